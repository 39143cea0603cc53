# SPDX-License-Identifier: Apache-2.0
"""How messages are made late or lost: each is a context manager, which is given (end, chance)."""
import contextlib
import json
import os
import pathlib
import signal
import subprocess
import sys
import time

from ends import HOGGED, INTERFACE, OTHER, inside, is_ours, napi_threads, pids, pin, threads

QUOTAS, FREEZER = "/sys/fs/cgroup/cpu", "/sys/fs/cgroup/freezer"  # of cgroup version 1
CULPRIT = sys.executable  # by another name, as soon as the script has made one


@contextlib.contextmanager
def nothing(_end, _chance):
    yield


@contextlib.contextmanager
def ended(processes):
    try:
        yield processes
    finally:
        for process in processes:
            process.kill()
        for process in processes:
            process.wait()


def autogroup(pid, niceness):
    """Among sessions, as nice is within one; where the kernel has it."""
    with contextlib.suppress(OSError):
        pathlib.Path(f"/proc/{pid}/autogroup").write_text(str(niceness))


def ordinary(end):
    """The end's threads, and not the other's, as if nothing had been asked for."""
    for thread in threads(end):
        with contextlib.suppress(ProcessLookupError):
            os.sched_setscheduler(thread, os.SCHED_OTHER, os.sched_param(0))


def hogs(count, *how, burst_ms, pause_ms):
    """Named `culprit` from the beginning, for a kernel names a process as the file that it runs."""
    code = (f"import time\nwhile True:\n    end = time.monotonic() + {burst_ms / 1e3}\n"
            f"    while time.monotonic() < end: pass\n    time.sleep({pause_ms / 1e3})\n")
    return ended([subprocess.Popen([*how, "taskset", "-c", str(HOGGED), CULPRIT, "-c", code], start_new_session=True)
                  for _ in range(count)])


def hog(count, *how, burst_ms, pause_ms):
    """Whatever ran on the CPU has to wait while it computes."""
    @contextlib.contextmanager
    def made(end, chance):
        pin(end)
        with hogs(count, *how, burst_ms=burst_ms * chance.uniform(0.8, 1.2), pause_ms=pause_ms):
            yield
    return made


@contextlib.contextmanager
def ordinary_hogs(end, chance):
    """Four that have all of the CPU while they compute, for what the scheduler cares for the end."""
    ordinary(end)
    for pid in pids(end):
        autogroup(pid, 19)
    for thread in threads(end):
        with contextlib.suppress(ProcessLookupError):
            os.setpriority(os.PRIO_PROCESS, thread, 19)
    pin(end)
    with hogs(4, "nice", "-n", "-20", burst_ms=60 * chance.uniform(0.8, 1.2), pause_ms=40) as processes:
        for process in processes:
            autogroup(process.pid, -20)
        yield


@contextlib.contextmanager
def real_time_hog(end, chance):
    """Over the end's ordinary threads."""
    ordinary(end)
    with hog(1, "chrt", "-f", "10", burst_ms=25, pause_ms=100)(end, chance):
        yield


@contextlib.contextmanager
def rt_throttled(end, _chance):
    """A real-time hog that never sleeps, and an ordinary one, for which the kernel takes the CPU from whatever is real-time."""
    pin(end)
    with hogs(1, "chrt", "-f", "10", burst_ms=9000, pause_ms=0), hogs(1, burst_ms=9000, pause_ms=0):
        yield


def starved_napi_for(least_ms, most_ms, pause_ms):
    """The kernel's thread that takes in packets has to wait for its CPU, and neither end has."""
    @contextlib.contextmanager
    def made(end, chance):
        move_napi(end)
        with hogs(1, "chrt", "-f", "90", burst_ms=chance.uniform(least_ms, most_ms), pause_ms=pause_ms):
            yield
    return made


def move_napi(end):
    inside(end, "ethtool", "-K", INTERFACE[end], "rx-udp-gro-forwarding", "on")  # or a veth keeps UDP from its NAPI
    for where in INTERFACE:
        for thread in threads(where):
            with contextlib.suppress(ProcessLookupError):
                os.sched_setaffinity(thread, {0})
    for thread in napi_threads(INTERFACE[end]):
        with contextlib.suppress(ProcessLookupError):
            os.sched_setaffinity(thread, {HOGGED})


starved_napi = starved_napi_for(20, 30, 100)
starved_napi_for_long = starved_napi_for(80, 120, 200)


@contextlib.contextmanager
def held(end):
    """Its processes, each by a descriptor that never means another, those that are not ours left out."""
    with contextlib.ExitStack() as stack:
        processes = {pid: os.pidfd_open(pid) for pid in pids(end)}
        for descriptor in processes.values():
            stack.callback(os.close, descriptor)
        yield [descriptor for pid, descriptor in processes.items() if is_ours(pid)]


