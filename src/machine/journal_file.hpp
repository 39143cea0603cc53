// SPDX-License-Identifier: Apache-2.0
// A journal as a file: who owns it (its name), what was changed (its lines).
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <sys/types.h>

namespace ontime::machine {

struct Change {
  std::string kind;  // "namespace", "directory"
  std::string what;
  bool operator==(const Change&) const = default;
};

std::string line_of(const Change&);
// A last line that was not written to its end is a change that was never made.
std::vector<Change> parse_journal(const std::string& text);

// A process, told from any later one that gets the same id.
struct Owner {
  pid_t pid;
  std::uint64_t start_ticks;
  bool operator==(const Owner&) const = default;
};
Owner this_process();
bool alive(const Owner&);

// "PID-START-NUMBER.journal"; a process may have several, one after another.
std::string name_of(const Owner&, unsigned number);
std::optional<Owner> owner_of(const std::string& name);

// /run/ontime, or an ordinary user's own. It exists only while there are journals in it.
std::string journal_folder();

struct JournalFile {
  std::string path;
  Owner owner;
};
std::vector<JournalFile> journal_files();

// Adds a line, on the disk when it returns. Returns the file's length before, for cut().
off_t append(const std::string& path, const Change&);
void cut(const std::string& path, off_t length);
// Removes the file, and the folder with the last one.
void remove_journal(const std::string& path);
void remove_empty_folder();

}  // namespace ontime::machine
