# SPDX-License-Identifier: Apache-2.0
"""Writes a results file of a synthetic 12-hour run: the tables of docs/reference/results-file.md, with samples that look
measured. The same seed makes the same file."""
import contextlib
import json
import random
import sqlite3

APPLICATION_ID, FORMAT = 1869509741, 3
SCHEMA = """
CREATE TABLE run (number INTEGER PRIMARY KEY, started_at TEXT NOT NULL, start_ns INTEGER, asked TEXT NOT NULL, outcome TEXT,
  id TEXT AS (json_extract(asked, '$.id')), transport TEXT AS (json_extract(asked, '$.transport')),
  repetition INTEGER AS (json_extract(asked, '$.repetition')), key TEXT NOT NULL DEFAULT '');
CREATE TABLE sample (run INTEGER NOT NULL, message INTEGER NOT NULL, intended_ns INTEGER NOT NULL,
  due_after_ns INTEGER NOT NULL, woke_after_ns INTEGER NOT NULL, sent_after_ns INTEGER NOT NULL,
  received_after_ns INTEGER, server_received_ns INTEGER, server_sent_after_ns INTEGER, skipped_cycles INTEGER NOT NULL,
  fate INTEGER NOT NULL, passed_wake_ns INTEGER NOT NULL DEFAULT 0, PRIMARY KEY (run, message)) WITHOUT ROWID;
CREATE TABLE note (run INTEGER NOT NULL, number INTEGER NOT NULL, at_ns INTEGER, message INTEGER, kind TEXT NOT NULL,
  text TEXT NOT NULL, PRIMARY KEY (run, number)) WITHOUT ROWID;
CREATE TABLE trace (run INTEGER NOT NULL, message INTEGER NOT NULL, host TEXT NOT NULL, events TEXT NOT NULL,
  PRIMARY KEY (run, message, host));
"""
PERIOD_NS, DEADLINE_NS, TIMEOUT_NS = 10_000_000, 10_000_000, 500_000_000
START_NS = 864_000_000_000_000  # a machine that has been up for ten days
ON_TIME, LATE, LOST = range(3)


def asked(messages, **own):
    return {"id": "Test1.D", "title": "System under load, real-time settings", "variant": "", "repetition": 1,
            "transport": "udp", "component_transport": "udp", "payload_bytes": 500, "period_us": PERIOD_NS / 1e3,
            "deadline_us": DEADLINE_NS / 1e3, "timeout_us": TIMEOUT_NS / 1e3, "duration_s": messages * PERIOD_NS / 1e9,
            "schedule": "fixed", "receive": "listener", "warm_up": 10, "realtime": True,
            "qos": {"reliability": "best-effort", "history": "keep-last", "depth": 1, "durability": "volatile"}, **own}


def outcome(**own):
    threads = [{"role": "send", "name": "ontime-send", "tid": 7, "policy": "fifo", "priority": 80, "cpus": "0-1"}]
    host = {"machine": {"kernel_release": "6.1"}, "threads": threads, "refusals": []}
    return {"interrupted": False, "hosts": {"controller": host, "component": host}, **own}


def samples(run, messages, seed=1):
    """Round trips with rare stalls, a slow drift, and about one loss in a million."""
    chance = random.Random(seed)
    drift = 0.0
    for i in range(messages):
        drift = 0.999 * drift + chance.gauss(0, 4_000)
        woke, sent = int(chance.expovariate(1 / 40_000)), 1_000 + chance.randrange(900)
        round_trip = int(400_000 + drift + chance.lognormvariate(11, 0.7))
        luck = chance.random()
        if luck < 2e-5:
            round_trip += int(chance.expovariate(1 / 6e6))
        server = START_NS + i * PERIOD_NS + woke + sent + round_trip // 2
        lost = luck > 1 - 1e-6
        fate = LOST if lost else LATE if woke + sent + round_trip > DEADLINE_NS else ON_TIME
        yield (run, i, i * PERIOD_NS, 0, woke, sent, None if lost else round_trip, None if lost else server,
               None if lost else 4_000 + chance.randrange(3_000), 0, fate, 0)


def write(path, runs, notes=(), traces=()):
    """`runs`: (asked, outcome, samples) of each; `notes`: (run, number, at_ns, message, kind, text); `traces`: (run, message,
    host, events)."""
    with contextlib.closing(sqlite3.connect(path)) as file:
        file.executescript(f"PRAGMA journal_mode = OFF; PRAGMA application_id = {APPLICATION_ID}; "
                           f"PRAGMA user_version = {FORMAT}; {SCHEMA}")
        for number, (request, outcome, rows) in enumerate(runs, 1):
            file.execute("INSERT INTO run (number, started_at, start_ns, asked, outcome) VALUES (?, ?, ?, ?, ?)",
                         (number, "2026-11-21T02:07:38.181Z", START_NS, json.dumps(request),
                          None if outcome is None else json.dumps(outcome)))
            file.executemany(f"INSERT INTO sample VALUES ({', '.join('?' * 12)})", rows)
        file.executemany("INSERT INTO note VALUES (?, ?, ?, ?, ?, ?)", notes)
        file.executemany("INSERT INTO trace VALUES (?, ?, ?, ?)", ((*row[:3], json.dumps(row[3])) for row in traces))
        file.commit()


def twelve_hours(path, messages=4_320_000):
    write(path, [(asked(messages), {"interrupted": False}, samples(1, messages))])
