# SPDX-License-Identifier: Apache-2.0
"""`ontime lab` in a folder of its own, for tests. ONTIME names the program."""

import json
import os
import pathlib
import shutil
import subprocess
import tempfile
import unittest

from program import ONTIME, eventually, processes_with

SCENARIO = """
hosts: namespaces
defaults: {transport: [%s], duration: 2 s, realtime: on}
runs:
  - id: quiet
"""
THREE = """
hosts: namespaces
defaults: {transport: udp, duration: 500 ms, realtime: on}
runs: [{id: a}, {id: b}, {id: c}]
"""


class Lab(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.mkdtemp(prefix="ontime-test-")
        self.addCleanup(shutil.rmtree, self.folder)
        self.temporary = os.path.join(self.folder, "tmp")
        os.mkdir(self.temporary)
        self.environment = dict(os.environ, TMPDIR=self.temporary, ONTIME_TEST=self.temporary)

    def tearDown(self):
        self.assertTrue(eventually(lambda: not self.left()), self.left())

    def left(self):
        return [*os.listdir(self.temporary), *processes_with("ONTIME_TEST=" + self.temporary).values()]

    def scenario(self, text):
        path = os.path.join(self.folder, "scenario.yaml")
        pathlib.Path(path).write_text(text)
        return path

    def results(self, name="results.ontime"):
        return os.path.join(self.folder, name)

    def lab(self, *arguments, **environment):
        return subprocess.run([ONTIME, "lab", *arguments], capture_output=True, text=True, cwd=self.folder, timeout=900,
                              env=dict(self.environment, **environment))

    def instead_of_qemu(self, text):
        """A PATH on which there is this first."""
        folder = pathlib.Path(self.folder, "bin")
        folder.mkdir()
        (folder / "qemu-system-x86_64").write_text(text)
        (folder / "qemu-system-x86_64").chmod(0o755)
        return f"{folder}:{os.environ['PATH']}"

    def report(self, results):
        answer = subprocess.run([ONTIME, "report", results, "--format", "json"], capture_output=True, text=True, timeout=120)
        self.assertEqual(answer.returncode, 0, answer.stderr)
        return json.loads(answer.stdout)["runs"]
