#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""`ontime listen --reader` beside publishers of two implementations, in a network of its own. ONTIME, LISTEN_NODE and
LISTEN_FASTDDS_NODE name the programs."""

import contextlib
import json
import os
import pathlib
import signal
import sqlite3
import subprocess
import tempfile
import unittest

from program import eventually

ONTIME, NODE, FASTDDS_NODE = (os.environ[name] for name in ("ONTIME", "LISTEN_NODE", "LISTEN_FASTDDS_NODE"))
DOMAIN = "77"
ENVIRONMENT = {**os.environ, "LISTEN_NODE_DOMAIN": DOMAIN, "ROS_DOMAIN_ID": DOMAIN}
PAUSES_EVERY = 997  # messages of a publisher


class Reader(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="ontime-test-")
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)

    def start(self, *command, **more):
        process = subprocess.Popen([str(word) for word in command], env=ENVIRONMENT, cwd=self.folder, **more)
        self.addCleanup(lambda: (process.kill(), process.wait()))
        return process

    def publish(self, node, topic):
        publisher = self.start(node, "publish", topic, 1_000_000, 1000, self.folder / topic.replace("/", "-"), stderr=subprocess.DEVNULL)
        caught = lambda: int(pathlib.Path(f"/proc/{publisher.pid}/status").read_text().split("SigCgt:")[1].split()[0], 16)
        self.assertTrue(eventually(lambda: caught() >> (signal.SIGUSR1 - 1) & 1))
        publisher.send_signal(signal.SIGUSR1)

    def kept(self):
        """How many periods of each run are in the results; none, until the file has tables."""
        try:
            with contextlib.closing(sqlite3.connect(f"file:{self.folder / 'kept.ontime'}?mode=ro", uri=True)) as database:
                return dict(database.execute("SELECT run.id, COUNT(*) FROM sample JOIN run ON run.number = sample.run GROUP BY run.id"))
        except sqlite3.OperationalError:
            return {}

    @unittest.skipUnless(os.geteuid() == 0, "needs root, for a network of its own")
    def test_late_messages_and_ages_of_both_implementations_are_seen(self):
        self.publish(NODE, "rt/cmd_vel")
        self.publish(FASTDDS_NODE, "rt/scan")
        listener = self.start(ONTIME, "listen", "/cmd_vel", "/scan", "--reader", "--deadline", "15ms", "--age", "5 s", "--format", "json",
                              "--output", "seen.json", "--results", "kept.ontime", stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
                              text=True)
        topics = ("/cmd_vel", "/scan")
        self.assertTrue(eventually(lambda: all(self.kept().get(f"{topic} period", 0) > 3 * PAUSES_EVERY for topic in topics)), self.kept())
        listener.send_signal(signal.SIGINT)
        said = listener.communicate(timeout=60)[1]
        self.assertEqual(listener.returncode, 1, said)
        seen = json.loads((self.folder / "seen.json").read_text())
        self.assertIn("--reader", " ".join(seen["remarks"]))
        flows = {flow["topic"]: flow for flow in seen["flows"]}
        self.assertEqual(set(flows), set(topics))
        for flow in flows.values():
            self.assertEqual(flow["duplicated"], 0)
            self.assertGreaterEqual(flow["late"], flow["messages"] // PAUSES_EVERY - 1)
            self.assertLess(flow["age"]["p50_ns"], 1_000_000_000)  # of this machine, by one clock

    def test_without_a_topic_it_is_refused(self):
        done = subprocess.run([ONTIME, "listen", "--reader"], capture_output=True, text=True, timeout=60)
        self.assertEqual(done.returncode, 2)
        self.assertIn("--reader", done.stderr)

    @unittest.skipUnless(os.geteuid() == 0, "needs root, for a network of its own")
    def test_nobody_there_is_said(self):
        done = subprocess.run([ONTIME, "listen", "/nix", "--reader", "--for", "2 s"], env=ENVIRONMENT, capture_output=True, text=True, timeout=60)
        self.assertEqual(done.returncode, 2, done.stderr)
        self.assertIn("no other DDS participant found in domain 77", done.stderr)
        self.assertIn("'/nix'", done.stderr)


if __name__ == "__main__":
    unittest.main(verbosity=2)
