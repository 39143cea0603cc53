# SPDX-License-Identifier: Apache-2.0
"""The real program, as tests start it, and what they see of it and of this machine. ONTIME names the program."""

import contextlib
import json
import os
import pathlib
import pty
import shutil
import signal
import sqlite3
import subprocess
import tempfile
import termios
import time
import unittest

# A shell's background command ignores SIGINT, and so would all that is started here: it would wait for what ends by it.
signal.signal(signal.SIGINT, signal.default_int_handler)
ONTIME = os.environ["ONTIME"]
TRANSPORTS = os.environ.get("ONTIME_TEST_TRANSPORTS", "udp,cyclonedds,fastdds").split(",")

SCENARIO = """
hosts: namespaces
defaults: {transport: [%s], period: 5 ms, duration: %s}
runs:
  - id: idle
  - id: loaded
    realtime: on
    load:
      controller: {cpu: 1, vm: 1, io: 1, hdd: 1, vm-bytes: 16 MiB, hdd-bytes: 16 MiB}
      component: {cpu: 1}
"""


def processes_with(word):
    """Living processes, as {pid: command line}, that were started with this text in their environment: a test's own,
    and nobody else's."""
    found = {}
    for entry in pathlib.Path("/proc").iterdir():
        if not entry.name.isdigit():
            continue
        try:
            environment = (entry / "environ").read_bytes().decode(errors="replace")
            command = (entry / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
            state = (entry / "stat").read_text().rsplit(")", 1)[1].split()[0]
        except (OSError, IndexError):
            continue
        if word in environment and state != "Z":
            found[int(entry.name)] = command
    return found


def eventually(true, seconds=120):
    """Whether it comes true. The limit is there for what hangs: on a busy machine all takes longer."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if true():
            return True
        time.sleep(0.05)
    return true()


def on_a_terminal(command, columns=80, when=lambda shown: False, then=lambda process: None, **options):
    """What a terminal got of a command, as bytes, and its process. The first time that `when` is true of what was shown,
    `then` is called. A read may end within a character."""
    ours, its = pty.openpty()
    termios.tcsetwinsize(its, (24, columns))
    process = subprocess.Popen(command, **{"stdin": its, "stdout": its, "stderr": its, **options})
    os.close(its)
    shown, called = b"", False
    with contextlib.suppress(OSError):  # the other side was closed
        while part := os.read(ours, 4096):
            shown += part
            if not called and when(shown):
                called = True
                then(process)
    os.close(ours)
    return shown, process


def pages_moved():
    """By the kernel, on this machine until now. A locked page, too, faults once when it is touched after that."""
    return int(dict(line.split() for line in pathlib.Path("/proc/vmstat").read_text().splitlines())["pgmigrate_success"])


def kill_at_once(*pids):
    """None acts on the end of another: on a busy machine one that outlives the others by a moment takes everything back."""
    for number in (signal.SIGSTOP, signal.SIGKILL):
        for pid in pids:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, number)


def sample_count(results, run=None):
    """Of all runs, or of the one with this number."""
    if not os.path.exists(results):
        return 0
    try:
        with contextlib.closing(sqlite3.connect(f"file:{results}?mode=ro", uri=True)) as database:
            return database.execute("SELECT count(*) FROM sample WHERE run = ifnull(?, run)", (run,)).fetchone()[0]
    except sqlite3.Error:
        return 0


def trace_instances():
    """Of the kernel, by a mount that nothing else sees."""
    return subprocess.run(["unshare", "-m", "sh", "-c", "mount -t tracefs none /mnt && ls /mnt/instances"],
                          capture_output=True, text=True, check=True, timeout=60).stdout.split()


def namespaces():
    return [line.split()[0] for line in
            subprocess.run(["ip", "netns", "list"], capture_output=True, text=True, check=True).stdout.splitlines()]


OUR_NAMESPACES = {"ontime-controller", "ontime-component"}


@unittest.skipUnless(os.geteuid() == 0, "network namespaces need root")
class Program(unittest.TestCase):
    """A test after which nothing of the program is left."""

    def setUp(self):
        self.folder = tempfile.mkdtemp(prefix="ontime-test-")
        self.addCleanup(shutil.rmtree, self.folder)
        self.results = os.path.join(self.folder, "results.ontime")
        # What load and agents of this test are known by.
        self.temporary = os.path.join(self.folder, "tmp")
        os.mkdir(self.temporary)
        self.environment = dict(os.environ, TMPDIR=self.temporary, ONTIME_TEST=self.temporary)

    def tearDown(self):
        self.assertTrue(eventually(self.nothing_left), self.what_is_left())

    def own(self, word):
        return [pid for pid, command in processes_with("ONTIME_TEST=" + self.temporary).items() if word in command]

    def agents(self):
        return [*self.own("/ontime agent"), *self.own("/ontime keeper")]

    def keepers(self):
        return self.own("/ontime keeper")

    def load(self):
        return self.own("stress-ng")

    def what_is_left(self):
        return (f"agents and keepers {self.agents()}, load {self.load()}, traffic {self.traffic()}, namespaces {namespaces()}, "
                f"files {os.listdir(self.temporary)}")

    def nothing_left(self):
        return not (self.agents() or self.load() or self.traffic() or OUR_NAMESPACES & set(namespaces()) or os.listdir(self.temporary))

    def scenario(self, duration="1 s", text=SCENARIO, transports=None):
        path = os.path.join(self.folder, "scenario.yaml")
        pathlib.Path(path).write_text(text % (", ".join(transports or TRANSPORTS), duration))
        return path

    def run_ontime(self, *arguments, **options):
        return subprocess.run([ONTIME, *arguments], capture_output=True, text=True, env=self.environment,
                              timeout=300, **options)

    def start_ontime(self, *arguments):
        return self.start([ONTIME, *arguments])

    def start(self, command):
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                                   env=self.environment)
        self.addCleanup(lambda: (process.kill(), process.communicate()))  # of a test that failed
        return process

    def report(self):
        answer = self.run_ontime("report", self.results, "--format", "json")
        self.assertEqual(answer.returncode, 0, answer.stderr)
        return json.loads(answer.stdout)["runs"]

    def started(self, process, condition):
        self.assertTrue(eventually(condition), process.poll())

    def traffic(self):
        return self.own("iperf3")

    def samples_recorded(self):
        return sample_count(self.results)
