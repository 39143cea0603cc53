// SPDX-License-Identifier: Apache-2.0
// The CPUs of this machine that are reserved for the current run, for all its hosts.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "isolation/isolation.hpp"
#include "keeper/tuned.hpp"

namespace ontime::keeper {

class Isolated {
 public:
  explicit Isolated(journal::Journal& journal) : journal_(journal) {}

  nlohmann::json apply(const nlohmann::json& order);  // the order "isolate", and its answer
  nlohmann::json keep(pid_t);                         // the answer to "keep"
  // The control groups for load and traffic.
  std::vector<std::string> beside() const;
  // By host, with what each thing is at this moment.
  std::map<std::string, std::vector<record::Applied>> now() const;
  std::vector<std::string> take_back();

 private:
  journal::Journal& journal_;
  std::optional<isolation::Isolation> isolation_;
  std::map<std::string, Changed> hosts_;  // by host: changes of its interface's interrupts
};

}  // namespace ontime::keeper
