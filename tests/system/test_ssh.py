#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The real program, and a machine that it reaches by ssh: an sshd of this test's own in a network namespace, with keys
made for it. Two links join it: one to measure, one for ssh. Needs root, and skips without. ONTIME names the program."""

import contextlib
import json
import os
import pathlib
import re
import shutil
import signal
import subprocess
import tempfile
import time
import unittest

import sshd
import yaml
from program import ONTIME, eventually, processes_with, sample_count
from sshd import PORT

NEAR, FAR = f"near-{os.getpid()}", f"far-{os.getpid()}"
USER, USER_ID = "robot-user", 64321
ARM64 = pathlib.Path(__file__).resolve().parents[2] / "build/arm64"

SCENARIO = """
hosts:
  controller: {interface: test-near, address: 198.18.1.1}
  component: {ssh: %s, interface: %s, address: 198.18.1.2}
defaults: {transport: udp, period: 5 ms, duration: %s}
runs:
  - id: run
    %s
"""


def run(*words, **options):
    return subprocess.run([str(word) for word in words], check=True, capture_output=True, text=True, **options)


def executable(pid):
    """Nothing of one that has just left, or is still the shell that ssh's server starts it by."""
    with contextlib.suppress(OSError):
        return os.path.realpath(f"/proc/{pid}/exe", strict=True)


