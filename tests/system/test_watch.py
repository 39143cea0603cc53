#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""`ontime watch`, from another terminal, on runs that the real program measures over loopback."""

import contextlib
import json
import re
import signal
import time
import unittest
import urllib.error
import urllib.request

import results


class Watch(results.Results):
    def test_follows_to_the_end(self):
        process = self.started("1 h")
        watch = self.start("watch", self.results, "--format", "json")
        lines = [json.loads(watch.stdout.readline()) for _ in range(2)]  # ontime watch lets all others run first
        process.send_signal(signal.SIGINT)
        lines += map(json.loads, watch.stdout)
        self.assertEqual((process.wait(180), watch.wait(180)), (130, 0))
        self.assertEqual(lines[0]["state"], "measuring")
        self.assertEqual(lines[-1]["state"], "ended")
        sent = [line["sent"] for line in lines]
        self.assertEqual(sent, sorted(sent))
        run = json.loads(self.ontime("report", self.results, "--format", "json").stdout)["runs"][0]
        self.assertEqual([lines[-1][key] for key in ("sent", "late", "lost")], [run[key] for key in ("sent", "late", "lost")])
        self.assertEqual(lines[-1]["round_trip_us"]["max"], run["round_trip_us"]["max"])
        self.assertEqual(list(self.folder.glob("results.ontime-*")), [], "the writer could leave one file")
        self.assertIn("(interrupted)", self.ontime("watch", self.results).stdout)

    def test_offers_metrics(self):
        process = self.started("1 h")
        watch = self.start("watch", self.results, "--metrics", "127.0.0.1:0")
        address = watch.stderr.readline().split()[-1]
        self.assertTrue(address.startswith("http://127.0.0.1:"), address)
        with urllib.request.urlopen(address, timeout=60) as answer:
            text = answer.read().decode()
        self.assertIn('ontime_messages_total{run="1",id="one"', text)
        self.assertIn("ontime_measuring 1\n", text)
        with self.assertRaises(urllib.error.HTTPError):
            urllib.request.urlopen(address + "/x", timeout=60)
        process.kill()  # what remains is a run that was cut off
        process.wait(180)
        last = None  # it ends when its last metrics are fetched
        while watch.poll() is None:
            with contextlib.suppress(OSError):
                last = urllib.request.urlopen(address, timeout=60).read().decode()
            time.sleep(0.1)
        self.assertIn("ontime_measuring 0\n", last)
        sent = json.loads(self.ontime("report", self.results, "--format", "json").stdout)["runs"][0]["sent"]
        counts = re.findall(r"ontime_messages_total\{[^}]*\} (\d+)", last)
        self.assertEqual(sum(map(int, counts)), sent)
        out, _ = watch.communicate(timeout=180)
        self.assertEqual(watch.returncode, 0)
        self.assertIn("cut off", out)

    def test_of_a_missing_file_or_address_is_refused(self):
        self.ontime("watch", self.folder / "none.ontime", code=2)
        self.measured()
        self.ontime("watch", self.results, "--metrics", "0.0.0.0.0:9464", code=2)
        self.ontime("watch", self.results, "--metrics", "192.0.2.1:9464", code=3)
        self.ontime("watch", self.results, "--format", "csv", code=2)


if __name__ == "__main__":
    unittest.main(verbosity=2)
