#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""debian/control, package.xml (with rosdep's keys) and scripts/setup name the same Debian packages."""

import pathlib
import re
import unittest
import xml.etree.ElementTree

import yaml

ROOT = pathlib.Path(__file__).resolve().parent.parent
# Keys of rosdep's own lists, and what they install on Debian 12 where the name is another.
ROSDEP = {"cli11": {"libcli11-dev"}, "cyclonedds": {"cyclonedds-dev"}, "fastrtps": {"libfastcdr-dev", "libfastrtps-dev"},
          "fmt": {"libfmt-dev"}, "google-mock": {"libgmock-dev"}, "gtest": {"libgtest-dev"},
          "libmicrohttpd": {"libmicrohttpd-dev"}, "libpcap": {"libpcap-dev"}, "nlohmann-json-dev": {"nlohmann-json3-dev"},
          "yaml-cpp": {"libyaml-cpp-dev"}, "zlib": {"zlib1g-dev"}}
# Debian's own tools for packages; colcon has make in place of ninja, and a compiler is there.
ONLY_DEBIAN = {"debhelper-compat", "ninja-build"}
ONLY_SETUP = {"g++", "ninja-build"}


def control(field, paragraph=0):
    """{package: its build profile}"""
    text = (ROOT / "debian/control").read_text().split("\n\n")[paragraph]
    entries = re.search(rf"^{field}:((?:\n? [^\n]*)+)", text, re.MULTILINE)[1].split(",")
    parts = [re.match(r"\s*([a-z0-9.+-]+)(?::\w+)?(?: \([^)]*\))?(?: <(!\w+)>)?\s*$", entry) for entry in entries]
    return {part[1]: part[2] for part in parts if part}


def build_packages(tests):
    return {name for name, profile in control("Build-Depends").items() if (profile == "!nocheck") == tests} - ONLY_DEBIAN


def package_xml(*kinds):
    own = yaml.safe_load((ROOT / "ros2/rosdep.yaml").read_text())
    document = xml.etree.ElementTree.parse(ROOT / "package.xml")
    keys = {element.text for kind in kinds for element in document.iter(kind)}
    return {package for key in keys for package in (own[key]["debian"] if key in own else ROSDEP.get(key, {key}))}


def setup(array):
    text = re.search(rf"\b{array}\+?=\((.*?)\)", (ROOT / "scripts/setup").read_text(), re.DOTALL)[1]
    return set(re.sub(r'#.*|"\$\{libraries\[@\]\}"', "", text).split())


class Dependencies(unittest.TestCase):
    def test_what_the_build_needs_is_the_same_for_debian_colcon_and_setup(self):
        needed = build_packages(tests=False)
        self.assertGreater(len(needed), 20)
        self.assertEqual(package_xml("buildtool_depend", "build_depend", "depend"), needed)
        to_run = package_xml("exec_depend") | set(control("Suggests", 1))
        self.assertEqual((setup("packages") | setup("libraries")) - ONLY_SETUP - to_run, needed)

    def test_what_the_unit_tests_need_is_the_same_for_debian_and_colcon_and_in_setup(self):
        self.assertEqual(package_xml("test_depend"), build_packages(tests=True))
        everything = (ROOT / "scripts/setup").read_text().split()
        self.assertLessEqual(build_packages(tests=True), {re.sub(r"^packages\+=\(", "", word) for word in everything})

    def test_what_a_run_needs_is_the_same_for_debian_and_colcon(self):
        needed = set(control("Depends", 1)) | set(control("Recommends", 1))
        self.assertEqual(package_xml("exec_depend"), {name for name in needed if not name.startswith("ontime")})

    def test_rosdep_keys_of_our_own_are_used(self):
        document = xml.etree.ElementTree.parse(ROOT / "package.xml")
        self.assertLessEqual(set(yaml.safe_load((ROOT / "ros2/rosdep.yaml").read_text())), {e.text for e in document.iter()})


if __name__ == "__main__":
    unittest.main()
