#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""CPUs that are kept for a run, by the real program, and given back however it ends; looked at by other means: /proc,
taskset. Needs root, control groups and two CPUs, and skips without. ONTIME names the program."""

import json
import os
import pathlib
import re
import shutil
import signal
import subprocess
import tempfile
import unittest

from program import ONTIME, eventually, kill_at_once

SCENARIO = """
hosts: namespaces
defaults: {transport: udp, period: 5 ms, duration: %s}
runs:
  - id: kept
    load: {controller: {cpu: 1}}
    traffic: {rate: 1 Mbit/s, direction: to-component}
    isolation: {cpus: %s, interrupts: on, load-quota: 30 %%, load-weight: 10}
"""
PLACES = """
hosts:
  controller: {command-prefix: %s, interface: lo}
  component: {command-prefix: %s, interface: lo, address: 127.0.0.1}
defaults: {transport: udp, period: 5 ms, duration: 300 ms}
runs:
  - {id: placed, load: {controller: {cpu: 1}}, isolation: %s}
"""
CPUS = sorted(os.sched_getaffinity(0))
KEPT, REST = str(CPUS[-1]), CPUS[:-1]
WORK = pathlib.Path("/sys/devices/virtual/workqueue/cpumask")


def hierarchy(controller):
    """Where its groups are, and whether that is version 2."""
    for line in pathlib.Path("/proc/mounts").read_text().splitlines():
        _, folder, kind, options = line.split()[:4]
        if kind == "cgroup" and controller in options.split(","):
            return pathlib.Path(folder), False
        if kind == "cgroup2" and controller in pathlib.Path(folder, "cgroup.controllers").read_text().split():
            return pathlib.Path(folder), True
    return None, False


def state():
    """What these tests change of this machine, but for who is where."""
    found = [WORK.read_text()]
    for controller in ("cpuset", "cpu"):
        root, unified = hierarchy(controller)
        found.append(sorted(path.name for path in root.iterdir() if path.name.startswith("ontime-")))
        file = root / ("cgroup.subtree_control" if unified else "cpuset.sched_load_balance")
        found.append(file.read_text() if file.exists() else "")
    return found


def cpus(pid):
    """Of each thread of a process, by /proc."""
    found = set()
    for thread in pathlib.Path(f"/proc/{pid}/task").iterdir():
        found.add(re.search(r"Cpus_allowed_list:\s*(\S+)", (thread / "status").read_text())[1])
    return found


def named(name):
    """Processes whose command line begins with that program and holds that word."""
    program, _, word = name.partition(" ")
    found = []
    for path in pathlib.Path("/proc").glob("[0-9]*/cmdline"):
        try:
            words = path.read_bytes().decode(errors="replace").split("\0")
        except OSError:
            continue
        if words[0].rpartition("/")[2].startswith(program) and (not word or word in words):
            found.append(int(path.parent.name))
    return found


def agents():
    return [pid for pid in named("ontime agent") if os.readlink(f"/proc/{pid}/exe") == os.path.realpath(ONTIME)]


@unittest.skipUnless(os.geteuid() == 0, "CPUs are kept by root alone")
@unittest.skipUnless(len(CPUS) > 1, "there is no CPU to spare")
@unittest.skipUnless(hierarchy("cpuset")[0] and hierarchy("cpu")[0], "there are no control groups")
class Isolation(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.mkdtemp(prefix="ontime-test-")
        self.addCleanup(shutil.rmtree, self.folder)
        self.results = os.path.join(self.folder, "results.ontime")
        self.ontime("tune", "revert")  # what tests that were killed left
        self.before = state()
        self.others = set(named("iperf3") + named("stress-ng"))
        self.bystander = subprocess.Popen(["sleep", "1000"])  # who asked for nothing
        # which asked for a CPU of its own, and is to have it again
        self.pinned = subprocess.Popen(["taskset", "--cpu-list", str(CPUS[0]), "sleep", "1000"])
        self.addCleanup(lambda: [one.kill() or one.wait() for one in (self.bystander, self.pinned)])
        self.assertTrue(eventually(lambda: cpus(self.pinned.pid) == {str(CPUS[0])}))
        self.everywhere = cpus(self.bystander.pid)

    def new(self, name):
        """Not those that ran before this test."""
        return [pid for pid in named(name) if pid not in self.others]

    def tearDown(self):
        answer = self.ontime("tune", "revert")
        self.assertEqual(state(), self.before)
        self.assertFalse(os.path.exists("/run/ontime"), answer.stderr)

    def ontime(self, *arguments):
        return subprocess.run([ONTIME, *arguments], capture_output=True, text=True, timeout=120)

    def scenario(self, duration, kept=KEPT):
        return self.written(SCENARIO % (duration, kept))

    def written(self, text):
        path = os.path.join(self.folder, "scenario.yaml")
        pathlib.Path(path).write_text(text)
        return path

    def placed(self, place, isolation):
        """A run of ends that are wherever that command has them."""
        return self.ontime("run", self.written(PLACES % (place, place, isolation)), "--results", self.results)

    def report(self):
        return json.loads(self.ontime("report", self.results, "--format", "json").stdout)["runs"]

    def isolated_run(self):
        process = subprocess.Popen([ONTIME, "run", self.scenario("1 h"), "--results", self.results],
                                   stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.addCleanup(lambda: (process.kill(), process.communicate()))
        self.assertTrue(eventually(lambda: len(self.new("iperf3")) >= 2 and self.new("stress-ng") and len(agents()) == 2))
        return process

    def assert_given_back(self):
        self.assertTrue(eventually(lambda: state() == self.before), state())
        self.assertTrue(eventually(lambda: not os.path.exists("/run/ontime")))
        self.assertEqual(cpus(self.bystander.pid), self.everywhere)
        self.assertEqual(cpus(self.pinned.pid), {str(CPUS[0])})
        root, _ = hierarchy("cpuset")
        self.assertIn(str(self.bystander.pid), (root / "cgroup.procs").read_text().split())

    def test_the_robot_has_its_cpus_and_nobody_else(self):
        process = self.isolated_run()
        for pid in agents():
            self.assertEqual(cpus(pid), {KEPT})
            said = subprocess.run(["taskset", "--cpu-list", "--pid", str(pid)], capture_output=True, text=True).stdout
            self.assertTrue(said.rstrip().endswith(f": {KEPT}"), said)
        beside = self.new("iperf3") + self.new("stress-ng")
        for pid in [self.bystander.pid, process.pid, *beside]:
            for one in cpus(pid):
                self.assertNotIn(int(KEPT), [cpu for part in one.split(",") for cpu in
                                             range(int(part.split("-")[0]), int(part.split("-")[-1]) + 1)], pid)
        root, unified = hierarchy("cpu")
        group = root / "ontime-load"
        inside = set(map(int, (group / "cgroup.procs").read_text().split()))
        self.assertLessEqual(set(beside), inside)
        self.assertTrue(inside.isdisjoint(agents()))
        if unified:
            self.assertEqual((group / "cpu.max").read_text(), "30000 100000\n")
            self.assertEqual((group / "cpu.weight").read_text(), "10\n")
        else:
            self.assertEqual((group / "cpu.cfs_quota_us").read_text(), "30000\n")
            self.assertEqual((group / "cpu.shares").read_text(), "102\n")
        self.assertEqual(int(WORK.read_text().replace(",", ""), 16), sum(1 << cpu for cpu in REST))
        cpusets, unified = hierarchy("cpuset")
        if not unified:
            other = cpusets / "test-of-ontime"
            other.mkdir()
            try:
                with self.assertRaises(OSError, msg="no process can give them to its own group"):
                    (other / "cpuset.cpus").write_text(KEPT)
            finally:
                other.rmdir()
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=180)
        self.assertEqual(process.returncode, 130)
        self.assert_given_back()

    def test_it_is_in_the_record(self):
        answer = self.ontime("run", self.scenario("300 ms"), "--results", self.results, "--full")
        self.assertEqual(answer.returncode, 0, answer.stderr)
        self.assert_given_back()
        self.assertRegex(" ".join(answer.stdout.split()), f"CPUs {KEPT} reserved, interrupts .* 30 % of a CPU")
        run = self.report()[0]
        self.assertEqual(run["conditions"]["isolation"]["cpus"], KEPT)
        for host in ("controller", "component"):
            said = run["hosts"][host]["isolation"]
            self.assertEqual({one["setting"] for one in said}, {"cpus", "workqueue-cpus", "load-quota", "load-weight"})
            for one in said:
                self.assertEqual(one["now"], one["after"], one)

    @unittest.skipIf(hierarchy("cpuset")[1], "version 2 keeps all processes off, or refuses")
    def test_who_may_run_on_kept_cpus_all_the_same_is_in_the_record(self):
        stays = subprocess.Popen(["taskset", "--cpu-list", KEPT, "sleep", "1000"])
        self.addCleanup(lambda: stays.kill() or stays.wait())
        self.assertTrue(eventually(lambda: cpus(stays.pid) == {KEPT}))
        answer = self.ontime("run", self.scenario("300 ms"), "--results", self.results)
        self.assertEqual(answer.returncode, 0, answer.stderr)
        notes = [note["text"] for note in self.report()[0]["notes"] if note["kind"] == "cpus-shared"]
        self.assertEqual(len(notes), 1, "both ends are on one machine")
        self.assertIn(f"run on CPUs {KEPT}: ", notes[0])
        self.assertIn(f"sleep ({stays.pid}, CPUs {KEPT})", notes[0])
        self.assertNotIn(f"({self.pinned.pid}, ", notes[0])
        self.assertEqual(cpus(stays.pid), {KEPT})
        self.assert_given_back()

    def test_killed_it_is_given_back_by_the_next(self):
        for by in ("keeper", "next start"):
            with self.subTest(by=by):
                process = self.isolated_run()
                children = pathlib.Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
                # Where the next start is to do it, no process is left that could.
                kill_at_once(process.pid, *(map(int, children) if by == "next start" else ()))
                process.communicate(timeout=180)
                if by == "next start":
                    self.assertTrue(eventually(lambda: not agents()))
                    self.assertNotEqual(state(), self.before)
                    self.assertIn("ontime-robot", self.ontime("tune", "revert").stdout)
                self.assert_given_back()

    def test_what_cannot_be_is_refused_and_nothing_is_changed(self):
        root, _ = hierarchy("cpuset")
        for kept, why in ((f"{CPUS[0]}-{CPUS[-1]}", "are all CPUs"), ("1023", "no CPU 1023")):
            with self.subTest(kept=kept):
                answer = self.ontime("run", self.scenario("1 s", kept), "--results", self.results)
                self.assertEqual(answer.returncode, 3)
                self.assertIn(why, answer.stderr)
                self.assert_given_back()
        other = root / "test-of-ontime"
        other.mkdir()
        try:
            if not (other / "cpuset.cpus").exists():
                self.skipTest("the controller is not on for the groups here")
            (other / "cpuset.cpus").write_text(KEPT)
            answer = self.ontime("run", self.scenario("1 s"), "--results", self.results)
            self.assertEqual(answer.returncode, 3)
            self.assertIn(f"belong to other control groups: {other}", answer.stderr)
            self.assertEqual((other / "cpuset.cpus").read_text(), KEPT + "\n")
        finally:
            other.rmdir()
        self.assert_given_back()

    @unittest.skipIf(hierarchy("cpuset")[1], "version 2 keeps all processes off, or refuses")
    def test_cpus_that_everybody_was_started_with_are_refused_where_these_are_not_all(self):
        first = str(CPUS[0])
        answer = subprocess.run(["taskset", "--cpu-list", first, "unshare", "--pid", "--fork", "--kill-child", "--mount-proc",
                                 ONTIME, "run", self.scenario("1 s", first), "--results", self.results],
                                capture_output=True, text=True, timeout=120)
        self.assertEqual(answer.returncode, 3, answer.stderr)
        self.assertIn(f"CPUs {first} cannot be reserved: all processes are bound to {first} of ", answer.stderr)
        self.assert_given_back()

    def test_load_is_limited_wherever_the_ends_live(self):
        answer = self.placed("[env]", "{load-quota: 30 %}")
        self.assertEqual(answer.returncode, 0, answer.stderr)
        self.assertEqual({one["setting"] for one in self.report()[0]["hosts"]["controller"]["isolation"]}, {"load-quota"})
        self.results = os.path.join(self.folder, "refused.ontime")
        for isolation in ("{load-quota: 30 %}, traffic: {rate: 1 Mbit/s}", f"{{cpus: {KEPT}, interrupts: on}}"):
            with self.subTest(isolation=isolation):
                answer = self.placed("[env]", isolation)
                self.assertEqual(answer.returncode, 2, answer.stderr)
                self.assertIn("[ip, netns, exec, NAME]", answer.stderr)
        self.assert_given_back()

    def test_an_end_in_a_pid_namespace_of_its_own_is_refused(self):
        answer = self.placed("[unshare, --pid, --fork, --kill-child, --mount-proc]", f"{{cpus: {KEPT}}}")
        self.assertEqual(answer.returncode, 3, answer.stderr)
        self.assertIn("PID namespace", answer.stderr)
        self.assert_given_back()


if __name__ == "__main__":
    unittest.main()
