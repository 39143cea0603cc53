// SPDX-License-Identifier: Apache-2.0
#include "report/conditions.hpp"

#include <algorithm>
#include <initializer_list>
#include <map>
#include <set>
#include <string_view>

#include <fmt/format.h>

#include "report/report.hpp"
#include "report/words.hpp"

namespace ontime::report {
namespace {

using nlohmann::json;
using statistics::Summary;
using Texts = std::map<std::string, std::string>;

constexpr std::size_t longest_value = 40;  // of an option; the whole is in JSON and CSV

// What an end says it took where nothing was asked, and without which a run of ROS 2 has no name, or one of
// xdp is taken for another.
constexpr std::initializer_list<const char*> told_by_facts = {"rmw", "executor", "xdp"};

// A condition of a run.
struct Phrase {
  std::string key;   // as a scenario has it
  std::string text;  // for people
  enum class Where { everywhere, in_labels } where = Where::everywhere;
};

std::string load(const json& run) {
  const auto& asked = at(run, "load");
  if (!asked.is_object()) return "";
  std::vector<std::string> hosts;
  for (const auto* host : {"controller", "component"})
    if (const auto text = workers(at(asked, host)); !text.empty()) hosts.push_back(text + " on the " + host);
  if (!hosts.empty()) return "load: " + join(hosts, " and ");
  return at(run, "hosts").is_null() ? "" : "no load";  // by hand nobody knows what else runs
}

std::string traffic(const json& asked) {
  const auto& direction = at(asked, "direction");
  auto text = fmt::format("traffic: {} Mbit/s {}", megabits(at(asked, "bit_s")),
                          direction == "to-component"    ? "to the component"
                          : direction == "to-controller" ? "to the controller"
                                                         : "each way");
  text += fmt::format(" in datagrams of {}", size(at(asked, "datagram_bytes")));
  if (const auto priority = count(at(asked, "priority")); priority > 0)
    text += fmt::format(" at SCHED_FIFO {}", priority);
  return text;
}

const char* place_of_neighbours(const json& where) {
  if (where == "same-callback-group") return "in the same callback group";
  if (where == "same-node") return "in another callback group of the node";
  if (where == "same-executor") return "in another node of the executor";
  if (where == "own-executor") return "in the same node, with an executor of their own";
  if (where == "same-participant") return "in the same participant";
  if (where == "same-process") return "in another participant of the process";
  return "in another process";
}

// "4 neighbours of 1 KiB each way, reliable", "at 100 Hz", "in another process": each may be what runs differ
// in.
void add_neighbours(std::vector<Phrase>& phrases, const json& asked) {
  if (!asked.is_object()) return;
  const auto &where = at(asked, "where"), &rate = at(asked, "rate_hz");
  auto text = fmt::format("{} of {} {}, {}", many(count(at(asked, "topics")), "neighbour", "neighbours"),
                          size(at(asked, "payload_bytes")),
                          !is_true(at(asked, "back"))    ? "to the component"
                          : !is_true(at(asked, "there")) ? "to the controller"
                                                         : "each way",
                          word(at(asked, "reliability")));
  if (const auto priority = count(at(asked, "priority")); priority > 0)
    text += fmt::format(" with SCHED_FIFO {}", priority);
  phrases.push_back({"neighbours", text});
  const double hz = rate.is_number() ? rate.get<double>() : 0;
  phrases.push_back(
      {"neighbours.rate", fmt::format("at {:.4g} {}", hz < 1000 ? hz : hz / 1000, hz < 1000 ? "Hz" : "kHz")});
  if (const auto& callback = at(asked, "callback_us"); callback.is_number() && callback > 0)
    phrases.push_back({"neighbours.callback", fmt::format("with callbacks of {}", duration(callback))});
  phrases.push_back({"neighbours.where", place_of_neighbours(where)});
}

std::string percent(const json& share) { return fmt::format("{:.4g} %", share.get<double>() * 100); }

std::string link(const json& asked) {
  std::vector<std::string> faults;
  const auto is_some = [&](const char* key) { return at(asked, key).is_number() && at(asked, key) > 0; };
  if (is_some("loss")) faults.push_back("loses " + percent(at(asked, "loss")));
  if (is_some("duplicates")) faults.push_back("doubles " + percent(at(asked, "duplicates")));
  if (is_some("delay_us")) {
    auto text = "delays " + duration(at(asked, "delay_us"));
    if (is_some("jitter_us")) text += " ± " + duration(at(asked, "jitter_us"));
    if (is_some("reordered")) text += fmt::format(" but for {}", percent(at(asked, "reordered")));
    faults.push_back(text);
  }
  if (const auto& qdisc = at(asked, "qdisc"); is_said(qdisc))
    faults.push_back("queues by " + shortened(word(qdisc), longest_value));
  if (at(asked, "message_priority").is_number())
    faults.push_back("sends messages with priority " + word(at(asked, "message_priority")));
  if (at(asked, "traffic_priority").is_number())
    faults.push_back("sends traffic with priority " + word(at(asked, "traffic_priority")));
  if (const auto& cut = at(asked, "cut"); cut.is_object())
    faults.push_back(fmt::format("is cut at {} s for {} ms", word(at(cut, "at_s")), word(at(cut, "for_ms"))));
  return faults.empty() ? "" : "a link that " + join(faults, ", ");
}

std::string wire(const json& asked) {
  if (!asked.is_object()) return "";
  std::vector<std::string> parts;
  if (const auto& rate = at(asked, "bits_per_s"); rate.is_number() && rate > 0)
    parts.push_back("of " + megabits(rate) + " Mbit/s");
  if (const auto& vlan = at(asked, "vlan"); vlan.is_number() && vlan > 0)
    parts.push_back("with VLAN " + word(vlan));
  return "a wire " + join(parts, " ");
}

// "kernel: irq-threads 90, ksoftirqd 60".
std::string kernel(const json& asked) {
  std::vector<std::string> parts;
  if (asked.is_object())
    for (const auto& [name, value] : asked.items())
      parts.push_back(shortened(printable(name) + " " + word(value), longest_value));
  return parts.empty() ? "" : "kernel: " + join(parts, ", ");
}

// "CPUs 2-3 kept, interrupts elsewhere, load and traffic with 50 % of a CPU".
std::string isolation(const json& asked) {
  std::vector<std::string> parts;
  if (const auto& cpus = at(asked, "cpus"); is_said(cpus))
    parts.push_back(fmt::format("CPUs {} kept", word(cpus)));
  if (is_true(at(asked, "interrupts"))) parts.emplace_back("interrupts elsewhere");
  if (const auto& quota = at(asked, "load_quota"); quota.is_number() && quota > 0)
    parts.push_back("load and traffic with " + percent(quota) + " of a CPU");
  if (const auto& weight = at(asked, "load_weight"); weight.is_number() && weight > 0)
    parts.push_back("load and traffic of weight " + word(weight));
  return join(parts, ", ");
}

std::string quality_of_service(const json& qos) {
  if (!qos.is_object()) return "";
  auto text = word(at(qos, "reliability")) + " " + word(at(qos, "history"));
  if (at(qos, "history") == "keep-last") text += " " + word(at(qos, "depth"));
  if (at(qos, "durability") != "volatile") text += " " + word(at(qos, "durability"));
  return text;
}

std::string seconds(const json& s) { return s.is_number() ? duration(s.get<double>() * 1e6) : nothing; }

bool any_refused(const Summary& summary) {
  const auto& hosts = at(summary.run.outcome, "hosts");
  return std::any_of(hosts.begin(), hosts.end(),
                     [](const json& host) { return !at(host, "refusals").empty(); });
}

// The transport's options of a run's two ends, as asked for, or else as the end said that it took them.
struct Options {
  Texts controller, component;
};

Texts options_of(const Summary& summary, const char* asked, const char* host) {
  Texts options;
  if (const auto& said = at(summary.run.asked, asked); said.is_object())
    for (const auto& [name, value] : said.items()) options[printable(name)] = word(value);
  const auto& facts = at(at(at(at(summary.run.outcome, "hosts"), host), "transport"), "facts");
  for (const auto* name : told_by_facts)
    if (const auto& fact = at(facts, name); fact.is_string()) options.try_emplace(name, word(fact));
  return options;
}

Options options_of(const Summary& summary) {
  return {options_of(summary, "options", "controller"),
          options_of(summary, "component_options", "component")};
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
  for (const auto& [name, value] : options)
    if (std::find(names.begin(), names.end(), name) == names.end()) names.push_back(name);
  return names;
}

void add_options(std::vector<Phrase>& phrases, const Summary& summary) {
  const auto [controller, component] = options_of(summary);
  const auto& transport = at(summary.run.asked, "transport");
  const auto& other = at(summary.run.asked, "component_transport");
  const bool another = !other.is_null() && other != transport;
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
std::string interfaces(const json& asked) {
  std::vector<std::string> names;
  for (const auto* key : {"interface", "component_interface"})
    if (const auto& name = at(asked, key); name.is_string()) names.push_back(word(name));
  return names.empty() ? "" : "over " + join(names, " and ");
}

// Where there are several components, the name of each is in its topics; it is told by itself.
void add_topics(std::vector<Phrase>& phrases, const json& asked) {
  if (at(asked, "ping_topic").is_null() || at(asked, "pong_topic").is_null()) return;
  const auto& component = at(asked, "component");
  const auto topic = [&](const char* key) {
    auto name = word(at(asked, key));
    const auto own = fmt::format("/{}/", word(component));
    if (const auto place = component.is_null() ? name.npos : name.rfind(own); place != name.npos)
      name.erase(place, own.size() - 1);
    return name;
  };
  const auto ping = topic("ping_topic"), pong = topic("pong_topic");
  if (ping != "/ping" || pong != "/pong")
    phrases.push_back({"topics", fmt::format("topics {} and {}", ping, pong)});
}

// The conditions of a run in words, each for itself; nothing of what its record does not say.
std::vector<Phrase> phrases_of(const Summary& summary) {
  const auto& asked = summary.run.asked;
  std::vector<Phrase> phrases;
  const auto add = [&](const char* key, const json& said, const std::string& text,
                       Phrase::Where where = Phrase::Where::everywhere) {
    if (!said.is_null() && !text.empty()) phrases.push_back({key, text, where});
  };
  const auto& realtime = at(asked, "realtime");
  const auto& period = at(asked, "period_us");
  const auto& schedule = at(asked, "schedule");
  add("realtime", realtime,
      !is_true(realtime)     ? "SCHED_OTHER"
      : any_refused(summary) ? "real-time settings, not all given (see below)"
                             : "real-time settings");
  add("payload", at(asked, "payload_bytes"), size(at(asked, "payload_bytes")));
  if (schedule != "back-to-back") add("period", period, "every " + duration(period));
  add("schedule", schedule, word(schedule));
  add("launch-time", at(asked, "launch_us"),
      "launched " + duration(at(asked, "launch_us")) + " after it was due");
  if (at(asked, "deadline_us") != period)
    add("deadline", at(asked, "deadline_us"), "deadline " + duration(at(asked, "deadline_us")));
  add("timeout", at(asked, "timeout_us"), "time-out " + duration(at(asked, "timeout_us")),
      Phrase::Where::in_labels);
  add("qos", at(asked, "qos"), quality_of_service(at(asked, "qos")));
  add("receive", at(asked, "receive"), word(at(asked, "receive")));
  add_options(phrases, summary);
  if (const auto& domain = at(asked, "domain"); domain != 0) add("domain", domain, "domain " + word(domain));
  add("security", at(asked, "security"), "security " + word(at(asked, "security")));
  add_topics(phrases, asked);
  add("component", at(asked, "component"), "component " + word(at(asked, "component")));
  add("beside", at(asked, "beside"), "beside " + word(at(asked, "beside")));
  add("interface", at(asked, "interface"), interfaces(asked));
  add("duration", at(asked, "duration_s"), seconds(at(asked, "duration_s")));
  add("load", at(asked, "load"), load(asked));
  add("traffic", at(asked, "traffic"), traffic(at(asked, "traffic")));
  add_neighbours(phrases, at(asked, "neighbours"));
  add("link", at(asked, "link"), link(at(asked, "link")));
  add("wire", at(asked, "wire"), wire(at(asked, "wire")));
  add("isolation", at(asked, "isolation"), isolation(at(asked, "isolation")));
  add("kernel", at(asked, "kernel"), kernel(at(asked, "kernel")));
  add("hosts", at(asked, "hosts"), "hosts " + word(at(asked, "hosts")), Phrase::Where::in_labels);
  return phrases;
}

const Phrase* find(const std::vector<Phrase>& phrases, const std::string& key) {
  const auto found =
      std::find_if(phrases.begin(), phrases.end(), [&](const Phrase& phrase) { return phrase.key == key; });
  return found == phrases.end() ? nullptr : &*found;
}

// Whether a run of which this is not known may have had it all the same: it failed before it could say.
bool may_have(const Summary& summary, const std::string& key) {
  const bool by_facts = std::any_of(told_by_facts.begin(), told_by_facts.end(), [&](const char* name) {
    return key == fmt::format("options.{}", name) || key == fmt::format("component.options.{}", name);
  });
  return by_facts && !at(summary.run.outcome, "hosts").is_object();
}

// What all of a group have in common, in words, and of each what not all have.
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

// A variant is what a scenario's lists made: "payload 32 KiB, realtime.priority 50". What it says of
// conditions that have words of their own is in those.
void add_variant(std::string& label, const json& variant, const std::vector<Phrase>& phrases) {
  if (!variant.is_string()) return;
  const auto text = word(variant);
  for (std::size_t begin = 0; begin < text.size();) {
    const auto end = std::min(text.find(", ", begin), text.size());
    const auto part = text.substr(begin, end - begin);
    const auto key = part.substr(0, part.find(' '));
    // "qos.depth 5" is told by "qos", "load.controller.cpu 4" by "load".
    // The component's transport is told where it is another, and the label begins with the one.
    const bool told = key == "component.transport" ||
                      std::any_of(phrases.begin(), phrases.end(), [&](const Phrase& phrase) {
                        const bool holds_others = phrase.key == "qos" || phrase.key == "load" ||
                                                  phrase.key == "traffic" || phrase.key == "link" ||
                                                  phrase.key == "neighbours" || phrase.key == "kernel" ||
                                                  phrase.key == "isolation";
                        return key == phrase.key || (holds_others && key.starts_with(phrase.key + "."));
                      });
    if (!told) label += " " + shortened(part, longest_value);
    begin = end + 2;
  }
}

}  // namespace

std::string workers(const json& load) {
  std::vector<std::string> parts;
  for (const auto* kind : {"cpu", "vm", "io", "hdd"})
    if (const auto number = count(at(load, kind)); number > 0) {
      const auto& bytes = at(load, fmt::format("{}_bytes", kind));
      parts.push_back(fmt::format("{} {}{}", number, kind, count(bytes) > 0 ? " of " + size(bytes) : ""));
    }
  return join(parts, ", ");
}

Group all_of(const Summaries& summaries) {
  Group all;
  for (const auto& summary : summaries) all.push_back(&summary);
  return all;
}

std::vector<Group> by_id(const Summaries& summaries) {
  std::vector<Group> groups;
  std::map<std::string, std::size_t> places;
  for (const auto& summary : summaries) {
    const auto [place, is_new] = places.try_emplace(word(at(summary.run.asked, "id")), groups.size());
    if (is_new) groups.emplace_back();
    groups[place->second].push_back(&summary);
  }
  return groups;
}

std::vector<std::string> labels_without_repetition(const Group& group) {
  const auto compared = compare(group);
  std::vector<std::string> labels;
  for (std::size_t i = 0; i < group.size(); ++i) {
    const auto& asked = group[i]->run.asked;
    labels.push_back(word(at(asked, "transport")));
    const auto transport = labels.back() + " ";
    for (const auto& phrase : compared.own[i])  // "xdp native copy" of xdp is told once
      labels.back() += " " + phrase.text.substr(phrase.text.starts_with(transport) ? transport.size() : 0);
    add_variant(labels.back(), at(asked, "variant"), phrases_of(*group[i]));
  }
  return labels;
}

std::vector<std::string> labels_of(const Group& group) {
  auto labels = labels_without_repetition(group);
  const auto repetition = [](const Summary* summary) { return count(at(summary->run.asked, "repetition")); };
  if (std::none_of(group.begin(), group.end(), [&](const auto* summary) { return repetition(summary) > 1; }))
    return labels;
  for (std::size_t i = 0; i < group.size(); ++i)
    labels[i] += " #" + word(at(group[i]->run.asked, "repetition"));
  return labels;
}

void tell_apart(std::vector<std::string>& labels, const Group& group) {
  std::map<std::string, int> uses;
  for (const auto& text : labels) ++uses[text];
  for (std::size_t i = 0; i < labels.size(); ++i)
    if (uses[labels[i]] > 1) labels[i] += fmt::format(" run {}", group[i]->run.number);
}

std::vector<std::string> shared_conditions(const Group& group) {
  std::vector<std::string> texts;
  for (const auto& phrase : compare(group).shared)
    if (phrase.where == Phrase::Where::everywhere) texts.push_back(phrase.text);
  return texts;
}

Differences differences_between(const Group& group) {
  Differences differences;
  const auto own = compare(group).own;
  for (const auto& phrases : own)
    for (const auto& phrase : phrases)
      if (std::find(differences.keys.begin(), differences.keys.end(), phrase.key) == differences.keys.end())
        differences.keys.push_back(phrase.key);
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
  const auto [controller, component] = options_of(summary);
  const auto value = [](const Texts& options, const std::string& name) {
    const auto found = options.find(name);
    return found == options.end() ? "" : found->second;
  };
  for (const auto& name : controller_) row.push_back(value(controller, name));
  for (const auto& name : component_) row.push_back(value(component, name));
}

}  // namespace ontime::report
