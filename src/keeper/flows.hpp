// SPDX-License-Identifier: Apache-2.0
// The concurrent traffic that this machine's ends send and receive, and the account of it.
#pragma once

#include <chrono>
#include <memory>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "background/background.hpp"

namespace ontime::keeper {

class Flows {
 public:
  void add(const std::string& host, const std::string& way, const background::Stream&);
  void clear() { flows_.clear(); }
  void listen();  // now and then: else the writers block
  void begin();   // the account is opened
  // Of each host and way {bit_s, running}; bit_s is null where nothing was reported in the time.
  nlohmann::json end();

 private:
  using Clock = std::chrono::steady_clock;
  struct Flow {
    std::string host, way;
    std::unique_ptr<background::Traffic> traffic;
    background::Moved before;
  };
  std::vector<Flow> flows_;
  Clock::time_point begun_;
};

// The average rate between two reports; nothing if no time was reported. Time without reports counts as time
// without traffic, except the last second of a running iperf3: its report may be late.
std::optional<double> bits_per_second(const background::Moved& before, const background::Moved& after,
                                      std::chrono::duration<double> elapsed, bool running);

}  // namespace ontime::keeper
