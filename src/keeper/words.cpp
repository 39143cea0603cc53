// SPDX-License-Identifier: Apache-2.0
// JSON of order parameters. It has the form of the record of a run, so it is converted by way of a Run.
#include "background/background.hpp"
#include "keeper/keeper.hpp"

namespace ontime::keeper {

using conditions::Run, conditions::run_of;
using nlohmann::json;

json to_json(const conditions::Workers& workers) {
  Run run;
  run.controller_load = workers;
  return conditions::to_json(run)["load"]["controller"];
}
conditions::Workers workers_of(const json& from) {
  return run_of({{"load", {{"controller", from}}}}).controller_load;
}

json to_json(const conditions::Isolation& wish) {
  Run run;
  run.isolation = wish;
  return conditions::to_json(run)["isolation"];
}
conditions::Isolation wish_of(const json& from) { return run_of({{"isolation", from}}).isolation; }

json to_json(const conditions::Faults& faults) {
  Run run;
  run.faults = faults;
  return conditions::to_json(run)["link"];
}
conditions::Faults faults_of(const json& from) { return run_of({{"link", from}}).faults; }

json to_json(const background::Stream& stream) {
  return {{"place", stream.place},         {"serves", stream.serves},
          {"receives", stream.receives},   {"address", stream.address},
          {"interface", stream.interface}, {"port", stream.port},
          {"bit_s", stream.bits_per_s},    {"datagram_bytes", stream.datagram_bytes},
          {"priority", stream.priority}};
}

background::Stream stream_of(const json& from) {
  return {.place = from.at("place"),
          .serves = from.at("serves"),
          .receives = from.at("receives"),
          .address = from.at("address"),
          .interface = from.at("interface"),
          .port = from.at("port"),
          .bits_per_s = from.at("bit_s"),
          .datagram_bytes = from.at("datagram_bytes"),
          .priority = from.at("priority"),
          .groups = {}};
}

}  // namespace ontime::keeper