@unittest.skipUnless(os.geteuid() == 0, "network namespaces need root")
@unittest.skipUnless(shutil.which("sshd", path="/usr/sbin"), "no sshd: sudo apt install openssh-server")
class Ssh(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(tempfile.mkdtemp(prefix="ontime-ssh-test-"))
        cls.addClassCleanup(shutil.rmtree, cls.folder)
        cls.folder.chmod(0o755)  # sshd reads there as the user who comes
        for name in (NEAR, FAR):
            run("ip", "netns", "add", name)
            cls.addClassCleanup(run, "ip", "netns", "del", name)
        for link, subnet in (("test", 1), ("ssh", 2)):
            run("ip", "-n", NEAR, "link", "add", f"{link}-near", "type", "veth", "peer", f"{link}-far", "netns", FAR)
            for name, side, host in ((NEAR, "near", 1), (FAR, "far", 2)):
                run("ip", "-n", name, "address", "add", f"198.18.{subnet}.{host}/30", "dev", f"{link}-{side}")
                run("ip", "-n", name, "link", "set", f"{link}-{side}", "up")
        sshd.make_keys(cls.folder)
        cls.far_temporary = cls.folder / "far"
        cls.far_temporary.mkdir(mode=0o1777)
        cls.far_temporary.chmod(0o1777)
        cls.enterClassContext(sshd.serving(cls.folder, FAR, cls.far_temporary,
                                           f"{USER}:x:{USER_ID}:{USER_ID}::{cls.folder}:/bin/sh\n"))

    def setUp(self):
        self.own = pathlib.Path(tempfile.mkdtemp(dir=self.folder))
        self.results = self.own / "results.ontime"
        self.near_temporary = self.own / "tmp"
        self.near_temporary.mkdir()
        path = sshd.make_client(self.folder, self.own, ("198.18.2.2", "198.18.1.2"))
        self.configure()
        self.environment = dict(os.environ, TMPDIR=str(self.near_temporary),
                                ONTIME_TEST=str(self.near_temporary), PATH=f"{path}:{os.environ['PATH']}")

    def tearDown(self):
        self.assertTrue(eventually(self.nothing_left), self.what_is_left())

    def configure(self, **changes):
        sshd.configure_client(self.folder, self.own, **{"HostName": "198.18.2.2", **changes})

    def near(self):
        return processes_with(f"ONTIME_TEST={self.near_temporary}")

    def far(self, word=""):
        found = processes_with(f"ONTIME_TEST={self.far_temporary}")
        return [pid for pid, command in found.items() if word in command]

    def nothing_left(self):
        return not (self.near() or self.far() or os.listdir(self.near_temporary) or os.listdir(self.far_temporary))

    def what_is_left(self):
        return (f"near {self.near()} {os.listdir(self.near_temporary)}, "
                f"far {processes_with(f'ONTIME_TEST={self.far_temporary}')} {os.listdir(self.far_temporary)}")

    def scenario(self, destination="robot", interface="test-far", duration="300 ms", program=ONTIME, keys=""):
        text = SCENARIO % (destination, interface, duration, keys)
        if program:
            text = text.replace("component: {", f"component: {{program: {program}, ", 1)
        path = self.own / "scenario.yaml"
        path.write_text(text)
        return path

    def command(self, *arguments):
        return ["ip", "netns", "exec", NEAR, ONTIME, "run", *map(str, arguments), "--results", str(self.results)]

    def run_ontime(self, *arguments):
        return subprocess.run(self.command(*arguments), capture_output=True, text=True, env=self.environment, timeout=180)

    def start_ontime(self, *arguments):
        process = subprocess.Popen(self.command(*arguments), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                                   env=self.environment)
        self.addCleanup(lambda: (process.kill(), process.communicate()))  # of a test that failed
        return process

    def report(self):
        answer = subprocess.run([ONTIME, "report", str(self.results), "--format", "json"], capture_output=True, text=True)
        self.assertEqual(answer.returncode, 0, answer.stderr)
        return json.loads(answer.stdout)["runs"]

    def connections(self):
        return run("ip", "netns", "exec", FAR, "ss", "-Htn", "state", "established", "sport", "=", f":{PORT}").stdout.splitlines()

    def loaded_run(self):
        process = self.start_ontime(self.scenario(duration="1 h", keys="load: {component: {cpu: 1, hdd: 1, hdd-bytes: 16 MiB}}"))
        self.assertTrue(eventually(lambda: sample_count(self.results) > 50 and self.far("stress-ng")), process.poll())
        return process

    def ended(self, process, code, words):
        out, error = process.communicate(timeout=120)
        self.assertEqual(process.returncode, code, error)
        self.assertIsNotNone(re.search(words, error), error)
        return out

    def kept_run(self, words):
        run_ = self.report()[0]
        self.assertRegex(run_["error"], words)
        self.assertGreater(run_["sent"], 50)
        self.assertEqual(run_["sent"], run_["on_time"] + run_["late"] + run_["lost"])

    # --- what it is for ---

    def test_one_connection_for_keeper_and_agents(self):
        process = self.start_ontime(self.scenario(duration="10 s"))
        self.assertTrue(eventually(lambda: self.far("/ontime agent")), process.poll())
        self.assertEqual(len(self.connections()), 1)
        self.assertEqual(len(self.far("/ontime keeper")), 1)
        self.assertIn("udp", self.ended(process, 0, ""))
        hosts = self.report()[0]["hosts"]
        self.assertEqual(hosts["component"]["transport"]["facts"]["address"].split(":")[0], "198.18.1.2")

    def test_one_machine_reached_in_two_ways_is_said(self):
        answer = self.run_ontime(self.scenario())
        self.assertEqual(answer.returncode, 0, answer.stderr)
        self.assertRegex(answer.stderr, "are on one machine.*two ontimes")

    def test_a_search_looks_at_the_machine_behind_ssh_before_its_first_run(self):
        command = ["ip", "netns", "exec", NEAR, ONTIME, "tune", "search", self.scenario(), "--goal", "p50 < 1 s",
                   "--results", self.results, "--format", "json"]
        answer = subprocess.run(command, capture_output=True, text=True, env=self.environment, timeout=180)
        self.assertEqual(answer.returncode, 0, answer.stderr)
        left_out = {one["key"]: one["why"] for one in json.loads(answer.stdout)["left_out"]}
        self.assertIn("on the component, test-far has no interrupts", left_out["kernel.irq-cpus"])

    def test_init_writes_a_scenario_that_runs(self):
        def init(*hosts):
            file = self.own / f"{len(hosts)}.yaml"
            answer = subprocess.run(["ip", "netns", "exec", NEAR, ONTIME, "init", *hosts, "--output", file],
                                    capture_output=True, text=True, env=self.environment, timeout=60)
            self.assertEqual(answer.returncode, 0, answer.stderr)
            self.assertIn(f"ontime run {file} --deploy", answer.stdout)  # there is no ontime in the PATH of its user
            return file, yaml.safe_load(file.read_text())["hosts"]

        self.configure(RemoteCommand="tmux attach", RequestTTY="yes")
        component = {"ssh": "robot", "interface": "ssh-far", "address": "198.18.2.2"}
        file, hosts = init("robot")
        self.assertEqual(hosts, {"controller": {"interface": "ssh-near", "address": "198.18.2.1"}, "component": component})
        self.assertEqual(init("robot", "robot")[1], {"controller": component, "component": component})
        answer = self.run_ontime(file, "--deploy", "--duration", "300ms")
        self.assertEqual(answer.returncode, 0, answer.stderr)
        self.assertEqual([run["id"] for run in self.report()], ["idle", "loaded", "loaded-realtime"])

    def test_words_reach_the_machine_as_they_are(self):
        odd = self.own / "it's a \"$HOME\" folder; exit 9"
        odd.mkdir()
        program = odd / "ontime"
        program.write_text(f'#!/bin/sh\nexec {ONTIME} "$@"\n')
        program.chmod(0o755)
        answer = self.run_ontime(self.scenario(program=json.dumps(str(program))))
        self.assertEqual(answer.returncode, 0, answer.stderr)

    def test_other_user_with_capabilities(self):
        """The capabilities are the file's, and then only transports that lie beside the program are loaded."""
        there = self.own / "installed"
        program = there / "bin" / "ontime"
        program.parent.mkdir(parents=True)
        self.own.chmod(0o755)
        shutil.copy(ONTIME, program)
        shutil.copytree(pathlib.Path(ONTIME).parent.parent / "lib", there / "lib")
        run("setcap", "cap_sys_nice,cap_ipc_lock=ep", program)
        answer = self.run_ontime(self.scenario(destination=f"{USER}@robot", program=program,
                                               keys="realtime: on\n    load: {component: {cpu: 1}}"))
        self.assertEqual(answer.returncode, 0, answer.stderr)
        component = self.report()[0]["hosts"]["component"]
        for thread in component["threads"]:
            if thread["role"] == "receive":
                self.assertEqual((thread["policy"], thread["priority"]), ("fifo", 80))
        self.assertTrue(component["load_running"])

    # --- the link of ssh ---

    def test_ssh_on_a_link_of_its_own_is_told_from_the_one_under_test(self):
        answer = self.run_ontime(self.scenario())
        self.assertEqual(answer.returncode, 0, answer.stderr)
        self.assertNotIn("ssh", answer.stdout.replace(str(self.folder), ""))
        self.assertEqual(self.report()[0]["hosts"]["component"]["ssh_link"], {"interface": "ssh-far", "shared": False})
        self.assertIsNone(self.report()[0]["hosts"]["controller"]["ssh_link"])

    def test_ssh_on_the_link_under_test_is_said(self):
        self.configure(HostName="198.18.1.2")
        answer = self.run_ontime(self.scenario(), "--full")
        self.assertEqual(answer.returncode, 0, answer.stderr)
        self.assertIn("ssh to the component uses test-far", " ".join(answer.stdout.split()))
        self.assertNotIn("waited", answer.stdout)  # the samples are on this side
        self.assertEqual(self.report()[0]["hosts"]["component"]["ssh_link"], {"interface": "test-far", "shared": True})

    def far_controller(self, **settings):
        """The far machine sends, and the near one answers."""
        text = self.scenario(**settings).read_text()
        here, there = "{interface: test-near, address: 198.18.1.1}", text.split("component: ")[1].splitlines()[0]
        text = text.replace("component: " + there, "component: " + here).replace("controller: " + here, "controller: " + there, 1)
        path = self.own / "scenario.yaml"
        path.write_text(text)
        return path

    def test_samples_wait_where_ssh_takes_the_link_under_test(self):
        self.configure(HostName="198.18.1.2")
        process = self.start_ontime(self.far_controller(duration="10 s"))
        self.assertTrue(eventually(lambda: self.far("/ontime agent")))
        time.sleep(3)
        self.assertEqual(sample_count(self.results), 0)
        out = self.ended(process, 0, "")
        self.assertRegex(" ".join(out.split()), r"\d kB of samples .*ssh")
        self.assertEqual(sample_count(self.results), self.report()[0]["sent"])
        self.assertGreater(self.report()[0]["sent"], 100)

    # --- a machine without ontime ---

    def test_deploy_brings_the_program_and_takes_it_away(self):
        process = self.start_ontime(self.scenario(program="", duration="10 s"), "--deploy")
        self.assertTrue(eventually(lambda: self.far("/ontime agent")), process.poll())
        brought = [name for name in os.listdir(self.far_temporary) if name.startswith("ontime-program-")]
        self.assertEqual(len(brought), 1)
        self.assertEqual(os.stat(self.far_temporary / brought[0]).st_mode & 0o777, 0o700)
        program = str(self.far_temporary / brought[0] / "bin" / "ontime")
        if shutil.which("strip"):
            self.assertLess(os.stat(program).st_size, os.stat(ONTIME).st_size)
        self.assertTrue(eventually(lambda: program in map(executable, self.far("/ontime agent"))))
        self.ended(process, 0, "")

    def test_deployed_program_is_taken_away_when_the_connection_breaks(self):
        process = self.start_ontime(self.scenario(program="", duration="1 h"), "--deploy")
        self.assertTrue(eventually(lambda: sample_count(self.results) > 50), process.poll())
        for pid in self.sessions():
            os.kill(pid, signal.SIGKILL)
        self.ended(process, 3, "the connection to robot was lost")
        self.kept_run("the connection to robot was lost")

    def test_deployed_keeper_that_is_killed_with_its_coordinator_is_given_back_by_the_shell_there(self):
        load = "load: {component: {cpu: 1, hdd: 1, hdd-bytes: 16 MiB}}"
        process = self.start_ontime(self.scenario(program="", duration="1 h", keys=load), "--deploy")
        self.assertTrue(eventually(lambda: sample_count(self.results) > 50 and self.far("stress-ng")), process.poll())
        for pid in (process.pid, *self.far("bin/ontime keeper")):
            os.kill(pid, signal.SIGKILL)
        process.communicate(timeout=180)
        self.assertTrue(eventually(self.nothing_left), self.what_is_left())

    def scenario_with_another(self, name, script, *variables):
        """Where a command of the far machine is this one, and it has more environment variables."""
        folder = self.own / "far-bin"
        folder.mkdir()
        (folder / name).write_text(script)
        (folder / name).chmod(0o755)
        path = self.scenario(program="")
        words = ", ".join(f"'{word}'" for word in ("env", f"PATH={folder}:/usr/bin:/bin", *variables))
        path.write_text(path.read_text().replace("component: {", f"component: {{host-prefix: [{words}], "))
        return path

    def test_deploy_to_another_architecture_is_refused(self):
        answer = self.run_ontime(self.scenario_with_another("uname", "#!/bin/sh\necho riscv64\n"), "--deploy")
        self.assertEqual(answer.returncode, 3, answer.stderr)
        self.assertRegex(answer.stderr, f"riscv64, .*{os.uname().machine}")
        self.assertIn("share/ontime/deploy/riscv64", answer.stderr)

    def test_deploy_brings_what_is_installed_for_the_architecture_there(self):
        own = self.own / "installed"
        other = own / "share/ontime/deploy/riscv64"
        build = pathlib.Path(ONTIME).resolve().parent.parent
        transport = next(build.glob("lib/**/ontime_transport_udp.so"))
        for prefix, folder in (own, transport.parent.relative_to(build)), (other, "lib/riscv64-linux-gnu/ontime"):
            (prefix / "bin").mkdir(parents=True)
            (prefix / folder).mkdir(parents=True)
            shutil.copy(ONTIME, prefix / "bin/ontime")
            shutil.copy(transport, prefix / folder)
        far_program = other / "bin/ontime"
        far_program.write_text("#!/bin/sh\necho brought from the folder of riscv64\n")
        scenario = self.scenario_with_another("uname", "#!/bin/sh\necho riscv64\n")
        command = [own / "bin/ontime" if word == ONTIME else word for word in self.command(scenario, "--deploy")]
        answer = subprocess.run(command, capture_output=True, text=True, env=self.environment, timeout=180)
        self.assertIn("brought from the folder of riscv64", answer.stderr)
        self.assertEqual(answer.returncode, 3, answer.stderr)
        fifo = other / "lib/riscv64-linux-gnu/ontime" / transport.name
        fifo.unlink()
        os.mkfifo(fifo)
        answer = subprocess.run(command, capture_output=True, text=True, env=self.environment, timeout=180)
        self.assertIn(f"cannot read {fifo}", answer.stderr)
        self.assertEqual(answer.returncode, 3, answer.stderr)

    def test_deploy_brings_a_program_for_arm64_that_measures(self):
        """The far machine says that it is aarch64, and this kernel has qemu-user run programs for it."""
        if not (ARM64 / "bin/ontime").exists():
            self.skipTest("no program for arm64: scripts/setup arm64 bin/ontime transports")
        if not os.path.exists("/proc/sys/fs/binfmt_misc/qemu-aarch64"):
            self.skipTest("this kernel runs no programs for aarch64: sudo apt install qemu-user-static")
        own = self.own / "installed"
        build = pathlib.Path(ONTIME).resolve().parent.parent
        transport = next(build.glob("lib/**/ontime_transport_udp.so"))
        for file in pathlib.Path(ONTIME).resolve(), transport:
            (own / file.relative_to(build)).parent.mkdir(parents=True)
            shutil.copy(file, own / file.relative_to(build))
        run("cmake", "--install", ARM64, "--strip", "--prefix", own / "share/ontime/deploy/aarch64")
        scenario = self.scenario_with_another("uname", "#!/bin/sh\necho aarch64\n", f"QEMU_LD_PREFIX={ARM64}-libraries")
        answer = subprocess.run([own / "bin/ontime" if word == ONTIME else word for word in self.command(scenario, "--deploy")],
                                capture_output=True, text=True, env=self.environment, timeout=300)
        self.assertEqual(answer.returncode, 0, answer.stderr)
        self.assertGreater(self.report()[0]["sent"], 0)
        self.assertEqual(self.report()[0]["lost"], 0)

    def test_deploy_works_with_busybox(self):
        if not shutil.which("busybox"):
            self.skipTest("no busybox: sudo apt install busybox-static")
        scenario = self.scenario_with_another("busybox", '#!/bin/sh\nexec /usr/bin/busybox "${0##*/}" "$@"\n')
        for name in ("chmod", "dd", "head", "mkdir", "mktemp", "rm", "sed", "sh", "sort", "uname", "wc"):
            (self.own / "far-bin" / name).symlink_to("busybox")
        answer = self.run_ontime(scenario, "--deploy")
        self.assertEqual(answer.returncode, 0, answer.stderr)

    def test_deploy_where_libraries_are_missing_names_their_packages(self):
        there = self.scenario_with_another("ldd", "#!/bin/sh\necho '\tlibfmt.so.9 => not found'\n")
        answer = self.run_ontime(there, "--deploy")
        self.assertEqual(answer.returncode, 3, answer.stderr)
        self.assertRegex(answer.stderr, r"libraries are missing .*libfmt.so.9.*sudo apt install libfmt9$")

    def test_deploy_where_there_is_nothing_to_deploy_to(self):
        path = self.scenario()
        path.write_text(path.read_text().replace("ssh: robot, ", ""))
        answer = self.run_ontime(path, "--deploy")
        self.assertEqual(answer.returncode, 2, answer.stderr)
        self.assertIn("--deploy copies ontime to ssh hosts", answer.stderr)

    # --- what can be wrong ---

    def refused(self, words, **scenario):
        answer = self.run_ontime(self.scenario(**scenario))
        self.assertEqual(answer.returncode, 3, answer.stderr)
        self.assertRegex(answer.stderr, words)
        self.assertFalse(os.path.exists(self.results), "nothing was run")

    def test_unknown_host_key(self):
        (self.own / "known_hosts").write_text("")
        self.refused("does not know the host key of robot.*: ssh robot")
        self.assertEqual((self.own / "known_hosts").read_text(), "")

    def test_changed_host_key(self):
        other = (self.folder / "other_key.pub").read_text()
        (self.own / "known_hosts").write_text(f"[198.18.2.2]:{PORT} {other}")
        self.refused("host key of robot .*ssh-keygen -R")

    def test_key_that_is_not_let_in(self):
        self.configure(IdentityFile=self.folder / "other_key")
        self.refused("robot .*ssh-copy-id robot")

    def test_nobody_listens(self):
        self.configure(Port=PORT + 1)
        self.refused("robot cannot be reached: .*Connection refused")

    def test_name_that_nobody_knows(self):
        self.configure(HostName="no-such-robot.invalid")
        self.refused("robot cannot be reached: .*Could not resolve")

    def test_no_ssh_client(self):
        (self.own / "bin" / "ssh").unlink()
        for name in ("sh", "cat", "rm", "ip"):
            (self.own / "bin" / name).symlink_to(shutil.which(name))
        self.environment["PATH"] = str(self.own / "bin")
        self.refused("no ssh client .*sudo apt install openssh-client")

    def test_ontime_is_missing_there(self):
        self.refused("/no/such/ontime not found on robot.*--deploy", program="/no/such/ontime")

    def program_there(self, script):
        program = self.own / "ontime-there"
        program.write_text(script)
        program.chmod(0o755)
        return program

    def test_other_version_there(self):
        hello = b"\xa3" + b"".join(bytes([0x60 + len(word)]) + word for word in
                                   (b"event", b"hello", b"version", b"9.9.9", b"samples", b""))
        unknown = b"\xa1\x65event\x63new"  # comes with it, in one read
        (self.own / "hello").write_bytes(b"".join(len(one).to_bytes(4, "little") + bytes(4) + one for one in (hello, unknown)))
        program = self.program_there(f"#!/bin/sh\ncat {self.own}/hello -\n")
        self.refused("is ontime 9.9.9, this is .*install the same", program=program)

    def test_shell_that_says_something_of_its_own(self):
        program = self.program_there(f"#!/bin/sh\necho Welcome to this robot\nexec {ONTIME} \"$@\"\n")
        self.refused('from robot: "Welcome to this robot"', program=program)

    # --- lost in the middle ---

    def test_connection_that_breaks(self):
        process = self.loaded_run()
        for line in self.connections():
            self.assertIn(f":{PORT}", line)
        for pid in self.sessions():
            os.kill(pid, signal.SIGKILL)
        self.ended(process, 3, "the connection to robot was lost")
        self.kept_run("the connection to robot was lost")

    def sessions(self):
        """sshd's processes that hold a connection: those below the one that listens."""
        listens = int((self.folder / "sshd.pid").read_text())
        children = {}
        for entry in pathlib.Path("/proc").glob("[0-9]*/stat"):
            with contextlib.suppress(OSError):
                pid, rest = entry.parent.name, entry.read_text().rsplit(")", 1)[1].split()
                children.setdefault(int(rest[1]), []).append(int(pid))
        return children.get(listens, [])

    def test_link_of_ssh_that_goes_silent(self):
        process = self.loaded_run()
        run("ip", "-n", NEAR, "link", "set", "ssh-near", "down")
        try:
            self.assertTrue(eventually(lambda: not self.far("/ontime") and not os.listdir(self.far_temporary)), self.what_is_left())
            self.ended(process, 3, "was silent for 10 s|the connection to robot was lost")
        finally:
            run("ip", "-n", NEAR, "link", "set", "ssh-near", "up")
            run("ip", "-n", NEAR, "address", "replace", "198.18.2.1/30", "dev", "ssh-near")
            for pid in self.sessions():  # which do not know yet
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)
        self.kept_run("was silent for 10 s|the connection to robot was lost")

    def test_coordinator_that_is_killed(self):
        process = self.loaded_run()
        process.kill()
        process.communicate(timeout=180)

    def test_service_that_is_stopped_keeps_its_run(self):
        process = self.loaded_run()
        for pid in self.near():
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGTERM)
        process.communicate(timeout=180)
        self.assertEqual(process.returncode, 130)
        self.assertIsNone(self.report()[0]["error"])
        self.assertEqual(set(self.report()[0]["hosts"]), {"controller", "component"})

    def test_interrupted_once_it_stops_and_reports(self):
        process = self.loaded_run()
        process.send_signal(signal.SIGINT)
        self.ended(process, 130, "")
        self.assertIsNone(self.report()[0]["error"])


if __name__ == "__main__":
    unittest.main(verbosity=2)
