# SPDX-License-Identifier: Apache-2.0
"""Kills a search with SIGKILL at random moments, and looks whether the next start restores the machine and goes on."""
import contextlib
import os
import pathlib
import random
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time

from program import ONTIME, eventually, processes_with

SCENARIO = """
hosts: namespaces
defaults: {transport: udp, period: 2 ms, duration: 300 ms, kernel: {gro: on, threaded-napi: on, busy-poll: 50}}
runs: [{id: one}]
"""
NEVER_MET = "p50 < 1 us"  # so that the search goes on until every setting was tried
LONGEST_LIFE_S = 4.0      # of a search before its kill: two or three runs


def machine():
    """What a search may change of this machine, as the kernel has it."""
    state = {}
    for name in ("net/core/rmem_max", "net/core/rmem_default", "net/core/busy_poll", "kernel/sched_rt_runtime_us",
                 "kernel/timer_migration"):
        state[name] = (pathlib.Path("/proc/sys") / name).read_text()
    for entry in pathlib.Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            name = (entry / "comm").read_text().strip()
            if name.startswith(("ksoftirqd/", "irq/")):
                pid = int(entry.name)
                state[name] = (os.sched_getscheduler(pid), os.sched_getparam(pid).sched_priority, sorted(os.sched_getaffinity(pid)))
    state["interfaces"] = sorted(os.listdir("/sys/class/net"))
    for folder in ("/run/netns", "/run/ontime", "/sys/kernel/tracing/instances"):
        found = os.listdir(folder) if os.path.isdir(folder) else []
        state[folder] = sorted(name for name in found if name not in ("told",))
    return state


def runs_of(results):
    """Numbers, from 1, of the search's own runs in the file, in their order."""
    if not results.exists():
        return []
    # To write: SQLite then rolls back what a kill cut off.
    with contextlib.closing(sqlite3.connect(f"file:{results}?mode=rw", uri=True)) as database:
        try:
            rows = database.execute("SELECT text FROM note WHERE kind = 'search' ORDER BY run, number").fetchall()
        except sqlite3.OperationalError as error:
            if "no such table" not in str(error):
                raise
            return []  # killed before it had tables
    return [int(text.split(" run ")[1].split(":")[0]) for (text,) in rows]


class Search:
    """One search, started again and again on one results file."""

    def __init__(self, folder, seed):
        self.folder, self.random, self.results = folder, random.Random(seed), folder / "s.ontime"
        self.marker = f"ONTIME_SEARCH_KILLS={os.getpid()}.{seed}"
        (folder / "s.yaml").write_text(SCENARIO)
        self.before = machine()
        self.ends = self.restored = 0  # searches that ended by themselves; kills after which the next start had to restore

    def start(self):
        name, value = self.marker.split("=")
        return subprocess.Popen([ONTIME, "tune", "search", "./s.yaml", "--goal", NEVER_MET, "--results", self.results.name, "--resume",
                                 "--format", "json"], cwd=self.folder, env={**os.environ, name: value},
                                stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    def kill_once(self):
        """Returns what is wrong after it; an empty list: nothing. After a search that ended by itself a new file begins."""
        search = self.start()
        time.sleep(self.random.uniform(0.05, LONGEST_LIFE_S))
        if search.poll() is not None:
            told = search.communicate()[1]
            if search.returncode != 1:
                return [f"it ended with exit code {search.returncode}: {told[-500:]}"]
            self.ends += 1
            self.results.unlink()
            return self.kill_once()
        search.kill()
        if self.random.random() < 0.5:  # its keeper and agents too: no process is left that could restore
            for pid in processes_with(self.marker):
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)
        search.communicate()
        return self.what_is_wrong()

    def what_is_wrong(self):
        if not eventually(lambda: not processes_with(self.marker)):
            return [f"left running: {processes_with(self.marker)}"]
        reverted = subprocess.run([ONTIME, "tune", "revert"], capture_output=True, text=True, check=False)  # the next start
        self.restored += bool(reverted.stdout)
        wrong = [] if reverted.returncode == 0 else ["revert: " + reverted.stderr]
        after = machine()
        wrong += [f"{name}: {self.before.get(name)} became {after.get(name)}" for name in {*self.before, *after}
                  if self.before.get(name) != after.get(name)]
        numbers = runs_of(self.results)
        if numbers != list(range(1, len(numbers) + 1)):
            wrong.append(f"the runs in the results are {numbers}")
        return wrong


def main():
    kills, seed = (int(word) for word in sys.argv[1:])
    with tempfile.TemporaryDirectory(prefix="ontime-test-") as folder:
        search = Search(pathlib.Path(folder), seed)
        broken = 0
        for number in range(1, kills + 1):
            wrong = search.kill_once()
            broken += bool(wrong)
            for line in wrong:
                print(f"kill {number}: {line}", flush=True)
        print(f"{kills} kills (seed {seed}): after {kills - broken} the machine was as before and the results in order. "
              f"After {search.restored} the next start restored settings. {search.ends} searches came to their end; "
              f"the last has {len(runs_of(search.results))} runs.", flush=True)
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
