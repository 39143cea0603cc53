#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""How a run of the real program ends that is interrupted, killed, stopped, or has no room left: what it had is kept, and
nothing of it stays on the machine. Needs root, and skips without. ONTIME names the program."""

import contextlib
import fcntl
import os
import pathlib
import re
import shutil
import signal
import sqlite3
import subprocess
import termios
import time
import unittest
import xml.etree.ElementTree

from program import ONTIME, OUR_NAMESPACES, SCENARIO, Program, eventually, kill_at_once, namespaces, on_a_terminal, processes_with

LOADED_FIRST = """
hosts: namespaces
defaults: {transport: [%s], period: 5 ms, duration: %s}
runs:
  - id: loaded
    load: {controller: {cpu: 1}}
  - id: idle
"""


class Endings(Program):
    # --- interrupted, killed, without room ---

    def interrupted(self, times):
        process = self.start_ontime("run", self.scenario("1 h", transports=["udp"]), "--only", "loaded", "--results", self.results)
        self.started(process, lambda: self.samples_recorded() > 50)
        for _ in range(times):
            process.send_signal(signal.SIGINT)
            time.sleep(0.05)
        out, error = process.communicate(timeout=180)
        self.assertEqual(process.returncode, 130, error)
        self.assertEqual(error.count("interrupted: restoring settings"), 1, error)
        return out

    def test_interrupted_once_it_stops_and_reports(self):
        out = self.interrupted(1)
        self.assertIn("udp", out)
        run = self.report()[0]
        self.assertTrue(run["interrupted"])
        self.assertEqual(run["sent"], run["on_time"] + run["late"] + run["lost"])
        self.assertEqual(run["sent"], self.samples_recorded())

    def gated_load(self):
        """Gives the gate at which stress-ng waits until it is open for writing. It runs as an ordinary user."""
        os.chmod(self.folder, 0o755)
        folder = pathlib.Path(self.folder, "programs")
        folder.mkdir()
        os.mkfifo(folder / "gate")
        (folder / "stress-ng").write_text(f"#!/bin/sh\n: <'{folder}/gate'\nexec '{shutil.which('stress-ng')}' \"$@\"\n")
        for path, mode in (folder, 0o755), (folder / "gate", 0o644), (folder / "stress-ng", 0o755):
            path.chmod(mode)
        self.environment["PATH"] = f"{folder}:{os.environ['PATH']}"
        return folder / "gate"

    def test_interrupted_before_the_first_message_it_begins_nothing_more(self):
        gate = self.gated_load()

        def interrupt(process):
            process.send_signal(signal.SIGINT)
            self.addCleanup(os.close, os.open(gate, os.O_RDWR))  # it stays open

        shown, process = on_a_terminal([ONTIME, "run", self.scenario("1 h", transports=["udp"]), "--only", "loaded", "--explain",
                                        "--results", self.results], when=lambda shown: b"starting load" in shown, then=interrupt,
                                       env={**self.environment, "TERM": "xterm", "LC_ALL": "C.UTF-8"})
        self.addCleanup(process.kill)
        shown = shown.decode()
        self.assertEqual(process.wait(timeout=180), 130, shown)
        steps = list(dict.fromkeys(re.findall(r"udp  ([\w ]+) …", shown)))
        self.assertEqual(steps[steps.index("starting load and traffic") + 1:], ["ending"], shown)
        self.assertTrue(eventually(self.nothing_left), self.what_is_left())
        self.assertTrue(self.report()[0]["interrupted"])

    def test_interrupted_twice_it_leaves_and_keeps_what_it_had(self):
        self.interrupted(2)
        self.assertGreater(self.samples_recorded(), 50)

    def test_interrupted_twice_it_keeps_what_lies_in_its_pipe(self):
        process = self.start_ontime("run", self.scenario("1 h", transports=["udp"]), "--only", "idle", "--results", self.results)
        self.started(process, lambda: self.samples_recorded() > 50)
        process.send_signal(signal.SIGSTOP)
        stopped_ns = time.monotonic_ns()
        time.sleep(3)  # its agent measures on, and hands over twice a second
        for one in (signal.SIGINT, signal.SIGTERM, signal.SIGCONT):
            process.send_signal(one)
        _, error = process.communicate(timeout=180)
        self.assertEqual(process.returncode, 130, error)
        with contextlib.closing(sqlite3.connect(f"file:{self.results}?mode=ro", uri=True)) as database:
            newest_ns = database.execute("SELECT start_ns + max(intended_ns) FROM run JOIN sample ON run = number").fetchone()[0]
        self.assertGreater(newest_ns, stopped_ns)

    def test_run_is_measured_although_its_log_takes_no_line(self):
        reader, log = os.pipe()
        self.addCleanup(os.close, reader)
        os.set_blocking(log, False)
        with contextlib.suppress(BlockingIOError):
            while True:
                os.write(log, bytes(1 << 16))
        os.set_blocking(log, True)
        process = subprocess.Popen([ONTIME, "run", self.scenario("1 h", transports=["udp"]), "--only", "idle", "--results", self.results],
                                   stdout=subprocess.DEVNULL, stderr=log, env=self.environment)
        self.addCleanup(lambda: (process.kill(), process.wait()))
        os.close(log)
        self.started(process, lambda: self.samples_recorded() > 50)
        process.kill()

    def killed(self, whom):
        process = self.start_ontime("run", self.scenario("1 h", transports=["cyclonedds"]), "--only", "loaded", "--results", self.results)
        self.started(process, lambda: self.samples_recorded() > 50 and len(self.load()) > 0)
        before = self.samples_recorded()
        kill_at_once(*whom(process))
        process.communicate(timeout=180)
        self.assertTrue(eventually(lambda: not self.load() and not self.agents()), self.what_is_left())
        self.assertTrue(eventually(lambda: not OUR_NAMESPACES & set(namespaces())), self.what_is_left())
        self.assertGreaterEqual(self.report()[0]["sent"], before)
        return process.returncode

    def test_killed_coordinator_leaves_nothing(self):
        self.killed(lambda process: [process.pid])

    def test_killed_agents_leave_nothing(self):
        self.assertEqual(self.killed(lambda _: self.own("/ontime agent")), 3)

    def test_killed_keeper_leaves_nothing(self):
        self.assertEqual(self.killed(lambda _: self.keepers()), 3)

    def test_killed_all_at_once_is_cleared_by_the_next_start(self):
        process = self.start_ontime("run", self.scenario("1 h", transports=["udp"]), "--only", "loaded", "--results", self.results)
        self.started(process, lambda: self.samples_recorded() > 50 and len(self.load()) > 0)
        kill_at_once(process.pid, *self.agents())
        process.communicate(timeout=180)
        self.assertTrue(eventually(lambda: not self.load()), self.what_is_left())
        answer = self.run_ontime("run", self.scenario("50 ms", transports=["udp"]), "--only", "idle", "--results", self.results)
        self.assertEqual(answer.returncode, 0, answer.stderr)
        self.assertIn("ontime-controller", answer.stderr)  # it says what it found and cleared

    def test_what_cannot_be_restored_is_told_once(self):
        journal = pathlib.Path("/run/ontime/0000000000000001-00000001.journal")
        journal.parent.mkdir(mode=0o700)
        self.addCleanup(shutil.rmtree, journal.parent)
        journal.write_text("of a later version\n")
        journal.chmod(0o600)
        told = []
        for _ in range(2):
            answer = self.run_ontime("run", self.scenario("50 ms", transports=["udp"]), "--only", "idle", "--results", self.results)
            self.assertEqual(answer.returncode, 0, answer.stderr)
            told.append(answer.stderr.count(str(journal)))
        self.assertEqual(told, [1, 0])

    # --- a keeper that takes its time, or is lost at the end ---

    def slow_programs(self):
        """ip, tc and nft that take their time once there is a file `slow`."""
        folder = pathlib.Path(self.folder, "slow-programs")
        folder.mkdir()
        for name in ("ip", "tc", "nft"):
            program = folder / name
            program.write_text(f'#!/bin/sh\n[ ! -e {folder}/slow ] || sleep 1.5\nexec {shutil.which(name)} "$@"\n')
            program.chmod(0o755)
        self.environment["PATH"] = f"{folder}:{os.environ['PATH']}"
        return folder

    def test_keeper_that_is_slow_to_restore_is_awaited_and_told_of(self):
        slow = self.slow_programs()
        text = SCENARIO.replace("  - id: idle\n", "  - id: idle\n    link: {loss: 1 %%}\n")
        process = self.start_ontime("run", self.scenario("1 h", text, ["udp"]), "--only", "idle", "--results", self.results)
        self.started(process, lambda: self.samples_recorded() > 50)
        (slow / "slow").touch()
        for _ in range(2):
            process.send_signal(signal.SIGINT)
            time.sleep(0.2)
        _, error = process.communicate(timeout=120)
        self.assertEqual(process.returncode, 130, error)
        self.assertTrue(self.nothing_left(), error + self.what_is_left())
        self.assertIn("waiting for ontime on the", error)

    def test_keeper_that_is_killed_as_its_run_is_interrupted_leaves_nothing(self):
        for interruptions in (1, 2):
            process = self.loaded_run()
            process.send_signal(signal.SIGSTOP)  # so that it learns of both at once
            for pid in self.keepers():
                os.kill(pid, signal.SIGKILL)
            process.send_signal(signal.SIGINT)
            process.send_signal(signal.SIGCONT)
            if interruptions == 2:
                time.sleep(0.1)
                process.send_signal(signal.SIGINT)
            _, error = process.communicate(timeout=180)
            self.assertEqual(process.returncode, 130, error)
            self.assertTrue(eventually(self.nothing_left), error + self.what_is_left())
            os.remove(self.results)

    @unittest.skipUnless(os.path.exists("/sys/fs/cgroup/freezer"), "no control groups of version 1 that freeze")
    def test_load_that_cannot_be_killed_is_waited_for_and_told_of(self):
        """A frozen process does not even die of SIGKILL, as one in an uninterruptible call."""
        group = pathlib.Path(f"/sys/fs/cgroup/freezer/ontime-test-{os.getpid()}")
        group.mkdir()
        self.addCleanup(group.rmdir)
        process = self.loaded_run()
        for pid in self.load():
            (group / "cgroup.procs").write_text(str(pid))
        (group / "freezer.state").write_text("FROZEN")
        self.addCleanup((group / "freezer.state").write_text, "THAWED")
        process.send_signal(signal.SIGINT)
        error = ""
        for line in process.stderr:
            error += line
            if re.search("waiting for ontime on the .*stress-ng", line):
                break
        self.assertIsNone(process.poll(), "it left, and the load was still there: " + error)
        process.send_signal(signal.SIGINT)
        error += process.stderr.read()
        self.assertEqual(process.wait(180), 130, error)
        self.assertRegex(error, "stress-ng .* does not end")
        self.assertFalse(OUR_NAMESPACES & set(namespaces()), "all else is given back meanwhile")
        (group / "freezer.state").write_text("THAWED")
        self.assertTrue(eventually(lambda: not self.load()), self.what_is_left())
        self.run_ontime("run", self.scenario("50 ms", transports=["udp"]), "--only", "idle", "--results", self.results + ".next")

    def test_killed_load_is_noticed(self):
        process = self.start_ontime("run", self.scenario("10 s", transports=["udp"]), "--only", "loaded", "--results", self.results)
        self.started(process, lambda: self.samples_recorded() > 50 and len(self.load()) > 0)
        kill_at_once(*self.load())
        out, error = process.communicate(timeout=180)
        self.assertEqual(process.returncode, 0, error)
        self.assertIn("load", out)
        self.assertIn(False, [host["load_running"] for host in self.report()[0]["hosts"].values()])

    def start_pong(self, *arguments):
        """It answers by then: ping waits ten seconds for it, and until then a signal interrupts its start."""
        pong = self.start_ontime("pong", *arguments)
        self.assertTrue(any("pong answers" in line for line in pong.stderr))
        return pong

    def test_a_ping_that_fails_shows_what_it_measured(self):
        arguments = ["--transport", "udp", "--interface", "lo", "--domain", "78"]
        pong = self.start_pong(*arguments)
        ping = self.start_ontime("ping", *arguments, "--peer", "127.0.0.1", "--duration", "1 h", "--results", self.results)
        self.started(ping, lambda: self.samples_recorded() > 50)
        children = subprocess.run(["ps", "--ppid", str(ping.pid), "-o", "pid="], capture_output=True, text=True).stdout.split()
        os.kill(next(pid for pid in self.own("/ontime agent") if str(pid) in children), signal.SIGKILL)
        out, error = ping.communicate(timeout=180)
        pong.send_signal(signal.SIGINT)
        pong.communicate(timeout=180)
        self.assertEqual(ping.returncode, 3, error)
        self.assertIn("round trips in ms", out)
        self.assertIn("failed", out)

    def test_a_ping_that_fails_before_its_samples_came_keeps_its_run(self):
        arguments = ["--transport", "udp", "--interface", "lo", "--domain", "78"]
        pong = self.start_pong(*arguments)
        ping = self.start_ontime("ping", *arguments, "--peer", "127.0.0.1", "--duration", "1 h", "--schedule", "back-to-back",
                                 "--results", self.results)
        carried = {}  # by agents that had ended their warm-up, until then

        def packets():
            with open("/proc/net/dev") as devices:
                return next(int(line.split()[2]) for line in devices if line.split()[0] == "lo:")

        def begun():  # back-to-back: long before the first samples are handed over
            for pid in self.own("/ontime agent"):
                with contextlib.suppress(ProcessLookupError):
                    if os.sched_getscheduler(pid) == os.SCHED_BATCH:  # a client's, from `begin` on
                        carried.setdefault(pid, packets())
            return any(packets() > before + 500 for before in carried.values())

        self.started(ping, begun)
        (measuring,) = carried
        os.kill(measuring, signal.SIGKILL)
        out, error = ping.communicate(timeout=180)
        pong.send_signal(signal.SIGINT)
        pong.communicate(timeout=180)
        self.assertEqual(ping.returncode, 3, error)
        self.assertEqual(out, "", "no sample came: the error says all")
        self.assertIn("the agent of the controller", error)
        self.assertIn("the agent of the controller", self.report()[0]["error"])

    def test_a_pong_that_is_started_again_at_once_is_noted(self):
        arguments = ["--transport", "cyclonedds", "--interface", "lo", "--domain", "78"]
        pong = self.start_pong(*arguments)
        ping = self.start_ontime("ping", *arguments, "--duration", "1 h", "--results", self.results)
        self.started(ping, lambda: self.samples_recorded() > 50)
        pong.send_signal(signal.SIGINT)
        pong.communicate(timeout=180)
        pong = self.start_pong(*arguments)

        def noted():
            with contextlib.closing(sqlite3.connect(f"file:{self.results}?mode=ro", uri=True)) as database:
                return {kind for kind, in database.execute("SELECT kind FROM note")} & {"peer-left", "peer-flickered"}

        self.started(ping, noted)
        ping.send_signal(signal.SIGINT)
        out, error = ping.communicate(timeout=180)
        pong.send_signal(signal.SIGINT)
        pong.communicate(timeout=180)
        self.assertEqual(ping.returncode, 130, error)
        self.assertIsNone(self.report()[0]["error"])

    def test_a_host_that_does_not_come_back_costs_not_what_was_measured(self):
        way = pathlib.Path(self.folder, "way")
        way.write_text('#!/bin/sh\n[ -e "$0.gone" ] && exit 1\nexec "$@"\n')
        way.chmod(0o755)
        path = pathlib.Path(self.folder, "scenario.yaml")
        path.write_text("hosts: {component: {host-prefix: [%s], address: 127.0.0.1}}\ndefaults: {transport: udp, period: 5 ms}\n"
                        "runs: [{id: one, duration: 300 ms}, {id: two, duration: 1 h}, {id: three, duration: 300 ms}]\n" % way)
        junit = os.path.join(self.folder, "junit.xml")
        process = self.start_ontime("run", str(path), "--results", self.results, "--junit", junit)
        self.started(process, lambda: self.samples_recorded() > 150)
        self.assertEqual(xml.etree.ElementTree.parse(junit).getroot().get("errors"), "1", "if it is killed, no earlier verdict stays")
        pathlib.Path(f"{way}.gone").touch()
        kill_at_once(*self.keepers())
        out, error = process.communicate(timeout=180)
        self.assertEqual(process.returncode, 3, error)
        self.assertIn("ontime on the component's machine", error)
        self.assertIn("round trips in ms", out)
        self.assertEqual([(run["id"], run["complete"]) for run in self.report()], [("one", True), ("two", False)])
        self.assertTrue(os.path.exists(os.path.join(self.folder, "results.html")))
        self.assertEqual(xml.etree.ElementTree.parse(junit).getroot().get("errors"), "2", "the second, and what did not begin")

    def test_load_of_a_run_that_failed_is_not_the_next_ones(self):
        process = self.start_ontime("run", self.scenario("10 s", LOADED_FIRST, ["udp"]), "--results", self.results)
        self.started(process, lambda: self.samples_recorded() > 50 and len(self.load()) > 0)
        kill_at_once(*self.own("/ontime agent"))
        _, error = process.communicate(timeout=180)
        self.assertEqual(process.returncode, 3, error)
        failed, idle = self.report()
        self.assertFalse(failed["complete"])
        self.assertTrue(idle["complete"], error)
        self.assertEqual([host["load_running"] for host in idle["hosts"].values()], [None, None])

    def test_namespace_of_somebody_else_is_left_alone(self):
        subprocess.run(["ip", "netns", "add", "ontime-component"], check=True)
        try:
            answer = self.run_ontime("run", self.scenario("50 ms"), "--results", self.results)
            self.assertEqual(answer.returncode, 3, answer.stderr)
            self.assertIn("ontime-component", answer.stderr)
            self.assertEqual(namespaces(), ["ontime-component"])
        finally:
            subprocess.run(["ip", "netns", "del", "ontime-component"], check=True)

    def test_second_ontime_is_refused_while_the_first_holds_the_machine(self):
        first = self.start_ontime("run", self.scenario("1 h", transports=["udp"]), "--only", "idle", "--results", self.results)
        self.started(first, lambda: self.samples_recorded() > 10)
        second = self.run_ontime("run", self.scenario("50 ms", transports=["udp"]), "--only", "idle",
                                 "--results", os.path.join(self.folder, "second.ontime"))
        self.assertEqual(second.returncode, 3, second.stderr)
        self.assertTrue(OUR_NAMESPACES <= set(namespaces()), "the first one's are still there")
        first.send_signal(signal.SIGINT)
        first.communicate(timeout=180)

    # --- silence ---

    def loaded_run(self, transport="udp", prefix=()):
        process = self.start([*prefix, ONTIME, "run", self.scenario("1 h", transports=[transport]), "--only", "loaded",
                              "--results", self.results])
        self.started(process, lambda: self.samples_recorded() > 50 and len(self.load()) > 0)
        return process

    def assert_ended_and_kept(self, process, words):
        out, error = process.communicate(timeout=180)
        self.assertEqual(process.returncode, 3, error)
        self.assertRegex(error, words)
        run = self.report()[0]
        self.assertRegex(run["error"], words)
        self.assertGreater(run["sent"], 50)
        self.assertEqual(run["sent"], run["on_time"] + run["late"] + run["lost"])

    def test_agent_that_is_stopped_is_named_and_what_was_recorded_is_kept(self):
        process = self.loaded_run()
        os.kill(self.agent_in("ontime-component"), signal.SIGSTOP)
        self.assert_ended_and_kept(process, "the agent of the component was silent for 10 s")

    def test_keeper_that_is_stopped_is_named_and_its_machine_given_back(self):
        process = self.loaded_run()
        os.kill(self.keepers()[0], signal.SIGSTOP)
        self.assert_ended_and_kept(process, "ontime on the .* was silent for 10 s")

    def test_coordinator_that_is_stopped_is_left_alone_and_the_machine_given_back(self):
        process = self.loaded_run()
        process.send_signal(signal.SIGSTOP)
        self.assertTrue(eventually(self.nothing_left), self.what_is_left())
        process.send_signal(signal.SIGCONT)
        self.assert_ended_and_kept(process, "the coordinator .* was silent for 10 s")

    def agent_in(self, namespace):
        own = os.stat(f"/run/netns/{namespace}").st_ino
        return next(pid for pid in self.own("/ontime agent") if os.stat(f"/proc/{pid}/ns/net").st_ino == own)

    # --- signals ---

    def assert_interrupted_and_given_back(self):
        self.assertTrue(eventually(self.nothing_left), self.what_is_left())
        run = self.report()[0]
        self.assertTrue(run["interrupted"])
        self.assertIsNone(run["error"])
        self.assertEqual(set(run["hosts"]), {"controller", "component"})
        self.assertGreater(run["sent"], 50)

    def test_service_that_is_stopped_keeps_its_run(self):
        """As systemctl stop does: a SIGTERM to every process of the service at once."""
        process = self.loaded_run()
        for pid in processes_with("ONTIME_TEST=" + self.temporary):
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGTERM)
        process.communicate(timeout=180)
        self.assertEqual(process.returncode, 130)
        self.assert_interrupted_and_given_back()

    def test_service_that_is_stopped_leaves_what_is_under_way_its_time_out(self):
        arguments = ["--transport", "udp", "--interface", "lo", "--domain", "78"]
        pong = self.start_pong(*arguments)
        of_pong = [*self.own("/ontime agent"), pong.pid]
        ping = self.start_ontime("ping", *arguments, "--peer", "127.0.0.1", "--duration", "1 h", "--timeout", "15 s",
                                 "--results", self.results)
        self.started(ping, lambda: self.samples_recorded() > 50)
        of_ping = [pid for pid in processes_with("ONTIME_TEST=" + self.temporary) if pid not in of_pong]
        for pid in of_pong:
            os.kill(pid, signal.SIGKILL)
        time.sleep(2)  # in which a message is sent
        for pid in of_ping:
            os.kill(pid, signal.SIGTERM)
        out, error = ping.communicate(timeout=180)
        pong.communicate(timeout=180)
        self.assertEqual(ping.returncode, 130, error)
        run = self.report()[0]
        self.assertTrue(run["interrupted"])
        self.assertGreater(run["lost"], 0)
        self.assertEqual(run["sent"], self.samples_recorded())

    def test_pong_that_is_stopped_as_a_service_has_not_failed(self):
        process = self.start_pong("--transport", "udp", "--interface", "lo", "--domain", "78")
        # All of a service are told, one after the other: it may have left before its own turn comes.
        for pid in self.own("/ontime agent"):
            os.kill(pid, signal.SIGTERM)
        process.communicate(timeout=180)
        self.assertEqual(process.returncode, 0)

    def test_nohup_goes_on_when_the_terminal_closes(self):
        process = self.loaded_run(prefix=["nohup"])
        before = self.samples_recorded()
        process.send_signal(signal.SIGHUP)
        self.assertTrue(eventually(lambda: self.samples_recorded() > before + 100))
        self.assertIsNone(process.poll())
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=180)
        self.assertEqual(process.returncode, 130)

    def test_closed_terminal_keeps_the_run(self):
        """The session's leader goes: the kernel sends SIGHUP to the foreground, and writing to the terminal fails."""
        master, slave = os.openpty()
        command = [ONTIME, "run", self.scenario("1 h", transports=["udp"]), "--only", "loaded", "--results", self.results]

        def own_terminal():
            os.setsid()
            fcntl.ioctl(slave, termios.TIOCSCTTY, 0)

        process = subprocess.Popen(command, stdin=slave, stdout=slave, stderr=slave, env=self.environment,
                                   preexec_fn=own_terminal)
        self.addCleanup(process.kill)
        os.close(slave)
        self.started(process, lambda: self.samples_recorded() > 50 and len(self.load()) > 0)
        os.close(master)
        process.wait(timeout=180)
        self.assert_interrupted_and_given_back()

    def test_timeout_keeps_the_run(self):
        process = self.start(["timeout", "1h", ONTIME, "run", self.scenario("1 h", transports=["udp"]), "--only", "loaded",
                              "--results", self.results])
        self.started(process, lambda: self.samples_recorded() > 50)
        process.send_signal(signal.SIGALRM)  # its time is up
        process.communicate(timeout=180)
        self.assertEqual(process.returncode, 124)
        self.assert_interrupted_and_given_back()


if __name__ == "__main__":
    unittest.main(verbosity=2)
