// SPDX-License-Identifier: Apache-2.0
#include "keeper/keeper.hpp"

namespace ontime::keeper {

using nlohmann::json;

json to_json(const background::Workers& workers) {
  return {{"cpu", workers.cpu},
          {"vm", workers.vm},
          {"io", workers.io},
          {"hdd", workers.hdd},
          {"vm_bytes", workers.vm_bytes},
          {"hdd_bytes", workers.hdd_bytes}};
}

background::Workers workers_of(const json& from) {
  return {from.at("cpu"), from.at("vm"),       from.at("io"),
          from.at("hdd"), from.at("vm_bytes"), from.at("hdd_bytes")};
}

}  // namespace ontime::keeper
