// SPDX-License-Identifier: Apache-2.0
#include "keeper/tuned.hpp"

#include <algorithm>
#include <chrono>
#include <iterator>
#include <utility>

#include <fmt/format.h>
#include <unistd.h>

#include "machine/machine.hpp"
#include "realtime/realtime.hpp"

namespace ontime::keeper {
namespace {

using nlohmann::json;

std::string why_not(const settings::Wishes& wishes, const settings::Link& link) {
  try {
    settings::require_writable(settings::plan(wishes, link), link);
  } catch (const settings::Error& error) {
    return error.what();
  }
  return "";
}

// Without an interface no setting of one can be had.
settings::Link link_if_found(const json& from) {
  try {
    return link_of(from);
  } catch (const machine::Error&) {
    return {};
  }
}

}  // namespace

settings::Link link_of(const json& from) {
  settings::Link link{from.at("interface"), from.at("network_namespace")};
  if (!link.interface.empty()) return link;
  if (const std::string peer = from.at("peer"); !peer.empty())
    link.interface = machine::interface_to(peer, link.network_namespace);
  else if (const std::string address = from.at("address"); !address.empty())
    link.interface = machine::interface_of(address, link.network_namespace);
  return link;
}

std::vector<record::Applied> applied(const std::vector<settings::Change>& changes,
                                     const settings::Link& link) {
  std::vector<record::Applied> all;
  for (const auto& change : changes) {
    const auto now = settings::now(change, link);
    all.push_back({std::string(change.setting->name), change.thing.title(), change.before, change.after,
                   now ? json(*now) : json()});
  }
  return all;
}

record::ByName<std::string> present(const json& link) {
  record::ByName<std::string> values;
  try {
    for (const auto& state : settings::show(link_if_found(link)))
      if (!state.things.empty()) values[state.setting->name] = settings::values_that_keep(state);
  } catch (const std::exception&) {  // no interface of that name: a run tells it by itself
  }
  return values;
}

json look(const json& order) {
  const auto link = link_if_found(order.at("link"));
  const realtime::CpuLatencyRequest request(std::chrono::microseconds(0));
  return {{"interface", link.interface},
          {"network_namespace", link.network_namespace},
          {"cannot", why_not(order.at("wishes").get<settings::Wishes>(), link)},
          {"without_effect", settings::without_effect(order.at("wishes"))},
          {"is_root", geteuid() == 0},
          {"cpu_latency", request.refusal() ? request.refusal()->found : ""}};
}

json Tuned::apply(const json& order) {
  try {
    journal_.hold();  // first: while another ontime holds the machine, an error is not about settings
    const auto link = link_of(order.at("link"));
    const settings::Wishes wishes = order.at("wishes");
    hosts_[order.at("host")] = {link, settings::apply(journal_, wishes, link)};
    return {{"note", settings::without_effect(wishes)}};
  } catch (const journal::Error& error) {
    return {{"error", fmt::format("kernel: {}", error.what())}};
  } catch (const machine::Error& error) {
    return {{"error", fmt::format("kernel: {}", error.what())}};
  } catch (const settings::Error& error) {  // which begins with the name of a setting
    const auto text = fmt::format("kernel.{}", error.what());
    return {{"error", text}, {"refused", text.substr(0, text.find(':'))}};
  }
}

std::map<std::string, std::vector<record::Applied>> Tuned::now() const {
  std::map<std::string, std::vector<record::Applied>> all;
  for (const auto& [host, tuned] : hosts_) all[host] = applied(tuned.changes, tuned.link);
  return all;
}

std::vector<std::string> Tuned::take_back() {
  std::vector<std::string> left;
  for (const auto& [host, tuned] : std::exchange(hosts_, {}))
    std::ranges::move(settings::take_back(journal_, tuned.changes), std::back_inserter(left));
  return left;
}

}  // namespace ontime::keeper
