// SPDX-License-Identifier: Apache-2.0
// The way back of one journal.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "journal/folder.hpp"
#include "journal/journal.hpp"

namespace ontime::journal {

struct Reverted {
  std::vector<std::string> done, left;  // for people, a line each
  std::string holder;                   // whose the machine is; nothing was done then
};

// Of a journal that is locked by us. It goes when nothing is left in it to undo.
Reverted revert(const Folder&, const std::string& name, int fd, std::span<const Kind> more);

// Of all, if nobody owns one of them.
Reverted revert_all(const Folder&, std::span<const Kind> more);

}  // namespace ontime::journal
