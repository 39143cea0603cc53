# SPDX-License-Identifier: Apache-2.0
"""What bench/run compares: ontime, the field's own tools, hand-written loops. docs/evidence/benchmark-method.md says how the
comparison is made fair.

Each reference is a context manager that runs its server. It yields a function of the duration in seconds and of ontime's run
just before. The function measures and returns quantiles in µs: {"p50": …, "p99": …, "p99.9": …}, without those that the
reference does not print.
"""
import contextlib
import json
import os
import pathlib
import re
import shutil
import signal
import sqlite3
import statistics
import subprocess
import tempfile
import threading
import time

ROOT = pathlib.Path(__file__).resolve().parent.parent
ONTIME = ROOT / "build/release/bin/ontime"
BARE_UDP = ROOT / "build/release/bench/bare_udp"
BARE_CYCLONEDDS = ROOT / "build/release/bench/bare_cyclonedds"
PACKAGES = {"ddsperf": "cyclonedds-tools", "cyclictest": "rt-tests", "taskset": "util-linux"}  # others: the program's name

CPUS = sorted(os.sched_getaffinity(0))
PAYLOAD = 500
QUANTILES = ("p50", "p99", "p99.9")
UDP_BYTES = 32 + PAYLOAD      # of a datagram of ontime's: header 16, CDR 16, payload
DDSPERF_BYTES = 12 + PAYLOAD  # CDR without its 4 bytes of encapsulation, which ddsperf does not count
FASTDDS_BYTES = 16 + PAYLOAD  # CDR with them: Fast DDS's own test does
WARM_UP = 1000                # answers; each side leaves out at least as many

ONTIME_DOMAIN, OTHER_DOMAIN = 71, 72
SOCKPERF_PORT, BARE_PORT = 17971, 17972

CYCLONEDDS_XML = '<General><Interfaces><NetworkInterface name="lo" multicast="false"/></Interfaces></General>'

# UDP on loopback and nothing else: the names are those that Fast DDS's own test looks for.
FASTDDS_PARTICIPANT = """
<participant profile_name="{name}" is_default_profile="{default}"><rtps>
  <useBuiltinTransports>false</useBuiltinTransports>
  <userTransports><transport_id>loopback</transport_id></userTransports>
  <builtin><initialPeersList><locator><udpv4><address>127.0.0.1</address></udpv4></locator></initialPeersList></builtin>
</rtps></participant>"""
FASTDDS_END = """
<{kind} profile_name="{name}"><topic><historyQos><kind>KEEP_LAST</kind><depth>1</depth></historyQos></topic><qos>
  <reliability><kind>BEST_EFFORT</kind></reliability><durability><kind>VOLATILE</kind></durability>
  <data_sharing><kind>OFF</kind></data_sharing>
</qos><historyMemoryPolicy>PREALLOCATED</historyMemoryPolicy></{kind}>"""
FASTDDS_XML = """<?xml version="1.0" encoding="UTF-8"?>
<dds xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles"><profiles>
<transport_descriptors><transport_descriptor><transport_id>loopback</transport_id><type>UDPv4</type>
  <interfaceWhiteList><address>127.0.0.1</address></interfaceWhiteList>
</transport_descriptor></transport_descriptors>{profiles}
</profiles></dds>"""


class Cannot(Exception):
    """Something could not be run: what, what was found, what to do."""


# All processes start in this program's session, because the kernel shares CPU time by session (autogroup).

def find(program):
    if isinstance(program, pathlib.Path):
        if not program.exists():
            raise Cannot(f"{program} does not exist. Build it: scripts/setup release")
    elif shutil.which(program) is None:
        raise Cannot(f"{program} is not installed. Fix: sudo apt install {PACKAGES.get(program, program)}")


