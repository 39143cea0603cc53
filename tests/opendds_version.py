#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Of an OpenDDS of another version than the transport is for CMake says so in a line, and all else is configured. CMAKE
and GENERATOR name what the tests were configured with."""

import os
import pathlib
import subprocess
import tempfile
import unittest

ROOT = pathlib.Path(__file__).resolve().parent.parent


def look_alike(folder, version):
    """What CMake looks for, as files that are as good as empty."""
    for name in ("ace/config.h", "tao/corba.h", "dds/DCPS/Service_Participant.h", "bin/opendds_idl", "bin/tao_idl",
                 *(f"lib/lib{name}.so" for name in ("OpenDDS_Rtps_Udp", "OpenDDS_Rtps", "OpenDDS_Dcps", "TAO_AnyTypeCode",
                                                    "TAO", "ACE"))):
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch(mode=0o755)
    parts = zip(("MAJOR", "MINOR", "MICRO"), version.split("."))
    (folder / "dds/Version.h").write_text("".join(f"#define DDS_{part}_VERSION {number}\n" for part, number in parts))


class OpenDdsVersion(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(cls.enterClassContext(tempfile.TemporaryDirectory()))

    def configured_with(self, version):
        look_alike(self.folder, version)
        answer = subprocess.run(
            [os.environ["CMAKE"], "-G", os.environ["GENERATOR"], "-S", ROOT, "-B", self.folder / "build", "-DBUILD_TESTING=OFF",
             "-DONTIME_BENCH=OFF"],
            env={**os.environ, **dict.fromkeys(("DDS_ROOT", "ACE_ROOT", "TAO_ROOT"), str(self.folder))}, capture_output=True, text=True)
        self.assertEqual(answer.returncode, 0, answer.stderr)
        return answer.stdout.replace(str(self.folder), "FOLDER")

    def test_another_is_told_and_left_out(self):
        self.assertIn("opendds is not built: it needs OpenDDS 3.13, but FOLDER has 3.14.1\n", self.configured_with("3.14.1"))

    def test_what_it_is_for_is_taken(self):
        self.assertNotIn("opendds is not built", self.configured_with("3.13.9"))


if __name__ == "__main__":
    unittest.main()
