#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The simulated machine of `ontime lab`, where there is QEMU: two machines measure the same by UDP, and a search is made in one.
All else that starts machines takes minutes: ONTIME_LAB=1 asks for it (scripts/test --lab). ONTIME names the program."""

import contextlib
import hashlib
import json
import os
import pathlib
import re
import shutil
import signal
import sqlite3
import subprocess
import threading
import time
import unittest

import search_kills
import search_lab
from program import ONTIME, TRANSPORTS, eventually, processes_with
from simulated import SCENARIO, THREE, Lab

ALL = os.environ.get("ONTIME_LAB") == "1"
of_all = unittest.skipUnless(ALL, "more machines are started by scripts/test --lab only")

LACKING = """
hosts: namespaces
defaults: {transport: udp, duration: 1 s, kernel: {governor: performance}}
runs:
  - id: governed
"""
LAUNCHED = """
hosts: namespaces
defaults:
  transport: [udp, ethernet]
  schedule: fixed
  duration: 500 ms
  realtime: on
  launch-time: 2 ms
  link:
    message-priority: 6
    qdisc: prio bands 2 priomap 1 1 1 1 1 1 0 1 1 1 1 1 1 1 1 1 below 1 etf clockid CLOCK_TAI delta 300000
runs:
  - id: kept
  - {id: past, link: {message-priority: 1}}
  - id: missed
    realtime: {send: {policy: other}}
    load: {controller: {cpu: 4}}
    launch-time: 60 us
    link:
      qdisc: prio bands 2 priomap 1 1 1 1 1 1 0 1 1 1 1 1 1 1 1 1 below 1 etf clockid CLOCK_TAI delta 40000
"""
BAD_LINK = """
hosts: namespaces
defaults: {transport: udp, duration: 2 s, realtime: on}
runs:
  - id: good
  - id: slow
    link: {delay: 2 ms}
  - id: lossy
    link: {loss: 10 %}
