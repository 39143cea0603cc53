// SPDX-License-Identifier: Apache-2.0
// Judges messages that a sensor sees, live or recorded, and prints the result: `ontime listen`, and
// `ontime import BAG`.
#pragma once

#include <string>
#include <vector>

#include "command.hpp"

namespace ontime::app {

struct ListenArguments {
  std::vector<std::string> topics, chains;
  std::string deadline, period, age, time, pcap, packets, bag, output, metrics, results, budget, keep,
      format = "table";
  bool list = false, no_explain = false, reader = false;
  bool is_recording() const { return !pcap.empty() || !bag.empty(); }
  bool is_in_processes() const { return packets.empty() && !is_recording() && !reader; }
};

// --deadline, --period and --age; `age_help` says when the age ends.
void add_limits(Command&, ListenArguments&, const char* age_help);
// Returns the exit code.
int listen_to(const ListenArguments&);

}  // namespace ontime::app
