// SPDX-License-Identifier: Apache-2.0
// The way back of one journal, and of all that have no owner.
#pragma once

#include <functional>
#include <span>
#include <string>
#include <vector>

#include "journal/folder.hpp"
#include "journal/format.hpp"
#include "journal/journal.hpp"

namespace ontime::journal {

struct Reverted {
  std::vector<std::string> done, left;  // for people, a line each
  std::size_t entries = 0;              // that the file has now
  bool finished = false;                // nothing is left in it to undo
};

using Wanted = std::function<bool(const Entry&)>;

// Of a journal that is locked by us: all of it, or the entries that are wanted.
Reverted revert(int fd, const std::string& path, std::span<const Kind> more, const Wanted& wanted = {});

// Adds what a journal's things are, if it is of this boot. Throws Error if it is not understood.
void look_at(int fd, const std::string& path, std::span<const Kind> more, std::vector<Kept>& all);

// A file of the folder, which is removed when nothing is left in it to undo. Adds what came of it.
void revert_file(const Folder&, const std::string& name, const Folder::Opened&, std::span<const Kind> more,
                 Journal::GivenBack& all);

struct Cleared {
  Journal::GivenBack given_back;
  std::string holder;  // whose the machine is, for people; nothing was done then
};
Cleared clear(const Folder&, std::span<const Kind> more);

}  // namespace ontime::journal
