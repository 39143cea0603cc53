// SPDX-License-Identifier: Apache-2.0
#include "campaign/search.hpp"

namespace ontime::campaign {

using nlohmann::json;

namespace {

const json& at(const json& object, const char* key) {
  static const json null;
  const auto found = object.is_object() ? object.find(key) : object.end();
  return object.is_object() && found != object.end() ? *found : null;
}

}  // namespace

// It may come from a file that somebody else wrote: what is not there, or is something else, is null.
bool ends_search(const json& outcome) {
  if (!at(outcome, "error").is_null()) return true;
  for (const auto* counter : {"late", "lost", "skipped_cycles"})
    if (const auto& count = at(outcome, counter); !count.is_null() && count != 0) return true;
  for (const auto* beside : {"neighbours", "traffic"})
    for (const auto* way : {"to_component", "to_controller"})
      if (at(at(at(outcome, beside), way), "short") == true) return true;
  for (const auto* name : {"controller", "component"}) {
    const auto& host = at(at(outcome, "hosts"), name);
    if (at(host, "load_running") == false) return true;
    if (at(at(host, "link"), "gone").is_string()) return true;
  }
  return false;
}

}  // namespace ontime::campaign
