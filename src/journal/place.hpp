// SPDX-License-Identifier: Apache-2.0
// Where this thread is, as text that can be compared with that of another process.
#pragma once

#include <string>

#include "journal/journal.hpp"

namespace ontime::journal {

// The kernel's boot_id, new after each reboot; "" if the kernel does not report it.
std::string boot_id();

// The namespace from which this thread sees things of that scope; "" for the whole machine. Throws Error if
// /proc does not report it.
std::string place(Scope);

// Whether no process is in that mount namespace any more, and no file keeps it. False where this cannot be
// known: in a container, or as an ordinary user.
bool mount_namespace_ended(const std::string& place);

// The identity of an open network namespace; "" if the file is not one. The kernel reuses the inode of a
// removed namespace, so its cookie is added, which is never reused (Linux 5.14 and later; only root can ask).
std::string network_identity(int fd);

}  // namespace ontime::journal
