// SPDX-License-Identifier: Apache-2.0
// Restores what one journal lists, or all journals without an owner.
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

// Reverts a journal that this process has locked: all of it, or the wanted entries.
Reverted revert(int fd, const std::string& path, std::span<const Kind> more, const Wanted& wanted = {});

// Adds the things of a journal of this boot. Throws Error if it is not understood.
void look_at(int fd, const std::string& path, std::span<const Kind> more, std::vector<Kept>& all);

// Reverts a file of the folder, and removes it when nothing is left in it to undo. Adds the results.
void revert_file(const Folder&, const std::string& name, const Folder::Opened&, std::span<const Kind> more,
                 Journal::GivenBack& all);

struct Cleared {
  Journal::GivenBack given_back;
  std::string holder;  // who holds the machine, for people; then nothing was done
};
Cleared clear(const Folder&, std::span<const Kind> more);

}  // namespace ontime::journal
