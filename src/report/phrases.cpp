// SPDX-License-Identifier: Apache-2.0
#include "report/phrases.hpp"

#include <algorithm>
#include <initializer_list>
#include <set>
#include <string_view>

#include <fmt/format.h>

#include "conditions/conditions.hpp"
#include "report/conditions.hpp"
#include "report/words.hpp"

namespace ontime::report {
namespace {

using nlohmann::json;
using record::Asked;

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
  const auto text = [](const auto& wish) {
    return shortened(printable(wish.first) + " " + word(wish.second), longest_value);
  };
  return asked.empty() ? "" : "kernel: " + join(texts_of(asked, text), ", ");
}

std::string quality_of_service(const transport::Qos& qos) {
  auto text = fmt::format("{} {}", conditions::word_of(qos.reliability), conditions::word_of(qos.history));
  if (qos.history == transport::History::keep_last) text += fmt::format(" {}", qos.depth);
  if (qos.durability != transport::Durability::volatile_)
    text += fmt::format(" {}", conditions::word_of(qos.durability));
  return text;
}

// The transport's options of an end: as requested, or else as the end reports them.
Texts options_at(const char* host, const Texts& asked, const record::Outcome& outcome) {
  Texts options;
  for (const auto& [name, value] : asked) options[printable(name)] = printable(value);
  const auto& facts = record::find(outcome.hosts, host).transport.facts;
  for (const auto* name : told_by_facts)
    if (const auto fact = facts.find(name); fact != facts.end())
      options.try_emplace(name, printable(fact->second));
  return options;
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

}  // namespace

std::pair<Texts, Texts> options_of(const Summary& summary) {
  const auto& asked = summary.run.asked;
  const auto& outcome = summary.run.outcome;
  return {options_at("controller", asked.task.config.options, outcome),
          options_at("component", asked.component_options, outcome)};
}

bool is_deadline_the_period(const Summary& summary) {
  return summary.run.asked.stated("deadline_us") == summary.run.asked.stated("period_us");
}

std::vector<Phrase> phrases_of(const Summary& summary, bool any_deadline) {
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
  if (!any_deadline && is_deadline_the_period(summary)) done.insert("deadline");
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

}  // namespace ontime::report
