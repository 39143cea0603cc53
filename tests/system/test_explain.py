#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Why messages were late: causes that are made here, named by the real program. Needs root, and skips without. ONTIME names
the program."""

import contextlib
import importlib.machinery
import importlib.util
import io
import json
import os
import pathlib
import re
import signal
import subprocess
import sys
import tempfile
import time
import unittest
import unittest.mock

from program import ONTIME, eventually, kill_at_once, sample_count, trace_instances

CULPRITS = pathlib.Path(__file__).resolve().parent.parent / "culprits" / "culprits"
SCENARIO = "hosts: namespaces\ndefaults: {transport: udp, duration: %s%s}\nruns: [{id: explained}]\n"


def ontime(*arguments):
    return subprocess.run([ONTIME, *arguments], capture_output=True, text=True, timeout=120)


def loaded_culprits():
    loader = importlib.machinery.SourceFileLoader("culprits", str(CULPRITS))
    culprits = importlib.util.module_from_spec(importlib.util.spec_from_loader("culprits", loader))
    sys.modules["culprits"] = culprits  # where dataclasses look
    with unittest.mock.patch("sys.dont_write_bytecode", True):
        loader.exec_module(culprits)
    return culprits


@unittest.skipUnless(os.geteuid() == 0, "tracing needs root")
class Explain(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="ontime-explain-")
        self.addCleanup(folder.cleanup)
        self.scenario, self.results = (str(pathlib.Path(folder.name) / name) for name in ("s.yaml", "r.ontime"))

    def write(self, duration, more=""):
        pathlib.Path(self.scenario).write_text(SCENARIO % (duration, more))

    def test_what_was_made_is_named(self):
        first_is_right = r"^1 drop-(in|out) (controller|component) udp: (right|dropped \w+ NETFILTER_DROP \(\2\))"
        for seed in ("1", "2", "3"):  # a busy machine makes others late beside
            said = subprocess.run([CULPRITS, "--only", "drop-in,drop-out", "--seed", seed], capture_output=True, text=True,
                                  timeout=280)
            if len(re.findall(first_is_right, said.stdout + said.stderr, re.MULTILINE)) == 4:
                return
        self.fail(said.stdout + said.stderr)

    def test_culprits_are_judged_by_all_that_was_late_or_lost(self):
        culprits = loaded_culprits()
        kinds = {kind.name: kind for kind in culprits.KINDS}

        def part(cause, us, culprit="", stage="delivered", end="component"):
            return {"cause": cause, "stage": stage, "end": end, "culprit": culprit, "us": us}

        def verdict(kind, *firsts, end="component"):
            messages = [{"fate": "lost" if one["us"] == 0 else "late", "delay_us": one["us"], "parts": [one]} for one in firsts]
            messages.append({"fate": "on time", "delay_us": 9e9, "parts": [part("unknown", 9e9)]})
            firsts = {json.dumps({**one, "us": 0}): one for one in firsts}.values()
            return culprits.judged(kinds[kind], end, {"causes": list(firsts), "messages": messages}).right

        stopped, unknown, short = part("stopped", 80e3), part("unknown", 10e3), part("unknown", 1e3)
        self.assertTrue(verdict("stop", stopped, stopped, unknown))
        self.assertFalse(verdict("stop", stopped, unknown), "not most of them")
        self.assertFalse(verdict("stop", stopped, stopped, part("cpu", 90e3, "hog")), "not most of the delay")
        self.assertFalse(verdict("stop", stopped, short, short, short))
        self.assertTrue(verdict("two", part("waited", 20e3), stopped))
        self.assertFalse(verdict("two", part("waited", 20e3)))
        dropped, lost = part("dropped", 0, "NETFILTER_DROP"), part("unknown", 0)
        self.assertTrue(verdict("drop-in", dropped, dropped, dropped, dropped, unknown))
        self.assertFalse(verdict("drop-in", dropped, dropped, lost), "of the messages")
        self.assertTrue(verdict("link-down", part("link-down", 0, "eth0 was taken down", "left")))
        self.assertFalse(verdict("link-down", part("link-down", 0, "eth0 was taken down", "left", "controller")), "the peer")
        self.assertFalse(verdict("link-down", part("link-down", 0, "eth0 had no carrier", "left")), "no thread did it")
        self.assertFalse(verdict("link-down", dropped), "by another")

    def test_culprits_are_made_where_they_can_be_and_of_what_is_its_own(self):
        culprits = loaded_culprits()
        with subprocess.Popen(["sh", "-c", "sleep 60 & echo $!; wait"], stdout=subprocess.PIPE, text=True) as shell:
            sleeper = int(shell.stdout.readline())
            is_ours = sys.modules["ends"].is_ours
            self.assertTrue(is_ours(sleeper))
            os.kill(sleeper, signal.SIGKILL)
        self.assertFalse(is_ours(1) or is_ours(os.getppid()) or is_ours(sleeper))
        for error in (subprocess.CalledProcessError(1, ["ip"], stderr="no such\nCannot open network namespace\n"),
                      subprocess.TimeoutExpired(["ontime"], 120), OSError("gone"), IndexError("none")):
            with (unittest.mock.patch.object(culprits, "run", side_effect=error), unittest.mock.patch("sys.argv", ["culprits", "--only", "none"]),
                  contextlib.redirect_stdout(io.StringIO()) as said, contextlib.redirect_stderr(io.StringIO())):
                self.assertEqual(culprits.main(), 1)
            self.assertIn("| `none` | 0 of 1 | 0 % | no run 1 |", said.getvalue())
            self.assertIn(type(error).__name__, said.getvalue())
        culprits.KINDS = [kind for kind in culprits.KINDS if kind.name == "quota"]
        culprits.KINDS[0].lacks = lambda: "there is no /nowhere"
        with unittest.mock.patch("sys.argv", ["culprits"]), contextlib.redirect_stdout(io.StringIO()) as said:
            self.assertEqual(culprits.main(), 0)
        self.assertIn("Not tried: quota: there is no /nowhere", said.getvalue())

    def test_a_run_is_explained_at_its_end_and_later(self):
        self.write("2 s", ", explain: on, link.loss: 20 %")
        run = ontime("run", self.scenario, "--results", self.results, "--full")
        self.assertEqual(run.returncode, 0, run.stderr)
        later = ontime("explain", self.results)
        self.assertRegex(later.stdout, "[0-9] lost[^:]*Why:")
        self.assertIn("the packet was dropped at", later.stdout)
        self.assertIn(later.stdout, run.stdout)
        account = json.loads(ontime("explain", self.results, "--format", "json").stdout)[0]
        lost = next(message for message in account["messages"] if message["fate"] == "lost")
        one = ontime("explain", self.results, "--message", str(lost["message"]))
        self.assertIn(f"message {lost['message']} (lost)", one.stdout)
        self.assertEqual(ontime("explain", self.results, "--message", "100000").returncode, 2)
        self.assertEqual(ontime("explain", self.results, "--run", "2").returncode, 2)
        self.assertEqual(ontime("explain", self.results, "--format", "csv").returncode, 2)

    def test_pong_by_hand_keeps_what_its_machine_did(self):
        kept, other = self.results + ".pong", self.results + ".other"
        ping = [ONTIME, "ping", "--transport", "udp", "--domain", "88", "--peer", "127.0.0.1", "--deadline", "20 ms"]
        pong = [ONTIME, "pong", "--transport", "udp", "--domain", "88", "--explain", "--results", kept]
        with subprocess.Popen(pong, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as answers, contextlib.ExitStack() as ends:
            ends.callback(answers.terminate)
            self.assertIn("pong answers", answers.stderr.readline())
            with subprocess.Popen([*ping, "--duration", "5 s", "--results", self.results], stdout=subprocess.DEVNULL) as asks:
                self.assertTrue(eventually(lambda: sample_count(self.results) > 50), asks.poll())
                agent = subprocess.run(["pgrep", "-P", str(answers.pid), "-f", "ontime agent"], capture_output=True, text=True)
                stopped = int(agent.stdout)
                for number in signal.SIGSTOP, signal.SIGCONT:
                    os.kill(stopped, number)
                    time.sleep(0.2)  # so that this is the cause also on a busy machine
                self.assertEqual(asks.wait(timeout=180), 0)
            self.assertEqual(subprocess.run([*ping, "--duration", "100 ms", "--results", other], stdout=subprocess.DEVNULL).returncode, 0)
            answers.terminate()
            self.assertEqual(answers.wait(timeout=180), 0)
            self.assertIn("answered", answers.stdout.read())
        said = ontime("explain", self.results, "--pong", kept)
        self.assertEqual(said.returncode, 0, said.stderr)
        self.assertIn("pong's receive thread was stopped by a signal", said.stdout)
        self.assertIn("no trace from the controller. Fix: ontime ping --explain", said.stdout)
        self.assertRegex(said.stdout, r"clock error .*±[0-9.]+ µs")
        self.assertIn("without `explain: on`", ontime("explain", self.results).stdout)
        refused = ontime("explain", self.results, "--pong", other)
        self.assertEqual(refused.returncode, 2)
        self.assertIn("--pong", refused.stderr)
        for flags in (["--explain"], ["--results", kept]):
            self.assertEqual(ontime("pong", "--transport", "udp", *flags).returncode, 2)

    def test_pong_by_hand_keeps_what_there_is_when_its_agent_dies(self):
        kept = self.results + ".pong"
        common = ["--transport", "udp", "--domain", "87"]
        ping = [ONTIME, "ping", *common, "--peer", "127.0.0.1", "--deadline", "5 ms", "--duration", "500 ms", "--results", self.results]
        pong = [ONTIME, "pong", *common, "--explain", "--results", kept]
        with subprocess.Popen(pong, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as answers, contextlib.ExitStack() as ends:
            ends.callback(answers.terminate)
            self.assertIn("pong answers", answers.stderr.readline())
            self.assertEqual(subprocess.run(ping, stdout=subprocess.DEVNULL, timeout=60).returncode, 0)
            time.sleep(5)  # what came has been cut out
            agent = subprocess.run(["pgrep", "-P", str(answers.pid), "-f", "ontime agent"], capture_output=True, text=True)
            os.kill(int(agent.stdout), signal.SIGKILL)
            self.assertEqual(answers.wait(timeout=180), 3)
            self.assertIn("the agent", answers.stderr.read())
        said = ontime("explain", self.results, "--pong", kept, "--format", "json")
        self.assertEqual(said.returncode, 0, said.stderr)
        self.assertTrue(json.loads(said.stdout)[0]["messages"])

    def test_what_cannot_be_traced_says_why(self):
        pong = [ONTIME, "pong", "--transport", "udp", "--domain", "88"]
        ping = ["ping", "--transport", "udp", "--domain", "88", "--peer", "127.0.0.1", "--duration", "100 ms", "--explain"]
        ordinary = ["setpriv", "--bounding-set=-all", "--inh-caps=-all"]
        with subprocess.Popen(pong, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as answers, contextlib.ExitStack() as ends:
            ends.callback(answers.terminate)
            answers.stderr.readline()
            refused = subprocess.run([*ordinary, ONTIME, *ping], capture_output=True, text=True, timeout=60)
            self.assertEqual(refused.returncode, 3)
            self.assertIn("needs root", refused.stderr)
            with subprocess.Popen([*pong[:4], "--domain", "89", "--explain", "--results", self.results], stdout=subprocess.DEVNULL,
                                  stderr=subprocess.PIPE, text=True) as traced:
                traced.stderr.readline()
                refused = ontime(*ping)
                traced.terminate()
            self.assertEqual(refused.returncode, 3)
            self.assertRegex(refused.stderr, rf"another ontime changes this machine: process {traced.pid} \(.*ontime pong ")

    def test_a_ping_that_keeps_no_results_explains_at_once(self):
        ping = ["ping", "--transport", "udp", "--loopback", "--duration", "200 ms", "--explain"]
        said = ontime(*ping)
        self.assertEqual(said.returncode, 0, said.stderr)
        self.assertRegex(said.stdout, r"run 1, ping \(udp\): ")
        refused = ontime(*ping, "--format", "json")
        self.assertEqual(refused.returncode, 2)
        self.assertIn("--results FILE", refused.stderr)

    def test_a_run_without_traces_says_so(self):
        self.write("500 ms")
        self.assertEqual(ontime("run", self.scenario, "--results", self.results).returncode, 0)
        self.assertIn("without `explain: on`", ontime("explain", self.results).stdout)

    def test_a_kill_leaves_no_tracing(self):
        self.write("60 s", ", explain: on")
        with subprocess.Popen([ONTIME, "run", self.scenario, "--results", self.results], stdout=subprocess.DEVNULL,
                              stderr=subprocess.DEVNULL) as run:
            self.assertTrue(eventually(lambda: "ontime-trace" in trace_instances()), run.poll())
            keeper = subprocess.run(["pgrep", "-P", str(run.pid), "-f", "keeper"], capture_output=True, text=True)
            kill_at_once(*map(int, keeper.stdout.split()), run.pid)
        self.write("500 ms", ", explain: on")
        again = ontime("run", self.scenario, "--results", self.results)
        self.assertEqual(again.returncode, 0, again.stderr)
        self.assertIn("trace-instance ontime-trace", again.stderr)


if __name__ == "__main__":
    unittest.main()
