// SPDX-License-Identifier: Apache-2.0
#include "background/nobody.hpp"

#include <fmt/format.h>
#include <unistd.h>

namespace ontime::background {

std::vector<std::string> as_nobody() {
  if (geteuid() != 0) return {};
  // A change of the user makes the kernel forget who is to be killed with whom: it is said again.
  return {"setpriv",
          fmt::format("--reuid={}", nobody),
          fmt::format("--regid={}", nobody),
          "--clear-groups",
          "--no-new-privs",
          "--pdeathsig=KILL"};
}

}  // namespace ontime::background
