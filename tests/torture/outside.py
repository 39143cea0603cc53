# SPDX-License-Identifier: Apache-2.0
"""What ontime did to a machine and what it left, seen by other means than its own."""

import contextlib
import json
import os
import pathlib
import shutil
import sqlite3
import subprocess

HERE = pathlib.Path(__file__).resolve().parent.parent.parent
ONTIME = os.environ.get("ONTIME", str(HERE / "build/release/bin/ontime"))


def output(*command):
    return subprocess.run(command, capture_output=True, text=True).stdout


def processes_of(folder):
    """Living processes that were started with this word in their environment: those of one repetition, as {pid: command}."""
    found = {}
    for entry in pathlib.Path("/proc").iterdir():
        with contextlib.suppress(OSError, IndexError, ValueError):
            pid = int(entry.name)
            if f"ONTIME_TEST={folder}\0".encode() not in (entry / "environ").read_bytes():
                continue
            if (entry / "stat").read_text().rsplit(")", 1)[1].split()[0] != "Z":
                found[pid] = (entry / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace").strip()
    return found


def state_of_machine():
    """What a run may change, as others see it: by the kernel's files, chrt's system call, ip, tc and nft."""
    state = {}
    for pattern in ("kernel/sched_rt_*_us", "kernel/timer_migration", "net/core/*mem_*", "net/core/busy_*"):
        for file in pathlib.Path("/proc/sys").glob(pattern):
            state[str(file)] = file.read_text().strip()
    for stat in pathlib.Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            name, rest = stat.read_text().split("(", 1)[1].rsplit(")", 1)
            pid, parent = int(stat.parent.name), int(rest.split()[1])
            if parent == 2 and not name.startswith("kworker"):
                policy, priority = os.sched_getscheduler(pid), os.sched_getparam(pid).sched_priority
                state[f"thread {pid} {name}"] = f"{policy}:{priority} on {sorted(os.sched_getaffinity(pid))}"
    for governor in pathlib.Path("/sys/devices/system/cpu").glob("cpu*/cpufreq/scaling_governor"):
        state[str(governor)] = governor.read_text().strip()
    state["interfaces"] = sorted(entry["ifname"] for entry in json.loads(output("ip", "-j", "link")))
    state["namespaces"] = sorted(output("ip", "netns", "list").split())
    state["qdiscs"] = output("tc", "qdisc", "show")
    state["rules"] = output("nft", "list", "ruleset") if shutil.which("nft") else ""
    return state


def difference(before, after):
    return [f"{what}: {before.get(what)!r} became {after.get(what)!r}"
            for what in sorted(before.keys() | after.keys()) if before.get(what) != after.get(what)
            # Threads of the kernel come and go with what others do.
            and not (what.startswith("thread ") and (what not in before or what not in after))]


def rows(file, query, *values):
    try:
        with contextlib.closing(sqlite3.connect(f"file:{file}?mode=ro", uri=True, timeout=5)) as database:
            return database.execute(query, values).fetchall()
    except sqlite3.Error:
        return []


class Broken(Exception):
    """A law that did not hold."""


def check(holds, law):
    if not holds:
        raise Broken(law)
