#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What `ontime tune apply --print` writes does what it says. Needs root, and skips without. ONTIME names the program."""

import json
import os
import pathlib
import shlex
import shutil
import subprocess
import sys
import tempfile
import unittest

from test_tune import BUSY_POLL, ONTIME, threads

# A veth pair of its own, on which the script is written, carried out and looked at.
ON_VETH = """
set -e
ip link add left type veth peer name right
ip link set left up
ip link set right up
ethtool --features left gro on
mount -t sysfs sysfs /sys
"$1" tune apply --set ksoftirqd=7 --set gro=on --set threaded-napi=on --set rps=0 --interface left --print shell > "$2"
sh "$2" >&2
"$1" tune show --interface left --format json
"""
NAMESAKE = "open('/proc/self/comm', 'w').write('ksoftirqd/0'); print(flush=True); __import__('sys').stdin.read()"


@unittest.skipUnless(os.geteuid() == 0, "settings of a machine need root")
class Boot(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(tempfile.mkdtemp(prefix="ontime-test-"))
        self.addCleanup(shutil.rmtree, self.folder)

    def run_all_right(self, *command, **options):
        answer = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False, **options)
        self.assertEqual(answer.returncode, 0, answer.stderr)
        return answer.stdout

    def printed(self, form, *settings):
        sets = [word for setting in settings for word in ("--set", setting)]
        return self.run_all_right(ONTIME, "tune", "apply", *sets, "--print", form)

    @unittest.skipUnless(shutil.which("ethtool"), "no ethtool: sudo apt install ethtool")
    def test_shell(self):
        before = threads("ksoftirqd/")
        self.assertTrue(all(policy == "SCHED_OTHER" for policy, _ in before.values()), "as a machine is at first")
        namesake = subprocess.Popen([sys.executable, "-c", NAMESAKE], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        try:
            namesake.stdout.readline()
            out = self.run_all_right("unshare", "--mount", "--net", "sh", "-c", ON_VETH, "sh", ONTIME, str(self.folder / "script"))
            self.assertEqual(set(threads("ksoftirqd/").values()), {("SCHED_FIFO", 7)})
            self.assertEqual(os.sched_getscheduler(namesake.pid), os.SCHED_OTHER, "of that name, and not the kernel's")
        finally:
            namesake.communicate()
            for line in subprocess.run(["pgrep", "--parent", "2", "^ksoftirqd/"], capture_output=True, text=True).stdout.split():
                os.sched_setscheduler(int(line), os.SCHED_OTHER, os.sched_param(0))
        self.assertEqual(threads("ksoftirqd/"), before)
        shown = {one["setting"]: list(one["now"].values()) for one in json.loads(out)["settings"]}
        self.assertEqual((shown["gro"], shown["threaded-napi"], set(shown["rps"])), (["on"], ["1"], {"0"}))

    @unittest.skipUnless(shutil.which("systemd-tmpfiles"), "no systemd-tmpfiles")
    @unittest.skipUnless(BUSY_POLL.exists(), "this kernel has no busy polling")
    def test_tmpfiles(self):
        lines = self.printed("tmpfiles", "busy-poll=50", "timer-migration=off")
        root = self.folder / "root"
        for name, value in (("net/core/busy_poll", "0"), ("kernel/timer_migration", "1")):
            file = root / "proc/sys" / name
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(value)
        self.run_all_right("systemd-tmpfiles", "--create", f"--root={root}", "-", input=lines)
        self.assertEqual((root / "proc/sys/net/core/busy_poll").read_text(), "50")
        self.assertEqual((root / "proc/sys/kernel/timer_migration").read_text(), "0")

    @unittest.skipUnless(BUSY_POLL.exists(), "this kernel has no busy polling")
    def test_systemd(self):
        unit = self.folder / "ontime-tune.service"
        unit.write_text(self.printed("systemd", "busy-poll=50"))
        if shutil.which("systemd-analyze"):
            self.run_all_right("systemd-analyze", "verify", str(unit))
        does = {key: shlex.split(value.replace("%%", "%")) for key, _, value in
                (line.partition("=") for line in unit.read_text().splitlines()) if key.startswith("Exec")}
        before = BUSY_POLL.read_text()
        try:
            self.run_all_right(*does["ExecStart"])
            self.assertEqual(BUSY_POLL.read_text(), "50\n")
        finally:
            self.run_all_right(*does["ExecStop"])
        self.assertEqual(BUSY_POLL.read_text(), before)


if __name__ == "__main__":
    unittest.main(verbosity=2)
