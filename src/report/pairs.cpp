// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <functional>
#include <iterator>
#include <map>
#include <utility>

#include <fmt/format.h>

#include "conditions/conditions.hpp"
#include "record/document.hpp"
#include "report/comparison.hpp"
#include "report/conditions.hpp"
#include "report/runs.hpp"
#include "report/words.hpp"

namespace ontime::report {
namespace {

using nlohmann::json;
using Pair = Comparison::Pair;
using Runs = Comparison::Runs;

using KeyOf = std::function<std::string(const statistics::Summary&)>;

// In the order of their first ones.
Comparison pairs_of(const Runs& a, const Runs& b, const KeyOf& key_of) {
  std::vector<std::pair<std::string, Pair>> found;
  for (const auto* run : a) entry_of(found, key_of(*run)).from.push_back(run);
  for (const auto* run : b) entry_of(found, key_of(*run)).to.push_back(run);
  Comparison comparison;
  for (const auto& [key, pair] : found) {
    if (pair.to.empty())
      comparison.only_from.push_back(pair.from);
    else if (pair.from.empty())
      comparison.only_to.push_back(pair.to);
    else
      comparison.pairs.push_back(pair);
  }
  return comparison;
}

std::string value_of(const json& asked, const std::string& key) {
  std::vector<std::string> values;
  for (const auto& place : conditions::places_of(key))
    if (asked.contains(place)) add_once(values, word(asked[place]));
  return values.empty() ? unset : join(values, ", ");
}

// A record repeats the controller's transport and options for a component that has none of its own.
void drop_repeated(json& asked) {
  constexpr std::pair<const char*, const char*> repeated[] = {{"transport", "component_transport"},
                                                              {"options", "component_options"}};
  for (const auto& [name, again] : repeated)
    if (record::at(asked, name) != record::at(asked, again)) return;
  for (const auto& [name, again] : repeated) asked.erase(again);
}

// Where there are several components, topics have the component's name if their transport has topics.
void drop_names_in_topics(json& asked) {
  const auto component = record::at(asked, "component");
  if (!component.is_string()) return;
  const auto own = "/" + component.get<std::string>() + "/";
  for (const auto* name : {"ping_topic", "pong_topic"}) {
    if (const auto topic = record::at(asked, name); topic.is_string())
      asked[name] = replace_all(topic.get<std::string>(), own, "/");
    if (auto others = asked.find("others"); others != asked.end() && others->is_object())
      for (auto& other : *others)
        if (other.is_object()) other.erase(name);
  }
}

// Its value of `key`, and all else that was asked for.
std::pair<std::string, std::string> split_by(const std::string& stated, const statistics::Summary& summary) {
  const auto key = conditions::current_key(stated);
  auto asked = record::conditions_of(summary.run.asked.document);
  if (!asked.is_object()) return {unset, ""};
  auto value = value_of(asked, key);
  const auto follows = following(asked, key);
  drop_repeated(asked);
  if (key == "transport") drop_names_in_topics(asked);
  for (const auto& [name, member] : follows.items())
    if (record::at(asked, name) == member) asked.erase(name);
  for (const auto& place : conditions::places_of(key))
    if (asked.contains(place)) asked[place] = nullptr;
  asked.erase("id");
  return {std::move(value), record::text_of(record::conditions_of(asked))};
}

}  // namespace

json following(const json& asked, const std::string& key) {
  auto alone = json::object();
  for (const auto& place : conditions::places_of(key))
    if (asked.contains(place)) alone[place] = asked[place];
  auto run = conditions::run_of_record(alone);
  if (const auto* const field = conditions::key_named(key)) try {
      conditions::Run of_scenario;
      field->set(of_scenario, value_of(asked, key));
      run = std::move(of_scenario);
    } catch (const std::exception&) {  // a record's number has no unit, and nothing but its group follows
    }
  return record::conditions_of(conditions::to_json(run));
}

Runs whole(const Runs& runs) {
  Runs result;
  std::ranges::copy_if(runs, std::back_inserter(result),
                       [](const auto* run) { return !gate::lacks_samples(gate::flaw_of(*run)); });
  return result;
}

std::optional<statistics::Change> change_of(const Pair& pair, statistics::Times times,
                                            statistics::Figure figure) {
  return statistics::change(whole(pair.from), whole(pair.to), times, figure);
}

bool is_repeated(const Pair& pair) { return whole(pair.from).size() > 1 && whole(pair.to).size() > 1; }

const statistics::Summary* unlike(const Runs& runs) {
  const auto found =
      std::ranges::find_if(runs, [&](const auto* run) { return run->run.key != runs.front()->run.key; });
  return found == runs.end() ? nullptr : *found;
}

bool has_run_on_both_sides(const Pair& pair) {
  return std::ranges::any_of(pair.from, [&](const auto* from) {
    return std::ranges::any_of(pair.to, [&](const auto* to) { return from->run.number == to->run.number; });
  });
}

std::string why_never(const Comparison& comparison) {
  const auto with_article = [](const std::string& quantity) {
    return quantity == "Age"               ? "an age"
           : quantity == "Period"          ? "a period"
           : quantity == "Wake-up latency" ? "an imported wake-up latency"
                                           : "a round trip";
  };
  std::string why;
  for (const auto& from : comparison.only_from)
    for (const auto& to : comparison.only_to) {
      const auto one = quantity_of(from), other = quantity_of(to);
      if (one == other) return "";
      why = fmt::format("{} and {} cannot be compared", with_article(one), with_article(other));
    }
  return comparison.pairs.empty() ? why : "";
}

Comparison compare(const Summaries& a, const Summaries& b) {
  return pairs_of(last_of(a), last_of(b), [](const auto& summary) { return summary.run.key; });
}

Comparison compare_chosen(const Summaries& a, const Summaries& b) {
  const auto key_of = [](const statistics::Summary& summary) {
    auto key = nlohmann::json::array();
    for (const auto* name : {"transport", "component_transport", "options", "component_options", "receive",
                             "variant", "beside", "thread", "measures"})
      key.push_back(summary.run.asked.stated(name));
    return record::text_of(key);
  };
  auto comparison = pairs_of(last_of(a), last_of(b), key_of);
  if (comparison.pairs.empty() && comparison.only_from.size() == 1 && comparison.only_to.size() == 1 &&
      quantity_of(comparison.only_from.front()) == quantity_of(comparison.only_to.front())) {
    comparison.pairs.push_back({comparison.only_from.front(), comparison.only_to.front()});
    comparison.only_from.clear();
    comparison.only_to.clear();
  }
  return comparison;
}

bool can_compare(const Summaries& all, const statistics::Summary& from, const statistics::Summary& to) {
  const bool by_id = word(from.run.asked.id) != word(to.run.asked.id);
  const auto alike = [&](const statistics::Summary& one) {
    Summaries runs;
    std::ranges::copy_if(all, std::back_inserter(runs), [&](const auto& run) {
      return by_id ? word(run.run.asked.id) == word(one.run.asked.id)
                   : run.run.number == one.run.number || (!one.run.key.empty() && run.run.key == one.run.key);
    });
    return runs;
  };
  const auto a = alike(from), b = alike(to);
  const auto comparison = compare_chosen(a, b);
  return !comparison.pairs.empty() && std::ranges::all_of(comparison.pairs, [&](const Pair& pair) {
    return unlike(pair.from) == nullptr && unlike(pair.to) == nullptr && !has_run_on_both_sides(pair);
  });
}

std::vector<Difference> other_differences(const Comparison& comparison, const Pair& pair) {
  auto all = differences(pair);
  if (comparison.key.empty()) return all;
  const auto from = record::conditions_of(pair.from.front()->run.asked.document),
             to = record::conditions_of(pair.to.front()->run.asked.document);
  const auto is_requested = [](const json& asked, const std::vector<std::string>& path) {
    const auto* at = &asked;
    for (const auto& name : path) {
      if (!at->is_object() || !at->contains(name)) return false;
      at = &at->at(name);
    }
    return true;
  };
  // All else that was requested is the same, or follows from the key.
  std::erase_if(all, [&](const Difference& difference) {
    const auto path = split(difference.what, ' ');
    return difference.host.empty() ? is_requested(from, path) || is_requested(to, path)
                                   : path[0] == "transport" && comparison.key == path[0];
  });
  return all;
}

std::vector<std::string> values_of(const Summaries& runs, const std::string& key) {
  std::vector<std::string> values;
  for (const auto& run : runs) add_once(values, split_by(key, run).first);
  return values;
}

std::string words_of_value(const std::string& stated, const std::string& value) {
  const auto key = conditions::current_key(stated);
  auto recorded = record::json_of(value).value_or(nullptr);
  if (recorded.is_object()) try {
      const auto words = words_of_group(key, recorded);
      return words.empty() ? value : words;
    } catch (const std::exception&) {  // not as a record has it
      return value;
    }
  const auto* const field = conditions::key_named(key);
  // A record leaves these out where they are as by default.
  if (value == unset && field != nullptr && !field->by_default.empty() &&
      (field->json.empty() || field->to_json({}).is_null()))
    return field->by_default;
  if (field == nullptr || field->json.empty()) return value;
  if (!recorded.is_number() && !recorded.is_boolean()) try {
      recorded = field->stated(value);
    } catch (const std::exception&) {  // `unset`, or the value of another version
      return value;
    }
  const auto words = words_of(*field, recorded);
  return words == nothing ? value : words;
}

std::vector<std::string> words_of_values(const std::string& key, const std::vector<std::string>& values) {
  const auto words = texts_of(values, [&](const auto& value) { return words_of_value(key, value); });
  std::vector<std::string> apart;
  for (std::size_t i = 0; i < values.size(); ++i)
    apart.push_back(std::ranges::count(words, words[i]) > 1 ? values[i] : words[i]);
  return apart;
}

Comparison compare_by(const Summaries& runs, const std::string& key, const std::string& from,
                      const std::string& to) {
  Runs a, b;
  std::map<const statistics::Summary*, std::string> others;
  for (const auto* run : last_of(runs)) {
    auto [value, other] = split_by(key, *run);
    if (value == from) a.push_back(run);
    if (value == to) b.push_back(run);
    others[run] = std::move(other);
  }
  auto comparison = pairs_of(a, b, [&](const auto& summary) { return others.at(&summary); });
  comparison.key = conditions::current_key(key);
  return comparison;
}

}  // namespace ontime::report
