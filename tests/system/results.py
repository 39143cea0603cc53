# SPDX-License-Identifier: Apache-2.0
"""Results that the real program measures over loopback, for tests. ONTIME names the program."""

import contextlib
import os
import pathlib
import shutil
import sqlite3
import subprocess
import tempfile
import unittest

import program

ONTIME = os.environ["ONTIME"]

SCENARIO = """
hosts: loopback
defaults: {transport: udp, period: 5 ms, timeout: 10 s, duration: %s}
runs:
  - id: one
    require: [%s]
"""


class Results(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(tempfile.mkdtemp(prefix="ontime-test-"))
        self.addCleanup(shutil.rmtree, self.folder)
        self.results = self.folder / "results.ontime"

    def ontime(self, *arguments, code=0, env=None):
        answer = subprocess.run([ONTIME, *map(str, arguments)], capture_output=True, text=True, timeout=120,
                                cwd=self.folder, env=env)
        self.assertEqual(answer.returncode, code, answer.stdout + answer.stderr)
        self.assertNotIn("terminate called", answer.stderr)
        return answer

    def start(self, *arguments):
        process = subprocess.Popen([ONTIME, *map(str, arguments)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.addCleanup(lambda: (process.kill(), process.communicate()))
        return process

    def started(self, duration):
        process = self.start("run", self.scenario(duration=duration), "--results", self.results)
        self.assertTrue(program.eventually(lambda: program.sample_count(self.results) > 0), process.poll())
        return process

    def scenario(self, require="lost <= 100%", duration="800 ms", period="5 ms"):
        path = self.folder / "scenario.yaml"
        path.write_text((SCENARIO % (duration, require)).replace("period: 5 ms", f"period: {period}"))
        return path

    def measured(self, **scenario):
        self.ontime("run", self.scenario(**scenario), "--results", self.results)

    def copy_with(self, name, round_trips_ns):
        """The results once more, with these round trips in place of its own."""
        path = self.folder / name
        shutil.copy(self.results, path)
        with contextlib.closing(sqlite3.connect(path)) as database:
            database.execute("DELETE FROM sample")
            database.executemany(
                "INSERT INTO sample (run, message, intended_ns, due_after_ns, woke_after_ns, sent_after_ns, "
                "received_after_ns, skipped_cycles, fate) VALUES (1, ?, ?, 0, 1000, 1000, ?, 0, 0)",
                ((index, index * 5_000_000, ns) for index, ns in enumerate(round_trips_ns)))
            database.commit()
        return path
