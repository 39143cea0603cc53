#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What `ontime listen` keeps in a results file for weeks, and beside the runs of a scenario. It needs root: who may not set probes
leaves with 3."""

import contextlib
import json
import os
import signal
import sqlite3
import subprocess
import sys
import unittest

from program import eventually
from robot import ENVIRONMENT, LATE, ONTIME, Robot, begin, changed_code


class Results(Robot):
    def traces(self):
        """Of the results file, by run and message: what is kept of what was around it. None, until it has tables."""
        try:
            with contextlib.closing(sqlite3.connect(f"file:{self.folder / 'kept.ontime'}?mode=ro", uri=True)) as database:
                return {(run, message): json.loads(events)
                        for run, message, events in database.execute("SELECT run, message, events FROM trace")}
        except sqlite3.OperationalError:
            return {}

    def test_recorder_keeps_late_messages_with_what_was_around_them(self):
        publisher, taker = self.pair(4000)
        listener = self.listen((publisher, taker), "/cmd_vel", "--deadline", "15ms", "--results", "kept.ontime", "--keep", "10MB")
        code, seen = self.end(listener, publisher, taker)
        self.assertEqual(code, 1)
        flow = seen["flows"][0]
        rows, runs = self.kept()
        period = runs["/cmd_vel period"]
        # All are counted, with the silence at the end, and few are kept.
        self.assertEqual((period["sent"], period["late"]), (flow["period"]["count"] + 1, flow["late"] + 1))
        self.assertLess(len(rows["/cmd_vel period"]), flow["messages"])
        late = [fate for _, fate in rows["/cmd_vel period"]].count(LATE)
        self.assertLess(period["round_trip_us"]["p50"], 15_000, "not of those that are kept")
        if not any(miss["why"] for miss in seen["misses"]):
            self.skipTest("late messages were not explained: another ontime holds the machine")
        kept = [trace for trace in self.traces().values() if "way" in trace]
        self.assertGreater(len(kept), 0)
        self.assertLessEqual(len(kept), late)
        for trace in kept:
            self.assertLessEqual(trace["from_ns"], trace["way"]["taken_ns"] - 100_000_000)
            if trace["whole"]:
                self.assertEqual(trace["to_ns"], trace["way"]["taken_ns"] + 100_000_000)
                self.assertGreater(trace["from_ns"] + trace["events"][-1]["at"], trace["way"]["taken_ns"])
        explained = subprocess.run([ONTIME, "explain", "kept.ontime"], capture_output=True, text=True, cwd=self.folder, timeout=60)
        self.assertEqual(explained.returncode, 0, explained.stderr)
        self.assertRegex(explained.stdout, r"(causes\s+of\s+\d+\s+of\s+)?\d+\s+late\s+messages")
        self.assertRegex(explained.stdout, r"\d{4}-\d\d-\d\d\s+\d\d:\d\d:\d\d")
        print(explained.stdout, file=sys.stderr)

    def test_killed_recorder_goes_on_in_the_same_file(self):
        publisher, taker = nodes = self.pair(600_000)
        begin(publisher)
        arguments = ("/cmd_vel", "--deadline", "15ms", "--results", "kept.ontime", "--keep", "10MB")
        first = self.start(ONTIME, "listen", *arguments)
        self.assertTrue(eventually(lambda: len(self.traces()) > 0))
        first.kill()
        first.wait()
        before = self.traces()
        self.assertTrue(eventually(lambda: all(changed_code(node.pid) == 0 for node in nodes)))
        second = self.start(ONTIME, "listen", *arguments, "--for", "1h")  # it may be ended before
        # It has the file before it sets probes. Until then no process may read what the killed one left.
        self.assertTrue(eventually(lambda: all(changed_code(node.pid) > 0 for node in nodes)))
        self.assertTrue(eventually(lambda: len(self.traces()) > len(before)))
        second.send_signal(signal.SIGINT)
        self.assertEqual(second.wait(120), 1)
        self.assertEqual({key: trace for key, trace in self.traces().items() if key in before}, before)
        report = subprocess.run([ONTIME, "report", "kept.ontime", "--format", "json"], capture_output=True, text=True, cwd=self.folder,
                                timeout=60)
        runs = [run for run in json.loads(report.stdout)["runs"] if run["id"] == "/cmd_vel period"]
        self.assertGreaterEqual(len(runs), 2, report.stderr)
        self.assertEqual([(run["complete"], run["state"]) for run in runs[:1]], [(False, "CUT OFF")], runs)
        self.assertTrue(runs[-1]["complete"], runs)

    def test_a_scenario_judges_messages_beside_its_runs(self):
        publisher, taker = self.pair(120_000)
        begin(publisher)
        (self.folder / "own.yaml").write_text("""
hosts: loopback
defaults: {transport: udp, duration: 4 s, listen: {topics: "/cmd_vel, /cmd_val", deadline: 5 ms}}
runs:
  - id: idle
  - id: busy
    load: {controller: {cpu: 1}}
""")
        done = subprocess.run([ONTIME, "run", "own.yaml", "--results", "kept.ontime", "--only-measure"], env=ENVIRONMENT,
                              cwd=self.folder, capture_output=True, text=True, timeout=120)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertRegex(done.stderr, r"listen.topics: .*'/cmd_val'")
        rows, runs = self.kept()
        self.assertLessEqual({"idle", "idle udp /cmd_vel age", "idle udp /cmd_vel period", "busy", "busy udp /cmd_vel period"}, set(rows))
        for run in ("idle udp /cmd_vel period", "busy udp /cmd_vel period"):
            self.assertGreater(sum(period for period, _ in rows[run]), 2e9)
            self.assertEqual([fate == LATE for _, fate in rows[run]], [period > 5_000_000 for period, _ in rows[run]])
        self.assertIsNone(runs["idle udp /cmd_vel period"]["conditions"]["load"]["asked"])
        self.assertEqual(runs["busy udp /cmd_vel period"]["conditions"]["load"]["asked"]["controller"]["cpu"], 1)
        compared = subprocess.run([ONTIME, "compare", "kept.ontime", "--from", "idle udp /cmd_vel period", "--to", "busy udp /cmd_vel period"],
                                  cwd=self.folder, capture_output=True, text=True, timeout=60)
        self.assertEqual(compared.returncode, 0, compared.stderr)
        self.assertIn("/cmd_vel", compared.stdout)


if __name__ == "__main__":
    if os.geteuid() != 0:
        sys.exit(3)
    unittest.main()