class Process:
    """A program and its output. It has its own process group, so that Ctrl-C reaches only this script."""

    def __init__(self, command, cpu=None, environment=None):
        self.command, self.cpu, self.environment = command, cpu, environment or {}

    def __enter__(self):
        find(self.command[0])
        pinned = [] if self.cpu is None else ["taskset", "-c", str(self.cpu)]
        # The user's own settings must not configure one side only.
        environment = {name: value for name, value in os.environ.items() if name not in
                       ("CYCLONEDDS_URI", "FASTRTPS_DEFAULT_PROFILES_FILE", "ROS_DOMAIN_ID", "ROS_LOCALHOST_ONLY")}
        self.out, self.err = tempfile.TemporaryFile(), tempfile.TemporaryFile()
        self.popen = subprocess.Popen([*pinned, *map(str, self.command)], env=environment | self.environment,
                                      process_group=0, stdin=subprocess.DEVNULL, stdout=self.out, stderr=self.err)
        return self

    def __exit__(self, *_):
        if self.running():
            self.popen.terminate()
            try:
                self.popen.wait(10)
            except subprocess.TimeoutExpired:
                self.popen.kill()
                self.popen.wait()
        self.out.close()
        self.err.close()

    def name(self):
        return pathlib.Path(self.command[0]).name

    def running(self):
        return self.popen.poll() is None

    def says(self, file):
        file.seek(0)
        return file.read().decode(errors="replace")

    def failed(self):
        said = (self.says(self.err).strip() or self.says(self.out).strip() or "no output").splitlines()
        return Cannot(f"{self.name()} ended with {self.popen.returncode}: {said[-1]}")

    def output(self, longest):
        # wait(longest) would poll twenty times a second, and would disturb the tails.
        late = threading.Timer(longest, self.popen.kill)
        late.start()
        code = self.popen.wait()
        late.cancel()
        if code == -signal.SIGKILL:
            raise Cannot(f"{self.name()} was killed, or did not end within {longest:g} s")
        if code != 0:
            raise self.failed()
        return self.says(self.out)


def output(command, seconds, **conditions):
    """The output of a program that measures for this long."""
    with Process(command, **conditions) as process:
        return process.output(3 * seconds + 60)


def timed(command):
    """Seconds that a program takes with stdout to /dev/null, and its peak memory in MB."""
    find(command[0])
    begin = time.monotonic()
    process = subprocess.Popen([str(word) for word in command], stdout=subprocess.DEVNULL)
    _, status, used = os.wait4(process.pid, 0)
    seconds = time.monotonic() - begin
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 0:
        raise Cannot(f"{command[0]} ended with {process.returncode}")
    return seconds, used.ru_maxrss * 1024 / 1e6


@contextlib.contextmanager
def running(*servers):
    def check():
        for server in servers:
            if not server.running():
                raise server.failed()

    with contextlib.ExitStack() as stack:
        for server in servers:
            stack.enter_context(server)
        time.sleep(1)
        check()
        yield
        check()


@contextlib.contextmanager
def temporary(name, text=""):
    with tempfile.TemporaryDirectory() as folder:
        file = pathlib.Path(folder) / name
        if text:
            file.write_text(text)
        yield file


