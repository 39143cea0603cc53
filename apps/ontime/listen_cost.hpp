// SPDX-License-Identifier: Apache-2.0
// How long `ontime listen` counted messages, and what that cost. Ordinary thread.
#pragma once

#include <chrono>
#include <optional>
#include <string>

#include <nlohmann/json.hpp>

#include "listen/listen.hpp"

namespace ontime::app {

// CPU time of this process, all threads, since it began.
std::chrono::nanoseconds own_cpu_time();

class ListenCost {
 public:
  void begin();                  // what was before does not count
  std::int64_t from_ns() const;  // the system's clock at begin()
  std::chrono::nanoseconds listened() const;
  // `probes`: in the nodes; nothing: it sets no probes.
  std::string text(const std::optional<listen::Cost>& probes) const;
  nlohmann::ordered_json json(const std::optional<listen::Cost>& probes) const;

 private:
  bool is_known() const;  // a share of a CPU over less time says nothing
  double share_of_cpu(double ns) const { return ns / static_cast<double>(listened().count()); }
  double own_share() const;  // with the thread that reads the kernel's events

  std::chrono::system_clock::time_point from_;
  std::chrono::steady_clock::time_point since_;
  std::chrono::nanoseconds own_before_{};
};

}  // namespace ontime::app
