# SPDX-License-Identifier: Apache-2.0
"""For tests of the page: a browser, results files to make pages of, and what the page then shows. ONTIME: the program."""
import contextlib
import os
import pathlib
import subprocess
import sys
import tempfile
import unittest

sys.dont_write_bytecode = True  # the checkout stays as it is
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent.parent / "bench"))
import browser  # noqa: E402
import results_file  # noqa: E402

ONTIME = os.environ.get("ONTIME", "build/release/bin/ontime")


class Opened(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        if not browser.is_there():
            raise unittest.SkipTest("there is no Chromium here: apt-get install chromium chromium-driver "
                                    "(scripts/setup installs them for the tests)")
        cls.stack = contextlib.ExitStack()
        cls.addClassCleanup(cls.stack.close)
        cls.folder = pathlib.Path(cls.stack.enter_context(tempfile.TemporaryDirectory()))
        # One for all: to start it takes longer than most tests.
        cls.opened = browser.Browser(cls.stack.enter_context(browser.driver()))
        cls.stack.callback(cls.opened.close)

    def browser(self, **options):
        self.opened.begin(**options)
        return self.opened

    def page_of(self, results):
        page = results.with_suffix(".html")
        subprocess.run([ONTIME, "report", results, "--format", "html", "--output", page], check=True, timeout=300)
        return page

    def results(self, runs, notes=(), traces=()):
        path = self.folder / f"{self.id()}.ontime"
        path.unlink(missing_ok=True)
        results_file.write(path, runs, notes, traces)
        return path

    def explained(self, hog="hog", reason="NETFILTER_DROP"):
        """A message that was late because another thread had the CPU, and one whose packet was dropped."""
        rows = [[1, i, i * 10_000_000, 0, 10_000, 2_000, 93_000, results_file.START_NS + i * 10_000_000 + 62_000, 3_000, 0,
                 results_file.ON_TIME, 0] for i in range(100)]
        rows[50][6], rows[50][7], rows[50][10] = 20_093_000, rows[50][7] + 20_000_000, results_file.LATE
        rows[70][6:9], rows[70][10] = [None] * 3, results_file.LOST

        def window(message, *events):
            all_of_it = [(0, "switch", {"at": 500_000, "other": 99, "other_name": hog, "other_priority": 120, "what": "R"}),
                         (-1, "waking", {"thread": 10, "name": "ping-send", "priority": 19, "what": "0"}),
                         (-1, "switch", {"other": 10, "other_name": "ping-send", "other_priority": 19, "what": "R"}), *events]
            listed = [{"at": 1_000_000 + 5_000 + i * 3_000, "cpu": cpu if cpu >= 0 else 1 + cpu, "kind": kind, **own}
                      for i, (cpu, kind, own) in enumerate(all_of_it)]
            listed[0]["cpu"] = 1
            begin = results_file.START_NS + message * 10_000_000 - 1_000_000
            return (1, message, "controller", {"message": message, "from_ns": begin, "to_ns": begin + 210_000_000, "whole": True,
                                               "events": sorted(listed, key=lambda event: event["at"])})
        ours = {"thread": 10, "packet": 1, "bytes": 550, "what": "veth"}
        waits = window(50, (0, "queued", ours), (0, "sent", ours), (0, "received", ours),
                       (0, "waking", {"thread": 20, "name": "pong-receive", "priority": 120, "what": "1", "other": 10}),
                       (0, "switch", {"thread": 10, "name": "ping-send", "what": "S"}),
                       (1, "switch", {"at": 21_000_000, "thread": 99, "name": hog, "priority": 120, "other": 20,
                                      "other_name": "pong-receive", "other_priority": 120, "what": "R"}),
                       (1, "switch", {"at": 21_070_000, "thread": 20, "name": "pong-receive", "priority": 120, "what": "S"}))
        dropped = window(70, (0, "queued", ours), (0, "sent", ours), (0, "received", ours),
                         (0, "dropped", {**ours, "what": reason}))
        came = results_file.outcome(trace={"controller": {}})
        came["hosts"] = {host: {"machine": {"boot_id": "b"}, "refusals": [], "threads": [{"role": role, "name": role, "tid": tid}]}
                         for host, role, tid in (("controller", "send", 10), ("component", "receive", 20))}
        return self.results([(results_file.asked(100), came, rows)], traces=[waits, dropped])

    def several(self):
        """Two conditions, two transports, two payloads, layers, losses, notes."""
        runs = []
        for i, (name, transport, payload, messages) in enumerate(
                [("Test1.B", "udp", 500, 3000), ("Test1.B", "cyclonedds", 500, 3000), ("Test1.D", "udp", 500, 3000),
                 ("Test1.D", "udp", 32768, 3000)], 1):
            request = results_file.asked(messages, id=name, transport=transport, payload_bytes=payload,
                                         realtime=name == "Test1.D", adds_to="Test1.B" if name == "Test1.D" else "")
            rows = [list(row) for row in results_file.samples(i, messages, seed=i)]
            if i == 1:
                rows[700][6], rows[700][10] = 27_654_321, results_file.LATE
                for column in (6, 7, 8):
                    rows[900][column] = None
                rows[900][10] = results_file.LOST
            runs.append((request, results_file.outcome(), rows))
        notes = [(1, 1, results_file.START_NS + 9_000_000_000, 900, "peer-left", "the pong left")]
        return self.results(runs, notes)

    def assert_quiet(self, opened):
        self.assertEqual(opened.errors(), [])

    def settle(self, opened):
        opened.run_async("const done = arguments[arguments.length - 1]; "
                         "requestAnimationFrame(() => requestAnimationFrame(done))")
