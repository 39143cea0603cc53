// SPDX-License-Identifier: Apache-2.0
#include "report/conditions.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <initializer_list>
#include <map>
#include <set>
#include <string_view>
#include <utility>

#include <fmt/format.h>

#include "conditions/conditions.hpp"
#include "report/words.hpp"

namespace ontime::report {
namespace {

using nlohmann::json;
using record::Asked;
using statistics::Summary;
using Texts = std::map<std::string, std::string>;

constexpr std::size_t longest_value = 40;  // of an option; the whole is in JSON and CSV

// Options that an end chose itself where none was requested. Without them runs of ROS 2, or of xdp, cannot be
// told apart.
constexpr std::initializer_list<const char*> told_by_facts = {"rmw", "executor", "xdp"};

// A condition of a run.
struct Phrase {
  std::string key;               // as a scenario has it
  std::string text;              // for people
  bool in_labels_alone = false;  // not shown where it is the same in all runs
};

// "every 10 ms"; "": the record does not say it.
std::string phrase_of(const conditions::Field& field, const json& value) {
  if (value.is_null()) return "";
  return fmt::format(fmt::runtime(field.phrase), shortened(words_of(field, value), longest_value));
}

// Of a group of fields those that are not as by default: "loses 1 %, delays 3 ms".
std::vector<std::string> phrases_below(const std::string& path, const Asked& asked) {
  static const conditions::Run by_default;
  std::vector<std::string> phrases;
  for (const auto& field : conditions::keys())
    if (field.path.starts_with(path) && !field.phrase.empty())
      if (const auto& value = asked.stated(field.json);
          !value.is_null() && value != field.to_json(by_default))
        phrases.push_back(phrase_of(field, value));
  return phrases;
}

std::string load(const Asked& asked) {
  if (!asked.stated("load").is_object()) return "";
  std::vector<std::string> hosts;
  if (const auto text = workers(asked.controller_load); !text.empty())
    hosts.push_back(text + " on the controller");
  if (const auto text = workers(asked.component_load); !text.empty())
    hosts.push_back(text + " on the component");
  if (!hosts.empty()) return "load: " + join(hosts, " and ");
  return asked.stated("hosts").is_null() ? "" : "no load";  // a run by hand does not know what else runs
}

const char* direction(bool there, bool back) {
  return !back ? "to the component" : !there ? "to the controller" : "each way";
}

std::string traffic(const conditions::Traffic& traffic) {
  using Direction = conditions::Traffic::Direction;
  auto text = fmt::format(
      "traffic: {} Mbit/s {} in datagrams of {}", megabits(static_cast<double>(traffic.bits_per_s)),
      direction(traffic.direction != Direction::to_controller, traffic.direction != Direction::to_component),
      size(traffic.datagram_bytes));
  if (traffic.priority > 0) text += fmt::format(" at SCHED_FIFO {}", traffic.priority);
  return text;
}

// "4 background topics of 1 KiB each way, reliable", "at 100 Hz", "in another process": runs may differ in
// each.
void add_background(std::vector<Phrase>& phrases, const Asked& asked) {
  static constexpr const char* places[] = {"in the same callback group",
                                           "in another callback group of the node",
                                           "in another node of the executor",
                                           "in the same node, with an executor of their own",
                                           "in the same participant",
                                           "in another participant of the process",
                                           "in another process"};
  const auto& background = asked.task.background;
  if (background.topics == 0) return;
  auto text = fmt::format(
      "{} of {} {}, {}",
      many(static_cast<std::uint64_t>(background.topics), "background topic", "background topics"),
      size(background.payload_bytes), direction(background.there, background.back),
      conditions::word_of(background.reliability));
  if (background.priority > 0) text += fmt::format(" with SCHED_FIFO {}", background.priority);
  phrases.push_back({"background", text});
  const double hz = 1e9 / static_cast<double>(background.period.count());
  phrases.push_back(
      {"background.rate", fmt::format("at {:.4g} {}", hz < 1000 ? hz : hz / 1000, hz < 1000 ? "Hz" : "kHz")});
  if (background.callback.count() > 0)
    phrases.push_back(
        {"background.callback", fmt::format("with callbacks of {}", duration(background.callback))});
  phrases.push_back({"background.where", places[static_cast<std::size_t>(background.where)]});
}

std::string link(const Asked& asked) {
  auto faults = phrases_below("link.", asked);
  if (const auto& cut = asked.cut)
    faults.push_back(
        fmt::format("is cut at {} for {}", conditions::text_of(cut->at), conditions::text_of(cut->length)));
  return faults.empty() ? "" : "a link that " + join(faults, ", ");
}

std::string wire(const conditions::Wire& wire) {
  std::vector<std::string> parts;
  if (wire.bits_per_s > 0)
    parts.push_back("of " + megabits(static_cast<double>(wire.bits_per_s)) + " Mbit/s");
  if (wire.vlan > 0) parts.push_back(fmt::format("with VLAN {}", wire.vlan));
  return "a wire " + join(parts, " ");
}

// "kernel: irq-threads 90, ksoftirqd 60".
std::string kernel(const settings::Wishes& asked) {
  std::vector<std::string> parts;
  for (const auto& [name, value] : asked)
    parts.push_back(shortened(printable(name) + " " + word(value), longest_value));
  return parts.empty() ? "" : "kernel: " + join(parts, ", ");
}

std::string quality_of_service(const transport::Qos& qos) {
  auto text = fmt::format("{} {}", conditions::word_of(qos.reliability), conditions::word_of(qos.history));
  if (qos.history == transport::History::keep_last) text += fmt::format(" {}", qos.depth);
  if (qos.durability != transport::Durability::volatile_)
    text += fmt::format(" {}", conditions::word_of(qos.durability));
  return text;
}

// The transport's options of an end: as requested, or else as the end reports them.
Texts options_of(const Texts& asked, const record::Outcome& outcome, const char* host) {
  Texts options;
  for (const auto& [name, value] : asked) options[printable(name)] = printable(value);
  const auto& facts = record::find(outcome.hosts, host).transport.facts;
  for (const auto* name : told_by_facts)
    if (const auto fact = facts.find(name); fact != facts.end())
      options.try_emplace(name, printable(fact->second));
  return options;
}

// Those of the controller, those of the component.
std::pair<Texts, Texts> options_of(const Summary& summary) {
  const auto& asked = summary.run.asked;
  const auto& outcome = summary.run.outcome;
  return {options_of(asked.task.config.options, outcome, "controller"),
          options_of(asked.component_options, outcome, "component")};
}

// "executor multi"; a name of an RMW needs no explanation.
std::string option_phrase(const std::string& name, const std::string& value) {
  const auto text = shortened(value, longest_value);
  return name == "rmw" && value.starts_with("rmw_") ? text : name + " " + text;
}

std::vector<std::string> names_in_order(const Texts& options) {
  std::vector<std::string> names;
  for (const auto* name : told_by_facts)
    if (options.contains(name)) names.emplace_back(name);
  for (const auto& [name, value] : options) add_once(names, name);
  return names;
}

void add_options(std::vector<Phrase>& phrases, const Summary& summary) {
  const auto [controller, component] = options_of(summary);
  const auto& other = summary.run.asked.component_transport;
  const bool another = !other.empty() && other != summary.run.asked.task.transport;
  for (const auto& name : names_in_order(controller))
    phrases.push_back({"options." + name, option_phrase(name, controller.at(name))});
  if (another) phrases.push_back({"component.transport", "component " + word(other)});
  for (const auto& name : names_in_order(component)) {
    const auto same = controller.find(name);
    if (another || same == controller.end() || same->second != component.at(name))
      phrases.push_back(
          {"component.options." + name, "component " + option_phrase(name, component.at(name))});
  }
}

// Of the link under test, where it was named.
std::string interfaces(const Asked& asked) {
  std::vector<std::string> names;
  for (const auto& name : {asked.task.config.interface, asked.component_interface})
    if (!name.empty()) names.push_back(printable(name));
  return names.empty() ? "" : "over " + join(names, " and ");
}

// Where there are several components, the name of each is in its topics; it is told by itself.
void add_topics(std::vector<Phrase>& phrases, const Asked& asked) {
  const auto topic = [&](std::string name) {
    name = printable(name);
    const auto own = fmt::format("/{}/", asked.component);
    if (const auto place = asked.stated("component").is_null() ? name.npos : name.rfind(own);
        place != name.npos)
      name.erase(place, own.size() - 1);
    return name;
  };
  const auto ping = topic(asked.task.config.ping_topic), pong = topic(asked.task.config.pong_topic);
  if (ping != "/ping" || pong != "/pong")
    phrases.push_back({"topics", fmt::format("topics {} and {}", ping, pong)});
}

// The conditions of a run in words, one phrase each; only those that its record has.
std::vector<Phrase> phrases_of(const Summary& summary) {
  const auto& asked = summary.run.asked;
  const auto& client = asked.task.client;
  std::vector<Phrase> phrases;
  std::set<std::string_view> done{"domain"};
  const auto add = [&](const char* key, const char* name, const std::string& text,
                       bool in_labels_alone = false) {
    if (!asked.stated(name).is_null() && !text.empty()) phrases.push_back({key, text, in_labels_alone});
  };
  const auto add_field = [&](const conditions::Field& field) {
    if (field.phrase.empty() || !done.insert(field.path).second) return;
    constexpr std::string_view in_labels_alone[] = {"timeout", "warm-up", "explain", "count-instructions"};
    if (const auto text = phrase_of(field, asked.stated(field.json)); !text.empty())
      phrases.push_back(
          {field.path, text, std::ranges::find(in_labels_alone, field.path) != std::end(in_labels_alone)});
  };
  const auto say = [&](std::initializer_list<std::string_view> paths) {
    for (const auto path : paths) add_field(*conditions::key_named(path));
  };
  if (client.schedule == roundtrip::Schedule::back_to_back) done.insert("period");
  if (asked.is_listened()) done.insert("schedule");
  if (asked.stated("deadline_us") == asked.stated("period_us")) done.insert("deadline");
  if (asked.task.config.domain != 0) done.erase("domain");
  add("component", "component", "component " + word(asked.component));
  const bool any_refused = std::ranges::any_of(
      summary.run.outcome.hosts, [](const auto& host) { return !host.second.refusals.empty(); });
  add("realtime", "realtime",
      !asked.task.realtime.on ? "SCHED_OTHER"
      : any_refused           ? "real-time settings, some denied (see below)"
                              : "real-time settings");
  say({"payload", "period", "schedule", "launch-time", "deadline", "timeout"});
  add("qos", "qos", quality_of_service(asked.task.config.qos));
  say({"receive"});
  add_options(phrases, summary);
  say({"domain", "security"});
  add_topics(phrases, asked);
  add("beside", "beside", "beside " + word(asked.beside));
  if (const auto names = interfaces(asked); !names.empty()) phrases.push_back({"interface", names});
  say({"duration"});
  for (const auto& field : conditions::keys())
    if (!field.path.starts_with("link.") && !field.path.starts_with("isolation.")) add_field(field);
  add("load", "load", load(asked));
  add("traffic", "traffic", traffic(asked.traffic));
  add_background(phrases, asked);
  add("link", "link", link(asked));
  add("wire", "wire", wire(asked.wire));
  add("isolation", "isolation", join(phrases_below("isolation.", asked), ", "));
  add("kernel", "kernel", kernel(asked.kernel));
  add("hosts", "hosts", "hosts " + word(asked.stated("hosts")), true);
  return phrases;
}

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

// What all runs of a group share, in words, and for each run what not all share.
struct Compared {
  std::vector<Phrase> shared;
  std::vector<std::vector<Phrase>> own;
};

Compared compare(const Group& group) {
  Compared result;
  for (const auto* summary : group) result.own.push_back(phrases_of(*summary));
  std::set<std::string> compared;
  for (const auto& phrases : result.own) {
    for (const auto& phrase : phrases) {
      if (!compared.insert(phrase.key).second) continue;
      bool common = true;
      for (std::size_t i = 0; i < group.size() && common; ++i) {
        const auto* other = find(result.own[i], phrase.key);
        common = other == nullptr ? may_have(*group[i], phrase.key) : other->text == phrase.text;
      }
      if (common) result.shared.push_back(phrase);
    }
  }
  for (auto& phrases : result.own)
    std::erase_if(phrases, [&](const auto& phrase) { return find(result.shared, phrase.key) != nullptr; });
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

// Adds the varied values that no phrase shows yet: "qos.depth" is already in the phrase "qos". The transport
// begins the label.
void add_variant(std::vector<std::string>& parts, const Summary& summary,
                 const std::vector<Phrase>& phrases) {
  constexpr std::string_view groups[] = {"qos",        "load",   "traffic",  "link",
                                         "background", "kernel", "isolation"};
  for (const auto& [key, value] : varied(summary)) {
    const bool told =
        key == "component.transport" || std::ranges::any_of(phrases, [&, &key = key](const Phrase& phrase) {
          const bool is_group = std::ranges::find(groups, phrase.key) != std::end(groups);
          return key == phrase.key || (is_group && key.starts_with(phrase.key + "."));
        });
    if (!told) parts.push_back(shortened(printable(fmt::format("{} {}", key, value)), longest_value));
  }
}

// Runs with different keys are not repetitions, even if this ontime has no words for the difference: their
// labels get the number of the first run with that key.
void tell_conditions_apart(std::vector<std::string>& labels, const Group& group) {
  using Firsts = std::map<std::string, std::int64_t>;  // by key
  std::map<std::pair<std::string, std::string>, Firsts> by_label;
  std::vector<const Firsts*> of_run;
  for (std::size_t i = 0; i < group.size(); ++i) {
    const auto& run = group[i]->run;
    auto& firsts = by_label[{run.asked.id, labels[i]}];
    firsts.try_emplace(run.key, run.number);
    of_run.push_back(&firsts);
  }
  for (std::size_t i = 0; i < group.size(); ++i)
    if (of_run[i]->size() > 1) labels[i] += fmt::format(" run {}", of_run[i]->at(group[i]->run.key));
}

}  // namespace

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
         : field.unit == Unit::share                      ? fmt::format("{:.4g} %", number * 100)
         : value.is_number_integer() && number >= 0       ? size(value.get<std::uint64_t>())
                                                          : nothing;
}

std::string words_of_group(const std::string& key, const json& value) {
  Summary alone;
  // The hosts are known: no load is then "no load".
  alone.run.asked = json{{"hosts", ""}, {key, value}};
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

std::vector<std::string> labels_without_repetition(const Group& group, std::string_view separator) {
  const auto compared = compare(group);
  std::vector<std::string> labels;
  for (std::size_t i = 0; i < group.size(); ++i) {
    const auto& asked = group[i]->run.asked;
    const auto transport = asked.is_listened() ? "" : word(asked.task.transport) + " ";
    std::vector<std::string> parts;
    for (const auto& phrase : compared.own[i])  // "xdp native copy" of xdp is told once
      parts.push_back(phrase.text.substr(phrase.text.starts_with(transport) ? transport.size() : 0));
    add_variant(parts, *group[i], phrases_of(*group[i]));
    auto& label = labels.emplace_back(transport + join(parts, separator));
    if (label.ends_with(' ')) label.pop_back();
  }
  tell_conditions_apart(labels, group);
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
  std::vector<std::string> texts;
  for (const auto& phrase : compare(group).shared)
    if (!phrase.in_labels_alone) texts.push_back(phrase.text);
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
