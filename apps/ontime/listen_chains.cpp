// SPDX-License-Identifier: Apache-2.0
#include "listen_chains.hpp"

#include <algorithm>
#include <map>
#include <numeric>
#include <set>

#include <boost/algorithm/string/trim.hpp>
#include <fmt/format.h>

#include "flags.hpp"
#include "listen_words.hpp"
#include "table/table.hpp"

namespace ontime::app {
namespace {

using nlohmann::ordered_json;

constexpr std::size_t text_width = 80;
constexpr std::string_view latest = "latest:";

[[noreturn]] void refuse(const std::string& text, const std::string& why) {
  throw wrong("--chain '{}': {}. Example: --chain /scan,/map,/cmd_vel@50ms", table::printable(text), why);
}

listen::ChainWish chain_of(const std::string& text) {
  using boost::algorithm::trim;
  listen::ChainWish chain;
  const auto at = text.find('@');
  if (const auto more = text.find(',', at); at != text.npos && more != text.npos)
    refuse(text, fmt::format("the limit is of the whole chain and stands at its end: {}{}{}",
                             table::printable(text.substr(0, at)), table::printable(text.substr(more)),
                             table::printable(text.substr(at, more - at))));
  if (at != text.npos) chain.age = duration_flag("--chain", boost::algorithm::trim_copy(text.substr(at + 1)));
  for (auto topic : table::split(text.substr(0, at), ',')) {
    trim(topic);
    const bool is_of_latest = topic.starts_with(latest);
    if (is_of_latest) topic.erase(0, latest.size());
    trim(topic);
    if (topic.empty()) refuse(text, "a topic name is empty");
    if (is_of_latest && chain.steps.empty()) refuse(text, "the first topic cannot have 'latest:'");
    if (std::ranges::any_of(chain.steps, [&](const auto& step) { return step.topic == topic; }))
      refuse(text, fmt::format("{} occurs twice; each topic may occur once", table::printable(topic)));
    chain.steps.push_back({topic, is_of_latest});
  }
  if (chain.steps.size() < 2) refuse(text, "it has 1 topic; the minimum is 2");
  if (chain.steps.size() > listen::ChainWish::most_topics)
    refuse(text, fmt::format("it has {} topics; the maximum is {}", chain.steps.size(),
                             listen::ChainWish::most_topics));
  return chain;
}

// Cuts the end of a long name: a wrapped line is harder to read.
std::string line(const std::string& text) { return table::shortened(text, text_width - 1) + "\n"; }

std::string spread(const listen::Distribution& values) {
  return fmt::format("{:>8}{:>8}{:>8}", in_rounded_ms(values.quantile_ns(0.5)),
                     in_rounded_ms(values.quantile_ns(0.99)), in_ms(values.max_ns()));
}

std::string topic_name(const listen::ChainWish& wish, std::size_t topic) {
  return table::printable(wish.steps[topic].topic);
}

// Parts alternate: a topic, a node, a topic, …
std::string name_of_part(const listen::ChainWish& wish, const listen::ChainPath& path, std::size_t part) {
  const auto topic = part / 2;
  if (part % 2 == 0)
    return fmt::format("{} → {}", topic_name(wish, topic), words_of(path.parties[topic + 1], "(unknown)"));
  return fmt::format("  in {}{}", words_of(path.parties[topic + 1], "(unknown)"),
                     wish.steps[topic + 1].is_of_latest ? " (latest taken)" : "");
}

std::string text_of(const listen::Chain& chain, const listen::ChainPath& path) {
  auto text = line(fmt::format("  share     p50     p99     max ms   from {}",
                               words_of(path.parties[0], "(unknown)"))) +
              line(fmt::format("  100 %{}   {} arrived{}", spread(path.age), path.age.count(),
                               chain.wish.age ? fmt::format(", {} of them late", path.late) : ""));
  if (path.not_judged > 0) text += line(fmt::format("    not judged: {} more", path.not_judged));
  for (std::size_t part = 0; part < path.parts.size(); ++part) {
    const auto& times = path.parts[part];
    const auto share = path.age.sum_ns() > 0 ? 100 * times.sum_ns() / path.age.sum_ns() : 0;
    text += line(fmt::format("{:5.0f} %{}   {}", share, spread(times), name_of_part(chain.wish, path, part)));
  }
  return text;
}

std::string remarks_of(const listen::Chain& chain) {
  const auto& wish = chain.wish;
  std::string text;
  const auto messages = [](std::uint64_t count) {
    return table::many(count, "message was", "messages were");
  };
  const auto add = [&](const std::string& remark) { text += table::wrapped(remark, text_width, "  "); };
  for (std::size_t part = 0; part < chain.ended.size(); ++part) {
    if (chain.ended[part] == 0) continue;
    const auto topic = topic_name(wish, part / 2);
    add(part % 2 == 0
            ? fmt::format("{}: {} not taken by a node of the chain", topic, messages(chain.ended[part]))
            : fmt::format("{}: {} taken without a following {} (may be intended)", topic,
                          messages(chain.ended[part]), topic_name(wish, part / 2 + 1)));
  }
  for (std::size_t topic = 1; topic < wish.steps.size(); ++topic)
    if (const auto count = chain.without_take[topic]; count > 0)
      add(fmt::format(
          "{}: {} published without a preceding take of {}{}", topic_name(wish, topic), messages(count),
          topic_name(wish, topic - 1),
          wish.steps[topic].is_of_latest
              ? " by their process"
              : fmt::format(" in the same callback. If a timer or another thread publishes: latest:{}",
                            topic_name(wish, topic))));
  for (std::size_t topic = 0; topic < wish.steps.size(); ++topic)
    if (const auto count = chain.unknown_takes[topic]; count > 0)
      add(
          fmt::format("{}: {} an unknown publish: the writer was not recognized yet, is on another machine, "
                      "published from two threads at once, or published too long ago",
                      topic_name(wish, topic), table::many(count, "take has", "takes have")));
  if (chain.silent_ns > 0) add("SILENT: no known arrival for the last " + time_of_silence(chain.silent_ns));
  if (chain.forgotten > 0)
    add(fmt::format("{} messages arrived by other paths, which are not listed{}",
                    table::grouped(chain.forgotten),
                    wish.age ? fmt::format("; {} of them late", table::grouped(chain.forgotten_late)) : ""));
  return text;
}

}  // namespace

std::vector<listen::ChainWish> chains_of(const std::vector<std::string>& texts) {
  if (texts.size() > listen::most_chains)
    throw wrong("--chain: {} chains are given; the maximum is {}", texts.size(), listen::most_chains);
  std::vector<listen::ChainWish> chains;
  for (const auto& text : texts) {
    chains.push_back(chain_of(text));
    if (std::ranges::count_if(chains, [&](const auto& one) { return one.name() == chains.back().name(); }) >
        1)
      refuse(text, "this chain is given twice");
  }
  return chains;
}

std::size_t came_out(const listen::Chain& chain) {
  return std::accumulate(chain.paths.begin(), chain.paths.end(), static_cast<std::size_t>(chain.forgotten),
                         [](auto sum, const auto& path) { return sum + path.age.count() + path.not_judged; });
}

std::vector<std::string> breaks_of(const listen::Findings& findings) {
  constexpr std::size_t most_named = 60;                 // columns
  std::map<std::uint32_t, std::set<std::string>> takes;  // by process
  for (const auto& flow : findings.flows)
    if (!flow.topic.empty()) takes[flow.reader.process].insert(flow.topic);
  std::set<std::string> breaks;
  for (const auto& chain : findings.chains)
    for (std::size_t topic = 1; came_out(chain) == 0 && topic < chain.wish.steps.size(); ++topic)
      for (const auto& flow : findings.flows) {
        if (flow.topic != chain.wish.steps[topic].topic || flow.writer.process == 0) continue;
        const auto found = takes.find(flow.writer.process);
        const auto& before = chain.wish.steps[topic - 1].topic;
        const bool was_seen = std::ranges::any_of(
            findings.flows, [&](const auto& other) { return other.topic == before && other.messages > 0; });
        if (!was_seen || found == takes.end() || found->second.contains(before)) continue;
        const std::vector<std::string> others(found->second.begin(), found->second.end());
        breaks.insert(fmt::format("--chain: {}, which publishes {}, took no {}; it took {}",
                                  words_of(flow.writer, "(unknown)"), topic_name(chain.wish, topic),
                                  topic_name(chain.wish, topic - 1),
                                  table::shortened(table::printable(table::join(others, ", ")), most_named)));
      }
  return {breaks.begin(), breaks.end()};
}

bool misses(const listen::Chain& chain) {
  const auto is_judged = [](const auto& path) { return path.age.count() > 0; };
  return chain.wish.age && ((chain.forgotten == 0 && std::ranges::none_of(chain.paths, is_judged)) ||
                            chain.silent_ns > 0 || chain.forgotten_late > 0 ||
                            std::ranges::any_of(chain.paths, [](const auto& path) { return path.late > 0; }));
}

std::string text_of(const listen::Chain& chain) {
  const auto& limit = chain.wish.age;
  auto text = table::wrapped(table::printable(chain.wish.name()) +
                                 (limit ? fmt::format(" within {} ms", in_ms(limit->count())) : ""),
                             text_width);
  for (const auto& path : chain.paths) text += text_of(chain, path);
  if (came_out(chain) == 0) text += "  no message arrived\n";
  return text + remarks_of(chain);
}

ordered_json json_of(const listen::Chain& chain) {
  ordered_json json{{"topics", ordered_json::array()},
                    {"age_limit_ns", chain.wish.age ? ordered_json(chain.wish.age->count()) : ordered_json()},
                    {"published", chain.begun},
                    {"came_out", came_out(chain)},
                    {"silent_ns", chain.silent_ns},
                    {"paths", ordered_json::array()},
                    {"forgotten", {{"messages", chain.forgotten}, {"late", chain.forgotten_late}}}};
  for (std::size_t topic = 0; topic < chain.wish.steps.size(); ++topic) {
    const bool is_last = topic + 1 == chain.wish.steps.size();
    json["topics"].push_back(
        {{"topic", chain.wish.steps[topic].topic},
         {"of_latest", chain.wish.steps[topic].is_of_latest},
         {"not_taken", chain.ended[2 * topic]},
         {"not_published_on", is_last ? ordered_json() : ordered_json(chain.ended[2 * topic + 1])},
         {"without_take", topic == 0 ? ordered_json() : ordered_json(chain.without_take[topic])},
         {"unknown_takes", chain.unknown_takes[topic]}});
  }
  for (const auto& path : chain.paths) {
    ordered_json of_path{{"processes", ordered_json::array()},
                         {"age", json_of(path.age)},
                         {"late", path.late},
                         {"not_judged", path.not_judged},
                         {"parts", ordered_json::array()}};
    for (const auto& party : path.parties) of_path["processes"].push_back(json_of(party));
    for (const auto& part : path.parts) {
      of_path["parts"].push_back(json_of(part));
      of_path["parts"].back()["share"] = path.age.sum_ns() > 0 ? part.sum_ns() / path.age.sum_ns() : 0;
    }
    json["paths"].push_back(std::move(of_path));
  }
  return json;
}

std::vector<listen::Flow> flows_of(const listen::Chain& chain) {
  std::vector<listen::Flow> flows;
  for (const auto& path : chain.paths) {
    listen::Flow flow;
    flow.id = path.id;
    flow.topic = chain.wish.name();
    flow.writer = path.parties.front();
    flow.reader = path.parties.back();
    flow.messages = path.age.count() + path.not_judged;
    flow.not_judged = path.not_judged;
    flow.last_ns = path.last_ns;
    flow.age = path.age;
    flow.between.assign(path.parties.begin() + 1, path.parties.end() - 1);
    flow.chain_limit = chain.wish.age;
    flow.late = path.late;
    flows.push_back(std::move(flow));
  }
  return flows;
}

}  // namespace ontime::app
