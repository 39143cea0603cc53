// SPDX-License-Identifier: Apache-2.0
#include "settings/kinds.hpp"

namespace ontime::settings {

std::span<const journal::Kind> kinds() {
  static const std::vector<journal::Kind> all = {
      thread,    network_sysctl, kernel_sysctl, governor,   workqueues,
      interrupt, threaded,       steering,      coalescing, gro};
  return all;
}

std::string Thing::title() const {
  if (kind == &thread) return name_of_thread(what);
  if (kind == &workqueues) return "unbound work";
  if (kind == &interrupt) return "interrupt " + what.substr(0, what.find(':'));
  if (is_interface(what.substr(0, what.find('/')))) return name_of_interface(what);
  return what;
}

}  // namespace ontime::settings
