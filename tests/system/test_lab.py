#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The simulated machine of `ontime lab`. What is refused takes no time and no QEMU; machines are started where
ONTIME_LAB=1 asks for it (scripts/test --lab), and there is a QEMU. ONTIME names the program."""

import contextlib
import hashlib
import json
import os
import pathlib
import shutil
import signal
import sqlite3
import subprocess
import tempfile
import time
import unittest

from program import ONTIME, eventually, processes_with

SCENARIO = """
hosts: namespaces
defaults: {transport: [%s], duration: 2 s, realtime: on}
runs:
  - id: quiet
"""
TUNED = """
hosts: namespaces
defaults: {transport: udp, duration: 2 s, realtime: on}
runs:
  - id: tuned
    kernel: {irq-threads: 90, ksoftirqd: 60}
"""


def samples(results):
    """All of them, as one hash."""
    with contextlib.closing(sqlite3.connect(f"file:{results}?mode=ro", uri=True)) as database:
        rows = database.execute("SELECT * FROM sample ORDER BY run, message").fetchall()
    return len(rows), hashlib.sha256(repr(rows).encode()).hexdigest()


class Lab(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.mkdtemp(prefix="ontime-test-")
        self.addCleanup(shutil.rmtree, self.folder)
        self.temporary = os.path.join(self.folder, "tmp")
        os.mkdir(self.temporary)
        self.environment = dict(os.environ, TMPDIR=self.temporary)

    def tearDown(self):
        self.assertTrue(eventually(lambda: not self.left()), self.left())

    def left(self):
        return [*os.listdir(self.temporary), *processes_with("TMPDIR=" + self.temporary).values()]

    def scenario(self, text):
        path = os.path.join(self.folder, "scenario.yaml")
        pathlib.Path(path).write_text(text)
        return path

    def results(self, name="results.ontime"):
        return os.path.join(self.folder, name)

    def lab(self, *arguments, **environment):
        return subprocess.run([ONTIME, "lab", *arguments], capture_output=True, text=True, cwd=self.folder, timeout=900,
                              env=dict(self.environment, **environment))

    def report(self, results):
        answer = subprocess.run([ONTIME, "report", results, "--format", "json"], capture_output=True, text=True, timeout=120)
        self.assertEqual(answer.returncode, 0, answer.stderr)
        return json.loads(answer.stdout)["runs"]


class Refused(Lab):
    def refused(self, code, words, *arguments, **environment):
        answer = self.lab(*arguments, **environment)
        self.assertEqual(answer.returncode, code, answer.stderr)
        self.assertIn(words, answer.stderr)
        self.assertEqual([name for name in os.listdir(self.folder) if name.endswith(".ontime")], [])

    def test_what_is_asked_for_wrongly(self):
        scenario = self.scenario(SCENARIO % "udp")
        self.refused(2, "--nic: 'e1000' is not one of e1000e, virtio, igb", "run", scenario, "--nic", "e1000")
        self.refused(2, "512 MiB are the least", "run", scenario, "--memory", "1 MiB")
        self.refused(2, "--with: /there/is/none", "run", scenario, "--with", "/there/is/none")
        self.refused(2, "there is no such scenario", "run", "/there/is/none")
        self.refused(2, "needs hosts: namespaces", "run", self.scenario((SCENARIO % "udp").replace("namespaces", "loopback")))
        self.refused(2, "", "run", scenario, "--live", "--deterministic")

    def test_results_that_are_there_already(self):
        taken = pathlib.Path(self.results("taken"))
        taken.write_text("mine")
        self.refused(2, "is there already", "run", self.scenario(SCENARIO % "udp"), "--results", str(taken))
        self.assertEqual(taken.read_text(), "mine")

    def test_a_machine_that_has_no_qemu(self):
        self.refused(3, "sudo apt install qemu-system-x86", "run", self.scenario(SCENARIO % "udp"), PATH=self.temporary)


@unittest.skipUnless(os.environ.get("ONTIME_LAB") == "1", "machines are started by scripts/test --lab only")
@unittest.skipUnless(shutil.which("qemu-system-x86_64"), "there is no QEMU (Debian's package: qemu-system-x86)")
class Machines(Lab):
    def measured(self, name, *arguments):
        answer = self.lab("run", *arguments, "--results", self.results(name))
        self.assertEqual(answer.returncode, 0, answer.stderr)
        return answer

    def test_two_machines_give_the_same_samples_whatever_else_this_one_does(self):
        scenario = self.scenario(SCENARIO % os.environ.get("ONTIME_TEST_TRANSPORTS", "udp,cyclonedds"))
        answer = self.measured("first.ontime", scenario)
        self.assertIn("SIMULATED by QEMU", answer.stdout)
        with subprocess.Popen(["sh", "-c", "while :; do :; done"]) as busy:
            try:
                self.measured("second.ontime", scenario)
            finally:
                busy.kill()
        first, second = samples(self.results("first.ontime")), samples(self.results("second.ontime"))
        self.assertGreater(first[0], 100)
        self.assertEqual(first, second)
        for run in self.report(self.results("first.ontime")):
            machine = run["hosts"]["controller"]["machine"]
            self.assertEqual((machine["preemption"], machine["cpu_count"], machine["clocksource"]), ("rt", 1, "tsc"))
            self.assertIn("counted instructions", machine["simulated"])

    def test_interrupt_threads_of_a_nic_get_their_priority(self):
        self.measured("tuned.ontime", self.scenario(TUNED))
        (run,) = self.report(self.results("tuned.ontime"))
        for host, nic in (("controller", "eth0"), ("component", "eth1")):
            threads = [one for one in run["hosts"][host]["kernel"] if one["setting"] == "irq-threads"]
            self.assertTrue(threads)
            for one in threads:
                self.assertIn(nic, one["thing"])
                self.assertEqual((one["before"], one["after"], one["now"]), ("fifo 50", "fifo 90", "fifo 90"))

    def test_an_interruption_ends_the_machine(self):
        process = subprocess.Popen([ONTIME, "lab", "run", self.scenario(SCENARIO % "udp"), "--results", self.results()],
                                   stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=self.environment)
        self.addCleanup(lambda: (process.kill(), process.communicate()))
        self.assertTrue(eventually(lambda: any("qemu" in one for one in
                                               processes_with("TMPDIR=" + self.temporary).values()), 300))
        time.sleep(1)
        process.send_signal(signal.SIGTERM)
        self.assertEqual(process.wait(30), 130)
        self.assertFalse(os.path.exists(self.results()))

    def test_a_machine_that_does_not_come_up_shows_its_console(self):
        folder = pathlib.Path(self.folder, "bin")
        folder.mkdir()
        real = shutil.which("qemu-system-x86_64")
        qemu = folder / "qemu-system-x86_64"  # it starts the machine without its files
        qemu.write_text(f"""#!/usr/bin/env python3
import os, sys
words = sys.argv[1:]
if "-initrd" in words:
    at = words.index("-initrd")
    del words[at:at + 2]
os.execv("{real}", ["{real}", *words])
""")
        qemu.chmod(0o755)
        answer = self.lab("run", self.scenario(SCENARIO % "udp"), "--results", self.results(),
                          PATH=f"{folder}:{os.environ['PATH']}")
        self.assertEqual(answer.returncode, 3, answer.stderr)
        self.assertIn("The last lines of its console", answer.stderr)
        self.assertIn("VFS: Unable to mount root fs", answer.stderr)


if __name__ == "__main__":
    unittest.main()
