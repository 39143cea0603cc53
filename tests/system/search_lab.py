# SPDX-License-Identifier: Apache-2.0
"""Plants faults in the laboratory's machine and has `ontime tune search --on lab` find what removes them. Then it measures each set
afresh in another such machine: the whole set, and the set without each of its members."""
import collections
import json
import pathlib
import shutil
import subprocess
import sys
import time

from program import ONTIME

REPEAT = 3  # of the runs afresh
# Beside the messages a real-time program computes for 12 ms of each 33 ms: what waits for it is late.
SCENARIO = """# {title}. Another text is another course of events.
hosts: namespaces
repeat: {repeat}
defaults:
  transport: cyclonedds
  period: 4.97 ms  # no multiple of the kernel's tick
  deadline: 100 ms
  duration: 1 s
  load: {{controller: {{cpu: 1}}, component: {{cpu: 1}}}}
  background: {{topics: 1, where: other-process, rate: 30 Hz, payload: 100 B, direction: to-component, callback: 12 ms, priority: 30}}
runs:
"""
RESPONSE = "response p90 < 1 ms"
Fault = collections.namedtuple("Fault", "goal run")
FAULTS = {
    "healthy": Fault(RESPONSE, {"realtime": "on"}),
    "napi": Fault(RESPONSE, {"realtime": "on", "kernel.threaded-napi": "on"}),
    "irq": Fault(RESPONSE, {"realtime": "on", "kernel.irq-threads": "other"}),
    "irq-and-napi": Fault(RESPONSE, {"realtime": "on", "kernel.threaded-napi": "on", "kernel.irq-threads": "other"}),
    # While the program keeps the receiver from its CPU, six messages arrive. The socket holds two or three.
    "buffer": Fault("lost < 5 %", {"realtime.policy": "fifo", "realtime.priority": "40", "realtime.send.priority": "80",
                                   "background.priority": "45", "schedule": "fixed", "period": "1.97 ms", "payload": "1200 B",
                                   "kernel.rmem-max": "2500 B"}),
}
Row = collections.namedtuple("Row", "name found missed took_s")


def scenario(path, title, repeat, runs):
    text = SCENARIO.format(title=title, repeat=repeat)
    for name, keys in runs.items():
        text += "  - {" + ", ".join(f"{key}: {value}" for key, value in {"id": name, **keys}.items()) + "}\n"
    path.write_text(text)


def ontime(folder, *words):
    done = subprocess.run([ONTIME, *words, "--format", "json"], cwd=folder, capture_output=True, text=True)
    if done.returncode not in (0, 1):
        print(f"{' '.join(words)} ended with exit code {done.returncode}: {done.stderr}", file=sys.stderr)
        sys.exit(done.returncode)
    return json.loads(done.stdout)


def searched(folder, name):
    fault = FAULTS[name]
    scenario(folder / f"{name}.yaml", f"{name}, searched", 1, {"searched": fault.run})
    return ontime(folder, "tune", "search", f"./{name}.yaml", "--goal", fault.goal, "--on", "lab", "--results", f"{name}.ontime")


def missed_afresh(folder, name, members):
    """By member ("": none is left out): how many runs miss the goal."""
    fault, runs = FAULTS[name], {}
    for left_out in ("", *members):
        some = {key: value for key, value in members.items() if key != left_out}
        runs[left_out or "whole"] = {**fault.run, **some, "require": f"[{fault.goal.replace('<', '<=')}]"}
    scenario(folder / f"{name}-afresh.yaml", f"{name}, afresh", REPEAT, runs)
    missed = collections.Counter()
    for run in ontime(folder, "lab", "run", f"./{name}-afresh.yaml", "--results", f"{name}-afresh.ontime")["runs"]:
        missed[run["id"]] += bool(run["error"]) or any(note["kind"].startswith("gate-") for note in run["notes"])
    return missed


def row_of(folder, name):
    begin = time.monotonic()
    found = searched(folder, name)
    return Row(name, found, missed_afresh(folder, name, found["set"]), time.monotonic() - begin)


def has_held(row):
    if row.found["end"] != "goal-holds" or row.missed["whole"] > 0:
        return False
    if row.name == "healthy":
        return not row.found["set"] and len(row.found["trials"]) <= 3
    return bool(row.found["set"]) and all(row.missed[member] == REPEAT for member in row.found["set"])


def line_of(row):
    members = row.found["set"]
    cells = (row.name, FAULTS[row.name].goal, row.found["end"],
             ", ".join(f"`{key}: {value}`" for key, value in members.items()) or "nothing",
             f"{len(row.found['trials'])} / {row.found['runs']}", f"{row.missed['whole']} of {REPEAT}",
             ", ".join(f"{row.missed[member]} of {REPEAT}" for member in members) or "–", f"{row.took_s / 60:.0f} min")
    return f"| {' | '.join(cells)} |"


def main(folder, names):
    for name in names:
        if name not in FAULTS:
            print(f"--lab: there is no fault '{name}'. There are: {', '.join(FAULTS)}", file=sys.stderr)
            return 2
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    print("| fault | goal | end | smallest set | trials / runs | whole set misses | without each member | time here |")
    print("|---|---|---|---|---|---|---|---|", flush=True)
    held = True
    for name in names:
        row = row_of(folder, name)
        print(line_of(row), flush=True)
        held = has_held(row) and held
    return 0 if held else 1


if __name__ == "__main__":
    sys.exit(main(pathlib.Path(sys.argv[1]), sys.argv[2:] or list(FAULTS)))
