# SPDX-License-Identifier: Apache-2.0
"""The two ends of a run between two network namespaces, as far as this script started them; or two nodes of a robot."""
import contextlib
import os
import pathlib
import re
import subprocess

INTERFACE = {"controller": "to-component", "component": "to-controller"}
OTHER = {"controller": "component", "component": "controller", "publisher": "taker", "taker": "publisher"}
NODES = {}  # the process of a publisher and of a taker
KTHREADD = 2  # whose children the kernel's threads are
HOGGED = 1  # the CPU that is taken from an end; its peer has CPU 0


def inside(end, *command, **options):
    return subprocess.run(["ip", "netns", "exec", f"ontime-{end}", *command], check=True, capture_output=True, text=True,
                          **options)


def parent_and_name(pid):
    """(0, "") where there is no such process any more."""
    try:
        name, _, rest = pathlib.Path(f"/proc/{pid}/stat").read_text().partition("(")[2].rpartition(")")
    except OSError:
        return 0, ""
    return int(rest.split()[1]), name


def is_ours(pid):
    """Whether this script started it, itself or by what it started."""
    while pid > 1 and pid != os.getpid():
        pid, _ = parent_and_name(pid)
    return pid == os.getpid()


def pids(end):
    if end in NODES:
        return [NODES[end]]
    inside = subprocess.run(["ip", "netns", "pids", f"ontime-{end}"], capture_output=True, text=True).stdout.split()
    return [int(pid) for pid in inside if is_ours(int(pid))]


def napi_threads(interface):
    """The kernel's, by their names, which older ones cut."""
    every = [(int(folder.name), *parent_and_name(folder.name)) for folder in pathlib.Path("/proc").glob("[0-9]*")]
    return [pid for pid, parent, name in every
            if parent == KTHREADD and (re.fullmatch(rf"napi/{re.escape(interface)}-\d+", name) or name == f"napi/{interface}"[:15])]


def threads(end):
    found = []
    for pid in pids(end):
        with contextlib.suppress(FileNotFoundError):  # it has ended
            found += [int(task.name) for task in pathlib.Path(f"/proc/{pid}/task").iterdir()]
    return found


def pin(end):
    """The end to the CPU that is hogged, and the other one apart from it."""
    for where, cpu in ((end, HOGGED), (OTHER[end], 0)):
        for thread in threads(where):
            with contextlib.suppress(ProcessLookupError):
                os.sched_setaffinity(thread, {cpu})


