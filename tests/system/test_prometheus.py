#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Debian's Prometheus scrapes three robots: network namespaces, each with two nodes and an `ontime listen --metrics`. What it
has is compared with the nodes' own accounts. ONTIME, LISTEN_NODE and LISTEN_RMW_NODE name the programs.

It leaves with 3 without root, and where prometheus is missing."""

import json
import math
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import unittest
import urllib.parse
import urllib.request

from program import eventually
from robot import ENVIRONMENT, NODE, ONTIME, REALTIME, begin, log_of, until_probed

ROOT = pathlib.Path(__file__).resolve().parent.parent.parent
ALERTS, DASHBOARD = (ROOT / "prometheus" / name for name in ("alerts.yml", "dashboard.json"))
ROBOTS = ("robot1", "robot2", "robot3")
SERVER = "http://127.0.0.1:9090"
MESSAGES, PERIOD_US = 12000, 2000  # it takes ten seconds until writer and reader are one row
HISTOGRAMS = ("ontime_topic_age_seconds", "ontime_topic_period_seconds")


def address_of(robot):
    return f"10.77.{ROBOTS.index(robot)}.2"


def promtool(*arguments, **options):
    return subprocess.run(["promtool", *map(str, arguments)], capture_output=True, text=True, timeout=120, **options)


def asked(path, **parameters):
    """What the server answers."""
    with urllib.request.urlopen(f"{SERVER}/api/v1/{path}?{urllib.parse.urlencode(parameters)}", timeout=30) as answer:
        return json.load(answer)["data"]


def values(expression):
    """{the values of its labels, in the order of their names: number}"""
    return {tuple(value for _, value in sorted(series["metric"].items())): float(series["value"][1])
            for series in asked("query", query=expression)["result"]}


def by_robot(expression):
    return {key[0]: number for key, number in values(f"sum by (instance) ({expression})").items()}


def messages_of(robot):
    return by_robot("ontime_topic_messages_total").get(robot, 0)


class Rules(unittest.TestCase):
    def test_alerts_are_valid_and_fire_where_they_must(self):
        for arguments in (("check", "rules", ALERTS), ("test", "rules", ROOT / "tests/prometheus/alerts_test.yml")):
            done = promtool(*arguments)
            self.assertEqual(done.returncode, 0, done.stdout + done.stderr)


class Fleet(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory(prefix="ontime-test-")
        cls.addClassCleanup(folder.cleanup)
        cls.folder = pathlib.Path(folder.name)
        for number, robot in enumerate(ROBOTS):
            for command in (f"netns add {robot}",
                            f"link add {robot} type veth peer name fleet netns {robot}",
                            f"address add 10.77.{number}.1/24 dev {robot}", f"link set {robot} up",
                            f"-n {robot} address add {address_of(robot)}/24 dev fleet",
                            f"-n {robot} link set fleet up", f"-n {robot} link set lo up"):
                subprocess.run(["ip", *command.split()], check=True)
            cls.addClassCleanup(subprocess.run, ["ip", "netns", "delete", robot], check=True)
        configuration = {"global": {"scrape_interval": "1s", "scrape_timeout": "1s", "evaluation_interval": "1s"},
                         "rule_files": [str(ALERTS)],
                         "scrape_configs": [{"job_name": "ontime", "static_configs": [
                             {"targets": [f"{address_of(robot)}:9464"], "labels": {"instance": robot}} for robot in ROBOTS]}]}
        (cls.folder / "prometheus.yml").write_text(json.dumps(configuration))  # JSON is YAML
        cls.nodes, cls.listeners = {}, {}
        cls.start_server()
        for robot in ROBOTS:
            cls.start_nodes(robot)
        assert eventually(lambda: all("libddsc.so" in pathlib.Path(f"/proc/{node.pid}/maps").read_text()
                                      for nodes in cls.nodes.values() for node in nodes))
        for robot in ROBOTS:
            # One ontime can record the kernel's events.
            arguments = [] if robot == ROBOTS[0] else ["--no-explain"]
            cls.listeners[robot] = cls.start(robot, ONTIME, "listen", f"/{robot}/cmd_vel", "/never", "--deadline", "15ms", "--metrics",
                                             f"{address_of(robot)}:9464", *arguments)
        # Its first counts come when its own probes are set. A process's code does not tell whose probes it has.
        assert eventually(lambda: by_robot("ontime_sensor_lost_total").keys() == set(ROBOTS)), by_robot("up")
        for robot in ROBOTS:
            begin(cls.nodes[robot][0])

    @classmethod
    def start(cls, robot, *command):
        process = subprocess.Popen([*(["ip", "netns", "exec", robot] if robot else []), *map(str, command)], cwd=cls.folder,
                                   env=ENVIRONMENT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        cls.addClassCleanup(lambda: (process.send_signal(signal.SIGINT), process.wait(60)))  # the kernel's events are given back
        return process

    @classmethod
    def start_server(cls):
        cls.start(None, "prometheus", "--config.file=prometheus.yml", "--storage.tsdb.path=data",
                  "--web.listen-address=127.0.0.1:9090")

        def is_ready():
            try:
                return urllib.request.urlopen(f"{SERVER}/-/ready", timeout=30).status == 200
            except OSError:
                return False
        assert eventually(is_ready)

    @classmethod
    def start_nodes(cls, robot):
        """A publisher that waits for SIGUSR1, and a taker."""
        cls.nodes[robot] = (
            cls.start(robot, *REALTIME, NODE, "publish", f"rt/{robot}/cmd_vel", MESSAGES, PERIOD_US, f"published.{robot}"),
            cls.start(robot, *REALTIME, NODE, "take", f"rt/{robot}/cmd_vel", 1000, 0, f"taken.{robot}"))

    def taken(self, robot):
        """When its taker took each message, by its own account; it ends both."""
        publisher, taker = self.nodes[robot]
        self.assertEqual(publisher.wait(120), 0)
        taker.send_signal(signal.SIGTERM)
        self.assertEqual(taker.wait(30), 0)
        return [at for _, at, _ in log_of(self.folder / f"taken.{robot}")]

    def no_counter_fell(self):
        for metric in asked("label/__name__/values"):
            if re.match(r"ontime_.*_(total|bucket|count|sum)$", metric):
                fallen = [key for key, resets in values(f"resets({metric}[1h])").items() if resets > 0]
                self.assertEqual(fallen, [], metric)

    # Their order is that of their names.

    def test_1_every_message_and_every_missed_limit_is_in_the_server(self):
        taken = {robot: self.taken(robot) for robot in ROBOTS}
        of_readers = '{reader="listen_node"}'
        seen = lambda: by_robot(f"ontime_topic_messages_total{of_readers}")
        # Each listener's sensor sees the nodes of all robots: it may have lost those of another one.
        lost = lambda: by_robot("ontime_sensor_lost_total")
        self.assertTrue(eventually(lambda: all(seen()[robot] <= len(taken[robot]) <= seen()[robot] + lost()[robot]
                                               for robot in ROBOTS)),
                        ({robot: len(taken[robot]) for robot in ROBOTS}, seen(), lost()))
        late, not_judged = (by_robot(f"ontime_topic_{count}_total{of_readers}") for count in ("late", "not_judged"))
        for robot in ROBOTS:
            gaps = [after - before for before, after in zip(taken[robot], taken[robot][1:])]
            sure = sum(gap > 17_000_000 for gap in gaps)  # the taker's own clock is read a little later
            self.assertGreaterEqual(sure, MESSAGES // 997 - 1, "each pause, but one that a standstill may split")
            self.assertGreaterEqual(late[robot] + not_judged[robot] + lost()[robot], sure)
            self.assertGreater(late[robot], 0)
        self.assertEqual(by_robot("ontime_late_by_cause_total"), late)
        for histogram in HISTOGRAMS:
            self.assertEqual(by_robot(f"{histogram}_count"), by_robot(f'{histogram}_bucket{{le="+Inf"}}'))

    def test_2_quantiles_and_rates_of_causes_can_be_asked(self):
        for histogram in HISTOGRAMS:
            quantiles = values(f"histogram_quantile(0.99, sum by (instance, le) (rate({histogram}_bucket[5m])))")
            self.assertEqual(set(quantiles), {(robot,) for robot in ROBOTS})
            for seconds in quantiles.values():
                self.assertTrue(1e-6 <= seconds <= 10, quantiles)
        causes = values("sum by (cause, instance) (rate(ontime_late_by_cause_total[5m]))")
        self.assertGreater(sum(rate for (cause, robot), rate in causes.items()
                               if robot == ROBOTS[0] and cause != "not looked for"), 0, causes)
        for (cause, robot), rate in causes.items():
            if robot != ROBOTS[0]:
                self.assertEqual(rate > 0, cause == "not looked for", (robot, cause))

    def test_3_every_panel_of_the_dashboard_has_values(self):
        dashboard = json.loads(DASHBOARD.read_text())

        def filled(text):
            return text.replace("$__rate_interval", "5m").replace("$instance", ".*").replace("$topic", ".*")
        for panel in dashboard["panels"]:
            for target in panel["targets"]:
                numbers = values(filled(target["expr"]))
                self.assertTrue(numbers and not all(map(math.isnan, numbers.values())), (panel["title"], target["expr"]))
        for variable in dashboard["templating"]["list"]:
            if variable["type"] == "query":
                selector, label = re.fullmatch(r"label_values\((.*), (\w+)\)", variable["definition"]).groups()
                self.assertTrue(any(label in series for series in asked("series", **{"match[]": filled(selector)})))

    def test_4_server_has_the_alerts_and_tells_of_silence(self):
        self.assertTrue(eventually(lambda: {rule["health"] for rule in asked("rules")["groups"][0]["rules"]} == {"ok"}),
                        asked("rules"))
        # The publishers have ended, and a deadline is stated; and nothing ever came on /never.
        firing = lambda: {(alert["labels"]["instance"], alert["labels"]["topic"]) for alert in asked("alerts")["alerts"]
                          if alert["labels"]["alertname"] == "OntimeTopicSilent" and alert["state"] == "firing"}
        expected = {(robot, topic) for robot in ROBOTS for topic in (f"/{robot}/cmd_vel", "/never")}
        self.assertTrue(eventually(lambda: firing() == expected), asked("alerts"))
        for robot, seconds in by_robot('ontime_topic_silent_seconds_total{topic!="/never"}').items():
            self.assertGreater(seconds, 5, robot)

    def test_5_texts_are_as_promtool_wants_them(self):
        for robot in ROBOTS:
            with urllib.request.urlopen(f"http://{address_of(robot)}:9464/metrics", timeout=30) as answer:
                done = promtool("check", "metrics", input=answer.read().decode())
            self.assertEqual((done.returncode, done.stdout + done.stderr), (0, ""))

    def test_6_no_counter_falls_when_nodes_end_and_start_again(self):
        robot = ROBOTS[1]
        before = messages_of(robot)
        self.start_nodes(robot)
        until_probed(self.nodes[robot])
        begin(self.nodes[robot][0])
        self.assertTrue(eventually(lambda: messages_of(robot) > before + 1000))
        for node in self.nodes[robot]:
            node.kill()
            node.wait()
        self.start_nodes(robot)
        until_probed(self.nodes[robot])
        begin(self.nodes[robot][0])
        now = messages_of(robot)
        self.assertTrue(eventually(lambda: messages_of(robot) > now + 500))
        self.no_counter_fell()

    def test_7_robot_whose_listener_ends_is_down(self):
        self.listeners[ROBOTS[2]].kill()
        self.assertTrue(eventually(lambda: by_robot("up") == {ROBOTS[0]: 1, ROBOTS[1]: 1, ROBOTS[2]: 0}))


if __name__ == "__main__":
    if os.geteuid() != 0:
        print("it needs root")
        sys.exit(3)
    if not shutil.which("prometheus") or not shutil.which("promtool"):
        print("prometheus is missing (Debian package: prometheus)")
        sys.exit(3)
    unittest.main()