@contextlib.contextmanager
def stopped(end, chance):
    """Twice a process is stopped for a while."""
    with held(end) as processes:
        for _ in range(2):
            try:
                for process in processes:
                    signal.pidfd_send_signal(process, signal.SIGSTOP)
                time.sleep(chance.uniform(0.06, 0.15))
            finally:
                for process in processes:
                    signal.pidfd_send_signal(process, signal.SIGCONT)
            time.sleep(0.3)
    yield


@contextlib.contextmanager
def throttled(end, chance):
    """A cgroup (version 1) with a quota that is used up by a busy process in it."""
    ordinary(end)
    group = pathlib.Path(f"{QUOTAS}/ontime-culprit-{os.getpid()}")
    group.mkdir()
    try:
        (group / "cpu.cfs_period_us").write_text("100000")
        (group / "cpu.cfs_quota_us").write_text(str(int(chance.uniform(30, 60)) * 1000))
        busy = subprocess.Popen(["taskset", "-c", "0", sys.executable, "-c", "while True: pass"])
        with ended([busy]):
            for pid in [busy.pid, *pids(end)]:
                (group / "cgroup.procs").write_text(str(pid))
            yield
    finally:
        while (group / "cgroup.procs").read_text():  # they leave with the run
            for pid in (group / "cgroup.procs").read_text().split():
                with contextlib.suppress(OSError):
                    (group.parent / "cgroup.procs").write_text(pid)
        group.rmdir()


def dropped(hook):
    """All packets, every now and then: a middleware that is told sends again at once."""
    @contextlib.contextmanager
    def made(end, chance):
        until = time.monotonic() + 0.9
        while time.monotonic() < until:
            inside(end, "nft", "-f", "-",
                   input=f"table inet culprit {{ chain unlucky {{ type filter hook {hook} priority 0; meta l4proto udp drop; }}; }}\n")
            time.sleep(chance.uniform(0.01, 0.04))
            inside(end, "nft", "delete", "table", "inet", "culprit")
            time.sleep(chance.uniform(0.05, 0.15))
        yield
    return made


@contextlib.contextmanager
def shaped(end, chance):
    """A token bucket that gives fewer bytes a second than the messages take."""
    rate = f"{chance.randrange(250, 330)}kbit"
    inside(end, "tc", "qdisc", "add", "dev", INTERFACE[end], "root", "tbf", "rate", rate, "burst", "2000", "latency",
           "300ms")
    yield
    inside(end, "tc", "qdisc", "del", "dev", INTERFACE[end], "root")


@contextlib.contextmanager
def link_down(end, chance):
    """The interface is taken down for a while, twice."""
    for _ in range(2):
        inside(end, "ip", "link", "set", INTERFACE[end], "down")
        time.sleep(chance.uniform(0.1, 0.3))
        inside(end, "ip", "link", "set", INTERFACE[end], "up")
        time.sleep(0.3)
    yield


# Runs in the peer's namespace: bytes to ADDRESS, to each of PORTS at once and then again, for SECONDS; from each of SOURCES in
# turn, or from a port of its own.
FLOOD = """
import itertools, socket, struct, sys, time
address, seconds, size, pause_s, ports, sources = sys.argv[1:]
size, sources = int(size), [int(source) for source in sources.split(",") if source]
out = socket.socket(socket.AF_INET, *[socket.SOCK_RAW, socket.IPPROTO_UDP] if sources else [socket.SOCK_DGRAM])
end = time.monotonic() + float(seconds)
for source in itertools.cycle(sources or [None]):
    for port in map(int, ports.split(",")):
        header = struct.pack("!HHHH", source, port, 8 + size, 0) if source else b""
        try: out.sendto(header + bytes(size), (address, 0 if source else port))
        except OSError: pass
    if float(pause_s): time.sleep(float(pause_s))
    if time.monotonic() > end: break
"""
OTHERS_BYTES = 100  # as tests/culprits/faults.cpp knows them


def flood(end, ports, seconds, size, pause_s=0.0, sources=()):
    """Packets from the peer to this end."""
    links = json.loads(inside(end, "ip", "-j", "-4", "addr", "show", "dev", INTERFACE[end]).stdout)
    address = links[0]["addr_info"][0]["local"]
    return subprocess.Popen(["ip", "netns", "exec", f"ontime-{OTHER[end]}", "taskset", "-c", "0", sys.executable, "-c", FLOOD,
                             address, str(seconds), str(size), str(pause_s), ",".join(map(str, ports)),
                             ",".join(map(str, sources))])


def ports_of(end):
    lines = pathlib.Path(f"/proc/{pids(end)[0]}/net/udp").read_text().splitlines()[1:]
    return [int(line.split()[1].split(":")[1], 16) for line in lines]


@contextlib.contextmanager
def small_buffer(end, _chance):
    """Its sockets hold a packet or two, and others than messages come to them, with which it is slow (see the fault)."""
    # As if from the peer: a socket that is connected takes no others.
    with ended([flood(end, ports_of(end), 1.0, OTHERS_BYTES, pause_s=0.0005, sources=ports_of(OTHER[end]))]):
        yield


