// SPDX-License-Identifier: Apache-2.0
// The settings of this machine for the current run, by host.
#pragma once

#include <map>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "record/outcome.hpp"
#include "settings/settings.hpp"

namespace ontime::keeper {

// The link of an order's {interface, network_namespace, peer, address}: the interface, else the interface on
// the route to the peer, else the interface with the address.
settings::Link link_of(const nlohmann::json&);
std::vector<record::Applied> applied(const std::vector<settings::Change>&, const settings::Link&);
// All settings that can be read there, in the words of `ontime tune show`. It does not matter who made them.
record::ByName<std::string> present(const nlohmann::json& link);
// The order "look", and its answer.
nlohmann::json look(const nlohmann::json& order);

struct Changed {
  settings::Link link;
  std::vector<settings::Change> changes;
};

class Tuned {
 public:
  explicit Tuned(journal::Journal& journal) : journal_(journal) {}

  // The order "tune", and its answer.
  nlohmann::json apply(const nlohmann::json& order);
  // By host, with the present value of each setting.
  std::map<std::string, std::vector<record::Applied>> now() const;
  std::vector<std::string> take_back();

 private:
  journal::Journal& journal_;
  std::map<std::string, Changed> hosts_;
};

}  // namespace ontime::keeper
