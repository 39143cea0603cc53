# SPDX-License-Identifier: Apache-2.0
"""The harms. Each is done to a repetition (repetition.py), and sees to it that it ends."""

import contextlib
import json
import os
import pathlib
import signal
import subprocess
import time

from outside import check, output, processes_of


def kill(word, it_ends=False):
    """One process of it that has this word in its command; whether the measuring ends by that."""
    def harm(repetition):
        pids = repetition.pids(word)
        check(pids, f"there is no process '{word}' to be harmed")
        if it_ends:
            repetition.moment()
        with contextlib.suppress(ProcessLookupError):
            os.kill(repetition.random.choice(pids), signal.SIGKILL)
        if not it_ends:
            time.sleep(repetition.random.uniform(0, 1))
            repetition.interrupt()
    return harm


def kill_sshd(repetition):
    """The one who serves our connection, not who listens for others."""
    listens = repetition.sshd.pid
    with open(f"/proc/{listens}/task/{listens}/children") as file:
        children = file.read().split()
    check(children, "no sshd serves our connection")
    repetition.moment()
    os.kill(int(children[0]), signal.SIGKILL)


def kill_all(repetition):
    repetition.moment()
    for pid in processes_of(repetition.temporary):
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
    repetition.everybody_is_gone = True


def terminate_all(repetition):
    repetition.moment()
    for pid in processes_of(repetition.temporary):
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGTERM)


def stop_for_a_while(word):
    def harm(repetition):
        pids = repetition.pids(word)
        check(pids, f"there is no process '{word}' to be harmed")
        pid = repetition.random.choice(pids)
        os.kill(pid, signal.SIGSTOP)
        time.sleep(repetition.random.uniform(0.05, 3))
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGCONT)
        repetition.interrupt()
    return harm


def cut_link(repetition):
    host = repetition.random.choice(["ontime-controller", "ontime-component"])
    links = [entry["ifname"] for entry in json.loads(output("ip", "-n", host, "-j", "link") or "[]")]
    for name in links:
        if name != "lo":
            subprocess.run(["ip", "-n", host, "link", "set", name, "down"], check=False)
            time.sleep(repetition.random.uniform(0.01, 0.5))
            subprocess.run(["ip", "-n", host, "link", "set", name, "up"], check=False)
    time.sleep(repetition.random.uniform(0, 0.5))
    repetition.interrupt()


def fill_disk(repetition):
    with contextlib.suppress(OSError), open(repetition.disk / "filler", "wb") as filler:
        while True:
            filler.write(b"\0" * 65536)
            filler.flush()
    # A run that goes on for as long finds out; one that has ended by then kept what it had.
    repetition.wait(6)
    (repetition.disk / "filler").unlink()
    repetition.interrupt()


def interrupt(repetition):
    repetition.moment()
    repetition.interrupt()


def interrupt_twice_at_any_moment(repetition):
    """Also while it gives back already."""
    repetition.moment()
    repetition.interrupt()
    time.sleep(repetition.random.uniform(0, 4))
    repetition.interrupt()


def keeper_slow_to_restore(repetition):
    """What the keeper calls to give back takes seconds each time: longer in all than any worker may be silent."""
    (repetition.slow / "slow").touch()
    repetition.moment()
    for _ in range(repetition.random.choice([1, 2])):
        repetition.interrupt()
        time.sleep(repetition.random.uniform(0, 0.5))


def load_that_cannot_be_killed(repetition):
    """As in an uninterruptible sync: in a frozen group of version 1 a process does not even die of SIGKILL."""
    group = pathlib.Path(f"/sys/fs/cgroup/freezer/ontime-torture-{os.getpid()}")
    group.mkdir()
    try:
        for pid in repetition.pids("stress-ng"):
            with contextlib.suppress(OSError):
                (group / "cgroup.procs").write_text(str(pid))
        (group / "freezer.state").write_text("FROZEN")
        repetition.moment()
        repetition.interrupt()
        repetition.wait(repetition.random.uniform(1, 3))
        check(repetition.process.poll() is None, "it left, and its load was still there")
        if repetition.random.random() < 0.5:  # who does not want to wait
            repetition.interrupt()
            repetition.wait(45)
            check("stress-ng" in repetition.output(), "it left a load and did not say so: " + repetition.words())
    finally:
        (group / "freezer.state").write_text("THAWED")
        for _ in range(100):
            with contextlib.suppress(OSError):
                group.rmdir()
                break
            time.sleep(0.1)


def rename_interface(repetition):
    """The messages go on: what is renamed is up, which Linux permits from 6.2 on, and the addresses stay."""
    name = next(entry["ifname"] for entry in json.loads(output("ip", "-n", "near", "-j", "link")) if entry["ifname"] != "lo")
    subprocess.run(["ip", "-n", "near", "link", "set", name, "down"], check=True)
    subprocess.run(["ip", "-n", "near", "link", "set", name, "name", "renamed"], check=True)
    subprocess.run(["ip", "-n", "near", "link", "set", "renamed", "up"], check=True)
    time.sleep(repetition.random.uniform(0, 0.5))
    repetition.interrupt()


def move_interface(repetition):
    subprocess.run(["ip", "netns", "add", "elsewhere"], check=True)
    subprocess.run(["ip", "-n", "near", "link", "set", "to-far", "netns", "elsewhere"], check=True)
    time.sleep(repetition.random.uniform(0, 0.5))
    repetition.interrupt()
    repetition.wait(60)
    check("to-far" in repetition.output(), "it says nothing of the interface that was moved: " + repetition.words())
    # Where it comes back, the next ontime gives back what was kept.
    subprocess.run(["ip", "-n", "elsewhere", "link", "set", "to-far", "netns", "near"], check=True)
    subprocess.run(["ip", "netns", "del", "elsewhere"], check=True)
    repetition.everybody_is_gone = True


def kill_deployed_keeper(repetition):
    """The shell that brought it has its name in its own command, too."""
    pids = set(repetition.pids("bin/ontime keeper")) & set(repetition.pids("ontime-program-"))
    check(len(pids) == 1, f"there is not exactly one deployed keeper: {pids}")
    repetition.moment()
    os.kill(pids.pop(), signal.SIGKILL)


def interrupt_twice(repetition):
    repetition.moment()
    repetition.interrupt()
    time.sleep(repetition.random.uniform(0, 0.3))
    repetition.interrupt()




def kill_listener(repetition):
    os.kill(repetition.process.pid, signal.SIGKILL)
    repetition.everybody_is_gone = True


def kill_node(repetition):
    """Under its probes, whose code the kernel changes at that moment."""
    repetition.random.choice(list(repetition.nodes.values())).kill()
    time.sleep(repetition.random.uniform(0, 1))
    repetition.interrupt()
