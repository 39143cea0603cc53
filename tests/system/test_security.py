#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""DDS Security by the real program between two network namespaces. Needs root, and skips without. ONTIME names the
program."""

import pathlib
import unittest

from program import TRANSPORTS, Program

SCENARIO = """
hosts: namespaces
defaults: {transport: [%s], period: 5 ms, timeout: 5 s, duration: %s, realtime: on}
runs:
  - {id: secured, security: [authenticate, sign, encrypt]}
"""


class Security(Program):
    def test_nothing_is_lost_and_no_key_is_recorded(self):
        transports = [name for name in TRANSPORTS if name in ("cyclonedds", "fastdds")]
        answer = self.run_ontime("run", self.scenario("1 s", text=SCENARIO, transports=transports), "--results", self.results)
        self.assertEqual(answer.returncode, 0, answer.stderr)
        runs = self.report()
        self.assertEqual([(run["transport"], run["conditions"]["security"]) for run in runs],
                         [(t, level) for t in transports for level in ("authenticate", "sign", "encrypt")])
        for run in runs:
            with self.subTest(transport=run["transport"], level=run["conditions"]["security"]):
                self.assertIsNone(run["error"])
                self.assertGreater(run["sent"], 10)
                self.assertEqual((run["lost"], run["strays"]), (0, 0))
                for host in ("controller", "component"):
                    self.assertEqual(run["hosts"][host]["transport"]["facts"]["security"], run["conditions"]["security"])
        self.assertNotIn(b"PRIVATE KEY", pathlib.Path(self.results).read_bytes())

    def test_who_has_none_refuses_it_by_name(self):
        path = pathlib.Path(self.folder, "refused.yaml")
        for keys, words in (("transport: udp, security: sign", "transport udp has no DDS Security"),
                            ("transport: cyclonedds, security: perhaps", "'perhaps' is not one of off, authenticate, sign, encrypt")):
            with self.subTest(keys):
                path.write_text(f"hosts: namespaces\nruns: [{{id: a, duration: 100 ms, {keys}}}]\n")
                answer = self.run_ontime("run", str(path), "--results", self.results)
                self.assertEqual(answer.returncode, 2, answer.stderr)
                self.assertIn(words, answer.stderr)


if __name__ == "__main__":
    unittest.main()
