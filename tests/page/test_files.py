#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The page and the figures as files, without a browser. ONTIME: the program."""
import os
import pathlib
import subprocess
import sys
import tempfile
import unittest

sys.dont_write_bytecode = True  # the checkout stays as it is
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent.parent / "bench"))
import results_file  # noqa: E402

ONTIME = os.environ.get("ONTIME", "build/release/bin/ontime")


class Files(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        self.results, self.page = self.folder / "r.ontime", self.folder / "r.html"

    def report(self, *arguments):
        return subprocess.run([ONTIME, "report", self.results, *arguments], capture_output=True, text=True, timeout=120)

    def assert_refused(self, code, word, *arguments):
        there = sorted(self.folder.iterdir())
        done = self.report(*arguments)
        self.assertEqual(done.returncode, code, done.stderr)
        self.assertIn(word, done.stderr)
        self.assertEqual(sorted(self.folder.iterdir()), there, "nothing is left of it")

    def test_what_is_no_results_file_makes_no_page(self):
        html = ("--format", "html", "--output", self.page)
        self.assert_refused(2, "r.ontime", *html)
        self.results.write_bytes(b"")
        self.assert_refused(2, "empty", *html)
        self.results.write_bytes(b"<html>" * 1000)
        self.assert_refused(2, "not a results file", *html)
        self.results.unlink()
        results_file.twelve_hours(self.results, 20_000)
        self.results.write_bytes(self.results.read_bytes()[:200_000])
        self.page.write_text("an earlier page")
        self.assert_refused(2, "damaged", *html)
        self.assertEqual(self.page.read_text(), "an earlier page")

    def test_the_results_are_not_written_over(self):
        results_file.twelve_hours(self.results, 100)
        before = self.results.read_bytes()
        self.assert_refused(2, "is a results file", "--format", "html", "--output", self.results)
        self.assertEqual(self.results.read_bytes(), before)
        self.assert_refused(2, "cannot be written", "--format", "html", "--output", self.folder / "none" / "r.html")

    def test_plot_draws_each_figure_in_each_form(self):
        results_file.write(self.results, [
            (results_file.asked(500, transport=transport, payload_bytes=payload, title="it's `touch hacked` <b>"), results_file.outcome(),
             results_file.samples(number, 500))
            for number, (transport, payload) in enumerate((("udp", 500), ("u'd\"p`touch hacked`", 1000)), 1)])
        for figure in ("time", "ccdf", "conditions", "payload"):
            for form, beginning in {"svg": b"<?xml", "pdf": b"%PDF", "png": b"\x89PNG"}.items():
                with self.subTest(figure=figure, form=form):
                    file = self.folder / f"{figure}.{form}"
                    done = subprocess.run([ONTIME, "plot", self.results, "--figure", figure, "--output", file],
                                          capture_output=True, text=True, timeout=60, cwd=self.folder)
                    self.assertEqual((done.returncode, done.stderr), (0, ""))
                    self.assertTrue(file.read_bytes().startswith(beginning))
        self.assertFalse((self.folder / "hacked").exists())

    def test_plot_makes_no_figure_of_megabytes(self):
        rows = [list(row) for row in results_file.samples(1, 12_000)]
        for i in range(0, 12_000, 12):  # as bad as can be: something late and something lost everywhere
            rows[i][6], rows[i][10] = 30_000_000 + i, results_file.LATE
            rows[i + 1][6:9], rows[i + 1][10] = [None] * 3, results_file.LOST
        rows[7_001][6], rows[7_001][10] = 444_000_000, results_file.LATE
        results_file.write(self.results, [(results_file.asked(12_000), results_file.outcome(), rows)])
        sizes = {}
        for wide in ("", "--wide"):
            file = self.folder / "time.svg"
            subprocess.run([ONTIME, "plot", self.results, "--output", file, *filter(None, [wide])], check=True, timeout=60)
            sizes[wide] = file.stat().st_size
        self.assertLess(max(sizes.values()), 200_000, sizes)

    def test_plot_says_what_is_wrong(self):
        results_file.twelve_hours(self.results, 100)

        def plot(*arguments, **options):
            return subprocess.run([ONTIME, "plot", self.results, *arguments], capture_output=True, text=True, **options)
        for arguments, word in ((("--output", "x.gif"), "x.gif"), (("--output", "x.svg", "--figure", "pie"), "payload"),
                                (("--output", "x.svg", "--only", "1,7"), "no run '7'")):
            done = plot(*arguments)
            self.assertEqual(done.returncode, 2)
            self.assertIn(word, done.stderr)
        done = plot("--output", str(self.folder / "x.svg"), env={"PATH": str(self.folder)})
        self.assertEqual(done.returncode, 3)
        self.assertIn("install gnuplot-nox", done.stderr)
        self.assertFalse((self.folder / "x.svg").exists())


if __name__ == "__main__":
    unittest.main()
