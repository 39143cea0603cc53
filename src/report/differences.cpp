// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <map>
#include <set>
#include <tuple>

#include <fmt/format.h>

#include "record/record.hpp"
#include "report/comparison.hpp"
#include "report/conditions.hpp"
#include "report/words.hpp"

namespace ontime::report {
namespace {

using nlohmann::json;

constexpr std::size_t longest_difference = 60;
constexpr const char* realtime_settings = "realtime_settings";
// Before the name of a setting, as its machine had it.
constexpr std::string_view present_setting = "kernel.";
// irqbalance changes it all the time.
constexpr std::string_view of_balancing = "irq-cpus";
// Differs in every run.
const std::set<std::string> of_the_moment = {"boot_id", "clock"};

// A fact of a host, or of the run.
struct Fact {
  std::string host, name;
  bool operator<(const Fact& other) const { return std::tie(host, name) < std::tie(other.host, other.name); }
};
// All values that runs have of it.
using Values = std::map<Fact, std::set<std::string>>;

void add(Values& values, const Fact& fact, const json& value) {
  if (value.is_object() && !value.empty()) {
    for (const auto& [key, member] : value.items())
      add(values, {fact.host, fact.name + " " + printable(key)}, member);
  } else if (!value.is_null()) {
    values[fact].insert(word(value));
  }
}

// As long as there is space for; what differs stays in sight.
template <class... Sets>
void shorten(Sets&... all) {
  std::vector<std::vector<std::string>> rows;
  for (const auto* values : {&all...})
    for (const auto& value : *values) rows.push_back({value});
  shorten_names(rows, 0, longest_difference);
  auto row = rows.begin();
  for (auto* values : {&all...}) {
    std::set<std::string> shorter;
    for (auto left = values->size(); left > 0; --left) shorter.insert((row++)->front());
    *values = std::move(shorter);
  }
}

// The real-time settings of these runs that `realtime: on`, or off, does not have of itself.
std::set<Fact> own_settings_of(const Comparison::Runs& runs) {
  std::set<Fact> own;
  for (const auto* run : runs) {
    const auto asked = record::conditions_of(run->run.asked.document);
    Values values, follow;
    add(values, {"", realtime_settings}, record::at(asked, realtime_settings));
    add(follow, {"", realtime_settings}, record::at(following(asked, "realtime"), realtime_settings));
    for (const auto& [fact, value] : values)
      if (follow[fact] != value) own.insert(fact);
  }
  return own;
}

Values values_of(const Comparison::Runs& runs) {
  Values values;
  for (const auto* run : runs) {
    const auto& asked = run->run.asked;
    const auto& outcome = run->run.outcome;
    const auto conditions = record::conditions_of(asked.document);
    if (conditions.is_object())
      for (const auto& [name, value] : conditions.items()) add(values, {"", printable(name)}, value);
    const auto add_text = [&](const Fact& fact, const std::string& text) {
      if (!text.empty()) add(values, fact, text);
    };
    add_text({"", "ontime"}, asked.ontime);
    add_text({"", "link_unproved"}, outcome.link_unproved.value_or(""));
    for (const auto& [way, rates] : outcome.traffic)
      if (rates.is_short) add(values, {"", "traffic " + way + " short"}, *rates.is_short);
    for (const auto* of : record::both_hosts) {
      const auto& host = record::find(outcome.hosts, of);
      if (host.machine.document.is_object())
        for (const auto& [key, value] : host.machine.document.items())
          if (!of_the_moment.contains(key)) add(values, {of, printable(key)}, value);
      for (const auto& [name, value] : host.settings)
        add_text({of, fmt::format("{}{}", present_setting, printable(name))}, value);
      add_text({of, "transport name"}, host.transport.name);
      add_text({of, "transport version"}, host.transport.version);
      if (const auto found = host.transport.facts.find("configuration"); found != host.transport.facts.end())
        add_text({of, "configuration"}, found->second);
      if (host.load_running == false)
        add(values, {of, "load_running"}, false);  // else it follows from the load
      for (const auto& refusal : host.refusals)
        add_text({of, "refused " + word(refusal.asked)}, refusal.found);
    }
  }
  return values;
}

bool is_present_setting(const Fact& fact) {
  return !fact.host.empty() && fact.name.starts_with(present_setting) && !fact.name.ends_with(of_balancing);
}

// In the words of a key, where one is given.
std::string one_of(const std::set<std::string>& values, const conditions::Key* key = nullptr) {
  if (values.empty()) return nothing;
  const auto words = [&](const auto& value) {
    return key == nullptr ? value : words_of_value(key->path, value);
  };
  return join(texts_of(values, words), " or ");
}

// The record's words for background topics.
std::string in_words(const std::string& name) {
  constexpr std::string_view group = "neighbours";
  return name.starts_with(group) ? "background topics" + name.substr(group.size()) : name;
}

// "period: 10 ms → 20 ms", by the key that a record stores there.
std::string text_of(const Fact& fact, const std::set<std::string>& before,
                    const std::set<std::string>& after) {
  const auto& keys = conditions::keys();
  const auto found = fact.host.empty()
                         ? std::ranges::find(keys, replace_all(fact.name, " ", "."), &conditions::Key::json)
                         : keys.end();
  const auto* const key = found == keys.end() ? nullptr : &*found;
  const auto from = one_of(before, key), to = one_of(after, key);
  // Rounded to the digits of a key they may read the same.
  if (key == nullptr || from == to)
    return fmt::format("{}: {} → {}", in_words(fact.name), one_of(before), one_of(after));
  return fmt::format("{}: {} → {}", key->path, from, to);
}

std::size_t rank_of(const Difference& difference) {
  constexpr std::string_view of_hosts[] = {"refused",    "load_running", "hostname",      "kernel_release",
                                           "preemption", "cpu_model",    "cpu_count",     "transport",
                                           "ontime",     "governor",     "isolated_cpus", "clocksource"};
  constexpr std::string_view last = "kernel_command_line";  // the longest
  if (is_requested(difference)) return 0;
  const auto* const found = std::ranges::find(of_hosts, difference.what.substr(0, difference.what.find(' ')));
  return 1 + static_cast<std::size_t>(found - std::begin(of_hosts)) + (difference.what == last ? 1 : 0);
}

}  // namespace

std::vector<Difference> differences(const Comparison::Pair& pair) {
  const auto from = whole(pair.from), to = whole(pair.to);
  if (from.empty() || to.empty()) return {};
  auto before = values_of(from), after = values_of(to);
  auto own = own_settings_of(from);
  own.merge(own_settings_of(to));
  std::set<Fact> facts;
  for (const auto* values : {&before, &after})
    for (const auto& [fact, all] : *values)
      if (!fact.name.starts_with(realtime_settings) || own.contains(fact)) facts.insert(fact);
  std::vector<Difference> found;
  for (const auto& fact : facts) {
    auto &one = before[fact], &other = after[fact];
    if (one == other) continue;
    if (!fact.host.empty() && fact.name.starts_with(present_setting)) {
      // An older record, or an interface without it.
      if (one.empty() || other.empty() || !is_present_setting(fact)) continue;
      const Fact asked{"", "kernel " + fact.name.substr(present_setting.size())};
      if (before[asked] != after[asked]) continue;  // told as requested
    }
    shorten(one, other);
    found.push_back({fact.host, fact.name, one_of(one), one_of(other), text_of(fact, one, other)});
  }
  return found;
}

bool is_requested(const Difference& difference) {
  return difference.host.empty() && difference.what != "ontime";
}

std::vector<Difference> by_importance(const std::vector<Difference>& differences) {
  std::vector<Difference> all;
  for (const auto& difference : differences) {
    const bool is_of_both =
        !difference.host.empty() && std::ranges::any_of(differences, [&](const Difference& other) {
          return !other.host.empty() && other.host != difference.host && other.what == difference.what &&
                 other.from == difference.from && other.to == difference.to;
        });
    if (is_of_both && difference.host != record::both_hosts[0]) continue;
    all.push_back(difference);
    if (is_of_both) all.back().host = Difference::both;
  }
  std::ranges::stable_sort(all, {}, rank_of);
  return all;
}

std::vector<std::string> mixed(const Comparison::Runs& runs) {
  constexpr std::size_t most_named = 3;
  constexpr std::pair<const char*, const char*> of_a_host[] = {{"hostname", "machines"},
                                                               {"cpu_model", "CPU models"},
                                                               {"kernel_release", "kernels"},
                                                               {"transport version", "transport versions"},
                                                               {"configuration", "configurations"}};
  if (runs.size() < 2) return {};
  auto values = values_of(runs);
  std::vector<std::string> several;
  const auto is_kernel = [](const std::string& one) { return one.starts_with("Linux "); };
  const auto add = [&](std::set<std::string> all, const std::string& what) {
    if (all.size() < 2 || std::ranges::all_of(all, is_kernel)) return;  // a transport's version: told already
    shorten(all);
    std::vector<std::string> named(all.begin(), all.end());
    if (named.size() > most_named) named.resize(most_named);
    several.push_back(fmt::format("{} {}: {}{}", all.size(), what, join(named, " and "),
                                  all.size() > most_named ? " …" : ""));
  };
  for (const auto& [fact, what] : of_a_host) {
    const auto &controller = values[{"controller", fact}], &component = values[{"component", fact}];
    const bool is_of_both = controller == component;
    add(controller, fmt::format("{}{}", what, is_of_both ? "" : " of the controller"));
    if (!is_of_both) add(component, fmt::format("{} of the component", what));
  }
  const std::map<Fact, std::set<std::string>> facts = values;
  for (const auto& [fact, all] : facts) {
    if (!is_present_setting(fact)) continue;
    const auto* const at_other =
        fact.host == record::both_hosts[0] ? record::both_hosts[1] : record::both_hosts[0];
    const auto other = facts.find({at_other, fact.name});
    const bool is_of_both = other != facts.end() && other->second == all;
    if (!is_of_both)
      add(all, fmt::format("values of {} of the {}", fact.name, fact.host));
    else if (fact.host == record::both_hosts[0])
      add(all, fmt::format("values of {}", fact.name));
  }
  add(values[{"", "ontime"}], "versions of ontime");
  return several;
}

std::vector<std::string> key_differences(const statistics::Summary& from, const statistics::Summary& to) {
  std::vector<std::string> differences, told;
  const auto add = [&](const std::string& key, const std::string& before, const std::string& after) {
    told.push_back(key);
    differences.push_back(fmt::format("{}: {} → {}", key, shortened(word(before), longest_difference),
                                      shortened(word(after), longest_difference)));
  };
  const auto mine = record::conditions_of(from.run.asked.document),
             theirs = record::conditions_of(to.run.asked.document);
  for (const auto& field : conditions::keys()) {
    const auto member = field.json.substr(0, field.json.find('.'));
    if (record::at(mine, member) == record::at(theirs, member)) continue;  // as of a title
    const auto &before = from.run.asked.stated(field.json), &after = to.run.asked.stated(field.json);
    // A record may lack what has its default.
    const bool may_be_same = !from.imported && !to.imported && (before.is_null() || after.is_null());
    if (before == after || (may_be_same && field.to_json(from.run.asked) == field.to_json(to.run.asked)))
      continue;
    const auto from_words = words_of(field, before), to_words = words_of(field, after);
    const bool is_told = from_words != to_words;  // by fewer digits they may be the same
    add(field.path, is_told ? from_words : word(before), is_told ? to_words : word(after));
  }
  // What has words for several keys together: "load", "kernel".
  const auto in_words = differences_between({&from, &to});
  const auto& keys = in_words.keys;
  for (std::size_t i = 0; i < keys.size(); ++i)
    if (std::ranges::none_of(
            conditions::keys(),
            [&](const auto& field) { return field.path == keys[i] && !field.json.empty(); }) &&
        std::ranges::none_of(
            told, [&](const std::string& key) { return key == keys[i] || key.starts_with(keys[i] + "."); }))
      add(keys[i], in_words.values[0][i], in_words.values[1][i]);
  return differences;
}

}  // namespace ontime::report
