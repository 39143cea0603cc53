// SPDX-License-Identifier: Apache-2.0
// Judges messages that a sensor sees, live or recorded, and prints the result: `ontime listen`, and
// `ontime import BAG`.
#pragma once

#include <memory>
#include <set>
#include <string>
#include <vector>

#include "command.hpp"
#include "listen/listen.hpp"

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

// Probes; if they are denied, campaign::Error has the command line to paste.
std::unique_ptr<listen::Sensor> sensor_in_processes(const listen::Limits&,
                                                    std::vector<listen::ChainWish> = {});
// A reader of our own reads `topics`, in the domain of ROS_DOMAIN_ID. Throws campaign::Error, and as the
// sensors do.
std::unique_ptr<listen::Sensor> sensor_of(const ListenArguments&, const listen::Limits&,
                                          const std::vector<listen::ChainWish>&,
                                          const std::set<std::string>& topics);

// Adds remarks on requested topics of which no message was seen. True: all were seen.
bool add_unseen(listen::Findings&, const std::set<std::string>& topics, const ListenArguments&);
// Once they are printed. 1: a limit was missed, or is open, which it says; 2: a topic or chain without a
// limit was not seen; 0. `is_all_seen`: a message of each topic that was asked for.
int exit_code_of(const listen::Findings&, const listen::Limits&, const ListenArguments&, bool is_all_seen);

}  // namespace ontime::app
