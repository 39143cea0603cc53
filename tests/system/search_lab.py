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
Fault = collections.namedtuple("Fault", "name goal keys")
FAULTS = (
    Fault("healthy", "p90 < 1 ms", {"realtime": "on"}),
    Fault("NAPI threads at SCHED_OTHER beside stress-ng and traffic", "p90 < 1 ms", {
        "realtime": "on", "kernel.threaded-napi": "on", "load": "{controller: {cpu: 3}, component: {cpu: 3}}",
        "traffic": "{rate: 4 Mbit/s, priority: 10}"}),
    Fault("interrupt threads at SCHED_OTHER beside stress-ng and traffic", "p90 < 1 ms", {
        "realtime": "on", "kernel.irq-threads": "other", "load": "{controller: {cpu: 3}, component: {cpu: 3}}",
        "traffic": "{rate: 4 Mbit/s, priority: 10}"}),
    Fault("application at SCHED_OTHER beside stress-ng", "p90 < 300 us", {
        "load": "{controller: {cpu: 3}, component: {cpu: 3}}"}),
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
    return ontime(folder, "tune", "search", f"./{name}.yaml", "--goal", fault.goal, "--on", "lab", "--within", "10 min",
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
    metric, limit = fault.goal.split(" < ")
    limit_us = float(limit.split()[0]) * {"us": 1, "ms": 1000}[limit.split()[1]]
    missed = collections.Counter()
    for run in ontime(folder, "lab", "run", "./afresh.yaml", "--results", results.name)["runs"]:
        figure = (run["round_trip_us"] or {}).get(metric)
        missed[run["id"]] += figure is None or figure >= limit_us
    return missed["whole"], {member: missed[f"without-{number}"] for number, member in enumerate(members)}


def main(seeds):
    held = True
    print("| fault | seed | goal | end | set found | trials / runs | fresh runs that miss it: whole set; without each member | time here |")
    print("|---|---|---|---|---|---|---|---|")
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
                elif fault.name != "healthy" or len(found["trials"]) > 3:
                    held = False
                held = held and found["end"] == "goal-holds"
                print(f"| {fault.name} | {seed} | {fault.goal} | {found['end']} | {members} | {len(found['trials'])} / {found['runs']} "
                      f"| {judged} | {took_s:.0f} s |", flush=True)
    return 0 if held else 1


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1])))
