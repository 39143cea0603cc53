// SPDX-License-Identifier: Apache-2.0
// The links of this machine's ends that have faults or are counted, and the account of them.
#pragma once

#include <chrono>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "background/background.hpp"
#include "record/outcome.hpp"

namespace ontime::keeper {

class Links {
 public:
  explicit Links(journal::Journal& journal) : journal_(journal) {}

  void add(const nlohmann::json& order);  // "link"
  std::vector<std::string> clear();       // what could not be removed, for people
  // Cuts the link `after` from now, for `length`.
  void cut(const std::string& host, std::chrono::milliseconds after, std::chrono::milliseconds length);
  // Makes the cuts that are due, reports host and time of each, and returns the time until the next.
  using Told = std::function<void(const std::string& host, std::chrono::nanoseconds at)>;
  std::chrono::milliseconds go_on(const Told&);
  void begin();  // the account is opened
  // By host a record::Link: faults, etf, and beside_traffic where messages go by IP; or why they are gone.
  nlohmann::json end() const;

 private:
  using Clock = std::chrono::steady_clock;  // CLOCK_MONOTONIC, as that of samples and notes
  struct Counted {
    std::unique_ptr<background::Link> link;
    background::Link::Counts before;
    std::optional<Clock::time_point> to_be_cut;
    std::chrono::milliseconds length{0};
    bool by_ip = true;  // else messages cannot be counted apart from the traffic
  };
  journal::Journal& journal_;
  std::map<std::string, Counted> links_;  // by host
};

// What was counted between two moments. Throws background::Error if the counters were set back.
record::Link account_of(const background::Link::Counts& before, const background::Link::Counts& now);

}  // namespace ontime::keeper
