// SPDX-License-Identifier: Apache-2.0
// How long cycles whose messages were lost waited: until the answer to a later one, if that came after they
// were given up. Else their wait is open: no answer is known that ended it.
#pragma once

#include <algorithm>
#include <cstdint>
#include <optional>
#include <utility>

#include "statistics/wrapping.hpp"

namespace ontime::statistics {

class LostWait {
 public:
  struct Wait {
    std::int64_t since_ns, ns;
    bool is_open;
  };

  void lost(std::int64_t due_ns, std::int64_t given_up_ns) {
    const auto ns = between(due_ns, given_up_ns);
    if (!wait_) wait_ = {due_ns, ns, true};
    wait_->ns = std::max(wait_->ns, ns);
  }

  // Since the last answer; nothing: no message was lost.
  std::optional<Wait> answered(std::int64_t at_ns) {
    auto wait = std::exchange(wait_, {});
    if (wait && between(wait->since_ns, at_ns) >= wait->ns)
      wait = {wait->since_ns, between(wait->since_ns, at_ns), false};
    return wait;
  }

  // Samples are missing here: one of these messages may have been answered. The wait is known only until the
  // lost ones were given up.
  std::optional<Wait> cut() { return std::exchange(wait_, {}); }

  // At the end: no answer came until then.
  std::optional<Wait> ended(std::int64_t until_ns) {
    auto wait = std::exchange(wait_, {});
    if (wait) wait->ns = std::max(wait->ns, between(wait->since_ns, until_ns));
    return wait;
  }

 private:
  std::optional<Wait> wait_;
};

}  // namespace ontime::statistics
