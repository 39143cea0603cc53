// SPDX-License-Identifier: Apache-2.0
// What searches found: the greatest value of a key without a miss.
#include <algorithm>
#include <cmath>
#include <map>
#include <tuple>
#include <utility>

#include <fmt/format.h>

#include "gate/gate.hpp"
#include "report/conditions.hpp"
#include "report/runs.hpp"
#include "report/words.hpp"

namespace ontime::report {
namespace {

// The runs of one value.
struct Step {
  std::string value;
  std::uint64_t messages = 0, late = 0, lost = 0, skipped_cycles = 0, late_by_response = 0;
  double effect = 1;          // the greatest design effect of its runs
  bool ended = false;         // one of them ended the search: by a count above or a reason below
  bool failed = false;        // no answer came
  bool is_short = false;      // background topics or traffic below what was requested
  std::string unfit;          // another reason why it was not measured as requested
  bool says_nothing = false;  // interrupted, or it failed for another reason than its value
};

struct Found {
  const record::Asked* asked;  // of its first run
  int time = 1;                // that it is searched: 2 for the second one of a file
  // Of each step and repetition the last run: after --resume that one counts.
  std::map<std::pair<int, int>, const Summary*> runs{};
  std::map<int, Step> steps{};
  const Step *passed = nullptr, *ended = nullptr;
  bool finished = false;                   // they are next to one another, or nothing is beyond
  const Step* ended_by_another = nullptr;  // component that is searched at the same time

