#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The real program between two network namespaces, with real DDS and real stress-ng; and what becomes of it
when it is killed, cut off, or has no room left. Needs root, and skips without. ONTIME names the program."""

import contextlib
import fcntl
import json
import os
import pathlib
import shutil
import signal
import sqlite3
import subprocess
import tempfile
import termios
import time
import unittest

ONTIME = os.environ["ONTIME"]
TRANSPORTS = os.environ.get("ONTIME_TEST_TRANSPORTS", "udp,cyclonedds,fastdds").split(",")

SCENARIO = """
hosts: namespaces
defaults: {transport: [%s], period: 5 ms, duration: %s}
runs:
  - id: idle
  - id: loaded
    realtime: on
    load:
      controller: {cpu: 1, vm: 1, io: 1, hdd: 1, vm-bytes: 16 MiB, hdd-bytes: 16 MiB}
      component: {cpu: 1}
"""

LOADED_FIRST = """
hosts: namespaces
defaults: {transport: [%s], period: 5 ms, duration: %s}
runs:
  - id: loaded
    load: {controller: {cpu: 1}}
  - id: idle
"""


def processes_with(word):
    """Living processes, as {pid: command line}, that were started with this text in their environment: a test's own,
    and nobody else's."""
    found = {}
    for entry in pathlib.Path("/proc").iterdir():
        if not entry.name.isdigit():
            continue
        try:
            environment = (entry / "environ").read_bytes().decode(errors="replace")
            command = (entry / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
            state = (entry / "stat").read_text().rsplit(")", 1)[1].split()[0]
        except (OSError, IndexError):
            continue
        if word in environment and state != "Z":
            found[int(entry.name)] = command
    return found


def eventually(true, seconds=5):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if true():
            return True
        time.sleep(0.05)
    return true()


def namespaces():
    return [line.split()[0] for line in
            subprocess.run(["ip", "netns", "list"], capture_output=True, text=True, check=True).stdout.splitlines()]


OUR_NAMESPACES = {"ontime-controller", "ontime-component"}


@unittest.skipUnless(os.geteuid() == 0, "network namespaces need root")
class System(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.mkdtemp(prefix="ontime-test-")
        self.addCleanup(shutil.rmtree, self.folder)
        self.results = os.path.join(self.folder, "results.ontime")
        # What load and agents of this test are known by.
        self.temporary = os.path.join(self.folder, "tmp")
        os.mkdir(self.temporary)
        self.environment = dict(os.environ, TMPDIR=self.temporary)

    def tearDown(self):
        self.assertTrue(eventually(self.nothing_left), self.what_is_left())

    def own(self, word):
        return [pid for pid, command in processes_with("TMPDIR=" + self.temporary).items() if word in command]

    def agents(self):
        return [*self.own("/ontime agent"), *self.own("/ontime keeper")]

    def keepers(self):
        return self.own("/ontime keeper")

    def load(self):
        return self.own("stress-ng")

    def what_is_left(self):
        return (f"agents and keepers {self.agents()}, load {self.load()}, traffic {self.traffic()}, namespaces {namespaces()}, "
                f"files {os.listdir(self.temporary)}")

    def nothing_left(self):
        return not (self.agents() or self.load() or self.traffic() or OUR_NAMESPACES & set(namespaces()) or os.listdir(self.temporary))

    def scenario(self, duration="1 s", text=SCENARIO, transports=None):
        path = os.path.join(self.folder, "scenario.yaml")
        pathlib.Path(path).write_text(text % (", ".join(transports or TRANSPORTS), duration))
        return path

    def run_ontime(self, *arguments, **options):
        return subprocess.run([ONTIME, *arguments], capture_output=True, text=True, env=self.environment,
                              timeout=120, **options)

    def start_ontime(self, *arguments):
        return self.start([ONTIME, *arguments])

    def start(self, command):
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                                   env=self.environment)
        self.addCleanup(lambda: (process.kill(), process.communicate()))  # of a test that failed
        return process

    def report(self):
        answer = self.run_ontime("report", self.results, "--format", "json")
        self.assertEqual(answer.returncode, 0, answer.stderr)
        return json.loads(answer.stdout)["runs"]

    def started(self, process, condition):
        self.assertTrue(eventually(condition, 30), process.poll())

    # --- the main job ---

    def test_scenario_between_two_namespaces(self):
        answer = self.run_ontime("run", self.scenario(), "--results", self.results)
        self.assertEqual(answer.returncode, 0, answer.stderr)
        runs = self.report()
        self.assertEqual([(run["id"], run["transport"]) for run in runs],
                         [(i, t) for i in ("idle", "loaded") for t in TRANSPORTS])
        for run in runs:
            with self.subTest(id=run["id"], transport=run["transport"]):
                self.assertTrue(run["complete"])
                self.assertGreater(run["sent"], 0)
                self.assertEqual(run["sent"], run["on_time"] + run["late"] + run["lost"])
                self.assertEqual(run["dropped_records"], 0)
                self.assertEqual(run["duplicates"] + run["strays"], 0)
                times = [run["round_trip_us"][key] for key in ("min", "p50", "p90", "p99", "p99.9", "max")]
                self.assertEqual(times, sorted(times))
                self.assertEqual(run["realtime"], run["id"] == "loaded")
                for host in ("controller", "component"):
                    self.assertEqual(run["hosts"][host]["transport"]["facts"]["carrier"], "UDPv4")
                    self.assertTrue(run["hosts"][host]["transport"]["facts"]["address"].startswith("198.18.0."))
        with contextlib.closing(sqlite3.connect(self.results)) as database:
            self.assertEqual(database.execute("SELECT count(*) FROM sample").fetchone()[0],
                             sum(run["sent"] for run in runs))

    def test_settings_are_as_the_kernel_says(self):
        answer = self.run_ontime("run", self.scenario(), "--only", "loaded", "--results", self.results)
        self.assertEqual(answer.returncode, 0, answer.stderr)
        for run in self.report():
            for host in ("controller", "component"):
                with self.subTest("discovery is silent while it measures", transport=run["transport"], host=host):
                    sent = run["sent"] if host == "controller" else run["sent"] - run["lost"]
                    self.assertLess(run["hosts"][host]["link"]["sent_packets"], sent + 60)
                threads = run["hosts"][host]["threads"]
                roles = {thread["role"] for thread in threads}
                self.assertIn("receive", roles)
                self.assertTrue(host == "component" or "send" in roles)
                for thread in threads:
                    with self.subTest(transport=run["transport"], host=host, thread=thread["name"]):
                        wanted = 80 if thread["role"] in ("send", "receive", "delivery") else 70
                        self.assertEqual((thread["policy"], thread["priority"]), ("fifo", wanted))
                        self.assertEqual(thread["major_faults"], 0)
                        if thread["role"] in ("send", "receive"):
                            self.assertEqual(thread["minor_faults"], 0)

    def test_traffic_takes_the_link_and_no_other(self):
        """Loopback carries nothing but the datagram by which Cyclone DDS wakes its own threads at the end."""
        process = self.start_ontime("run", self.scenario("2 s"), "--only", "idle", "--results", self.results)
        self.started(process, lambda: OUR_NAMESPACES <= set(namespaces()) and self.agents())
        others = {}

        def bytes_of(name):
            text = subprocess.run(["ip", "netns", "exec", name, "cat", "/proc/net/dev"], capture_output=True, text=True).stdout
            return {line.split(":")[0].strip(): int(line.split(":")[1].split()[0]) for line in text.splitlines()[2:]}

        while process.poll() is None:
            for name in OUR_NAMESPACES:
                for interface, count in bytes_of(name).items():
                    others[(name, interface)] = count
            time.sleep(0.2)
        process.communicate()
        self.assertEqual(process.returncode, 0)
        self.assertGreater(max(c for (_, i), c in others.items() if i != "lo"), 100_000)
        self.assertLess(sum(c for (_, i), c in others.items() if i == "lo"), 1000)

    def test_ping_and_pong_start_in_any_order_and_come_and_go(self):
        arguments = ["--transport", "udp", "--interface", "lo", "--domain", "77"]
        ping = self.start_ontime("ping", *arguments, "--peer", "127.0.0.1", "--duration", "300 ms", "--format", "json")
        time.sleep(0.3)
        pong = self.start_ontime("pong", *arguments)
        try:
            out, error = ping.communicate(timeout=60)
            self.assertEqual(ping.returncode, 0, error)
            self.assertEqual(json.loads(out)["runs"][0]["lost"], 0)
            again = self.run_ontime("ping", *arguments, "--peer", "127.0.0.1", "--duration", "300 ms", "--realtime",
                                    "--results", self.results)
            self.assertEqual(again.returncode, 0, again.stderr)
            self.assertTrue(self.report()[0]["realtime"], "a switch that stands alone says on")
            with open("/dev/full", "w") as full:
                for stream, code in (("stderr", 0), ("stdout", 3)):
                    streams = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, stream: full}
                    answer = subprocess.run([ONTIME, "ping", *arguments, "--peer", "127.0.0.1", "--duration", "50 ms"],
                                            **streams, timeout=60)
                    self.assertEqual(answer.returncode, code, stream)
        finally:
            pong.send_signal(signal.SIGINT)
            out, _ = pong.communicate(timeout=30)
        self.assertEqual(pong.returncode, 130)
        self.assertRegex(out, r"answered \d\d+ messages")

    # --- concurrent traffic ---

    TRAFFIC = """
hosts: namespaces
defaults: {transport: [%s], period: 5 ms, duration: %s, traffic: {rate: 8 Mbit/s}}
runs:
  - id: both
  - {id: one-way, traffic: {direction: to-controller, datagram: 200 B, priority: 1}}
  - {id: too-much, traffic: {rate: 100 Gbit/s, direction: to-component}}
"""

    def traffic(self):
        return self.own("iperf3")

    def test_traffic_flows_and_what_arrived_is_told(self):
        scenario = self.scenario("3 s", text=self.TRAFFIC, transports=["udp"])
        answer = self.run_ontime("run", scenario, "--only", "both,one-way", "--results", self.results)
        self.assertEqual(answer.returncode, 0, answer.stderr)
        both, one_way = self.report()
        self.assertEqual(set(both["conditions"]["traffic"]["achieved"]), {"to_component", "to_controller"})
        self.assertEqual(set(one_way["conditions"]["traffic"]["achieved"]), {"to_controller"})
        for run in (both, one_way):
            self.assertIsNone(run["error"])
            for way, rates in run["conditions"]["traffic"]["achieved"].items():
                with self.subTest(run=run["id"], way=way):
                    self.assertGreater(rates["received_bit_s"], 1e6)
                    self.assertTrue(rates["running"])
                    # It went over the link under test: the kernel counted it there.
                    carried = run["hosts"][way.removeprefix("to_")]["link"]["received_bytes"]
                    self.assertGreater(carried, rates["received_bit_s"] / 8 * 2)

    def test_traffic_that_was_not_there_is_said_loudly(self):
        scenario = self.scenario("2 s", text=self.TRAFFIC, transports=["udp"])
        answer = self.run_ontime("run", scenario, "--only", "too-much", "--results", self.results)
        self.assertEqual(answer.returncode, 0, answer.stderr)
        self.assertIn("of 1e+05 Mbit/s", answer.stderr)
        self.assertIn("NOT", answer.stderr)
        self.assertIn("NOT THE TRAFFIC THAT WAS ASKED FOR", answer.stdout)
        self.assertTrue(self.report()[0]["conditions"]["traffic"]["achieved"]["to_component"]["short"])

    def test_traffic_dies_with_who_started_it(self):
        for whom in (lambda process: [process.pid], lambda _: self.keepers()):
            process = self.start_ontime("run", self.scenario("1 h", text=self.TRAFFIC, transports=["udp"]), "--only", "both",
                                        "--results", self.results)
            self.started(process, lambda: self.samples_recorded() > 50 and len(self.traffic()) == 4)
            for pid in whom(process):
                os.kill(pid, signal.SIGKILL)
            process.communicate(timeout=30)
            self.assertTrue(eventually(self.nothing_left, 5), self.what_is_left())
            os.remove(self.results)

    def test_traffic_that_died_is_noticed(self):
        process = self.start_ontime("run", self.scenario("3 s", text=self.TRAFFIC, transports=["udp"]), "--only", "one-way",
                                    "--results", self.results)
        self.started(process, lambda: self.samples_recorded() > 50 and len(self.traffic()) == 2)
        for pid in self.traffic():
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        out, error = process.communicate(timeout=60)
        self.assertEqual(process.returncode, 0, error)
        self.assertIn("iperf3 had died", error)

    # --- the link's faults ---

    FAULTS = """
hosts: namespaces
defaults: {transport: [%s], period: 5 ms, timeout: 100 ms, duration: %s}
runs:
  - {id: lossy, link: {loss: 10 %%}}
  - {id: double, link: {duplicate: 50 %%}}
  - {id: cut, link: {cut: 1 s for 500 ms}}
  - {id: slow, link: {delay: 2 ms}}
  - {id: busy, link: {loss: 10 %%}, traffic: {rate: 4 Mbit/s}}
"""

    def test_faults_of_the_link_lose_double_and_cut_and_each_loss_has_its_place(self):
        scenario = self.scenario("3 s", text=self.FAULTS, transports=["udp"])
        answer = self.run_ontime("run", scenario, "--only", "lossy,double,cut,busy", "--results", self.results)
        self.assertEqual(answer.returncode, 0, answer.stderr)
        lossy, double, cut, busy = self.report()
        for run in (lossy, double, cut, busy):
            self.assertIsNone(run["error"])
            self.assertIsNone(run["link_unproved"])
            self.assertEqual(run["sent"], run["on_time"] + run["late"] + run["lost"])
        ours = sum(host["link"]["faults"]["lost_frames"] for host in lossy["hosts"].values())
        self.assertGreater(ours, 0)
        self.assertLessEqual(lossy["lost"], ours)
        self.assertIn("lost by link.loss", answer.stdout)
        self.assertGreater(double["duplicates"], 0)
        self.assertEqual(double["lost"], 0)
        self.assertGreater(cut["lost"], 0)
        self.assertEqual([note["kind"] for note in cut["notes"]], ["link-cut", "link-back"])
        gone, back = (note["at_s"] for note in cut["notes"])
        self.assertAlmostEqual(back - gone, 0.5)
        with contextlib.closing(sqlite3.connect(self.results)) as database:
            lost = [row[0] for row in database.execute(
                "SELECT intended_ns / 1e9 FROM sample WHERE run = ? AND fate = 2", (cut["run"],))]
        self.assertTrue(lost and all(gone - 0.2 < at < back + 0.05 for at in lost), (gone, back, lost))

    def test_fault_that_the_kernel_has_not_is_refused_before_anything_is_run(self):
        scenario = self.scenario("3 s", text=self.FAULTS, transports=["udp"])
        answer = self.run_ontime("run", scenario, "--results", self.results)
        if answer.returncode == 0:
            self.skipTest("this kernel has netem")
        self.assertEqual(answer.returncode, 3, answer.stderr)
        self.assertRegex(answer.stderr, r"scenario.yaml:8: run 'slow': link.delay")
        self.assertIn("sch_netem", answer.stderr)
        self.assertEqual(self.report(), [])

    def test_faults_need_a_link_of_their_own(self):
        text = self.FAULTS.replace("namespaces", "loopback")
        answer = self.run_ontime("run", self.scenario("1 s", text=text, transports=["udp"]), "--only", "lossy",
                                 "--results", self.results)
        self.assertEqual(answer.returncode, 3, answer.stderr)
        self.assertIn("loopback", answer.stderr)

    def test_faults_on_somebody_elses_namespaces_are_given_back_whoever_is_killed(self):
        """There the namespaces stay, and what was done to them must not."""
        for command in ("netns add ot-left", "netns add ot-right", "link add ot-l netns ot-left type veth peer name ot-r netns ot-right",
                        "-n ot-left addr add 198.18.7.1/30 dev ot-l", "-n ot-right addr add 198.18.7.2/30 dev ot-r",
                        "-n ot-left link set ot-l up", "-n ot-right link set ot-r up"):
            subprocess.run(["ip", *command.split()], check=True)
        try:
            hosts = """{controller: {place: [ip, netns, exec, ot-left], interface: ot-l, address: 198.18.7.1},
                        component: {place: [ip, netns, exec, ot-right], interface: ot-r, address: 198.18.7.2}}"""
            text = self.FAULTS.replace("hosts: namespaces", "hosts: " + hosts)
            ours = ["run", self.scenario("1 h", text=text, transports=["udp"]), "--only", "busy", "--results", self.results]

            def tables():
                return "".join(subprocess.run(["ip", "netns", "exec", name, "nft", "list", "tables"], capture_output=True,
                                              text=True, check=True).stdout for name in ("ot-left", "ot-right"))

            for whom in (lambda process: [process.pid], lambda _: self.keepers()):
                process = self.start_ontime(*ours)
                self.assertTrue(eventually(lambda: self.samples_recorded() > 50, 30),
                                process.poll() is not None and process.communicate())
                self.assertIn("table netdev ontime-controller", tables())
                self.assertIn("table inet ontime-component", tables())
                for pid in whom(process):
                    os.kill(pid, signal.SIGKILL)
                process.communicate(timeout=30)
                self.assertTrue(eventually(lambda: not tables(), 5), tables())
                self.assertTrue(eventually(self.nothing_left, 5), self.what_is_left())
                os.remove(self.results)
            process = self.start_ontime(*ours)
            self.started(process, lambda: self.samples_recorded() > 50)
            for pid in [process.pid, *self.agents()]:
                os.kill(pid, signal.SIGKILL)
            process.communicate(timeout=30)
            self.assertIn("ontime-controller", tables())
            ours[1] = self.scenario("100 ms", text=text, transports=["udp"])
            answer = self.run_ontime(*ours)
            self.assertIn("nft-table", answer.stderr)
            self.assertEqual(tables(), "")
        finally:
            for name in ("ot-left", "ot-right"):
                subprocess.run(["ip", "netns", "del", name], check=True)

    # --- long runs ---

    def resident_bytes(self):
        """Of all processes of this test's ontime."""
        total = 0
        for pid in processes_with("TMPDIR=" + self.temporary):
            with contextlib.suppress(OSError):
                total += int(pathlib.Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGESIZE")
        return total

    def test_memory_is_flat_however_many_messages(self):
        """Back to back, so that hours of messages pass in seconds."""
        text = SCENARIO.replace("period: 5 ms", "schedule: back-to-back")
        process = self.start_ontime("run", self.scenario("1 h", text=text, transports=["udp"]), "--only", "idle",
                                    "--results", self.results)
        # They come in bursts, of half a ring each: the first few show what is ever held at once.
        self.assertTrue(eventually(lambda: self.samples_recorded() > 300_000, 120), process.poll())
        before, bytes_before = self.samples_recorded(), self.resident_bytes()
        self.assertTrue(eventually(lambda: self.samples_recorded() > before + 600_000, 120), process.poll())
        grown = self.resident_bytes() - bytes_before
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=60)
        self.assertLess(grown, 600_000 * 88 / 2, "of samples that are kept somewhere")

    # --- suites ---

    def suite(self):
        folder = pathlib.Path(self.folder, "suite")
        folder.mkdir(exist_ok=True)
        for name in ("one", "two"):
            (folder / f"{name}.yaml").write_text(
                "hosts: namespaces\nrepeat: 2\ndefaults: {transport: [udp], period: 5 ms, duration: 2 s}\n"
                f"runs: [{{id: {name}}}]\n")
        return folder

    def test_folder_is_run_in_order_and_goes_on_where_it_was_interrupted(self):
        folder = self.suite()
        process = self.start_ontime("run", str(folder), "--results", self.results, "--resume")
        self.started(process, lambda: len(self.recorded()) == 2)
        process.send_signal(signal.SIGTERM)
        _, error = process.communicate(timeout=60)
        self.assertEqual(process.returncode, 130, error)
        self.assertIn("4 runs, about 16 s", error)
        self.assertEqual([run["complete"] for run in self.report()], [True, False])
        answer = self.run_ontime("run", str(folder), "--results", self.results, "--resume")
        self.assertEqual(answer.returncode, 0, answer.stderr)
        self.assertRegex(answer.stderr, r"\[1/4, 16 s left\] one udp +is done already")
        self.assertEqual([(run["id"], run["repetition"]) for run in self.report() if run["complete"]],
                         [("one", 1), ("one", 2), ("two", 1), ("two", 2)])
        # What is asked otherwise is not done: neither a text that was changed, nor another duration.
        (folder / "two.yaml").write_text((folder / "two.yaml").read_text() + "# changed\n")
        answer = self.run_ontime("run", str(folder), "--results", self.results, "--resume")
        self.assertEqual(answer.stderr.count("is done already"), 2, answer.stderr)
        answer = self.run_ontime("run", str(folder), "--results", self.results, "--resume", "--duration", "1 s")
        self.assertEqual(answer.stderr.count("is done already"), 0, answer.stderr)
        # And what another machine did is nothing of this suite.
        with contextlib.closing(sqlite3.connect(self.results)) as database:
            database.execute("UPDATE run SET outcome = json_set(outcome, '$.hosts.component.machine.hostname', 'other')")
            database.commit()
        answer = self.run_ontime("run", str(folder), "--results", self.results, "--resume")
        self.assertEqual(answer.returncode, 2, answer.stderr)
        self.assertIn("another machine", answer.stderr)

    def recorded(self):
        if not os.path.exists(self.results):
            return []
        try:
            with contextlib.closing(sqlite3.connect(f"file:{self.results}?mode=ro", uri=True)) as database:
                return database.execute("SELECT number FROM run").fetchall()
        except sqlite3.Error:
            return []

    def test_scenarios_are_shown_with_a_line_each_and_found_by_name(self):
        answer = self.run_ontime("scenarios")
        self.assertEqual(answer.returncode, 0, answer.stderr)
        self.assertRegex(answer.stdout, r"(?m)^paper/test5 +The paper's Test 5, twelve hours: 6 runs, 72 h")
        shown = json.loads(self.run_ontime("scenarios", "--format", "json").stdout)
        self.assertIn("demo", [line["name"] for line in shown])
        self.assertTrue(all(line["error"] is None for line in shown), shown)
        answer = self.run_ontime("run", "paper/test1", "--only", "Test1.A", "--transports", "udp", "--duration", "100 ms",
                                 "--results", self.results)
        self.assertEqual(answer.returncode, 0, answer.stderr)
        self.assertIn("paper's DDS 1", answer.stdout)
        broken = pathlib.Path(self.folder, "broken.yaml")
        broken.write_text("runs: 5\n")
        answer = self.run_ontime("scenarios", str(broken))
        self.assertIn("cannot be run", answer.stdout)
        self.assertEqual(self.run_ontime("run", "no-such-thing").returncode, 2)

    # --- wrong input ---

    def test_wrong_input_is_said_and_nothing_is_made(self):
        other = os.path.join(self.folder, "other.txt")
        pathlib.Path(other).write_text("not a results file" * 100)
        newer = os.path.join(self.folder, "newer.ontime")
        self.run_ontime("run", self.scenario("50 ms", transports=["udp"]), "--only", "idle", "--results", newer)
        with contextlib.closing(sqlite3.connect(newer)) as database:
            database.execute("PRAGMA user_version = 999")
        scenario = self.scenario("50 ms", transports=["udp"])
        cases = [
            (["report", other], 2, "results file"),
            (["report", newer], 2, "newer"),
            (["report", os.path.join(self.folder, "none.ontime")], 2, "none.ontime"),
            (["run", scenario, "--results", other], 2, "results file"),
            (["run", scenario, "--results", os.path.join(self.folder, "no", "such", "x.ontime")], None, "x.ontime"),
            (["run", scenario, "--only", "nix"], 2, "nix"),
            (["run", scenario, "--transports", "telepathy", "--results", self.results], 3, "telepathy"),
            (["run", os.path.join(self.folder, "none.yaml")], 2, "none.yaml"),
            (["ping", "--transport", "udp", "--payload", "70 kB", "--peer", "127.0.0.1"], 2, "65475"),
            (["ping", "--transport", "udp", "--interface", "nonet0", "--peer", "127.0.0.1"], 2, "nonet0"),
            (["ping", "--transport", "cyclonedds", "--interface", "lo", "--domain", "99", "--wait", "500 ms"], 3, "no pong"),
            (["ping", "--transport", "udp", "--peer", "127.0.0.1", "--period", ""], 2, "--period"),
            (["ping", "--transport", "udp", "--peer", "127.0.0.1", "--interface", ""], 2, "--interface"),
            (["ping", "--transport", "udp", "--peer", "127.0.0.1", "--results", ""], 2, "--results"),
            (["ping", "--transport", "udp", "--peer", ""], 2, "--peer"),
            (["ping", "--transport", "udp", "--peer", "127.0.0.1", "--timeout", "99999 h"], 2, "--timeout"),
            (["run", scenario, "--transports", "udp,foo"], 3, "foo"),
            (["ping"], 2, "transport"),
            ([], 2, ""),
            (["dance"], 2, ""),
        ]
        for arguments, code, word in cases:
            with self.subTest(arguments=arguments):
                answer = self.run_ontime(*arguments, cwd=self.folder)
                if code is None:
                    self.assertIn(answer.returncode, (2, 3))
                else:
                    self.assertEqual(answer.returncode, code, answer.stderr)
                self.assertIn(word, answer.stderr + answer.stdout)
                self.assertNotIn("terminate called", answer.stderr)
        self.assertEqual(pathlib.Path(other).read_text(), "not a results file" * 100)

    # --- faults ---

    def interrupted(self, times):
        process = self.start_ontime("run", self.scenario("1 h", transports=["udp"]), "--only", "loaded", "--results", self.results)
        self.started(process, lambda: self.samples_recorded() > 50)
        for _ in range(times):
            process.send_signal(signal.SIGINT)
            time.sleep(0.05)
        out, error = process.communicate(timeout=30)
        self.assertEqual(process.returncode, 130, error)
        return out

    def samples_recorded(self):
        if not os.path.exists(self.results):
            return 0
        try:
            with contextlib.closing(sqlite3.connect(f"file:{self.results}?mode=ro", uri=True)) as database:
                return database.execute("SELECT count(*) FROM sample").fetchone()[0]
        except sqlite3.Error:
            return 0

    def test_interrupted_once_it_stops_and_reports(self):
        out = self.interrupted(1)
        self.assertIn("udp", out)
        run = self.report()[0]
        self.assertTrue(run["interrupted"])
        self.assertEqual(run["sent"], run["on_time"] + run["late"] + run["lost"])
        self.assertEqual(run["sent"], self.samples_recorded())

    def test_interrupted_twice_it_leaves_and_keeps_what_it_had(self):
        self.interrupted(2)
        self.assertGreater(self.samples_recorded(), 50)

    def killed(self, whom):
        process = self.start_ontime("run", self.scenario("1 h", transports=["cyclonedds"]), "--only", "loaded", "--results", self.results)
        self.started(process, lambda: self.samples_recorded() > 50 and len(self.load()) > 0)
        before = self.samples_recorded()
        for pid in whom(process):
            os.kill(pid, signal.SIGKILL)
        process.communicate(timeout=30)
        self.assertTrue(eventually(lambda: not self.load() and not self.agents(), 5), self.what_is_left())
        self.assertTrue(eventually(lambda: not OUR_NAMESPACES & set(namespaces()), 5), self.what_is_left())
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
        for pid in [process.pid, *self.agents()]:
            os.kill(pid, signal.SIGKILL)
        process.communicate(timeout=30)
        self.assertTrue(eventually(lambda: not self.load(), 5), self.what_is_left())
        answer = self.run_ontime("run", self.scenario("50 ms", transports=["udp"]), "--only", "idle", "--results", self.results)
        self.assertEqual(answer.returncode, 0, answer.stderr)
        self.assertIn("ontime-controller", answer.stderr)  # it says what it found and cleared

    def test_killed_load_is_noticed(self):
        process = self.start_ontime("run", self.scenario("3 s", transports=["udp"]), "--only", "loaded", "--results", self.results)
        self.started(process, lambda: self.samples_recorded() > 50 and len(self.load()) > 0)
        for pid in self.load():
            try:
                os.kill(pid, signal.SIGKILL)
            except ProcessLookupError:
                pass
        out, error = process.communicate(timeout=60)
        self.assertEqual(process.returncode, 0, error)
        self.assertIn("load", out)
        self.assertIn(False, [host["load_running"] for host in self.report()[0]["hosts"].values()])

    def test_load_of_a_run_that_failed_is_not_the_next_ones(self):
        process = self.start_ontime("run", self.scenario("3 s", LOADED_FIRST, ["udp"]), "--results", self.results)
        self.started(process, lambda: self.samples_recorded() > 50 and len(self.load()) > 0)
        for pid in self.own("/ontime agent"):
            os.kill(pid, signal.SIGKILL)
        _, error = process.communicate(timeout=60)
        self.assertEqual(process.returncode, 3, error)
        failed, idle = self.report()
        self.assertFalse(failed["complete"])
        self.assertTrue(idle["complete"])
        self.assertEqual([host["load_running"] for host in idle["hosts"].values()], [None, None])

    def test_cut_link_loses_messages_and_goes_on(self):
        process = self.start_ontime("run", self.scenario("4 s", transports=["cyclonedds"]), "--only", "idle", "--results", self.results)
        self.started(process, lambda: self.samples_recorded() > 50)
        link = json.loads(subprocess.run(["ip", "-n", "ontime-controller", "-j", "link"], capture_output=True, text=True, check=True).stdout)
        name = next(entry["ifname"] for entry in link if entry["ifname"] != "lo")
        subprocess.run(["ip", "-n", "ontime-controller", "link", "set", name, "down"], check=True)
        time.sleep(1)
        subprocess.run(["ip", "-n", "ontime-controller", "link", "set", name, "up"], check=True)
        _, error = process.communicate(timeout=60)
        self.assertEqual(process.returncode, 0, error)
        run = self.report()[0]
        self.assertGreater(run["lost"], 0)
        self.assertGreater(run["on_time"], 0)
        self.assertEqual(run["sent"], run["on_time"] + run["late"] + run["lost"])

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
            self.assertGreater(self.report()[0]["sent"], 0)
        finally:
            subprocess.run(["umount", disk], check=True)

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
        first.communicate(timeout=60)

    # --- silence ---

    def loaded_run(self, transport="udp", prefix=()):
        process = self.start([*prefix, ONTIME, "run", self.scenario("1 h", transports=[transport]), "--only", "loaded",
                              "--results", self.results])
        self.started(process, lambda: self.samples_recorded() > 50 and len(self.load()) > 0)
        return process

    def assert_ended_and_kept(self, process, words):
        out, error = process.communicate(timeout=90)
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
        self.assert_ended_and_kept(process, "the keeper of the .* was silent for 10 s")

    def test_coordinator_that_is_stopped_is_left_alone_and_the_machine_given_back(self):
        process = self.loaded_run()
        process.send_signal(signal.SIGSTOP)
        self.assertTrue(eventually(self.nothing_left, 30), self.what_is_left())
        process.send_signal(signal.SIGCONT)
        self.assert_ended_and_kept(process, "the coordinator .* was silent for 10 s")

    def agent_in(self, namespace):
        own = os.stat(f"/run/netns/{namespace}").st_ino
        return next(pid for pid in self.own("/ontime agent") if os.stat(f"/proc/{pid}/ns/net").st_ino == own)

    # --- signals ---

    def assert_interrupted_and_given_back(self):
        self.assertTrue(eventually(self.nothing_left, 30), self.what_is_left())
        run = self.report()[0]
        self.assertTrue(run["interrupted"])
        self.assertIsNone(run["error"])
        self.assertEqual(set(run["hosts"]), {"controller", "component"})
        self.assertGreater(run["sent"], 50)

    def test_service_that_is_stopped_keeps_its_run(self):
        """As systemctl stop does: a SIGTERM to every process of the service at once."""
        process = self.loaded_run()
        for pid in processes_with("TMPDIR=" + self.temporary):
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGTERM)
        process.communicate(timeout=60)
        self.assertEqual(process.returncode, 130)
        self.assert_interrupted_and_given_back()

    def test_pong_that_is_stopped_as_a_service_has_not_failed(self):
        process = self.start_ontime("pong", "--transport", "udp", "--interface", "lo", "--domain", "78")
        self.started(process, lambda: self.own("/ontime agent"))
        time.sleep(0.5)
        for pid in [*self.own("/ontime agent"), process.pid]:
            os.kill(pid, signal.SIGTERM)
        process.communicate(timeout=30)
        self.assertEqual(process.returncode, 0)

    def test_nohup_goes_on_when_the_terminal_closes(self):
        process = self.loaded_run(prefix=["nohup"])
        before = self.samples_recorded()
        process.send_signal(signal.SIGHUP)
        self.assertTrue(eventually(lambda: self.samples_recorded() > before + 100, 30))
        self.assertIsNone(process.poll())
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=60)
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
        process.wait(timeout=60)
        self.assert_interrupted_and_given_back()

    def test_timeout_keeps_the_run(self):
        answer = subprocess.run(["timeout", "8", ONTIME, "run", self.scenario("1 h", transports=["udp"]), "--only",
                                 "loaded", "--results", self.results], env=self.environment, capture_output=True, timeout=120)
        self.assertEqual(answer.returncode, 124)
        self.assert_interrupted_and_given_back()


if __name__ == "__main__":
    unittest.main(verbosity=2)
