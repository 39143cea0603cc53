// SPDX-License-Identifier: Apache-2.0
// The keys of a run as a file states them, before they have a meaning.
#pragma once

#include <map>
#include <string>
#include <vector>

#include <yaml-cpp/yaml.h>

#include "scenario/scenario.hpp"

namespace ontime::scenario {

// A run as written, flat: path ("qos.depth") → value.
using Entries = std::map<std::string, YAML::Node>;

// A key for one component ("arm.period"), or for all.
struct Said {
  std::string component;  // "": all
  std::string key;
};

// The keys of a scenario file outside its runs.
inline const std::vector<std::string> file_keys = {"title",    "hosts", "wire",   "components",
                                                   "defaults", "order", "repeat", "runs"};

bool is_key(const std::string& path);
// As meant_of(), for a run's key: among the keys of the same group.
std::string meant_of(const std::string& path);
// As meant_of(), for a key outside the runs.
std::string meant_in_file(const std::string& key);

// Keys of one scenario, whose hosts must outlive this. Throws Error: file, line, column, message.
class RunKeys {
 public:
  // `named`: the scenario names its components, and keys below a name apply to that component.
  RunKeys(const std::string& file, const Hosts& hosts, bool named, Notices& notices)
      : file_(file), hosts_(hosts), named_(named), notices_(notices) {}
  Said divided(const std::string& path) const;
  // With the current name of the key: "arm.background.rate" for the earlier "arm.neighbours.rate".
  std::string current(const std::string& path) const;
  Entries flat(const YAML::Node& run) const;

 private:
  // A component's name may be mistyped as well.
  std::string meant_of(const std::string& path, const std::string& key) const;
  // `unknown`: the first name on the way here that no key has; null: none.
  void flatten(const YAML::Node&, const std::string& prefix, Entries&, const YAML::Node* unknown) const;
  void check_empty(const YAML::Node& name, const YAML::Node& map, const std::string& path) const;

  const std::string& file_;
  const Hosts& hosts_;
  const bool named_;
  Notices& notices_;
};

}  // namespace ontime::scenario
