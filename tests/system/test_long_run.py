#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What a run of many hours meets: millions of messages, a link that goes and comes back, an end that dies, a full disk, a
clock that is set. Needs root, and skips without. ONTIME names the program."""

import contextlib
import glob
import json
import os
import pathlib
import signal
import sqlite3
import subprocess
import time
import unittest

from program import SCENARIO, TRANSPORTS, Program, eventually, processes_with


class LongRun(Program):
    def resident_bytes(self):
        """Of all processes of this test's ontime."""
        total = 0
        for pid in processes_with("ONTIME_TEST=" + self.temporary):
            with contextlib.suppress(OSError):
                total += int(pathlib.Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGESIZE")
        return total

    def test_memory_is_flat_however_many_messages(self):
        """Back to back, so that hours of messages pass in seconds."""
        text = SCENARIO.replace("period: 5 ms", "schedule: back-to-back")
        process = self.start_ontime("run", self.scenario("1 h", text=text, transports=["udp"]), "--only", "idle",
                                    "--results", self.results)
        # They come in bursts, of half a ring each: the first few show what is held at once. A busy machine holds more at times.
        self.assertTrue(eventually(lambda: self.samples_recorded() > 100_000, 250), process.poll())
        before, bytes_before = self.samples_recorded(), self.resident_bytes()

        def is_flat():
            messages = self.samples_recorded() - before
            return messages > 400_000 and self.resident_bytes() - bytes_before < messages * 88 / 2
        self.assertTrue(eventually(is_flat, 250), "samples are kept somewhere")
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=180)

    def test_cut_link_loses_messages_and_goes_on(self):
        process = self.start_ontime("run", self.scenario("10 s", transports=["cyclonedds"]), "--only", "idle", "--results", self.results)
        self.started(process, lambda: self.samples_recorded() > 50)
        link = json.loads(subprocess.run(["ip", "-n", "ontime-controller", "-j", "link"], capture_output=True, text=True, check=True).stdout)
        name = next(entry["ifname"] for entry in link if entry["ifname"] != "lo")
        subprocess.run(["ip", "-n", "ontime-controller", "link", "set", name, "down"], check=True)
        time.sleep(1)
        subprocess.run(["ip", "-n", "ontime-controller", "link", "set", name, "up"], check=True)
        _, error = process.communicate(timeout=180)
        self.assertEqual(process.returncode, 0, error)
        run = self.report()[0]
        self.assertGreater(run["lost"], 0)
        self.assertGreater(run["on_time"], 0)
        self.assertEqual(run["sent"], run["on_time"] + run["late"] + run["lost"])

    def noted(self, kind):
        with contextlib.closing(sqlite3.connect(f"file:{self.results}?mode=ro", uri=True)) as database:
            return database.execute("SELECT count(*) FROM note WHERE kind = ?", (kind,)).fetchone()[0] > 0

    def test_link_that_is_gone_for_long_is_matched_again_and_both_moments_are_told(self):
        process = self.start_ontime("run", self.scenario("1 h", transports=["cyclonedds"]), "--only", "idle", "--results", self.results)
        self.started(process, lambda: self.samples_recorded() > 50)
        link = ("ip", "-n", "ontime-controller", "link", "set", "to-component")
        subprocess.run([*link, "down"], check=True)
        self.assertTrue(eventually(lambda: self.noted("peer-left")), process.poll())
        subprocess.run([*link, "up"], check=True)
        self.assertTrue(eventually(lambda: self.noted("peer-came")), process.poll())
        before = self.samples_recorded()
        self.assertTrue(eventually(lambda: self.samples_recorded() > before + 50), process.poll())
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=180)
        run = self.report()[0]
        self.assertGreater(run["lost"], 0)
        self.assertEqual(run["sent"], run["on_time"] + run["late"] + run["lost"])
        left, came = (next(note["at_s"] for note in run["notes"] if note["kind"] == kind) for kind in ("peer-left", "peer-came"))
        self.assertLess(left, came)

    def test_full_disk_is_said_and_the_file_opens(self):
        disk = os.path.join(self.folder, "disk")
        os.mkdir(disk)
        subprocess.run(["mount", "-t", "tmpfs", "-o", "size=3m", "tmpfs", disk], check=True)
        try:
            self.results = os.path.join(disk, "results.ontime")
            scenario = self.scenario("1 h", transports=["udp"], text=SCENARIO.replace("period: 5 ms", "schedule: back-to-back"))
            answer = self.run_ontime("run", scenario, "--only", "idle", "--results", self.results)
            self.assertEqual(answer.returncode, 3, answer.stderr)
            self.assertIn("full", answer.stderr)
            self.assertIn("p99", answer.stdout, "what there is is shown")
            self.assertGreater(self.report()[0]["sent"], 0)
        finally:
            subprocess.run(["umount", disk], check=True)

    # --- an end that dies ---

    def component_is_killed(self):
        pids = subprocess.run(["ip", "netns", "pids", "ontime-component"], capture_output=True, text=True, check=True).stdout.split()
        self.assertEqual(len(pids), 1)
        os.kill(int(pids[0]), signal.SIGKILL)

    def test_component_that_dies_is_started_again_if_asked(self):
        text = SCENARIO.replace("duration: %s", "duration: %s, component: {restart: on}")
        for transport in TRANSPORTS:
            with self.subTest(transport=transport):
                self.results = os.path.join(self.folder, transport + ".ontime")
                process = self.start_ontime("run", self.scenario("6 s", text=text, transports=[transport]), "--only", "idle",
                                            "--results", self.results)
                self.started(process, lambda: self.samples_recorded() > 200)
                self.component_is_killed()
                out, error = process.communicate(timeout=180)
                self.assertEqual(process.returncode, 0, error)
                run = self.report()[0]
                self.assertTrue(run["complete"])
                self.assertTrue(run["conditions"]["component_restart"])
                self.assertGreater(run["lost"], 0)
                self.assertGreater(run["on_time"] + run["late"], run["lost"])
                self.assertEqual(run["sent"], run["on_time"] + run["late"] + run["lost"])
                gone, back = (next(note for note in run["notes"] if note["kind"] == kind)
                              for kind in ("component-gone", "component-back"))
                self.assertIn("the agent of the component", gone["text"])
                self.assertLess(gone["at_s"], back["at_s"])
                self.assertRegex(back["text"], r"\d\.\d{3} s")
                self.assertIn(back["text"][:40], " ".join(out.split()))

    def test_component_that_dies_ends_the_run_if_not_asked(self):
        process = self.start_ontime("run", self.scenario("1 h", transports=["udp"]), "--only", "idle", "--results", self.results)
        self.started(process, lambda: self.samples_recorded() > 50)
        self.component_is_killed()
        _, error = process.communicate(timeout=180)
        self.assertEqual(process.returncode, 3, error)
        self.assertIn("the agent of the component", error)

    # --- a clock that is set ---

    def test_system_clock_that_is_set_changes_nothing(self):
        libraries = glob.glob("/usr/lib/*/faketime/libfaketimeMT.so.1")
        if not libraries:
            self.skipTest("no libfaketime: sudo apt install libfaketime")
        clock = pathlib.Path(self.folder, "clock")
        clock.write_text("+0")
        self.environment.update(LD_PRELOAD=libraries[0], FAKETIME_TIMESTAMP_FILE=str(clock), FAKETIME_NO_CACHE="1",
                                FAKETIME_DONT_FAKE_MONOTONIC="1")
        for transport, moved in zip(TRANSPORTS, (3600, -3600, 86400)):
            with self.subTest(transport=transport):
                self.results = os.path.join(self.folder, transport + ".ontime")
                clock.write_text("+0")
                process = self.start_ontime("run", self.scenario("10 s", transports=[transport]), "--only", "idle",
                                            "--results", self.results)
                self.started(process, lambda: self.samples_recorded() > 50)
                clock.write_text(f"{moved:+}")
                out, error = process.communicate(timeout=180)
                self.assertEqual(process.returncode, 0, error)
                run = self.report()[0]
                self.assertTrue(run["complete"])
                self.assertLess(run["lost"], run["sent"] / 2)
                self.assertAlmostEqual(run["conditions"]["load"]["achieved"]["controller"]["clock_moved_s"], moved, delta=60)
                self.assertIn(f"the system clock of the machine was moved by {moved:+}.0 s", " ".join(out.split()))


if __name__ == "__main__":
    unittest.main(verbosity=2)
