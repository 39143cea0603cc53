// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <string_view>

#include <fmt/format.h>

#include "gate/gate.hpp"
#include "table/table.hpp"

namespace ontime::gate {
namespace {

using nlohmann::json;
using statistics::Answer;
using statistics::Figure;
using statistics::Interval;
using statistics::Summary;
using table::grouped;
using Result = Judgement::Result;

bool is_share(const Gate& gate) { return statistics::metric_of(gate.figure).is_share; }

// In as many digits as tell it from the limit, which has those that its author gave.
std::string value_of(const Gate& gate, double value) {
  const auto text = [&](double of, int digits) {
    return is_share(gate) ? table::percent(of, digits) + " %" : time_of(of, digits);
  };
  int digits = 4;
  if (!gate.is_relative() && value != gate.limit)
    while (digits < 12 && text(value, digits) == text(gate.limit, 12)) ++digits;
  return text(value, digits);
}

std::string figure_of(const Gate& gate) {
  auto figure = gate.text.substr(0, gate.text.find_first_of("<>"));
  figure.erase(figure.find_last_not_of(" \t") + 1);
  return figure.erase(0, figure.find_first_not_of(" \t"));
}

// "98 % interval [2.5 ms, 3.5 ms]".
template <class Text>
std::string interval(const Interval& interval, Text text) {
  if (interval.low && interval.high)
    return fmt::format("98 % interval [{}, {}]", text(*interval.low), text(*interval.high));
  if (interval.low) return fmt::format("98 % interval from {}", text(*interval.low));
  if (interval.high) return fmt::format("98 % interval up to {}", text(*interval.high));
  return "no interval";
}

constexpr const char* nothing_answered = "no message was answered";
constexpr const char* too_few = "too few messages: measure longer";
constexpr const char* one_run =
    "a side of one run does not show how much runs vary. Fix: five runs a side (repeat: 5), or --single-runs";
constexpr const char* too_wide =
    "the change may be far greater, or chance. Repeat the runs more often, or measure longer";

Judgement judgement(const Gate& gate, std::string run, Result result, std::string says) {
  return {result, std::move(run), gate.requirement(), std::move(says)};
}

// What a gate on a time or a share asks of a run: that a probability is no greater than `most`. A percentile
// keeps to its limit if no more messages than it leaves above itself are slower.
struct Question {
  statistics::Between of;
  double most = 0;
};
std::optional<Question> question_of(const Gate& gate, const Summary& run) {
  if (is_share(gate)) return Question{probability_beyond(gate, run), gate.limit};
  const auto& metric = statistics::metric_of(gate.figure);
  if (metric.one_in == 0) return {};
  return Question{probability_beyond(gate, run), metric.share_above()};
}

// A run may be too short to prove that it meets the limit. Without events there is no sign of bursts: then
// only the number of messages decides, so that chance does not. Why the run is too short for that; empty: it
// is not.
std::string too_short_words(const Question& question) {
  const auto& of = question.of.at_most;
  const double needed = statistics::messages_to_claim(question.most, of.events == 0 ? 1 : of.effect);
  if (static_cast<double>(of.messages) >= needed) return "";
  return fmt::format(
      "{} too few, it takes at least {}: measure longer",
      table::many(of.messages, "message is", "messages are"),
      needed < 1e15 ? grouped(static_cast<std::uint64_t>(std::ceil(needed))) : fmt::format("{:.0e}", needed));
}

// All were slower than the limit: however they depend on one another, the run did not keep to it.
bool is_every_message(const statistics::Probability& slower) {
  constexpr std::uint64_t enough = 30;
  return slower.messages >= enough && slower.events == slower.messages;
}

// Judges a percentile by the number of slower messages. Each answer uses the bound that opposes it.
Answer answer_by_share(const Question& question, bool is_above) {
  const auto &least = question.of.at_least, &most = question.of.at_most;
  if (is_above && (is_every_message(least) || statistics::exceeds(least, question.most) == Answer::yes))
    return Answer::yes;
  if (!is_above && statistics::exceeds(most, question.most) == Answer::no) return Answer::no;
  return Answer::cannot_tell;
}

// More than the metric leaves above itself are surely slower.
bool is_beyond(const Question& question) {
  const auto& slower = question.of.at_least;
  return static_cast<double>(slower.events) > question.most * static_cast<double>(slower.messages);
}

std::string slower_words(const statistics::Between& slower) {
  const auto least = slower.at_least.events, most = slower.at_most.events;
  return fmt::format(
      "{}{} of {} slower{}", least < most ? grouped(least) + " to " : "", grouped(most),
      grouped(slower.at_most.messages),
      slower.unanswered == 0 ? "" : fmt::format(" ({} had no answer)", grouped(slower.unanswered)));
}

// Of answers alone, so that a loss would hide from it.
bool is_late_answers(const Gate& gate, const Summary& run) {
  return gate.figure == Figure::late && gate.times == statistics::Times::round_trip &&
         !run.run.asked.is_listened();
}

// A limit for late messages, a percentile or the maximum of a run: a message without an answer was slower, as
// it waited for its time-out.
bool counts_unanswered(const Gate& gate, const Summary& run) {
  if (is_share(gate)) return is_late_answers(gate, run) && !gate.is_relative();
  return !gate.is_relative() && gate.figure != Figure::mean && !run.run.asked.is_listened() &&
         static_cast<double>(run.run.asked.task.client.timeout.count()) >= gate.limit;
}

// A mean and a change are of answers alone, and whether a lost message was slower than a limit above its
// time-out is unknown. Where more were lost than the metric leaves above itself, it may keep to the limit
// only because of them.
bool is_of_too_few_answers(const Gate& gate, const Summary& run) {
  const auto& metric = statistics::metric_of(gate.figure);
  if (counts_unanswered(gate, run) || (metric.is_share && !is_late_answers(gate, run))) return false;
  const double permitted = metric.one_in > 0 ? metric.share_above() : 0;
  return static_cast<double>(run.lost) > permitted * static_cast<double>(run.sent);
}

std::string unanswered_words(const Gate& gate, const Summary& run) {
  return run.lost > 0 && is_share(gate) && counts_unanswered(gate, run)
             ? fmt::format(" ({} had no answer)", grouped(run.lost))
             : "";
}

// A sender that stood still has sent nothing that could be late.
Judgement unless_it_stood_still(Judgement judged, const Gate& gate, const Summary& run) {
  if (judged.result != Result::held || gate.figure == Figure::lost) return judged;
  if (is_of_too_few_answers(gate, run)) {
    judged.is_sure = false;
    judged.says += fmt::format("; but {} of {} messages were lost and are not included", grouped(run.lost),
                               grouped(run.sent));
  }
  if (gate.times != statistics::Times::round_trip) return judged;
  const auto waited = run.late_by_response.value_or(0);
  if (waited <= run.late + run.lost) return judged;
  judged.is_sure = false;
  judged.says += fmt::format("; but {} of {} cycles had no answer in time (see response {})", grouped(waited),
                             grouped(run.sent + run.skipped_cycles), figure_of(gate));
  return judged;
}

Judgement judge_count(const Gate& gate, const Summary& run) {
  const bool by_response = gate.times == statistics::Times::response;
  const auto late = by_response ? run.late_by_response
                                : std::optional(run.late + (counts_unanswered(gate, run) ? run.lost : 0));
  const auto count = gate.figure == Figure::lost ? std::optional(run.lost) : late;
  if (!count) return judgement(gate, name_of(run), Result::cannot_judge, "the record has no deadline");
  return unless_it_stood_still(
      judgement(gate, name_of(run), static_cast<double>(*count) > gate.limit ? Result::missed : Result::held,
                by_response
                    ? fmt::format("{} of {} cycles", grouped(*count), grouped(run.sent + run.skipped_cycles))
                    : fmt::format("{} of {} messages{}", grouped(*count), grouped(run.sent),
                                  unanswered_words(gate, run))),
      gate, run);
}

// The judgement that follows from the answer to "is the limit exceeded". `of`: what there are too few of.
Judgement judge_answer(const Gate& gate, std::string run, Answer answer, const std::string& says,
                       const char* of = "messages") {
  if (answer == Answer::yes) return judgement(gate, std::move(run), Result::missed, says);
  auto held = judgement(gate, std::move(run), Result::held, says);
  held.is_sure = answer == Answer::no;
  if (!held.is_sure) held.says += fmt::format("; too few {} to be certain", of);
  return held;
}

// The value that the limit of a change permits.
double permitted_of(const Gate& gate, const statistics::Change& change) {
  return gate.kind == Gate::Limit::ratio ? change.from * gate.limit : change.from + gate.limit;
}

// Whether the true value may be greater.
bool may_exceed(const statistics::Change& change, double value) {
  const auto& high = change.lies().high;
  return !high || (change.ratio ? change.from * *high : change.from + *high) > value;
}

// Where to − from lies, by the interval that decides. A share lies between 0 and 1; the true `from`, too.
Interval difference_lies(const Gate& gate, const statistics::Change& change) {
  auto lies = change.lies();
  for (auto* end : {&lies.low, &lies.high}) {
    if (*end && change.ratio) *end = change.from * (**end - 1);
    if (*end && is_share(gate)) *end = std::clamp(**end, -1.0, 1.0);
  }
  return lies;
}

// "(+30 %), 98 % interval [+28 %, +32 %]"; in points or as a time if the limit is. Of shares also if a run
// had none late or lost: percent would read as a ratio.
std::string change_words(const Gate& gate, const statistics::Change& change) {
  if (change.ratio && gate.kind == Gate::Limit::ratio) {
    const auto in_percent = [](double ratio) {
      if (ratio > 100) return std::string("over 100 times");
      if (ratio < 1) return table::percent(ratio - 1, 3) + " %";  // nearly all is not 100 %
      const double percent = (ratio - 1) * 100;
      return percent < 999.5 ? fmt::format("{:+.3g} %", percent) : fmt::format("{:+.0f} %", percent);
    };
    return fmt::format("({}), {}", in_percent(*change.ratio), interval(change.ratio_lies, in_percent));
  }
  const auto text = [&](double value) {
    return is_share(gate) ? table::points(value) + " points" : (value < 0 ? "" : "+") + time_of(value);
  };
  return fmt::format("({}), {}", text(change.to - change.from),
                     interval(difference_lies(gate, change), text));
}

// Why `ontime listen` did not see what the gate judges; empty: it did.
std::string not_seen(const Gate& gate, const Summary& run) {
  if (gate.figure == Figure::lost && !statistics::knows_loss(run.run))
    return "the number of lost messages is unknown";
  if (gate.figure == Figure::late && !statistics::knows_late(run.run)) return "no limit was stated";
  return "";
}

std::string why_open(const statistics::Measured& found) {
  return *found.open != '\0' ? fmt::format("{}: measure longer", found.open) : too_few;
}

}  // namespace

statistics::Between probability_beyond(const Gate& gate, const Summary& run) {
  const auto* share = counts_unanswered(gate, run) && is_share(gate)
                          ? &run.missed_probability
                          : statistics::probability_of(run, gate.times, gate.figure);
  return share != nullptr ? statistics::Between{*share, *share}
                          : statistics::slower_than(run, gate.times, gate.limit);
}

bool is_superseded(const Summary& run, std::span<const Summary> all) {
  if (statistics::is_complete(run.run) || run.run.key.empty()) return false;
  if (run.run.asked.is_listened()) return false;  // what a robot did another day does not replace it
  return std::any_of(all.begin(), all.end(), [&](const Summary& other) {
    return other.run.number > run.run.number && other.run.key == run.run.key &&
           other.run.asked.repetition == run.run.asked.repetition;
  });
}

std::string name_of(const Summary& run) {
  auto name = name_of(Runs{&run});
  if (const auto repetition = run.run.asked.repetition; repetition > 1)
    name += fmt::format(" #{}", repetition);
  return fmt::format("{} (run {})", name, run.run.number);
}

std::string name_of(const Runs& runs) {
  const auto& asked = runs.front()->run.asked;
  auto name = fmt::format("{:.{}}", asked.id, longest_id);
  if (name.size() < asked.id.size()) name = fmt::format("{:.{}}…", asked.id, longest_id - 1);
  for (const auto& word : {asked.variant, asked.task.transport})
    if (!word.empty()) name += " " + word;
  if (!asked.beside.empty()) name += " beside " + asked.beside;
  return table::printable(name);
}

const char* word_of(const Judgement& judgement) {
  if (judgement.result == Result::missed) return "FAIL";
  if (judgement.result == Result::cannot_judge) return "open";
  return judgement.is_sure ? "ok" : "ok, not certain";
}

std::string text_of(const Judgement& judgement) {
  return fmt::format("{}: {} ({}): {}", word_of(judgement), judgement.gate, judgement.run, judgement.says);
}

Judgement judge_as_asked(const Summary& run) {
  const auto why = run.imported ? "" : unfit(run);
  return {why.empty() ? Result::held : Result::cannot_judge, name_of(run), as_asked, why};
}

Judgement judge(const Gate& gate, const Summary& run) {
  const auto open = [&](const std::string& why) {
    return judgement(gate, name_of(run), Result::cannot_judge, why);
  };
  if (run.imported && run.wake_up.count > 0 && gate.figure == Figure::max &&
      gate.times == statistics::Times::round_trip) {
    const auto max = static_cast<double>(run.wake_up.max);
    return judgement(gate, name_of(run), max > gate.limit ? Result::missed : Result::held,
                     "max wake-up latency is " + value_of(gate, max));
  }
  if (const auto why = unfit(run); !why.empty()) return open(why);
  if (const auto why = not_seen(gate, run); !why.empty()) return open(why);
  if (gate.kind == Gate::Limit::count) return judge_count(gate, run);
  auto found = statistics::measured(run, gate.times, gate.figure);
  if (found && is_share(gate)) found = statistics::Measured(probability_beyond(gate, run).at_most);
  if (!found)
    return run.lost > 0 && counts_unanswered(gate, run)
               ? judgement(gate, name_of(run), Result::missed, nothing_answered)
               : open(nothing_answered);
  auto says =
      fmt::format("{} is {}{}", figure_of(gate), value_of(gate, found->value), unanswered_words(gate, run));
  if (gate.figure == Figure::max) {
    const auto slower = probability_beyond(gate, run);
    if (slower.unanswered > 0) says += "; " + slower_words(slower);
    return unless_it_stood_still(
        judgement(gate, name_of(run),
                  found->value > gate.limit || is_beyond({slower}) ? Result::missed : Result::held, says),
        gate, run);
  }
  says += ", " + interval(found->surer, [&](double value) { return value_of(gate, value); });
  auto answer = statistics::exceeds(*found, gate.limit);
  const auto question = question_of(gate, run);
  // The interval is of answers alone.
  if (question && !is_share(gate) && answer != Answer::yes &&
      (answer == Answer::cannot_tell || question->of.unanswered > 0)) {
    answer = answer_by_share(*question, found->value > gate.limit || is_beyond(*question));
    says += "; " + slower_words(question->of);
  }
  const auto shift = statistics::shift_text(run);
  if (answer == Answer::cannot_tell) {
    const auto short_by = question ? too_short_words(*question) : found->surer.high ? "" : why_open(*found);
    if (!short_by.empty()) return open(says + ": " + short_by + (shift.empty() ? "" : "; " + shift));
    // As of a change: what was measured beyond the limit passes only if it is surely not far beyond.
    if (!question && found->value > gate.limit && *found->surer.high > 2 * gate.limit)
      return open(says + ": the true one may be far above the limit: measure longer");
  }
  auto judged = unless_it_stood_still(judge_answer(gate, name_of(run), answer, says), gate, run);
  if (!judged.is_sure && !shift.empty()) judged.says += "; " + shift;
  return judged;
}

std::vector<Judgement> judge_all(std::span<const Gate> gates, const Summary& run) {
  const auto& required = run.run.asked.stated("require");
  const auto is_of_a_run = [](const Gate& gate) { return !gate.is_relative(); };
  if (required.is_null() && std::none_of(gates.begin(), gates.end(), is_of_a_run)) return {};
  if (auto whole = judge_as_asked(run); whole.result != Result::held) return {std::move(whole)};
  std::vector<Judgement> judgements;
  for (const auto& gate : gates)
    if (is_of_a_run(gate)) judgements.push_back(judge(gate, run));
  for (const auto& text : required.is_null() || required.is_array() ? required : json::array({required})) {
    try {
      judgements.push_back(judge(parse(text.is_string() ? text.get<std::string>() : "", Use::require), run));
    } catch (const Error& error) {  // the file is of a later version, or damaged
      judgements.push_back({Result::cannot_judge, name_of(run),
                            text.dump(-1, ' ', true, json::error_handler_t::replace), error.what()});
    }
  }
  return judgements;
}

Judgement judge(const Gate& gate, const Runs& from, const Runs& to, SingleRuns single_runs) {
  const auto name = name_of(to);
  const auto open = [&](const std::string& why) { return judgement(gate, name, Result::cannot_judge, why); };
  for (const auto* runs : {&from, &to})
    for (const auto* run : *runs) {
      auto why = unfit(*run);
      if (why.empty()) why = not_seen(gate, *run);
      if (why.empty() && (!statistics::measured(*run, gate.times, gate.figure) ||
                          (is_late_answers(gate, *run) && run->lost == run->sent)))
        why = nothing_answered;
      if (!why.empty())
        return open(fmt::format("{} of {}: {}", name_of(*run), runs == &from ? "A" : "B", why));
    }
  const auto found = statistics::change(from, to, gate.times, gate.figure);
  if (!found) return open(too_few);
  const auto& change = *found;
  const auto by_answer = [&](Answer answer, const std::string& says) {
    // A measured change beyond the limit that chance may explain passes only if it is surely not far beyond.
    const auto permitted = permitted_of(gate, change);
    if (answer == Answer::cannot_tell && may_exceed(change, 2 * permitted))
      return open(says + ": " + too_wide);
    // No run proves that none is ever late or lost: where none is permitted, what was measured decides.
    if (answer == Answer::no && permitted > 0 && may_exceed(change, permitted)) answer = Answer::cannot_tell;
    auto judged = judge_answer(gate, name, answer, says, "runs or messages");
    for (const auto* run : to)
      if (judged.is_sure) judged = unless_it_stood_still(std::move(judged), gate, *run);
    return judged;
  };
  auto says = fmt::format("{} went from {} to {}", figure_of(gate), value_of(gate, change.from),
                          value_of(gate, change.to));
  if (!change.repeated && single_runs == SingleRuns::open) return open(says + ": " + one_run);
  if (!change.lies().low)  // whatever is measured, it could not be shown to be worse
    return open(says + ": " + too_few);
  says += " " + change_words(gate, change);
  if (!change.ratio)  // a run had none late or lost
    return by_answer(statistics::difference_exceeds(change, permitted_of(gate, change) - change.from), says);
  const auto exceeds =
      gate.kind == Gate::Limit::ratio ? statistics::ratio_exceeds : statistics::difference_exceeds;
  return by_answer(exceeds(change, gate.limit), says);
}

}  // namespace ontime::gate
