// SPDX-License-Identifier: Apache-2.0
// Late messages of `ontime listen` with the same cause. Pure; ordinary thread.
#pragma once

#include <string>
#include <vector>

#include "record/record.hpp"

namespace ontime::report {

struct SameCause {
  std::vector<const record::Note*> notes{};
  // What they say: of each time the shortest and the longest; details, such as a CPU, only if all have the
  // same.
  std::string text{}, fix{};  // fix: "" if nothing helps
};
// Of notes why a message was late, which stay where they are. The most messages first.
std::vector<SameCause> same_causes_of(const std::vector<const record::Note*>&);
// "2026-11-25 03:50:43  ", before the text of a note of weeks; else empty.
std::string date_of(const std::string& text);

}  // namespace ontime::report
