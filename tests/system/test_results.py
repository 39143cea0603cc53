#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The real program on real results: gates, comparisons, and what goes out."""

import contextlib
import csv
import io
import json
import os
import pathlib
import random
import shutil
import signal
import sqlite3
import subprocess
import unittest
import unittest.mock
import xml.etree.ElementTree

import results
from program import eventually, on_a_terminal
from results import ONTIME


class Results(results.Results):
    def test_page_is_not_written_through_what_is_no_file(self):
        os.mkfifo(self.folder / "results.html")
        answer = self.ontime("run", self.scenario(), "--results", self.results)
        self.assertIn("results.html exists", answer.stderr)
        self.assertTrue(self.results.with_suffix(".html").is_fifo())

    def test_results_where_no_file_can_be_are_wrong_usage(self):
        for command in (("run", "demo"), ("ping", "--transport", "udp"), ("pong", "--transport", "udp", "--explain"), ("lab", "run", "lab"),
                        ("tune", "search", "demo", "--goal", "p50 < 1 s"), ("listen",), ("import", "bag")):
            for results, flaw in (("no/r.ontime", ": no is no folder. Fix: make it first"), (".", ". is a folder. Fix: name a file in it")):
                with self.subTest(command, results=results):
                    self.assertIn(flaw, self.ontime(*command, "--results", results, code=2).stderr)

    def test_next_commands_name_no_scenario_that_others_can_change(self):
        scenario = self.scenario()
        scenario.write_text(scenario.read_text().replace("period: 5 ms", "period: 5 ms, deadline: 1 us"))
        self.ontime("run", scenario, "--results", self.results)

        def named():
            texts = [self.ontime("report", self.results, *more).stdout for more in ((), ("--format", "html"))]
            return [f"ontime run {scenario}" in text for text in texts]

        self.assertEqual(named(), [True, True])
        for path, mode in ((scenario, 0o666), (scenario, 0o664), (self.folder, 0o777)):
            path.chmod(mode)
            self.assertEqual(named(), [False, False], path)
            path.chmod(mode & 0o755)
        self.assertEqual(named(), [True, True])
        scenario.rename(self.folder / "moved.yaml")
        scenario.symlink_to("moved.yaml")
        self.assertEqual(named(), [False, False])

    def test_next_commands_name_no_folder_to_which_others_can_add_scenarios(self):
        suite = self.folder / "suite"
        suite.mkdir()
        scenario = self.scenario()
        (suite / "one.yaml").write_text(scenario.read_text().replace("period: 5 ms", "period: 5 ms, deadline: 500 ms"))
        self.ontime("run", suite, "--only", "one", "--results", self.results)
        for mode, is_named in ((0o755, True), (0o777, False), (0o1777, False)):
            suite.chmod(mode)
            self.assertEqual(f"ontime run {suite} --only one" in self.ontime("report", self.results).stdout, is_named, oct(mode))

    # --- gates ---

    def test_what_a_scenario_requires_is_judged_and_recorded(self):
        self.ontime("run", self.scenario("lost <= 100%, max <= 100 s"), "--results", self.results, "--junit", "held.xml")
        answer = self.ontime("run", self.scenario("p50 <= 1 ns"), "--results", self.results, "--junit", "missed.xml", code=1)
        self.assertIn("FAIL: p50 <= 1 ns (one udp (run 2)): p50 is ", answer.stderr)
        self.assertIn("FAIL: p50 <= 1 ns", answer.stdout)
        self.assertRegex(answer.stdout.splitlines()[0], r"had (an|no) answer")
        self.assertLessEqual(len(answer.stdout.splitlines()), 24)
        self.assertIn("FAIL: p50 <= 1 ns", self.ontime("report", self.results).stdout)
        run = json.loads(self.ontime("report", self.results, "--format", "json").stdout)["runs"][1]
        self.assertEqual(run["require"], ["p50 <= 1 ns"])
        self.assertEqual([note["kind"] for note in run["notes"]], ["gate-missed"])
        held, missed = (xml.etree.ElementTree.parse(self.folder / name).getroot() for name in ("held.xml", "missed.xml"))
        self.assertEqual((held.get("tests"), held.get("failures")), ("3", "0"))
        self.assertEqual((missed.get("tests"), missed.get("failures")), ("2", "1"))
        # Judged again from the file, both runs.
        self.ontime("report", self.results, "--junit", "again.xml", code=1)
        self.assertEqual(xml.etree.ElementTree.parse(self.folder / "again.xml").getroot().get("failures"), "1")

    def test_a_run_under_way_is_running(self):
        process = self.started("1 h")
        answer = json.loads(self.ontime("report", self.results, "--format", "json").stdout)["answer"]
        self.assertEqual([row["state"] for row in answer["rows"]], ["running"])
        self.assertIn("ontime watch", answer["next"][0]["command"])
        process.send_signal(signal.SIGINT)
        _, error = process.communicate(timeout=180)
        self.assertEqual(process.returncode, 130, error)

    def test_what_was_interrupted_and_measured_again_is_judged_by_that(self):
        process = self.started("6 s")
        process.send_signal(signal.SIGINT)
        _, error = process.communicate(timeout=180)
        self.assertEqual(process.returncode, 130, error)
        answer = json.loads(self.ontime("report", self.results, "--format", "json").stdout)["answer"]
        self.assertEqual([row["state"] for row in answer["rows"]], ["CUT OFF"])
        gates = ("--fail-if", "max > 100 s", "--junit", "gates.xml")
        self.ontime("report", self.results, *gates, code=1)
        answer = self.ontime("run", self.scenario(duration="6 s"), "--results", self.results, "--resume", *gates)
        self.assertNotIn("CUT OFF", answer.stdout, "the answer is of what was measured again")
        runs = json.loads(self.ontime("report", self.results, *gates, "--format", "json").stdout)["runs"]
        self.assertEqual([run["complete"] for run in runs], [False, True], "both are there")
        self.assertEqual(runs[0]["key"], runs[1]["key"])
        self.assertEqual(xml.etree.ElementTree.parse(self.folder / "gates.xml").getroot().get("tests"), "3")
        shutil.copy(self.results, self.folder / "copy.ontime")
        self.ontime("compare", self.results, self.folder / "copy.ontime", *gates)

    def test_a_requirement_that_is_none_is_refused_where_it_stands(self):
        answer = self.ontime("run", self.scenario("late <= 0, p98 <= 2 ms"), "--results", self.results, code=2)
        self.assertIn("scenario.yaml:6:26: require: 'p98 <= 2 ms', column 1: 'p98' is not a metric", answer.stderr)
        self.assertFalse(self.results.exists())

    def test_a_requirement_changes_no_key(self):
        self.measured()
        self.measured(require="lost <= 50%")
        runs = json.loads(self.ontime("report", self.results, "--format", "json").stdout)["runs"]
        self.assertEqual(runs[0]["key"], runs[1]["key"])

    def test_fail_if(self):
        self.measured()
        before = self.results.read_bytes()
        self.ontime("report", self.results, "--fail-if", "late > 1000000", "--fail-if", "max > 100 s")
        answer = self.ontime("report", "--fail-if", "p50 > 1 ns", self.results, code=1)
        self.assertRegex(answer.stderr, r"FAIL: p50 <= 1 ns \(one udp \(run 1\)\): p50 is .*(slower|interval)")
        self.assertIn("All tables:", answer.stdout, "the report is printed although the gate failed")
        answer = self.ontime("report", self.results, "--fail-if", "p99.99 > 1 s", code=1)
        self.assertIn("measure longer", answer.stderr)
        answer = self.ontime("report", self.results, "--fail-if", "p99 > +10%", code=2)
        self.assertIn("--fail-if: 'p99 > +10%', column 7:", answer.stderr)
        self.ontime("report", self.results, "--fail-if", "late > 0", "--junit", self.folder / "no" / "x.xml", code=2)
        self.assertEqual(self.results.read_bytes(), before)
        scenario = pathlib.Path(self.scenario())
        as_written = scenario.read_bytes()
        self.ontime("run", scenario, "--results", self.folder / "none.ontime", "--junit", scenario, code=2)
        self.assertEqual(scenario.read_bytes(), as_written)
        self.assertFalse((self.folder / "none.ontime").exists(), "nothing was measured")
        self.ontime("run", scenario, "--results", self.results, "--fail-if", "p50 > 1 ns", code=1)

    def test_junit_is_written_before_the_reader_of_the_text_is_gone(self):
        self.measured()
        shutil.copy(self.results, self.folder / "copy.ontime")
        for command in (f"report {self.results}", f"compare {self.results} copy.ontime"):
            subprocess.run(["bash", "-c", f"{ONTIME} {command} --fail-if 'late > 0' --junit cut.xml > >(exec true) 2>&1"],
                           cwd=self.folder, timeout=60)
            xml.etree.ElementTree.parse(self.folder / "cut.xml")
            (self.folder / "cut.xml").unlink()

    # --- what is chosen ---

    def test_a_list_does_not_take_the_name_that_follows(self):
        scenario = self.folder / "two.yaml"
        scenario.write_text("hosts: loopback\ndefaults: {transport: [udp, opendds], period: 5 ms, duration: 100 ms}\n"
                            "runs: [{id: one}, {id: two}, {id: three}]\n")
        self.ontime("run", "--only", "one", scenario, "--transports", "udp", "--results", self.results)
        self.ontime("run", "--transports", "udp", scenario, "--only", "one,two", "--results", self.results)
        self.ontime("run", scenario, "--only", "one", "--only", "three", "--transports", "udp", "--results", self.results)
        runs = json.loads(self.ontime("report", self.results, "--format", "json").stdout)["runs"]
        self.assertEqual([run["id"] for run in runs], ["one", "one", "two", "one", "three"])
        plain = {**os.environ, "LC_ALL": "C"}
        self.assertNotIn("iconv", self.ontime("plot", "--runs", "1,3", self.results, "--output", "runs.svg", env=plain).stderr)
        self.ontime("plot", "--runs", "1", "--runs", "3", self.results, "--output", "again.svg")
        self.assertEqual((self.folder / "runs.svg").read_text(), (self.folder / "again.svg").read_text())
        answer = self.ontime("plot", self.results, "--figure", "payload", "--output", "one.svg", code=2)
        self.assertIn("payload", answer.stderr)
        self.assertFalse((self.folder / "one.svg").exists(), "one payload is no comparison")
        answer = self.ontime("run", "--cable", "no0,no1", scenario, "--results", "cable.ontime", code=2)
        self.assertIn("two.yaml has other hosts", answer.stderr)
        answer = self.ontime("lab", "run", "--with", "/etc/passwd", scenario, "--results", "lab.ontime", code=2)
        self.assertIn("two.yaml: the lab needs hosts: namespaces", answer.stderr)

    def test_runs_are_chosen_out_of_several_scenarios(self):
        suite = self.folder / "suite"
        suite.mkdir()
        for name in ("a", "b"):
            (suite / f"{name}.yaml").write_text(f"hosts: loopback\nruns: [{{id: {name}, transport: udp, duration: 100 ms}}]\n")
        self.ontime("run", suite, "--only", "b", "--results", self.results)
        runs = json.loads(self.ontime("report", self.results, "--format", "json").stdout)["runs"]
        self.assertEqual([run["id"] for run in runs], ["b"])
        answer = self.ontime("run", suite, "--only", "b,c", "--results", self.results, code=2)
        self.assertIn("these 2 scenarios have no run 'c'; there are: a, b", answer.stderr)

    # A results file may come from elsewhere.
    def test_texts_in_figures_are_drawn_as_they_are_and_run_nothing(self):
        texts = ["'quoted' id", "''", "'", "it's 'bounded'", "`touch made`", '"`touch made`"', "'.`touch made`.'", '".system("touch made")."',
                 "@made", "\\", "\\'", "'\\", "'; system 'touch made'; #", "'\nsystem 'touch made'\n", "{/*99 a} x_y^z", "%g %s", "$made", "END"]
        (self.folder / "two.yaml").write_text("hosts: loopback\ndefaults: {transport: udp, duration: 100 ms}\n"
                                              "runs: [{id: a, payload: [100 B, 200 B]}]\n")
        self.ontime("run", self.folder / "two.yaml", "--results", self.results)
        for text in texts:
            with contextlib.closing(sqlite3.connect(self.results)) as file, file:
                file.execute("UPDATE run SET asked = json_set(asked, '$.title', ?1, '$.id', ?1)", [text])
            for figure in ("time", "ccdf", "conditions", "payload"):
                with self.subTest(text, figure=figure):
                    self.ontime("plot", self.results, "--figure", figure, "--output", "texts.svg", "--only", "1,2")
                    drawn = "".join(xml.etree.ElementTree.parse(self.folder / "texts.svg").getroot().itertext())
                    self.assertIn("".join(text.split()), "".join(drawn.split()))
        self.ontime("compare", self.results, "--from", "1", "--to", "2", "--plot", "texts.svg")
        self.assertFalse((self.folder / "made").exists())

    # --- what it is called ---

    def test_results_of_this_folder_are_called_after_it(self):
        self.scenario(duration="100 ms")
        self.ontime("run", ".")
        self.assertEqual(len(list(self.folder.glob(f"{self.folder.name}-*.ontime"))), 1, list(self.folder.iterdir()))

    def test_results_with_one_beginning_have_a_page_each(self):
        for name in ("day.1", "day.2"):
            self.ontime("run", self.scenario(duration="100 ms"), "--results", name)
        self.assertEqual(sorted(path.name for path in self.folder.glob("*.html")), ["day.1.html", "day.2.html"])

    # --- what a terminal shows ---

    def test_what_is_done_already_has_a_line_of_its_own(self):
        path = self.folder / "three.yaml"
        path.write_text("hosts: loopback\ndefaults: {duration: 100 ms}\n"
                        "runs: [{id: a, transport: broken}, {id: b, transport: broken}, {id: c, transport: udp}]\n")
        (self.folder / "ontime_transport_broken.so").write_text("it is there, and does not load")
        environment = unittest.mock.patch.dict(os.environ, ONTIME_TRANSPORT_PATH=str(self.folder))
        self.enterContext(environment)
        arguments = ("run", str(path), "--results", str(self.results), "--resume")
        self.ontime(*arguments, code=3)
        shown, process = on_a_terminal([ONTIME, *arguments], stdin=None, stdout=subprocess.DEVNULL, cwd=self.folder,
                                       env=dict(os.environ, TERM="xterm"))
        self.addCleanup(process.kill)
        self.assertEqual(process.wait(180), 3)
        line = next(line for line in shown.decode().split("\r\n") if "skipped (already" in line)
        self.assertRegex(line, r"^(.*\r\x1b\[K)?\[3/3[^…]* c udp  skipped \(already in results\)$")

    # --- what comes to nothing ---

    def test_a_run_that_cannot_begin_leaves_no_file(self):
        path = self.folder / "unreachable.yaml"
        path.write_text("hosts: {component: {host-prefix: ['false'], address: 127.0.0.1}}\n"
                        "runs: [{id: one, transport: udp, duration: 100 ms}]\n")
        self.ontime("run", path, code=3)
        self.ontime("run", path, "--results", "mine.ontime", code=3)
        self.assertEqual([entry.name for entry in self.folder.iterdir()], ["unreachable.yaml"])

    def test_a_transport_that_was_not_copied_to_its_end_is_named(self):
        plugin = next(pathlib.Path(ONTIME).resolve().parent.parent.rglob("ontime_transport_udp.so"))
        whole = plugin.read_bytes()
        cut = self.folder / "ontime_transport_udp.so"
        self.enterContext(unittest.mock.patch.dict(os.environ, ONTIME_TRANSPORT_PATH=str(self.folder)))
        for size in (0, 40, 70, 5000, len(whole) // 2, len(whole) - 1):
            cut.write_bytes(whole[:size])
            said = self.ontime("ping", "--transport", "udp", "--loopback", "--duration", "100ms", code=3).stderr
            self.assertIn(str(cut), said)
            if size > 64:  # there is an ELF header
                self.assertIn("truncated", said)

    def test_what_a_transport_declares_on_its_machine_is_respected(self):
        folder = next(pathlib.Path(ONTIME).resolve().parent.parent.rglob("ontime_transport_modest.so")).parent
        path = self.folder / "foreign.yaml"
        host = f"{{host-prefix: [env, 'ONTIME_TRANSPORT_PATH={folder}'], address: 127.0.0.1, interface: lo}}"
        path.write_text(f"hosts: {{controller: {host}, component: {host}}}\n"
                        "runs: [{id: a, transport: modest, payload: 16 B, duration: 100 ms, link: {message-priority: 6}}]\n")
        self.assertIn("modest bypasses the packet filter", self.ontime("run", path, code=2).stderr)

    def test_all_hosts_are_checked_before_the_first_run(self):
        path = self.folder / "unready.yaml"
        path.write_text("hosts:\n  controller: {host-prefix: ['false'], address: 127.0.0.1}\n"
                        "  component: {host-prefix: [env, ONTIME_TEST=1], address: 127.0.0.1}\n"
                        "runs: [{id: one, transport: [udp, unheard-of], duration: 100 ms}]\n")
        said = self.ontime("run", path, code=3).stderr
        self.assertIn("2 problems", said)
        self.assertIn("controller", said)
        self.assertIn("the component's machine: no transport 'unheard-of'", said)
        self.assertNotIn("keeper of", said)  # a word of ontime's own
        self.assertEqual([entry.name for entry in self.folder.iterdir()], ["unready.yaml"])

    def test_a_ping_without_a_pong_leaves_no_run(self):
        lonely = ("ping", "--transport", "udp", "--peer", "127.0.0.1", "--wait", "100 ms", "--duration", "100 ms")
        self.ontime(*lonely, "--results", "mine.ontime", code=3)
        self.assertEqual(list(self.folder.iterdir()), [])
        self.measured()
        before = json.loads(self.ontime("report", self.results, "--format", "json").stdout)
        self.ontime(*lonely, "--results", self.results, code=3)
        self.assertEqual(json.loads(self.ontime("report", self.results, "--format", "json").stdout), before)

    def test_a_ping_that_is_interrupted_before_a_pong_was_there_shows_no_run(self):
        process = self.start("ping", "--transport", "udp", "--peer", "127.0.0.1", "--domain", "79", "--wait", "1 min",
                             "--results", self.results)

        def begun():
            with contextlib.suppress(sqlite3.Error), \
                    contextlib.closing(sqlite3.connect(f"file:{self.results}?mode=ro", uri=True)) as database:
                return database.execute("SELECT count(*) FROM run").fetchone()[0] > 0

        self.assertTrue(eventually(begun))
        process.send_signal(signal.SIGINT)
        out, error = process.communicate(timeout=180)
        self.assertEqual((process.returncode, out), (130, ""), error)
        self.assertFalse(self.results.exists())

    def test_of_a_search_the_number_of_runs_is_a_bound(self):
        path = self.folder / "search.yaml"
        path.write_text("runs: [{id: one, transport: udp, payload: [1 kB, 2 kB, 4 kB], search: payload, "
                        "duration: 100 ms, require: [lost <= 50%]}]\n")
        self.assertIn("at most 3 runs", self.ontime("scenarios", path).stdout)
        self.assertTrue(json.loads(self.ontime("scenarios", path, "--format", "json").stdout)[0]["searches"])

    def test_resumed_search_ends_where_its_report_does(self):
        path = self.folder / "search.yaml"
        path.write_text("hosts: loopback\nruns: [{id: one, transport: udp, payload: [1 kB, 2 kB, 3 kB, 4 kB], search: payload, "
                        "period: 50 ms, deadline: 2 s, timeout: 3 s, duration: 200 ms}]\n")
        self.ontime("run", path, "--results", self.results)
        with contextlib.closing(sqlite3.connect(self.results)) as database, database:
            database.executescript("DELETE FROM sample WHERE run > 2; DELETE FROM note WHERE run > 2; DELETE FROM run WHERE number > 2")
            # Late by response time alone, which the ontime that measured it did not count.
            database.execute("UPDATE sample SET woke_after_ns = woke_after_ns + 2500000000 WHERE run = 2 AND message = 0")
        self.ontime("run", path, "--results", self.results, "--resume")
        report = json.loads(self.ontime("report", self.results, "--format", "json").stdout)
        self.assertEqual([search["ended"]["value"] for search in report["searches"]], ["2 kB"])
        self.assertEqual(len(report["runs"]), 2, "all others are beyond it")

    def test_an_empty_choice_is_wrong_usage(self):
        for flag in ("--transports", "--only", "--duration", "--results"):
            self.ontime("run", self.scenario(), flag, "", code=2)
        self.assertIn("a value is needed", self.ontime("run", self.scenario(), "--transports", "", code=2).stderr)

    def test_json_steers_no_terminal(self):
        for command in (("check",), ("tune", "show"), ("scenarios",)):
            done = subprocess.run([ONTIME, *command, "--format", "json"], capture_output=True, text=True, timeout=60)
            json.loads(done.stdout)
            self.assertTrue(done.stdout.isascii(), command)

    def test_a_file_without_a_run_holds_no_line(self):
        self.measured()
        with contextlib.closing(sqlite3.connect(self.results)) as database:
            database.executescript("DELETE FROM sample; DELETE FROM run")
        self.ontime("report", self.results)
        for flags in (["--fail-if", "late > 0"], ["--junit", "none.xml"]):
            answer = self.ontime("report", self.results, *flags, code=1)
            self.assertIn("open: the file has a run", answer.stderr)
        self.assertEqual(xml.etree.ElementTree.parse(self.folder / "none.xml").getroot().get("errors"), "1")

    # --- comparing ---

    def test_a_change_is_seen_and_chance_is_not(self):
        """60,000 messages that come in bursts, as they do; the two halves of one run, and a p99 that is 20 % longer."""
        self.measured()
        chance = random.Random(1)
        round_trips, level = [], 0.0
        for _ in range(120_000):
            level = 0.9 * level + chance.gauss(0, 0.2)
            round_trips.append(int(100_000 * 2 ** (level + chance.gauss(0, 0.3))))
        first, second = round_trips[:60_000], round_trips[60_000:]
        a, b = self.copy_with("a.ontime", first), self.copy_with("b.ontime", second)
        gate = ("--fail-if", "p99 > +10%", "--single-runs")
        answer = self.ontime("compare", a, b, *gate[:2], code=1)
        self.assertIn("open: p99 <= +10% (one udp)", answer.stderr, "one run a side tells nothing of the next start")
        self.ontime("compare", a, b, *gate)
        slower = self.copy_with("slower.ontime", (int(ns * 1.2) for ns in second))
        answer = self.ontime("compare", a, slower, *gate, "--full", "--junit", "compare.xml", code=1)
        self.assertRegex(answer.stderr, r"FAIL: p99 <= \+10% \(one udp\): p99 went from .* to .* 98 % interval")
        self.assertRegex(answer.stdout, r"\np99 .* higher\n")
        self.assertEqual(xml.etree.ElementTree.parse(self.folder / "compare.xml").getroot().get("failures"), "1")
        self.ontime("compare", slower, a, *gate)
        told = json.loads(self.ontime("compare", a, slower, *gate, "--format", "json", code=1).stdout)
        self.assertIn(("p99 <= +10%", "one udp", "missed"),
                      [(one["gate"], one["run"], one["result"]) for one in told["gates"]])
        for form in ("json", "csv", "markdown", "latex", "html"):
            wanted = "cannot tell" if form in ("json", "csv") else "lower"
            self.assertIn(wanted, self.ontime("compare", slower, a, "--format", form).stdout)
        answer = self.ontime("compare", a, slower)
        self.assertRegex(answer.stdout, r"^In these runs slower.ontime had a higher p99 than a.ontime\.")
        self.assertRegex(answer.stdout, r"\nAll metrics: +ontime compare \S+ \S+ --full\n$")

    def test_what_has_no_partner_holds_no_line(self):
        self.measured()
        other = self.folder / "other.ontime"
        self.ontime("run", self.scenario(duration="200 ms"), "--results", other)
        answer = self.ontime("compare", self.results, other).stdout
        self.assertRegex(answer, rf"\ANo run of {self.results.name} has the same\s+conditions")
        answer = self.ontime("compare", self.results, other, "--fail-if", "p50 > +900%", code=1)
        self.assertIn("no run of B has the same conditions", answer.stderr)
        self.ontime("compare", self.results, other, "--from", "1", "--to", "one", "--fail-if", "lost > +900%",
                    "--single-runs")
        self.ontime("compare", self.results, code=2)
        self.ontime("compare", self.results, "--from", "1", code=2)
        self.assertIn("'two'", self.ontime("compare", self.results, other, "--only", "two", code=2).stderr)

    def test_no_output_takes_the_place_of_results(self):
        self.measured()
        other = self.folder / "other.ontime"
        shutil.copy(self.results, other)
        before = self.results.read_bytes()
        for arguments in (("compare", self.results, other, "--output", self.results),
                          ("compare", self.results, other, "--junit", other),
                          ("report", self.results, "--output", other), ("report", self.results, "--junit", self.results),
                          ("plot", self.results, "--output", self.folder / "link.svg")):
            if arguments[0] == "plot":
                (self.folder / "link.svg").symlink_to(other)
            self.assertIn("is a results file", self.ontime(*arguments, code=2).stderr)
            self.assertEqual(self.results.read_bytes(), before)
            self.assertEqual(other.read_bytes(), before)

    def test_output_replaces_only_files_of_its_kind(self):
        self.measured()
        self.measured(duration="200 ms")
        sides = ("--from", "1", "--to", "2")
        tables = (("report",), ("report", "--full"), ("report", "--threads"), ("report", "--layers"), ("compare", *sides))
        written = {"text.txt": tables,
                   **{form: [(*table, "--format", form) for table in tables] for form in ("json", "csv", "latex", "html")},
                   "time.svg": (("plot",),), "time.pdf": (("plot",),), "time.png": (("plot",),)}
        written["json"].append(("export", "--format", "jsonl"))
        written["csv"].append(("export",))
        for name, commands in written.items():
            (self.folder / name).touch()
            for command, *more in commands * 2:
                with self.subTest(name, command=command, more=more):
                    self.ontime(command, self.results, *more, "--output", self.folder / name)
        others = {"load.yaml": b"# SPDX\nruns: []\n", "Makefile": b"all:\n", "robot.urdf": b"<robot/>", "data.csv": b"time,x\n1,2\n",
                  "paper.tex": b"% Mine\n\\documentclass{x}\n", "mine.html": b"<!DOCTYPE html>\n<title>Mine</title>\n",
                  "robot.pcap": b"\xd4\xc3\xb2\xa1\x02\0\x04\0", "robot.mcap": b"\x89MCAP0\r\n", "drawn.svg": b"runs: []\n"}
        for name, content in others.items():
            (self.folder / name).write_bytes(content)
        for command, *more in [("plot",)] + [commands[-1] for name, commands in written.items() if not name.startswith("time")]:
            for name in ["drawn.svg"] if command == "plot" else others:
                with self.subTest(name, command=command, more=more):
                    answer = self.ontime(command, self.results, *more, "--output", self.folder / name, code=2)
                    self.assertRegex(answer.stderr, f"{name} exists and is no|is none of the formats")
                    self.assertEqual((self.folder / name).read_bytes(), others[name])
        self.assertIn("exists and is no", self.ontime("listen", "--for", "1h", "--output", self.folder / "load.yaml", code=2).stderr)
        self.ontime("report", self.results, "--output", "/dev/stdout")

    def test_runs_that_are_not_alike_are_no_repetitions(self):
        self.measured()
        self.measured(duration="200 ms")
        answer = self.ontime("compare", self.results, "--from", "one", "--to", "2", code=2)
        self.assertIn("--from one: runs 1 and 2 have different conditions", answer.stderr)
        self.ontime("compare", self.results, "--from", "1", "--to", "2")

    def test_a_number_stands_for_its_repetitions_and_a_key_for_its_values(self):
        for _ in range(2):
            for period in ("5 ms", "10 ms"):
                self.measured(duration="200 ms", period=period)
        def runs(*flags, code=0):
            answer = self.ontime("compare", self.results, *flags, "--format", "json", code=code)
            return [(pair["from"]["runs"], pair["to"]["runs"]) for pair in json.loads(answer.stdout)["pairs"]] if code == 0 else answer.stderr
        self.assertEqual(runs("--from", "1", "--to", "2"), [([1, 3], [2, 4])])
        self.assertEqual(runs("--by", "period"), [([1, 3], [2, 4])])
        self.assertEqual(runs("--by", "period", "--from", "10000", "--to", "5000"), [([2, 4], [1, 3])])
        self.assertIn("--from 1 --to 3: both name the same runs", runs("--from", "1", "--to", "3", code=2))
        self.assertIn("transport: udp", runs("--by", "transport", code=2))
        self.assertIn("unknown key 'perod' (did you mean 'period'?)", runs("--by", "perod", code=2))
        self.assertIn("unknown key 'foo'; these differ between the runs: period", runs("--by", "foo", code=2))
        self.ontime("ping", "--transport", "udp", "--loopback", "--option", "port=7901", "--duration", "200 ms", "--results", self.results)
        self.assertIn("unknown key 'port' (did you mean 'options.port'?)", runs("--by", "port", code=2))
        self.assertIn("in common", runs(self.results, code=2))

    # --- out ---

    def test_export_has_every_sample(self):
        self.measured()
        sent = json.loads(self.ontime("report", self.results, "--format", "json").stdout)["runs"][0]["sent"]
        rows = list(csv.DictReader(io.StringIO(self.ontime("export", self.results).stdout)))
        self.assertEqual(len(rows), sent)
        lines = self.ontime("export", self.results, "--format", "jsonl", "--run", "1").stdout.splitlines()
        self.assertEqual([json.loads(line)["received_ns"] for line in lines], [int(row["received_ns"]) for row in rows])
        self.ontime("export", self.results, "--output", "out.csv")
        self.assertEqual((self.folder / "out.csv").read_text().count("\n"), sent + 1)
        before = self.results.read_bytes()
        for arguments, word in ((["--run", "7"], "no run '7'"), (["--format", "parquet"], "Debian 12"),
                                (["--format", "x"], "'x'"), (["--output", self.results], "is a results file")):
            self.assertIn(word, self.ontime("export", self.results, *arguments, code=2).stderr)
        for output, fix in ((self.folder / "no" / "out.csv", "make its folder"), (self.results / "out.csv", "make its folder"),
                            (self.folder, "name a file in this folder")):
            self.assertIn(fix, self.ontime("export", self.results, "--output", output, code=2).stderr)
        # As a process of the same number left it that was killed.
        again = subprocess.run(["sh", "-c", 'echo old >again.csv.part-$$; exec "$@"', "sh", ONTIME, "export", self.results,
                                "--output", "again.csv"], cwd=self.folder, capture_output=True, text=True)
        self.assertEqual(again.returncode, 0, again.stderr)
        self.assertEqual((self.folder / "again.csv").read_bytes(), (self.folder / "out.csv").read_bytes())
        (left,) = self.folder.glob("again.csv.part-*")
        self.assertEqual(left.read_text(), "old\n", "it may be another's")
        left.unlink()
        for arguments, code, words in (("export {} >&-", 3, "standard output is closed"), ("tune show >&-", 3, "standard output is closed"),
                                       ("export {} >/dev/full", 3, "or free disk space")):
            done = subprocess.run(["sh", "-c", f"{ONTIME} {arguments.format(self.results)}"], capture_output=True, text=True)
            self.assertEqual(done.returncode, code, done.stderr)
            self.assertIn(words, done.stderr)
        with open("/dev/full", "w") as full:
            for arguments in (["export", self.results], ["--help"]):
                self.assertEqual(subprocess.run([ONTIME, *arguments], stdout=full, stderr=full).returncode, 3)
        self.assertEqual(self.results.read_bytes(), before)
        self.assertEqual([path.name for path in self.folder.iterdir() if ".part" in path.name], [])


if __name__ == "__main__":
    unittest.main(verbosity=2)
