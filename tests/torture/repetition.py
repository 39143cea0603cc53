# SPDX-License-Identifier: Apache-2.0
"""One run that is harmed, and what must hold after it, whatever was done to it."""

import contextlib
import json
import os
import pathlib
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time

from outside import Broken, HERE, ONTIME, check, difference, output, processes_of, rows, state_of_machine

sys.path.insert(0, str(HERE / "tests/system"))
os.environ.setdefault("ONTIME", ONTIME)
for name in "listen_node", "listen_rmw_node", "listen_fastdds_node":
    os.environ.setdefault(name.upper(), str(pathlib.Path(ONTIME).parent / name))
import robot  # noqa: E402
import sshd  # noqa: E402
from program import trace_instances  # noqa: E402

TIMER_MIGRATION = pathlib.Path("/proc/sys/kernel/timer_migration")


def join_namespaces(stack):
    """Two namespaces with a link between them, until the stack ends: {name: address}."""
    ends = {"near": "198.18.1.1", "far": "198.18.1.2"}
    for name in ends:
        subprocess.run(["ip", "netns", "add", name], check=True)
        stack.callback(subprocess.run, ["ip", "netns", "del", name], check=False)
    subprocess.run(["ip", "-n", "near", "link", "add", "to-far", "type", "veth", "peer", "to-near", "netns", "far"],
                   check=True)
    for (name, address), other in zip(ends.items(), reversed(ends)):
        subprocess.run(["ip", "-n", name, "address", "add", f"{address}/30", "dev", f"to-{other}"], check=True)
        subprocess.run(["ip", "-n", name, "link", "set", f"to-{other}", "up"], check=True)
    return ends


class Repetition:
    """Subclasses say what is started; all else is the same for all."""

    def __init__(self, seed, harm):
        self.random = random.Random(seed)
        self.harm = harm
        self.folder = pathlib.Path(tempfile.mkdtemp(prefix="ontime-torture-"))
        self.temporary, self.disk = self.folder / "tmp", self.folder / "disk"
        self.slow = self.folder / "slow"  # programs that take their time, once there is a file `slow`
        for folder in (self.temporary, self.disk, self.slow):
            folder.mkdir()
        for name in ("nft", "tc", "ip"):
            program = self.slow / name
            program.write_text(f'#!/bin/sh\n[ ! -e {self.slow}/slow ] || sleep 0.8\nexec {shutil.which(name)} "$@"\n')
            program.chmod(0o755)
        self.results = self.disk / "results.ontime"
        self.environment = dict(os.environ, TMPDIR=str(self.temporary), ONTIME_TEST=str(self.temporary))
        self.transport = self.random.choice(os.environ.get("ONTIME_TEST_TRANSPORTS", "udp,cyclonedds,fastdds").split(","))
        self.duration = "1 s" if harm is None else "1 h"
        self.everybody_is_gone = False
        self.harmed_ns = None
        self.missing_s = None

    def command(self):
        """Of who writes the results."""
        raise NotImplementedError

    def surroundings(self):
        """What is there before it starts, and is taken away after all has been looked at."""
        return contextlib.nullcontext()

    def finish(self):
        """Once who writes the results has left."""

    # For the harms.
    def pids(self, word):
        return [pid for pid, command in processes_of(self.temporary).items() if word in command]

    def moment(self):
        """From here on nothing that ontime does is sure to be kept."""
        if self.harmed_ns is None:
            self.harmed_ns = time.monotonic_ns()

    def interrupt(self):
        with contextlib.suppress(ProcessLookupError):
            self.process.send_signal(signal.SIGINT)

    def wait(self, seconds):
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.process.wait(seconds)

    # The course of it.
    def start(self, *command):
        return subprocess.Popen(command, stdout=self.said, stderr=self.said, env=self.environment)

    def scenario(self, text):
        file = self.folder / "scenario.yaml"
        file.write_text(text)
        return ONTIME, "run", str(file), "--results", str(self.results)

    def samples(self):
        found = rows(self.results, "SELECT count(*) FROM sample")
        return found[0][0] if found else 0

    def run(self):
        subprocess.run(["mount", "-t", "tmpfs", "-o", "size=8m", "tmpfs", str(self.disk)], check=True)
        try:
            with open(self.folder / "said", "w+b") as self.said, self.surroundings():
                return self.harmed()
        finally:
            subprocess.run(["umount", "-l", str(self.disk)], check=False)
            shutil.rmtree(self.folder, ignore_errors=True)

    def harmed(self):
        before = state_of_machine()
        try:
            self.process = self.start(*self.command())
            end = time.monotonic() + 120
            while self.samples() == 0 and self.process.poll() is None and time.monotonic() < end:
                time.sleep(0.02)
            check(self.samples() > 0, "nothing was measured within two minutes: " + self.words())
            if self.harm is not None:
                time.sleep(self.random.uniform(0, 1))
                self.harm(self)
            try:
                self.process.wait(120)
            except subprocess.TimeoutExpired:
                raise Broken("it did not end within two minutes: " + self.words()) from None
            self.finish()
            self.check_left(before)
            self.check_results()
            return self.process.returncode
        except BaseException:  # the next repetition begins as this one did
            for pid in processes_of(self.temporary):
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)
            self.give_back()
            raise

    def output(self):
        """All that the program printed."""
        return pathlib.Path(self.said.name).read_text(errors="replace")

    def words(self):
        """The last of it, for people."""
        return self.output()[-600:]

    def left(self, before):
        left = [f"process {pid} {command}" for pid, command in processes_of(self.temporary).items()]
        left += [f"file {name}" for name in os.listdir(self.temporary)]
        left += [f"journal {name}" for name in pathlib.Path("/run/ontime").glob("*.journal")]
        return left + difference(before, state_of_machine())

    def give_back(self):
        """As the next run does before it begins."""
        (self.folder / "next.yaml").write_text("hosts: loopback\nruns: [{id: next, transport: udp, duration: 50 ms}]\n")
        command = [ONTIME, "run", str(self.folder / "next.yaml"), "--results", str(self.folder / "next.ontime")]
        subprocess.run(command, capture_output=True, env=self.environment, check=False)

    def check_left(self, before):
        if self.everybody_is_gone:
            self.give_back()
        end = time.monotonic() + 60
        while (left := self.left(before)) and time.monotonic() < end:
            time.sleep(0.1)
        check(not left, "left: " + "; ".join(left))

    def check_results(self):
        check(rows(self.results, "PRAGMA integrity_check") == [("ok",)], "the results file is damaged")
        answer = subprocess.run([ONTIME, "report", str(self.results), "--format", "json"], capture_output=True, text=True,
                                env=self.environment)
        check(answer.returncode in (0, 1), "its report fails: " + answer.stderr)
        (run,) = json.loads(answer.stdout)["runs"]
        check(run["sent"] == run["on_time"] + run["late"] + run["lost"], "the ledger does not add up")
        (numbers,) = rows(self.results, "SELECT count(*), min(message), max(message) FROM sample")
        check(numbers[0] == numbers[2] + 1 and numbers[1] == 0, f"there is a gap in the samples: {numbers}")
        if self.harmed_ns is None:
            return
        ((start_ns,),) = rows(self.results, "SELECT start_ns FROM run")
        ((last_ns,),) = rows(self.results, "SELECT max(intended_ns + due_after_ns) FROM sample")
        self.missing_s = (self.harmed_ns - start_ns - last_ns) / 1e9


