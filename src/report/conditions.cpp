// SPDX-License-Identifier: Apache-2.0
#include "report/conditions.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <tuple>

#include <fmt/format.h>

#include "conditions/conditions.hpp"
#include "gate/gate.hpp"
#include "report/phrases.hpp"
#include "report/words.hpp"

namespace ontime::report {
namespace {

using nlohmann::json;

const Phrase* find(const std::vector<Phrase>& phrases, const std::string& key) {
  const auto found = std::ranges::find(phrases, key, &Phrase::key);
  return found == phrases.end() ? nullptr : &*found;
}

// Whether a run may have had a condition that its record lacks: it failed before it could report it.
bool may_have(const Summary& summary, const std::string& key) {
  const bool by_facts = std::ranges::any_of(told_by_facts, [&](const char* name) {
    return key == fmt::format("options.{}", name) || key == fmt::format("component.options.{}", name);
  });
  return by_facts && summary.run.outcome.hosts.empty();
}

// Whether both are of the same part of a scenario: "background.where" and "background.rate".
bool is_beside(std::string_view key, std::string_view other) {
  return key.substr(0, key.find('.')) == other.substr(0, other.find('.'));
}

// What all runs of a group share, in words, and for each run what not all share.
struct Compared {
  std::vector<Phrase> shared;
  std::vector<std::vector<Phrase>> own, all;
};

Compared compare(const Group& group, const std::string& against = "") {
  Compared result;
  // One that is not the period is told of all: "-" beside "10 ms" would read as none.
  const bool any_deadline =
      !std::ranges::all_of(group, [](const auto* summary) { return is_deadline_the_period(*summary); });
  for (const auto* summary : group) result.all.push_back(phrases_of(*summary, any_deadline));
  result.own = result.all;
  std::set<std::string> compared;
  for (const auto& phrases : result.own) {
    for (const auto& phrase : phrases) {
      if (!compared.insert(phrase.key).second) continue;
      bool common = true;
      for (std::size_t i = 0; i < group.size() && common; ++i) {
        const auto* other = find(result.own[i], phrase.key);
        common = other != nullptr
                     ? other->text == phrase.text
                     : may_have(*group[i], phrase.key) ||
                           (is_beside(phrase.key, against) && find(result.own[i], against) == nullptr);
      }
      if (common) result.shared.push_back(phrase);
    }
  }
  for (auto& phrases : result.own)
    std::erase_if(phrases, [&](const auto& phrase) {
      return phrase.key == against || find(result.shared, phrase.key) != nullptr;
    });
  return result;
}

// The values that a scenario's lists gave this run: {{"payload", "32 KiB"}, {"realtime.priority", "50"}}.
// Earlier records have them as one text: there a part begins a new pair if it starts with a key, since a
// value may contain commas.
std::vector<std::pair<std::string, std::string>> varied(const Summary& summary) {
  const auto& run = summary.run.asked;
  if (!run.varied.empty() || run.variant.empty()) return run.varied;
  const auto is_key = [](const std::string& stated) {
    const auto word = conditions::current_key(stated);
    return word.starts_with("options.") || word.starts_with("component.options.") || word == "component" ||
           std::ranges::any_of(conditions::keys(), [&](const auto& key) {
             return key.path == word || word.ends_with("." + key.path);
           });
  };
  std::vector<std::pair<std::string, std::string>> varied;
  for (const auto& part : split(replace_all(run.variant, ", ", "\n"), '\n')) {
    const auto end = std::min(part.find(' '), part.size());
    if (varied.empty() || is_key(part.substr(0, end)))
      varied.emplace_back(conditions::current_key(part.substr(0, end)),
                          end < part.size() ? part.substr(end + 1) : "");
    else
      varied.back().second += ", " + part;
  }
  return varied;
}

// Whether the key is an option of the component that has the controller's value, which one phrase shows.
bool is_option_of_both(const std::string& key, const Summary& summary) {
  constexpr std::string_view group = "component.options.";
  if (!key.starts_with(group)) return false;
  const auto [controller, component] = options_of(summary);
  const auto name = key.substr(group.size());
  const auto here = controller.find(name), there = component.find(name);
  return here != controller.end() && there != component.end() && here->second == there->second;
}

// Adds the varied values that no phrase shows yet: "qos.depth" is already in the phrase "qos". The transport
// begins the label.
void add_variant(std::vector<std::string>& parts, const Summary& summary, const std::vector<Phrase>& phrases,
                 const std::string& against) {
  constexpr std::string_view groups[] = {"qos",        "load",   "traffic",  "link",
                                         "background", "kernel", "isolation"};
  for (const auto& [key, value] : varied(summary)) {
    const bool told = conditions::current_key(key) == against || key == "component.transport" ||
                      is_option_of_both(key, summary) ||
                      std::ranges::any_of(phrases, [&, &key = key](const Phrase& phrase) {
                        const bool is_group = std::ranges::find(groups, phrase.key) != std::end(groups);
                        return key == phrase.key || (is_group && key.starts_with(phrase.key + "."));
                      });
    if (!told) parts.push_back(shortened(printable(fmt::format("{} {}", key, value)), longest_value));
  }
}

// Runs with different keys are not repetitions, even if this ontime has no words for the difference: their
// labels get the number of the first run with that key. At different places, keys differ anyway.
void tell_conditions_apart(std::vector<std::string>& labels, const Group& group,
                           const std::vector<std::string>& places) {
  using Firsts = std::map<std::string, std::int64_t>;  // by key
  std::map<std::tuple<std::string, std::string, std::string>, Firsts> by_label;
  std::vector<const Firsts*> of_run;
  for (std::size_t i = 0; i < group.size(); ++i) {
    const auto& run = group[i]->run;
    auto& firsts = by_label[{run.asked.id, labels[i], places[i]}];
    firsts.try_emplace(run.key, run.number);
    of_run.push_back(&firsts);
  }
  for (std::size_t i = 0; i < group.size(); ++i)
    if (of_run[i]->size() > 1) labels[i] += fmt::format(" run {}", of_run[i]->at(group[i]->run.key));
}

}  // namespace

Group all_of(const Summaries& summaries) {
  Group all;
  for (const auto& summary : summaries) all.push_back(&summary);
  return all;
}

Group last_of(const Summaries& summaries) {
  auto last = all_of(summaries);
  std::erase_if(last, [&](const auto* run) { return gate::is_superseded(*run, summaries); });
  return last;
}

std::vector<Group> by_id(const Summaries& summaries) {
  std::vector<Group> groups;
  std::map<std::string, std::size_t> places;
  for (const auto& summary : summaries) {
    const auto [place, is_new] = places.try_emplace(word(summary.run.asked.id), groups.size());
    if (is_new) groups.emplace_back();
    groups[place->second].push_back(&summary);
  }
  return groups;
}

std::string quantity_of(const Group& group) {
  const std::string first = quantity_of(group.front()->run.asked);
  const bool same = std::ranges::all_of(
      group, [&](const auto* summary) { return quantity_of(summary->run.asked) == first; });
  return same ? first : "Time";
}

bool all_listened(const Group& group) {
  return std::ranges::all_of(group, [](const auto* summary) { return summary->run.asked.is_listened(); });
}

std::string words_of(const conditions::Field& field, const json& value) {
  using Unit = conditions::Field::Unit;
  if (value.is_null()) return nothing;
  const auto number = value.is_number() ? value.get<double>() : 0;
  const auto time = [&](double ns_each) {
    return std::abs(number * ns_each) < 9e18
               ? duration(std::chrono::nanoseconds(std::llround(number * ns_each)))
               : nothing;
  };
  return value.is_boolean()                               ? value.get<bool>() ? "on" : "off"
         : field.unit == Unit::none || !value.is_number() ? word(value)
         : field.unit == Unit::us                         ? time(1e3)
         : field.unit == Unit::s                          ? time(1e9)
         : field.unit == Unit::share                      ? conditions::text_of_share(number)
         : field.unit == Unit::bit_s                      ? megabits(number) + " Mbit/s"
         : field.unit == Unit::hz                         ? fmt::format("{:g} Hz", number)
         : value.is_number_integer() && number >= 0       ? size(value.get<std::uint64_t>())
                                                          : nothing;
}

std::string words_of_group(const std::string& key, const json& value) {
  Summary alone;
  // The hosts are known: no load is then "no load".
  json asked = {{"hosts", ""}};
  asked[conditions::places_of(key).front()] = value;
  alone.run.asked = asked;
  std::vector<std::string> texts;
  for (const auto& [of, text, in_labels_alone] : phrases_of(alone))
    if (of == key || of.starts_with(key + ".")) texts.push_back(text);
  const auto words = join(texts, ", ");
  if (words == "no " + key) return "none";
  return words.starts_with(key + ": ") ? words.substr(key.size() + 2) : words;
}

std::string workers(const conditions::Workers& load) {
  std::vector<std::string> parts;
  const auto add = [&](int number, const char* kind, std::uint64_t bytes) {
    if (number > 0)
      parts.push_back(fmt::format("{} {}{}", number, kind, bytes > 0 ? " of " + size(bytes) : ""));
  };
  add(load.cpu, "cpu", 0);
  add(load.vm, "vm", load.vm_bytes);
  add(load.io, "io", 0);
  add(load.hdd, "hdd", load.hdd_bytes);
  return join(parts, ", ");
}

std::vector<std::string> labels_without_repetition(const Group& group, std::string_view separator,
                                                   const std::string& against) {
  const auto compared = compare(group, against);
  std::vector<std::string> labels, places;
  for (std::size_t i = 0; i < group.size(); ++i) {
    const auto& asked = group[i]->run.asked;
    const auto transport = asked.is_listened() ? "" : word(asked.task.transport) + " ";
    std::vector<std::string> parts;
    for (const auto& phrase : compared.own[i])  // "xdp native copy" of xdp is told once
      parts.push_back(phrase.text.substr(phrase.text.starts_with(transport) ? transport.size() : 0));
    add_variant(parts, *group[i], compared.all[i], against);
    const auto* place = find(compared.all[i], against);
    places.push_back(place == nullptr ? "" : place->text);
    auto& label = labels.emplace_back(transport + join(parts, separator));
    if (label.ends_with(' ')) label.pop_back();
  }
  tell_conditions_apart(labels, group, places);
  return labels;
}

std::vector<std::pair<std::string, Group>> alike(const Group& group) {
  const auto labels = labels_without_repetition(group);
  std::vector<std::pair<std::string, Group>> all;
  for (std::size_t i = 0; i < group.size(); ++i) entry_of(all, labels[i]).push_back(group[i]);
  return all;
}

std::vector<std::string> labels_of(const Group& group, std::string_view separator) {
  auto labels = labels_without_repetition(group, separator);
  if (std::ranges::none_of(group, [](const auto* summary) { return summary->run.asked.repetition > 1; }))
    return labels;
  for (std::size_t i = 0; i < group.size(); ++i)
    labels[i] += fmt::format(" #{}", group[i]->run.asked.repetition);
  return labels;
}

void tell_apart(std::vector<std::string>& labels, const Group& group) {
  std::map<std::string, int> uses;
  for (const auto& text : labels) ++uses[text];
  for (std::size_t i = 0; i < labels.size(); ++i)
    if (uses[labels[i]] > 1) labels[i] += fmt::format(" run {}", group[i]->run.number);
}

std::vector<std::string> labels_apart(const Group& group) {
  auto labels = labels_of(group);
  tell_apart(labels, group);
  return labels;
}

std::vector<std::string> shared_conditions(const Group& group) {
  const bool have_ended =
      std::ranges::all_of(group, [](const auto* run) { return statistics::is_complete(run->run); });
  std::vector<std::string> texts;
  for (const auto& phrase : compare(group).shared)
    if (!phrase.in_labels_alone)
      texts.push_back(phrase.text + (phrase.key == "duration" && !have_ended ? " requested" : ""));
  return texts;
}

std::string common_duration(const Summaries& summaries, ClientTime time, const std::string& otherwise) {
  const auto first = summaries.front().run.asked.task.client.*time;
  const bool common = std::ranges::all_of(
      summaries, [&](const auto& summary) { return summary.run.asked.task.client.*time == first; });
  return common && first.count() > 0 ? duration(first) : otherwise;
}

std::string limit_of(const Summaries& summaries, const std::string& name, ClientTime time) {
  const auto common = common_duration(summaries, time, "");
  return common.empty() ? name : name + " of " + common;
}

Differences differences_between(const Group& group) {
  Differences differences;
  const auto own = compare(group).own;
  for (const auto& phrases : own)
    for (const auto& phrase : phrases) add_once(differences.keys, phrase.key);
  for (const auto& phrases : own) {
    auto& row = differences.values.emplace_back();
    for (const auto& key : differences.keys) {
      const auto* phrase = find(phrases, key);
      row.push_back(phrase == nullptr ? "" : phrase->text);
    }
  }
  return differences;
}

OptionColumns::OptionColumns(const Summaries& summaries) {
  for (const auto& summary : summaries) {
    const auto [controller, component] = options_of(summary);
    for (const auto& [name, value] : controller) controller_.insert(name);
    if (component == controller) continue;
    for (const auto& [name, value] : component) component_.insert(name);
  }
}

void OptionColumns::add_names(std::vector<std::string>& header) const {
  for (const auto& name : controller_) header.push_back("option." + name);
  for (const auto& name : component_) header.push_back("component_option." + name);
}

void OptionColumns::add_values(std::vector<std::string>& row, const Summary& summary) const {
  auto [controller, component] = options_of(summary);
  for (const auto& name : controller_) row.push_back(controller[name]);
  for (const auto& name : component_) row.push_back(component[name]);
}

}  // namespace ontime::report
