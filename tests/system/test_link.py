#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What else goes over the link between two network namespaces, and the link's faults: made by the real program, by
nftables and tc themselves, and given back. Needs root, and skips without. ONTIME names the program."""

import contextlib
import os
import pathlib
import signal
import sqlite3
import subprocess
import unittest

from program import Program, eventually, kill_at_once


class Link(Program):
    # --- concurrent traffic ---

    TRAFFIC = """
hosts: namespaces
defaults: {transport: [%s], period: 5 ms, duration: %s, traffic: {rate: 8 Mbit/s}}
runs:
  - id: both
  - {id: one-way, traffic: {direction: to-controller, datagram: 200 B, priority: 1}}
  - {id: too-much, traffic: {rate: 100 Gbit/s, direction: to-component}}
"""

    def test_traffic_flows_and_what_arrived_is_told(self):
        scenario = self.scenario("3 s", text=self.TRAFFIC, transports=["udp"])
        answer = self.run_ontime("run", scenario, "--only", "both,one-way", "--results", self.results)
        self.assertEqual(answer.returncode, 0, answer.stderr)
        both, one_way = self.report()
        self.assertEqual(set(both["conditions"]["traffic"]["achieved"]), {"to_component", "to_controller"})
        self.assertEqual(set(one_way["conditions"]["traffic"]["achieved"]), {"to_controller"})
        for run in (both, one_way):
            self.assertIsNone(run["error"])
            for way, rates in run["conditions"]["traffic"]["achieved"].items():
                with self.subTest(run=run["id"], way=way):
                    self.assertGreater(rates["received_bit_s"], 1e6)
                    self.assertTrue(rates["running"])
                    # It went over the link under test: the kernel counted it there.
                    carried = run["hosts"][way.removeprefix("to_")]["link"]["received_bytes"]
                    self.assertGreater(carried, rates["received_bit_s"] / 8 * 2)

    def test_traffic_that_was_not_there_is_said_loudly(self):
        scenario = self.scenario("2 s", text=self.TRAFFIC, transports=["udp"])
        answer = self.run_ontime("run", scenario, "--only", "too-much", "--results", self.results, "--full")
        self.assertEqual(answer.returncode, 0, answer.stderr)
        self.assertIn("of 100000 Mbit/s", answer.stderr)
        self.assertIn("TRAFFIC SHORTFALL", answer.stderr)
        self.assertIn("TRAFFIC SHORTFALL", answer.stdout)
        self.assertTrue(self.report()[0]["conditions"]["traffic"]["achieved"]["to_component"]["short"])

    def forget_results(self):
        for suffix in ("", "-wal", "-shm"):  # a killed writer leaves them beside it
            pathlib.Path(self.results + suffix).unlink(missing_ok=True)

    def test_traffic_dies_with_who_started_it(self):
        for whom in (lambda process: [process.pid], lambda _: self.keepers()):
            process = self.start_ontime("run", self.scenario("1 h", text=self.TRAFFIC, transports=["udp"]), "--only", "both",
                                        "--results", self.results)
            self.started(process, lambda: self.samples_recorded() > 50 and len(self.traffic()) == 4)
            kill_at_once(*whom(process))
            process.communicate(timeout=180)
            self.assertTrue(eventually(self.nothing_left), self.what_is_left())
            self.forget_results()

    def test_traffic_that_died_is_noticed(self):
        process = self.start_ontime("run", self.scenario("10 s", text=self.TRAFFIC, transports=["udp"]), "--only", "one-way",
                                    "--results", self.results)
        self.started(process, lambda: self.samples_recorded() > 50 and len(self.traffic()) == 2)
        for pid in self.traffic():
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        out, error = process.communicate(timeout=180)
        self.assertEqual(process.returncode, 0, error)
        self.assertIn("iperf3 died", error)

    # --- the link's faults ---

    # Real-time, so that what else this machine does delays no message by its timeout.
    FAULTS = """
hosts: namespaces
defaults: {transport: [%s], period: 5 ms, schedule: fixed, timeout: 1 s, duration: %s, realtime: on}
runs:
  - {id: lossy, link: {loss: 10 %%}}
  - {id: double, link: {duplicate: 50 %%}}
  - {id: cut, link: {cut: 100 ms for 500 ms}}
  - {id: slow, link: {delay: 2 ms}}
  - {id: busy, link: {loss: 10 %%}, traffic: {rate: 4 Mbit/s}}
