#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What shells complete is what the program takes. ONTIME names the program."""

import os
import pathlib
import shutil
import subprocess
import tempfile
import unittest

ONTIME = os.environ["ONTIME"]
BASH = 'source <("$0" completion bash); COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); _ontime_words; echo "${COMPREPLY[@]}"'


def completed(*words, folder=None):
    """What bash offers for the last of these words, in this folder."""
    return subprocess.run(["bash", "-c", BASH, ONTIME, ONTIME, *words], capture_output=True, text=True,
                          check=True, cwd=folder).stdout.split()


class Completion(unittest.TestCase):
    def test_commands_are_those_of_the_help(self):
        words = completed("")
        for command in ("run", "ping", "pong", "report", "check", "tune"):
            self.assertIn(command, words)
            self.assertIn("--help", completed(command, "--h"))
        for hidden in ("agent", "keeper"):
            self.assertNotIn(hidden, words)
        self.assertEqual(completed("tune", ""), ["show", "apply", "verify", "revert", "search", "--help"])

    def test_flags_and_their_few_words(self):
        self.assertEqual(completed("tune", "apply", "--dry"), ["--dry-run"])
        self.assertEqual(completed("ping", "--receive", ""), ["listener", "waitset"])
        self.assertEqual(completed("ping", "--receive", "w"), ["waitset"])
        self.assertEqual(completed("run", "some.yaml", "--on"), ["--only"])
        self.assertEqual(completed("report", "--results", "x", "nothing"), [])
        self.assertEqual(completed("explain", "x.ontime", "--per"), ["--perfetto"])

    def test_values_are_those_of_this_machine(self):
        with tempfile.TemporaryDirectory() as folder:
            for name in ("demo-1.ontime", "own.yaml", "notes.txt"):
                (pathlib.Path(folder) / name).touch()
            self.assertEqual(completed("run", "de", folder=folder), ["demo"])
            self.assertIn("own.yaml", completed("run", "", folder=folder))
            self.assertEqual(completed("report", "", folder=folder), ["demo-1.ontime"])
            self.assertEqual(completed("run", "demo", "--results", "", folder=folder), ["demo-1.ontime"])
            self.assertIn("--format", completed("report", "--", folder=folder))
            self.assertEqual(completed("ping", "--transport", "ud", folder=folder), ["udp"])
            self.assertEqual(completed("run", "demo", "--transports", "udp,ud", folder=folder), ["udp,udp"])
            self.assertEqual(completed("report", "demo-1.ontime", "--output", "", folder=folder), [])

    def test_zsh_takes_it(self):
        if shutil.which("zsh") is None:
            self.skipTest("there is no zsh here")
        script = subprocess.run([ONTIME, "completion", "zsh"], capture_output=True, text=True, check=True).stdout
        self.assertEqual(subprocess.run(["zsh", "-n"], input=script, text=True).returncode, 0)


if __name__ == "__main__":
    unittest.main(verbosity=2)
