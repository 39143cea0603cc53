// SPDX-License-Identifier: Apache-2.0
// The delays of a message on one leg, and what else the leg's threads did.
#pragma once

#include <cstdint>
#include <vector>

#include "explain/explain.hpp"

namespace ontime::explain {

// How long a thread ran or slept at a stage. It is a delay only if it is longer than usual.
struct Spent {
  Part whose;
  std::int64_t ns = 0;
  std::vector<Stretch> when{};
};

struct Delay {
  std::vector<Part> parts{};
  std::int64_t held_ns = 0;  // the sum of the parts
  std::vector<Spent> ran{}, slept{};
  Part last{};  // the stage and the thread that was looked at last

  // Parts with the same cause, stage, thread and culprit become one.
  void add(Part, std::int64_t ns, const std::vector<Stretch>& when);
  void add(const Part&, const Stretch& when);
};

// What that thread spent at that stage; times of one thread and stage become one.
Spent& add(std::vector<Spent>&, const Part& whose, const Stretch& when);

}  // namespace ontime::explain