@contextlib.contextmanager
def crowded(end, chance):
    """Others send what fills the link's token bucket."""
    inside(end, "tc", "qdisc", "add", "dev", INTERFACE[end], "root", "tbf", "rate", f"{chance.randrange(18, 30)}mbit", "burst",
           "20000", "latency", "200ms")  # longer than what a socket holds: a sender that fills it waits, and nothing is dropped
    with ended([flood(OTHER[end], [9], 1.0, 1400)]):
        yield
    inside(end, "tc", "qdisc", "del", "dev", INTERFACE[end], "root")


@contextlib.contextmanager
def slow_rules(end, chance):
    """Rules of a packet filter that each packet passes as it is sent, and that match nothing."""
    rules = "meta mark 12345 counter\n" * 600
    jumps = "jump inner\n" * chance.randrange(900, 1300)
    inside(end, "nft", "-f", "-", input=f"table inet culprit {{ chain inner {{ {rules} }}; chain unlucky {{ type filter hook output "
           f"priority 0; meta l4proto udp goto outer; }}; chain outer {{ {jumps} }}; }}\n")
    yield
    inside(end, "nft", "delete", "table", "inet", "culprit")


@contextlib.contextmanager
def frozen(end, chance):
    """By the freezer of a cgroup (version 1), twice, as `docker pause` does."""
    group = pathlib.Path(f"{FREEZER}/ontime-culprit-{os.getpid()}")
    group.mkdir()
    try:
        for pid in pids(end):
            (group / "cgroup.procs").write_text(str(pid))
        for _ in range(2):
            (group / "freezer.state").write_text("FROZEN")
            time.sleep(chance.uniform(0.06, 0.15))
            (group / "freezer.state").write_text("THAWED")
            time.sleep(0.3)
        yield
    finally:
        (group / "freezer.state").write_text("THAWED")
        for pid in (group / "cgroup.procs").read_text().split():
            with contextlib.suppress(OSError):
                (group.parent / "cgroup.procs").write_text(pid)
        group.rmdir()


# Stops the threads of PIDS for their tracer, for SECONDS.
TRACER = """
import ctypes, sys, time
libc = ctypes.CDLL(None)
SEIZE, INTERRUPT, DETACH, WALL = 0x4206, 0x4207, 17, 0x40000000
threads = [int(one) for one in sys.argv[2:]]
for thread in threads: libc.ptrace(SEIZE, thread, 0, 0)
for thread in threads: libc.ptrace(INTERRUPT, thread, 0, 0)
for thread in threads: libc.waitpid(thread, None, WALL)
time.sleep(float(sys.argv[1]))
for thread in threads: libc.ptrace(DETACH, thread, 0, 0)
"""


@contextlib.contextmanager
def traced(end, chance):
    """Twice a debugger stops the process for a while."""
    for _ in range(2):
        subprocess.run([CULPRIT, "-c", TRACER, str(chance.uniform(0.06, 0.15)), *map(str, threads(end))], check=True)
        time.sleep(0.3)
    yield


@contextlib.contextmanager
def little_room(end, chance):
    """A queue that has room for the first fragments of a message alone."""
    inside(end, "tc", "qdisc", "add", "dev", INTERFACE[end], "root", "tbf", "rate", "20mbit", "burst", "1600", "limit",
           str(chance.randrange(1600, 3000)))
    yield
    inside(end, "tc", "qdisc", "del", "dev", INTERFACE[end], "root")


@contextlib.contextmanager
def inversion(end, chance):
    """A thread of low priority has a lock that the receiving one needs, and is kept from its CPU by one between them."""
    def holder():
        return [thread for thread in threads(end) if pathlib.Path(f"/proc/{thread}/comm").read_text().strip() == "culprit-lock"]

    until = time.monotonic() + 3
    while not holder() and time.monotonic() < until:  # it begins with the first message
        time.sleep(0.05)
    for thread in threads(end):
        os.sched_setaffinity(thread, {HOGGED if [thread] == holder() else 0})
    for thread in holder():
        os.sched_setscheduler(thread, os.SCHED_FIFO, os.sched_param(5))
    with hogs(1, "chrt", "-f", "10", burst_ms=chance.uniform(20, 30), pause_ms=16):
        yield


def no_freezer():
    return "" if os.path.isdir(FREEZER) else f"there is no {FREEZER} here (a cgroup of version 1)"


def no_quotas():
    return "" if os.path.isdir(QUOTAS) else f"there is no {QUOTAS} here (a cgroup of version 1)"


def no_ros2():
    """Looks where ontime does for the transport."""
    files = [os.path.join(folder, "ontime_transport_ros2.so") for folder in os.environ.get("ONTIME_TRANSPORT_PATH", "").split(":")]
    files += [os.path.join(folder, "share/ament_index/resource_index/ontime_transport/ros2")
              for folder in os.environ.get("AMENT_PREFIX_PATH", "").split(":")]
    return "" if any(map(os.path.exists, files)) else "there is no ROS 2 here"
