// SPDX-License-Identifier: Apache-2.0
// The offset between the server's and the client's clock at each time of a run (clocks drift), from the
// answer that bounds it best at that time: a quick or a near one.
#pragma once

#include <cstdint>
#include <vector>

#include "record/record.hpp"

namespace ontime::explain {

class Drift {
 public:
  Drift() = default;  // they are one clock
  Drift(const record::Reader&, std::int64_t run);

  struct Beside {
    std::int64_t difference_ns = 0;   // server's clock minus client's
    std::int64_t uncertainty_ns = 0;  // either way
  };
  Beside at(std::int64_t sent_ns) const;  // by the client's clock

 private:
  struct Answer {
    std::int64_t sent_ns;
    Beside beside;
    Beside at(std::int64_t then_ns) const;
  };
  // The best of all answers until then, and of all since.
  struct Moment {
    std::int64_t sent_ns;
    Answer before, after;
  };
  std::vector<Moment> moments_;  // in order
};

}  // namespace ontime::explain
