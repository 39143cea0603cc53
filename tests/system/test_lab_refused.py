#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What `ontime lab` and a search in it refuse, before a machine starts. It needs no QEMU."""

import os
import pathlib
import subprocess
import unittest

from program import ONTIME
from simulated import SCENARIO, THREE, Lab


class Refused(Lab):
    def refused(self, code, words, *arguments, **environment):
        answer = self.lab(*arguments, **environment)
        self.assertEqual(answer.returncode, code, answer.stderr)
        self.assertIn(words, answer.stderr)
        self.assertEqual([name for name in os.listdir(self.folder) if name.endswith(".ontime")], [])

    def test_what_is_asked_for_wrongly(self):
        scenario = self.scenario(SCENARIO % "udp")
        self.refused(2, "--nic: 'e1000' is not one of e1000e, virtio, igb", "run", scenario, "--nic", "e1000")
        self.refused(2, "512 MiB", "run", scenario, "--memory", "1 MiB")
        self.refused(2, "--cpus: Value 9 not in range 1 to 8", "run", scenario, "--cpus", "9")
        self.refused(2, "--with: /there/is/none", "run", scenario, "--with", "/there/is/none")
        self.refused(2, "--with: /proc/version: ", "run", scenario, "--with", "/proc/version")
        self.refused(2, "/there/is/none: ", "run", "/there/is/none")
        self.refused(2, "needs hosts: namespaces", "run", self.scenario((SCENARIO % "udp").replace("namespaces", "loopback")))
        wired = os.path.join(self.folder, "wired.yaml")
        pathlib.Path(wired).write_text("wire: {rate: 10 Mbit/s}" + SCENARIO % "udp")
        other = self.scenario(SCENARIO % "udp")
        self.refused(2, "(10 Mbit/s) than ", "run", other, wired)
        self.refused(2, "(any) than ", "run", wired, other)
        self.refused(2, "--deterministic excludes --live", "run", scenario, "--live", "--deterministic")
        for package in ("bash", "-o=x", "linux-image-rt-amd64 bash"):
            self.refused(2, f"--kernel: '{package}' ", "run", scenario, "--kernel=" + package)

    def test_a_cable_that_is_none(self):
        for text, cable, words in ((SCENARIO % "udp", "eth1", "two interfaces"), (SCENARIO % "udp", "eth1,eth1", "two interfaces"),
                                   ("hosts: loopback\ndefaults: {transport: udp}\nruns: [{id: a}]", "eth1,eth2", "--cable needs hosts: namespaces")):
            answer = subprocess.run([ONTIME, "run", self.scenario(text), "--cable", cable, "--results", self.results()],
                                    capture_output=True, text=True, timeout=60)
            self.assertEqual(answer.returncode, 2, answer.stderr)
            self.assertIn(words, answer.stderr)
            self.assertFalse(os.path.exists(self.results()))

    def test_results_that_are_there_already(self):
        taken = pathlib.Path(self.results("taken"))
        taken.write_text("mine")
        self.refused(2, "exists", "run", self.scenario(SCENARIO % "udp"), "--results", str(taken))
        self.assertEqual(taken.read_text(), "mine")

    def test_results_that_can_be_written_nowhere(self):
        self.refused(2, "/there/is is no folder", "run",
                     self.scenario(SCENARIO % "udp"), "--results", "/there/is/none.ontime")

    def test_a_machine_that_has_no_qemu(self):
        self.refused(3, "sudo apt install qemu-system-x86", "run", self.scenario(SCENARIO % "udp"), PATH=self.temporary)

    def test_what_this_machine_has_not(self):
        scenario = self.scenario(SCENARIO % "udp")
        path = self.instead_of_qemu("""#!/bin/sh
[ "$1" = --version ] && echo 'QEMU emulator version 7.2.22 (Debian)' || echo 'name "e1000e", bus PCI'
""")
        self.refused(3, "sudo apt install -t bookworm-backports", "run", scenario, "--nic", "igb", PATH=path)
        self.refused(3, "QEMU 7.2.22 cannot boot 2 CPUs", "run", scenario, "--cpus", "2", PATH=path)
        self.refused(3, "9536743 MiB of memory", "run", scenario, "--memory", "10000000 MB", PATH=path)
        self.refused(3, "the kernel package linux-image-of-nobody is not available here: ", "run", scenario,
                     "--kernel", "linux-image-of-nobody", PATH=path)


class SearchRefused(Lab):
    """`ontime tune search --on lab`: what is wrong is said before a machine starts."""
    def refused(self, code, words, *arguments, text=SCENARIO % "udp", goal="p50 < 1 s", **environment):
        answer = subprocess.run([ONTIME, "tune", "search", self.scenario(text), "--goal", goal, *arguments], capture_output=True,
                                text=True, cwd=self.folder, timeout=60, env=dict(self.environment, **environment))
        self.assertEqual(answer.returncode, code, answer.stderr)
        self.assertIn(words, answer.stderr)
        self.assertEqual([name for name in os.listdir(self.folder) if name.endswith(".ontime")], [])

    def test_wrong_input_starts_no_machine(self):
        path = self.instead_of_qemu("#!/bin/sh\ntouch started\n")
        on = ("--on", "lab")
        for words, arguments, others in (
                ("--on: 'moon' is not one of here, lab", ("--on", "moon"), {}),
                ("--goal", on, {"goal": "mean < 1 ms"}),
                ("needs hosts: namespaces", on, {"text": (SCENARIO % "udp").replace("namespaces", "loopback")}),
                ("has 3 runs", on, {"text": THREE}),
                ("--nic: 'e1000' is not one of", (*on, "--nic", "e1000"), {}),
                ("--nic applies to the lab's machine: add --on lab", ("--nic", "virtio"), {}),
                ("--cable does not apply", (*on, "--cable", "eth1,eth2"), {}),
                ("no CPU 3 here. CPUs here: 0", (*on, "--keep-cpus-off", "3"), {}),
                ("leaves no CPU. CPUs here: 0-1", (*on, "--cpus", "2", "--keep-cpus-off", "0,1"), {}),
                ("did you mean 'irq-threads'", (*on, "--never", "irq-thread"), {}),
                ("too short for one run", (*on, "--within", "100 ms"), {})):
            with self.subTest(words):
                self.refused(2, words, *arguments, PATH=path, **others)
        self.assertFalse(os.path.exists(os.path.join(self.folder, "started")))

    def test_a_machine_that_has_no_qemu_says_what_to_install(self):
        self.refused(3, "sudo apt install qemu-system-x86", "--on", "lab", PATH=self.temporary)


if __name__ == "__main__":
    unittest.main(verbosity=2)
