#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The page's figures, in a browser: they show what was measured, down to one message, to every reader. ONTIME: the program."""
import json
import math
import os
import random
import re
import subprocess
import sys
import time
import unittest
import xml.etree.ElementTree

sys.dont_write_bytecode = True  # the checkout stays as it is
from opened import ONTIME, Opened, results_file  # noqa: E402


def seen_difference(one, other):
    """The least that the colours differ (CIE 1976) to full sight and to the three kinds of colour blindness, which the matrices of
    Machado, Oliveira & Fernandes (2009) stand for."""
    blind = [((1, 0, 0), (0, 1, 0), (0, 0, 1)),
             ((0.152286, 1.052583, -0.204868), (0.114503, 0.786281, 0.099216), (-0.003882, -0.048116, 1.051998)),
             ((0.367322, 0.860646, -0.227968), (0.280085, 0.672501, 0.047413), (-0.011820, 0.042940, 0.968881)),
             ((1.255528, -0.076749, -0.178779), (-0.078411, 0.930809, 0.147602), (0.004733, 0.691367, 0.303900))]

    def times(matrix, vector):
        return [sum(a * b for a, b in zip(row, vector)) for row in matrix]

    def lab(colour, matrix):
        linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in (part / 255 for part in colour)]
        seen = [min(max(c, 0), 1) for c in times(matrix, linear)]
        xyz = times(((0.4124, 0.3576, 0.1805), (0.2126, 0.7152, 0.0722), (0.0193, 0.1192, 0.9505)), seen)
        x, y, z = (c ** (1 / 3) if c > 0.008856 else 7.787 * c + 16 / 116 for c in (xyz[0] / 0.9505, xyz[1], xyz[2] / 1.089))
        return 116 * y - 16, 500 * (x - y), 200 * (y - z)
    return min(math.dist(lab(one, matrix), lab(other, matrix)) for matrix in blind)


