// SPDX-License-Identifier: Apache-2.0
// Text to paste that keeps the settings found. Ordinary thread; changes nothing.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "conditions/conditions.hpp"
#include "search/search.hpp"
#include "settings/settings.hpp"

namespace ontime::search {

// A systemd unit that applies kernel settings at every boot.
struct Unit {
  std::string host;     // machine: "controller"; "": each
  std::string command;  // that prints it
  std::string text;     // a unit of systemd
  std::string why_not;  // why there is no text, for people
};
struct Kept {
  std::string run;       // its id: `scenario` belongs into this run, because its own keys override defaults
  std::string scenario;  // keys of that run, in YAML; "": nothing is to be kept
  std::vector<Unit> units;  // empty: no setting is the kernel's
  std::string fill_in;      // what the user must replace in the units; "": nothing
  std::string left_out;     // what no unit sets, though the goal was proven with it, and the fix; "": nothing
};
// The units also set what the run itself asks of the kernel: the goal was proven with it, and napi-threads
// cannot be set without its threaded-napi.
struct Place {
  settings::Link link;  // where its messages come and go at boot; an interface "" is not known
  std::string program;  // its ontime, which the unit starts; "": it is there only for the search
  bool is_here = true;  // else on another machine
};
using Places = std::map<std::string, Place>;  // by host, or "": each; never empty
Kept keep(const conditions::Run&, const Set&, Places);

}  // namespace ontime::search
