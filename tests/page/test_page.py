#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The page, in a browser: what it shows is what was measured, and no script runs but its own.

ONTIME: the program. PICTURES: a folder that gets pictures of the page, wide and narrow, light and dark.
"""
import json
import os
import pathlib
import subprocess
import sys
import time
import unittest

sys.dont_write_bytecode = True  # the checkout stays as it is
from opened import ONTIME, Opened, results_file  # noqa: E402

PICTURES = os.environ.get("PICTURES")
HOSTILE = "</script><script>window.hacked = 1</script><!-- <img src=x onerror='window.hacked = 2'> \" ' \u2028 &lt;b&gt;"
SHOWN_OF_IT = "</script><script>window.hacked = 1</script><!-- <img src=x onerror='window.hacked = 2'> \" ' &lt;b&gt;"


class Page(Opened):
    def test_it_loads_and_shows_what_json_says(self):
        results = self.several()
        said = json.loads(subprocess.run([ONTIME, "report", results, "--format", "json"], check=True,
                                         capture_output=True).stdout)["runs"]
        opened = self.browser()
        opened.open(self.page_of(results))
        self.assert_quiet(opened)
        for run in said:
            shown = opened.run("""const row = document.querySelector(`tr[data-run="${arguments[0]}"]`);
                return Object.fromEntries([...row.querySelectorAll("data")].map(one => [one.dataset.figure, +one.value]));""",
                               run["run"])
            with self.subTest(run=run["run"]):
                for name in ("sent", "late", "lost"):
                    self.assertEqual(shown[name], run[name])
                if "late_by_response" in shown:
                    self.assertEqual(shown["late_by_response"], run["late_by_response"])
                for name in ("min", "mean", "p50", "p99", "p99.9", "max"):
                    self.assertEqual(shown[name], run["round_trip_us"][name])
        self.assertEqual(opened.run("return [...document.querySelectorAll('.answers li b')].map(one => one.textContent)"),
                         ["Test1.B · System under load, real-time settings", "Test1.D · System under load, real-time settings"],
                         "a sentence for each condition, none over all of them")
        self.assertEqual(opened.run("return [...document.querySelectorAll('figure')].filter(one => "
                                    "!one.querySelector('svg path[d]')).length"), 0, "each figure is drawn")
        self.assertEqual(opened.run("return performance.getEntriesByType('resource').length"), 0, "nothing is fetched")

    def test_whoever_cannot_see_it_is_told(self):
        opened = self.browser()
        opened.open(self.page_of(self.several()))
        for what, selector in {"figures have a name": "svg[role=img]:not([aria-label])", "columns have a head": "th:not([scope])",
                               "buttons say what they do": "button:not([title]):not([aria-pressed])"}.items():
            self.assertEqual(opened.run("return document.querySelectorAll(arguments[0]).length", selector), 0, what)

    def test_faults_are_found_one_after_another(self):
        rows = [list(row) for row in results_file.samples(1, 20_000)]
        for i, fate in ((4_000, results_file.LATE), (9_999, results_file.LOST)):
            rows[i][10] = fate
        for column in (6, 7, 8):
            rows[9_999][column] = None
        opened = self.browser()
        opened.open(self.page_of(self.results([(results_file.asked(20_000), results_file.outcome(), rows)])))
        faults = [row[1] for row in rows if row[10] != results_file.ON_TIME]
        for fault in [*faults, faults[0]]:
            opened.click("figure.time [data-does='show the next late or lost message']")
            self.assertIn(f"message {fault} · ", opened.text("figure.time .readout"))
            self.assertEqual(opened.run("return document.querySelectorAll('path.lost[d]:not([d=\"\"])').length"),
                             1 if fault == 9_999 else 0)
        self.assert_quiet(opened)

    def test_hostile_file_is_shown_and_runs_nothing(self):
        request = results_file.asked(50, id=HOSTILE, title=HOSTILE, transport=HOSTILE, variant=HOSTILE, receive=HOSTILE,
                                     schedule=HOSTILE, options={HOSTILE: HOSTILE}, adds_to=HOSTILE)
        host = {"machine": {HOSTILE: HOSTILE, "kernel_release": HOSTILE}, "transport": {"facts": {"rmw": HOSTILE}},
                "threads": [{"role": HOSTILE, "name": HOSTILE, "policy": HOSTILE}],
                "refusals": [{"asked": HOSTILE, "found": HOSTILE, "remedy": HOSTILE}]}
        came = {"hosts": {"controller": host, "component": host, HOSTILE: host}, "error": HOSTILE}
        other = results_file.asked(50, id=HOSTILE, transport="udp", payload_bytes=9)
        results = self.results([(request, came, results_file.samples(1, 50)), (other, came, results_file.samples(2, 50))],
                               [(1, 1, results_file.START_NS + 10**8, 3, HOSTILE, HOSTILE)])
        opened = self.browser()
        opened.open(self.page_of(results))
        self.assertIsNone(opened.run("return window.hacked"))
        self.assertIn(SHOWN_OF_IT, " ".join(opened.run("return document.querySelector('h2').textContent").split()))
        self.assertIn(SHOWN_OF_IT, " ".join(opened.run("return document.querySelector('.names span').textContent").split()))
        self.assertEqual(opened.run("return document.images.length + document.querySelectorAll('main script').length"), 0)
        self.assert_quiet(opened)
        # And if one had come through, the policy would have stopped it.
        opened.run("""const script = document.createElement("script");
                   script.textContent = "window.hacked = 3";
                   document.body.append(script);
                   document.body.insertAdjacentHTML("beforeend", "<img src=x onerror='window.hacked = 4'>");""")
        time.sleep(0.2)
        self.assertIsNone(opened.run("return window.hacked"))
        self.assertIn("Content Security Policy", " ".join(opened.errors()))

    def test_a_run_of_which_nothing_came_back_stands_among_the_others(self):
        lost = [[*row[:6], None, None, None, row[9], results_file.LOST, 0] for row in results_file.samples(2, 300)]
        opened = self.browser()
        opened.open(self.page_of(self.results([
            (results_file.asked(300), results_file.outcome(), results_file.samples(1, 300)),
            (results_file.asked(300, transport="fastdds", component_transport="fastdds"), results_file.outcome(), lost)])))
        self.assertEqual(opened.run("return [...document.querySelectorAll('figure.ccdf .names span')].map(one => one.textContent)"),
                         ["udp", "fastdds"])
        top, bottom, width = opened.run("""const box = document.querySelector("figure.ccdf path.line.c1").getBBox();
            return [box.y, box.y + box.height, box.width];""")
        self.assertEqual((top, bottom), (0, 0), "all of it is slower than any")
        self.assertGreater(width, 300)
        self.assertIn(": fastdds.", opened.text("figure.histogram .note"))
        self.assert_quiet(opened)

    def test_a_culprit_is_seen_and_said(self):
        opened = self.browser()
        opened.open(self.page_of(self.explained()))
        self.assertIn("1 of 2 pong's receive thread waited for a CPU while hog ran: 20.0 ms", opened.text(".culprits"))
        self.assertIn("NETFILTER_DROP", opened.text(".culprits"))
        late = "figure.way[data-drawing='1']"
        self.assertIn("Message 50 was late: delayed by 20.0 ms", opened.text(f"{late} figcaption"))
        box = opened.run("""const box = document.querySelector(arguments[0] + " .bar.other.culprit rect").getBBox();
            return [box.width, document.querySelector(arguments[0] + " .lane").getBBox().width];""", late)
        self.assertGreater(box[0], 0.8 * box[1], "the culprit had the CPU for most of what is shown")
        self.assertEqual(opened.run("return document.querySelectorAll(arguments[0] + ' .stage.culprit').length", late), 1)
        colours = opened.run("""return ["other.culprit", "ours"].map(one =>
            getComputedStyle(document.querySelector(`${arguments[0]} .bar.${one} rect`)).fill);""", late)
        self.assertNotEqual(*colours)
        # By the keyboard, and in words.
        opened.type(f"{late} svg", "\ue014" * 20)
        self.assertIn("hog", opened.text(f"{late} .readout"))
        self.assertIn("waited for a CPU while hog ran", opened.run(
            "return document.querySelector(arguments[0] + ' + details').textContent", late))
        self.assertIn("dropped: NETFILTER_DROP", opened.run(
            "return document.querySelector('figure.way[data-drawing=\"0\"] .bar.dropped.culprit').textContent"))
        self.assert_quiet(opened)

    def test_what_was_seen_goes_to_perfetto(self):
        results, file = self.explained(hog=HOSTILE), self.folder / "trace.json"

        def explain(*arguments):
            return subprocess.run([ONTIME, "explain", results, *arguments], capture_output=True, text=True)
        self.assertEqual(explain("--perfetto", file).returncode, 0)
        trace = json.loads(file.read_text())
        names = {event["name"] for event in trace["traceEvents"]}
        self.assertLessEqual({"message 50", "message 50 due", "message 50 late", "message 70", SHOWN_OF_IT[:9]},
                             names | {name[:9] for name in names})
        times = [event["ts"] for event in trace["traceEvents"] if event["ph"] != "M"]
        self.assertEqual(times, sorted(times))
        self.assertEqual(explain("--perfetto", file, "--message", "50").returncode, 0)
        self.assertNotIn("message 70", file.read_text())
        before = results.read_bytes()
        self.assertEqual(explain("--perfetto", results).returncode, 2)
        self.assertEqual(results.read_bytes(), before)
        self.assertIn("--only RUN", subprocess.run([ONTIME, "explain", self.several(), "--perfetto", file], capture_output=True,
                                                text=True).stderr)

    def test_hostile_names_in_what_was_seen_run_nothing(self):
        opened = self.browser()
        opened.open(self.page_of(self.explained(hog=HOSTILE, reason=HOSTILE)))
        self.assertIsNone(opened.run("return window.hacked"))
        self.assertIn(SHOWN_OF_IT, " ".join(opened.text(".culprits").split()))
        self.assertIn(SHOWN_OF_IT[:40], opened.run("return document.querySelector('.bar.culprit').textContent"))
        self.assertEqual(opened.run("return document.images.length + document.querySelectorAll('main script').length"), 0)
        self.assert_quiet(opened)

    def test_what_was_imported_is_a_table_without_messages(self):
        histogram = {"unit_ns": 1000, "values": [[9_000, 90], [12_000, 9]], "beyond": 1, "beyond_from_ns": 100_000,
                     "max_ns": 400_000, "mean_ns": 12_000}
        request = {"id": "cyclictest", "variant": "thread 0", "imported": {"from": "cyclictest-json", "file": HOSTILE}}
        opened = self.browser(width=360)
        opened.open(self.page_of(self.results([(request, {"interrupted": False, "histogram": histogram}, [])])))
        self.assertIn("No messages were measured", opened.text("h1"))
        self.assertEqual(opened.run("return document.querySelectorAll('figure, .runs').length"), 0)
        self.assertIn("thread 0", opened.text("main"))
        self.assertLessEqual(opened.run("return document.documentElement.scrollWidth"), 360)
        self.assert_quiet(opened)

    def test_it_fits_a_phone_and_the_dark(self):
        for name, results in (("page", self.several), ("way", self.explained)):
            page = self.page_of(results())
            for width, scheme in ((360, "light"), (360, "dark"), (1280, "light"), (1280, "dark")):
                opened = self.browser(width=width, scheme=scheme)
                opened.open(page)
                with self.subTest(name, width=width, scheme=scheme):
                    self.assertLessEqual(opened.run("return document.documentElement.scrollWidth"), width)
                    light = opened.run("return getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
                    self.assertEqual(light, scheme == "light")
                if PICTURES:
                    opened.run("document.querySelector(arguments[0]).scrollIntoView()", ".why" if name == "way" else "header")
                    opened.picture(pathlib.Path(PICTURES) / f"{name}-{width}-{scheme}.png")


if __name__ == "__main__":
    unittest.main()
