// SPDX-License-Identifier: Apache-2.0
// The links of this machine's ends that have faults or are counted, and the account of them.
#pragma once

#include <chrono>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>

#include <nlohmann/json.hpp>

#include "background/background.hpp"

namespace ontime::keeper {

class Links {
 public:
  explicit Links(journal::Journal& journal) : journal_(journal) {}

  void add(const nlohmann::json& order);  // "link"
  void clear() { links_.clear(); }
  // A while from now on, for so long.
  void cut(const std::string& host, std::chrono::milliseconds after, std::chrono::milliseconds length);
  // Cuts what is due, tells the host and since when, and returns how long there is until the next.
  using Told = std::function<void(const std::string& host, std::chrono::nanoseconds at)>;
  std::chrono::milliseconds go_on(const Told&);
  void begin();  // the account is opened
  // By host {faults {lost_frames, cut_off_frames, duplicated_frames}, beside_traffic {sent_bytes,
  // received_bytes} where messages go by IP}, or {gone: why it cannot be counted any more, and the faults
  // are not verified}.
  nlohmann::json end() const;

 private:
  using Clock = std::chrono::steady_clock;  // CLOCK_MONOTONIC, as that of samples and notes
  struct Counted {
    std::unique_ptr<background::Link> link;
    background::Link::Counts before;
    std::optional<Clock::time_point> to_be_cut;
    std::chrono::milliseconds length{0};
    bool by_ip = true;  // else what is beside the traffic cannot be told
  };
  journal::Journal& journal_;
  std::map<std::string, Counted> links_;  // by host
};

// What was counted between two moments. Throws background::Error if the counters were set back.
nlohmann::json account_of(const background::Link::Counts& before, const background::Link::Counts& now);

}  // namespace ontime::keeper
