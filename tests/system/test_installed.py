#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What an installation has, and what is said of half of one. ONTIME_BUILD names the build tree, CMAKE the program."""

import configparser
import json
import os
import pathlib
import re
import shutil
import subprocess
import tempfile
import unittest


ROOT = pathlib.Path(__file__).resolve().parent.parent.parent


class Installed(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory(prefix="ontime-installed-")
        cls.addClassCleanup(folder.cleanup)
        cls.whole = pathlib.Path(folder.name) / "whole"
        subprocess.run([os.environ["CMAKE"], "--install", os.environ["ONTIME_BUILD"], "--prefix", cls.whole], check=True,
                       stdout=subprocess.DEVNULL)

    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="ontime-installed-")
        self.addCleanup(folder.cleanup)
        self.prefix = pathlib.Path(folder.name) / "prefix"
        shutil.copytree(self.whole, self.prefix)

    def ontime(self, *words, code=0, **environment):
        done = subprocess.run([self.prefix / "bin/ontime", *words], capture_output=True, text=True, cwd=self.prefix,
                              env={"PATH": os.environ["PATH"], "HOME": "/nonexistent", **environment})
        self.assertEqual(done.returncode, code, done.stdout + done.stderr)
        return done

    def ping(self, transport, code=0, **environment):
        return self.ontime("ping", "--loopback", "--transport", transport, "--duration", "1 s", "--format", "json",
                           code=code, **environment)

    def transport(self, name):
        return next(self.prefix.glob("lib/**/ontime")) / f"ontime_transport_{name}.so"

    def plug_in(self, file, abi):
        subprocess.run(["cc", "-shared", "-fPIC", "-x", "c", "-", "-o", file], check=True, text=True,
                       input=f"int ontime_transport[64] = {{{abi}}};")

    def test_an_installation_measures_wherever_it_lies(self):
        self.assertGreater(json.loads(self.ping("udp").stdout)["runs"][0]["on_time"], 0)
        self.assertIn("demo", self.ontime("scenarios").stdout)

    def test_an_installation_has_alerts_and_a_dashboard(self):
        self.assertEqual({file.name for file in (self.prefix / "share/ontime/prometheus").iterdir()}, {"alerts.yml", "dashboard.json"})

    def test_the_unit_of_pong_permits_real_time_by_limits_alone(self):
        unit = configparser.RawConfigParser(strict=False)
        unit.optionxform = str
        unit.read(ROOT / "debian/ontime.ontime-pong@.service")
        service = unit["Service"]
        # What a denied setting asks for (realtime::how_to_permit), without a capability.
        self.assertGreaterEqual(int(service["LimitRTPRIO"]), 98)
        self.assertEqual(service["LimitMEMLOCK"], "infinity")
        self.assertEqual(service["CapabilityBoundingSet"], "")
        # An ordinary user of its own: no other service's files, and none left behind.
        self.assertEqual(service["DynamicUser"], "yes")
        # Each would take away what the limits give.
        self.assertLessEqual({"User", "Group", "AmbientCapabilities", "RestrictRealtime", "CPUSchedulingPolicy", "SupplementaryGroups"}
                             & service.keys(), set())
        self.assertIn("@system-service", service["SystemCallFilter"])  # it has sched_setscheduler and mlockall
        # A service that is stopped answers as for Ctrl-C, and wrong options are no reason to start again.
        self.assertEqual((service["KillSignal"], service["SuccessExitStatus"]), ("SIGINT", "130"))
        self.assertEqual(service["RestartPreventExitStatus"].split(), ["2", "3"])

    @unittest.skipUnless(shutil.which("systemd-analyze"), "no systemd-analyze")
    def test_units_are_valid_and_as_hardened_as_the_manual_says(self):
        install, fleet = ((ROOT / "docs/how-to" / name).read_text() for name in ("install.md", "fleet.md"))
        for unit, page in ("ontime-pong@.service", install), ("ontime-listen.service", fleet):
            file = self.prefix / unit
            text = (ROOT / f"debian/ontime.{unit}").read_text()
            file.write_text(text.replace("/usr/bin/ontime", str(self.prefix / "bin/ontime")))
            done = subprocess.run(["systemd-analyze", "verify", "--man=no", file], capture_output=True, text=True)
            self.assertEqual((done.returncode, done.stderr), (0, ""))
            exposure = re.search(r"rates its exposure (\d)\.(\d)", page)
            limit = "".join(exposure.groups())
            done = subprocess.run(["systemd-analyze", "security", "--offline=true", f"--threshold={limit}", file],
                                  capture_output=True, text=True)
            self.assertEqual(done.returncode, 0, done.stdout[-200:])

    @unittest.skipUnless(shutil.which("help2man"), "no help2man: no manual pages")
    def test_each_manual_page_has_its_own_name_and_summary(self):
        summaries = set()
        pages = list((self.prefix / "share/man/man1").glob("*.1"))
        for page in pages:
            self.assertEqual(re.search(r"^\.TH (\S+)", page.read_text(), re.MULTILINE)[1].lower(), page.stem)
            names = re.findall(r"^\.SH NAME\n(.*) \\- (.*)$", page.read_text(), re.MULTILINE)
            self.assertEqual([name.replace("\\-", "-") for name, _ in names], [page.stem])
            self.assertNotRegex(page.read_text(), r"\?\?", "what help2man writes for … in another character set")
            summaries.add(names[0][1])
        commands = re.findall(r"^  ([a-z]+)  ", self.ontime("--help").stdout, re.MULTILINE)
        self.assertIn("run", commands)
        self.assertLessEqual({f"ontime-{command}" for command in commands}, {page.stem for page in pages})
        self.assertEqual(len(summaries), len(pages))

    def test_a_transport_that_is_not_installed_has_its_package_named(self):
        self.transport("cyclonedds").unlink(missing_ok=True)
        self.assertIn("ontime-transport-cyclonedds", self.ping("cyclonedds", code=3).stderr)

    def test_a_transport_of_ones_own_builds_as_the_manual_says(self):
        page = (ROOT / "docs/how-to/own-transport.md").read_text()
        text = re.search(r"```cmake\n(.*?)```", page, re.DOTALL).group(1)
        folder = self.prefix / "mine"
        folder.mkdir()
        (folder / "CMakeLists.txt").write_text(text.replace("ontime::message)", "ontime::message fmt sodium)"))
        # The page names it as the one to start from, so its headers are installed.
        (folder / "mine.cpp").write_text((ROOT / "src/transport/udp/udp.cpp").read_text().replace('.name = "udp"', '.name = "mine"'))
        for words in ["-B", "build", f"-DCMAKE_PREFIX_PATH={self.prefix}"], ["--build", "build"]:
            done = subprocess.run([os.environ["CMAKE"], *words], cwd=folder, capture_output=True, text=True)
            self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        self.assertTrue((folder / "build/ontime_transport_mine.so").exists())

    def test_a_transport_of_another_version_is_refused(self):
        self.plug_in(self.transport("udp"), abi=1)
        self.assertIn("another ontime", self.ping("udp", code=3).stderr)

    def test_the_transport_beside_the_program_comes_before_another_installation(self):
        for name, file in ("udp", "other.so"), ("gone", "gone.so"):
            index = self.prefix / "older/share/ament_index/resource_index/ontime_transport"
            index.mkdir(parents=True, exist_ok=True)
            (index / name).write_text(file)
        self.plug_in(self.prefix / "older/other.so", abi=1)
        older = str(self.prefix / "older")
        self.ping("udp", AMENT_PREFIX_PATH=older)
        self.transport("udp").unlink()
        self.assertIn(f"{older}/other.so", self.ping("udp", code=3, AMENT_PREFIX_PATH=older).stderr)
        self.assertIn(f"{older}/gone.so", self.ping("gone", code=3, AMENT_PREFIX_PATH=older).stderr)
        (index / "gone").write_text("")  # half installed
        self.assertIn(str(index / "gone"), self.ping("gone", code=3, AMENT_PREFIX_PATH=older).stderr)


if __name__ == "__main__":
    unittest.main()
