#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""`ontime tune search` by the real program: it ends, goes on after kill -9, and leaves the machine as it was. Needs root, and skips
without. ONTIME names the program."""
import json
import os
import pathlib
import shutil
import signal
import subprocess
import tempfile
import unittest

from program import ONTIME

BUSY_POLL = pathlib.Path("/proc/sys/net/core/busy_poll")
SCENARIO = """
hosts: namespaces
defaults: {transport: udp, period: 2 ms, deadline: 400 ms, duration: 500 ms, kernel: {busy-poll: 50}}
runs: [{id: one}, {id: two}]
"""
EASY = "p50 < 1 s"  # on the busiest machine


@unittest.skipUnless(os.geteuid() == 0, "settings of a machine need root")
class Search(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(tempfile.mkdtemp(prefix="ontime-test-"))
        self.addCleanup(shutil.rmtree, self.folder)
        (self.folder / "s.yaml").write_text(SCENARIO)
        self.before = BUSY_POLL.read_text()

    def command(self, *arguments, goal=EASY):
        return [ONTIME, "tune", "search", "./s.yaml", "--goal", goal, "--only", "one", "--results", "s.ontime", "--format", "json", *arguments]

    def search(self, *arguments, code=0, **goal):
        done = subprocess.run(self.command(*arguments, **goal), cwd=self.folder, capture_output=True, text=True, timeout=120)
        self.assertEqual(done.returncode, code, done.stdout + done.stderr)
        self.assertEqual(BUSY_POLL.read_text(), self.before)
        return json.loads(done.stdout) if code < 2 else done.stderr

    def test_a_goal_that_holds_changes_nothing(self):
        found = self.search()
        self.assertEqual((found["end"], found["set"], len(found["trials"])), ("goal-holds", {}, 1))
        self.assertTrue((self.folder / "s.search.html").exists())
        self.assertTrue((self.folder / "s.html").exists())

    def test_a_search_that_ended_is_not_measured_again(self):
        first = self.search()
        again = self.search("--resume")
        self.assertEqual((again["runs"], again["end"], again["trials"]), (first["runs"], first["end"], first["trials"]))

    def test_a_search_that_was_killed_goes_on_and_leaves_the_machine_as_it_was(self):
        with subprocess.Popen(self.command(goal="p99 < 1 s"), cwd=self.folder, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
                              text=True) as search:
            for line in search.stderr:
                if "trial 1, run 2" in line:
                    break
            search.send_signal(signal.SIGKILL)
        subprocess.run([ONTIME, "tune", "revert"], capture_output=True, check=True)
        self.assertEqual(BUSY_POLL.read_text(), self.before)
        found = self.search("--resume", goal="p99 < 1 s")
        self.assertEqual(found["end"], "goal-holds")

    def test_another_scenario_does_not_go_on_with_these_results(self):
        self.search()
        (self.folder / "s.yaml").write_text(SCENARIO.replace("500 ms", "600 ms"))
        self.assertIn("--resume", self.search("--resume", code=2))

    def test_wrong_usage_measures_nothing(self):
        for goal in ("mean < 1 ms", "p99 < ", "late = 3"):
            self.search(goal=goal, code=2)
        self.search("--never", "no-such-setting", code=2)
        self.search("--only", "one,two", code=2)
        self.assertFalse((self.folder / "s.ontime").exists())


if __name__ == "__main__":
    unittest.main()
