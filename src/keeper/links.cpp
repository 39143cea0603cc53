// SPDX-License-Identifier: Apache-2.0
#include "keeper/links.hpp"

#include <algorithm>
#include <iterator>
#include <utility>

#include "keeper/keeper.hpp"

namespace ontime::keeper {

using nlohmann::json;

void Links::add(const json& order) {
  const std::string host = order.at("host");
  links_.erase(host);
  auto link = std::make_unique<background::Link>(
      journal_, background::Link::Place{host, order.at("network_namespace"), order.at("interface")},
      faults_of(order.at("faults")), order.at("traffic_ports").get<std::vector<int>>());
  auto& counted = links_[host];  // only after the link exists: an error leaves no entry
  counted.link = std::move(link);
  counted.by_ip = order.at("by_ip");
}

std::vector<std::string> Links::clear() {
  std::vector<std::string> left;
  for (const auto& [host, counted] : std::exchange(links_, {}))
    std::ranges::move(counted.link->take_back(), std::back_inserter(left));
  return left;
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
    record::Link link;
    try {
      link = account_of(counted.before, counted.link->counts());
      if (!counted.by_ip) link.beside_traffic.reset();
    } catch (const background::Error& error) {
      link.gone = error.what();
    }
    account[host] = record::to_json(link);
  }
  return account;
}

record::Link account_of(const background::Link::Counts& before, const background::Link::Counts& now) {
  const auto since = [](std::uint64_t then, std::uint64_t count) {
    if (count < then) throw background::Error("the link's counters were reset");
    return count - then;
  };
  record::Link link;
  link.faults = {since(before.lost, now.lost), since(before.cut_off, now.cut_off),
                 since(before.duplicated, now.duplicated)};
  link.beside_traffic = {since(before.sent_bytes, now.sent_bytes),
                         since(before.received_bytes, now.received_bytes)};
  if (before.etf && now.etf)
    link.etf = {since(before.etf->launched, now.etf->launched), since(before.etf->dropped, now.etf->dropped)};
  return link;
}

}  // namespace ontime::keeper
