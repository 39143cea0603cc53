#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Ordinary topics beside the critical one, in its participant, in its process and in another: all counted, and as
ordinary as they are said to be. Needs root, and skips without. ONTIME names the program."""

import json
import os
import signal
import unittest

from program import TRANSPORTS, Program, sample_count

SCENARIO = """
hosts: namespaces
defaults: {transport: [%s], period: 5 ms, duration: %s}
runs:
  - id: beside
    realtime: on
    background: {topics: 3, rate: 100 Hz, payload: 2 kB, reliability: reliable,
                 where: [same-participant, same-process, other-process]}
"""
SEARCH = """
hosts: namespaces
repeat: 2
defaults: {transport: [%s], period: 1 s, deadline: 5 s, timeout: 5 s, duration: %s}
runs:
  - {id: up, search: background.rate, background: {topics: 1, rate: [1 Hz, 2 Hz, 100 kHz], payload: 20 kB, direction: to-component}}
"""
OVERRUN = """
hosts: namespaces
defaults: {transport: [%s], period: 5 ms, duration: %s}
runs:
  - {id: beside, background: {topics: 1, rate: 50 Hz, callback: 40 ms, direction: to-component, where: other-process}}
"""
STARVED = """
hosts: namespaces
defaults: {transport: [%s], period: 500 ms, deadline: 2 s, timeout: 2 s, warm-up: 50, duration: %s}
runs:
  - {id: up, search: background.callback,
     background: {topics: 1, rate: 10 Hz, callback: [1 ms, 10 s], direction: to-component, reliability: reliable}}
"""
KILLED = """
hosts: namespaces
defaults: {transport: [%s], period: 500 ms, deadline: 2 s, timeout: 2 s, duration: %s}
runs:
  - {id: up, search: background.rate, background: {topics: 1, rate: [1 Hz, 2 Hz, 3 Hz], reliability: reliable}}