"""

    def test_faults_of_the_link_lose_double_and_cut_and_each_loss_has_its_place(self):
        scenario = self.scenario("3 s", text=self.FAULTS, transports=["udp"])
        answer = self.run_ontime("run", scenario, "--only", "lossy,double,cut,busy", "--results", self.results, "--full")
        self.assertEqual(answer.returncode, 0, answer.stderr)
        lossy, double, cut, busy = self.report()
        for run in (lossy, double, cut, busy):
            self.assertIsNone(run["error"])
            self.assertIsNone(run["link_unproved"])
            self.assertEqual(run["sent"], run["on_time"] + run["late"] + run["lost"])
        ours = sum(host["link"]["faults"]["lost_frames"] for host in lossy["hosts"].values())
        self.assertGreater(ours, 0)
        self.assertLessEqual(lossy["lost"], ours)
        self.assertRegex(answer.stdout, r"link\.loss\s+dropped")
        self.assertGreater(double["duplicates"], 0)
        self.assertEqual(double["lost"], 0)
        self.assertGreater(cut["lost"], 0)
        self.assertEqual([note["kind"] for note in cut["notes"]], ["link-cut", "link-back"])
        gone, back = (note["at_s"] for note in cut["notes"])
        self.assertAlmostEqual(back - gone, 0.5)
        with contextlib.closing(sqlite3.connect(self.results)) as database:
            first, last = database.execute("SELECT min(sent), max(sent) FROM (SELECT (intended_ns + due_after_ns + woke_after_ns + "
                                           "sent_after_ns) / 1e9 AS sent FROM sample WHERE run = ? AND fate = 2)", (cut["run"],)).fetchone()
        # nft cuts one end after the other, and is noted once it has ended: on a busy machine each takes its time.
        self.assertLess(first, gone + 0.1)
        self.assertLess(last, back)
        self.assertLessEqual(cut["lost"], sum(host["link"]["faults"]["cut_off_frames"] for host in cut["hosts"].values()), "none at another time")

    def test_fault_that_the_kernel_has_not_is_refused_before_anything_is_run(self):
        scenario = self.scenario("3 s", text=self.FAULTS, transports=["udp"])
        answer = self.run_ontime("run", scenario, "--results", self.results)
        if answer.returncode == 0:
            self.skipTest("this kernel has netem")
        self.assertEqual(answer.returncode, 3, answer.stderr)
        self.assertRegex(answer.stderr, r"scenario.yaml:8: run 'slow': on the controller, link.delay")
        self.assertIn("sch_netem", answer.stderr)
        self.assertFalse(os.path.exists(self.results), "nothing was run")

    def test_faults_need_a_link_of_their_own(self):
        text = self.FAULTS.replace("namespaces", "loopback")
        answer = self.run_ontime("run", self.scenario("1 s", text=text, transports=["udp"]), "--only", "lossy",
                                 "--results", self.results)
        self.assertEqual(answer.returncode, 3, answer.stderr)
        self.assertIn("loopback", answer.stderr)

    def test_faults_on_somebody_elses_namespaces_are_given_back_whoever_is_killed(self):
        """There the namespaces stay, and what was done to them must not."""
        for command in ("netns add ot-left", "netns add ot-right", "link add ot-l netns ot-left type veth peer name ot-r netns ot-right",
                        "-n ot-left addr add 198.18.7.1/30 dev ot-l", "-n ot-right addr add 198.18.7.2/30 dev ot-r",
                        "-n ot-left link set ot-l up", "-n ot-right link set ot-r up"):
            subprocess.run(["ip", *command.split()], check=True)
        try:
            hosts = """{controller: {command-prefix: [ip, netns, exec, ot-left], interface: ot-l, address: 198.18.7.1},
                        component: {command-prefix: [ip, netns, exec, ot-right], interface: ot-r, address: 198.18.7.2}}"""
            text = self.FAULTS.replace("hosts: namespaces", "hosts: " + hosts)
            ours = ["run", self.scenario("1 h", text=text, transports=["udp"]), "--only", "busy", "--results", self.results]

            def tables():
                return "".join(subprocess.run(["ip", "netns", "exec", name, "nft", "list", "tables"], capture_output=True,
                                              text=True, check=True).stdout for name in ("ot-left", "ot-right"))

            for whom in (lambda process: [process.pid], lambda _: self.keepers()):
                process = self.start_ontime(*ours)
                self.assertTrue(eventually(lambda: self.samples_recorded() > 50),
                                process.poll() is not None and process.communicate())
                self.assertIn("table netdev ontime-controller", tables())
                self.assertIn("table inet ontime-component", tables())
                kill_at_once(*whom(process))
                process.communicate(timeout=180)
                self.assertTrue(eventually(lambda: not tables()), tables())
                self.assertTrue(eventually(self.nothing_left), self.what_is_left())
                self.forget_results()
            process = self.start_ontime(*ours)
            self.started(process, lambda: self.samples_recorded() > 50)
            kill_at_once(process.pid, *self.agents())
            process.communicate(timeout=180)
            self.assertIn("ontime-controller", tables())
            ours[1] = self.scenario("100 ms", text=text, transports=["udp"])
            answer = self.run_ontime(*ours)
            self.assertIn("nft-table", answer.stderr)
            self.assertEqual(tables(), "")
        finally:
            for name in ("ot-left", "ot-right"):
                subprocess.run(["ip", "netns", "del", name], check=True)


if __name__ == "__main__":
    unittest.main(verbosity=2)
