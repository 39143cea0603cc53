// SPDX-License-Identifier: Apache-2.0
// The user that load and traffic run as: neither root's reserves nor its rights are for them.
#pragma once

#include <string>
#include <vector>

#include <sys/types.h>

namespace ontime::background {

inline constexpr uid_t nobody = 65534;

// Words before a command, by which root starts it as the user nobody, without any privilege, and still killed
// with the thread that started it. None for a caller that is not root.
std::vector<std::string> as_nobody();

}  // namespace ontime::background
