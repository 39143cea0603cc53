// SPDX-License-Identifier: Apache-2.0
#include "keeper/links.hpp"

#include <algorithm>

#include "keeper/keeper.hpp"

namespace ontime::keeper {

using nlohmann::json;

void Links::add(const json& order) {
  const std::string host = order.at("host");
  links_.erase(host);
  links_[host].link = std::make_unique<background::Link>(
      journal_, background::Link::Place{host, order.at("network_namespace"), order.at("interface")},
      faults_of(order.at("faults")), order.at("not_counted").get<std::vector<int>>());
}

void Links::cut(const std::string& host, std::chrono::milliseconds after, std::chrono::milliseconds length) {
  auto& counted = links_.at(host);
  counted.to_be_cut = Clock::now() + after;
  counted.length = length;
}

std::chrono::milliseconds Links::go_on(const Told& told) {
  auto longest = std::chrono::milliseconds::max();
  for (auto& [host, counted] : links_) {
    if (!counted.to_be_cut) continue;
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(*counted.to_be_cut - Clock::now());
    if (left.count() > 0) {
      longest = std::min(longest, left);
      continue;
    }
    counted.to_be_cut.reset();
    counted.link->cut(counted.length);
    told(host, Clock::now().time_since_epoch());
  }
  return longest;
}

void Links::begin() {
  for (auto& [host, counted] : links_) counted.before = counted.link->counts();
}

json Links::end() const {
  auto account = json::object();
  for (const auto& [host, counted] : links_) {
    const auto now = counted.link->counts();
    const auto& before = counted.before;
    account[host] = {{"faults",
                      {{"lost_frames", now.lost - before.lost},
                       {"cut_off_frames", now.cut_off - before.cut_off},
                       {"duplicated_frames", now.duplicated - before.duplicated}}},
                     {"beside_traffic",
                      {{"sent_bytes", now.sent_bytes - before.sent_bytes},
                       {"received_bytes", now.received_bytes - before.received_bytes}}}};
  }
  return account;
}

}  // namespace ontime::keeper
