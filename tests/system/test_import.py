#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What other tools and recorders wrote, imported by the real program: histograms and bags."""

import contextlib
import hashlib
import json
import os
import re
import shutil
import sqlite3
import struct
import subprocess
import unittest

import results

HISTOGRAM = """# Histogram
000001 000003
000002 000001
# Total: 000000004
# Min Latencies: 00001
# Avg Latencies: 00001
# Max Latencies: 00002
# Histogram Overflows: 00000
# Histogram Overflow at cycle number:
# Thread 0:
"""


class Import(results.Results):
    # --- in ---

    def import_file(self, text, code=0, form="cyclictest-histogram"):
        (self.folder / "old.txt").write_bytes(text if isinstance(text, bytes) else text.encode())
        return self.ontime("import", "old.txt", "--from", form, "--results", self.results, code=code)

    def test_imported_runs_are_shown_as_what_they_are(self):
        self.measured()
        self.import_file(HISTOGRAM)
        out = self.ontime("report", self.results, "--full").stdout
        self.assertIn("imported wake-up latencies", out)
        self.assertIn("thread 0 (old.txt)", out)
        self.assertEqual(len(self.ontime("export", self.results, "--run", "2").stdout.splitlines()), 1)
        self.assertIn("imported", self.ontime("report", self.results, "--fail-if", "late > 100000", code=1).stderr)
        other = self.folder / "other.ontime"
        shutil.copy(self.results, other)
        self.assertIn("no confidence interval", self.ontime("compare", self.results, other).stdout)
        self.import_file(HISTOGRAM.replace("Overflows: 00000", "Overflows: 00001").replace("Max Latencies: 00002", "Max Latencies: 00090"))
        runs = json.loads(self.ontime("report", self.results, "--format", "json").stdout)["runs"]
        imported = [run["imported"] for run in runs]
        self.assertIsNone(imported[0])
        self.assertEqual([(one["file"], one["values"], one["beyond"], one["beyond_from_us"], one["resolution_us"]) for one in imported[1:]],
                         [("old.txt", 4, 0, None, 1), ("old.txt", 5, 1, 3, 1)])

    def test_what_is_wrong_changes_nothing(self):
        self.measured()
        before = hashlib.sha256(self.results.read_bytes()).digest()
        for text in ("", "x", "\0" * 1000, HISTOGRAM[:60], HISTOGRAM.replace("000003", "-00003"),
                     HISTOGRAM.replace("000003", "nan"), HISTOGRAM.replace("000003", "9" * 30),
                     HISTOGRAM.replace("000003", "3 4"), HISTOGRAM * 2, b"\xff\xfe" + HISTOGRAM.encode("utf-16-le"),
                     "1 1\n" * 100_000, "1" * 1_000_000):
            self.import_file(text, code=2)
        for text in ("{", "[]", "[" * 100_000, '{"thread": {"0": {"histogram": {"1": -1}}}}', HISTOGRAM):
            self.import_file(text, code=2, form="cyclictest-json")
        self.assertIn("comma", self.ontime("import", "old.txt", "--from", "cyclictest-json", "--results", self.results, "--id", "a,b", code=2).stderr)
        self.assertIn("performance_test", self.import_file(HISTOGRAM, code=2, form="performance-test").stderr)
        self.assertEqual(hashlib.sha256(self.results.read_bytes()).digest(), before)
        self.results.unlink()
        self.import_file("x", code=2)
        self.assertFalse(self.results.exists())

    # --- bags ---

    START = 1_700_000_000_000_000_000

    def bag(self, gaps_ms, stamp_behind_ms=2, unset=()):
        """A bag as rosbag2 writes it, of one topic. Messages `unset`, by number, have no stamp."""
        folder = self.folder / "drive"
        folder.mkdir(exist_ok=True)
        path = folder / "drive_0.db3"
        path.unlink(missing_ok=True)
        with contextlib.closing(sqlite3.connect(path)) as database, database:
            database.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT)")
            database.execute("CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)")
            database.execute("INSERT INTO topics VALUES(1, '/scan', 'sensor_msgs/msg/LaserScan', 'cdr')")
            at = self.START
            for number, gap_ms in enumerate([0, *gaps_ms]):
                at += gap_ms * 10**6
                stamp = (0, 0) if number in unset else divmod(at - stamp_behind_ms * 10**6, 10**9)
                database.execute("INSERT INTO messages(topic_id, timestamp, data) VALUES(1, ?, ?)",
                                 (at, b"\0\1\0\0" + struct.pack("<iI", *stamp) + b"\1\0\0\0\0"))
        (folder / "metadata.yaml").write_text("rosbag2_bagfile_information:\n  version: 5\n  compression_mode: ''\n"
                                              "  relative_file_paths: [drive_0.db3]\n")
        return folder

    def test_bag_is_judged_by_the_limits_that_are_stated(self):
        bag = self.bag([10, 10, 30, 10])
        out = self.ontime("import", bag).stdout
        self.assertIn("/scan", out)
        self.assertIn("header.stamp", out)
        self.ontime("import", bag, "--deadline", "50ms", "--age", "5ms")
        flow, = json.loads(self.ontime("import", bag / "drive_0.db3", "--deadline", "20ms", "--format", "json", code=1).stdout)["flows"]
        self.assertEqual((flow["messages"], flow["late"], flow["age_from"]), (5, 1, "header.stamp"))
        self.assertEqual((flow["period"]["max_ns"], flow["age"]["max_ns"]), (30_000_000, 2_000_000))
        self.ontime("import", bag, "--age", "1ms", code=1)

    def test_message_that_misses_both_limits_is_one_late_message(self):
        text = self.ontime("import", self.bag([10, 10, 30, 10]), "--deadline", "20ms", "--age", "1ms", code=1).stdout
        rest = re.search(r"… and (\d+) more late messages? until", text)
        self.assertRegex(text, r"\b5 of 5\b", text)  # late in all: each has an age of 2 ms
        printed = len(re.findall(r"(?m)^\S* ?\d\d:\d\d:\d\d\.\d+ ", text))
        self.assertEqual((printed, int(rest[1])), (2, 3), text)  # the first age, and the gap

    def test_late_messages_are_in_the_order_of_time_and_an_age_hides_no_gap(self):
        text = self.ontime("import", self.bag([10, 10, 30, 10, 10], unset=range(4)), "--deadline", "20ms", "--age", "1ms", code=1).stdout
        late = re.findall(r"(?m)^\S* ?\d\d:\d\d:\d\d\.(\d+)  .* ms (old|after)", text)
        self.assertEqual(late, [("050", "after"), ("060", "old")], text)

    def test_messages_of_the_same_time_are_several_late_messages(self):
        text = self.ontime("import", self.bag([0] * 9), "--age", "1ms", code=1).stdout
        self.assertRegex(text, r"\b10 of 10\b")
        self.assertIn("… and 9 more late messages until", text)

    def test_messages_of_a_bag_become_runs_of_a_results_file(self):
        bag = self.bag([10, 10, 30, 10])
        self.ontime("import", bag, "--deadline", "20ms", "--results", self.results, code=1)
        runs = json.loads(self.ontime("report", self.results, "--format", "json").stdout)["runs"]
        self.assertEqual({run["id"]: run["sent"] for run in runs}, {"/scan age": 5, "/scan period": 4})
        self.assertEqual({run["id"]: run["late"] for run in runs}, {"/scan age": None, "/scan period": 1})  # no --age

    def test_limit_of_an_age_that_is_partly_unknown_is_open(self):
        bag = self.bag([10] * 99, unset=range(1, 100))
        done = self.ontime("import", bag, "--age", "5ms", "--results", self.results, code=1)
        self.assertIn("late 0 of 1  age unknown 99 ", done.stdout)
        self.assertIn("open: --age 5ms: the age of 99 of 100 messages of /scan is unknown", done.stderr)
        report = self.ontime("report", self.results).stdout
        self.assertRegex(report, r"(?s)Caution: .*the\s+age\s+of\s+99\s+of\s+100\s+messages")
        self.assertRegex(report, r"/scan age .* open")
        self.ontime("import", bag, "--deadline", "50ms")

    def test_ages_from_a_clock_that_is_ahead_are_told_where_they_are_kept(self):
        bag = self.bag([10] * 99, stamp_behind_ms=-3_600_000)
        for limits, code in (((), 0), (("--age", "5ms"), 1)):
            self.results.unlink(missing_ok=True)
            done = self.ontime("import", bag, *limits, "--results", self.results, code=code)
            self.assertIn(" stamp ahead 100 ", done.stdout)
            self.assertIn("the writer's clock is ahead", done.stderr)
            report = self.ontime("report", self.results).stdout
            self.assertRegex(report, r"(?s)Caution: .*100\s+of\s+100\s+stamps\s+of\s+/scan\s+are\s+later")
            self.assertEqual(code == 1, bool(re.search(r"/scan age .* open", report)), report)

    def test_a_bag_that_is_imported_again_is_no_repetition(self):
        bag = self.bag([50] * 20)
        runs = lambda: json.loads(self.ontime("report", self.results, "--format", "json").stdout)["runs"]
        for limits, count in ((["--deadline", "55ms"], 2), (["--deadline", "55ms"], 2), (["--deadline", "56ms"], 3)):
            said = self.ontime("import", bag, *limits, "--results", self.results).stderr
            self.assertEqual(len(runs()), count, said)
        self.bag([50] * 19 + [51])
        self.ontime("import", bag, "--deadline", "55ms", "--results", self.results)
        self.assertEqual(len(runs()), 5)

    def test_damaged_bag_leaves_no_runs(self):
        bag = self.bag([1] * 2000)
        with contextlib.closing(sqlite3.connect(bag / "drive_0.db3")) as database, database:
            database.execute("INSERT INTO messages(topic_id, timestamp, data) VALUES(99, ?, '')", (self.START,))
        self.ontime("import", bag, "--results", self.results, code=2)
        self.assertFalse(self.results.exists())
        self.ontime("import", self.bag([1]), "--results", self.results)
        before = self.ontime("report", self.results, "--format", "json").stdout
        shutil.copy(bag / "drive_0.db3", self.folder / "bad.db3")
        with contextlib.closing(sqlite3.connect(self.folder / "bad.db3")) as database, database:
            database.execute("INSERT INTO messages(topic_id, timestamp, data) VALUES(99, ?, '')", (self.START,))
        self.ontime("import", "bad.db3", "--results", self.results, code=2)
        self.assertEqual(self.ontime("report", self.results, "--format", "json").stdout, before)

    def test_log_of_a_bag_is_not_left_out_where_it_cannot_be_read(self):
        folder = self.folder / "read-only"
        folder.mkdir()
        live = self.bag([10]) / "drive_0.db3"
        with contextlib.closing(sqlite3.connect(live)) as database:
            database.execute("PRAGMA journal_mode = WAL")
            database.execute("INSERT INTO messages(topic_id, timestamp, data) VALUES(1, ?, '')", (self.START + 10**9,))
            database.commit()
            for suffix in ("", "-wal"):
                shutil.copy(f"{live}{suffix}", folder / f"killed.db3{suffix}")
        shutil.copy(live, folder / "ended.db3")
        folder.chmod(0o555)
        self.addCleanup(folder.chmod, 0o755)
        bounded = ["setpriv", "--bounding-set", "-all"] if os.geteuid() == 0 else []  # root may write there, too

        def read(name):
            return subprocess.run([*bounded, results.ONTIME, "import", folder / name, "--format", "json"], capture_output=True, text=True, timeout=60)
        killed, ended = read("killed.db3"), read("ended.db3")
        self.assertEqual(killed.returncode, 3, killed.stderr)
        self.assertIn("killed.db3-wal", killed.stderr)
        self.assertEqual(ended.returncode, 0, ended.stderr)
        self.assertEqual(json.loads(ended.stdout)["flows"][0]["messages"], 3)

    def test_bag_that_another_program_has_locked_is_no_damaged_one(self):
        bag = self.bag([10])
        with contextlib.closing(sqlite3.connect(bag / "drive_0.db3", isolation_level=None)) as database:
            database.execute("BEGIN EXCLUSIVE")
            self.assertIn("locked", self.ontime("import", bag, code=3).stderr)
        self.ontime("import", bag)

    def test_what_is_asked_of_a_bag_in_vain_is_refused(self):
        bag = self.bag([10])
        self.assertIn("/scan", self.ontime("import", bag, "--topic", "/scam", code=2).stderr)
        self.ontime("import", bag, "--topic", "/scan")
        # A name that the bag has not is no late message. A topic that was silent is.
        with open(bag / "metadata.yaml", "a") as metadata:
            metadata.write("  topics_with_message_count: [{topic_metadata: {name: /odom}, message_count: 0}]\n")
        self.assertIn("'/scan'?", self.ontime("import", bag, "--topic", "scan", "--deadline", "50ms", code=2).stderr)
        self.ontime("import", bag, "--topic", "/odom", "--deadline", "50ms", code=1)
        self.ontime("import", bag, "--topic", "scan", "--topic", "/scan", "--deadline", "50ms", code=1)
        self.assertIn("--unit", self.ontime("import", bag, "--unit", "us", code=2).stderr)
        self.assertIn("--topic", self.ontime("import", "x", "--from", "cyclictest-json", "--results", self.results, "--topic", "/a", code=2).stderr)
        self.assertIn("--results", self.ontime("import", "x", "--from", "cyclictest-json", code=2).stderr)
        self.assertIn("--unit", self.ontime("import", "x", "--from", "cyclictest-json", "--unit", "ns", code=2).stderr)
        (self.folder / "old.txt").write_text(HISTOGRAM)
        self.assertIn("--from", self.ontime("import", "old.txt", code=2).stderr)
        self.assertIn("Choose another", self.ontime("import", bag / "drive_0.db3", "--output", bag / "drive_0.db3", code=2).stderr)


if __name__ == "__main__":
    unittest.main(verbosity=2)
