#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What the documents tell people to type, typed as it stands there. ONTIME: the program.

Of the CI services' files all but what is the service's own: checking out, installing and cloning ontime.
"""
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import unittest
import xml.etree.ElementTree

import yaml

sys.dont_write_bytecode = True  # the checkout stays as it is
ROOT = pathlib.Path(__file__).resolve().parent.parent.parent
sys.path.insert(0, str(ROOT / "bench"))
import results_file  # noqa: E402

ONTIME = pathlib.Path(os.environ.get("ONTIME", "build/release/bin/ontime")).resolve()
FENCE = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def blocks(document, language, section=None):
    text = (ROOT / document).read_text()
    if section:
        text = text.split(f"\n## {section}\n", 1)[1].split("\n## ", 1)[0]
    return [body for kind, body in FENCE.findall(text) if kind == language]


def commands(document):
    return [line.split("  #")[0].strip() for body in blocks(document, "sh") for line in body.splitlines()
            if line.startswith("ontime ")]


def outcome():
    host = {"machine": {"kernel_release": "6.1"}, "threads": [], "refusals": []}
    return {"interrupted": False, "hosts": {"controller": host, "component": host}}


class Docs(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(tempfile.mkdtemp(prefix="ontime-test-"))
        self.addCleanup(shutil.rmtree, self.folder)

    def shell(self, line, codes, shell=("sh", "-e", "-c")):
        environment = {**os.environ, "PATH": f"{ONTIME.parent}:{os.environ['PATH']}",
                       "GITHUB_STEP_SUMMARY": str(self.folder / "summary.md")}
        done = subprocess.run([*shell, line], cwd=self.folder, env=environment, capture_output=True, text=True, timeout=300)
        self.assertIn(done.returncode, codes, f"{line}\n{done.stdout}{done.stderr}")
        return done

    def test_a_pipeline_from_nothing(self):
        (self.folder / "ci.yaml").write_text(blocks("docs/how-to/ci.md", "yaml")[0])
        github = yaml.safe_load(blocks("docs/how-to/ci.md", "yaml", "GitHub")[0])
        gitlab = yaml.safe_load(blocks("docs/how-to/ci.md", "yaml", "GitLab")[0])
        self.assertIn(True, github, "'on', as YAML 1.1 reads it")
        steps = {step["name"]: step for step in github["jobs"]["ontime"]["steps"] if "name" in step}
        self.assertEqual(list(steps), ["Build ontime", "Measure", "Compare"])
        job = gitlab["ontime"]
        build = steps["Build ontime"]["run"].splitlines()
        self.assertEqual(build, job["before_script"], "both build it alike")
        self.assertIn(" program", build[2])
        self.assertTrue((ROOT / "scripts" / "setup").exists())
        measure, compare = job["script"]
        self.assertEqual(steps["Measure"]["run"], measure)
        self.assertEqual(blocks("docs/how-to/ci.md", "sh")[0].strip(), measure)

        # Whether it holds is a matter of the machine; that it measures, judges and writes is not.
        self.shell(measure, (0, 1))
        self.assertEqual(xml.etree.ElementTree.parse(self.folder / "ontime.xml").getroot().tag, "testsuites")
        self.shell(compare, (0,))  # without good.ontime nothing is compared
        self.assertFalse((self.folder / "compare.xml").exists())
        shutil.copy(self.folder / "now.ontime", self.folder / "good.ontime")
        self.assertEqual(steps["Compare"]["shell"], "bash -o pipefail {0}")
        script = self.folder / "step.sh"
        script.write_text(steps["Compare"]["run"])
        held = self.shell(f"bash -o pipefail {script}", (0, 1))
        self.assertIn("Round trip (µs)", (self.folder / "summary.md").read_text(), held.stderr)
        self.assertEqual(self.shell(compare, (0, 1)).returncode, held.returncode, "a pipe hides no gate")
        xml.etree.ElementTree.parse(self.folder / "compare.xml")
        self.shell(blocks("docs/how-to/ci.md", "sh")[1].strip(), (0, 1))
        for pattern in [job["artifacts"]["paths"][0], *job["artifacts"]["reports"]["junit"]]:
            self.assertTrue(list(self.folder.glob(pattern)), pattern)

    def files_of(self, *names):
        """What the documents' names stand for: two conditions, repeated, in several payloads."""
        for number, name in enumerate(names):
            runs = [(results_file.asked(3000, id=id, title=id, payload_bytes=payload, repetition=repetition), outcome(),
                     list(results_file.samples(1 + i, 3000, seed=10 * number + i)))
                    for i, (id, payload, repetition) in enumerate(
                        [("idle", 500, 1), ("loaded", 500, 1), ("idle", 500, 2), ("loaded", 500, 2)])]
            if name in ("layers.ontime", "test3.ontime"):
                runs = [(results_file.asked(3000, payload_bytes=500 * (i + 1)), outcome(), rows)
                        for i, (_, _, rows) in enumerate(runs)]
            if name == "demo.ontime":
                runs = [(results_file.asked(300, id=f"Test1.{chr(65 + i)}"), outcome(), list(results_file.samples(1 + i, 300)))
                        for i in range(10)]
            results_file.write(self.folder / name, runs)

    def test_comparing(self):
        self.files_of("before.ontime", "after.ontime", "results.ontime")
        (self.folder / "scenario.yaml").write_text(
            "hosts: loopback\nruns: [{id: one, transport: udp, period: 5 ms, duration: 500 ms}]\n")
        lines = commands("docs/how-to/compare.md")
        self.assertGreaterEqual(len(lines), 5)
        for line in lines:
            with self.subTest(line):
                self.shell(line, (0, 1) if "--fail-if" in line else (0,))
        self.assertTrue((self.folder / "report.xml").exists())

    def test_what_a_scenario_requires_is_read(self):
        wanted = yaml.safe_load(blocks("docs/how-to/compare.md", "yaml")[0])
        wanted["defaults"].update(transport="udp", duration="100 ms")
        (self.folder / "scenario.yaml").write_text("hosts: loopback\n" + yaml.safe_dump(wanted))
        self.assertIn("1 run", self.shell("ontime scenarios scenario.yaml", (0,)).stdout)

    def test_results_to_look_at(self):
        self.files_of("demo.ontime", "layers.ontime", "test3.ontime")
        # Those of mixed.ontime are in test_background.py.
        lines = [line for line in commands("docs/how-to/draw-figures.md") + commands("docs/reference/report.md")
                 if "mixed.ontime" not in line]
        self.assertGreaterEqual(len(lines), 4)
        for line in lines:
            with self.subTest(line):
                self.shell(line, (0,))
                named = re.search(r"--(?:output|plot) (\S+)", line)
                self.assertGreater((self.folder / (named[1] if named else "demo-time.svg")).stat().st_size, 1000)


if __name__ == "__main__":
    unittest.main(verbosity=2)
