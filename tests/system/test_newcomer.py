#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What a newcomer types first, and types wrongly: each answer says what to do. ONTIME names the program."""

import contextlib
import os
import pathlib
import re
import signal
import sqlite3
import subprocess
import tempfile
import unittest

from program import ONTIME, eventually, on_a_terminal, sample_count


class Newcomer(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="ontime-test-")
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)

    def ontime(self, *arguments, code=0, **environment):
        done = subprocess.run([ONTIME, *arguments], cwd=self.folder, capture_output=True, text=True, timeout=120,
                              env={**os.environ, **environment})
        self.assertEqual(done.returncode, code, f"{arguments}\n{done.stdout}{done.stderr}")
        return done

    def test_alone_it_says_what_to_do_next_in_ten_lines(self):
        lines = self.ontime(LANG="C", NO_COLOR="1").stdout.splitlines()
        self.assertLessEqual(len(lines), 10)
        self.assertLessEqual(max(map(len, lines)), 80)
        text = "\n".join(lines)
        for command in ("--loopback", "ontime check", "ontime run", "ontime init", "ontime --help"):
            self.assertIn(command, text)

    def test_loopback_needs_no_second_terminal(self):
        done = self.ontime("ping", "--transport", "udp", "--loopback", "--duration", "200 ms", "--results", "r.ontime")
        self.assertIn("udp", done.stdout)
        (self.folder / "newer.ontime").touch()
        self.assertIn("ontime report r.ontime", self.ontime().stdout)
        for flag, value in (("--peer", "127.0.0.1"), ("--interface", "lo"), ("--wait", "1 s")):
            self.ontime("ping", "--transport", "udp", "--loopback", flag, value, code=2)

    @unittest.skipUnless(os.geteuid() == 0, "needs root, to have less of it")
    def test_root_of_a_container_is_told_what_permits_it(self):
        """It has the capabilities of `docker run` without options."""
        in_container = ["setpriv", "--bounding-set=-all,+chown,+dac_override,+fowner,+fsetid,+kill,+setgid,+setuid,+setpcap,"
                        "+net_bind_service,+net_raw,+sys_chroot,+mknod,+audit_write,+setfcap", "--inh-caps=-all"]

        def ontime(*arguments):
            done = subprocess.run([*in_container, ONTIME, *arguments], cwd=self.folder, capture_output=True, text=True, timeout=120)
            self.assertNotRegex(done.stdout + done.stderr, "sudo|as root,|setcap|run it as root")
            return done
        (self.folder / "own.yaml").write_text("runs: [{id: loaded, transport: udp, duration: 500 ms, deadline: 1 us, realtime: on, "
                                              "load: {controller: {cpu: 1}}}]\n")
        done = ontime("run", "own.yaml", "--results", "r.ontime")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("--cap-add SYS_ADMIN --cap-add NET_ADMIN", done.stderr)
        full = " ".join(ontime("report", "r.ontime", "--full").stdout.split())
        for words in "both ends were on loopback", "--cap-add SYS_ADMIN", "--cap-add SYS_NICE --ulimit rtprio=99 --ulimit memlock=-1":
            self.assertIn(words, full)
        self.assertNotIn("stress-ng", full)
        self.assertNotIn("--explain", done.stdout)
        searched = ontime("tune", "search", "./own.yaml", "--goal", "p50 < 1 s")
        self.assertEqual(searched.returncode, 3, searched.stderr)
        self.assertIn("--cap-add SYS_ADMIN", searched.stderr)
        self.assertIn("ontime run demo ", ontime().stdout)
        denied = ontime("listen", "/x", "--for", "1s")
        self.assertEqual(denied.returncode, 3, denied.stdout)
        self.assertIn("--cap-add SYS_ADMIN", denied.stderr)

    def test_every_report_says_that_an_ordinary_users_ends_were_on_loopback(self):
        (self.folder / "own.yaml").write_text("runs: [{id: idle, transport: udp, duration: 100 ms}]\n")
        ordinary = ["setpriv", "--bounding-set=-all", "--inh-caps=-all"] if os.geteuid() == 0 else []
        done = subprocess.run([*ordinary, ONTIME, "run", "own.yaml", "--results", "r.ontime"], cwd=self.folder, capture_output=True,
                              text=True, timeout=120)
        self.assertEqual(done.returncode, 0, done.stderr)
        for shown in done, *(self.ontime("report", "r.ontime", *flags) for flags in ((), ("--full",), ("--format", "html"))):
            self.assertIn("both ends were on loopback: no permission", " ".join(shown.stdout.split()))

    def test_a_mistyped_word_is_answered_with_the_nearest(self):
        (self.folder / "own.yaml").write_text(
            "hosts: loopback\nruns: [{id: idle, transport: udp, duration: 100 ms}]\n")
        self.ontime("run", "own.yaml", "--results", "r.ontime")
        for arguments, code, meant in ((["reprot"], 2, "'report'"), (["tune", "aply"], 2, "'apply'"),
                                       (["run", "x.yaml", "--onyl", "a"], 2, "'--only'"),
                                       (["ping", "--transprot", "udp"], 2, "'--transport'"),
                                       (["tune", "search", "own.yaml", "--goal", "max < 1 s", "--never", "irq"], 2, "'irq-threads'?)\n"),
                                       (["run", "dmeo"], 2, "'demo'"),
                                       (["run", "own.yaml", "--transports", "upd"], 2, "'udp'"),
                                       (["ping", "--transport", "upd", "--loopback"], 2, "'udp'"),
                                       (["export", "r.ontime", "--only", "idel"], 2, "'idle'"),
                                       (["run", "own.yaml", "--duration", "5"], 2, "'5 s'")):
            with self.subTest(arguments):
                self.assertIn(f"did you mean {meant}", self.ontime(*arguments, code=code).stderr)

    def test_a_mistyped_option_is_not_called_a_command(self):
        for arguments in (["--verison"], ["tune", "--verison"]):
            with self.subTest(arguments):
                self.assertIn("option '--verison'", self.ontime(*arguments, code=2).stderr)

    def test_a_forgotten_value_does_not_take_the_next_option(self):
        for next_word in ("--realtime", "-h"):
            with self.subTest(next_word):
                answer = self.ontime("ping", "--transport", "udp", "--loopback", "--results", next_word, code=2)
                self.assertIn(f"--results: a value is missing before {next_word}", answer.stderr)
                self.assertFalse((self.folder / next_word).exists())

    def test_an_option_before_its_command_is_told_its_place(self):
        for place, *arguments in (("--format after ontime report", "--format", "json", "report", "x.ontime"),
                                  ("--full after ontime report", "--full", "report"),
                                  ("--set after ontime tune apply", "tune", "--set", "gro=off", "apply")):
            with self.subTest(arguments):
                self.assertIn(place, self.ontime(*arguments, code=2).stderr)

    def test_an_interrupted_run_says_once_how_to_go_on(self):
        for name in ("one", "two"):
            (self.folder / f"{name}.yaml").write_text(f"hosts: loopback\nruns: [{{id: {name}, transport: udp, duration: 60 s}}]\n")
        for arguments in (["one.yaml"], ["one.yaml", "--format", "json"], ["one.yaml", "two.yaml"]):
            with self.subTest(arguments), subprocess.Popen([ONTIME, "run", *arguments, "--results", f"{len(arguments)}.ontime"],
                                                           cwd=self.folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as run:
                file = self.folder / f"{len(arguments)}.ontime"
                self.assertTrue(eventually(lambda: sample_count(file) > 0), run.poll())
                run.send_signal(signal.SIGINT)
                shown, said = run.communicate(timeout=120)
                self.assertEqual(run.returncode, 130)
                line = f"run {' '.join(arguments)} --results {file.name} --resume"
                self.assertIn(line, said if "json" in arguments else shown)
                self.assertEqual((said.count(" --resume"), shown.count("Finish:")), (1, 0) if "json" in arguments else (0, 1), shown + said)
                file.unlink()

    def test_a_path_never_means_an_installed_scenario(self):
        for name in ("./demo", "./demo.yaml", "../demo", "/demo.yaml", "./lab", "demo.yaml", "./scenarios/demo.yaml", ""):
            with self.subTest(name):
                self.assertIn("no such scenario", self.ontime("scenarios", name, code=2).stderr)
        self.assertIn("did you mean 'demo'", self.ontime("scenarios", "./demo.yaml", code=2).stderr)
        (self.folder / "my runs").mkdir()
        self.assertIn("'./my runs'", self.ontime("run", "my runs", code=2).stderr)
        for name in ("demo", "lab", "lab/tsn", "lab/tsn.yaml", "scenarios/demo.yaml", "scenarios/lab"):
            with self.subTest(name):
                self.ontime("scenarios", name)

    def test_a_current_folder_that_was_removed_is_named(self):
        with tempfile.TemporaryDirectory() as folder:
            answer = subprocess.run(["sh", "-c", 'mkdir "$1" && cd "$1" && rmdir "$1" && exec "$2" run demo', "sh", f"{folder}/gone", ONTIME],
                                    capture_output=True, text=True)
        self.assertEqual((answer.returncode, answer.stderr), (2, "ontime: the current folder was removed. Fix: cd to another\n"))

    def test_a_cpu_that_is_not_there_is_wrong_usage(self):
        said = self.ontime("ping", "--transport", "udp", "--loopback", "--cpus", "1000", code=2).stderr
        self.assertIn("--cpus", said)
        self.assertIn("1000", said)

    def test_an_ordinary_user_who_asks_for_causes_is_told_the_fix(self):
        ordinary = ["setpriv", "--reuid", "65534", "--regid", "65534", "--clear-groups"] if os.geteuid() == 0 else []
        done = subprocess.run([*ordinary, ONTIME, "ping", "--transport", "udp", "--loopback", "--explain"], cwd="/",
                              capture_output=True, text=True, timeout=120)
        self.assertEqual(done.returncode, 3, done.stderr)
        self.assertIn("Fix: run as root", done.stderr)

    def test_ending_of_the_output_decides_the_format(self):
        for name in ("a.ontime", "b.ontime"):
            self.ontime("ping", "--transport", "udp", "--loopback", "--duration", "200 ms", "--results", name)
        for command in ("report", "a.ontime"), ("compare", "a.ontime", "b.ontime"):
            for ending, begin in ((".html", "<!DOCTYPE html>"), (".json", "{"), (".txt", None)):
                with self.subTest(command, ending=ending):
                    file = self.folder / f"{command[0]}{ending}"
                    self.ontime(*command, "--output", file.name)
                    text = file.read_text()
                    self.assertEqual(text, self.ontime(*command, *(["--format", ending[1:]] if begin else [])).stdout)
                    self.assertTrue(text.lower().startswith((begin or "").lower()), text[:80])
                    self.ontime(*command, "--format", "table", "--output", f"{command[0]}-table.txt")
            self.assertIn("ontime plot", self.ontime(*command, "--output", "g.PDF", code=2).stderr)
            self.assertFalse((self.folder / "g.PDF").exists())

    def test_a_value_without_its_option_is_answered_with_the_option(self):
        for word, option in (("10.0.0.2", "--peer 10.0.0.2"), ("udp", "--transport udp")):
            self.assertIn(f"Fix: {option}", self.ontime("ping", word, code=2).stderr)

    def test_a_word_before_the_command_is_named(self):
        self.assertIn("unexpected argument 'me'", self.ontime("me", "ping", code=2).stderr)

    def test_help_is_a_command_too(self):
        for command in [], ["ping"], ["tune", "apply"]:
            self.assertEqual(self.ontime("help", *command).stdout, self.ontime(*command, "--help").stdout)
        self.assertIn("'pimg' (did you mean 'ping'?)", self.ontime("help", "pimg", code=2).stderr)

    def test_an_option_that_is_given_twice_is_refused_by_name(self):
        said = self.ontime("ping", "--transport", "udp", "--duration", "1 s", "--duration", "2 s", code=2).stderr
        self.assertIn("--duration is given twice", said)

    def test_scenarios_of_the_lab_last_simulated_time(self):
        lines = self.ontime("scenarios").stdout.splitlines()
        self.assertTrue(any(line.startswith("lab/") for line in lines))
        for line in lines:
            self.assertEqual("simulated time" in line.rpartition(":")[2], line.startswith("lab/"), line)

    def test_transports_are_listed_where_one_is_needed(self):
        for command, further in (("ping", " --loopback"), ("pong", "")):
            self.assertIn(f". Fix: {ONTIME} {command} --payload '1 kB' --transport udp{further}\n",
                          self.ontime(command, "--payload", "1 kB", code=2).stderr)
            self.assertIn("installed: ", self.ontime(command, "--help").stdout)
        self.ontime("ping", "--payload", "1 kB", "--transport", "udp", "--loopback", "--duration", "100 ms")

    def test_runs_are_named_in_one_way(self):
        (self.folder / "own.yaml").write_text(
            "hosts: loopback\ndefaults: {transport: udp, duration: 100 ms}\nruns: [{id: one}, {id: two}]\n")
        self.ontime("run", "own.yaml", "--results", "r.ontime")
        of_one = self.ontime("export", "r.ontime", "--only", "one").stdout
        self.assertEqual(of_one, self.ontime("export", "r.ontime", "--only", "1").stdout)
        self.assertEqual(of_one, self.ontime("export", "r.ontime", "--run", "1").stdout)
        self.assertNotEqual(of_one, self.ontime("export", "r.ontime", "--only", "one,2").stdout)
        self.ontime("explain", "r.ontime", "--only", "two")
        self.assertIn("one by one: 1,2,3", self.ontime("report", "r.ontime", "--only", "1-3", code=2).stderr)
        self.assertNotIn("one by one", self.ontime("report", "r.ontime", "--only", "three", code=2).stderr)

    def test_hosts_that_cannot_be_reached_get_no_scenario(self):
        done = self.ontime("init", "robot@no-such-host.invalid", code=3)
        self.assertEqual(done.stderr.count("robot@no-such-host.invalid"), 1)
        self.ontime("init", "-oProxyCommand=x", code=2)
        self.ontime("init", "a", "b", "c", code=2)
        self.assertIn("'a b' is not a host", self.ontime("init", "a b", code=2).stderr)
        self.assertEqual(list(self.folder.iterdir()), [])
        (self.folder / "robot.yaml").write_text("mine")
        self.assertIn("exists", self.ontime("init", "robot", code=2).stderr)
        self.assertEqual((self.folder / "robot.yaml").read_text(), "mine")
        (self.folder / "10.9.0.2.yaml").write_text("mine")
        self.assertIn("10.9.0.2.yaml exists", self.ontime("init", "root@10.9.0.2", code=2).stderr)

    def test_hosts_that_ssh_reaches_by_ipv6_get_their_ipv4_addresses(self):
        ssh = self.folder / "ssh"
        ssh.write_text('#!/bin/sh\nfor command; do :; done\nexec sh -c "$command"\n')
        ssh.chmod(0o755)

        def init(connection, code):
            return self.ontime("init", "robot", code=code, SSH_CONNECTION=connection, PATH=f"{self.folder}:{os.environ['PATH']}").stderr

        said = init("::1 5000 2001:db8::9 22", 3)
        self.assertIn("robot: ssh uses the IPv6 address 2001:db8::9. Messages need an IPv4 address", said)
        self.assertFalse((self.folder / "robot.yaml").exists())
        self.assertNotIn("another host", init("::1 5000 ::1%lo 22", 0))
        hosts = [line.strip() for line in (self.folder / "robot.yaml").read_text().splitlines() if "address:" in line]
        self.assertEqual(hosts, ["controller: {interface: lo, address: 127.0.0.1}",
                                 "component: {ssh: robot, interface: lo, address: 127.0.0.1}"])

    def test_init_through_a_jump_host_writes_this_machines_own_address(self):
        ssh = self.folder / "ssh"
        ssh.write_text('#!/bin/sh\nfor command; do :; done\nexec sh -c "$command"\n')
        ssh.chmod(0o755)
        done = self.ontime("init", "robot", SSH_CONNECTION="203.0.113.9 5000 127.0.0.1 22", PATH=f"{self.folder}:{os.environ['PATH']}")
        self.assertIn("another host (203.0.113.9)", done.stderr)
        self.assertIn("controller: {interface: lo, address: 127.0.0.1}", (self.folder / "robot.yaml").read_text())

    def test_help_fits_and_groups_commands_by_purpose(self):
        text = self.ontime("--help", LANG="C").stdout
        groups = [line.rstrip(":") for line in text.splitlines() if line.endswith(":") and not line.startswith(" ")]
        self.assertEqual([group for group in groups if group not in ("Options", "Usage")],
                         ["Measure", "Understand", "Tune", "Try", "Set up"])

    def on_a_terminal(self, *arguments, watched=None, columns=80, **environment):
        """What a terminal got, as bytes. `watched`: as `when` and `then` of program's."""
        shown, child = on_a_terminal([ONTIME, *arguments], columns, **(watched or {}), cwd=self.folder,
                                     env={**os.environ, "TERM": "xterm", **environment})
        child.wait(timeout=120)
        return shown

    def test_watch_draws_anew_where_it_drew_before_in_a_narrow_terminal(self):
        with subprocess.Popen([ONTIME, "ping", "--transport", "udp", "--loopback", "--duration", "1 h", "--results", "r.ontime"],
                              cwd=self.folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as ping, contextlib.ExitStack() as end:
            end.callback(ping.terminate)
            self.assertTrue(eventually(lambda: sample_count(self.folder / "r.ontime") > 0), ping.poll())
            # ontime watch lets all others run first: on a busy machine it is seldom its turn.
            shown = self.on_a_terminal("watch", "r.ontime", columns=40, LC_ALL="C.UTF-8",
                                       watched={"when": lambda shown: shown.count(b"\x1b[J") > 1, "then": lambda _: ping.terminate()})
            shown = shown.decode().replace("\r\n", "\n")
        first, *others = re.split("\x1b\\[([0-9]+)A\x1b\\[J", shown)
        self.assertGreater(len(others), 0, shown)
        for before, up in zip([first, *others[1::2]], others[::2]):
            rows = sum(max(1, -(-len(line) // 40)) for line in before.rstrip("\n").split("\n"))
            self.assertEqual(int(up), rows, before)

    def test_a_terminal_without_utf_8_gets_ascii_and_no_colour(self):
        for arguments in (["--help"], ["ping", "--help"], ["reprot"],
                          ["ping", "--transport", "udp", "--loopback", "--duration", "200 ms"]):
            with self.subTest(arguments):
                shown = self.on_a_terminal(*arguments, LC_ALL="C", NO_COLOR="1")
                self.assertTrue(shown)
                self.assertTrue(shown.isascii(), shown)
                self.assertNotRegex(shown, rb"\x1b\[[0-9;]*m")
        self.assertIn("·".encode(), self.on_a_terminal("--help", LC_ALL="C.UTF-8"))
        (self.folder / "s.yaml").write_text(
            "hosts: loopback\nruns: [{id: ü, transport: udp, duration: 100 ms}, "
            "{id: o, transport: udp, duration: 200 ms}, {id: p, transport: udp, duration: 1 s}]\n")
        self.ontime("run", "s.yaml", "--results", "s.ontime")
        # One for each character of the id "ü", and none for ontime's own.
        for unknown, *arguments in (b"??", "report", "s.ontime", "--full"), (b"?", "compare", "s.ontime", "--from", "2", "--to", "3"):
            with self.subTest(arguments):
                shown = self.on_a_terminal(*arguments, LC_ALL="C")
                self.assertTrue(shown.isascii(), shown)
                self.assertNotIn(unknown, shown)

    def test_a_terminal_gets_each_verdict_of_compare_once(self):
        for name in ("a.ontime", "b.ontime"):
            self.ontime("ping", "--transport", "udp", "--loopback", "--duration", "200 ms", "--results", name)
        compare = "compare", "a.ontime", "b.ontime", "--fail-if", "max > 1 ns"
        self.assertEqual(self.on_a_terminal(*compare).count(b"FAIL: max <= 1 ns"), 1)
        self.assertEqual(self.on_a_terminal(*compare, "--format", "csv").count(b"FAIL: max <= 1 ns"), 1)
        self.assertIn("FAIL: max <= 1 ns", self.ontime(*compare, code=1).stderr)

    def test_progress_says_what_it_waits_for_and_how_long_it_takes(self):
        shown = self.on_a_terminal("ping", "--transport", "udp", "--peer", "127.0.0.1:9", "--wait", "300 ms",
                                   LC_ALL="C.UTF-8").decode()
        self.assertIn("waiting for pong at 127.0.0.1:9", shown)
        (self.folder / "two.yaml").write_text("hosts: loopback\ndefaults: {transport: udp, duration: 200 ms}\n"
                                              "runs: [{id: a}, {id: b}]\n")
        shown = self.on_a_terminal("run", "./two.yaml", LC_ALL="C.UTF-8").decode()
        self.assertRegex(shown, r"\[1/2, ≥ [0-9]+ s left\] a udp  starting")
        self.assertRegex(shown, r"\[2/2, [0-9]+ s left\] b udp  starting")

    def test_log_of_a_run_says_what_begins(self):
        (self.folder / "two.yaml").write_text("hosts: loopback\ndefaults: {transport: udp, duration: 200 ms}\n"
                                              "runs: [{id: a}, {id: b}]\n")
        said = self.ontime("run", "./two.yaml").stderr
        self.assertRegex(said, r"\[1/2, ≥ [0-9]+ s left\] a udp .*200 ms.*\n\[1/2.* \d+ late, \d+ lost of \d+ messages.*\n\[2/2, [0-9]+ s left\] b udp .*200 ms.*\n\[2/2")

    def test_progress_is_cut_between_words(self):
        shown = self.on_a_terminal("ping", "--transport", "udp", "--peer", "127.0.0.1:9", "--wait", "300 ms", columns=36,
                                   LC_ALL="C.UTF-8").decode()
        self.assertIn("\x1b[Kping udp  waiting for pong at …\r", shown)

    def test_scenario_without_a_title_has_its_name_alone(self):
        (self.folder / "own.yaml").write_text("runs: [{id: a, transport: udp, duration: 0.3 s, period: 7 ms}, {id: b, transport: udp}]\n")
        self.assertTrue(self.ontime("scenarios", "own.yaml").stdout.startswith("own.yaml  2 runs, "))
        self.assertRegex(self.ontime("scenarios", "own.yaml", "--format", "json").stdout, r'"seconds": \d+\.\d{1,3}\b')

    def test_help_states_the_exit_codes(self):
        for command in ("run", "init", "ping", "report", "check", "lab run", "lab shell", "tune apply", "tune search"):
            self.assertRegex(self.ontime(*command.split(), "--help").stdout, "Exit codes: 0 .* 2 invalid usage", command)

    def test_help_of_pong_states_its_own_default_payload(self):
        for command, default in ("ping", "500 B"), ("pong", "60 kB"):
            self.assertRegex(self.ontime(command, "--help").stdout, rf"--payload SIZE .*\(default: {default}\)")

    def test_only_commands_that_take_settings_list_them(self):
        for command, lists in (("apply", True), ("revert", False), ("verify", False)):
            self.assertEqual("Settings:" in self.ontime("tune", command, "--help").stdout, lists, command)

    def test_long_lines_are_wrapped_on_a_terminal(self):
        for arguments in (["scenarios"], ["tune", "show", "--interface", "lo"]):
            for columns in (40, 80):
                with self.subTest(arguments, columns=columns):
                    lines = self.on_a_terminal(*arguments, columns=columns, LC_ALL="C.UTF-8").decode().splitlines()
                    self.assertEqual([line for line in lines if len(line) > columns], [])

    def test_errors_break_lines_between_words_and_keep_commands_whole(self):
        for arguments in (["run", "dmo"], ["ping", "--transport", "udp", "--loopback", "--period", "10"],
                          ["tune", "search", "demo", "--goal", "p99 < 1 ms", "--never", "frobnicate"], ["ping"]):
            with self.subTest(arguments):
                shown = self.on_a_terminal(*arguments, LC_ALL="C.UTF-8").decode().replace("\r", "")
                self.assertEqual([line for line in shown.splitlines() if len(line) > 80], [])
                piped = self.ontime(*arguments, code=2).stderr
                self.assertEqual(piped.count("\n"), 1)
                self.assertEqual(shown.split(), piped.split())
        self.assertRegex(shown, r"\n  \S*ontime ping --transport udp --loopback\n")

    def test_an_error_before_the_first_message_stands_alone(self):
        for arguments in (["--option", "prot=7"], ["--payload", "1 MB"], ["--loopback", "--option", "port=70000"]):
            done = subprocess.run([ONTIME, "ping", "--transport", "udp", *arguments], cwd=self.folder, capture_output=True, text=True,
                                  timeout=120)
            self.assertEqual((done.returncode, done.stdout), (2, ""), done.stderr)

    def test_a_sentence_about_ontime_is_no_command_to_paste(self):
        (self.folder / "own.yaml").write_text("hosts:\n  controller: {}\n  component: {address: 127.0.0.1, host-prefix: [sh, -c, 'exit 7']}\n"
                                              "runs: [{id: one, transport: udp, duration: 100 ms}]\n")
        shown = self.on_a_terminal("run", "own.yaml", LC_ALL="C.UTF-8", TERM="dumb").decode().splitlines()
        self.assertIn("ontime: ontime on the component's machine", shown[0])
        self.assertEqual([line for line in shown if len(line) > 80], [])

    def test_further_lines_of_a_foreign_text_are_no_commands_to_paste(self):
        foreign = "a\n  sudo reboot " + 20 * "now and then "
        for arguments in ["ping", foreign], ["run", foreign], ["report", foreign]:
            piped = self.ontime(*arguments, code=2).stderr
            shown = self.on_a_terminal(*arguments, LC_ALL="C.UTF-8", TERM="dumb").decode()
            for line in (piped + shown).splitlines():
                self.assertRegex(line, "^(ontime: |  \\| |See: |  [^s])")
        self.assertGreater(shown.count("\n"), 3)

    def test_id_from_a_foreign_file_is_no_line_to_paste(self):
        self.ontime("ping", "--transport", "udp", "--loopback", "--duration", "200 ms", "--results", "r.ontime")
        with contextlib.closing(sqlite3.connect(self.folder / "r.ontime")) as database, database:
            database.execute("""UPDATE run SET asked = replace(asked, '"id":"ping"', '"id":"a\\n  sudo reboot"')""")
        for arguments, code in (["--only", "x"], 2), (["--fail-if", "max > 1 ns"], 1):
            told = self.ontime("report", "r.ontime", *arguments, code=code).stderr
            self.assertIn("sudo reboot", told)
            self.assertEqual(told.count("\n"), 1, told)

    def test_check_begins_with_its_errors_and_ends_with_their_names(self):
        done = subprocess.run([ONTIME, "check"], capture_output=True, text=True, timeout=60)
        marks = re.findall(r"^(error  |warning|       ) ([a-z-]+): ", done.stdout, re.MULTILINE)
        self.assertGreater(len(marks), 6)
        order = ["error  ", "warning", "       "]
        self.assertEqual(marks, sorted(marks, key=lambda mark: order.index(mark[0])))
        errors = list(dict.fromkeys(check for level, check in marks if level == order[0]))
        last = done.stdout[done.stdout.rindex("OK: "):]
        self.assertEqual(done.returncode, 1 if errors else 0)
        for check in errors:
            self.assertIn(check, last)

    def test_help_and_check_break_lines_between_words(self):
        for columns in 40, 80:
            for arguments in [], ["--help"], ["run", "--help"], ["ping", "--help"], ["check"]:
                with self.subTest(arguments, columns=columns):
                    shown = self.on_a_terminal(*arguments, columns=columns, LC_ALL="C.UTF-8").decode()
                    lines = shown.replace("\r", "").splitlines()
                    self.assertGreater(len(lines), 6)
                    # A command to copy stays whole, and so does a word.
                    long = [line for line in lines if len(line) > columns
                            and "fix: " not in line and " " in line.strip()]
                    self.assertEqual(long, [])
        piped = subprocess.run([ONTIME, "check"], capture_output=True, text=True, timeout=60).stdout.splitlines()
        self.assertEqual([line for line in piped if len(line) > 80 and "fix: " not in line], [])
        wide = self.ontime("ping", "--help").stdout
        self.assertGreater(max(map(len, wide.splitlines())), 80)  # man pages are made of it


if __name__ == "__main__":
    unittest.main(verbosity=2)
