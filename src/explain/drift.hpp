// SPDX-License-Identifier: Apache-2.0
// How the server's clock goes beside the client's at each moment of a run, for two clocks drift apart: by
// that answer which says it best then, a quick one or a near one.
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
    std::int64_t difference_ns = 0;   // what the server's clock shows more
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
