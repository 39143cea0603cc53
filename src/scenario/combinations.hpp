// SPDX-License-Identifier: Apache-2.0
// Lists multiply: every combination of their choices is a run.
#pragma once

#include <map>
#include <set>
#include <string>
#include <vector>

#include "conditions/conditions.hpp"
#include "scenario/run_keys.hpp"
#include "scenario/scenario.hpp"

namespace ontime::scenario {

// Gates of a run, by component; "": of all.
using Required = std::map<std::string, std::vector<std::string>>;

// Of one scenario; what it is made of outlives it. Throws Error: file, line, column, message.
class Combinations {
 public:
  Combinations(const std::string& file, const Hosts& hosts, const RunKeys& keys, const Selection& selection)
      : file_(file), hosts_(hosts), keys_(keys), selection_(selection) {}

  // The runs of those entries, which stand at `run`.
  std::vector<Run> of(const std::string& id, const YAML::Node& run, const Required&, Entries);

 private:
  // One choice of a key that has several, and where it stands.
  struct Choice {
    std::string value;
    YAML::Node node;
  };
  struct Dimension {
    std::string path;
    const conditions::Key* key;  // nothing: a transport's option
    std::vector<Choice> choices;
    Said said;
  };
  using Dimensions = std::vector<Dimension>;

  [[noreturn]] void fail(const YAML::Node&, const std::string& message) const;
  std::vector<Choice> choices_of(const std::string& path, const YAML::Node&) const;
  void add_selected(Entries&, const YAML::Node& run) const;
  Dimensions dimensions_of(const Entries&) const;
  std::set<std::string> owners_of(const Dimensions&, const Required&) const;
  void bound(const std::string& id, const YAML::Node& run, const Required&, const Dimensions&,
             std::size_t owners);
  void hold(const std::string& id, const YAML::Node& run, std::size_t bytes);
  bool search_last(Dimensions&) const;
  Run make_runs(const std::string& id, const YAML::Node& run, const Dimensions&,
                const std::vector<std::size_t>& at, const std::set<std::string>& owners) const;
  Run make_run(const std::string& id, const YAML::Node& run, const Dimensions&,
               const std::vector<std::size_t>& at, const std::string& component) const;
  static bool is_said_anew(const Dimensions&, const std::string& key, const std::string& component);
  static void make_step(Run::Step&, const std::vector<Choice>&, std::size_t number);
  void set(Run&, const Dimension&, const Choice&) const;

  const std::string& file_;
  const Hosts& hosts_;
  const RunKeys& keys_;
  const Selection& selection_;
  std::size_t different_ = 0, held_ = 0;
};

}  // namespace ontime::scenario
