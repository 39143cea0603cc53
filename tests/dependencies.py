#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""debian/control, package.xml (by rosdep's keys), docs/how-to/install.md, cmake/needs.cmake and scripts/setup name the same
Debian packages. CMAKE and GENERATOR name what the tests were configured with."""

import os
import pathlib
import re
import subprocess
import tempfile
import unittest
import xml.etree.ElementTree

ROOT = pathlib.Path(__file__).resolve().parent.parent
# Keys that rosdep resolved for Debian bookworm, Ubuntu jammy and noble (rosdistro of 2026-08-22), with what they install on
# Debian 12 where the name is another. Where ROS 2 is not installed from packages, its own keys are those of the sourced one.
ROSDEP = {key: {key} for key in ("clang", "cmake", "iproute2", "libboost-dev", "libgmock-dev", "libmnl-dev", "libsodium-dev",
                                 "libsqlite3-dev", "libssl-dev", "openssh-client", "pkg-config", "python3-yaml", "sqlite3",
                                 "stress-ng")}
ROSDEP |= {"cli11": {"libcli11-dev"}, "fmt": {"libfmt-dev"}, "gtest": {"libgtest-dev"}, "libmicrohttpd": {"libmicrohttpd-dev"},
           "libpcap": {"libpcap-dev"}, "nlohmann-json-dev": {"nlohmann-json3-dev"}, "yaml-cpp": {"libyaml-cpp-dev"},
           "zlib": {"zlib1g-dev"}}
ROS = {"cyclonedds": {"cyclonedds-dev"}, "fastrtps": {"libfastcdr-dev", "libfastrtps-dev"}} | {key: set() for key in (
    "ament_cmake", "ament_cmake_python", "diagnostic_msgs", "launch", "launch_ros", "rclcpp", "rclcpp_components", "ros2cli",
    "rosidl_default_generators", "rosidl_default_runtime", "tlsf")}
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
    document = xml.etree.ElementTree.parse(ROOT / "package.xml")
    keys = {element.text for kind in kinds for element in document.iter(kind)}
    return {package for key in keys for package in (ROSDEP | ROS)[key]}


def beside_rosdep():
    """What the guide has installed by apt, because rosdep does not know it."""
    return set(re.search(r"sudo apt install (bpftool .*)", (ROOT / "docs/how-to/install.md").read_text())[1].split())


def setup(array):
    text = re.search(rf"\b{array}\+?=\((.*?)\)", (ROOT / "scripts/setup").read_text(), re.DOTALL)[1]
    return set(re.sub(r'#.*|"\$\{libraries\[@\]\}"', "", text).split())


class Dependencies(unittest.TestCase):
    def test_what_the_build_needs_is_the_same_for_debian_colcon_and_setup(self):
        needed = build_packages(tests=False)
        self.assertGreater(len(needed), 20)
        in_workspace = package_xml("buildtool_depend", "build_depend", "depend")
        self.assertLessEqual(in_workspace, needed)
        self.assertLessEqual(needed, in_workspace | beside_rosdep())
        to_run = package_xml("exec_depend") | beside_rosdep() - needed | set(control("Suggests", 1))
        self.assertEqual((setup("packages") | setup("libraries")) - ONLY_SETUP - to_run, needed)

    def test_what_the_unit_tests_need_is_the_same_for_debian_and_colcon_and_in_setup(self):
        self.assertEqual(package_xml("test_depend"), build_packages(tests=True))
        everything = (ROOT / "scripts/setup").read_text().split()
        self.assertLessEqual(build_packages(tests=True), {re.sub(r"^packages\+=\(", "", word) for word in everything})

    def test_what_a_run_needs_is_the_same_for_debian_and_colcon(self):
        needed = set(control("Depends", 1)) | set(control("Recommends", 1))
        built = build_packages(tests=False)
        self.assertEqual(package_xml("exec_depend") | beside_rosdep() - built,
                         {name for name in needed if not name.startswith("ontime")})

    def test_rosdep_knows_each_key_of_the_workspace(self):
        documents = [xml.etree.ElementTree.parse(path) for path in (ROOT / "package.xml", *ROOT.glob("ros2/*/package.xml"))]
        self.assertEqual(len(documents), 3)
        ours = {document.find("name").text for document in documents}
        keys = {element.text for document in documents for element in document.iter() if element.tag.endswith("depend")}
        self.assertLessEqual(keys, ROSDEP.keys() | ROS.keys() | ours)

    def test_what_apt_brings_rosdep_does_not(self):
        self.assertEqual(beside_rosdep() & set().union(*ROSDEP.values(), *ROS.values()), set())

    def test_what_is_missing_is_named_in_one_line(self):
        with tempfile.TemporaryDirectory() as folder:
            answer = subprocess.run(
                [os.environ["CMAKE"], "-G", os.environ["GENERATOR"], "-S", ROOT, "-B", folder, "-DBUILD_TESTING=OFF",
                 "-DCMAKE_DISABLE_FIND_PACKAGE_fmt=ON"],
                env={**os.environ, "PKG_CONFIG_LIBDIR": folder}, capture_output=True, text=True)
        self.assertNotEqual(answer.returncode, 0)
        line = re.search(r"^ *sudo apt install (.*)$", answer.stderr, re.MULTILINE)
        self.assertTrue(line, answer.stderr)
        named = set(line[1].split())
        self.assertLessEqual({"libfmt-dev", "libbpf-dev", "libtraceevent-dev"}, named)
        self.assertLessEqual(named, build_packages(tests=False))


if __name__ == "__main__":
    unittest.main()
