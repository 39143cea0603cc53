# SPDX-License-Identifier: Apache-2.0
"""Nodes that keep their own account of each message, for tests of `ontime listen` beside them. ONTIME, LISTEN_NODE,
LISTEN_FASTDDS_NODE and LISTEN_RMW_NODE name the programs. LISTEN_MESSAGES: how many messages are compared (5,000)."""

import contextlib
import json
import os
import pathlib
import re
import signal
import sqlite3
import subprocess
import tempfile
import time
import unittest

from program import eventually

ONTIME, NODE, FASTDDS_NODE, RMW_NODE = (os.environ[name] for name in ("ONTIME", "LISTEN_NODE", "LISTEN_FASTDDS_NODE", "LISTEN_RMW_NODE"))
LATE = 1  # a fate of a results file
REALTIME = ("chrt", "-f", "60")  # what else runs on this machine does not delay it
MESSAGES = int(os.environ.get("LISTEN_MESSAGES", "5000"))
DOMAIN = 77
CONFIGURATION = f"""<CycloneDDS><Domain id="{DOMAIN}"><General><Interfaces><NetworkInterface name="lo"/></Interfaces>
<AllowMulticast>false</AllowMulticast></General><Discovery><Peers><Peer address="127.0.0.1"/></Peers>
<ParticipantIndex>auto</ParticipantIndex></Discovery></Domain></CycloneDDS>"""
ENVIRONMENT = {**os.environ, "CYCLONEDDS_URI": CONFIGURATION, "LISTEN_NODE_DOMAIN": str(DOMAIN), "LC_ALL": "C.UTF-8"}


def changed_code(pid):
    """How many bytes of the process's code of its DDS are not those of the file: those are probes."""
    changed = 0
    for line in pathlib.Path(f"/proc/{pid}/maps").read_text().splitlines():
        fields = line.split()
        if len(fields) < 6 or not re.search(r"lib(ddsc|fastrtps)\.so", fields[5]) or "x" not in fields[1]:
            continue
        begin, end = (int(text, 16) for text in fields[0].split("-"))
        with open(f"/proc/{pid}/mem", "rb", 0) as memory, open(fields[5], "rb") as file:
            memory.seek(begin)
            file.seek(int(fields[2], 16))
            here, there = memory.read(end - begin), file.read(end - begin)
            for at in range(0, len(here), 4096):
                page, other = here[at:at + 4096], there[at:at + 4096]
                if page != other:
                    changed += sum(a != b for a, b in zip(page, other))
    return changed


def until_probed(nodes):
    """The last probes are set when three looks, a second apart, see the same."""
    assert eventually(lambda: all(changed_code(node.pid) > 0 for node in nodes))
    counts = [None]
    while len(counts) < 3 or len({str(count) for count in counts[-3:]}) > 1:
        counts.append([changed_code(node.pid) for node in nodes])
        time.sleep(1)


def begin(publisher):
    """Once it can be told."""
    caught = lambda: int(pathlib.Path(f"/proc/{publisher.pid}/status").read_text().split("SigCgt:")[1].split()[0], 16)
    assert eventually(lambda: caught() >> (signal.SIGUSR1 - 1) & 1)
    publisher.send_signal(signal.SIGUSR1)


def log_of(path):
    return [tuple(int(word) for word in line.split()) for line in path.read_text().splitlines()]


class Robot(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="ontime-test-")
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)

    def start(self, *command, **more):
        process = subprocess.Popen([str(word) for word in command], env=ENVIRONMENT, cwd=self.folder,
                                   stderr=subprocess.DEVNULL, **more)
        self.addCleanup(lambda: (process.kill(), process.wait()))
        return process

    def pair(self, count, period_us=1000, depth=1000, take_us=0, node=NODE, way="take"):
        """A publisher that waits for SIGUSR1, and a taker; real-time, for one take of over 64 messages is not seen whole."""
        return (self.start(*REALTIME, node, "publish", "rt/cmd_vel", count, period_us, self.folder / "published"),
                self.start(*REALTIME, node, way, "rt/cmd_vel", depth, take_us, self.folder / "taken"))

    def listen(self, nodes, *arguments):
        listener = self.start(ONTIME, "listen", "--format", "json", "--output", "seen.json", *arguments)
        until_probed(nodes)  # the topics' names are found within the first messages
        return listener

    def end(self, listener, publisher, taker, last_take_s=0.5):
        begin(publisher)
        self.assertEqual(publisher.wait(600), 0)
        time.sleep(last_take_s)
        listener.send_signal(signal.SIGINT)
        code = listener.wait(120)
        taker.send_signal(signal.SIGTERM)
        self.assertEqual(taker.wait(120), 0)
        return code, json.loads((self.folder / "seen.json").read_text())

    def kept(self):
        """The rows of the results file, by the run's id, and what `report` says of the runs."""
        results = self.folder / "kept.ontime"
        with contextlib.closing(sqlite3.connect(f"file:{results}?mode=ro", uri=True)) as database:
            rows = {id: database.execute("SELECT received_after_ns, fate FROM sample WHERE run = ? ORDER BY message", [number]).fetchall()
                    for number, id in database.execute("SELECT number, id FROM run")}
        report = subprocess.run([ONTIME, "report", results, "--format", "json"], capture_output=True, text=True, timeout=60)
        self.assertEqual(report.returncode, 0, report.stderr)
        return rows, {run["id"]: run for run in json.loads(report.stdout)["runs"]}
