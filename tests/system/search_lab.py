# SPDX-License-Identifier: Apache-2.0
"""Plants faults in the laboratory's machine, has `ontime tune search --on lab` find what removes them, and measures the set afresh,
whole and without each of its members."""
import collections
import json
import pathlib
import subprocess
import sys
import tempfile
import time

from program import ONTIME

SCENARIO = """# {name}, seed {seed}: another text is another course of events
hosts: namespaces
defaults:
  transport: udp
  period: 5 ms
  deadline: 100 ms
  duration: 1 s
{keys}
runs: {runs}
"""
Fault = collections.namedtuple("Fault", "name keys")
GOAL = "p90 < 300 us"
BUSY = {"load": "{controller: {cpu: 3}, component: {cpu: 3}}", "traffic": "{rate: 4 Mbit/s, priority: 10}"}
FAULTS = (
    Fault("none", {"realtime": "on", **BUSY}),
    Fault("NAPI threads at SCHED_OTHER", {"realtime": "on", "kernel.threaded-napi": "on", **BUSY}),
    Fault("application at SCHED_OTHER", BUSY),
    Fault("application and NAPI threads at SCHED_OTHER", {"kernel.threaded-napi": "on", **BUSY}),
    Fault("interrupt threads (50) behind traffic at SCHED_FIFO 60", {
        "realtime": "on", **BUSY, "traffic": "{rate: 4 Mbit/s, priority: 60}"}),
)


def keys_of(settings):
    """In YAML: kernel.NAME of one map."""
    kernel = {key.partition(".")[2]: value for key, value in settings.items() if key.startswith("kernel.")}
    others = {key: value for key, value in settings.items() if not key.startswith("kernel.")}
    lines = [f"  {key}: {value}" for key, value in others.items()]
    return "\n".join(lines + (["  kernel: {" + ", ".join(f"{key}: {value}" for key, value in kernel.items()) + "}"] if kernel else []))


def ontime(folder, *words):
    done = subprocess.run([ONTIME, *words, "--format", "json"], cwd=folder, capture_output=True, text=True)
    if done.returncode not in (0, 1):
        sys.exit(f"{' '.join(words)} ended with exit code {done.returncode}: {done.stderr}")
    return json.loads(done.stdout)


def search(folder, fault, seed, name):
    (folder / f"{name}.yaml").write_text(SCENARIO.format(name=fault.name, seed=seed, keys=keys_of(fault.keys), runs="[{id: searched}]"))
    return ontime(folder, "tune", "search", f"./{name}.yaml", "--goal", GOAL, "--on", "lab", "--within", "10 min",
                  "--results", f"{name}.ontime")


def afresh(folder, fault, seed, found):
    """Of fresh runs in another machine: how many of those with the whole set miss the goal, and, by its members, of those without it."""
    members = list(found["set"])
    sets = {"whole": found["set"], **{f"without-{number}": {key: value for key, value in found["set"].items() if key != member}
                                      for number, member in enumerate(members)}}
    runs = "".join(f"\n  - id: {name}\n" + keys_of({**fault.keys, **chosen}).replace("  ", "    ", 1).replace("\n  ", "\n    ")
                   for name, chosen in sets.items())
    (folder / "afresh.yaml").write_text(SCENARIO.format(name=f"{fault.name}, afresh", seed=seed, keys="  explain: on\nrepeat: 3", runs=runs))
    results = folder / "afresh.ontime"
    results.unlink(missing_ok=True)
    missed = collections.Counter()
    for run in ontime(folder, "lab", "run", "./afresh.yaml", "--results", results.name)["runs"]:
        p90_us = (run["round_trip_us"] or {}).get("p90")
        missed[run["id"]] += p90_us is None or p90_us >= 300
    return missed["whole"], {member: missed[f"without-{number}"] for number, member in enumerate(members)}


def main(seeds):
    held = True
    print(f"Goal: {GOAL}.\n")
    print("| fault | seed | end | set found | trials / runs | fresh runs that miss the goal: by the set; without each member | time here |")
    print("|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory(prefix="ontime-search-lab-") as path:
        folder = pathlib.Path(path)
        for fault in FAULTS:
            for seed in range(1, seeds + 1):
                begin = time.monotonic()
                name = f"search-{FAULTS.index(fault)}-{seed}"
                found = search(folder, fault, seed, name)
                took_s = time.monotonic() - begin
                members = ", ".join(f"`{key}: {value}`" for key, value in found["set"].items()) or "nothing"
                judged = "–"
                if found["set"]:
                    whole, without = afresh(folder, fault, seed, found)
                    judged = f"{whole} of 3; " + ", ".join(f"{count} of 3" for count in without.values())
                    held = held and whole == 0 and all(count == 3 for count in without.values())
                elif fault.name != "none" or len(found["trials"]) > 3:
                    held = False
                held = held and found["end"] == "goal-holds"
                print(f"| {fault.name} | {seed} | {found['end']} | {members} | {len(found['trials'])} / {found['runs']} "
                      f"| {judged} | {took_s:.0f} s |", flush=True)
    return 0 if held else 1


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1])))