class Figures(Opened):
    def test_zoom_goes_down_to_one_message(self):
        count, slowest = 200_000, 123_457
        rows = [list(row) for row in results_file.samples(1, count)]
        rows[slowest][6], rows[slowest][10] = 444_000_000, results_file.LATE
        opened = self.browser()
        opened.open(self.page_of(self.results([(results_file.asked(count), results_file.outcome(), rows)])))
        svg, plot = "figure.time svg", "figure.time"
        self.assertEqual(opened.attribute(svg, "data-mode"), "columns")
        self.assertEqual(int(opened.attribute(svg, "data-shown")), count)
        opened.click(f"{plot} [data-does='show the slowest message']")
        self.assertEqual(opened.attribute(svg, "data-mode"), "messages")
        self.assertLess(int(opened.attribute(svg, "data-shown")), 40)
        self.assertIn(f"message {slowest} · 444 ms · late", opened.text(f"{plot} .readout"))
        # By the keyboard alone: nearer, along, and back to all.
        before = int(opened.attribute(svg, "data-shown"))
        opened.type(svg, "+++")
        self.settle(opened)
        self.assertLess(int(opened.attribute(svg, "data-shown")), before)
        self.assertLessEqual(int(opened.attribute(svg, "data-shown")), 8)
        opened.type(svg, "\ue011")  # Home
        self.settle(opened)
        self.assertEqual(int(opened.attribute(svg, "data-shown")), count)
        self.assert_quiet(opened)

    def test_message_due_long_after_the_others_leaves_them_their_room(self):
        count = 2_000
        rows = [list(row) for row in results_file.samples(1, count)]
        rows[-1][2] += 10 ** 6 * results_file.PERIOD_NS * count  # of 20 s
        opened = self.browser()
        opened.open(self.page_of(self.results([(results_file.asked(count), results_file.outcome(), rows)])))
        svg = "figure.time svg"
        self.assertEqual(int(opened.attribute(svg, "data-shown")), count)  # and one on either side
        self.assertGreater(opened.run("return document.querySelector('.columns').getBBox().width"), 500)
        opened.type(svg, "+++")
        self.settle(opened)
        self.assertLess(int(opened.attribute(svg, "data-shown")), count / 4)
        opened.type(svg, "\ue011")  # Home
        self.settle(opened)
        self.assertLess(opened.run("return document.querySelector('.columns').getBBox().width"), 5)
        self.assert_quiet(opened)

    def test_no_level_of_detail_hides_an_extreme(self):
        count = 50_000
        rows = [list(row) for row in results_file.samples(1, count)]
        rows[31_234][6], rows[31_234][10] = 49_000_000, results_file.LATE
        opened = self.browser()
        opened.open(self.page_of(self.results([(results_file.asked(count), results_file.outcome(), rows)])))
        wrong = opened.run_async("""
            const done = arguments[arguments.length - 1];
            timePlots.then(([{ course }]) => {
              const plain = (from, to) => {
                const all = new Extremes();
                for (let i = from; i < to; ++i) all.add(course.code[i], course.fate[i]);
                return JSON.stringify(all);
              };
              let wrong = 0;
              for (let trial = 0; trial < 400; ++trial) {
                const from = (trial * 7919) % course.count, to = Math.min(from + (trial * trial * 31) % 30000, course.count);
                if (JSON.stringify(course.extremes(from, to)) !== plain(from, to)) ++wrong;
              }
              done(wrong);
            });""")
        self.assertEqual(wrong, 0)
        # It is drawn where it is: in a column of more than fifty messages.
        drawn = opened.run_async("""
            const done = arguments[arguments.length - 1];
            timePlots.then(([plot]) => done([...plot.layers.late.attr("d").matchAll(/M([\\d.]+),([\\d.]+)h0/g)]
              .map(found => [plot.x.invert(+found[1]), plot.y.invert(+found[2])])));""")
        self.assertTrue(any(abs(at - 312.34) < 1 and abs(ns / 49e6 - 1) < 0.02 for at, ns in drawn), drawn)
        # Of a run that is too long for a page two of so many messages are here, and no more is claimed to be.
        counted = opened.run_async("""
            const done = arguments[arguments.length - 1];
            timePlots.then(([plot]) => {
              const px = plot.x(312.34), told = of => {
                plot.course.of = of;
                plot.point(px);
                return plot.frame.readout.text();
              };
              done([told(1), told(10)]);
            });""")
        messages = int(re.search(r"· ([\d,]+) messages", counted[0])[1].replace(",", ""))
        self.assertIn(f"about {messages * 10:,} messages", counted[1])
        self.assertIn("at least 1 late", counted[1])

    def test_nothing_but_losses_is_drawn_all_the_same(self):
        lost = [[*row[:6], None, None, None, row[9], results_file.LOST, 0] for row in results_file.samples(1, 300)]
        opened = self.browser()
        opened.open(self.page_of(self.results([(results_file.asked(300), results_file.outcome(), lost)])))
        self.assertEqual(opened.run("return document.querySelectorAll('figure.ccdf path.line[d]').length"), 2)
        self.assert_quiet(opened)

    def test_the_worst_case_is_drawn_where_the_data_allow_it(self):
        chance = random.Random(3)
        fine = [[*row[:6], int(300_000 + chance.expovariate(1 / 40_000)), *row[7:]] for row in results_file.samples(1, 20_000)]
        few = [[2, *row[1:]] for row in fine[:200]]
        results = self.results([(results_file.asked(20_000, transport="udp"), results_file.outcome(), fine),
                                (results_file.asked(200, transport="fastdds"), results_file.outcome(), few)])
        said = json.loads(subprocess.run([ONTIME, "report", results, "--format", "json"], check=True,
                                         capture_output=True).stdout)["runs"]
        bounds = [said[0]["extremes"][way] for way in ("block_maxima", "peaks_over_threshold")]
        self.assertTrue(all(bound["allowed"] for bound in bounds), bounds)
        opened = self.browser()
        opened.open(self.page_of(results))
        drawn = opened.run("return data.runs.map(run => run.bound)")
        self.assertAlmostEqual(drawn[0]["level"] / 1e3, max(bound["level_us"] for bound in bounds), places=2)
        self.assertIsNone(drawn[1])
        marks = "return document.querySelectorAll('figure.ccdf path.expected').length"
        self.assertEqual(opened.run(marks), 3, "of one of the two runs")
        self.assertEqual(opened.text("figure.ccdf svg g g text.label"), "extrapolated worst case")
        opened.click("figure.ccdf [title^='of each cycle']")
        self.assertEqual(opened.run(marks), 0, "of round trips alone")
        self.assert_quiet(opened)

    def test_the_worst_case_stands_on_the_curve_also_where_messages_were_lost(self):
        chance = random.Random(3)
        rows = [[*row[:6], int(300_000 + chance.expovariate(1 / 40_000)), *row[7:]] for row in results_file.samples(1, 20_000)]
        for i in range(0, 20_000, 500):
            rows[i][6:9], rows[i][10] = [None] * 3, results_file.LOST
        opened = self.browser()
        opened.open(self.page_of(self.results([(results_file.asked(20_000), results_file.outcome(), rows)])))
        curve, mark = opened.run("""const of = path => [...path.getAttribute("d").matchAll(/([MLHV])([\\d.e-]+)(?:,([\\d.e-]+))?/g)];
            let x = 0, y = 0;
            const curve = of(document.querySelector("figure.ccdf path.line.c0")).map(([, kind, a, b]) => {
              if (kind === "V") y = +a; else { x = +a; if (b !== undefined) y = +b; }
              return [x, y];
            });
            const [[, , at, share]] = of(document.querySelector("figure.ccdf path.dots.expected"));
            return [curve, [+at, +share]];""")
        there = [y for x, y in curve if x <= mark[0]][-1]
        self.assertAlmostEqual(mark[1], there, delta=1, msg="the mark is as high as the curve where it stands")
        self.assert_quiet(opened)

    def test_each_condition_has_its_own_line_against_the_payload(self):
        runs = []
        for payload, realtime in ((64, False), (64, True), (1024, False), (1024, True)):
            rows = [[*row[:6], 200_000 if realtime else 900_000, *row[7:]] for row in results_file.samples(len(runs) + 1, 100)]
            runs.append((results_file.asked(100, id="size", payload_bytes=payload, realtime=realtime), results_file.outcome(), rows))
        opened = self.browser()
        opened.open(self.page_of(self.results(runs)))
        names = opened.run("return [...document.querySelectorAll('figure.payload .names span')].map(one => one.textContent)")
        self.assertEqual(names, ["size udp SCHED_OTHER", "size udp real-time settings"])
        opened.type("figure.payload svg", "\ue011")  # Home
        self.assertIn("size udp SCHED_OTHER p50 900 µs, p99 900 µs · size udp real-time settings p50 200 µs",
                      opened.text("figure.payload .readout"), "what was measured, not the median of both")
        self.assert_quiet(opened)

    def test_one_answer_alone_in_its_column_can_be_seen(self):
        count = 4_000
        rows = [list(row) for row in results_file.samples(1, count)]
        for i in range(1_000, 3_000):  # a long silence, and in its middle one slow answer that is not late
            if i != 2_000:
                rows[i] = None
        rows = [row for row in rows if row]
        slow = next(row for row in rows if row[1] == 2_000)
        slow[6] = 9_000_000
        opened = self.browser()
        opened.open(self.page_of(self.results([(results_file.asked(count), results_file.outcome(), rows)])))
        self.assertEqual(opened.attribute("figure.time svg", "data-mode"), "columns")
        alone = opened.run_async("""const done = arguments[arguments.length - 1];
            timePlots.then(([plot]) => done([
              [...plot.layers.alone.attr("d").matchAll(/M([\\d.]+),([\\d.]+)h0/g)].map(found => [plot.x.invert(+found[1]), plot.y.invert(+found[2])]),
              getComputedStyle(plot.layers.alone.node()).strokeWidth]));""")
        self.assertTrue(any(abs(at - 20) < 0.1 and abs(ns / 9e6 - 1) < 0.05 for at, ns in alone[0]), alone)
        self.assertEqual(alone[1], "3px")

    def test_late_and_waiting_are_told_apart_by_colour_blind_readers(self):
        opened = self.browser()
        opened.open(self.page_of(self.several()))
        for scheme in ("light", "dark"):
            opened.devtools("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
            colours = opened.run("""return ["late", "stall", "columns"].map(name =>
                getComputedStyle(document.querySelector(`figure.time path.${name}`)).stroke.match(/\\d+/g).map(Number));""")
            for i, one in enumerate(colours):
                for other in colours[:i]:
                    self.assertGreater(seen_difference(one, other), 20, (scheme, one, other))

    def test_every_figure_is_read_by_the_keyboard(self):
        opened = self.browser()
        opened.open(self.page_of(self.several()))
        opened.run("document.body.tabIndex = -1; document.body.focus();")
        order = []
        for _ in range(400):
            opened.press("\ue004")  # Tab
            order.append(opened.run("""const now = document.activeElement, figure = now.closest("figure");
                if (now === document.body) return null;
                return [figure ? [...document.querySelectorAll("figure")].indexOf(figure) : -1, now.localName,
                        getComputedStyle(now).outlineStyle];"""))
            if order[-1] is None:
                break
        places = [place for place in order if place and place[0] >= 0]
        self.assertEqual([place[0] for place in places], sorted(place[0] for place in places), "in the order of the page")
        figures = opened.run("return [...document.querySelectorAll('figure')].map(one => one.className)")
        read = [figure for figure, element, outline in places if element == "svg"]
        self.assertEqual(read, [i for i, name in enumerate(figures) if name != "layers"], "each one once, but for bars with names")
        self.assertNotIn("none", [outline for _, _, outline in places], "the focus is seen")
        for i, name in enumerate(figures):
            if name == "layers":
                continue
            opened.run("document.querySelectorAll('figure')[arguments[0]].querySelector(':scope > svg').focus()", i)
            said = []
            for key in ("\ue011", "\ue010") if name == "payload" else ("\ue014", "\ue014"):  # Home and End, or twice to the right
                opened.press(key)
                said.append(opened.run("return document.querySelectorAll('figure')[arguments[0]].querySelector('output').textContent", i))
            self.assertTrue(all(said), (name, said))
            self.assertNotEqual(*said, name)
        self.assert_quiet(opened)

    def test_answers_that_took_no_time_are_drawn_all_the_same(self):
        rows = [[*row[:6], 0, *row[7:]] for row in results_file.samples(1, 100)]
        opened = self.browser()
        opened.open(self.page_of(self.results([(results_file.asked(100), results_file.outcome(), rows)])))
        self.assert_quiet(opened)
        self.assertEqual(opened.run("return document.querySelectorAll('.fault[role=alert]').length"), 0)

    def test_saved_figures_say_what_they_are(self):
        opened = self.browser(scheme="dark")
        opened.devtools("Browser.setDownloadBehavior", behavior="allow", downloadPath=str(self.folder))
        results = self.several()
        opened.open(self.page_of(results))
        figures = {"time": ("Test1.B", "-udp-round-trip-over-time", ["udp", "round trip over time", "time since the start", "round trip", "late", "lost",
                                                                  "deadline 10 ms", "3,000 messages, 1 late, 1 lost"]),
                   "ccdf": ("Test1.B", "-Exceedance-CCDF", ["Exceedance (CCDF)", "share of messages slower", "round trip", "udp",
                                                           "cyclonedds", "every 10 ms"]),
                   "histogram": ("Test1.B", "-Distribution", ["Distribution", "messages per bin", "round trip", "cyclonedds"])}
        for name, (begin, end, words) in figures.items():
            for form in ("SVG", "PNG"):
                opened.click(f"figure.{name} [title='save as {form}']")
                deadline = time.monotonic() + 60
                pattern = f"{results.stem}-{begin}*{end}.{form.lower()}"
                # The browser may take the name first, and write the content to a file of another.
                while not (files := [file for file in self.folder.glob(pattern) if file.stat().st_size]) and time.monotonic() < deadline:
                    time.sleep(0.05)
                self.assertTrue(files, (pattern, os.listdir(self.folder)))
                content = files[0].read_bytes()
                if form == "PNG":
                    self.assertTrue(content.startswith(b"\x89PNG"))
                    continue
                svg = xml.etree.ElementTree.fromstring(content)
                text = " ".join(" ".join(svg.itertext()).split())
                for word in [*words, "System under load, real-time settings", results.name]:
                    self.assertIn(word, text, name)
                self.assertNotIn(b"class=", content, "it needs no style of the page")
                self.assertNotIn(b"rgba(", content)
                self.assertEqual(svg[0].get("fill") if svg[0].tag.endswith("rect") else svg.find("{*}rect").get("fill"),
                                 "rgb(255, 255, 255)", "for paper, also from a dark screen")
        self.assert_quiet(opened)


if __name__ == "__main__":
    unittest.main()
