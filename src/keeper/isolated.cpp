// SPDX-License-Identifier: Apache-2.0
#include "keeper/isolated.hpp"

#include <algorithm>
#include <iterator>
#include <utility>

#include <fmt/format.h>

#include "keeper/keeper.hpp"
#include "machine/machine.hpp"

namespace ontime::keeper {

using nlohmann::json;

json Isolated::apply(const json& order) {
  try {
    const auto wish = wish_of(order.at("wish"));
    if (isolation_ && isolation_->wish() != wish) take_back();  // of a run whose end was not told
    std::string stay;                                           // told once of a machine
    if (!isolation_) stay = isolation_.emplace(journal_, wish).stay();
    Changed host;
    if (wish.interrupts) {
      host.link = link_of(order.at("link"));
      host.changes = settings::apply(journal_, settings::away_to(isolation_->rest(), host.link), host.link);
    }
    hosts_[order.at("host")] = std::move(host);
    return {{"stay", stay}};
  } catch (const machine::Error& error) {
    return {{"error", fmt::format("isolation: {}", error.what())}};
  } catch (const settings::Error& error) {
    return {{"error", fmt::format("isolation.interrupts: {}", error.what())}};
  } catch (const journal::Error& error) {
    return {{"error", fmt::format("isolation: {}", error.what())}};
  }
}

json Isolated::keep(pid_t process) {
  try {
    if (isolation_) isolation_->keep(process);
    return json::object();
  } catch (const journal::Error& error) {
    return {{"error", fmt::format("isolation.cpus: {}", error.what())}};
  }
}

std::vector<std::string> Isolated::beside() const {
  return isolation_ ? isolation_->beside() : std::vector<std::string>{};
}

std::map<std::string, std::vector<record::Applied>> Isolated::now() const {
  std::map<std::string, std::vector<record::Applied>> all;
  for (const auto& [host, its] : hosts_) {
    auto& things = all[host] = applied(its.changes, its.link);
    for (const auto& one : isolation_->state())
      things.push_back({one.setting, one.thing, one.before, one.after, one.now});
  }
  return all;
}

std::vector<std::string> Isolated::take_back() {
  std::vector<std::string> left;
  for (const auto& [host, its] : std::exchange(hosts_, {}))
    std::ranges::move(settings::take_back(journal_, its.changes), std::back_inserter(left));
  if (isolation_) std::ranges::move(isolation_->take_back(), std::back_inserter(left));
  isolation_.reset();
  return left;
}

}  // namespace ontime::keeper
