# SPDX-License-Identifier: Apache-2.0
"""Whether what was named is right, and the table of it."""
import collections
import dataclasses
import os
import pathlib
import re
import subprocess
import time

from ends import OTHER

NOBODY = {"unknown", "timer", "idle-cpu", "not-preempted", "busy"}
LEAST_SHARE = 0.8


def is_made(kind, end, part):
    return (part["cause"] in kind.cause.split("|") and kind.culprit in part["culprit"] and kind.via in part.get("via", "") and (kind.named_at or end) in ("either", part["end"])
            and (not kind.stages or part["stage"] in kind.stages))


@dataclasses.dataclass
class Verdict:
    right: bool
    first: str      # the cause that was named first, or "none"
    instead: str    # what was named, where that is not right


def judged(kind, end, said):
    causes = said["causes"]
    if not kind.cause:
        accused = [cause["cause"] for cause in causes if cause["cause"] not in NOBODY]
        return Verdict(not accused, accused[0] if accused else "none", accused[0] if accused else "")
    if not causes:
        return Verdict(False, "none", "nothing was late")
    first = causes[0]
    named = " ".join(filter(None, [first["cause"], first["stage"], first["culprit"], f"({first['end']})"]))
    wrong = Verdict(False, first["cause"], named)
    right = Verdict(True, first["cause"], "")
    if kind.also and first["cause"] == kind.also:
        if len(causes) < 2 or not is_made(kind, end, causes[1]):
            return wrong
    elif not is_made(kind, end, first):
        return wrong
    elif kind.also and (len(causes) < 2 or causes[1]["cause"] != kind.also):
        return dataclasses.replace(wrong, instead=named + " alone")
    def counts(part):
        return is_made(kind, end, part) or part["cause"] == kind.also
    faults = [message for message in said["messages"] if message["fate"] != "on time"]
    mine = [message for message in faults if message["parts"] and counts(message["parts"][0])]
    if 2 * len(mine) <= len(faults):
        return dataclasses.replace(wrong, instead=f"{named}, {len(mine)} of {len(faults)} messages")
    if kind.cause in ("dropped", "link-down"):
        share = len(mine) / len(faults)
    else:
        delay = sum(message["delay_us"] for message in faults)
        share = sum(part["us"] for message in faults for part in message["parts"] if counts(part)) / max(delay, 1)
    return right if share >= LEAST_SHARE else dataclasses.replace(wrong, instead=f"{named} {100 * share:.0f} % of it")


class Results:
    """What came of all that was tried, as Markdown."""

    def __init__(self, seed, ontime):
        self.verdicts = collections.defaultdict(list)  # by kind, end and transport
        self.not_tried = {}                            # why, by kind and transport
        self.seed, self.ontime, self.begun, self.load = seed, ontime, time.time(), os.getloadavg()[0]

    def add(self, kind, end, transport, verdict):
        self.verdicts[kind.name, end, transport].append(verdict)

    def all_right(self):
        return all(verdict.right for verdicts in self.verdicts.values() for verdict in verdicts)

    def of(self, name=None, end=None, transport=None):
        return [verdict for key, verdicts in self.verdicts.items()
                if all(wanted in (None, here) for wanted, here in zip((name, end, transport), key)) for verdict in verdicts]

    @staticmethod
    def count(verdicts):
        return f"{sum(verdict.right for verdict in verdicts)} of {len(verdicts)}" if verdicts else ""

    def share(self, name=None):
        verdicts = self.of(name)
        return 100 * sum(verdict.right for verdict in verdicts) / max(len(verdicts), 1)

    def columns(self, place):
        return list(dict.fromkeys(key[place] for key in self.verdicts))

    def machine(self):
        model = re.search(r"model name\s*: (.*)", pathlib.Path("/proc/cpuinfo").read_text())
        memory = int(re.search(r"MemTotal: *(\d+)", pathlib.Path("/proc/meminfo").read_text())[1]) / 2**20
        version = subprocess.run([self.ontime, "--version"], capture_output=True, text=True).stdout.strip()
        return (f"{version}, Linux {os.uname().release}, {os.cpu_count()} CPUs ({model[1] if model else os.uname().machine}), "
                f"{memory:.0f} GiB; seed {self.seed}, {len(self.of())} runs in {(time.time() - self.begun) / 60:.0f} min, load average "
                f"{self.load:.1f} before and {os.getloadavg()[0]:.1f} at the end.")

    def markdown(self):
        transports, ends = self.columns(2), [end for end in self.columns(1) if end]
        lines = [self.machine(), "", "| made | " + " | ".join(transports + [f"at the {end}" if end in OTHER else "at either end"
                                                                         for end in ends]) + " | right | named first |",
                 "|---" * (len(transports) + len(ends) + 3) + "|"]
        for name in self.columns(0):
            first = collections.Counter(verdict.first for verdict in self.of(name))
            counts = [self.count(self.of(name, transport=transport)) for transport in transports]
            counts += [self.count(self.of(name, end=end)) for end in ends]
            named = ", ".join(f"{cause} {number}" for cause, number in first.most_common())
            lines.append(f"| `{name}` | " + " | ".join(counts) + f" | {self.share(name):.0f} % | {named} |")
        if self.verdicts:
            least = min(self.columns(0), key=self.share)
            lines += ["", f"Right are {self.count(self.of())} ({self.share():.1f} %); the least of a kind {self.share(least):.0f} % "
                          f"(`{least}`)."]
        lines += [""] + [f"Not tried: {name}{f' over {transport}' if transport else ''}: {why}."
                         for (name, transport), why in self.not_tried.items()]
        wrong = collections.Counter((key, verdict.instead) for key, verdicts in self.verdicts.items() for verdict in verdicts
                                    if not verdict.right)
        if wrong:
            lines += ["", "| not right | at the | over | times | named |", "|---|---|---|---|---|"]
            lines += [f"| `{name}` | {end} | {transport} | {number} | {instead} |"
                      for ((name, end, transport), instead), number in wrong.items()]
        return "\n".join(lines)
