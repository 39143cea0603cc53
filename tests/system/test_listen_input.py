#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Files and flags of `ontime listen` that need no node: captures, and what is refused."""

import contextlib
import itertools
import json
import os
import pathlib
import shutil
import signal
import socket
import struct
import subprocess
import tempfile
import time
import unittest

from program import ONTIME


class Input(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="ontime-test-")
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)

    def test_chain_that_cannot_be_is_refused(self):
        for chain in ("/scan", "/scan,/map,/scan", "/scan,,/map", "latest:/scan,/map", "/scan,/map@soon", ",".join(f"/{i}" for i in range(9))):
            done = subprocess.run([ONTIME, "listen", "--chain", chain], capture_output=True, text=True, timeout=60)
            self.assertEqual(done.returncode, 2, (chain, done.stderr))
            self.assertIn("--chain", done.stderr)
        done = subprocess.run([ONTIME, "listen", "--chain", "/scan@5ms,/map, /cmd_vel"], capture_output=True, text=True, timeout=60)
        self.assertEqual(done.returncode, 2)
        self.assertIn(": /scan,/map, /cmd_vel@5ms", done.stderr)
        # Blanks are of no name.
        done = subprocess.run([ONTIME, "listen", "--chain", "/scan, latest: /map @ 5ms", "--chain", "/scan,/scan "], capture_output=True,
                              text=True, timeout=60)
        self.assertIn("/scan occurs twice", done.stderr)
        for arguments in (("--packets", "lo"), ("--pcap", "no.pcap"), ("--list",)):
            done = subprocess.run([ONTIME, "listen", "--chain", "/scan,/map", *arguments], capture_output=True, text=True, timeout=60)
            self.assertEqual(done.returncode, 2, (arguments, done.stderr))
            self.assertIn("--chain", done.stderr)

    def test_bound_that_cannot_be_is_refused(self):
        for arguments in (("--keep", "20MB"), ("--keep", "20", "--results", "kept.ontime"), ("--keep", "1MB", "--results", "kept.ontime"),
                          ("--keep", "20MB", "--results", "kept.ontime", "--pcap", "no.pcap")):
            done = subprocess.run([ONTIME, "listen", *arguments], capture_output=True, text=True, timeout=60, cwd=self.folder)
            self.assertEqual(done.returncode, 2, (arguments, done.stderr))
            self.assertIn("--keep", done.stderr)
            self.assertFalse((self.folder / "kept.ontime").exists())

    def test_budget_that_cannot_be_is_refused(self):
        for budget in ("1", "0%", "-1%", "101%", "nan%", "1%%", "much"):
            done = subprocess.run([ONTIME, "listen", f"--budget={budget}"], capture_output=True, text=True, timeout=60)
            self.assertEqual(done.returncode, 2, (budget, done.stderr))
            self.assertIn("--budget", done.stderr)
        done = subprocess.run([ONTIME, "listen", "--budget", "1%", "--packets", "lo"], capture_output=True, text=True, timeout=60)
        self.assertEqual(done.returncode, 2, done.stderr)
        self.assertIn("--budget", done.stderr)

    def test_reader_that_cannot_be_is_refused(self):
        def read(program, code, **more):
            environment = {name: value for name, value in os.environ.items() if name not in ("ONTIME_TRANSPORT_PATH", "AMENT_PREFIX_PATH")}
            done = subprocess.run([program, "listen", "/scan", "--reader"], capture_output=True, text=True, timeout=60, env={**environment, **more})
            self.assertEqual(done.returncode, code, done.stderr)
            return done.stderr
        alone = shutil.copy(ONTIME, self.folder / "ontime")
        self.assertIn("ontime-transport-fastdds", read(alone, 3))
        broken = self.folder / "ontime_transport_fastdds.so"
        broken.write_bytes(b"no library")
        self.assertIn(str(broken), read(alone, 3, ONTIME_TRANSPORT_PATH=str(self.folder)))
        # Of a topic's reader the domain is checked first, with whatever transport is installed.
        self.assertIn("ROS_DOMAIN_ID", read(ONTIME, 2, ROS_DOMAIN_ID="233"))

    def packet(self, number, tags=b"", udp_beyond=0, ip_beyond=0):
        """From a writer without a name. Its headers may state more bytes than it has."""
        data = struct.pack("<HHIIII", 0, 16, 0, 0x03120000, 0, number) + bytes(8)
        rtps = b"RTPS\2\1\1\x10" + bytes(range(1, 13)) + struct.pack("<BBH", 0x15, 5, len(data)) + data
        udp = struct.pack(">HHHH", 40000, 7401, 8 + len(rtps) + udp_beyond, 0) + rtps
        ip = struct.pack(">BBHHHBBHII", 0x45, 0, 20 + len(udp) + ip_beyond, 0, 0, 64, 17, 0, 0x0a000001, 0x0a000002) + udp
        return bytes(12) + tags + b"\x08\0" + ip

    def capture(self, messages, kept=65535):
        return self.capture_of([self.packet(number) for number in range(1, messages + 1)], kept)

    def capture_of(self, packets, kept=65535):
        """One each second; of each packet so many bytes are kept."""
        path = self.folder / "robot.pcap"
        path.write_bytes(struct.pack("<IHHiIII", 0xa1b2c3d4, 2, 4, 0, 0, 65535, 1) + b"".join(
            struct.pack("<IIII", 1000 + number, 0, len(packet[:kept]), len(packet)) + packet[:kept] for number, packet in enumerate(packets)))
        return path

    @unittest.skipUnless(os.geteuid() == 0, "interfaces need root")
    def test_packet_that_passes_two_interfaces_is_one_message(self):
        self.check_capture("any")

    @unittest.skipUnless(os.geteuid() == 0, "interfaces need root")
    def test_packets_with_vlan_tags_are_seen(self):
        service, customer = b"\x88\xa8\0\x07", b"\x81\0\0\x09"
        for tags in customer, service + customer, customer + customer:
            for interface in "v0", "v1", "any":
                with self.subTest(tags=tags, interface=interface):
                    self.check_capture(interface, tags)

    @unittest.skipUnless(os.geteuid() == 0, "interfaces need root")
    def test_packet_on_loopback_that_was_not_seen_counts_once(self):
        for interface in "lo", "any":
            with self.subTest(interface=interface), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as messages:
                arguments = [ONTIME, "listen", "--packets", interface, "--format", "json", "--results", self.folder / f"{interface}.ontime"]
                listener = subprocess.Popen(arguments, stdout=subprocess.PIPE)
                self.addCleanup(listener.kill)
                while not (self.folder / f"{interface}.ontime").exists():  # after it captures
                    time.sleep(0.01)
                listener.send_signal(signal.SIGSTOP)
                os.waitid(os.P_PID, listener.pid, os.WSTOPPED)
                for number in range(1, 3001):  # more than it can keep meanwhile
                    messages.sendto(self.packet(number)[42:] + bytes(20000), ("127.0.0.1", 7401))
                listener.send_signal(signal.SIGCONT)
                time.sleep(3)  # it reads what it has, also on a busy machine
                listener.send_signal(signal.SIGINT)
                seen = json.load(listener.stdout)
                listener.wait(60)
                flow, = seen["flows"]
                self.assertLess(flow["messages"], 3000)
                self.assertEqual(flow["messages"] + seen["sensor_lost"], 3000)

    def check_capture(self, interface, tags=b""):
        subprocess.run("ip link add v0 type veth peer name v1 && ip link set v0 up && ip link set v1 up", shell=True, check=True)
        with contextlib.ExitStack() as end, socket.socket(socket.AF_PACKET, socket.SOCK_RAW) as wire:
            end.callback(subprocess.run, ["ip", "link", "del", "v0"], check=True)
            wire.bind(("v0", 0))
            with subprocess.Popen([ONTIME, "listen", "--packets", interface, "--for", "1s", "--format", "json"], stdout=subprocess.PIPE) as listener:
                for number in itertools.count(1):
                    if listener.poll() is not None:
                        break
                    wire.send(self.packet(number, tags))
                    time.sleep(0.01)
                flow, = json.load(listener.stdout)["flows"]
        self.assertGreater(flow["messages"], 1)
        self.assertEqual((flow["lost"], flow["duplicated"]), (0, 0))

    def test_late_messages_beyond_those_that_are_listed_are_counted(self):
        arguments = [ONTIME, "listen", "--pcap", self.capture(3000), "--deadline", "500 ms"]
        done = subprocess.run([*arguments, "--format", "json"], capture_output=True, text=True, timeout=60)
        self.assertEqual(done.returncode, 1, done.stderr)
        seen = json.loads(done.stdout)
        flow, = seen["flows"]
        self.assertEqual((flow["messages"], flow["late"]), (3000, 2999))
        self.assertEqual(len(seen["misses"]) + seen["misses_left_out"], flow["late"])
        self.assertLessEqual(len(seen["misses"]), 1000)

    def test_file_that_is_no_capture_is_refused(self):
        (self.folder / "bad.pcap").write_bytes(b"no capture")
        for name in ("bad.pcap", "missing.pcap"):
            done = subprocess.run([ONTIME, "listen", "--pcap", self.folder / name], capture_output=True, text=True,
                                  timeout=60)
            self.assertEqual(done.returncode, 2, done.stderr)
            self.assertEqual(done.stderr.count(name), 1, done.stderr)
            self.assertIn("pcapng", done.stderr)

    def test_capture_of_another_link_is_wrong_input(self):
        (self.folder / "wlan.pcap").write_bytes(struct.pack("<IHHiIII", 0xa1b2c3d4, 2, 4, 0, 0, 65535, 105))
        for arguments in (("--pcap", self.folder / "wlan.pcap"), ("--pcap", self.folder), ("--packets", "no-such-link")):
            done = subprocess.run([ONTIME, "listen", *arguments], capture_output=True, text=True, timeout=60)
            self.assertEqual(done.returncode, 2, (arguments, done.stderr))
            self.assertIn(str(arguments[0]), done.stderr)

    def test_capture_cut_at_its_end_is_judged_until_there(self):
        (self.folder / "cut.pcap").write_bytes(struct.pack("<IHHiIII", 0xa1b2c3d4, 2, 4, 0, 0, 65535, 1) + bytes(5))
        done = subprocess.run([ONTIME, "listen", "--pcap", self.folder / "cut.pcap", "--format", "json"],
                              capture_output=True, text=True, timeout=60)
        self.assertEqual(done.returncode, 0, done.stderr)
        seen = json.loads(done.stdout)
        self.assertEqual(len(seen["remarks"]), 1)
        # Of the same time as what it counts: starting is in neither.
        self.assertLessEqual(seen["cost"]["ontime_cpu_share"] or 0, os.cpu_count())

    def test_capture_that_is_cut_is_told_of_its_runs(self):
        path, results = self.capture(100), self.folder / "r.ontime"
        path.write_bytes(path.read_bytes()[:-5])
        subprocess.run([ONTIME, "listen", "--pcap", path, "--results", results], check=True, capture_output=True, timeout=60)
        for full in ((), ("--full",)):
            told = subprocess.run([ONTIME, "report", results, *full], check=True, capture_output=True, text=True, timeout=60).stdout
            self.assertIn("the capture cannot be read to its end: truncated", " ".join(told.split()))

    def test_limit_is_open_where_the_capture_has_only_the_beginnings_of_packets(self):
        done = subprocess.run([ONTIME, "listen", "--pcap", self.capture(100, kept=90), "--deadline", "500 ms"],
                              capture_output=True, text=True, timeout=60)
        self.assertEqual(done.returncode, 1, done.stdout)
        self.assertIn("open: no period of (unknown topic)", done.stderr)
        self.assertIn("100 datagrams were captured only in part", done.stderr)

    def test_datagram_that_is_shorter_than_it_states_hides_no_loss(self):
        for beyond in {"udp_beyond": 500}, {"ip_beyond": 500}, {"ip_beyond": 500, "udp_beyond": 500}:
            packets = [self.packet(1), self.packet(2), self.packet(3, **beyond), self.packet(5), self.packet(6)]
            done = subprocess.run([ONTIME, "listen", "--pcap", self.capture_of(packets), "--format", "json"], capture_output=True,
                                  text=True, timeout=60)
            seen = json.loads(done.stdout)
            flow, = seen["flows"]
            self.assertEqual((flow["messages"], flow["lost"]), (4, 2), beyond)
            self.assertEqual(sum("than they state: 1." in remark for remark in seen["remarks"]), 1, seen["remarks"])

    def test_output_that_cannot_be_written_loses_no_results(self):
        gone, pipe = os.pipe()
        os.close(gone)
        with open(pipe, "wb") as pipe, open("/dev/full", "wb") as full:
            for out, code in (pipe, -signal.SIGPIPE), (full, 3):
                results = self.folder / f"{code}.ontime"
                done = subprocess.run([ONTIME, "listen", "--pcap", self.capture(3000), "--deadline", "500 ms", "--results", results],
                                      stdout=out, stderr=subprocess.PIPE, text=True, timeout=60)
                self.assertEqual(done.returncode, code, done.stderr)
                report = subprocess.run([ONTIME, "report", results, "--format", "json"], capture_output=True, text=True, timeout=60)
                run, = json.loads(report.stdout)["runs"]
                self.assertEqual((run["sent"], run["late"]), (2999, 2999))

    def test_empty_capture_has_no_messages(self):
        (self.folder / "empty.pcap").write_bytes(struct.pack("<IHHiIII", 0xa1b2c3d4, 2, 4, 0, 0, 65535, 1))
        done = subprocess.run([ONTIME, "listen", "--pcap", self.folder / "empty.pcap"], capture_output=True, text=True,
                              timeout=60)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("No message", done.stdout)


if __name__ == "__main__":
    unittest.main()