"""


def samples(results):
    """All of them, as one hash."""
    with contextlib.closing(sqlite3.connect(f"file:{results}?mode=ro", uri=True)) as database:
        rows = database.execute("SELECT * FROM sample ORDER BY run, message").fetchall()
    return len(rows), hashlib.sha256(repr(rows).encode()).hexdigest()


def arrivals(results, run):
    """When each message was there, after it was due, in µs: of two ends that have one clock."""
    with contextlib.closing(sqlite3.connect(f"file:{results}?mode=ro", uri=True)) as database:
        return [ns / 1000 for ns, in database.execute(
            "SELECT server_received_ns - start_ns - intended_ns - due_after_ns FROM sample JOIN run ON run.number = run"
            " WHERE run = ?", [run])]


def recorded(results):
    """How many runs; also while it is being written."""
    with contextlib.suppress(sqlite3.Error), contextlib.closing(sqlite3.connect(f"file:{results}?mode=ro", uri=True)) as database:
        return database.execute("SELECT count(*) FROM run WHERE outcome IS NOT NULL").fetchone()[0]
    return 0


@unittest.skipUnless(shutil.which("qemu-system-x86_64"), "there is no QEMU (Debian's package: qemu-system-x86)")
class Machines(Lab):
    def measured(self, name, *arguments):
        answer = self.lab("run", *arguments, "--results", self.results(name))
        if "is not available here" in answer.stderr:
            self.skipTest(answer.stderr)
        self.assertEqual(answer.returncode, 0, answer.stderr)
        return answer

    @contextlib.contextmanager
    def qemu_disturbed(self):
        """QEMU's other thread is woken all the time, also while the machine halts: by a signal that it takes for a timer's."""
        done = threading.Event()

        def disturb():
            while not done.wait(0.1):
                for pid, command in processes_with("ONTIME_TEST=" + self.temporary).items():
                    if "qemu-system-" not in command:
                        continue
                    with contextlib.suppress(OSError):
                        blocked = re.search(r"SigBlk:\s*(\w+)", pathlib.Path(f"/proc/{pid}/status").read_text()).group(1)
                        while int(blocked, 16) >> (signal.SIGALRM - 1) & 1 and not done.is_set():
                            os.kill(pid, signal.SIGALRM)
                            time.sleep(0.00002)

        thread = threading.Thread(target=disturb)
        thread.start()
        try:
            yield
        finally:
            done.set()
            thread.join()

    def test_two_machines_give_the_same_samples_whatever_else_this_one_does(self):
        # Twice, as the first run leaves the machine before the second begins.
        scenario = self.scenario("repeat: 2\n" + (SCENARIO % (",".join(TRANSPORTS) if ALL else "udp")).replace("2 s", "1 s"))
        answer = self.measured("first.ontime", scenario)
        self.assertIn("SIMULATED by QEMU", answer.stdout)
        with subprocess.Popen(["sh", "-c", "while :; do :; done"]) as busy, self.qemu_disturbed():
            try:
                self.measured("second.ontime", scenario)
            finally:
                busy.kill()
        first, second = samples(self.results("first.ontime")), samples(self.results("second.ontime"))
        self.assertGreater(first[0], 100)
        self.assertEqual(first, second)
        runs = self.report(self.results("first.ontime"))
        self.assertEqual(len(runs), 2 * (len(TRANSPORTS) if ALL else 1))
        for run in runs:
            machine = run["hosts"]["controller"]["machine"]
            self.assertEqual((machine["preemption"], machine["cpu_count"], machine["clocksource"]), ("rt", 1, "tsc"))
            self.assertIn("counted instructions", machine["simulated"])

    def search(self, *arguments, goal="p50 < 1 s", name="s.ontime", text=SCENARIO % "udp"):
        return [ONTIME, "tune", "search", self.scenario(text.replace("2 s", "500 ms")), "--goal", goal, "--on", "lab", "--results",
                self.results(name), "--format", "json", *arguments]

    def searched(self, *arguments, code=0, **others):
        done = subprocess.run(self.search(*arguments, **others), capture_output=True, text=True, cwd=self.folder, timeout=900,
                              env=self.environment)
        if "is not available here" in done.stderr:
            self.skipTest(done.stderr)
        self.assertEqual(done.returncode, code, done.stderr)
        return json.loads(done.stdout)

    def test_a_search_on_a_healthy_machine_changes_nothing_and_knows_what_that_machine_can_have(self):
        found = self.searched()
        self.assertEqual((found["end"], found["set"], len(found["trials"])), ("goal-holds", {}, 1))
        self.assertIn("counted instructions", found["simulated"])
        left_out = {one["key"] for one in found["left_out"]}
        self.assertNotIn("kernel.irq-threads", left_out)  # PREEMPT_RT has them
        self.assertIn("kernel.governor", left_out)
        self.assertIn("kernel.irq-cpus", left_out)  # it has one CPU
        for page in ("s.search.html", "s.html"):
            self.assertIn("SIMULATED", pathlib.Path(self.folder, page).read_text())
        # What ended needs no machine any more, and is of that machine alone.
        self.environment["PATH"] = self.instead_of_qemu("#!/bin/sh\nexit 1\n")
        again = self.searched("--resume")
        self.assertEqual((again["runs"], again["end"], again["trials"]), (found["runs"], found["end"], found["trials"]))
        here = subprocess.run([word for word in self.search("--resume") if word not in ("--on", "lab")], capture_output=True, text=True,
                              cwd=self.folder, timeout=60, env=self.environment)
        self.assertEqual(here.returncode, 2, here.stderr)
        self.assertIn("on another machine", here.stderr)

    @of_all
    def test_a_search_outlasts_an_interruption_and_a_kill(self):
        never_met = "p50 < 1 us"
        for number, (signalled, code) in enumerate(((signal.SIGINT, 130), (signal.SIGKILL, -signal.SIGKILL)), 1):
            before = recorded(self.results("s.ontime"))
            process = subprocess.Popen(self.search(*(["--resume"] if number > 1 else []), goal=never_met), cwd=self.folder,
                                       stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=self.environment)
            self.addCleanup(lambda process=process: (process.kill(), process.communicate()))
            self.assertTrue(eventually(lambda: recorded(self.results("s.ontime")) > before or process.poll() is not None, 600))
            process.send_signal(signalled)
            said, told = process.communicate(timeout=180)
            if "is not available here" in told:
                self.skipTest(told)
            self.assertEqual(process.returncode, code, told)
            if code == 130:
                found = json.loads(said)
                self.assertEqual((found["end"], found["why"]), ("no-time", "interrupted"))
                self.assertGreaterEqual(found["runs"], 1)
        subprocess.run([ONTIME, "tune", "revert"], env=self.environment, timeout=120)  # what was killed left its folder
        before = recorded(self.results("s.ontime"))
        found = self.searched("--resume", "--within", "12 s", goal=never_met, code=1)
        self.assertEqual(found["end"], "no-time")
        self.assertIn("--within", found["why"])
        self.assertGreater(found["runs"], before)
        numbers = search_kills.runs_of(pathlib.Path(self.results("s.ontime")))
        self.assertEqual(numbers, list(range(1, len(numbers) + 1)))

    @of_all
    def test_two_machines_make_the_same_search(self):
        text = search_lab.SCENARIO.format(title="the same", repeat=1) + "  - {id: one, realtime: on, kernel.irq-threads: other}\n"
        found = [self.searched(goal=search_lab.RESPONSE, name=name, text=text) for name in ("one.ontime", "two.ontime")]
        for one in found:
            del one["results"], one["page"]
        self.assertEqual(found[0], found[1])
        self.assertEqual((found[0]["end"], found[0]["set"]), ("goal-holds", {"kernel.irq-threads": "60"}))
        self.assertEqual(samples(self.results("one.ontime")), samples(self.results("two.ontime")))

    @of_all
    def test_two_cpus_in_turn_give_the_same_samples(self):
        scenario = self.scenario(SCENARIO % "udp")
        answer = self.lab("run", scenario, "--cpus", "2", "--results", self.results("first.ontime"))
        if "cannot boot 2 CPUs" in answer.stderr:
            self.skipTest(answer.stderr)
        self.assertEqual(answer.returncode, 0, answer.stderr)
        self.measured("second.ontime", scenario, "--cpus", "2")
        self.assertEqual(samples(self.results("first.ontime")), samples(self.results("second.ontime")))
        for run in self.report(self.results("second.ontime")):
            machine = run["hosts"]["controller"]["machine"]
            self.assertEqual(machine["cpu_count"], 2)
            self.assertIn("2 CPUs in turn", machine["simulated"])

    def test_too_little_memory_for_its_files(self):
        answer = self.lab("run", self.scenario(SCENARIO % "udp"), "--results", self.results(), "--memory", "512 MiB")
        if "is not available here" in answer.stderr:
            self.skipTest(answer.stderr)
        self.assertEqual(answer.returncode, 3, answer.stderr)
        self.assertRegex(answer.stderr, "has 512 MiB of memory.* [0-9]+ MiB of files need [0-9]+ MiB")

    def shell(self, script, *flags, variables=""):
        """What a script says in such a machine."""
        process = subprocess.Popen([ONTIME, "lab", "shell", "--with", script, *flags], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                                   stderr=subprocess.STDOUT, cwd=self.folder, env=self.environment)
        self.addCleanup(lambda: (process.kill(), process.communicate()))
        said = b""
        while not said.endswith(b"# "):
            part = os.read(process.stdout.fileno(), 4096)
            self.assertTrue(part, said)
            said += part
        answer, _ = process.communicate(f"{variables} bash {script}; exit\r".encode(), timeout=900)
        self.assertEqual(process.returncode, 0, answer)
        return answer.decode(errors="replace").replace("\r\033[K", "\n").replace("\r", "").splitlines()

    @of_all
    def test_settings_come_to_real_interrupt_threads_and_go_again_also_after_kill_9(self):
        seen = {}
        said = self.shell(pathlib.Path(__file__).with_name("lab_settings.sh"))
        for line in said:
            if found := re.fullmatch(r"(before|during|after|killed|reverted) (\S+(?: \S+)?)=(.+)", line):
                seen.setdefault(found[1], {})[found[2]] = found[3]
        text = "\n".join(said)
        self.assertIn("whole ended 0", said, text)
        self.assertIn("revert ended 0", said, text)
        self.assertIn("left ", said, text)
        for moment in ("during", "killed"):
            for nic in ("eth0", "eth1"):
                self.assertEqual(seen[moment][f"{nic} threaded"], "1", text)
                self.assertEqual(seen[moment][f"{nic} rx-usecs"], "10", text)
                self.assertEqual(seen[moment][f"{nic} generic-receive-offload"], "off", text)
                self.assertEqual(self.threads(seen[moment], f"irq/[0-9]+-{nic}.*"), ["FF 90"] * 3, text)
                self.assertEqual(self.threads(seen[moment], f"napi/{nic}-.*"), ["FF 61"], text)
            self.assertEqual(self.threads(seen[moment], "ksoftirqd/.*"), ["FF 60"], text)
        for moment in ("after", "reverted"):
            for thing, value in seen["before"].items():
                self.assertEqual(seen[moment][thing], value, text)
            self.assertLessEqual(set(self.threads(seen[moment], "irq/.*")), {"FF 50"}, text)
            self.assertLessEqual(set(self.threads(seen[moment], "napi/.*")), {"TS -"}, text)

    @staticmethod
    def threads(seen, pattern):
        return [value for thing, value in seen.items() if re.fullmatch(pattern, thing)]

    @of_all
    def test_frames_wait_in_disciplines_with_queues_and_carry_their_class_and_all_of_it_goes_again_also_after_kill_9(self):
        seen = {}
        said = self.shell(pathlib.Path(__file__).with_name("lab_link.sh"))
        for line in said:
            if found := re.fullmatch(r"(before|taprio|mqprio|cbs|after|killed|reverted) (\w+)=(.*)", line):
                seen.setdefault(found[1], {})[found[2]] = found[3]
        text = "\n".join(said)
        self.assertIn("revert ended 0", said, text)
        for kind in ("taprio", "mqprio", "cbs"):
            self.assertIn(f"{kind} whole ended 0", said, text)
            self.assertEqual((seen[kind]["wire"], seen[kind]["vlan"], seen[kind]["tagged"]), ("10Mbit", kind, "1"), text)
            self.assertGreater(int(seen[kind]["sent"]), 0, text)
        self.assertEqual((seen["killed"]["wire"], seen["killed"]["vlan"]), ("10Mbit", "taprio"), text)
        for moment in ("before", "after", "reverted"):
            self.assertEqual((seen[moment]["vlan"], seen[moment]["left"]), ("", "0 0"), text)

    @of_all
    def test_frames_of_every_transport_carry_the_class_of_messages_or_of_traffic(self):
        transports = [*TRANSPORTS, "ethernet"]
        seen = {}
        said = self.shell(pathlib.Path(__file__).with_name("lab_classes.sh"), variables=f"TRANSPORTS='{' '.join(transports)}'")
        for line in said:
            if found := re.fullmatch(r"(\w+) (\w+_\w+)=([0-9]+)", line):
                seen.setdefault(found[1], {}).setdefault(found[2], []).append(int(found[3]))
        text = "\n".join(said)
        for transport in transports:
            self.assertIn(f"{transport} ended 0", said, text)
            of = seen[transport]
            self.assertGreater(of["messages_6"][-1], 50, text)
            self.assertGreater(of["traffic_2"][-1], 10, text)
            # Until the priorities are given, discovery and the first of the traffic have none.
            begun = next(at for at, (messages, traffic) in enumerate(zip(of["messages_6"], of["traffic_2"])) if messages and traffic)
            # Once they are taken away, the end of a participant has none.
            ended = of["messages_6"].index(of["messages_6"][-1])
            for others in (of["messages_other"], of["traffic_other"]):
                self.assertEqual(others[begun], others[ended], text)

    @of_all
    def test_cpus_are_kept_by_a_partition_of_version_2_and_given_back_also_after_kill_9(self):
        seen = {}
        said = self.shell(pathlib.Path(__file__).with_name("lab_isolation.sh"), "--live")
        for line in said:
            if found := re.fullmatch(r"(before|during|after|killed|reverted|used|taken|pinned|refused) (\w+)=(.*)", line):
                seen.setdefault(found[1], {})[found[2]] = found[3]
        text = "\n".join(said)
        self.assertIn("whole ended 0", said, text)
        self.assertIn("revert ended 0", said, text)
        self.assertEqual(seen["before"]["others"], "0,1", text)
        during = seen["during"]
        self.assertEqual((during["partition"], during["others"], during["agents"]), ("root", "0", "1"), text)
        self.assertEqual((during["work"].lstrip("0"), during["interrupts"], during["limit"]), ("1", "0", "30000 100000 10"), text)
        self.assertTrue(during["load"].endswith("/ontime-load"), text)
        self.assertEqual(during["thread"], "0", text)
        self.assertNotEqual(seen["killed"]["groups"], seen["before"]["groups"], text)
        for moment in ("after", "reverted"):
            self.assertIn(seen[moment].pop("interrupts"), ("", "0-1"), "a NIC that is down has no interrupts")
        seen["refused"].pop("interrupts")
        del seen["before"]["interrupts"]
        for moment in ("after", "reverted", "refused"):
            self.assertEqual(seen[moment], seen["before"], text)
        words = " ".join(text.split())
        for run, code in (("used", 0), ("taken", 3), ("pinned", 3)):
            self.assertIn(f"{run} ended {code}", said, text)
        self.assertIn("left control group controller cpuset as it is: another program has changed it", words)
        self.assertIn("belong to other control groups: /sys/fs/cgroup/other", words)
        for moment in ("used", "taken"):
            self.assertEqual((seen[moment]["groups"], seen[moment]["controllers"], seen[moment]["others"]),
                             (seen["before"]["groups"], "cpuset", "0,1"), text)
        self.assertRegex(words, r"Linux before 6\.2 would forget: sleep \([0-9]+\)")
        self.assertEqual(seen["pinned"]["thread"], "0", text)

    @of_all
    def test_by_version_1_who_gives_himself_cpus_keeps_them_and_cpus_that_everybody_has_are_refused_where_there_are_more(self):
        said = self.shell(pathlib.Path(__file__).with_name("lab_isolation_v1.sh"), "--live", "--cpus", "3")
        text = "\n".join(said)
        for moment, bystander, groups in (("before", "0-2", "ontime-*"), ("during", "0,1", "ontime-rest ontime-robot"),
                                          ("after", "1", "ontime-*"), ("end", "1", "ontime-*")):
            self.assertIn(f"{moment} bystander={bystander} groups={groups}", said, text)
        for run, code in (("whole", 0), ("inherited", 3), ("free", 0)):
            self.assertIn(f"{run} ended {code}", said, text)
        self.assertIn("CPUs 1 cannot be reserved: all processes are bound to 0-1 of 0-2", " ".join(text.split()))

    @of_all
    def test_a_shell_that_is_killed_takes_its_machine_with_it(self):
        process = subprocess.Popen([ONTIME, "lab", "shell"], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                                   stderr=subprocess.STDOUT, cwd=self.folder, env=self.environment)
        self.addCleanup(process.communicate)
        self.assertTrue(eventually(lambda: any("qemu" in one for one in
                                               processes_with("ONTIME_TEST=" + self.temporary).values()), 300))
        process.kill()
        self.assertTrue(eventually(lambda: not processes_with("ONTIME_TEST=" + self.temporary)))
        subprocess.run([ONTIME, "tune", "revert"], env=self.environment, timeout=120)  # as whatever starts next does

    @of_all
    def test_what_the_machine_lacks_is_named(self):
        answer = self.lab("run", self.scenario(LACKING), "--results", self.results())
        self.assertEqual(answer.returncode, 3, answer.stderr)
        self.assertIn("kernel.governor: Linux does not control this machine's CPU frequency", answer.stderr)

    @of_all
    def test_a_link_is_as_bad_as_asked_for(self):
        self.measured("bad.ontime", self.scenario(BAD_LINK))
        good, slow, lossy = self.report(self.results("bad.ontime"))
        self.assertEqual((good["lost"], slow["lost"]), (0, 0))
        self.assertEqual(round((slow["round_trip_us"]["p50"] - good["round_trip_us"]["p50"]) / 1000), 4, "2 ms either way")
        self.assertGreater(lossy["lost"], 0)
        frames = [lossy["hosts"][host]["link"]["faults"]["lost_frames"] for host in ("controller", "component")]
        self.assertGreaterEqual(sum(frames), lossy["lost"])

    @of_all
    def test_a_message_leaves_at_its_launch_time_or_it_is_said_that_it_did_not(self):
        answer = self.lab("run", self.scenario(LAUNCHED), "--results", self.results(), "--full")
        self.assertEqual(answer.returncode, 3, answer.stderr)
        runs = self.report(self.results())
        self.assertEqual([(run["id"], run["transport"]) for run in runs],
                         [(id, transport) for id in ("kept", "past", "missed") for transport in ("udp", "ethernet")])
        for number, run in enumerate(runs[:2], 1):
            self.assertEqual((run["error"], run["sent"], run["lost"]), (None, 50, 0), answer.stderr)
            for host in ("controller", "component"):
                etf = run["hosts"][host]["link"]["etf"]
                self.assertGreaterEqual(etf["launched_frames"], 50)
                self.assertEqual(etf["dropped_frames"], 0)
            for arrived_us in arrivals(self.results(), number):
                self.assertTrue(1700 <= arrived_us < 2000, f"delta before it at most: {arrived_us} µs")
        for run in runs[2:4]:
            self.assertRegex(run["error"], r"launch-time .*\d+ messages, .*\d+ frames")
        for run in runs[4:]:  # an ordinary sender among others wakes later than that
            dropped = run["hosts"]["controller"]["link"]["etf"]["dropped_frames"]
            self.assertGreater(dropped, 0)
            self.assertEqual((run["error"], run["lost"]), (None, dropped))
            self.assertIn(f"etf dropped {dropped} frame", answer.stdout.replace("\n    ", " "))

    @of_all
    def test_traffic_that_ruins_best_effort_does_not_touch_a_window(self):
        tsn = pathlib.Path(__file__).parents[2] / "scenarios/lab/tsn.yaml"
        self.measured("tsn.ontime", str(tsn), "--only", "one-queue,windows", "--duration", "300 ms")
        queued, windows = self.report(self.results("tsn.ontime"))
        self.assertEqual((queued["sent"], queued["on_time"]), (30, 0))
        self.assertEqual((windows["sent"], windows["on_time"]), (30, 30))
        for run in (queued, windows):
            for rates in run["conditions"]["traffic"]["achieved"].values():
                self.assertGreater(rates["received_bit_s"], 4e6)

    def started(self, *arguments):
        process = subprocess.Popen([ONTIME, "lab", "run", *arguments, "--results", self.results()], cwd=self.folder,
                                   stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=self.environment)
        self.addCleanup(lambda: (process.kill(), process.communicate()))
        return process

    @of_all
    def test_interruption_before_the_first_run_leaves_no_results(self):
        process = self.started(self.scenario(SCENARIO % "udp"))
        self.assertTrue(eventually(lambda: any("qemu" in one for one in
                                               processes_with("ONTIME_TEST=" + self.temporary).values()), 300))
        process.send_signal(signal.SIGTERM)
        self.assertEqual(process.wait(180), 130)
        self.assertFalse(os.path.exists(self.results()))

    @of_all
    def test_runs_that_finished_outlast_an_interruption_and_a_kill(self):
        scenario = self.scenario(THREE)
        for number, (signalled, code) in enumerate(((signal.SIGINT, 130), (signal.SIGKILL, -signal.SIGKILL)), 1):
            process = self.started(scenario, *(["--resume"] if number > 1 else []))
            self.assertTrue(eventually(lambda: recorded(self.results()) == number or process.poll() is not None, 600))
            if "is not available here" in (text := process.communicate()[1] if process.poll() is not None else ""):
                self.skipTest(text)
            process.send_signal(signalled)
            self.assertEqual(process.wait(180), code, text)
            runs = self.report(self.results())
            self.assertEqual([run["id"] for run in runs], ["a", "b"][:number])
            self.assertEqual([(run["sent"], run["interrupted"]) for run in runs], [(50, False)] * number)
            if code == 130:
                self.assertIn("--resume", process.stdout.read())
        subprocess.run([ONTIME, "tune", "revert"], env=self.environment, timeout=120)  # what was killed left its folder
        self.measured("results.ontime", scenario, "--resume")
        self.assertEqual([(run["id"], run["sent"]) for run in self.report(self.results())], [("a", 50), ("b", 50), ("c", 50)])

    def test_qemu_yields_as_its_caller_does(self):
        real = shutil.which("qemu-system-x86_64")
        path = self.instead_of_qemu(f'#!/bin/sh\ncase "$*" in *-initrd*) nice; exit 1 ;; esac\nexec {real} "$@"\n')
        answer = subprocess.run(["nice", "-n", "7", ONTIME, "lab", "run", self.scenario(SCENARIO % "udp"), "--results", self.results()],
                                capture_output=True, text=True, cwd=self.folder, timeout=900, env=dict(self.environment, PATH=path))
        if "is not available here" in answer.stderr:
            self.skipTest(answer.stderr)
        self.assertRegex(answer.stderr, r"of QEMU:\s+\| %d\n" % min(os.nice(0) + 7, 19))

    @of_all
    def test_a_machine_that_does_not_come_up_shows_its_console(self):
        real = shutil.which("qemu-system-x86_64")
        path = self.instead_of_qemu(f"""#!/usr/bin/env python3
import os, sys
words = sys.argv[1:]
if "-initrd" in words:
    at = words.index("-initrd")
    del words[at:at + 2]
os.execv("{real}", ["{real}", *words])
""")
        answer = self.lab("run", self.scenario(SCENARIO % "udp"), "--results", self.results(), PATH=path)
        self.assertEqual(answer.returncode, 3, answer.stderr)
        self.assertIn("The last lines of its console", answer.stderr)
        self.assertIn("VFS: Unable to mount root fs", answer.stderr)


if __name__ == "__main__":
    unittest.main()