class BetweenNamespaces(Repetition):
    """Settings of the kernel, and beside them load, traffic and a link that loses, each in two of three repetitions."""

    always = ()  # of these

    BESIDE = {
        "load": "{controller: {vm: 1, vm-bytes: 16 MiB, hdd: 1, hdd-bytes: 4 MiB}, component: {cpu: 1}}",
        "traffic": "{rate: 5 Mbit/s}",
        "link": "{loss: 1 %}",
    }

    def command(self):
        timers = "timer-migration: off, " if TIMER_MIGRATION.exists() else ""
        beside = [f"    {key}: {text}\n" for key, text in self.BESIDE.items()
                  if self.random.random() < 2 / 3 or key in self.always]
        return self.scenario(f"""
hosts: namespaces
defaults: {{transport: {self.transport}, period: 5 ms, timeout: 100 ms, duration: {self.duration}}}
runs:
  - id: tortured
    realtime: on
    kernel: {{{timers}gro: on, rps: 0}}
{"".join(beside)}""")


class WithLoad(BetweenNamespaces):
    always = ("load",)


class WithTraffic(BetweenNamespaces):
    always = ("traffic",)


class WithSlowPrograms(BetweenNamespaces):
    always = ("traffic", "link")  # which call them most

    def __init__(self, seed, harm):
        super().__init__(seed, harm)
        self.environment["PATH"] = f"{self.slow}:{os.environ['PATH']}"


