// SPDX-License-Identifier: Apache-2.0
#include <map>
#include <set>

#include "record/record.hpp"
#include "report/comparison.hpp"
#include "report/words.hpp"

namespace ontime::report {
namespace {

using nlohmann::json;

constexpr std::size_t longest_difference = 60;
// What is another each time.
const std::set<std::string> of_the_moment = {"boot_id", "clock"};

// By name, all values that runs have of it.
using Values = std::map<std::string, std::set<std::string>>;

void add(Values& values, const std::string& name, const json& value) {
  if (value.is_object() && !value.empty()) {
    for (const auto& [key, member] : value.items()) add(values, name + " " + printable(key), member);
  } else if (!value.is_null()) {
    values[name].insert(shortened(word(value), longest_difference));
  }
}

Values values_of(const Comparison::Runs& runs) {
  Values values;
  for (const auto* run : runs) {
    const auto &asked = run->run.asked, &outcome = run->run.outcome;
    const auto conditions = record::conditions_of(asked);
    if (conditions.is_object())
      for (const auto& [name, value] : conditions.items()) add(values, printable(name), value);
    add(values, "ontime", at(asked, "ontime"));
    add(values, "link_unproved", at(outcome, "link_unproved"));
    for (const auto* way : {"to_component", "to_controller"})
      add(values, std::string("traffic ") + way + " short", at(at(at(outcome, "traffic"), way), "short"));
    for (const auto* host : {"controller", "component"}) {
      const auto& facts = at(at(outcome, "hosts"), host);
      const auto& machine = at(facts, "machine");
      if (machine.is_object())
        for (const auto& [key, value] : machine.items())
          if (!of_the_moment.contains(key)) add(values, std::string(host) + " " + printable(key), value);
      for (const auto* key : {"name", "version"})
        add(values, std::string(host) + " transport " + key, at(at(facts, "transport"), key));
      add(values, std::string(host) + " load_running", at(facts, "load_running"));
      for (const auto& [index, refusal] : at(facts, "refusals").items())
        add(values, std::string(host) + " refused " + word(at(refusal, "asked")), at(refusal, "found"));
    }
  }
  return values;
}

std::string one_of(const Values& values, const std::string& name) {
  const auto found = values.find(name);
  if (found == values.end()) return nothing;
  return join({found->second.begin(), found->second.end()}, " or ");
}

}  // namespace

std::vector<Difference> differences(const Comparison::Runs& from, const Comparison::Runs& to) {
  const auto before = values_of(from), after = values_of(to);
  std::set<std::string> names;
  for (const auto* values : {&before, &after})
    for (const auto& [name, all] : *values) names.insert(name);
  std::vector<Difference> found;
  for (const auto& name : names)
    if (const auto one = one_of(before, name), other = one_of(after, name); one != other)
      found.push_back({name, one, other});
  return found;
}

}  // namespace ontime::report
