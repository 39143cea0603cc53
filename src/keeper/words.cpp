// SPDX-License-Identifier: Apache-2.0
// JSON of order parameters. It has the form of the record of a run, so it is converted by way of a Run.
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

}  // namespace ontime::keeper
