#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""`ontime listen` beside programs that keep their own account of each message (robot.py). It needs root: who may not set probes
leaves with 3."""

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
import sys
import time
import unittest
import urllib.request

from program import eventually, on_a_terminal, trace_instances
from robot import ENVIRONMENT, FASTDDS_NODE, LATE, MESSAGES, NODE, ONTIME, REALTIME, RMW_NODE, Robot, begin, changed_code, log_of, until_probed

DDS_STAND_INS = pathlib.Path(RMW_NODE).parent.parent / "tests/listen"


def captures(pid):
    """Whether a packet socket of the process runs on an interface."""
    try:
        links = [os.readlink(link) for link in pathlib.Path(f"/proc/{pid}/fd").iterdir()]
    except FileNotFoundError:  # closed meanwhile
        return False
    rows = [line.split() for line in pathlib.Path("/proc/net/packet").read_text().splitlines()[1:]]
    return any(f"socket:[{row[8]}]" in links and int(row[5]) == 1 and int(row[4]) != 0 for row in rows)


class Listen(Robot):
    def test_every_late_and_no_other_message_is_found(self):
        self.check_each_message()

    def test_every_late_and_no_other_message_of_fast_dds_is_found(self):
        self.check_each_message(node=FASTDDS_NODE)

    def test_every_late_and_no_other_message_of_fast_dds_that_is_taken_alone_is_found(self):
        self.check_each_message(node=FASTDDS_NODE, way="next")

    def check_each_message(self, **kind):
        publisher, taker = self.pair(MESSAGES, **kind)
        listener = self.listen((publisher, taker), "/cmd_vel", "--deadline", "15ms", "--results", "kept.ontime")
        code, seen = self.end(listener, publisher, taker)
        taken = log_of(self.folder / "taken")
        self.assertEqual(len(seen["flows"]), 1, seen)
        flow = seen["flows"][0]
        self.assertEqual((flow["topic"], flow["writer"]["pid"], flow["reader"]["pid"]),
                         ("/cmd_vel", publisher.pid, taker.pid))
        self.assertEqual(seen["sensor_lost"], 0)
        self.assertEqual(flow["messages"], len(taken))
        self.assertEqual((flow["lost"], flow["duplicated"], flow["out_of_order"]), (MESSAGES - len(taken), 0, 0))
        gaps = [after[1] - before[1] for before, after in zip(taken, taken[1:])]
        # The taker's own clock is read a little later: what is that near to the deadline may be either.
        sure, possible = (sum(gap > limit for gap in gaps) for limit in (17_000_000, 13_000_000))
        self.assertGreaterEqual(sure, MESSAGES // 997 - 1, "each pause, but one that a standstill may split")
        self.assertLessEqual(flow["late"], possible)
        self.assertEqual(code, 1)
        self.assertIsNotNone(flow["age"])
        print(f"age ns: {flow['age']}; late {flow['late']}, by its own log {sure} to {possible}", file=sys.stderr)
        rows, runs = self.kept()
        self.assertEqual(set(rows), {"/cmd_vel age", "/cmd_vel period"})
        # The last is the silence after the last message.
        self.assertEqual(rows["/cmd_vel period"].pop(), (flow["silent_ns"], LATE))
        self.assertEqual(len(rows["/cmd_vel period"]), flow["period"]["count"])
        self.assertGreaterEqual(flow["period"]["count"] + flow["not_judged"], len(taken) - 1)
        self.assertEqual([fate for _, fate in rows["/cmd_vel period"]].count(LATE), flow["late"])
        # The middle of each late period in the taker's own log is in a late period here, or in none (while ontime set or
        # removed probes).
        periods = self.periods()
        # The taker reads its clock after the take, once in a while much later: the median of the last ones tells how much.
        ahead = statistics.median_low([ended[1] - begun[0] for ended, begun in zip(taken[-21:-1], periods[-20:])])
        found = 0
        for before, after in zip(taken, taken[1:]):
            if after[1] - before[1] <= 17_000_000:
                continue
            middle = (before[1] + after[1]) // 2 - ahead
            fates = [fate for begin, length, fate in periods if begin <= middle < begin + length]
            self.assertIn(fates, ([LATE], []))
            found += len(fates)
        self.assertTrue(sure - flow["not_judged"] <= found <= flow["late"], (sure, found, flow))
        self.assertGreaterEqual(found, MESSAGES // 997 - 2)
        self.assertEqual(len(rows["/cmd_vel age"]), flow["age"]["count"])
        self.assertEqual(max(age for age, _ in rows["/cmd_vel age"]), flow["age"]["max_ns"])
        self.assertEqual((runs["/cmd_vel period"]["late"], runs["/cmd_vel period"]["sent"]), (flow["late"] + 1, flow["period"]["count"] + 1))

    def periods(self):
        """When each period of the results file began, how long it was, and its fate; without the silence at the end."""
        with contextlib.closing(sqlite3.connect(f"file:{self.folder / 'kept.ontime'}?mode=ro", uri=True)) as database:
            return database.execute("SELECT intended_ns, received_after_ns, fate FROM sample JOIN run ON run = number "
                                    "WHERE id = '/cmd_vel period' ORDER BY message").fetchall()[:-1]

    def test_messages_overwritten_in_the_queue_are_counted_exactly(self):
        self.check_overwritten()

    def test_messages_of_fast_dds_overwritten_in_the_queue_are_counted_exactly(self):
        self.check_overwritten(node=FASTDDS_NODE)

    def check_overwritten(self, **kind):
        publisher, taker = self.pair(MESSAGES, depth=1, take_us=5000, **kind)
        listener = self.listen((publisher, taker), "/cmd_vel", "--results", "kept.ontime")
        code, seen = self.end(listener, publisher, taker)
        taken = [number for number, _, _ in log_of(self.folder / "taken")]
        flow = seen["flows"][0]
        self.assertEqual(flow["messages"], len(taken))
        self.assertGreater(MESSAGES - len(taken), MESSAGES // 2)
        self.assertEqual(code, 0)  # no limit was stated
        # From the message by which the writer is recognized each has a row, but for those while ontime removed probes.
        with contextlib.closing(sqlite3.connect(f"file:{self.folder / 'kept.ontime'}?mode=ro", uri=True)) as database:
            rows = dict(database.execute("SELECT message, received_after_ns FROM sample JOIN run ON run = number "
                                         "WHERE id = '/cmd_vel age'"))
        self.assertGreater(len(rows), MESSAGES // 4)
        # The last taken one may be among these, and a lost one may follow it. Which are taken differs, so the rows fit at one
        # place only.
        there = {message for message, age in rows.items() if age is not None}
        first = max(taken) - max(rows)
        self.assertTrue(any({message + ahead for message in there} == set(taken) & {message + ahead for message in rows}
                            for ahead in range(first - 500, first + 500)), (first, sorted(there), taken))
        self.assertLessEqual(max(rows) + 1 - min(rows) - len(rows), flow["not_judged"] + flow["lost_not_judged"])
        self.assertEqual(flow["lost"], sum(age is None for age in rows.values()))
        self.assertEqual(self.kept()[1]["/cmd_vel age"]["lost"], flow["lost"])

    def test_age_of_a_chain_is_that_of_the_nodes_own_logs(self):
        self.check_chain(NODE)

    def test_age_of_a_chain_of_fast_dds_programs_is_that_of_their_own_logs(self):
        self.check_chain(FASTDDS_NODE)

    def check_chain(self, node):
        publisher = self.start(*REALTIME, node, "publish", "rt/scan", MESSAGES, 1000, self.folder / "published")
        relay = self.start(*REALTIME, node, "relay", "rt/scan", 3, 0, self.folder / "relayed", "rt/cmd_vel")
        taker = self.start(*REALTIME, node, "take", "rt/cmd_vel", 1000, 0, self.folder / "taken")
        nodes = (publisher, relay, taker)
        listener = self.listen(nodes, "--chain", "/scan,/cmd_vel@1h", "--results", "kept.ontime")
        code, seen = self.end(listener, publisher, taker)
        relay.send_signal(signal.SIGTERM)
        self.assertEqual(relay.wait(120), 0)
        self.assertEqual((code, seen["sensor_lost"]), (0, 0))
        self.assertEqual({flow["topic"] for flow in seen["flows"]}, {"/scan", "/cmd_vel"})
        chain, = seen["chains"]
        path, = chain["paths"]
        self.assertEqual([process["pid"] for process in path["processes"]], [node.pid for node in nodes])
        scan, cmd_vel = chain["topics"]
        # Of a plain Cyclone DDS program the first messages tell the topic's name; on a busy machine it takes a while.
        self.assertTrue(MESSAGES // 2 < chain["published"] <= MESSAGES, chain)
        self.assertEqual(path["late"], 0)
        self.assertEqual((scan["not_taken"], cmd_vel["not_taken"], cmd_vel["without_take"]), (0, 0, 0))
        rows = self.kept()[0]["/scan → /cmd_vel age"]
        self.assertEqual(len(rows), path["age"]["count"])
        # From the message on by which the writers were recognized each has its row, and no other.
        published = {number: at for number, at, _ in log_of(self.folder / "published")}
        # Some before them were under way while ontime removed probes: the later half has no hole.
        rows = rows[len(rows) // 2:]
        taken = log_of(self.folder / "taken")[-len(rows):]
        self.assertGreater(len(taken), MESSAGES // 20)
        self.assertTrue(all(number % 3 == 0 for number, _, _ in taken))
        # Two of three are not published on, and that is no loss: but for those under way at the end.
        self.assertAlmostEqual(scan["not_published_on"], 2 * chain["came_out"], delta=4)
        for (age, _), (number, at, _) in zip(rows, taken):
            truth = at - published[number]
            self.assertLessEqual(age, truth)  # the logs read their clocks before the publish, after the take
        errors = sorted(at - published[number] - age for (age, _), (number, at, _) in zip(rows, taken))
        self.assertLess(errors[len(errors) // 2], 1_000_000)  # another message's would be 3 ms off; a busy machine delays some logs
        print(f"chain: {len(rows)} ages; below the logs by p50 {errors[len(errors) // 2]} ns, max {errors[-1]} ns", file=sys.stderr)

    def test_node_that_never_takes_the_topic_before_is_named(self):
        publisher = self.start(NODE, "publish", "rt/scan", 2000, 1000, self.folder / "published")
        relay = self.start(NODE, "relay", "rt/scan", 1, 0, self.folder / "relayed", "rt/map")
        last = self.start(NODE, "relay", "rt/map", 1, 0, self.folder / "again", "rt/cmd_vel")
        taker = self.start(NODE, "take", "rt/cmd_vel", 1000, 0, self.folder / "taken")
        listener = self.listen((publisher, relay, last, taker), "--chain", "/scan,/cmd_vel")
        code, seen = self.end(listener, publisher, taker)
        self.assertEqual((code, seen["chains"][0]["came_out"]), (2, 0))
        self.assertRegex(" ".join(seen["remarks"]), rf"listen_node \[{last.pid}\], .* /cmd_vel, took no /scan; it took /map")
        self.assertNotIn(f"[{relay.pid}]", " ".join(seen["remarks"]))

    def test_table_has_the_ages_of_a_chain_that_are_recorded(self):
        publisher = self.start(*REALTIME, NODE, "publish", "rt/scan", 4000, 1000, self.folder / "published")
        relay = self.start(*REALTIME, NODE, "relay", "rt/scan", 3, 0, self.folder / "relayed", "rt/cmd_vel")
        taker = self.start(*REALTIME, NODE, "take", "rt/cmd_vel", 1000, 0, self.folder / "taken")
        other = self.start(NODE, "publish", "rt/cmd_vel", 1000, 1000, self.folder / "other")
        listener = self.start(ONTIME, "listen", "--chain", "/scan,/cmd_vel@10us", "--chain", "/nix,/cmd_vel", "--results", "kept.ontime",
                              "--budget", "100%", "--output", "seen.txt")
        until_probed((publisher, relay, taker))
        begin(publisher)
        begin(other)
        self.assertEqual(publisher.wait(600), 0)
        time.sleep(0.5)
        listener.send_signal(signal.SIGINT)
        self.assertEqual(listener.wait(120), 1)
        text = (self.folder / "seen.txt").read_text()
        print(text, file=sys.stderr)
        chain, nix = re.search(r"^(/scan → /cmd_vel within 0\.010 ms\n(?: .*\n)+)(/nix → /cmd_vel\n(?: .*\n)+)", text, re.MULTILINE).groups()
        self.assertLessEqual(max(map(len, (chain + nix).splitlines())), 80, text)
        self.assertIn("no message arrived", nix)
        rows = re.findall(r"^ +(\d+) % +([0-9.]+) +([0-9.]+) +([0-9.]+)   +(.+)$", chain, re.MULTILINE)
        shares = [int(row[0]) for row in rows]
        self.assertEqual((len(rows), shares[0]), (4, 100), text)
        self.assertAlmostEqual(sum(shares[1:]), 100, delta=1)
        ages = self.kept()[0]["/scan → /cmd_vel age"]
        late = sum(fate == LATE for _, fate in ages)
        self.assertGreater(late, 0)
        self.assertEqual(rows[0][4], f"{len(ages)} arrived, {late} of them late")
        self.assertAlmostEqual(float(rows[0][3]) * 1e6 / max(age for age, _ in ages), 1, delta=0.01)
        self.assertAlmostEqual(float(rows[0][1]) * 1e6 / statistics.median_low(age for age, _ in ages), 1, delta=0.05)
        self.assertEqual([row[4] for row in rows[1:]], [f"/scan → listen_node [{relay.pid}]", f"in listen_node [{relay.pid}]",
                                                        f"/cmd_vel → listen_node [{taker.pid}]"])
        # The other publisher took nothing.
        self.assertRegex(chain, r"/cmd_vel: \d+ messages were\s+published")
        self.assertRegex(text, r"budget +100 % of one CPU for ontime")

    def test_chain_of_topics_that_no_node_joins_has_no_age(self):
        publisher, taker = self.pair(2000)
        other = self.start(NODE, "publish", "rt/scan", 1, 1000, self.folder / "other")
        listener = self.listen((publisher, taker, other), "--chain", "/scan,/cmd_vel")
        code, seen = self.end(listener, publisher, taker)
        self.assertEqual(code, 2)
        chain, = seen["chains"]
        self.assertEqual((chain["came_out"], chain["paths"]), (0, []))
        # On a busy machine it takes a while to find the topics' names.
        self.assertTrue(0 < chain["topics"][1]["without_take"] <= 2000, chain)

    def hog(self, priority, cpu):
        """Has the CPU for some 30 ms, every half a second."""
        program = self.folder / "hog"
        shutil.copy("/bin/dash", program)
        script = "while :; do i=0; while [ $i -lt 150000 ]; do i=$((i+1)); done; sleep 0.5; done"
        return self.start("chrt", *priority, "taskset", "-c", cpu, program, "-c", script)

    def test_thread_that_keeps_the_reader_from_its_cpu_is_named(self):
        last = os.cpu_count() - 1
        publisher = self.start(*REALTIME, NODE, "publish", "rt/cmd_vel", 4000, 1000, self.folder / "published")
        taker = self.start("taskset", "-c", last, NODE, "take", "rt/cmd_vel", 1000, 0, self.folder / "taken")
        listener = self.listen((publisher, taker), "/cmd_vel", "--age", "5ms")
        hog = self.hog(("-f", "50"), last)
        code, seen = self.end(listener, publisher, taker)
        self.assertEqual(code, 1)
        why = [miss["why"] for miss in seen["misses"] if miss["why"]]
        self.assertGreater(len(why), 0, seen["remarks"])
        named = [one for one in why if one["culprit"] and one["culprit"]["pid"] == hog.pid]
        self.assertGreater(len(named), 0, why)
        for one in named:
            self.assertEqual((one["cause"], one["culprit"]["name"], one["victim"]["pid"]), ("cpu", "hog", taker.pid))
        print(f"{len(named)} of {len(why)} name the hog", file=sys.stderr)

    def test_what_is_beyond_64_messages_of_one_take_is_unseen_and_not_lost(self):
        publisher, taker = nodes = self.pair(3000, take_us=100_000)
        listener = self.listen(nodes)
        code, seen = self.end(listener, publisher, taker, last_take_s=3)
        flow, = seen["flows"]
        taken = len(log_of(self.folder / "taken"))
        self.assertEqual((code, flow["lost"]), (0, 0))
        self.assertLess(flow["messages"], taken)
        self.assertEqual(flow["messages"] + seen["sensor_lost"], taken)

    def test_publisher_that_sleeps_accuses_no_process(self):
        # Real-time ends: what else runs on this machine does not delay them.
        publisher = self.start(*REALTIME, NODE, "publish", "rt/cmd_vel", 4000, 1000, self.folder / "published")
        taker = self.start(*REALTIME, NODE, "take", "rt/cmd_vel", 1000, 0, self.folder / "taken")
        listener = self.listen((publisher, taker), "/cmd_vel", "--deadline", "20ms")
        code, seen = self.end(listener, publisher, taker)
        self.assertEqual(code, 1)
        # Of its four sleeps of 30 ms those that nothing made longer: a machine without preemption, or a hypervisor, may.
        why = [miss["why"] for miss in seen["misses"] if miss["why"] and 30e6 <= miss["value_ns"] < 35e6]
        self.assertGreater(len(why), 0, seen["misses"])
        for one in why:
            self.assertIsNone(one["culprit"], one)
            self.assertNotIn(one["cause"], ("cpu", "interrupts", "throttled"), one)

    def test_trace_of_a_killed_listener_goes_with_the_next(self):
        nodes = self.pair(100)
        listener = self.listen(nodes, "--deadline", "1s")
        self.assertTrue(eventually(lambda: "ontime-trace" in trace_instances()))
        beside = subprocess.run([ONTIME, "listen", "--deadline", "1s", "--for", "1 s"], capture_output=True, text=True, timeout=60)
        self.assertRegex(beside.stderr, rf"not explained: .*process {listener.pid}")
        listener.kill()
        listener.wait()
        subprocess.run([ONTIME, "listen", "--deadline", "1s", "--for", "1 s"], capture_output=True, timeout=60)
        self.assertNotIn("ontime-trace", trace_instances())

    def test_budget_that_is_exceeded_makes_pauses_and_says_so(self):
        publisher, taker = nodes = self.pair(10_000_000, period_us=100)
        begin(publisher)
        listener = subprocess.Popen([ONTIME, "listen", "/cmd_vel", "--deadline", "1h", "--budget", "3%", "--format", "json",
                                     "--results", "kept.ontime"],
                                    stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=self.folder)
        self.addCleanup(lambda: (listener.kill(), listener.wait(), listener.stdout.close(), listener.stderr.close()))
        self.assertIn("not explained", listener.stderr.readline())
        self.assertIn("pauses", listener.stderr.readline())
        probes = lambda: sum(changed_code(node.pid) for node in nodes)
        self.assertTrue(eventually(lambda: probes() == 0, 60))
        self.assertTrue(eventually(lambda: probes() > 0, 300))
        self.assertTrue(eventually(lambda: probes() == 0, 60))
        listener.send_signal(signal.SIGINT)
        seen = json.loads(listener.communicate(timeout=60)[0])
        for node in nodes:
            node.send_signal(signal.SIGTERM)
            node.wait(60)
        budget = seen["cost"]["budget"]
        self.assertEqual((budget["cpu_share"], budget["kernel_events_left_out"]), (0.03, True))
        self.assertGreaterEqual(budget["pauses"], 2)
        self.assertTrue(0 < budget["listened_share"] < 1, budget)
        report = subprocess.run([ONTIME, "report", "kept.ontime", "--full"], capture_output=True, text=True, cwd=self.folder, timeout=60).stdout
        self.assertRegex(report, rf"listened\s+\d+\s+%\s+of\s+the\s+time,\s+with\s+{budget['pauses']}\s+pauses")
        # What was not seen is not lost, and no silence.
        flow, = seen["flows"]
        taken = log_of(self.folder / "taken")
        self.assertTrue(0 < flow["messages"] < len(taken), (flow, len(taken)))
        self.assertEqual((flow["duplicated"], flow["silent_ns"]), (0, 0))
        self.assertLessEqual(flow["lost"], taken[-1][0] + 1 - taken[0][0] - len(taken))  # a busy machine's taker misses some
        gaps = [after[1] - before[1] for before, after in zip(taken, taken[1:])]
        self.assertLess(flow["period"]["max_ns"], max(gaps) + 10_000_000)

    def test_listener_that_is_interrupted_soon_states_no_cost(self):
        listener = subprocess.Popen([ONTIME, "listen"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.addCleanup(lambda: (listener.kill(), listener.wait(), listener.stdout.close(), listener.stderr.close()))
        caught = lambda: int(pathlib.Path(f"/proc/{listener.pid}/status").read_text().split("SigCgt:")[1].split()[0], 16)
        self.assertTrue(eventually(lambda: caught() >> (signal.SIGINT - 1) & 1))
        listener.send_signal(signal.SIGINT)
        said = listener.communicate(timeout=60)[0]
        is_short = float(re.search(r"for ([0-9.]+) s", said)[1]) < 1
        self.assertEqual("cost " in said, not is_short, said)

    def test_listener_that_is_interrupted_before_it_listens_judges_no_limit(self):
        shown, listener = on_a_terminal([ONTIME, "listen", "--age", "1 ms"], when=lambda shown: b"setting probes" in shown,
                                        then=lambda process: process.send_signal(signal.SIGINT), env={**os.environ, "TERM": "xterm"})
        self.addCleanup(listener.kill)
        self.assertEqual(listener.wait(timeout=60) == 130, b"listening:" not in shown, shown)

    def test_costly_functions_are_named_only_if_they_were_called(self):
        nodes = self.pair(1000)
        code, seen = self.end(self.listen(nodes, "/cmd_vel"), *nodes)
        named = [remark for remark in seen["remarks"] if "cheap" in remark]
        stepped = seen["cost"]["probes"]["stepped"]
        self.assertEqual(len(named), 1 if stepped else 0, seen["remarks"])
        for remark in named:
            self.assertIn(f" {stepped} ", remark)

    def test_nothing_remains_after_kill_9(self):
        publisher, taker = nodes = self.pair(100)
        listener = self.listen(nodes)
        listener.kill()
        listener.wait()
        self.assertTrue(eventually(lambda: all(changed_code(node.pid) == 0 for node in nodes)))
        begin(publisher)
        self.assertEqual(publisher.wait(60), 0)
        time.sleep(0.5)
        taker.send_signal(signal.SIGTERM)
        self.assertEqual(taker.wait(120), 0)
        self.assertEqual(len(log_of(self.folder / "taken")), 100)

    def test_packets_show_the_same_messages(self):
        listener = self.start(ONTIME, "listen", "/cmd_vel", "--packets", "lo", "--format", "json", "--output", "seen.json")
        # Before the nodes, so that their discovery is seen.
        self.assertTrue(eventually(lambda: captures(listener.pid)))
        publisher, taker = self.pair(1000)
        time.sleep(1)
        code, seen = self.end(listener, publisher, taker)
        self.assertEqual(code, 0)
        flow, = seen["flows"]
        self.assertEqual((flow["messages"], flow["lost"], flow["duplicated"]), (1000, 0, 0), seen)
        self.assertIsNotNone(flow["age"])

    def test_messages_of_a_ros_2_node_are_judged(self):
        node = self.start(RMW_NODE)
        done = subprocess.run([ONTIME, "listen", "/scan", "--for", "3 s", "--format", "json"], capture_output=True,
                              text=True, timeout=60)
        self.assertEqual(done.returncode, 0, done.stderr)
        flow, = json.loads(done.stdout)["flows"]
        self.assertEqual((flow["writer"]["pid"], flow["reader"]["pid"]), (node.pid, node.pid))
        # One of 110 is never taken, one of 11 is a copy; the window begins and ends anywhere.
        # Lost ones are judged from the message on by which the writer is recognized, as ages are. Copies are known before.
        judged = flow["age"]["count"]
        self.assertGreater(judged, 0)
        self.assertAlmostEqual(flow["lost"], judged / 109, delta=2)
        self.assertGreaterEqual(flow["duplicated"], judged * 10 / 109 - 11)
        self.assertLessEqual(flow["duplicated"], flow["messages"] * 10 / 109 + 11)
        self.assertEqual(flow["out_of_order"], 0)
        self.assertLess(flow["age"]["p50_ns"], 10_000_000)

    def test_a_ros_2_node_is_seen_once_beside_a_plain_program_of_its_dds(self):
        node = self.start(RMW_NODE)
        # The first process of that library that is no node has the probes set there too.
        plain = subprocess.Popen(["sleep", "60"], env={**ENVIRONMENT, "LD_PRELOAD": " ".join(
            str(DDS_STAND_INS / name) for name in ("libddsc.so", "libfastrtps.so"))})
        self.addCleanup(lambda: (plain.kill(), plain.wait()))
        done = subprocess.run([ONTIME, "listen", "--for", "3 s", "--format", "json"], capture_output=True,
                              text=True, timeout=60)
        seen = json.loads(done.stdout)
        flow, = (flow for flow in seen["flows"] if node.pid in (end["pid"] for end in (flow["writer"], flow["reader"]) if end))
        self.assertEqual(flow["topic"], "/scan")
        self.assertIsNotNone(flow["reader"])
        self.assertGreater(flow["age"]["count"], 0)
        # The probes of both are met, and told of: a publish of rmw makes one of Fast DDS.
        self.assertGreater(seen["cost"]["probes"]["publishes"], 1.5 * flow["messages"])

    def test_capabilities_of_the_service_suffice(self):
        unit = (pathlib.Path(__file__).parent.parent.parent / "debian/ontime.ontime-listen.service").read_text()
        names = re.search(r"^CapabilityBoundingSet=(.*)$", unit, re.MULTILINE)[1].lower().replace("cap_", "+").split()
        self.start(RMW_NODE)
        done = subprocess.run(["setpriv", "--bounding-set", ",".join(["-all", *names]), ONTIME, "listen", "/scan", "--for", "3 s", "--deadline", "1us",
                               "--results", "kept.ontime", "--keep", "10MB", "--format", "json"], capture_output=True, text=True, timeout=60, cwd=self.folder)
        self.assertEqual(done.returncode, 1, done.stderr)
        flow, = json.loads(done.stdout)["flows"]
        rows, runs = self.kept()
        self.assertGreaterEqual(runs["/scan period"]["late"], flow["late"])
        # The worst is kept, also of the last ones. The silence at the end may be longer.
        self.assertGreaterEqual(max(period for period, _ in rows["/scan period"]), flow["period"]["max_ns"])

    def test_metrics_have_the_messages_of_each_topic(self):
        self.start(RMW_NODE)
        listener = subprocess.Popen([ONTIME, "listen", "/scan", "--age", "1 h", "--no-explain", "--metrics", "0", "--for", "120 s"],
                                    stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, cwd=self.folder)
        self.addCleanup(listener.stderr.close)
        self.addCleanup(listener.wait)
        self.addCleanup(listener.send_signal, signal.SIGINT)
        url = re.search(r"http://\S+", listener.stderr.readline()).group()

        def metrics():
            with urllib.request.urlopen(url, timeout=30) as answer:
                return answer.read().decode()
        labels = 'topic="/scan",writer="listen_rmw_node"'
        self.assertTrue(eventually(lambda: f'ontime_topic_age_seconds_count{{{labels}' in metrics()), metrics())
        text = metrics()
        age = [int(line.rsplit(" ", 1)[1]) for line in text.splitlines()
               if line.startswith("ontime_topic_age_seconds_bucket") and labels in line]
        self.assertEqual(age, sorted(age))
        self.assertGreater(age[-1], 0)
        for metric in ("messages_total", "late_total", "lost_total", "period_seconds_sum"):
            self.assertIn(f"ontime_topic_{metric}{{", text)

    def test_unknown_topic_is_answered_with_the_nearest(self):
        publisher, taker = self.pair(10000)
        begin(publisher)
        done = subprocess.run([ONTIME, "listen", "/cmd_vle", "--for", "5 s"], capture_output=True, text=True, timeout=60)
        self.assertEqual(done.returncode, 2, done.stderr)
        self.assertIn("did you mean '/cmd_vel'?", done.stderr)

    def test_flows_without_a_topic_name_are_told_of_without_a_capture(self):
        publisher, taker = nodes = self.pair(10, period_us=8_000_000)
        listener = self.start(ONTIME, "listen", "/nosuch", "--format", "json", "--output", "seen.json")
        until_probed(nodes)
        taker.send_signal(signal.SIGSTOP)
        begin(publisher)
        time.sleep(12)  # the first message is sent after 8 s; the next one would tell its topic
        listener.send_signal(signal.SIGINT)
        self.assertEqual(listener.wait(120), 2)
        remark = next(text for text in json.loads((self.folder / "seen.json").read_text())["remarks"] if "/nosuch" in text)
        # Other programs of this machine may have some, too.
        self.assertRegex(remark, r"; [0-9]+ flows? ha(s|ve) no topic name: .* replace TOPIC by --list")
        self.assertNotIn("capture", remark)

    def test_without_privileges_it_says_what_to_grant(self):
        done = subprocess.run(["setpriv", "--reuid", "65534", "--clear-groups", ONTIME, "listen",
                               "--for", "1 s"], capture_output=True, text=True, timeout=60)
        self.assertEqual(done.returncode, 3, done.stderr)
        self.assertRegex(done.stderr, r"Fix: sudo .*listen --for '1 s'$")

    def test_reader_that_leaves_ends_it_quietly(self):
        node = self.start(RMW_NODE)
        listener = subprocess.Popen([ONTIME, "listen", "/scan", "--deadline", "1 us", "--for", "60 s"],
                                    stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=self.folder)
        self.assertIn("/scan", listener.stdout.readline())
        listener.stdout.close()
        self.assertEqual(listener.stderr.read(), "")
        self.assertEqual(listener.wait(120), -signal.SIGPIPE)
        listener.stderr.close()
        self.assertIsNone(node.poll())


if __name__ == "__main__":
    if os.geteuid() != 0:
        sys.exit(3)
    unittest.main()
