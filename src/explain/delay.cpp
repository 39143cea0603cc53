// SPDX-License-Identifier: Apache-2.0
#include "explain/delay.hpp"

#include <algorithm>

namespace ontime::explain {

void Delay::add(Part part, std::int64_t ns, const std::vector<Stretch>& when) {
  if (ns <= 0) return;
  held_ns += ns;
  const auto same = std::find_if(parts.begin(), parts.end(), [&](const Part& other) {
    return other.cause == part.cause && other.stage == part.stage && other.end == part.end &&
           other.thread == part.thread && other.via == part.via && other.culprit == part.culprit;
  });
  if (same == parts.end()) {
    part.ns = ns;
    part.when = when;
    parts.push_back(std::move(part));
    return;
  }
  same->ns += ns;
  same->when.insert(same->when.end(), when.begin(), when.end());
  for (const auto thread : part.culprit_threads)
    if (std::ranges::find(same->culprit_threads, thread) == same->culprit_threads.end())
      same->culprit_threads.push_back(thread);
}

void Delay::add(const Part& part, const Stretch& when) { add(part, when.length_ns(), {when}); }

Spent& add(std::vector<Spent>& all, const Part& whose, const Stretch& when) {
  auto same = std::find_if(all.begin(), all.end(), [&](const Spent& one) {
    return one.whose.thread_id == whose.thread_id && one.whose.stage == whose.stage;
  });
  if (same == all.end()) same = all.insert(all.end(), {.whose = whose});
  same->ns += when.length_ns();
  same->when.push_back(when);
  return *same;
}

}  // namespace ontime::explain
