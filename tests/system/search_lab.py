# SPDX-License-Identifier: Apache-2.0
"""Plants faults in the laboratory's machine, has `ontime tune search --on lab` find what removes them, and measures each set afresh in
another such machine, whole and without each of its members."""
import collections
import json
import pathlib
import subprocess
import sys
import tempfile
import time

from program import ONTIME

GOAL, LIMIT_US = "p90 < 340 us", 340  # with the trace that `explain` needs, a round trip takes 320 µs there
REPEAT = 2                            # of the runs afresh
SCENARIO = """# {title}: another text is another course of events
hosts: namespaces
repeat: {repeat}
defaults:
  {{transport: udp, period: 5 ms, deadline: 100 ms, duration: 1 s, explain: on, load: {{component: {{cpu: 2}}}}}}
runs:
"""
FAULTS = {
    "none": {"realtime": "on"},
    "application at SCHED_OTHER": {},
    "interrupt threads at SCHED_OTHER": {"realtime": "on", "kernel.irq-threads": "other"},
    "both": {"kernel.irq-threads": "other"},
}
Row = collections.namedtuple("Row", "fault seed found took_s")


def run_of(name, settings):
    return "  - {" + ", ".join([f"id: {name}", *(f"{key}: {value}" for key, value in settings.items())]) + "}\n"


def ontime(folder, *words):
    done = subprocess.run([ONTIME, *words, "--format", "json"], cwd=folder, capture_output=True, text=True)
    if done.returncode not in (0, 1):
        sys.exit(f"{' '.join(words)} ended with exit code {done.returncode}: {done.stderr}")
    return json.loads(done.stdout)


def search(folder, fault, seed):
    (folder / "searched.yaml").write_text(SCENARIO.format(title=f"{fault}, seed {seed}", repeat=1) + run_of("searched", FAULTS[fault]))
    (folder / "searched.ontime").unlink(missing_ok=True)
    begin = time.monotonic()
    found = ontime(folder, "tune", "search", "./searched.yaml", "--goal", GOAL, "--on", "lab", "--results", "searched.ontime")
    return Row(fault, seed, found, time.monotonic() - begin)


def missed_afresh(folder, rows):
    """By row and member ("": the whole set): how many of its runs miss the goal, in one machine for all."""
    sets = {}
    for at, row in enumerate(rows):
        for member in ("", *row.found["set"]) if row.found["set"] else ():
            sets[f"set-{len(sets)}"] = at, member, {key: value for key, value in row.found["set"].items() if key != member}
    runs = "".join(run_of(name, {**FAULTS[rows[at].fault], **settings}) for name, (at, _, settings) in sets.items())
    (folder / "afresh.yaml").write_text(SCENARIO.format(title="afresh", repeat=REPEAT) + runs)
    missed = collections.Counter()
    for run in ontime(folder, "lab", "run", "./afresh.yaml", "--results", "afresh.ontime")["runs"] if sets else ():
        at, member, _ = sets[run["id"]]
        missed[at, member] += not (run["round_trip_us"] and run["round_trip_us"]["p90"] < LIMIT_US)
    return missed


def has_held(at, row, missed):
    if row.found["end"] != "goal-holds" or (row.fault == "none") != (not row.found["set"]):
        return False
    if row.fault == "none":
        return len(row.found["trials"]) <= 3
    return missed[at, ""] == 0 and all(missed[at, member] == REPEAT for member in row.found["set"])


def main(seeds):
    with tempfile.TemporaryDirectory(prefix="ontime-search-lab-") as path:
        folder = pathlib.Path(path)
        rows = []
        for fault in FAULTS:
            for seed in range(1, seeds + 1):
                rows.append(search(folder, fault, seed))
                print(f"{fault}, seed {seed}: {rows[-1].found['end']}, {rows[-1].found['set']}", file=sys.stderr, flush=True)
        missed = missed_afresh(folder, rows)
    print(f"Goal: {GOAL}. Afresh: of {REPEAT} runs, so many miss it.\n")
    print("| fault | seed | end | smallest set | trials / runs | afresh, whole set | afresh, without each member | time here |")
    print("|---|---|---|---|---|---|---|---|")
    for at, row in enumerate(rows):
        members = row.found["set"]
        shown = ", ".join(f"`{key}: {value}`" for key, value in members.items()) or "nothing"
        print(f"| {row.fault} | {row.seed} | {row.found['end']} | {shown} | {len(row.found['trials'])} / {row.found['runs']} "
              f"| {missed[at, ''] if members else '–'} "
              f"| {', '.join(str(missed[at, member]) for member in members) or '–'} | {row.took_s:.0f} s |")
    return 0 if all(has_held(at, row, missed) for at, row in enumerate(rows)) else 1


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1])))
