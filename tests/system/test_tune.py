#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The settings of a machine, changed and given back by the real program however it ends, and looked at by other
programs: chrt, ps, cat. Needs root, and skips without. ONTIME names the program."""

import json
import os
import pathlib
import re
import shlex
import shutil
import signal
import subprocess
import tempfile
import unittest

from own_machine import own_mounts
from program import ONTIME, eventually, kill_at_once, sample_count

NAMESPACE, INTERFACE = "ontime-controller", "to-component"

SCENARIO = """
hosts: namespaces
defaults: {transport: udp, period: 5 ms, duration: %s, realtime: on}
runs:
  - id: tuned
    kernel: {ksoftirqd: 60, busy-poll: 50, gro: on, threaded-napi: on, napi-threads: 55, rps: 0}
  - id: lacking
    kernel: {ksoftirqd: 60, irq-threads: 90}
  - id: unthrottled
    kernel: {rt-throttling: off}
  - id: kept
    kernel: {ksoftirqd: 60}
    isolation: {load-weight: 50}
"""
# Between namespaces no kernel has any, each for its own reason.
NO_IRQ_THREADS = "on the controller, kernel.irq-threads: (this kernel has no IRQ threads|to-component has no interrupts)"
BUSY_POLL = pathlib.Path("/proc/sys/net/core/busy_poll")


def threads(prefix):
    """Kernel threads, as {name: (policy, priority)} by ps and chrt."""
    found = {}
    for line in subprocess.run(["ps", "--ppid", "2", "-o", "pid=,comm="], capture_output=True, text=True).stdout.splitlines():
        pid, name = line.split(maxsplit=1)
        if name.startswith(prefix):
            said = subprocess.run(["chrt", "--pid", pid], capture_output=True, text=True).stdout.splitlines()
            found[name] = (said[0].split()[-1], int(said[1].split()[-1]))
    return found


def state():
    """All that these tests change of this machine itself."""
    return threads("ksoftirqd/"), BUSY_POLL.read_text()


def in_namespace(path):
    return subprocess.run(["ip", "netns", "exec", NAMESPACE, "cat", path], capture_output=True, text=True).stdout.strip()


@unittest.skipUnless(os.geteuid() == 0, "settings of a machine need root")
@unittest.skipUnless(BUSY_POLL.exists(), "this kernel has no busy polling")
class Tune(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.mkdtemp(prefix="ontime-test-")
        self.addCleanup(shutil.rmtree, self.folder)
        self.results = os.path.join(self.folder, "results.ontime")
        self.before = state()
        self.assertTrue(all(policy == "SCHED_OTHER" for policy, _ in self.before[0].values()), "as a machine is at first")
        self.assertEqual(self.before[1], "0\n", f"as a machine is at first: echo 0 >{BUSY_POLL}")

    def tearDown(self):
        self.ontime("tune", "revert")
        self.assertEqual(state(), self.before)
        self.assertFalse(os.path.exists("/run/ontime"))
        self.assertFalse(os.path.exists(f"/run/netns/{NAMESPACE}"))

    def ontime(self, *arguments):
        return subprocess.run([ONTIME, *arguments], capture_output=True, text=True, timeout=120)

    def scenario(self, duration):
        path = os.path.join(self.folder, "scenario.yaml")
        pathlib.Path(path).write_text(SCENARIO % duration)
        return path

    def plain(self):
        path = pathlib.Path(self.folder, "plain.yaml")
        path.write_text("hosts: loopback\nruns: [{id: plain, transport: udp}]\n")
        return str(path)

    def tuned_run(self):
        process = subprocess.Popen([ONTIME, "run", self.scenario("1 h"), "--only", "tuned", "--results", self.results],
                                   stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.addCleanup(lambda: (process.kill(), process.communicate()))
        # Namespaces of other tests may have such threads, too.
        self.assertTrue(eventually(lambda: process.poll() is not None
                                   or in_namespace(f"/sys/class/net/{INTERFACE}/queues/rx-0/rps_cpus").endswith("1")
                                   and ("SCHED_FIFO", 55) in threads("napi/").values()))
        self.assertIsNone(process.poll(), process.poll() is not None and process.communicate())
        self.assertEqual(set(threads("ksoftirqd/").values()), {("SCHED_FIFO", 60)})
        self.assertEqual(BUSY_POLL.read_text(), "50\n")
        self.assertEqual(in_namespace(f"/sys/class/net/{INTERFACE}/threaded"), "1")
        return process

    def assert_given_back(self):
        self.assertTrue(eventually(lambda: state() == self.before), state())
        self.assertTrue(eventually(lambda: not os.path.exists("/run/ontime")))

    def keepers_of(self, process):
        children = pathlib.Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
        return [int(pid) for pid in children if b"keeper" in pathlib.Path(f"/proc/{pid}/cmdline").read_bytes()]

    # --- a run

    def test_settings_of_a_run_are_in_its_record_and_given_back_after_it(self):
        answer = self.ontime("run", self.scenario("300 ms"), "--only", "tuned", "--results", self.results, "--full")
        self.assertEqual(answer.returncode, 0, answer.stderr)
        self.assert_given_back()
        run = json.loads(self.ontime("report", self.results, "--format", "json").stdout)["runs"][0]
        self.assertEqual(run["conditions"]["kernel"]["ksoftirqd"], "60")
        for host in ("controller", "component"):
            said = run["hosts"][host]["kernel"]
            self.assertEqual({one["setting"] for one in said}, set(run["conditions"]["kernel"]))
            present = run["hosts"][host]["settings"]
            self.assertEqual([present[name] for name in ("ksoftirqd", "busy-poll", "threaded-napi", "timer-migration")],
                             ["60", "50 us", "on", "on"], "also one that was not requested")
            for one in said:
                self.assertEqual(one["now"], one["after"])
            self.assertEqual({one["after"].rsplit(":", 1)[0] for one in said if one["setting"] == "napi-threads"}, {"fifo:55"})
        self.assertIn("kernel: busy-poll 50", answer.stdout)

    def test_what_this_kernel_lacks_is_refused_by_name_and_nothing_is_changed(self):
        process = subprocess.Popen([ONTIME, "run", self.scenario("1 s"), "--only", "lacking", "--results", self.results],
                                   stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        while process.poll() is None:
            self.assertEqual(state(), self.before)
        _, error = process.communicate()
        self.assertEqual(process.returncode, 3)
        self.assertRegex(error, NO_IRQ_THREADS)
        self.assertIn("irq-threads 90: above the application's 80", error)

    def test_the_papers_test_4_is_refused_and_the_rest_of_the_folder_goes_on(self):
        folder = pathlib.Path(self.folder, "suite")
        folder.mkdir()
        shutil.copy(pathlib.Path(__file__).parents[2] / "scenarios/paper/test4.yaml", folder)
        (folder / "test5.yaml").write_text("hosts: namespaces\nruns: [{id: next, transport: udp}]\n")
        answer = self.ontime("run", str(folder), "--transports", "udp", "--duration", "200 ms", "--results", self.results, "--full")
        self.assertEqual(answer.returncode, 3, answer.stderr)
        self.assertRegex(answer.stderr, NO_IRQ_THREADS)
        self.assertIn("failed: on the controller, kernel.irq-threads:", " ".join(answer.stdout.split()))
        runs = json.loads(self.ontime("report", self.results, "--format", "json").stdout)["runs"]
        self.assertEqual([(run["id"], run["complete"], run["sent"] > 0) for run in runs],
                         [("Test4.A", False, False), ("next", True, True)])

    def test_a_signal_gives_back(self):
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            with self.subTest(signal=number):
                process = self.tuned_run()
                process.send_signal(number)
                process.communicate(timeout=180)
                self.assertEqual(process.returncode, 130)
                self.assert_given_back()

    def test_a_coordinator_that_is_gone_gives_back(self):
        process = self.tuned_run()
        process.kill()
        process.communicate(timeout=180)
        self.assert_given_back()

    def test_after_kill_9_of_all_revert_gives_back(self):
        process = self.tuned_run()
        kill_at_once(*self.keepers_of(process), process.pid)
        process.communicate(timeout=180)
        # Agents notice it as well, and leave; who comes first gives back.
        answer = self.ontime("tune", "revert")
        self.assertEqual(answer.returncode, 0, answer.stderr)
        self.assert_given_back()

    def test_what_cannot_be_restored_is_told_until_it_is(self):
        own_mounts()
        process = self.tuned_run()
        keepers = self.keepers_of(process)
        barred = lambda *options: subprocess.run(["mount", *options, BUSY_POLL], check=True)
        barred("--bind", BUSY_POLL)
        try:
            barred("-o", "remount,bind,ro")
            process.kill()  # so no process reads what the keeper could not restore
            process.communicate(timeout=180)
            self.assertTrue(eventually(lambda: not any(os.path.exists(f"/proc/{pid}") for pid in keepers)))
            for _ in range(2):
                answer = self.ontime("tune", "revert")
                self.assertEqual(answer.returncode, 3, answer.stdout + answer.stderr)
                self.assertIn("busy_poll", answer.stderr)
                self.assertNotIn("nothing was applied", answer.stderr)
        finally:
            subprocess.run(["umount", BUSY_POLL], check=True)
        answer = self.ontime("tune", "revert")
        self.assertEqual(answer.returncode, 0, answer.stderr)
        self.assertIn("set network sysctl net/core/busy_poll back to", answer.stdout)
        self.assert_given_back()

    def test_what_somebody_changed_meanwhile_is_left_to_him(self):
        process = self.tuned_run()
        self.assertTrue(eventually(lambda: sample_count(self.results)))
        BUSY_POLL.write_text("70")
        process.send_signal(signal.SIGINT)
        _, error = process.communicate(timeout=180)
        self.assertEqual(BUSY_POLL.read_text(), "70\n")
        BUSY_POLL.write_text(self.before[1])
        self.assertRegex(error, "busy_poll.*another program")
        run = json.loads(self.ontime("report", self.results, "--format", "json").stdout)["runs"][0]
        self.assertIn("70", [one["now"] for one in run["hosts"]["controller"]["kernel"]])

    def test_throttling_that_this_kernel_does_not_have_is_told(self):
        own_mounts()
        release = pathlib.Path(self.folder, "release")
        release.touch()
        mounts = (["--bind", release, "/proc/sys/kernel/osrelease"], ["-t", "tmpfs", "none", "/sys/fs/cgroup"])  # no group has a budget
        for mount in mounts:
            subprocess.run(["mount", *mount], check=True)
        try:
            told = "rt-throttling: it changes nothing"
            for text, is_told in (("6.11.9-rt", False), ("6.12.0-rt", True)):
                release.write_text(text)
                tuned = self.ontime("tune", "apply", "--set", "rt-throttling=off", "--dry-run")
                self.assertEqual((tuned.returncode, told in tuned.stderr), (0, is_told), tuned.stderr)
            run = self.ontime("run", self.scenario("100 ms"), "--only", "unthrottled", "--results", self.results)
            self.assertEqual(run.returncode, 0, run.stderr)
            self.assertIn("on the controller, kernel." + told, run.stderr)
        finally:
            for mount in mounts:
                subprocess.run(["umount", mount[-1]], check=True)

    # --- by hand

    def test_what_is_applied_stays_until_it_is_reverted(self):
        self.assertEqual(self.ontime("tune", "verify").returncode, 1, "nothing was applied yet")
        dry = self.ontime("tune", "apply", "--set", "ksoftirqd=60", "--dry-run")
        self.assertIn("ksoftirqd/0 from other:0 to fifo:60", dry.stdout)
        self.assertEqual(state(), self.before)
        answer = self.ontime("tune", "apply", "--set", "ksoftirqd=60", "--set", "busy-poll=40")
        self.assertEqual(answer.returncode, 0, answer.stderr)
        self.assertEqual(set(threads("ksoftirqd/").values()), {("SCHED_FIFO", 60)})
        self.assertEqual(self.ontime("tune", "verify").returncode, 0)
        shown = json.loads(self.ontime("tune", "show", "--format", "json").stdout)["settings"]
        self.assertEqual(next(one["now"] for one in shown if one["setting"] == "busy-poll"), {"net/core/busy_poll": "40"})

        # A run changes the same, and gives back what it found.
        self.assertEqual(self.ontime("run", self.scenario("100 ms"), "--only", "tuned", "--results", self.results).returncode, 0)
        self.assertEqual(BUSY_POLL.read_text(), "40\n")
        self.assertEqual(self.ontime("tune", "verify").returncode, 0)

        BUSY_POLL.write_text("41")
        verified = self.ontime("tune", "verify")
        self.assertEqual(verified.returncode, 1)
        self.assertIn("applied 40, is 41", verified.stdout)
        BUSY_POLL.write_text("40")
        reverted = self.ontime("tune", "revert")
        self.assertEqual(reverted.returncode, 0)
        self.assert_given_back()
        one, other = (set(re.findall(r"(\S*ksoftirqd\S* \[\d+\])", answer.stdout)) for answer in (verified, reverted))
        self.assertTrue(one)
        self.assertEqual(one, other, reverted.stdout)

    def test_what_cannot_be_told_is_not_applied(self):
        with open("/dev/full", "w") as full:
            answer = subprocess.run([ONTIME, "tune", "apply", "--set", "busy-poll=40"], stdout=full, stderr=subprocess.PIPE, text=True,
                                    timeout=120)
        self.assertEqual(answer.returncode, 3, answer.stderr)
        self.assertEqual(state(), self.before)
        self.assertEqual(self.ontime("tune", "verify").returncode, 1, "nothing is applied")

    def test_reader_that_leaves_undoes_nothing(self):
        gone, out = os.pipe()
        os.close(gone)
        answer = subprocess.run([ONTIME, "tune", "apply", "--set", "busy-poll=40"], stdout=out, stderr=subprocess.PIPE, text=True, timeout=120)
        os.close(out)
        self.assertEqual(answer.returncode, 0, answer.stderr)
        self.assertIn("ontime tune revert", answer.stderr)
        self.assertEqual(self.ontime("tune", "verify").returncode, 0)
        self.assertEqual(self.ontime("tune", "revert").returncode, 0)

    def test_a_journal_that_may_not_grow_leaves_nothing_changed(self):
        sets = [word for name in ("busy-poll=1", "busy-read=1", "ksoftirqd=1", "rmem-max=9 MiB") for word in ("--set", name)]
        answer = subprocess.run(["sh", "-c", 'ulimit -f 1; exec "$@"', "-", ONTIME, "tune", "apply", *sets],  # 512 bytes
                                capture_output=True, text=True, timeout=120)
        self.assertEqual(answer.returncode, 3, answer.stderr)
        self.assertIn("File too large", answer.stderr)
        self.assertEqual(state(), self.before)

    def test_what_is_left_is_told_where_the_output_cannot_be_written(self):
        self.assertEqual(self.ontime("tune", "apply", "--set", "ksoftirqd=60", "--set", "busy-poll=40").returncode, 0)
        BUSY_POLL.write_text("41")
        with open("/dev/full", "w") as full:
            answer = subprocess.run([ONTIME, "tune", "revert"], stdout=full, stderr=subprocess.PIPE, text=True, timeout=120)
        BUSY_POLL.write_text(self.before[1])
        self.assertEqual(answer.returncode, 3, answer.stderr)
        self.assertRegex(answer.stderr, "busy_poll .* another program has changed it")

    def test_command_to_paste_removes_the_folder_that_is_left_and_no_other(self):
        with tempfile.TemporaryDirectory(prefix="of a user ") as folder:
            left = pathlib.Path(folder, "ontime-stress-0123456789abcdef")
            left.mkdir()
            os.utime(left, (1, 1))
            answer = subprocess.run([ONTIME, "tune", "revert"], capture_output=True, text=True, timeout=120,
                                    env={**os.environ, "TMPDIR": folder})
        told = [line for line in answer.stderr.splitlines() if left.name in line]
        self.assertEqual([shlex.split(line.rpartition("Fix: ")[2]) for line in told], [["rm", "-r", str(left)]])

    def test_revert_goes_on_where_no_file_may_grow(self):
        self.assertEqual(self.ontime("tune", "apply", "--set", "busy-poll=40").returncode, 0)
        self.assertEqual(self.ontime("tune", "apply", "--set", "ksoftirqd=60").returncode, 0)
        latest = max(pathlib.Path("/run/ontime").glob("*.kept"))
        lines = latest.read_text().splitlines()
        unknown = json.dumps({**json.loads(lines[-1]), "kind": "of a later version"})
        latest.write_text("\n".join([*lines, unknown, ""]))
        answer = subprocess.run(["sh", "-c", 'ulimit -f 0; exec "$@"', "-", ONTIME, "tune", "revert"], capture_output=True, text=True,
                                timeout=120)
        latest.unlink()
        self.assertEqual(self.ontime("tune", "revert").returncode, 0)
        self.assertEqual(answer.returncode, 3, answer.stderr)
        self.assertIn("of a later version", answer.stderr)
        self.assert_given_back()

    def test_what_was_so_already_is_verified_too(self):
        self.assertEqual(self.ontime("tune", "apply", "--set", f"busy-poll={self.before[1].strip()}").returncode, 0)
        self.assertEqual(self.ontime("tune", "verify").returncode, 0)
        BUSY_POLL.write_text("33")
        self.assertEqual(self.ontime("tune", "verify").returncode, 1)
        BUSY_POLL.write_text(self.before[1])

    def test_a_scenarios_settings_are_applied_by_the_id_of_a_run(self):
        subprocess.run(["ip", "netns", "add", "tune-test"], check=True)
        try:
            for command in (["link", "add", "left", "type", "veth", "peer", "name", "right"], ["link", "set", "left", "up"],
                            ["link", "set", "right", "up"]):
                subprocess.run(["ip", "-n", "tune-test", *command], check=True)
            answer = self.ontime("tune", "apply", "--scenario", self.scenario("1 s"), "--run", "tuned", "--interface", "left",
                                 "--namespace", "tune-test")
            self.assertEqual(answer.returncode, 0, answer.stderr)
            self.assertEqual(threads("napi/left"), {name: ("SCHED_FIFO", 55) for name in threads("napi/left")})
            self.assertTrue(threads("napi/left"))
            self.assertEqual(self.ontime("tune", "verify").returncode, 0)
            self.assertEqual(self.ontime("tune", "revert").returncode, 0)
            self.assertFalse(threads("napi/left"))
            self.assert_given_back()
        finally:
            subprocess.run(["ip", "netns", "delete", "tune-test"], check=True)

    def test_an_ordinary_user_gets_the_command_that_works(self):
        user = ["setpriv", "--reuid", "65534", "--regid", "65534", "--clear-groups"]
        for words in ("apply --set busy-poll=9", "verify", "revert"):
            answer = subprocess.run([*user, ONTIME, "tune", *words.split()], capture_output=True, text=True, timeout=120)
            self.assertEqual(answer.returncode, 3, answer.stderr)
            self.assertRegex(answer.stderr, rf"\Aontime: .* Fix: sudo \S+ tune {words}\n\Z")

    def test_wrong_input_is_said_and_nothing_is_changed(self):
        for arguments, code, words in (
                (["apply"], 2, "--set"),
                (["apply", "--set", "ksoftirqd"], 2, "NAME=VALUE"),
                (["apply", "--set", "ksoftirqd=100"], 2, "100"),
                (["apply", "governor=performance"], 2, "Fix: --set governor=performance"),
                (["apply", "kernel.governor=performance"], 2, "Fix: --set kernel.governor=performance"),
                (["apply", "--set", "kernel.ksoftirqd=100"], 2, "--set ksoftirqd: "),
                (["apply", "kept.yaml"], 2, "Fix: --scenario kept.yaml"),
                (["apply", self.plain(), "--only", "plain"], 2, f"Fix: --scenario {self.plain()}"),
                (["apply", "robot.local"], 2, "Fix: --peer robot.local"),
                (["apply", "--set", "ksoftirqd=60,gro=off"], 2, "'60' is not CPU=PRIORITY"),
                (["apply", "--scenario", "demo", "--only", "Test1.A"], 2, "'Test1.A' states no kernel.* keys. Fix: "),
                (["apply", "--scenario", "dmo", "--only", "Test1.A"], 2, "did you mean 'demo'?"),
                (["search", "demo", "--goal", "max < 1 s", "--explain"], 2, "unknown option '--explain'"),
                (["apply", "--scenario", self.plain(), "--only", "plain"], 2, "'plain' states no kernel.* keys. Fix: "),
                (["apply", "--set", "speed=1"], 2, "speed"),
                (["apply", "--set", "governer=performance"], 2, "did you mean 'governor'?"),
                (["apply", "--set", "rps=0"], 2, "--interface"),
                (["apply", "--set", "rps=0", "--interface", "nonet0"], 2, "nonet0"),
                (["apply", "--set", "busy-poll=9", "--set", "rps=0", "--interface", "lo", "--namespace", "no-such"], 3, "no-such"),
                (["apply", "--scenario", self.scenario("1 s"), "--run", "kept"], 2, "isolation.*"),
                (["apply", "--set", "busy-poll=9", "--print", "runes"], 2, "runes"),
                (["apply", "--set", "ksoftirqd=60", "--print", "tmpfiles"], 2, "ksoftirqd"),
                (["apply", "--set", "ksoftirqd=60", "--set", "kernel.ksoftirqd=50", "--dry-run"], 2, "twice"),
                (["show", "--format", "xml"], 2, "xml"),
                (["show", "--interface", "nonet0"], 2, "nonet0"),
                ([], 2, "")):
            with self.subTest(arguments=arguments):
                answer = self.ontime("tune", *arguments)
                self.assertEqual(answer.returncode, code, answer.stderr)
                self.assertIn(words, answer.stdout + answer.stderr)
                self.assertEqual(state(), self.before)


if __name__ == "__main__":
    unittest.main(verbosity=2)
