#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The real program between two network namespaces, with real DDS and real stress-ng. Needs root, and skips without.
ONTIME names the program."""

import contextlib
import json
import os
import pathlib
import signal
import sqlite3
import subprocess
import time
import unittest

from program import ONTIME, OUR_NAMESPACES, SCENARIO, TRANSPORTS, Program, namespaces, pages_moved


class System(Program):
    # --- the main job ---

    def test_scenario_between_two_namespaces(self):
        answer = self.run_ontime("run", self.scenario(), "--results", self.results)
        self.assertEqual(answer.returncode, 0, answer.stderr)
        runs = self.report()
        self.assertEqual([(run["id"], run["transport"]) for run in runs],
                         [(i, t) for i in ("idle", "loaded") for t in TRANSPORTS])
        for run in runs:
            with self.subTest(id=run["id"], transport=run["transport"]):
                self.assertTrue(run["complete"])
                self.assertGreater(run["sent"], 0)
                self.assertEqual(run["sent"], run["on_time"] + run["late"] + run["lost"])
                self.assertEqual(run["dropped_records"], 0)
                self.assertEqual(run["duplicates"], 0)
                self.assertLessEqual(run["strays"], run["lost"], "an answer that came too late is both")
                times = [run["round_trip_us"][key] for key in ("min", "p50", "p90", "p99", "p99.9", "max")]
                self.assertEqual(times, sorted(times))
                self.assertEqual(run["realtime"], run["id"] == "loaded")
                for host in ("controller", "component"):
                    self.assertEqual(run["hosts"][host]["transport"]["facts"]["carrier"], "UDPv4")
                    self.assertTrue(run["hosts"][host]["transport"]["facts"]["address"].startswith("198.18.0."))
        with contextlib.closing(sqlite3.connect(self.results)) as database:
            self.assertEqual(database.execute("SELECT count(*) FROM sample").fetchone()[0],
                             sum(run["sent"] for run in runs))

    def test_settings_are_as_the_kernel_says(self):
        before = pages_moved()
        answer = self.run_ontime("run", self.scenario(), "--only", "loaded", "--results", self.results)
        moved = pages_moved() - before
        self.assertEqual(answer.returncode, 0, answer.stderr)
        for run in self.report():
            for host in ("controller", "component"):
                with self.subTest("discovery is silent while it measures", transport=run["transport"], host=host):
                    # Lost ones, too: an answer that came too late was sent.
                    self.assertLess(run["hosts"][host]["link"]["sent_packets"], run["sent"] + 60)
                threads = run["hosts"][host]["threads"]
                roles = {thread["role"] for thread in threads}
                self.assertIn("receive", roles)
                self.assertTrue(host == "component" or "send" in roles)
                for thread in threads:
                    with self.subTest(transport=run["transport"], host=host, thread=thread["name"]):
                        wanted = ("fifo", 80 if thread["role"] in ("send", "receive", "delivery") else 70)
                        if thread["role"] == "resend":
                            wanted = ("other", 0)
                        self.assertEqual((thread["policy"], thread["priority"]), wanted)
                        self.assertEqual(thread["major_faults"], 0)
                        if thread["role"] in ("send", "receive"):
                            self.assertLessEqual(thread["minor_faults"], moved)

    def test_traffic_takes_the_link_and_no_other(self):
        """Loopback carries nothing but the datagram by which Cyclone DDS wakes its own threads at the end."""
        process = self.start_ontime("run", self.scenario("2 s"), "--only", "idle", "--results", self.results)
        self.started(process, lambda: OUR_NAMESPACES <= set(namespaces()) and self.agents())
        others = {}

        def bytes_of(name):
            text = subprocess.run(["ip", "netns", "exec", name, "cat", "/proc/net/dev"], capture_output=True, text=True).stdout
            return {line.split(":")[0].strip(): int(line.split(":")[1].split()[0]) for line in text.splitlines()[2:]}

        while process.poll() is None:
            for name in OUR_NAMESPACES:
                for interface, count in bytes_of(name).items():
                    others[(name, interface)] = count
            time.sleep(0.2)
        process.communicate()
        self.assertEqual(process.returncode, 0)
        self.assertGreater(max(c for (_, i), c in others.items() if i != "lo"), 100_000)
        self.assertLess(sum(c for (_, i), c in others.items() if i == "lo"), 1000)

    def test_ping_and_pong_start_in_any_order_and_come_and_go(self):
        arguments = ["--transport", "udp", "--interface", "lo", "--domain", "77"]
        ping = self.start_ontime("ping", *arguments, "--peer", "127.0.0.1", "--wait", "60 s", "--timeout", "10 s", "--duration", "300 ms",
                                 "--format", "json")
        time.sleep(0.3)
        pong = self.start_ontime("pong", *arguments)
        try:
            out, error = ping.communicate(timeout=180)
            self.assertEqual(ping.returncode, 0, error)
            self.assertEqual(json.loads(out)["runs"][0]["lost"], 0)
            again = self.run_ontime("ping", *arguments, "--peer", "127.0.0.1", "--duration", "300 ms", "--realtime",
                                    "--results", self.results)
            self.assertEqual(again.returncode, 0, again.stderr)
            self.assertTrue(self.report()[0]["realtime"], "a switch that stands alone says on")
            with open("/dev/full", "w") as full:
                for stream, code in (("stderr", 0), ("stdout", 3)):
                    streams = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, stream: full}
                    answer = subprocess.run([ONTIME, "ping", *arguments, "--peer", "127.0.0.1", "--duration", "50 ms"],
                                            **streams, timeout=60)
                    self.assertEqual(answer.returncode, code, stream)
        finally:
            pong.send_signal(signal.SIGINT)
            out, _ = pong.communicate(timeout=180)
        self.assertEqual(pong.returncode, 130)
        self.assertRegex(out, r"answered \d\d+ messages")

    # --- suites ---

    def suite(self):
        folder = pathlib.Path(self.folder, "suite")
        folder.mkdir(exist_ok=True)
        for name in ("one", "two"):
            (folder / f"{name}.yaml").write_text(
                "hosts: namespaces\nrepeat: 2\ndefaults: {transport: [udp], period: 5 ms, duration: 2 s}\n"
                f"runs: [{{id: {name}}}]\n")
        return folder

    def test_folder_is_run_in_order_and_goes_on_where_it_was_interrupted(self):
        folder = self.suite()
        process = self.start_ontime("run", str(folder), "--results", self.results, "--resume")
        self.started(process, lambda: len(self.recorded()) == 2)
        process.send_signal(signal.SIGTERM)
        _, error = process.communicate(timeout=180)
        self.assertEqual(process.returncode, 130, error)
        self.assertIn("4 runs, about 10 s", error)
        self.assertEqual([run["complete"] for run in self.report()], [True, False])
        answer = self.run_ontime("run", str(folder), "--results", self.results, "--resume")
        self.assertEqual(answer.returncode, 0, answer.stderr)
        self.assertRegex(answer.stderr, r"\[1/4, ≥ 8 s left\] one udp +skipped")
        self.assertEqual([(run["id"], run["repetition"]) for run in self.report() if run["complete"]],
                         [("one", 1), ("one", 2), ("two", 1), ("two", 2)])
        # What is asked otherwise is not done: neither a text that was changed, nor another duration.
        (folder / "two.yaml").write_text((folder / "two.yaml").read_text() + "# changed\n")
        answer = self.run_ontime("run", str(folder), "--results", self.results, "--resume")
        self.assertEqual(answer.stderr.count("skipped (already in results)"), 2, answer.stderr)
        answer = self.run_ontime("run", str(folder), "--results", self.results, "--resume", "--duration", "1 s")
        self.assertEqual(answer.stderr.count("skipped (already in results)"), 0, answer.stderr)
        # And what another machine did is nothing of this suite.
        with contextlib.closing(sqlite3.connect(self.results)) as database:
            database.execute("UPDATE run SET outcome = json_set(outcome, '$.hosts.component.machine.hostname', 'other')")
            database.commit()
        answer = self.run_ontime("run", str(folder), "--results", self.results, "--resume")
        self.assertEqual(answer.returncode, 2, answer.stderr)
        self.assertIn("another machine", answer.stderr)
        self.assertEqual(answer.stdout, "", "the old report would hide why")
        self.assertNotIn("page:", answer.stderr)

    def recorded(self):
        if not os.path.exists(self.results):
            return []
        try:
            with contextlib.closing(sqlite3.connect(f"file:{self.results}?mode=ro", uri=True)) as database:
                return database.execute("SELECT number FROM run").fetchall()
        except sqlite3.Error:
            return []

    def test_what_spins_for_locks_of_others_has_no_real_time_priority(self):
        if "fastdds" not in TRANSPORTS:
            self.skipTest("there is no transport fastdds")
        scenario = self.scenario("300 ms", transports=["fastdds"],
                                 text=SCENARIO.replace("- id: idle\n", "- id: idle\n    realtime: on\n"))
        answer = self.run_ontime("run", scenario, "--only", "idle", "--results", self.results)
        self.assertEqual(answer.returncode, 0, answer.stderr)
        for host in self.report()[0]["hosts"].values():
            policies = {thread["role"]: thread["policy"] for thread in host["threads"]}
            self.assertEqual(policies["receive"], "fifo")
            self.assertEqual(policies["resend"], "other")

    def test_scenarios_are_shown_with_a_line_each_and_found_by_name(self):
        answer = self.run_ontime("scenarios")
        self.assertEqual(answer.returncode, 0, answer.stderr)
        self.assertRegex(answer.stdout, r"(?m)^paper/test5 +The paper's Test 5, twelve hours: 6 runs, 72 h")
        shown = json.loads(self.run_ontime("scenarios", "--format", "json").stdout)
        self.assertIn("demo", [line["name"] for line in shown])
        self.assertTrue(all(line["error"] is None for line in shown), shown)
        answer = self.run_ontime("run", "paper/test1", "--only", "Test1.A", "--transports", "udp", "--duration", "100 ms",
                                 "--results", self.results, "--full")
        self.assertEqual(answer.returncode, 0, answer.stderr)
        self.assertIn("paper's DDS 1", answer.stdout)
        broken = pathlib.Path(self.folder, "broken.yaml")
        broken.write_text("runs: 5\n")
        answer = self.run_ontime("scenarios", str(broken))
        self.assertIn("cannot be run", answer.stdout)
        self.assertEqual(answer.returncode, 2)
        self.assertEqual(self.run_ontime("run", "no-such-thing").returncode, 2)

    # --- wrong input ---

    def test_wrong_input_is_said_and_nothing_is_made(self):
        other = os.path.join(self.folder, "other.txt")
        pathlib.Path(other).write_text("not a results file" * 100)
        newer = os.path.join(self.folder, "newer.ontime")
        self.run_ontime("run", self.scenario("50 ms", transports=["udp"]), "--only", "idle", "--results", newer)
        with contextlib.closing(sqlite3.connect(newer)) as database:
            database.execute("PRAGMA user_version = 999")
        scenario = self.scenario("50 ms", transports=["udp"])
        two_hosts = pathlib.Path(self.folder, "two.yaml")
        two_hosts.write_text("hosts: {controller: {interface: lo}, component: {interface: rb, address: 127.0.0.1}}\n"
                             "runs: [{id: a, transport: udp, duration: 50 ms}]\n")
        cases = [
            (["report", other], 2, "results file"),
            (["report", newer], 2, "newer"),
            (["report", os.path.join(self.folder, "none.ontime")], 2, "none.ontime"),
            (["run", scenario, "--results", other], 2, "results file"),
            (["run", scenario, "--results", os.path.join(self.folder, "no", "such", "x.ontime")], None, "x.ontime"),
            (["run", scenario, "--only", "nix"], 2, "nix"),
            (["run", scenario, "--transports", "telepathy", "--results", self.results], 2, "telepathy"),
            (["run", os.path.join(self.folder, "none.yaml")], 2, "none.yaml"),
            (["ping", "--transport", "udp", "--payload", "70 kB", "--peer", "127.0.0.1"], 2, "65475"),
            (["ping", "--transport", "udp", "--peer", "::1"], 2, "IPv4"),
            (["ping", "--transport", "udp", "--interface", "nonet0", "--peer", "127.0.0.1"], 2, "nonet0"),
            (["ping", "--transport", "cyclonedds", "--interface", "lo", "--domain", "99", "--wait", "500 ms"], 3, "pong"),
            (["ping", "--transport", "udp", "--peer", "127.0.0.1", "--period", ""], 2, "--period"),
            (["ping", "--transport", "udp", "--peer", "127.0.0.1", "--interface", ""], 2, "--interface"),
            (["ping", "--transport", "udp", "--peer", "127.0.0.1", "--results", ""], 2, "--results"),
            (["ping", "--transport", "udp", "--peer", ""], 2, "--peer"),
            (["ping", "--transport", "udp", "--peer", "127.0.0.1", "--timeout", "99999 h"], 2, "--timeout"),
            (["run", scenario, "--transports", "udp,foo"], 2, "foo"),
            (["run", scenario, "--transports", "udp,udp"], 2, "--transports: 'udp' occurs twice"),
            (["run", scenario, "r.ontime"], 2, "--results r.ontime"),
            (["report", newer, "quiet"], 2, "Fix: --only quiet"),
            (["explain", newer, "3"], 2, "Fix: --only 3"),
            (["search"], 2, "did you mean 'tune search'?"),
            (["run", str(two_hosts), "--results", self.results], 2, "on the component, this host has no interface 'rb'"),
            (["ping"], 2, "transport"),
            (["ping", "--transport", "udp", "--peer", "127.0.0.1", "--wait", "2000000 h"], 2, "--wait"),
            ([], 0, "ontime --help"),
            (["dance"], 2, "'dance'"),
            (["listen", "--for", "500 ms"], 2, "--for: '500 ms' is too short"),
        ]
        for arguments, code, word in cases:
            with self.subTest(arguments=arguments):
                answer = self.run_ontime(*arguments, cwd=self.folder)
                if code is None:
                    self.assertIn(answer.returncode, (2, 3))
                else:
                    self.assertEqual(answer.returncode, code, answer.stderr)
                self.assertIn(word, answer.stderr + answer.stdout)
                self.assertNotIn("terminate called", answer.stderr)
        self.assertEqual(pathlib.Path(other).read_text(), "not a results file" * 100)

    def test_bare_name_is_the_installed_scenario_and_a_path_has_a_slash_or_a_suffix(self):
        impostor = "title: IMPOSTOR\nruns: [{id: one, transport: udp, duration: 50 ms}]\n"
        pathlib.Path(self.folder, "paper").mkdir()
        for name in ("demo", "mine", "mine.yaml", "paper/test1"):
            pathlib.Path(self.folder, name).write_text(impostor)
        installed = self.run_ontime("scenarios", "demo", cwd=self.folder)
        self.assertEqual(installed.returncode, 0, installed.stderr)
        self.assertNotIn("IMPOSTOR", installed.stdout)
        self.assertNotIn("IMPOSTOR", self.run_ontime("scenarios", "paper/test1", cwd=self.folder).stdout)
        for path in ("./demo", "mine.yaml", "./paper/test1"):
            self.assertIn("IMPOSTOR", self.run_ontime("scenarios", path, cwd=self.folder).stdout, path)
        refused = self.run_ontime("scenarios", "mine", cwd=self.folder)
        self.assertEqual(refused.returncode, 2, refused.stdout)
        self.assertIn("./mine", refused.stderr)


if __name__ == "__main__":
    unittest.main(verbosity=2)
