#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""`ontime tune search` by the real program: it ends, goes on after kill -9, and leaves the machine as it was. Needs root, and skips
without. ONTIME names the program."""
import contextlib
import fcntl
import json
import os
import pathlib
import re
import shutil
import signal
import sqlite3
import subprocess
import tempfile
import unittest

import search_kills
from program import ONTIME, eventually

BUSY_POLL = pathlib.Path("/proc/sys/net/core/busy_poll")
SCENARIO = """
hosts: namespaces
defaults: {transport: udp, period: 2 ms, deadline: 400 ms, duration: 500 ms, kernel: {busy-poll: 50}}
runs: [{id: one}, {id: two}]
"""
EASY = "p50 < 1 s"  # on the busiest machine
NEVER_MET = "p50 < 1 us"


@contextlib.contextmanager
def another_ontime():
    """A living journal: by it another ontime holds the machine."""
    folder = pathlib.Path("/run/ontime")
    while True:  # as ontime does: who holds the folder makes journals in it, or removes it
        folder.mkdir(mode=0o700, exist_ok=True)
        with contextlib.suppress(FileNotFoundError):
            held = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
            fcntl.flock(held, fcntl.LOCK_EX)
            with contextlib.suppress(FileNotFoundError):
                if os.fstat(held).st_ino == folder.stat().st_ino:
                    break
            os.close(held)
    path = folder / "0000000000000001-00000001.journal"
    with open(path, "x", opener=lambda name, flags: os.open(name, flags, 0o600)) as journal:
        boot = pathlib.Path("/proc/sys/kernel/random/boot_id").read_text().strip()
        journal.write(json.dumps({"journal": 1, "boot": boot, "pid": os.getpid(), "command": "ontime of a test"}) + "\n")
        journal.flush()
        fcntl.flock(journal, fcntl.LOCK_EX)
        os.close(held)
        try:
            yield
        finally:
            path.unlink()


@unittest.skipUnless(os.geteuid() == 0, "settings of a machine need root")
class Search(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(tempfile.mkdtemp(prefix="ontime-test-"))
        self.addCleanup(shutil.rmtree, self.folder)
        (self.folder / "s.yaml").write_text(SCENARIO)
        self.before = BUSY_POLL.read_text()
        self.assertEqual(self.before, "0\n", f"as a machine is at first: echo 0 >{BUSY_POLL}")

    def command(self, *arguments, goal=EASY, only="one"):
        return [ONTIME, "tune", "search", "./s.yaml", "--goal", goal, "--only", only, "--results", "s.ontime", "--format", "json", *arguments]

    def search(self, *arguments, code=0, **others):
        done = subprocess.run(self.command(*arguments, **others), cwd=self.folder, capture_output=True, text=True, timeout=120)
        self.assertEqual(done.returncode, code, done.stdout + done.stderr)
        self.assertEqual(BUSY_POLL.read_text(), self.before)
        return json.loads(done.stdout) if code < 2 else done.stderr

    def searched(self):
        """A search that ended: one for all tests that only go on from there."""
        if not hasattr(Search, "ended"):
            folder = tempfile.TemporaryDirectory(prefix="ontime-test-")
            self.addClassCleanup(folder.cleanup)
            found = self.search()
            Search.ended = found, shutil.copy(self.folder / "s.ontime", folder.name)
        found, results = Search.ended
        shutil.copy(results, self.folder / "s.ontime")
        return found

    def test_a_goal_that_holds_changes_nothing(self):
        found = self.search()
        self.assertEqual((found["end"], found["set"], len(found["trials"])), ("goal-holds", {}, 1))
        self.assertTrue((self.folder / "s.search.html").exists())
        self.assertTrue((self.folder / "s.html").exists())

    def test_a_limit_on_response_times_counts_cycles(self):
        command = [word.replace("json", "table") for word in self.command(goal="response p50 < 1 s and p50 < 1 s")]
        said = subprocess.run(command, cwd=self.folder, capture_output=True, text=True, timeout=120).stdout
        self.assertRegex(said, r"response p50 < 1 s: 0 of \d+ cycles break it")
        self.assertRegex(said, r"\n  p50 < 1 s: 0 of \d+ messages break it")

    def test_an_ordinary_user_is_refused_before_the_first_run_with_the_command_that_works(self):
        self.folder.chmod(0o777)
        user = ["setpriv", "--reuid", "65534", "--regid", "65534", "--clear-groups"]
        for hosts in ("namespaces", "loopback", "{component: {address: 127.0.0.1}}"):
            (self.folder / "s.yaml").write_text(SCENARIO.replace("namespaces", hosts))
            done = subprocess.run([*user, *self.command()], cwd=self.folder, capture_output=True, text=True, timeout=120)
            self.assertEqual(done.returncode, 3, done.stderr)
            self.assertRegex(done.stderr, r"\Aontime: .* Fix: sudo \S+ tune search \./s\.yaml --goal 'p50 < 1 s' .*\n\Z")
            self.assertFalse((self.folder / "s.ontime").exists())

    def test_a_search_that_ended_is_not_measured_again(self):
        first = self.searched()
        again = self.search("--resume")
        self.assertEqual((again["runs"], again["end"], again["trials"]), (first["runs"], first["end"], first["trials"]))

    def test_a_search_that_was_killed_goes_on_and_leaves_the_machine_as_it_was(self):
        with subprocess.Popen(self.command(goal="p99 < 1 s"), cwd=self.folder, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
                              text=True) as search:
            for line in search.stderr:
                if "trial 1, run 2" in line:
                    break
            search.send_signal(signal.SIGKILL)
            search.stderr.read()  # its keeper has it, too, and gives back meanwhile
        subprocess.run([ONTIME, "tune", "revert"], capture_output=True, check=True)
        self.assertEqual(BUSY_POLL.read_text(), self.before)
        found = self.search("--resume", goal="p99 < 1 s")
        self.assertEqual(found["end"], "goal-holds")

    def test_another_scenario_does_not_go_on_with_these_results(self):
        self.searched()
        (self.folder / "s.yaml").write_text(SCENARIO.replace("500 ms", "600 ms"))
        self.assertIn("--resume", self.search("--resume", code=2))

    def test_resume_names_what_differs_from_the_search_in_the_file(self):
        self.searched()
        self.assertIn(EASY, self.search("--resume", goal="p99 < 1 s", code=2))
        self.assertIn("realtime.lock-memory", self.search("--resume", "--never", "lock-memory", code=2))
        self.assertIn("one over udp", self.search("--resume", only="two", code=2))
        self.assertEqual(self.search("--resume")["end"], "goal-holds")

    def test_resume_refuses_results_of_another_machine_or_kernel(self):
        self.searched()
        with contextlib.closing(sqlite3.connect(self.folder / "s.ontime")) as database:
            database.execute("UPDATE run SET outcome = json_set(outcome, '$.hosts.component.machine.kernel_release', '5.10.0-rt')")
            database.commit()
        said = self.search("--resume", code=2)
        self.assertIn("than the component's: kernel_release \"5.10.0-rt\", not", said)
        self.assertIn("Fix: start a new results file", said)

    def test_resume_refuses_results_of_another_command(self):
        subprocess.run([ONTIME, "run", "./s.yaml", "--only", "one", "--results", "s.ontime"], cwd=self.folder, capture_output=True,
                       check=True)
        self.assertIn("holds no search", self.search("--resume", code=2))

    def test_a_machine_that_another_ontime_holds_ends_the_search_and_refuses_no_setting(self):
        for hosts in ("namespaces", "loopback"):
            (self.folder / "s.yaml").write_text(SCENARIO.replace("namespaces", hosts))
            with subprocess.Popen(self.command(goal=NEVER_MET), cwd=self.folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                                  text=True) as search:
                self.await_text(search, "trial 2")
                with another_ontime():
                    said, told = search.communicate(timeout=120)
            self.assertEqual(search.returncode, 3, said + told)
            found = json.loads(said)
            self.assertIn("ontime of a test", found["why"])
            self.assertNotIn("refused", [trial["decision"] for trial in found["trials"]])
            (self.folder / "s.ontime").unlink()

    def test_a_machine_that_is_held_for_a_moment_is_waited_for(self):
        with subprocess.Popen(self.command(goal=NEVER_MET), cwd=self.folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                              text=True) as search:
            self.await_text(search, "trial 2")
            with another_ontime():
                self.await_text(search, "retry in")
            self.await_text(search, "trial 3")
            search.send_signal(signal.SIGINT)
            found = json.loads(search.communicate(timeout=120)[0])
        self.assertEqual(search.returncode, 130)
        self.assertNotIn("refused", [trial["decision"] for trial in found["trials"]])

    def await_text(self, search, text):
        self.assertTrue(any(text in line for line in search.stderr), f"the search ended without '{text}'")

    def test_a_setting_that_another_process_changes_stays_and_ends_the_search(self):
        self.addCleanup(BUSY_POLL.write_text, self.before)
        with subprocess.Popen(self.command("--duration", "3 s"), cwd=self.folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                              text=True) as search:
            self.assertTrue(eventually(lambda: BUSY_POLL.read_text() == "50\n"))
            BUSY_POLL.write_text("77\n")
            told = search.communicate(timeout=120)[1]
        self.assertEqual(search.returncode, 3, told)
        self.assertIn("another process changed busy-poll", told)
        self.assertEqual(BUSY_POLL.read_text(), "77\n")

    def test_settings_of_an_interface_are_not_tried_on_loopback(self):
        (self.folder / "s.yaml").write_text(SCENARIO.replace("namespaces", "loopback"))
        found = self.search()
        left_out = {one["key"]: one["why"] for one in found["left_out"]}
        for key in ("gro", "coalescing", "irq-cpus", "irq-threads"):
            self.assertIn("loopback", left_out[f"kernel.{key}"])

    def test_a_proof_is_printed_beside_the_goal_and_the_picture_fits_a_page(self):
        found = self.search(goal="p50 < 1 s and p99 < 1 s and p90 < 2 s")
        self.assertEqual([proof["permitted"] for proof in found["proofs"]], [0.5, 0.01, 0.1])
        for proof in found["proofs"]:
            self.assertLessEqual(proof["below"], proof["permitted"] * 1.000001)
        width = re.search(r'<svg [^>]*width="(\d+)"', (self.folder / "s.search.html").read_text())
        self.assertLessEqual(int(width.group(1)), 960)

    def test_too_little_time_for_a_run_says_how_long_one_takes(self):
        said = self.search("--within", "100 ms", code=2)
        self.assertRegex(said, "a run takes about .* and the first trial .* about")
        self.assertFalse((self.folder / "s.ontime").exists())

    def test_wrong_usage_measures_nothing(self):
        for goal in ("mean < 1 ms", "p99 < ", "late = 3"):
            self.search(goal=goal, code=2)
        self.assertIn("kernel.irq-threads", self.search("--never", "no-such-setting", code=2))
        self.assertIn("did you mean 'irq-threads'", self.search("--never", "irq-thread", code=2))
        self.search("--never", "duration", code=2)
        for cpus in ("999", "one", f"0-{os.cpu_count() - 1}"):
            self.assertIn("CPUs here: 0", self.search("--keep-cpus-off", cpus, code=2))
        self.search(only="one,two", code=2)
        self.assertFalse((self.folder / "s.ontime").exists())

    def test_help_names_every_setting_and_exit_code(self):
        said = subprocess.run([ONTIME, "tune", "search", "--help"], capture_output=True, text=True, check=True).stdout
        for word in ("kernel.rmem-max", "realtime.cpu-latency", "2 invalid usage", "130 interrupted"):
            self.assertIn(word, said)

    def test_kills_at_random_moments_leave_the_machine_as_it_was_and_the_search_goes_on(self):
        search = search_kills.Search(self.folder, seed=1)
        for _ in range(2):
            self.assertEqual(search.kill_once(), [])
        with search.start() as again:
            again.send_signal(signal.SIGINT)
            again.communicate()
        self.assertEqual(search.what_is_wrong(), [])


if __name__ == "__main__":
    unittest.main()