class OverInterfacesOfItsOwn(Repetition):
    """Between two namespaces that were there before, and whose interfaces may be called otherwise meanwhile."""

    def kept(self):
        """What a run sets of an interface, whatever it is called by then."""
        names = [entry["ifname"] for entry in json.loads(output("ip", "-n", "near", "-j", "link") or "[]")]
        return {option: output("ip", "netns", "exec", "near", "sh", "-c",
                               f"cat /sys/class/net/{name}/queues/rx-0/rps_cpus; ethtool -k {name} | grep ^generic-receive")
                for name in names if name != "lo" for option in ["rps and gro"]}

    @contextlib.contextmanager
    def surroundings(self):
        with contextlib.ExitStack() as stack:
            join_namespaces(stack)
            self.before = self.kept()
            yield

    def left(self, before):
        now = self.kept()
        return super().left(before) + ([] if now == self.before else [f"interface: {self.before} became {now}"])

    def command(self):
        return self.scenario(f"""
hosts:
  controller: {{command-prefix: [ip, netns, exec, near], interface: to-far, address: 198.18.1.1}}
  component: {{command-prefix: [ip, netns, exec, far], interface: to-near, address: 198.18.1.2}}
defaults: {{transport: {self.transport}, period: 5 ms, timeout: 100 ms, duration: {self.duration}}}
runs:
  - id: tortured
    kernel: {{gro: on, rps: 0}}
""")


class ByHand(Repetition):
    """`ontime ping` and `ontime pong`, two programs that were started apart."""

    def command(self):
        both = ("--transport", self.transport, "--interface", "lo", "--domain", "77")
        self.pong = self.start(ONTIME, "pong", *both)
        return (ONTIME, "ping", *both, "--peer", "127.0.0.1", "--period", "5 ms", "--timeout", "100 ms",
                "--duration", self.duration, "--results", str(self.results))

    def finish(self):
        if self.pong.poll() is None:
            self.pong.send_signal(signal.SIGINT)
        try:
            code = self.pong.wait(30)
        except subprocess.TimeoutExpired:
            raise Broken("pong did not leave: " + self.words()) from None
        check(code in (130, -signal.SIGKILL), f"pong left with {code}: " + self.words())


class BySsh(Repetition):
    """The component is reached through an sshd of our own, over the link under test."""

    @contextlib.contextmanager
    def surroundings(self):
        with contextlib.ExitStack() as stack:
            ends = join_namespaces(stack)
            sshd.make_keys(self.folder)
            self.sshd = stack.enter_context(sshd.serving(self.folder, "far", self.temporary))
            path = sshd.make_client(self.folder, self.folder, [ends["far"]])
            sshd.configure_client(self.folder, self.folder, HostName=ends["far"])
            self.environment["PATH"] = f"{path}:{os.environ['PATH']}"
            yield

    def command(self):
        return ("ip", "netns", "exec", "near", *self.scenario(f"""
hosts:
  controller: {{interface: to-far, address: 198.18.1.1}}
  component: {{ssh: robot, program: {ONTIME}, interface: to-near, address: 198.18.1.2}}
defaults: {{transport: {self.transport}, period: 5 ms, timeout: 100 ms, duration: {self.duration}}}
runs:
  - id: tortured
    load: {{component: {{cpu: 1, hdd: 1, hdd-bytes: 4 MiB}}}}
"""))


class Deployed(BySsh):
    """As by ssh, with a program that is brought there for the time of the run."""

    def command(self):
        command = super().command()
        scenario = self.folder / "scenario.yaml"
        scenario.write_text(scenario.read_text().replace(f"program: {ONTIME}, ", ""))
        return (*command, "--deploy")


class Listening(Repetition):
    """`ontime listen` beside a publisher and a taker that know nothing of it."""

    @contextlib.contextmanager
    def surroundings(self):
        words = {"publisher": ("publish", "rt/cmd_vel", "10000000", "1000"), "taker": ("take", "rt/cmd_vel", "1000", "0")}
        self.nodes = {name: subprocess.Popen([robot.NODE, *words[name], self.folder / name], env=robot.ENVIRONMENT,
                                             stdout=self.said, stderr=self.said) for name in words}
        try:
            robot.begin(self.nodes["publisher"])
            yield
            for name, node in self.nodes.items():
                if node.poll() is None:
                    node.terminate()
                check(node.wait(30) in (0, -signal.SIGKILL), f"the {name} ended with {node.returncode}")
        finally:
            for node in self.nodes.values():
                node.kill()
                node.wait()

    def command(self):
        return ONTIME, "listen", "/cmd_vel", "--deadline", "50ms", "--results", str(self.results), "--for", self.duration

    def left(self, before):
        left = [f"changed code in the {name}" for name, node in self.nodes.items()
                if node.poll() is None and robot.changed_code(node.pid)]
        return super().left(before) + left + [f"trace {name}" for name in trace_instances() if "ontime" in name]

    def check_results(self):
        check(rows(self.results, "PRAGMA integrity_check") == [("ok",)], "the results file is damaged")
        answer = subprocess.run([ONTIME, "report", str(self.results)], capture_output=True, text=True, env=self.environment)
        check(answer.returncode in (0, 1), "its report fails: " + answer.stderr)
        for node in self.nodes.values():
            check(node.poll() in (None, -signal.SIGKILL), "a node ended")
