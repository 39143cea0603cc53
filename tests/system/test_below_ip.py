#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The transports below IP, by the real program between two network namespaces. Needs root, and skips without. ONTIME
names the program."""

import json
import pathlib
import subprocess
import unittest

from program import ONTIME, Program, eventually, kill_at_once, pages_moved

SCENARIO = """
hosts: namespaces
defaults: {transport: [%s], period: 5 ms, timeout: 5 s, duration: %s}
runs:
  - {id: listener}
  - {id: waitset, receive: waitset, realtime: on}
  - {id: traffic, traffic: {rate: 8 Mbit/s}}
"""

NAMESPACE = "ontime-test-below"


def transports():
    there = {path.name for path in pathlib.Path(ONTIME).parent.parent.glob("lib/**/ontime_transport_*.so")}
    return [name for name in ("ethernet", "xdp") if f"ontime_transport_{name}.so" in there]


class BelowIp(Program):
    def test_between_two_namespaces_nothing_is_lost(self):
        before = pages_moved()
        answer = self.run_ontime("run", self.scenario("1 s", text=SCENARIO, transports=transports()), "--full", "--only",
                                 "listener,waitset", "--results", self.results)
        moved = pages_moved() - before
        self.assertEqual(answer.returncode, 0, answer.stderr)
        runs = self.report()
        self.assertEqual(len(runs), 2 * len(transports()))
        for run in runs:
            with self.subTest(id=run["id"], transport=run["transport"]):
                self.assertIsNone(run["error"])
                self.assertEqual(run["sent"] + run["skipped_cycles"], 200)
                self.assertGreater(run["sent"], 20)
                self.assertEqual((run["lost"], run["duplicates"], run["strays"], run["dropped_records"]), (0, 0, 0, 0))
                for host in ("controller", "component"):
                    facts = run["hosts"][host]["transport"]["facts"]
                    self.assertEqual(facts["carrier"], "Ethernet")
                    self.assertEqual(run["hosts"][host]["losses"], {"on_the_way": None, "overwritten": 0})
                    for thread in run["hosts"][host]["threads"]:
                        if run["id"] == "waitset":
                            self.assertEqual((thread["policy"], thread["priority"]), ("fifo", 80))
                            self.assertLessEqual(thread["minor_faults"], moved)
                    if run["transport"] == "xdp":
                        self.assertRegex(facts["xdp"], "^(native|generic) (zero-)?copy$")
                if run["transport"] == "xdp":
                    self.assertIn("xdp " + facts["xdp"], answer.stdout)

    def test_other_traffic_of_the_link_goes_on(self):
        """iperf3's UDP arrives, past the XDP program. Messages cannot be counted apart from it on the link."""
        answer = self.run_ontime("run", self.scenario("3 s", text=SCENARIO, transports=transports()), "--full", "--only", "traffic",
                                 "--results", self.results)
        self.assertEqual(answer.returncode, 0, answer.stderr)
        for run in self.report():
            with self.subTest(transport=run["transport"]):
                self.assertIsNone(run["error"])
                for way, rates in run["conditions"]["traffic"]["achieved"].items():
                    self.assertGreater(rates["sent_bit_s"], 1e5, way)  # how much, a busy machine decides
                    self.assertGreater(rates["received_bit_s"], rates["sent_bit_s"] / 2, way)
                self.assertNotIn("beside_traffic", run["hosts"]["component"]["link"])
        self.assertIn("not verified that the messages used ", " ".join(answer.stdout.split()))

    def test_what_xdp_passes_by_is_refused(self):
        for keys, words in (("link: {loss: 1 %}", "xdp bypasses"), ("explain: on", "explain cannot follow")):
            with self.subTest(keys):
                path = pathlib.Path(self.folder, "refused.yaml")
                path.write_text(f"hosts: namespaces\nruns: [{{id: a, transport: xdp, {keys}}}]\n")
                answer = self.run_ontime("run", str(path))
                self.assertEqual(answer.returncode, 2, answer.stderr)
                self.assertIn(words, answer.stderr)

    def test_link_of_ethernet_has_its_faults(self):
        path = pathlib.Path(self.folder, "faults.yaml")
        path.write_text("hosts: namespaces\nruns: [{id: a, transport: ethernet, schedule: fixed, period: 2 ms, duration: 2 s,"
                        " link: {loss: 20 %}, traffic: {rate: 1 Mbit/s}}]\n")
        answer = self.run_ontime("run", str(path), "--results", self.results)
        run = self.report()[0]
        self.assertIsNone(run["error"], answer.stderr)
        self.assertGreater(run["lost"], 10)
        self.assertGreater(run["on_time"], 10)

    def test_nothing_is_left_of_an_end_that_is_killed(self):
        def ip(*words, check=True):
            return subprocess.run(["ip", *words], capture_output=True, text=True, check=check).stdout

        ip("netns", "add", NAMESPACE)
        self.addCleanup(ip, "netns", "delete", NAMESPACE)
        ip("-n", NAMESPACE, "link", "add", "near", "type", "veth", "peer", "name", "far")
        for name, address in (("near", "10.9.0.1/24"), ("far", "10.9.0.2/24")):
            ip("-n", NAMESPACE, "address", "add", address, "dev", name)
            ip("-n", NAMESPACE, "link", "set", name, "up")

        def has_program():
            return "xdp" in ip("-n", NAMESPACE, "link", "show", "dev", "far")

        place = ["ip", "netns", "exec", NAMESPACE, ONTIME]
        for transport in transports():
            with self.subTest(transport):
                for _ in range(2):  # the second finds what the killed one held free again
                    pong = subprocess.Popen([*place, "pong", "--transport", transport, "--interface", "far"], env=self.environment,
                                            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
                    ping = subprocess.run([*place, "ping", "--transport", transport, "--interface", "near", "--peer", "10.9.0.2",
                                           "--duration", "300 ms", "--timeout", "5 s", "--format", "json"], env=self.environment,
                                          capture_output=True, text=True, timeout=60)
                    self.assertEqual(ping.returncode, 0, ping.stderr)
                    self.assertEqual(json.loads(ping.stdout)["runs"][0]["lost"], 0)
                    self.assertEqual(has_program(), transport == "xdp")
                    kill_at_once(pong.pid, *self.agents())
                    pong.communicate(timeout=180)
                    self.assertTrue(eventually(lambda: not has_program()))


if __name__ == "__main__":
    unittest.main()
