// SPDX-License-Identifier: Apache-2.0
// A journal as text, in lines of JSON: one that names its owner, one for each change before it is made, and
// one for each later result of a change. Pure functions.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

#include <sys/types.h>

#include "journal/journal.hpp"

namespace ontime::journal {

constexpr int format_version = 1;

struct Header {
  std::string boot;     // the kernel's boot_id
  pid_t pid = 0;        // of its owner, as people know it, in its own PID namespace: for people only
  std::string command;  // of that process, for people
  bool operator==(const Header&) const = default;
};

struct Entry {
  std::string kind;
  std::string where;  // place() of the kind's scope, when the change was made
  std::string what;
  Value before, after;
  bool done = false;  // undone, or left to its new owner: nothing remains to do
  bool operator==(const Entry&) const = default;
};

std::string line_of(const Header&);
std::string line_of(const Entry&);
// About entry `index`, counted from 0: its new value; that it is done.
std::string line_of_identity(std::size_t index, const std::string& after);
std::string line_of_done(std::size_t index);

struct Contents {
  Header header;
  std::vector<Entry> entries;
  std::vector<std::size_t> begins;  // where in the text each entry begins
  std::string not_understood;       // if not empty: do not rely on the other fields
};
// Parses any bytes. An incomplete last line is a change that was never made.
Contents parse(std::string_view text);

// For people: no control characters, no more than a line.
std::string in_quotes(std::string_view text);

}  // namespace ontime::journal