"""
DDS = [name for name in TRANSPORTS if name != "udp"]


class Neighbours(Program):
    def test_of_every_kind_are_counted_and_ordinary(self):
        for transport in DDS:
            with self.subTest(transport=transport):
                self.results = os.path.join(self.folder, transport + ".ontime")
                scenario = self.scenario("1 s", text=SCENARIO, transports=[transport])
                answer = self.run_ontime("run", scenario, "--results", self.results)
                self.assertEqual(answer.returncode, 0, answer.stderr)
                for run in self.report():
                    self.assertTrue(run["complete"])
                    self.assertIsNone(run["error"])
                    self.assertIn("background topics", run["remarks"].lower())
                    self.counted(run)
                    self.ordinary(run)
                self.assertEqual(len(self.report()), 3)
                self.assertEqual(len({run["key"] for run in self.report()}), 3)

    def counted(self, run):
        for way, counted in run["conditions"]["background"]["achieved"].items():
            with self.subTest(way=way, run=run["variant"]):
                self.assertEqual(counted["sent"] + counted["refused"] + counted["skipped_cycles"], 300, "three, 100 times")
                self.assertGreater(counted["received"], 0)
                self.assertEqual(counted["lost"], counted["sent"] - counted["received"])
                self.assertEqual(counted["strays"], 0)

    def ordinary(self, run):
        for name, host in run["hosts"].items():
            beside = [thread for thread in host["threads"] if thread["role"].startswith("background ")]
            with self.subTest(host=name, run=run["variant"]):
                self.assertIn("background send", [thread["role"] for thread in beside])
                self.assertEqual({thread["policy"] for thread in beside}, {"other"})
                critical = [thread for thread in host["threads"] if thread["role"] in ("send", "receive")]
                self.assertTrue(critical)
                refused = [refusal["asked"] for refusal in host["refusals"]]
                for thread in critical:
                    if not any(asked.startswith("SCHED_FIFO") and asked.endswith(thread["role"]) for asked in refused):
                        self.assertEqual(thread["policy"], "fifo", (thread, refused))

    def test_are_turned_up_until_no_more_is_to_be_had_and_that_goes_on_where_it_was_left(self):
        scenario = self.scenario("5 s", text=SEARCH, transports=DDS[:1])
        answer = self.run_ontime("run", scenario, "--results", self.results, "--full")
        self.assertEqual(answer.returncode, 0, answer.stderr)
        self.assertIn("highest background.rate without a miss", answer.stdout)
        first = self.report()
        steps = [(run["variant"], run["repetition"]) for run in first]
        self.assertEqual(steps[:4], [(f"background.rate {rate}", times) for rate in ("1 Hz", "2 Hz") for times in (1, 2)])
        self.assertEqual(steps[4][0], "background.rate 100 kHz")
        (search,) = self.searches()
        self.assertEqual(search["key"], "background.rate")
        self.assertEqual(search["passed"]["value"], "2 Hz")
        self.assertEqual(search["passed"]["messages"], 10, "of both times")
        self.assertEqual(search["ended"]["value"], "100 kHz", "two gigabytes a second are nowhere to be had")
        again = self.run_ontime("run", scenario, "--results", self.results, "--resume")
        self.assertEqual(again.returncode, 0, again.stderr)
        self.assertEqual(len(self.report()), len(first), "resumed: all runs were in the results")

    def searches(self):
        return json.loads(self.run_ontime("report", self.results, "--format", "json").stdout)["searches"]

    def test_end_a_search_where_they_leave_no_time_to_answer(self):
        answer = self.run_ontime("run", self.scenario("8 s", text=STARVED, transports=["cyclonedds"]), "--results", self.results)
        self.assertEqual(answer.returncode, 0, answer.stderr)
        self.assertRegex(answer.stderr, "search of background.callback ends at 10 s: .*warm-up")
        (search,) = self.searches()
        self.assertEqual(search["passed"]["value"], "1 ms")
        self.assertEqual(search["ended"]["value"], "10 s")
        self.assertTrue(search["ended"]["failed"])
        self.assertTrue(search["finished"])

    def test_are_not_what_a_search_breaks_off_at_where_an_end_dies(self):
        process = self.start_ontime("run", self.scenario("4 s", text=KILLED, transports=DDS[:1]), "--results", self.results)
        self.started(process, lambda: sample_count(self.results, 2) > 0)
        os.kill(self.own("/ontime agent")[0], signal.SIGKILL)
        self.assertEqual(process.wait(180), 3, process.stderr.read())
        (search,) = self.searches()
        self.assertEqual(search["passed"]["value"], "1 Hz")
        self.assertIsNone(search["ended"])
        self.assertFalse(search["finished"])
        self.assertEqual(len(self.report()), 2, "no harsher value is tried")

    def test_whose_callbacks_overrun_their_period_are_not_those_that_were_asked_for(self):
        answer = self.run_ontime("run", self.scenario("4 s", text=OVERRUN, transports=DDS[:1]), "--results", self.results)
        self.assertEqual(answer.returncode, 0, answer.stderr)
        self.assertRegex(answer.stderr, r"BACKGROUND TOPICS SHORTFALL: .*\d+ with a callback")
        (run,) = self.report()
        counted = run["conditions"]["background"]["achieved"]["to_component"]
        self.assertTrue(counted["short"])
        self.assertGreater(counted["overruns"], 0)
        self.assertIn("BACKGROUND TOPICS SHORTFALL", run["remarks"])

    def test_of_a_transport_without_topics_are_refused(self):
        answer = self.run_ontime("run", self.scenario("1 s", text=SCENARIO, transports=["udp"]), "--results", self.results)
        self.assertEqual(answer.returncode, 2)
        self.assertIn("transport udp has no topics", answer.stderr)
        self.assertFalse(os.path.exists(self.results))


if __name__ == "__main__":
    unittest.main()
