// SPDX-License-Identifier: Apache-2.0
// Misses that wait to be taken: the latest most_misses, and by topic the number of those left out.
#pragma once

#include <algorithm>
#include <cstdint>
#include <deque>
#include <iterator>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "listen/listen.hpp"

namespace ontime::listen {

class Misses {
 public:
  void add(Miss miss) {
    if (waiting_.size() == most_misses) {
      const auto& topic = waiting_.front().topic;
      const bool has_room = left_out_.size() < Findings::most_topics || left_out_.contains(topic);
      ++left_out_[has_room ? topic : Findings::any_topic];
      waiting_.pop_front();
    }
    waiting_.push_back(std::move(miss));
  }
  std::vector<Miss> take() {
    return take([](const Miss&) { return false; });
  }
  // Takes all except those that shall wait.
  template <class Waits>
  std::vector<Miss> take(Waits waits) {
    const auto first_taken = std::stable_partition(waiting_.begin(), waiting_.end(), waits);
    std::vector<Miss> taken(std::make_move_iterator(first_taken), std::make_move_iterator(waiting_.end()));
    waiting_.erase(first_taken, waiting_.end());
    return taken;
  }
  void name(std::uint64_t flow, const std::string& topic) {
    for (auto& miss : waiting_)
      if (miss.flow == flow) miss.topic = topic;
  }
  const std::map<std::string, std::uint64_t>& left_out() const { return left_out_; }

 private:
  std::deque<Miss> waiting_;
  std::map<std::string, std::uint64_t> left_out_;
};

}  // namespace ontime::listen
