// SPDX-License-Identifier: Apache-2.0
// Late messages of `ontime listen` with the same cause. Pure; ordinary thread.
#pragma once

#include <string>
#include <vector>

#include "record/record.hpp"

namespace ontime::report {

struct SameCause {
  std::vector<const record::Note*> notes{};  // the earliest first
  // What they say: of each time the shortest and the longest; details, such as a CPU, only if all have the
  // same. Notes of an older ontime are the same if their texts are, but for numbers: the first one's text,
  // which includes the fix.
  std::string text{}, fix{};  // fix: "" if nothing helps
};
// Of notes why a message was late, which stay where they are. The most messages first.
std::vector<SameCause> same_causes_of(const std::vector<const record::Note*>&);
// One line: "2026-11-25 03:50:43  26.1 ms old (limit 5 ms): …; fix: …".
std::string text_of(const record::LateCause&);

}  // namespace ontime::report
