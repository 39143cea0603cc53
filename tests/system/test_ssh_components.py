#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The real program, and two components that it reaches by ssh: two sshds of this test's own, each in a network namespace,
behind a switch to measure by and another for ssh. Needs root, and skips without. ONTIME names the program."""

import contextlib
import json
import os
import pathlib
import shutil
import signal
import subprocess
import tempfile
import unittest

import sshd
from program import ONTIME, eventually, processes_with, sample_count

NEAR = f"near-{os.getpid()}"
FAR = {"arm": 2, "base": 3}  # and the last part of its addresses
SCENARIO = """
hosts:
  controller: {interface: test, address: 198.18.1.1}
components:
  arm: {ssh: 198.18.2.2, program: %s, interface: test, address: 198.18.1.2}
  base: {ssh: 198.18.2.3, program: %s, interface: test, address: 198.18.1.3}
defaults: {transport: %s, period: 5 ms, timeout: 10 s, duration: %s, arm: {period: 2 ms, deadline: 2 ms}}
runs:
  - id: run
    %s
"""


def ip(words):
    subprocess.run(["ip", *words.split()], check=True)


@unittest.skipUnless(os.geteuid() == 0, "network namespaces need root")
@unittest.skipUnless(shutil.which("sshd", path="/usr/sbin"), "no sshd: sudo apt install openssh-server")
class SshComponents(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = pathlib.Path(tempfile.mkdtemp(prefix="ontime-ssh-test-"))
        cls.addClassCleanup(shutil.rmtree, folder)
        folder.chmod(0o755)
        cls.keys = folder / "keys"
        cls.keys.mkdir()
        sshd.make_keys(cls.keys)
        cls.folder, cls.temporary = folder, {}
        for name in (NEAR, *(f"{far}-{os.getpid()}" for far in FAR)):
            ip(f"netns add {name}")
            cls.addClassCleanup(ip, f"netns del {name}")
        for subnet, switch in ((1, "test"), (2, "ssh")):
            ip(f"-n {NEAR} link add {switch} type bridge mcast_snooping 0")
            ip(f"-n {NEAR} address add 198.18.{subnet}.1/24 dev {switch}")
            ip(f"-n {NEAR} link set {switch} up")
            for far, number in FAR.items():
                there = f"{far}-{os.getpid()}"
                ip(f"link add {switch}-{far} netns {NEAR} type veth peer name {switch} netns {there}")
                ip(f"-n {NEAR} link set {switch}-{far} master {switch} up")
                ip(f"-n {there} address add 198.18.{subnet}.{number}/24 dev {switch}")
                ip(f"-n {there} link set {switch} up")
        for far in FAR:
            shutil.copytree(cls.keys, folder / far)
            cls.temporary[far] = folder / far / "tmp"
            cls.temporary[far].mkdir()
            cls.enterClassContext(sshd.serving(folder / far, f"{far}-{os.getpid()}", cls.temporary[far]))

    def setUp(self):
        self.own = pathlib.Path(tempfile.mkdtemp(dir=self.folder))
        self.results = self.own / "results.ontime"
        self.near_temporary = self.own / "tmp"
        self.near_temporary.mkdir()
        path = sshd.make_client(self.keys, self.own, ("198.18.2.2", "198.18.2.3"))
        sshd.configure_client(self.keys, self.own, "198.18.2.*")
        self.environment = dict(os.environ, TMPDIR=str(self.near_temporary),
                                ONTIME_TEST=str(self.near_temporary), PATH=f"{path}:{os.environ['PATH']}")

    def tearDown(self):
        self.assertTrue(eventually(self.nothing_left), self.what_is_left())

    def of(self, far, word=""):
        return [pid for pid, command in processes_with(f"ONTIME_TEST={self.temporary[far]}").items() if word in command]

    def what_is_left(self):
        folders = [self.near_temporary, *self.temporary.values()]
        return [processes_with(f"ONTIME_TEST={folder}") for folder in folders] + [os.listdir(folder) for folder in folders]

    def nothing_left(self):
        return not any(self.what_is_left())

    def command(self, duration, *more, transport="udp", keys="", program=ONTIME):
        text = SCENARIO % (program, program, transport, duration, keys)
        path = self.own / "scenario.yaml"
        path.write_text(text if program else text.replace("program: , ", ""))
        return ["ip", "netns", "exec", NEAR, ONTIME, "run", str(path), *more, "--results", str(self.results)]

    def run_ontime(self, *arguments, **options):
        return subprocess.run(self.command(*arguments, **options), capture_output=True, text=True, env=self.environment, timeout=180)

    def report(self):
        answer = subprocess.run([ONTIME, "report", str(self.results), "--format", "json"], capture_output=True, text=True)
        self.assertEqual(answer.returncode, 0, answer.stderr)
        return json.loads(answer.stdout)["runs"]

    def measured(self):
        arm, base = self.report()
        for run, name, period in ((arm, "arm", 2000), (base, "base", 5000)):
            self.assertTrue(run["complete"])
            self.assertEqual((run["conditions"]["component"], run["period_us"]), (name, period))
            self.assertEqual(run["hosts"]["component"]["ssh_link"], {"interface": "ssh", "shared": False})
            self.assertGreater(run["on_time"] + run["late"], 0)
        return arm, base

    def test_each_is_measured_where_ssh_finds_it(self):
        for transport in ("udp", "cyclonedds"):
            with self.subTest(transport=transport):
                self.results = self.own / transport
                answer = self.run_ontime("1 s", transport=transport)
                self.assertEqual(answer.returncode, 0, answer.stderr)
                for run, number in zip(self.measured(), FAR.values()):
                    self.assertIn(f"198.18.1.{number}", run["hosts"]["component"]["transport"]["facts"]["address"])

    def test_exchanged_addresses_are_refused_before_a_message_is_sent(self):
        command = self.command("1 s")
        path = self.own / "scenario.yaml"
        text = path.read_text()
        path.write_text(text.replace("198.18.1.2", "198.18.1.9").replace("198.18.1.3", "198.18.1.2").replace("198.18.1.9", "198.18.1.3"))
        answer = subprocess.run(command, capture_output=True, text=True, env=self.environment, timeout=180)
        self.assertEqual(answer.returncode, 2, answer.stderr)
        self.assertIn("198.18.1.3 is not an address of 198.18.2.2", answer.stderr)
        for run in self.report():
            self.assertEqual(run["sent"], 0)

    def test_each_has_a_keeper_and_an_agent_of_its_own(self):
        process = subprocess.Popen(self.command("10 s"), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=self.environment)
        self.addCleanup(lambda: (process.kill(), process.communicate()))
        self.assertTrue(eventually(lambda: sample_count(self.results) > 50), process.poll())
        for far in FAR:
            self.assertEqual((len(self.of(far, "/ontime keeper")), len(self.of(far, "/ontime agent"))), (1, 1))
        _, error = process.communicate(timeout=180)
        self.assertEqual(process.returncode, 0, error)

    def test_the_program_is_brought_to_each_and_taken_away(self):
        answer = self.run_ontime("2 s", "--deploy", program="")
        self.assertEqual(answer.returncode, 0, answer.stderr)
        self.measured()

    def test_load_and_traffic_are_where_they_are_said_to_be(self):
        answer = self.run_ontime("2 s", keys="traffic: {rate: 4 Mbit/s}\n    arm: {load: {component: {cpu: 1}}}")
        self.assertEqual(answer.returncode, 0, answer.stderr)
        arm, base = self.measured()
        self.assertEqual([run["hosts"]["component"]["load_running"] for run in (arm, base)], [True, None])
        for run in (arm, base):
            for way in run["conditions"]["traffic"]["achieved"].values():
                self.assertTrue(way["running"])
                self.assertGreater(way["received_bit_s"], 0)  # how much, a busy machine decides

    def test_a_connection_that_breaks_ends_all_and_names_the_machine(self):
        process = subprocess.Popen(self.command("1 h"), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=self.environment)
        self.addCleanup(lambda: (process.kill(), process.communicate()))
        self.assertTrue(eventually(lambda: all(sample_count(self.results, run) > 50 for run in (1, 2))), process.poll())
        listens = int((self.folder / "base" / "sshd.pid").read_text())
        for pid in subprocess.run(["pgrep", "-P", str(listens)], capture_output=True, text=True).stdout.split():
            with contextlib.suppress(ProcessLookupError):
                os.kill(int(pid), signal.SIGKILL)
        _, error = process.communicate(timeout=120)
        self.assertEqual(process.returncode, 3, error)
        self.assertIn("the connection to 198.18.2.3 was lost", error)
        for run in self.report():
            self.assertIn("the connection to 198.18.2.3 was lost", run["error"])
            self.assertGreater(run["sent"], 10)
            self.assertEqual(run["sent"], run["on_time"] + run["late"] + run["lost"])


if __name__ == "__main__":
    unittest.main(verbosity=2)
