#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""One controller with several components, each with a round trip of its own at the same time. Needs root, and skips
without. ONTIME names the program."""

import contextlib
import json
import os
import signal
import sqlite3
import subprocess
import unittest

from program import TRANSPORTS, Program, eventually, namespaces

SCENARIO = """
hosts: namespaces
components: [left_arm, base]
defaults: {transport: [%s], period: 5 ms, duration: %s}
runs:
  - id: idle
    load: {component: {cpu: 1}}
"""
NAMESPACES = {"ontime-controller", "ontime-left-arm", "ontime-base"}


class Components(Program):
    def nothing_left(self):
        return super().nothing_left() and not NAMESPACES & set(namespaces())

    def spans(self):
        """Of each run, when its first message was sent and its last."""
        with contextlib.closing(sqlite3.connect(f"file:{self.results}?mode=ro", uri=True)) as database:
            return database.execute("SELECT start_ns, start_ns + max(intended_ns) FROM run JOIN sample ON run.number = sample.run GROUP BY run ORDER BY run").fetchall()

    def test_each_has_a_row_and_they_were_measured_at_the_same_time(self):
        for transport in TRANSPORTS:
            with self.subTest(transport=transport):
                self.results = os.path.join(self.folder, transport + ".ontime")
                scenario = self.scenario("2 s", text=SCENARIO, transports=[transport])
                answer = self.run_ontime("run", scenario, "--results", self.results, "--full")
                self.assertEqual(answer.returncode, 0, answer.stderr)
                for name in ("left_arm", "base"):
                    self.assertRegex(answer.stdout, rf"(?m)^{transport} component {name}( \(.*\))?\s+\d")  # a narrow table has the name on a line of its own
                arm, base = self.report()
                self.assertNotEqual(arm["key"], base["key"])
                addresses = set()
                for run, name in ((arm, "left_arm"), (base, "base")):
                    self.assertTrue(run["complete"])
                    self.assertEqual(run["conditions"]["component"], name)
                    self.assertEqual(run["conditions"]["ping_topic"], "/ping" if transport == "udp" else f"/{name}/ping")
                    self.assertEqual(run["sent"] + run["skipped_cycles"], 400)
                    self.assertGreater(run["on_time"] + run["late"], run["lost"])
                    self.assertLessEqual(run["strays"], run["lost"], "none answers another's; one that came too late is lost")
                    self.assertEqual(run["duplicates"], 0)
                    self.assertLessEqual(run["hosts"]["component"]["answered"], run["sent"] + 10, "with its warm-up")
                    self.assertEqual([run["hosts"][host]["load_running"] for host in ("controller", "component")], [None, True])
                    addresses.add(run["hosts"]["component"]["transport"]["facts"]["address"])
                self.assertEqual(len(addresses), 2)
                (one_began, one_ended), (other_began, other_ended) = self.spans()
                self.assertLess(max(one_began, other_began), min(one_ended, other_ended))

    def test_of_hosts_of_your_own_each_is_where_it_is_said_to_be(self):
        names = ["ot-near", "ot-arm", "ot-base"]
        commands = [f"netns add {name}" for name in names]
        for number, name in enumerate(names[1:]):
            commands += [f"link add {name} netns ot-near type veth peer name far netns {name}",
                         f"-n ot-near addr add 198.18.{number}.1/29 dev {name}", f"-n {name} addr add 198.18.{number}.2/29 dev far",
                         f"-n ot-near link set {name} up", f"-n {name} link set far up"]
        commands.append("-n ot-arm addr add 198.18.0.3/29 dev far")  # the stated one is the second of its interface
        try:
            for command in commands:
                subprocess.run(["ip", *command.split()], check=True)
            text = SCENARIO.replace("hosts: namespaces", "hosts: {controller: {command-prefix: [ip, netns, exec, ot-near]}}").replace(
                "[left_arm, base]", """{arm: {command-prefix: [ip, netns, exec, ot-arm], interface: far, address: 198.18.0.3},
                                        base: {command-prefix: [ip, netns, exec, ot-base], interface: far, address: 198.18.1.2}}""")
            answer = self.run_ontime("run", self.scenario("1 s", text=text, transports=["udp"]), "--results", self.results)
            self.assertEqual(answer.returncode, 0, answer.stderr)
            for run, address in zip(self.report(), ("198.18.0.3:", "198.18.1.2:")):
                self.assertTrue(run["complete"])
                self.assertTrue(run["hosts"]["component"]["transport"]["facts"]["address"].startswith(address))
                self.assertEqual(run["hosts"]["component"]["link"]["interface"], "far")
            # The same place in other words: what answers is not the arm.
            wrong = self.scenario("1 s", text=text.replace("address: 198.18.0.3}", "address: '198.18.1.2:7900'}"), transports=["udp"])
            answer = self.run_ontime("run", wrong, "--results", self.results)
            self.assertEqual(answer.returncode, 3, answer.stderr)
            self.assertRegex(answer.stderr, r"arm: the component answered 0 messages.*another program")
            self.assertIn("another program", self.report()[2]["error"])
        finally:
            for name in names:
                subprocess.run(["ip", "netns", "del", name], check=False)

    def test_each_may_have_conditions_of_its_own_and_its_row_says_so(self):
        text = SCENARIO.replace("period: 5 ms,", "left_arm: {period: 2 ms, deadline: 2 ms, payload: 64 B, require: [p50 <= 1 us]}, period: 5 ms,")
        answer = self.run_ontime("run", self.scenario("1 s", text=text, transports=["udp"]), "--results", self.results, "--full")
        self.assertEqual(answer.returncode, 1, "what only the arm requires is missed: " + answer.stderr)
        arm, base = self.report()
        self.assertEqual([run["period_us"] for run in (arm, base)], [2000, 5000])
        self.assertEqual([run["payload_bytes"] for run in (arm, base)], [64, 500])
        self.assertEqual([run["sent"] + run["skipped_cycles"] for run in (arm, base)], [500, 200])
        self.assertRegex(answer.stdout, r"(?m)^udp component left_arm 64 B every 2 ms")
        self.assertRegex(answer.stdout, r"(?m)^udp component base 500 B every 5 ms")

    def test_traffic_flows_between_the_controller_and_whom_it_is_said_of(self):
        text = SCENARIO.replace("{component: {cpu: 1}}", "{component: {cpu: 0}}\n    traffic: {rate: 4 Mbit/s}") + (
            "  - {id: one, base: {traffic: {rate: 4 Mbit/s, direction: to-component}}}\n")
        answer = self.run_ontime("run", self.scenario("2 s", text=text, transports=["udp"]), "--results", self.results)
        self.assertEqual(answer.returncode, 0, answer.stderr)
        runs = self.report()
        achieved = [run["conditions"]["traffic"]["achieved"] for run in runs]
        self.assertEqual([set(ways or {}) for ways in achieved],
                         [{"to_component", "to_controller"}, {"to_component", "to_controller"}, set(), {"to_component"}])
        for run, ways in zip(runs, achieved):
            self.assertIsNone(run["error"])
            self.assertIsNone(run["link_unproved"])
            carried = run["hosts"]["component"]["link"]["received_bytes"]
            if ways:
                self.assertGreater(ways["to_component"]["received_bit_s"], 1e6)
                self.assertGreater(carried, ways["to_component"]["received_bit_s"] / 8)
            else:
                self.assertLess(carried, 400 * 1000, "the other's traffic is not on its link")

    def test_traffic_of_another_at_the_same_address_proves_nothing_of_ones_messages(self):
        names = ["ot-near", "ot-both"]
        commands = ["link add both netns ot-near type veth peer name far netns ot-both", "-n ot-near addr add 198.18.0.1/30 dev both",
                    "-n ot-both addr add 198.18.0.2/30 dev far", "-n ot-near link set both up", "-n ot-both link set far up"]
        text = """
