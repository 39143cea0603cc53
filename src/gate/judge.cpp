// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "gate/gate.hpp"

namespace ontime::gate {
namespace {

using nlohmann::json;
using record::at;
using statistics::Answer;
using statistics::Figure;
using statistics::Interval;
using statistics::Summary;
using Result = Judgement::Result;

std::string text_of(const json& value) { return value.is_string() ? value.get<std::string>() : ""; }

bool is_share(const Gate& gate) { return gate.figure == Figure::late || gate.figure == Figure::lost; }

std::string value_of(const Gate& gate, double value) {
  return is_share(gate) ? fmt::format("{:.4g} %", value * 100) : time_of(value);
}

std::string figure_of(const Gate& gate) {
  auto figure = gate.text.substr(0, gate.text.find_first_of("<>"));
  figure.erase(figure.find_last_not_of(" \t") + 1);
  return figure.erase(0, figure.find_first_not_of(" \t"));
}

template <class Text>
std::string lies(const Interval& interval, Text text) {
  if (interval.low && interval.high)
    return fmt::format("between {} and {}", text(*interval.low), text(*interval.high));
  if (interval.low) return fmt::format("above {}", text(*interval.low));
  if (interval.high) return fmt::format("below {}", text(*interval.high));
  return "anywhere";
}

constexpr const char* nothing_answered = "nothing was answered";
constexpr const char* too_few = "too few messages to tell: measure longer";

Judgement judgement(const Gate& gate, std::string run, Result result, std::string says) {
  return {result, std::move(run), gate.text, std::move(says)};
}

const statistics::Probability& probability_of(const Gate& gate, const Summary& run) {
  if (gate.figure == Figure::lost) return run.lost_probability;
  return gate.times == statistics::Times::response ? run.late_by_response_probability : run.late_probability;
}

// So short that it could not have shown that it keeps to the limit. Where nothing is known to come in bursts
// that hangs on the number of messages alone: what a run can hold is not left to chance.
bool is_too_short(const Gate& gate, const Summary& run, const statistics::Measured& found) {
  if (!is_share(gate)) return !found.surer.high;
  const auto& probability = probability_of(gate, run);
  return static_cast<double>(probability.messages) <
         statistics::messages_to_claim(gate.limit, probability.events == 0 ? 1 : probability.effect);
}

// A sender that stood still has sent nothing that could be late.
Judgement unless_it_stood_still(Judgement judged, const Gate& gate, const Summary& run) {
  if (judged.result != Result::held || gate.figure == Figure::lost ||
      gate.times != statistics::Times::round_trip)
    return judged;
  const auto waited = run.late_by_response.value_or(0);
  if (waited <= run.late + run.lost) return judged;
  judged.is_sure = false;
  judged.says += fmt::format("; but {} of {} cycles had no answer in time (response {})", waited,
                             run.sent + run.skipped_cycles, figure_of(gate));
  return judged;
}

Judgement judge_count(const Gate& gate, const Summary& run) {
  const bool by_response = gate.times == statistics::Times::response;
  const auto late = by_response ? run.late_by_response : std::optional(run.late);
  const auto count = gate.figure == Figure::lost ? std::optional(run.lost) : late;
  if (!count)
    return judgement(gate, name_of(run), Result::cannot_judge, "its record does not say its deadline");
  return unless_it_stood_still(
      judgement(gate, name_of(run), static_cast<double>(*count) > gate.limit ? Result::missed : Result::held,
                by_response ? fmt::format("{} of {} cycles", *count, run.sent + run.skipped_cycles)
                            : fmt::format("{} of {} messages", *count, run.sent)),
      gate, run);
}

// What the answer to "is the limit passed" makes of a gate.
Judgement judge_answer(const Gate& gate, std::string run, Answer answer, const std::string& says) {
  if (answer == Answer::yes) return judgement(gate, std::move(run), Result::missed, says);
  auto held = judgement(gate, std::move(run), Result::held, says);
  held.is_sure = answer == Answer::no;
  if (!held.is_sure) held.says += "; whether that passes the limit cannot be told";
  return held;
}

}  // namespace

std::string time_of(double ns) {
  const double size = std::abs(ns);
  if (size >= 1e9) return fmt::format("{:.4g} s", ns / 1e9);
  if (size >= 1e6) return fmt::format("{:.4g} ms", ns / 1e6);
  return fmt::format("{:.4g} µs", ns / 1e3);
}

std::string absent(const json& asked, const json& outcome) {
  const auto& hosts = at(outcome, "hosts");
  for (const auto* host : {"controller", "component"})
    if (at(at(hosts, host), "load_running") == false)
      return fmt::format("the load on the {} had died by the end", host);
  for (const auto* host : {"controller", "component"})
    for (const auto& set : at(at(hosts, host), "kernel"))
      if (set.is_object() && at(set, "now") != at(set, "after"))
        return fmt::format("kernel.{} was not as it was asked for to the end, on the {}",
                           text_of(at(set, "setting")), host);
  for (const auto* host : {"controller", "component"})
    for (const auto& made : at(at(hosts, host), "isolation"))
      if (made.is_object() && at(made, "now") != at(made, "after"))
        return fmt::format("the CPUs and limits that were asked for were not there to the end, on the {}",
                           host);
  if (!at(asked, "link").is_null())
    for (const auto* host : {"controller", "component"})
      if (at(at(at(hosts, host), "link"), "gone").is_string())
        return fmt::format("the link's faults need not have been there to the end, at the {}", host);
  for (const auto* way : {"to_component", "to_controller"})
    for (const auto* beside : {"traffic", "neighbours"})
      if (at(at(at(outcome, beside), way), "short") == true)
        return fmt::format("the {} that {} asked for {} not there", beside,
                           beside == std::string_view("traffic") ? "was" : "were",
                           beside == std::string_view("traffic") ? "was" : "were");
  return "";
}

// It may come from a file that somebody else wrote: what is not there, or is something else, is null.
bool ends_search(const json& asked, const json& outcome) {
  if (at(outcome, "interrupted") == true) return false;
  if (!at(outcome, "error").is_null()) {
    const auto& step = at(at(asked, "search"), "step");
    return at(outcome, "unanswered") == true && step.is_number() && step > 0;
  }
  for (const auto* counter : {"late", "lost", "skipped_cycles", "dropped_records"})
    if (const auto& count = at(outcome, counter); !count.is_null() && count != 0) return true;
  return at(outcome, "sent") == 0 || !absent(asked, outcome).empty();
}

std::string unfit(const Summary& run) {
  if (run.imported) return "it was imported, and has no messages";
  if (!statistics::is_complete(run.run)) {
    const auto error = text_of(at(run.run.outcome, "error"));
    return error.empty() ? "it was not measured to its end" : "it failed: " + error;
  }
  if (const auto missing = statistics::unrecorded(run.run); missing > 0)
    return fmt::format("{} of its samples were not recorded", missing);
  if (run.sent == 0) return "nothing was sent";
  return absent(run.run.asked, run.run.outcome);
}

bool is_superseded(const Summary& run, std::span<const Summary> all) {
  if (statistics::is_complete(run.run) || run.run.key.empty()) return false;
  return std::any_of(all.begin(), all.end(), [&](const Summary& other) {
    return other.run.number > run.run.number && other.run.key == run.run.key &&
           at(other.run.asked, "repetition") == at(run.run.asked, "repetition");
  });
}

std::string name_of(const Summary& run) {
  auto name = name_of(Runs{&run});
  if (const auto& repetition = at(run.run.asked, "repetition");
      repetition.is_number_integer() && repetition > 1)
    name += fmt::format(" ×{}", repetition.dump());
  return fmt::format("{} (run {})", name, run.run.number);
}

std::string name_of(const Runs& runs) {
  const auto& asked = runs.front()->run.asked;
  const auto id = text_of(at(asked, "id"));
  auto name = fmt::format("{:.{}}", id, longest_id);
  if (name.size() < id.size()) name += "…";
  for (const auto* key : {"variant", "transport"})
    if (const auto word = text_of(at(asked, key)); !word.empty()) name += " " + word;
  if (const auto others = text_of(at(asked, "beside")); !others.empty()) name += " beside " + others;
  return name;
}

const char* word_of(Result result) {
  return result == Result::held ? "held" : result == Result::missed ? "missed" : "cannot judge";
}

std::string text_of(const Judgement& judgement) {
  return fmt::format("{}: {} ({}): {}", word_of(judgement.result), judgement.gate, judgement.run,
                     judgement.says);
}

Judgement judge_end(const Summary& run) {
  const bool complete = statistics::is_complete(run.run);
  return {complete ? Result::held : Result::cannot_judge, name_of(run), end, complete ? "" : unfit(run)};
}

Judgement judge(const Gate& gate, const Summary& run) {
  if (const auto why = unfit(run); !why.empty())
    return judgement(gate, name_of(run), Result::cannot_judge, why);
  if (gate.kind == Gate::Limit::count) return judge_count(gate, run);
  const auto found = statistics::measured(run, gate.times, gate.figure);
  if (!found) return judgement(gate, name_of(run), Result::cannot_judge, nothing_answered);
  auto says = fmt::format("{} is {}", figure_of(gate), value_of(gate, found->value));
  if (gate.figure == Figure::max)
    return unless_it_stood_still(
        judgement(gate, name_of(run), found->value > gate.limit ? Result::missed : Result::held, says), gate,
        run);
  says += fmt::format(", surely {}", lies(found->surer, [&](double value) { return value_of(gate, value); }));
  const auto answer = statistics::exceeds(*found, gate.limit);
  if (answer == Answer::cannot_tell && is_too_short(gate, run, *found))
    return judgement(gate, name_of(run), Result::cannot_judge, says + ": " + too_few);
  return unless_it_stood_still(judge_answer(gate, name_of(run), answer, says), gate, run);
}

std::vector<Judgement> judge_required(const Summary& run) {
  std::vector<Judgement> judgements;
  const auto& required = at(run.run.asked, "require");
  if (required.is_null()) return judgements;
  for (const auto& text : required.is_array() ? required : json::array({required})) {
    try {
      judgements.push_back(judge(parse(text_of(text), Use::require), run));
    } catch (const Error& error) {  // of a version to come, or somebody else's file
      judgements.push_back({Result::cannot_judge, name_of(run),
                            text.dump(-1, ' ', true, json::error_handler_t::replace), error.what()});
    }
  }
  return judgements;
}

Judgement judge(const Gate& gate, const Runs& from, const Runs& to) {
  const auto name = name_of(to);
  for (const auto* runs : {&from, &to})
    for (const auto* run : *runs) {
      auto why = unfit(*run);
      if (why.empty() && !statistics::measured(*run, gate.times, gate.figure)) why = nothing_answered;
      if (!why.empty())
        return judgement(gate, name, Result::cannot_judge,
                         fmt::format("{} of {}: {}", name_of(*run), runs == &from ? "A" : "B", why));
    }
  const auto change = *statistics::change(from, to, gate.times, gate.figure);
  const auto figure = figure_of(gate);
  auto says =
      fmt::format("{} went from {} to {}", figure, value_of(gate, change.from), value_of(gate, change.to));
  if (!change.difference_lies.low)  // that it is worse could never be told
    return judgement(gate, name, Result::cannot_judge, says + ": " + too_few);
  if (gate.kind == Gate::Limit::difference) {
    says += fmt::format(", surely by {}", lies(change.difference_lies, [&](double value) {
                          return (value < 0 ? "" : "+") + value_of(gate, value);
                        }));
    return judge_answer(gate, name, statistics::difference_exceeds(change, gate.limit), says);
  }
  if (!change.ratio) {  // of nothing, of which any more is infinitely more; or in some of the repetitions of
                        // nothing
    const bool worse = change.verdict == statistics::Verdict::worse;
    const bool passes = change.to > change.from * gate.limit;
    return judge_answer(gate, name,
                        passes && worse ? Answer::yes
                        : passes        ? Answer::cannot_tell
                                        : Answer::no,
                        says);
  }
  says += fmt::format(
      " ({:+.3g} %), surely {}", (*change.ratio - 1) * 100,
      lies(change.ratio_lies, [](double ratio) { return fmt::format("{:+.3g} %", (ratio - 1) * 100); }));
  return judge_answer(gate, name, statistics::ratio_exceeds(change, gate.limit), says);
}

}  // namespace ontime::gate
