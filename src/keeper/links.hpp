// SPDX-License-Identifier: Apache-2.0
// The links of this machine's ends that have faults or are counted, and the account of them.
#pragma once

#include <chrono>
#include <map>
#include <memory>
#include <string>

#include <nlohmann/json.hpp>

#include "background/background.hpp"

namespace ontime::keeper {

class Links {
 public:
  explicit Links(journal::Journal& journal) : journal_(journal) {}

  void add(const nlohmann::json& order);  // "link"
  void clear() { links_.clear(); }
  void cut(const std::string& host, std::chrono::milliseconds) const;
  void begin();  // the account is opened
  // By host {faults {lost_frames, cut_off_frames, duplicated_frames}, beside_traffic {sent_bytes,
  // received_bytes}}.
  nlohmann::json end() const;

 private:
  struct Counted {
    std::unique_ptr<background::Link> link;
    background::Link::Counts before;
  };
  journal::Journal& journal_;
  std::map<std::string, Counted> links_;  // by host
};

}  // namespace ontime::keeper
