// SPDX-License-Identifier: Apache-2.0
#include "settings/kinds.hpp"

#include <algorithm>

namespace ontime::settings {

std::span<const journal::Kind> kinds() {
  static const std::vector<journal::Kind> all = {thread,   network_sysctl, kernel_sysctl, governor, interrupt,
                                                 threaded, steering,       coalescing,    gro};
  return all;
}

Thing thing(const journal::Kind& kind, std::string what) {
  const auto all = kinds();
  const auto known =
      std::find_if(all.begin(), all.end(), [&](const journal::Kind& one) { return one.name == kind.name; });
  return {&*known, std::move(what)};
}

std::string Thing::title() const {
  if (kind == &*thing(thread, "").kind) return name_of_thread(what);
  if (kind->name == std::string_view("interrupt")) return "interrupt " + what;
  return what;
}

}  // namespace ontime::settings
