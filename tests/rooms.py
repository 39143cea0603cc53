#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Who may use whom: CONTRIBUTING.md's table of rooms, what CMake links, and what the files include are one.

And whose names are whose: files of a module are compiled together."""

import pathlib
import re
import unittest

ROOT = pathlib.Path(__file__).resolve().parent.parent
SRC = ROOT / "src"
# The headers that other modules may include, beside the one with the module's name.
SHOWN = {"transport/clock.hpp", "transport/dds.hpp", "transport/shipped.hpp", "roundtrip/sample.hpp", "roundtrip/clocks.hpp",
         "orders/frames.hpp", "realtime/privileges.hpp", "background/child.hpp", "settings/file.hpp", "conditions/around.hpp",
         "listen/budget.hpp", "listen/misses.hpp", "listen/rows.hpp", "listen/sequence.hpp", "record/connection.hpp", "record/document.hpp", "record/outcome.hpp", "report/answer.hpp", "report/comparison.hpp", "report/conditions.hpp", "report/explained.hpp",
         "report/paper.hpp", "report/runs.hpp", "report/words.hpp", "statistics/lost_wait.hpp", "statistics/values.hpp", "statistics/wrapping.hpp"}


def rooms():
    return sorted(path.parent.name for path in SRC.glob("*/CMakeLists.txt"))


def linked(room):
    text = (SRC / room / "CMakeLists.txt").read_text()
    return set(re.findall(r"ontime::(\w+)", text)) & set(rooms()) - {room}


def included(room):
    """The rooms that a room's files include, and the headers by which they do."""
    found = {}
    for file in [*(SRC / room).rglob("*.cpp"), *(SRC / room).rglob("*.hpp")]:
        for header in re.findall(r'^#include "([^"]+)"', file.read_text(), re.MULTILINE):
            other = header.split("/")[0]
            if other != room and other in rooms():
                found.setdefault(other, set()).add((header, file.relative_to(SRC).as_posix()))
    return found


def documented():
    """| `room` | what lives there | `what`, `it`, `uses` |"""
    table = re.findall(r"^\| `src/(\w+)/` \|[^|]*\|([^|]*)\|$", (ROOT / "CONTRIBUTING.md").read_text(), re.MULTILINE)
    return {room: set(re.findall(r"`(\w+)`", uses)) for room, uses in table}


def reachable(room):
    seen, waiting = set(), [room]
    while waiting:
        for other in linked(waiting.pop()):
            if other not in seen:
                seen.add(other)
                waiting.append(other)
    return seen


NO_CODE = re.compile(r'//[^\n]*|R"(\w*)\(.*?\)\1"|"(?:[^"\\\n]|\\.)*"', re.S)
FUNCTION = re.compile(r"^(?!using |namespace |class |struct |enum |template|#)[\w\[][\w:<>,&*\[\] ]*?[ &*>](\w+)\(", re.MULTILINE)


def functions(text, between=r"(?s:.*)"):
    """The free functions of a file, or of what \1 of `between` is in it."""
    text = NO_CODE.sub("", text)
    return {name for part in re.finditer(between, text) for name in FUNCTION.findall(part[part.re.groups])}


class Names(unittest.TestCase):
    def test_functions_of_unnamed_namespaces_share_no_name(self):
        """If two in a module have one name, the call may go to the one that its author did not know."""
        rooms = [path.parent for top in (SRC, ROOT / "apps") for path in top.rglob("CMakeLists.txt") if path.parent != top]
        self.assertGreater(len(rooms), 30)
        for room in rooms:
            taken = {name: header.name for header in room.glob("*.hpp") for name in functions(header.read_text())}
            for file in sorted(room.glob("*.cpp")):
                for name in functions(file.read_text(), r"(?ms)^namespace \{$(.*?)^\}"):
                    with self.subTest(room=room.name, name=name):
                        self.assertEqual(taken.setdefault(name, file.name), file.name)


class Rooms(unittest.TestCase):
    def test_what_is_included_is_linked(self):
        for room in rooms():
            with self.subTest(room=room):
                self.assertLessEqual(set(included(room)), linked(room))

    def test_what_is_linked_is_needed(self):
        for room in rooms():
            with self.subTest(room=room):
                self.assertLessEqual(linked(room), set(included(room)))

    def test_nobody_reaches_behind_a_rooms_header(self):
        for room in rooms():
            for other, headers in included(room).items():
                for header, file in headers:
                    with self.subTest(file=file):
                        self.assertTrue(header == f"{other}/{other}.hpp" or header in SHOWN, header)

    def test_no_room_uses_itself_by_way_of_others(self):
        for room in rooms():
            with self.subTest(room=room):
                self.assertNotIn(room, reachable(room))

    def test_the_table_tells_it_so(self):
        self.assertEqual(documented(), {room: linked(room) for room in rooms()})


if __name__ == "__main__":
    unittest.main()