  std::string key() const { return word(asked->step.key); }
  std::string transport() const { return word(asked->task.transport); }
  // The component, and the other varied values.
  std::string among() const {
    std::vector<std::string> parts;
    for (const auto& text : {conditions::is_named(*asked) ? asked->component : "", asked->step.among})
      if (!text.empty()) parts.push_back(word(text));
    return join(parts, ", ");
  }
  std::string whose() const {
    const auto more = among();
    return transport() + (more.empty() ? "" : " " + more);
  }
};

// Of all components.
bool is_same_search(const record::Asked& one, const record::Asked& other) {
  const auto of = [](const record::Asked& asked) {
    return std::tie(asked.id, asked.task.transport, asked.step.among, asked.step.key);
  };
  return of(one) == of(other);
}

bool any_short(const record::Outcome& outcome) {
  const auto is_short = [](const auto& way) { return way.second.is_short == true; };
  return std::ranges::any_of(outcome.background, is_short) || std::ranges::any_of(outcome.traffic, is_short);
}

void add(Step& step, const Summary& summary) {
  const auto& outcome = summary.run.outcome;
  step.value = word(summary.run.asked.step.value);
  const bool ends = gate::ends_search(summary.run.asked, outcome);
  if (!ends && !statistics::is_complete(summary.run)) {
    step.says_nothing = true;
    return;
  }
  step.ended = step.ended || ends;
  step.messages += summary.sent;
  step.late += summary.late;
  step.lost += summary.lost;
  step.skipped_cycles += summary.skipped_cycles;
  step.late_by_response += outcome.late_by_response_only;
  step.effect = std::max(step.effect, summary.missed_probability.effect);
  step.failed = step.failed || outcome.error;
  step.is_short = step.is_short || any_short(outcome);
  if (!step.failed && !step.is_short && step.unfit.empty() && gate::flaw_of(summary) != gate::Flaw::denied)
    step.unfit = gate::unfit(summary);  // what is denied is denied to every step
}

std::vector<Found> found(const Group& group) {
  std::vector<Found> all;
  for (const auto* summary : group) {
    const auto& asked = summary->run.asked;
    if (asked.step.key.empty()) continue;
    constexpr std::pair first{0, 1};
    const std::pair run{asked.step.number, asked.repetition};
    auto one = std::find_if(all.rbegin(), all.rend(), [&](const Found& known) {
      return is_same_search(*known.asked, asked) && known.asked->component == asked.component;
    });
    // The first run measured again begins another search.
    const bool is_new = one == all.rend();
    if (is_new ||
        (run == first && one->runs.contains(first) && statistics::is_complete(one->runs.at(first)->run))) {
      all.push_back({.asked = &asked, .time = is_new ? 1 : one->time + 1});
      one = all.rbegin();
    }
    one->runs[run] = summary;
  }
  for (auto& one : all) {
    for (const auto& [run, summary] : one.runs) add(one.steps[run.first], *summary);
    int passed = -1, ended = one.asked->step.of;
    for (const auto& [number, step] : one.steps) {
      if (step.ended) {
        one.ended = &step;
        ended = number;
        break;
      }
      if (step.says_nothing) continue;
      one.passed = &step;
      passed = number;
    }
    one.finished = passed + 1 == ended;
  }
  // A miss of one component ends the search of all.
  for (const auto& other : all)
    for (auto& one : all)
      if (other.finished && other.ended != nullptr && one.ended == nullptr && other.time == one.time &&
          is_same_search(*other.asked, *one.asked)) {
        one.finished = true;
        one.ended_by_another = other.ended;
      }
  return all;
}

// Upper limit of the miss probability, with 95 % confidence, after this many messages without a miss. Each
// tried value may have had none by chance (Bonferroni).
std::optional<double> bound_of(const Found& of) {
  if (of.passed == nullptr || of.passed->messages == 0) return {};
  return -std::expm1(std::log(0.05 / static_cast<double>(of.steps.size())) * of.passed->effect /
                     static_cast<double>(of.passed->messages));
}

std::string why(const Step& step) {
  std::vector<std::string> parts;
  if (step.late > 0) parts.push_back(fmt::format("{} late", grouped(step.late)));
  if (step.lost > 0) parts.push_back(fmt::format("{} lost", grouped(step.lost)));
  if (step.skipped_cycles > 0) parts.push_back(many(step.skipped_cycles, "skipped cycle", "skipped cycles"));
  if (step.late_by_response > 0)
    parts.push_back(fmt::format("{} late by response time", grouped(step.late_by_response)));
  if (!parts.empty()) parts = {join(parts, ", ") + " of " + many(step.messages, "message", "messages")};
  if (step.failed) parts.emplace_back("no answer from the server in time");
  if (!step.unfit.empty()) parts.push_back(step.unfit);
  if (step.is_short) parts.emplace_back("background load below the requested load");
  return join(parts, "; ");
}

std::string because(const Found& one) {
  const std::string unfinished = "search not finished";
  if (one.ended_by_another != nullptr) return "another component";
  if (one.ended == nullptr) return one.finished ? nothing : unfinished;
  return why(*one.ended) + (one.finished ? "" : "; " + unfinished);
}

ordered_json json_of(const Step* step) {
  if (step == nullptr) return nullptr;
  return {{"value", step->value},
          {"messages", step->messages},
          {"late", step->late},
          {"lost", step->lost},
          {"skipped_cycles", step->skipped_cycles},
          {"late_by_response_only", step->late_by_response},
          {"failed", step->failed},
          {"unfit", or_null(step->unfit)},
          {"short", step->is_short}};
}

}  // namespace

Table searches_table(const Group& group) {
  using enum Column::Align;
  Table table{"", "", {}, {}, {}};
  std::vector<std::string> keys;
  for (const auto& one : found(group)) {
    add_once(keys, one.key());
    const auto bound = bound_of(one);
    table.rows.push_back(
        {one.whose(), one.passed == nullptr ? "none" : one.passed->value,
         one.passed == nullptr ? nothing : grouped(one.passed->messages),
         bound ? fmt::format("< {} %", table::percent(*bound, 2, table::Limit::high)) : nothing,
         one.ended != nullptr              ? one.ended->value
         : one.ended_by_another != nullptr ? one.ended_by_another->value
         : one.finished                    ? "none"
                                           : nothing,
         because(one)});
  }
  if (table.rows.empty()) return table;
  table.title = fmt::format("highest {} without a miss", join(keys, ", "));
  table.columns = {{"", left},           {"No miss\nat", right},
                   {"Messages", right},  {"Miss\nprobability", right},
                   {"Ended\nat", right}, {"Because", left}};
  table.notes.emplace_back(
      "Miss: a message that is lost, or late by round trip or response time, or a cycle without a message; "
      "several in a row are one here. Miss probability: upper limit, 95 % confidence; it counts that several "
      "values were tried.");
  return table;
}

std::string searches_sentence_of(const Summaries& summaries) {
  constexpr std::size_t most = 3;
  const auto all = found(last_of(summaries));
  if (all.empty()) return "";
  std::vector<std::string> keys, values;
  for (const auto& one : all) {
    add_once(keys, one.key());
    if (values.size() == most) continue;
    const auto of = all.size() == 1 ? "" : id_of(*one.asked) + " " + one.whose() + " ";
    values.push_back(of + (one.passed == nullptr ? "none" : one.passed->value) +
                     (one.finished ? "" : " (search not finished)"));
  }
  const auto more = all.size() > most ? fmt::format(" and {}", many(all.size() - most, "more", "more")) : "";
  return fmt::format(" Highest {} without a miss: {}{}.", join(keys, ", "), join(values, ", "), more);
}

ordered_json searches_json_of(const Summaries& summaries) {
  return array_of(found(all_of(summaries)), [](const Found& one) -> ordered_json {
    return {{"id", id_of(*one.asked)},       {"transport", one.transport()},
            {"among", one.among()},          {"key", one.key()},
            {"passed", json_of(one.passed)}, {"missed_below", or_null(bound_of(one))},
            {"ended", json_of(one.ended)},   {"finished", one.finished}};
  });
}

}  // namespace ontime::report