hosts: {controller: {command-prefix: [ip, netns, exec, ot-near], interface: both}}
components:
  arm: &both {command-prefix: [ip, netns, exec, ot-both], interface: far, address: 198.18.0.2}
  base: *both
defaults: {transport: cyclonedds, period: 5 ms, duration: 2 s, base: {traffic: {rate: 4 Mbit/s}}}
runs:
  - id: counted
  - {id: uncounted, base: {transport: ethernet}}
"""
        path = os.path.join(self.folder, "scenario.yaml")
        with open(path, "w", encoding="utf-8") as file:
            file.write(text)
        try:
            for command in [f"netns add {name}" for name in names] + commands:
                subprocess.run(["ip", *command.split()], check=True)
            answer = self.run_ontime("run", path, "--results", self.results)
            self.assertEqual(answer.returncode, 0, answer.stderr)
            arm, base, beside_ethernet, _ = self.report()
            for run in (arm, base):
                self.assertIsNone(run["link_unproved"])
                for host in run["hosts"].values():
                    self.assertLess(host["link"]["beside_traffic"]["received_bytes"], host["link"]["received_bytes"])
            self.assertIn("cannot count them apart from the traffic", beside_ethernet["link_unproved"] or "")
            self.assertEqual(arm["conditions"]["others"]["base"]["traffic"]["bit_s"], 4000000)
        finally:
            for name in names:
                subprocess.run(["ip", "netns", "del", name], check=False)

    def test_faults_are_of_the_link_that_they_are_said_of(self):
        # Real-time, so that what else this machine does delays no message by its timeout; cut at once, as nft takes its time, too.
        text = SCENARIO.replace("duration: %s", "duration: %s, schedule: fixed, timeout: 1 s, realtime: on").replace("load: {component: {cpu: 1}}", "base: {link: {loss: 20 %%}}") + (
            "  - {id: cut, link: {cut: 100 ms for 1 s}}\n  - {id: cut-one, left_arm: {link: {cut: 100 ms for 1 s}}}\n")
        answer = self.run_ontime("run", self.scenario("2 s", text=text, transports=["udp"]), "--results", self.results)
        self.assertEqual(answer.returncode, 0, answer.stderr)
        runs = self.report()
        ours = [{name: host["link"].get("faults") for name, host in run["hosts"].items()} for run in runs]
        self.assertEqual(ours[0], {"controller": None, "component": None})
        frames = sum(faults["lost_frames"] for faults in ours[1].values())
        self.assertGreater(frames, 0)
        self.assertGreater(runs[1]["lost"], 0)
        self.assertLessEqual(runs[1]["lost"], frames)
        self.assertEqual([[note["kind"] for note in run["notes"]] for run in runs[2:]],
                         [["link-cut", "link-back"], ["link-cut", "link-back"], ["link-cut", "link-back"], []])
        self.assertGreater(min(run["lost"] for run in runs[2:5]), 0)

    def test_explained_each_has_windows_of_its_own_messages(self):
        text = SCENARIO.replace("load: {component: {cpu: 1}}", "load: {component: {cpu: 2}}\n    explain: on\n    base: {link: {loss: 20 %%}}")
        text = text.replace("duration: %s", "duration: %s, timeout: 100 ms")
        answer = self.run_ontime("run", self.scenario("2 s", text=text, transports=["udp"]), "--results", self.results)
        if "tracefs" in answer.stderr:
            self.skipTest(answer.stderr)
        self.assertEqual(answer.returncode, 0, answer.stderr)
        explained = self.run_ontime("explain", self.results, "--format", "json")
        self.assertEqual(explained.returncode, 0, explained.stderr)
        arm, base = json.loads(explained.stdout)
        self.assertEqual([arm["component"], base["component"]], ["left_arm", "base"])
        for run in (arm, base):
            self.assertTrue(run["traced"])
            self.assertGreater(len(run["messages"]), 0)
        causes = {message["parts"][0]["cause"] for message in base["messages"] if message["fate"] == "lost"}
        self.assertIn("dropped", causes, "also where a bridge handed the packet on")

    def test_one_alone_may_have_a_name(self):
        text = SCENARIO.replace("[left_arm, base]", "[left_arm]")
        answer = self.run_ontime("run", self.scenario("500 ms", text=text, transports=["udp"]), "--results", self.results)
        self.assertEqual(answer.returncode, 0, answer.stderr)
        self.assertEqual([run["conditions"]["component"] for run in self.report()], ["left_arm"])

    def test_interrupted_all_are_kept_and_resumed_all_are_done_once(self):
        process = self.start_ontime("run", self.scenario("1 h", text=SCENARIO, transports=["udp"]), "--results", self.results)
        self.started(process, lambda: self.samples_recorded() > 100)
        process.send_signal(signal.SIGINT)
        _, error = process.communicate(timeout=180)
        self.assertEqual(process.returncode, 130, error)
        for run in self.report():
            self.assertTrue(run["interrupted"])
            self.assertGreater(run["sent"], 10)
            self.assertEqual(run["sent"], run["on_time"] + run["late"] + run["lost"])
        again = ["run", self.scenario("500 ms", text=SCENARIO, transports=["udp"]), "--results", self.results, "--resume"]
        self.assertEqual(self.run_ontime(*again).returncode, 0)
        answer = self.run_ontime(*again)
        self.assertIn("skipped (already in results)", answer.stderr)
        self.assertEqual([run["complete"] for run in self.report()], [False, False, True, True])
        with contextlib.closing(sqlite3.connect(self.results)) as database, database:
            database.execute("UPDATE run SET outcome = NULL WHERE number = 4")
        answer = self.run_ontime(*again)
        self.assertRegex(answer.stderr, "1 of 2 components .*in the results")
        self.assertEqual([run["complete"] for run in self.report()], [False, False, True, False, True, True])

    def test_one_that_dies_ends_all_and_is_named(self):
        process = self.start_ontime("run", self.scenario("1 h", text=SCENARIO, transports=["udp"]), "--results", self.results)
        self.started(process, lambda: self.samples_recorded() > 100)
        pids = subprocess.run(["ip", "netns", "pids", "ontime-base"], capture_output=True, text=True, check=True).stdout.split()
        self.assertEqual(len(pids), 1)
        os.kill(int(pids[0]), signal.SIGKILL)
        _, error = process.communicate(timeout=180)
        self.assertEqual(process.returncode, 3, error)
        self.assertIn("the agent of the base", error)
        for run in self.report():
            self.assertIn("the agent of the base", run["error"])
            self.assertGreater(run["sent"], 10)
            self.assertEqual(run["sent"], run["on_time"] + run["late"] + run["lost"])

    def test_one_that_dies_is_started_again_if_asked(self):
        text = SCENARIO.replace("duration: %s", "duration: %s, component: {restart: on}")
        process = self.start_ontime("run", self.scenario("4 s", text=text, transports=["udp"]), "--results", self.results)
        self.started(process, lambda: self.samples_recorded() > 200)
        pids = subprocess.run(["ip", "netns", "pids", "ontime-base"], capture_output=True, text=True, check=True).stdout.split()
        os.kill(int(pids[0]), signal.SIGKILL)
        _, error = process.communicate(timeout=180)
        self.assertEqual(process.returncode, 0, error)
        arm, base = self.report()
        self.assertEqual([note["kind"] for note in arm["notes"]], [])
        self.assertEqual([note["kind"] for note in base["notes"]], ["component-gone", "component-back"])
        self.assertGreater(base["lost"], 0)

    def test_all_that_die_together_are_started_again_and_each_is_told_of(self):
        text = SCENARIO.replace("duration: %s", "duration: %s, component: {restart: on}").replace("base]", "base, hand]")
        process = self.start_ontime("run", self.scenario("6 s", text=text, transports=["udp"]), "--results", self.results)
        self.started(process, lambda: self.samples_recorded() > 300)
        for name in ("left-arm", "base", "hand"):
            pids = subprocess.run(["ip", "netns", "pids", f"ontime-{name}"], capture_output=True, text=True, check=True).stdout.split()
            os.kill(int(pids[0]), signal.SIGKILL)
        _, error = process.communicate(timeout=180)
        self.assertEqual(process.returncode, 0, error)
        for run, name in zip(self.report(), ("left_arm", "base", "hand")):
            self.assertEqual([note["kind"] for note in run["notes"]], ["component-gone", "component-back"])
            self.assertIn(f"the agent of the {name} ", run["notes"][0]["text"])
            self.assertTrue(run["hosts"]["component"]["started_again"])

    def test_killed_coordinator_leaves_nothing(self):
        process = self.start_ontime("run", self.scenario("1 h", text=SCENARIO, transports=["udp"]), "--results", self.results)
        self.started(process, lambda: self.samples_recorded() > 100)
        process.kill()
        process.communicate(timeout=180)
        self.assertTrue(eventually(self.nothing_left), self.what_is_left())


if __name__ == "__main__":
    unittest.main(verbosity=2)
