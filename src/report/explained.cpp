// SPDX-License-Identifier: Apache-2.0
#include "report/explained.hpp"

#include <algorithm>
#include <map>
#include <set>
#include <string_view>
#include <utility>

#include <fmt/format.h>

#include "report/runs.hpp"
#include "report/words.hpp"

namespace ontime::report {
namespace {

using explain::Account;
using explain::Cause;
using explain::Group;
using explain::Message;
using explain::Part;

constexpr std::int64_t worth_naming_ns = 20'000;  // of a message that was on time

std::string of_the_delay(const Group& group) {
  if (group.most_ns == 0) return "";
  const auto least = span_of(group.least_ns), most = span_of(group.most_ns);
  return least == most ? ": " + most : fmt::format(": {} to {}", least, most);
}

// Text and Markdown differ in how a list is written.
struct Marks {
  const char *heading, *item, *below;
};
Marks marks_of(Format format) {
  return format == Format::markdown ? Marks{"**", "- ", "  - "} : Marks{"", "  ", "       → "};
}

std::string name_of(const Explained& one) {
  const auto& asked = one.run.asked;
  if (asked.is_listened())
    return fmt::format("run {}, {} ({})", one.run.number, word(asked.id), word(asked.variant));
  return fmt::format("run {}, {} ({}{})", one.run.number, word(asked.id), word(asked.task.transport),
                     conditions::is_named(asked) ? ", component " + word(asked.component) : "");
}

// What `ontime listen` found out while it ran.
constexpr std::size_t most_told = 20;
bool is_cause(const record::Note& note) { return note.kind == record::cause_of_late; }

// Late messages of `ontime listen` without a cause in the file.
struct WithoutCause {
  std::uint64_t not_seen = 0, no_space = 0, not_examined = 0;
  std::uint64_t unknown = 0;  // which of the three: the file has no counts
};
WithoutCause without_cause(const Explained& one) {
  WithoutCause counts;
  auto left = one.account.late;
  const auto take = [&](std::uint64_t count) {
    const auto taken = std::min(count, left);
    left -= taken;
    return taken;
  };
  const auto count = [&](const char* kind) {
    return static_cast<std::uint64_t>(std::ranges::count(one.notes, kind, &record::Note::kind));
  };
  const auto noted = take(count(record::cause_of_late));
  const auto examined = one.run.outcome.causes.value_or(record::Causes());
  counts.not_seen = take(std::max(examined.not_seen, count(record::cause_not_seen)));
  counts.no_space = take(examined.seen - std::min(examined.seen, noted));
  (one.run.outcome.causes ? counts.not_examined : counts.unknown) = left;
  return counts;
}

// The blanks of commands, so that a command can be copied from one line.
constexpr const char* blank_of_command = "\u00a0";

std::string with_whole_commands(const std::string& text) {
  std::string whole;
  bool is_command = false;
  for (std::size_t i = 0; i < text.size(); ++i) {
    is_command = text.compare(i, 6, "(chrt ") == 0 || (is_command && text[i] != ')');
    whole += is_command && text[i] == ' ' ? blank_of_command : std::string(1, text[i]);
  }
  return whole;
}

std::string text_of(const SameCause& same, const Marks& marks) {
  const auto* const first = same.notes.front();
  auto lines = fmt::format("{}{:>4}  {}", marks.item, same.notes.size(), printable(same.text));
  if (first->message)
    lines += fmt::format("; {}message {}", same.notes.size() > 1 ? "first: " : "", *first->message);
  if (first->cause && !first->cause->date.empty()) lines += "; " + printable(first->cause->date);
  lines += "\n";
  if (!same.fix.empty())
    lines += fmt::format("{}{}\n", marks.below, with_whole_commands(printable(same.fix)));
  return lines;
}

std::string text_of_listened(const Explained& one, const Marks& marks) {
  std::vector<const record::Note*> told;
  for (const auto& note : one.notes)
    if (record::tells_of_late(note)) told.push_back(&note);
  if (one.account.late == 0)
    return fmt::format("{0}{1}: no message was late{0}\n", marks.heading, name_of(one));
  const auto are_counts_old = one.account.late > one.run.outcome.counters.late;  // of a file that is written
  if (told.empty() && !one.run.outcome.causes && !(one.run.asked.keeps_worst() && are_counts_old)) {
    const auto& words = one.run.asked.command_line;
    const bool is_recording = words.size() > 1 && words[1] == "import";
    return fmt::format("{0}{1}: causes unknown: {2}{0}\n", marks.heading, name_of(one),
                       is_recording ? "a recording has no kernel events"
                                    : "`listen` finds causes only as root, without --no-explain, while no "
                                      "other ontime traces");
  }
  const auto causes_told = std::ranges::count_if(told, [](const auto* note) { return is_cause(*note); });
  auto text = fmt::format("{}{}: {}{}", marks.heading, name_of(one),
                          causes_told > 0 ? fmt::format("causes of {} of ", causes_told) : "",
                          many(one.account.late, "late message", "late messages"));
  const auto without = without_cause(one);
  for (const auto& [words, count] : {std::pair("cause not seen", without.not_seen),
                                     {"no space in the file for the cause", without.no_space},
                                     {"not examined", without.not_examined},
                                     {"cause not seen or not recorded", without.unknown}})
    if (count > 0) text += fmt::format("; {}: {}", words, grouped(count));
  text += fmt::format("{}\n", marks.heading);
  if (*marks.heading != '\0') text += "\n";
  const auto causes = same_causes_of(told);
  for (std::size_t i = 0; i < std::min(most_told, causes.size()); ++i) text += text_of(causes[i], marks);
  if (causes.size() > most_told)
    text += fmt::format("{}… and {} (--format json has all)\n", marks.item,
                        many(causes.size() - most_told, "more cause", "more causes"));
  return text;
}

constexpr const char* untraced = "causes unknown: measured without `explain: on`";
bool is_untraced(const Explained& one) {
  return !one.run.asked.is_listened() && !one.run.asked.explain && !one.account.traced;
}
std::string why_untraced(const Explained& one) {
  if (!one.run.asked.explain) return untraced;
  const auto& error = one.run.outcome.error;
  return error ? "failed: " + word(*error) : "causes unknown: no kernel events were recorded";
}

// A line of a list of causes.
struct Listed {
  Group group;
  std::string more, remedy;
};
// Causes with the same remedy stand together, above it. It is left out if it was told before, of all of them.
std::string text_of(const std::vector<Listed>& causes, const std::vector<Listed>& told, const Marks& marks) {
  const auto is_told = [&](const Listed* cause) {
    return std::ranges::any_of(told, [&](const Listed& one) {
      return one.remedy == cause->remedy && explain::same_cause(one.group.culprit, cause->group.culprit);
    });
  };
  std::vector<std::pair<std::string, std::vector<const Listed*>>> blocks;
  for (const auto& cause : causes) entry_of(blocks, cause.remedy).push_back(&cause);
  std::ranges::stable_sort(blocks, std::ranges::greater(), [](const auto& block) {
    std::size_t messages = 0;
    for (const auto* cause : block.second) messages += cause->group.messages;
    return messages;
  });
  std::string text;
  for (const auto& [remedy, of] : blocks) {
    for (const auto* cause : of)
      text += fmt::format("{}{:>4}  {}{}\n", marks.item, cause->group.messages, sentence_of(cause->group),
                          cause->more);
    if (!remedy.empty() && !std::ranges::all_of(of, is_told))
      text += fmt::format("{}{}{}\n", marks.below,
                          of.size() == 1 ? "" : fmt::format("for these {} causes: ", of.size()),
                          printable(remedy));
  }
  return text;
}

// A cause in several runs.
struct Across {
  Group group;
  std::set<std::string> remedies;  // a run's own settings may need another one
  std::size_t runs = 0;
};
std::vector<Across> across(const std::vector<Explained>& all) {
  std::vector<Across> causes;
  for (const auto& one : all)
    for (const auto& group : one.account.groups) {
      auto found = std::ranges::find_if(causes, [&](const Across& cause) {
        return explain::same_cause(cause.group.culprit, group.culprit);
      });
      if (found == causes.end()) {
        found = causes.insert(causes.end(), {group, {}, 0});
        found->group.messages = 0;
      }
      auto& sum = found->group;
      sum.messages += group.messages;
      sum.threads = std::max(sum.threads, group.threads);
      sum.least_ns = std::min(sum.least_ns, group.least_ns);
      sum.most_ns = std::max(sum.most_ns, group.most_ns);
      found->remedies.insert(explain::text_of(group.remedy));
      ++found->runs;
    }
  std::ranges::stable_sort(causes, std::ranges::greater(),
                           [](const Across& cause) { return cause.group.messages; });
  return causes;
}

constexpr std::size_t most_across = 10;
// The causes of all runs come first; "" if fewer than two runs have a cause. `told` gets those that it lists.
std::string text_of_all(const std::vector<Explained>& all, const Marks& marks, std::vector<Listed>& told) {
  const auto runs = std::ranges::count_if(all, [](const auto& one) { return !one.account.groups.empty(); });
  if (runs < 2) return "";
  const auto causes = across(all);
  auto text = fmt::format("{0}Causes of late or lost messages in {1} runs:{0}\n", marks.heading, runs);
  if (*marks.heading != '\0') text += "\n";
  for (std::size_t i = 0; i < std::min(most_across, causes.size()); ++i) {
    const auto& [group, remedies, in] = causes[i];
    told.push_back({group, fmt::format(" ({})", many(in, "run", "runs")),
                    remedies.size() == 1 ? *remedies.begin() : ""});
  }
  text += text_of(told, {}, marks);
  if (causes.size() > most_across)
    text += fmt::format("{}… and {}, see each run\n", marks.item,
                        many(causes.size() - most_across, "more cause", "more causes"));
  return text;
}

// Without remedies that were told before of the same causes.
std::string text_of(const Explained& one, const Marks& marks, const std::vector<Listed>& told) {
  if (one.run.asked.is_listened()) return text_of_listened(one, marks);
  const auto& account = one.account;
  const auto heading = [&](const std::string& rest) {
    return fmt::format("{0}{1}: {2}{0}\n", marks.heading, name_of(one), rest);
  };
  if (!account.traced) return heading(why_untraced(one));
  const auto faults = faults_of(account);
  auto text = heading(faults.empty() ? "nothing was late or lost" : faults + ". Why:");
  if (faults.empty() && account.limits.empty() && account.messages.empty() &&
      one.run.outcome.counters.skipped_cycles == 0)
    return text;
  if (*marks.heading != '\0') text += "\n";
  std::vector<Listed> listed;
  for (const auto& group : account.groups) listed.push_back({group, "", explain::text_of(group.remedy)});
  text += text_of(listed, told, marks);
  if (const auto skipped = one.run.outcome.counters.skipped_cycles; skipped > 0)
    text += fmt::format("{}{}: ping still waited for an answer, or woke up too late\n", marks.item,
                        many(skipped, "cycle was skipped", "cycles were skipped"));
  const auto slowest = std::ranges::find_if(
      account.messages, [](const Message& message) { return !message.is_fault() && !message.parts.empty(); });
  if (slowest != account.messages.end() && slowest->parts.front().ns >= worth_naming_ns &&
      slowest->parts.front().cause != Cause::unknown)
    text += fmt::format("{}slowest on time, message {}: {}, {} of {}\n", marks.item, slowest->sample.index,
                        printable(explain::sentence_of(slowest->parts.front())),
                        span_of(slowest->parts.front().ns), span_of(slowest->delay_ns));
  for (const auto& limit : account.limits) text += fmt::format("{}{}\n", marks.item, printable(limit));
  return text;
}

std::string text_of(const Explained& one, const Message& message, const Marks& marks) {
  auto text =
      fmt::format("{0}{1}, message {2} ({3}){4}{0}\n", marks.heading, name_of(one), message.sample.index,
                  word_of(message), message.delay_ns == 0 ? "" : ": delayed by " + span_of(message.delay_ns));
  if (*marks.heading != '\0') text += "\n";
  for (const auto& part : message.parts) {
    text += fmt::format("{}{:>8}  {:<9}  {}\n", marks.item, part.ns == 0 ? "" : span_of(part.ns),
                        explain::word_of(part.stage), printable(explain::sentence_of(part)));
  }
  if (!message.parts.empty())
    if (const auto remedy = explain::text_of(explain::remedy_for(message.parts.front(), one.run));
        !remedy.empty())
      text += fmt::format("{}{}\n", marks.below, printable(remedy));
  if (!message.whole) text += fmt::format("{}some kernel events around it are missing\n", marks.item);
  return text;
}

// Breaks long lines between words; they go on below the text of their item. Viewers of Markdown do so
// themselves.
std::string fitted(std::string text, Format format, std::size_t columns) {
  if (format == Format::markdown) return text;
  constexpr std::size_t items_end = 24;  // the last column where an item's text begins
  constexpr std::string_view arrow = "→ ";
  std::string lines;
  text.pop_back();  // the newline after the last line
  for (const auto& line : split(text, '\n')) {
    if (width_of(line) <= columns) {
      lines += line + "\n";
      continue;
    }
    auto at = line.find_first_not_of(' ');
    if (const auto gap = line.rfind("  ", items_end); gap != line.npos && gap >= at)
      at = line.find_first_not_of(' ', gap);
    if (at == line.npos) {  // blanks alone
      lines += line + "\n";
      continue;
    }
    if (line.compare(at, arrow.size(), arrow) == 0) at += arrow.size();
    const auto head = line.substr(0, at);
    lines +=
        wrapped(line.substr(at), columns, std::string(width_of(head), ' ')).replace(0, width_of(head), head);
  }
  return lines;
}

ordered_json json_of(const Part& part) {
  return {{"cause", explain::word_of(part.cause)},
          {"stage", explain::word_of(part.stage)},
          {"end", part.end},
          {"thread", part.thread},
          {"via", printable(part.via)},
          {"culprit", printable(part.culprit)},
          {"us", static_cast<double>(part.ns) / 1e3}};
}

ordered_json json_of(const Message& message) {
  return {{"message", message.sample.index},
          {"fate", message.late_by_response ? "late by response" : word_of(message.sample.fate)},
          {"delay_us", static_cast<double>(message.delay_ns) / 1e3},
          {"whole", message.whole},
          {"parts", array_of(message.parts, [](const Part& part) { return json_of(part); })}};
}

ordered_json json_of(const Group& group) {
  auto result = json_of(group.culprit);
  auto settings = ordered_json::array();
  for (const auto& [key, value] : group.remedy.settings)
    settings.push_back({{"key", key}, {"value", printable(value)}});
  result.erase("us");
  result.update({{"threads", group.threads},
                 {"messages", group.messages},
                 {"least_us", static_cast<double>(group.least_ns) / 1e3},
                 {"most_us", static_cast<double>(group.most_ns) / 1e3},
                 {"says", printable(explain::sentence_of(group.culprit))},
                 {"settings", settings},
                 {"remedy", printable(explain::text_of(group.remedy))}});
  return result;
}

ordered_json json_of(const Explained& one) {
  const auto to_json = [](const auto& of) { return json_of(of); };
  auto notes = ordered_json::array();
  for (const auto& note : one.notes)
    if (record::tells_of_late(note))
      notes.push_back({{"at_ns", note.at_ns.value_or(0)}, {"text", report::text_of(note)}});
  auto without = ordered_json();
  if (one.run.asked.is_listened()) {
    const auto [not_seen, no_space, not_examined, unknown] = without_cause(one);
    without = {
        {"not_seen", not_seen}, {"no_space", no_space}, {"not_examined", not_examined}, {"unknown", unknown}};
  }
  return {{"run", one.run.number},
          {"notes", notes},
          {"without_cause", without},
          {"id", word(one.run.asked.id)},
          {"transport", word(one.run.asked.task.transport)},
          {"component", one.run.asked.stated("component")},
          {"traced", one.account.traced},
          {"late", one.account.late},
          {"lost", one.account.lost},
          {"late_by_response_only", one.account.late_by_response},
          {"late_by_response", one.account.late_by_response},  // its old name, for one version
          {"after_skipped_cycles", one.account.after_skipped},
          {"skipped_cycles", one.run.outcome.counters.skipped_cycles},
          {"causes", array_of(one.account.groups, to_json)},
          {"messages", array_of(one.account.messages, to_json)},
          {"limits", array_of(one.account.limits, [](const auto& limit) { return printable(limit); })}};
}

}  // namespace

const char* word_of(const Message& message) {
  return message.late_by_response ? "late by response time" : word_of(message.sample.fate);
}

const char* word_of(explain::State state) {
  using explain::State;
  static const std::map<State, const char*> words = {{State::ready, "ready, waits for a CPU"},
                                                     {State::comes, "comes to its CPU, which is idle"},
                                                     {State::runs, "runs"},
                                                     {State::stopped, "stopped by a signal"},
                                                     {State::traced, "stopped for a tracer"},
                                                     {State::blocked, "waits in the kernel"},
                                                     {State::gone, "gone"}};
  const auto found = words.find(state);
  return found == words.end() ? "sleeps" : found->second;
}

std::string span_of(std::int64_t ns) {
  const auto us = static_cast<double>(ns) / 1e3;
  return us < 999.5 ? fmt::format("{:.0f} µs", us) : fmt::format("{:.1f} ms", us / 1e3);
}

std::string faults_of(const Account& account) {
  if (account.late + account.lost + account.late_by_response + account.after_skipped == 0) return "";
  auto text = fmt::format("{} late, {} lost", grouped(account.late), grouped(account.lost));
  if (account.late_by_response > 0)
    text += fmt::format(", {} more late by response time", grouped(account.late_by_response));
  if (account.after_skipped > 0)
    text += fmt::format(", {} more after skipped cycles", grouped(account.after_skipped));
  return text;
}

std::string sentence_of(const explain::Group& group) {
  auto part = group.culprit;
  if (group.threads > 1) part.culprit += fmt::format(" [{} threads]", group.threads);
  return printable(explain::sentence_of(part) + of_the_delay(group));
}

std::string render_explained(const std::vector<Explained>& all, Format format, std::size_t columns) {
  if (format == Format::json)
    return json_text(array_of(all, [](const Explained& one) { return json_of(one); }));
  std::string text;
  const auto add = [&](const std::string& more) { text += (text.empty() ? "" : "\n") + more; };
  const auto marks = marks_of(format);
  std::vector<Listed> told;
  if (const auto first = text_of_all(all, marks, told); !first.empty()) add(fitted(first, format, columns));
  const auto without = std::ranges::count_if(all, is_untraced);
  for (const auto& one : all)
    if (without < 2 || !is_untraced(one))
      add(replace_all(fitted(text_of(one, marks, told), format, columns), blank_of_command, " "));
  if (without > 1)  // one sentence for all of them
    add(std::cmp_equal(without, all.size())
            ? fmt::format(
                  "None of the {} runs was measured with `explain: on`. Fix: measure with --explain\n",
                  without)
            : fmt::format("{} of the {} runs: {}\n", without, all.size(), untraced));
  return text;
}

std::string render_explained(const Explained& one, const Message& message, Format format,
                             std::size_t columns) {
  return format == Format::json ? json_of(message).dump(2) + "\n"
                                : fitted(text_of(one, message, marks_of(format)), format, columns);
}

}  // namespace ontime::report
