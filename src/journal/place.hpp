// SPDX-License-Identifier: Apache-2.0
// Where we are, in words that can be compared with those of another process.
#pragma once

#include <string>

#include "journal/journal.hpp"

namespace ontime::journal {

// The kernel's, new with each start of the machine; "" if it does not say.
std::string boot_id();

// What this thread can see things of that scope from; "" for the whole machine. Throws Error if /proc does
// not say.
std::string place(Scope);

// Of an open network namespace, "" if it is none. The kernel gives the inode of one that has gone to the
// next, so its cookie is added, which it never gives again (from Linux 5.14 on; root alone can ask).
std::string network_identity(int fd);

}  // namespace ontime::journal