def quantiles_of(times):
    """By nearest rank: the smallest value that at least this share of all values does not exceed."""
    ordered = sorted(times)
    if not ordered:
        raise Cannot("no message was answered")
    return {name: ordered[-(-len(ordered) * thousandths // 1000) - 1]
            for name, thousandths in zip(QUANTILES, (500, 990, 999))}


# ontime.

def pong(transport, *flags, **conditions):
    return Process([ONTIME, "pong", "--transport", transport, "--interface", "lo", "--domain", ONTIME_DOMAIN,
                    "--payload", f"{PAYLOAD} B", *flags], **conditions)


def ping_command(transport, seconds, *flags):
    peer = ["--peer", "127.0.0.1"] if transport == "udp" else []
    return [ONTIME, "ping", "--transport", transport, "--interface", "lo", "--domain", ONTIME_DOMAIN, *peer,
            "--payload", f"{PAYLOAD} B", "--duration", f"{seconds:g} s", "--format", "json", *flags]


def run_of(report):
    return json.loads(report)["runs"][0]


def back_to_back(transport, seconds, *flags):
    command = ping_command(transport, seconds, "--schedule", "back-to-back", "--receive", "listener",
                           "--warm-up", WARM_UP, "--period", "1 ms", *flags)
    return run_of(output(command, seconds, cpu=CPUS[0]))


def second_by_second(results, most):
    """Quantiles of each whole second (of its first `most` round trips); of each, the median over the seconds."""
    seconds = {}
    with contextlib.closing(sqlite3.connect(f"file:{results}?mode=ro", uri=True)) as file:
        for at, time_us in file.execute("SELECT intended_s, round_trip_us FROM message "
                                        "WHERE round_trip_us IS NOT NULL ORDER BY message"):
            seconds.setdefault(int(at), []).append(time_us)
    *whole, _ = sorted(seconds.items())  # the last second is not whole
    if not whole:
        raise Cannot("a run of less than 2 s has no whole second to compare with ddsperf. Fix: --seconds 2")
    each = [quantiles_of(times[:most]) for _, times in whole]
    return {name: statistics.median(one[name] for one in each) for name in QUANTILES}


# The references.

@contextlib.contextmanager
def sockperf():
    def measure(seconds, _):
        said = output(["sockperf", "pp", "-i", "127.0.0.1", "-p", SOCKPERF_PORT, "-m", UDP_BYTES, "-t",
                       max(1, round(seconds)), "--full-rtt"], seconds, cpu=CPUS[0])
        found = dict(re.findall(r"percentile ([\d.]+) = +([\d.]+)", said))
        if "Round trip is" not in said or "50.000" not in found:
            raise Cannot("sockperf printed no round trips")
        return {"p50": float(found["50.000"]), "p99": float(found["99.000"]), "p99.9": float(found["99.900"])}

    with running(Process(["sockperf", "server", "-i", "127.0.0.1", "-p", SOCKPERF_PORT], cpu=CPUS[0])):
        yield measure


DDSPERF_KEEPS = 20_000  # round trips of each second; it only counts further ones


@contextlib.contextmanager
def ddsperf():
    conditions = {"cpu": CPUS[0], "environment": {"CYCLONEDDS_URI": CYCLONEDDS_XML}}

    def measure(seconds, _):
        said = output(["ddsperf", "-i", OTHER_DOMAIN, "-u", "-D", round(seconds) + 2, "ping", "size",
                       DDSPERF_BYTES, "listener"], seconds, **conditions)
        # One line per second. The first contains the warm-up.
        found = rf"size {DDSPERF_BYTES} mean ([\d.]+)us .* 50% ([\d.]+)us .* 99% ([\d.]+)us .* cnt (\d+)"
        lines = [tuple(map(float, line)) for line in re.findall(found, said)[1:]]
        if not lines:
            raise Cannot("ddsperf printed no round trips")
        # Pings are back to back, so the round trips of a second add up to 1 s; ddsperf prints halves, which add up to 0.5 s.
        added_up_s = statistics.median(mean * count / 1e6 for mean, _, _, count in lines)
        if not 0.3 < added_up_s < 0.7:
            raise Cannot(f"ddsperf's times of one second add up to {added_up_s:.2f} s instead of 0.5 s")
        return {"p50": 2 * statistics.median(p50 for _, p50, _, _ in lines),
                "p99": 2 * statistics.median(p99 for _, _, p99, _ in lines)}

    with running(Process(["ddsperf", "-i", OTHER_DOMAIN, "-u", "pong", "listener"], **conditions)):
        yield measure


def fastdds_profiles():
    ends = [(kind, f"{side}_{kind}_profile") for side in ("pub", "sub") for kind in ("publisher", "subscriber")]
    return FASTDDS_XML.format(profiles="".join(
        [FASTDDS_PARTICIPANT.format(name=f"{side}_participant_profile", default="false") for side in ("pub", "sub")] +
        [FASTDDS_END.format(kind=kind, name=name) for kind, name in ends]))


@contextlib.contextmanager
def fastdds_latency_test():
    """Fast DDS's own test. It takes a number of samples instead of a duration: as many as ontime sent. Its server serves
    one run."""
    program = os.environ.get("FASTDDS_LATENCY_TEST", "")
    if not os.access(program, os.X_OK):
        raise Cannot(f"FASTDDS_LATENCY_TEST is {repr(program) if program else 'not set'}; it must be the path of "
                     "LatencyTest, from test/performance/latency of Fast DDS's source (docs/evidence/benchmark-method.md)")
    with temporary("profiles.xml", fastdds_profiles()) as xml, temporary("sizes", f"{FASTDDS_BYTES};") as sizes, \
            temporary("times.csv") as times:
        def measure(seconds, ontimes):
            options = [f"--domain={OTHER_DOMAIN}", f"--xml={xml}", f"--file={sizes}",
                       f"--samples={ontimes['sent'] + WARM_UP}"]
            times.unlink(missing_ok=True)
            with Process([program, "subscriber", *options], cpu=CPUS[0]):
                said = output([program, "publisher", *options, f"--export_raw_data={times}"], 2 * seconds,
                              cpu=CPUS[0])
            # Half of a round trip each, less what it takes to read the clock.
            overhead_us = float(re.search(r"Overhead ([\d.e-]+) ns", said)[1])  # it prints "ns", but the values are µs
            lines = times.read_text().splitlines()[1 + WARM_UP:]
            return quantiles_of(2 * (float(line.split(",")[2]) + overhead_us) for line in lines)

        yield measure


@contextlib.contextmanager
def by_hand(program, *pong, ping, **conditions):
    """All hand-written loops have the same command line, and print one line of JSON."""
    def measure(seconds, _):
        line = json.loads(output([program, "ping", *ping, seconds], seconds, **conditions))
        return {name: line[f"{name}_us"] for name in QUANTILES}

    with running(Process([program, "pong", *pong], **conditions)):
        yield measure


def bare_udp():
    return by_hand(BARE_UDP, BARE_PORT, UDP_BYTES, ping=[BARE_PORT, UDP_BYTES], cpu=CPUS[0])


def bare_cyclonedds():
    return by_hand(BARE_CYCLONEDDS, OTHER_DOMAIN, PAYLOAD, ping=[OTHER_DOMAIN, PAYLOAD], cpu=CPUS[0],
                   environment={"CYCLONEDDS_URI": CYCLONEDDS_XML})


@contextlib.contextmanager
def bare_ros2(rmw):
    folders = [pathlib.Path(folder) for folder in os.environ.get("AMENT_PREFIX_PATH", "").split(":") if folder]
    programs = [folder / "lib/ontime_ros2/bare_ros2" for folder in folders]
    program = next((program for program in programs if program.exists()), None)
    if program is None:
        raise Cannot("bare_ros2 is not in AMENT_PREFIX_PATH. Build the packages in ros2/ and source them "
                     "(docs/how-to/ros2.md)")
    profiles = FASTDDS_XML.format(profiles=FASTDDS_PARTICIPANT.format(name="default", default="true"))
    with temporary("profiles.xml", profiles) as xml, \
            by_hand(program, ping=[PAYLOAD], cpu=CPUS[0], environment={
                "RMW_IMPLEMENTATION": rmw, "ROS_DOMAIN_ID": str(OTHER_DOMAIN), "CYCLONEDDS_URI": CYCLONEDDS_XML,
                "FASTRTPS_DEFAULT_PROFILES_FILE": str(xml)}) as measure:
        yield measure


def cyclictest(cpu, seconds):
    """Quantiles of the wake-up latency, in µs."""
    said = output(["cyclictest", "-p80", "-i1000", "-m", "-t1", "-a", cpu, "-N", "-h", 1_000_000, "-q", "-D",
                   round(seconds)], seconds)
    buckets = [(int(ns), int(count)) for ns, count in re.findall(r"^(\d+) (\d+)$", said, re.MULTILINE)]
    overflows = int(re.search(r"^# Histogram Overflows: (\d+)", said, re.MULTILINE)[1])
    times = [ns / 1000 for ns, count in buckets for _ in range(count)] + [float("inf")] * overflows
    found = quantiles_of(times)
    if float("inf") in found.values():
        raise Cannot("cyclictest's p99.9 is above the 1 ms of its histogram; is the machine overcommitted?")
    return found
