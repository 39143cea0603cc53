// SPDX-License-Identifier: Apache-2.0
#include <map>

#include <fmt/format.h>

#include "gate/gate.hpp"
#include "report/conditions.hpp"
#include "report/runs.hpp"
#include "report/words.hpp"

namespace ontime::report {

Verdict verdict_of(const Summaries& summaries) {
  if (summaries.empty()) return {Verdict::Word::nothing, "Nothing was measured.", ""};
  std::uint64_t sent = 0, late = 0, lost = 0, late_cycles = 0, late_by_response_only = 0;
  std::size_t measured = 0, fine = 0, unfinished = 0;
  std::size_t with_limit = 0, without_limit = 0;  // runs; only of a robot's own messages there may be none
  std::size_t with_missed = 0, with_open = 0;     // runs with such a requirement
  std::map<std::string, std::size_t> flaws;       // of runs that were measured to their end
  const statistics::Summary* slowest = nullptr;
  for (const auto* run : last_of(summaries)) {
    const auto& summary = *run;
    const bool knows_late = statistics::knows_late(summary.run),
               knows_loss = statistics::knows_loss(summary.run);
    without_limit += knows_late ? 0 : 1;
    with_limit += knows_late ? 1 : 0;
    if (knows_late || knows_loss) {
      const auto fates = statistics::fates_of(summary);
      sent += fates.sent;
      late += fates.late;
      lost += fates.lost;
      late_cycles += summary.late_by_response.value_or(0);
      late_by_response_only += summary.run.outcome.late_by_response_only;
      measured += fates.sent > 0 ? 1 : 0;
      fine += fates.sent > 0 && fates.not_in_time == 0 ? 1 : 0;
      if (summary.round_trip.count > 0 &&
          (slowest == nullptr || summary.round_trip.max > slowest->round_trip.max))
        slowest = &summary;
    }
    with_missed += has_note(summary, gate::missed_note) ? 1 : 0;
    with_open += has_note(summary, gate::open_note) ? 1 : 0;
    using gate::Flaw;
    const auto flaw = gate::flaw_of(summary);
    if (flaw == Flaw::failed || flaw == Flaw::cut_off)
      ++unfinished;
    else if (flaw >= Flaw::unrecorded && flaw < Flaw::none)
      ++flaws[gate::unfit(summary)];
  }

  Verdict verdict;
  const auto deadline = limit_of(summaries, "deadline", &roundtrip::ClientOptions::deadline);
  const auto of_sent = [&](std::uint64_t part) {
    return fmt::format("{} of {}", grouped(part), grouped(sent));
  };
  const bool listened = all_listened(all_of(summaries));
  if (sent == 0) {
    verdict.sentence =
        without_limit == 0 ? "Nothing was measured." : "Nothing tells which messages were late or lost.";
  } else if (fine == measured) {
    verdict.word = with_missed > 0 ? Verdict::Word::no
                   : unfinished == 0 && flaws.empty() && with_open == 0 && with_limit > 0
                       ? Verdict::Word::yes
                       : Verdict::Word::partly;
    const auto all =
        sent == 1 ? std::string("The only message") : fmt::format("All {} messages", grouped(sent));
    verdict.sentence = with_limit > 0
                           ? fmt::format("{} came {}within the {}.", all, listened ? "" : "back ", deadline)
                           : fmt::format("None of {} was lost.", many(sent, "message", "messages"));
  } else {
    verdict.word = Verdict::Word::no;
    std::vector<std::string> parts;
    if (late > 0) parts.push_back(fmt::format("{} messages missed the {}", of_sent(late), deadline));
    if (lost > 0)
      parts.push_back(late > 0
                          ? fmt::format("{} {} lost", grouped(lost), lost == 1 ? "was" : "were")
                          : fmt::format("{} messages {} lost", of_sent(lost), lost == 1 ? "was" : "were"));
    if (parts.empty())
      parts.push_back(fmt::format("every message sent came back in time, but {} had no answer within the {}",
                                  many(late_cycles, "cycle", "cycles"), deadline));
    else if (late_cycles > late + lost)
      parts.push_back(fmt::format("{} had no answer in time, {}", many(late_cycles, "cycle", "cycles"),
                                  late_cycles > late + lost + late_by_response_only  // the sender stood still
                                      ? "including cycles without a message"
                                      : "counted from when each was due"));
    verdict.sentence = join(parts, ", and ") + ".";
    verdict.sentence.front() = static_cast<char>(std::toupper(verdict.sentence.front()));
  }
  std::vector<std::string> further;
  if (measured > 1 && fine < measured)
    further.push_back(fmt::format("{} of {} had {}.", measured - fine, many(measured, "run", "runs"),
                                  listened ? "late or lost messages" : "cycles without an answer in time"));
  if (slowest != nullptr)
    further.push_back(fmt::format(
        "Maximum: {}{}.", gate::time_of(static_cast<double>(slowest->round_trip.max)),
        measured > 1
            ? fmt::format(" ({}, {})", id_of(slowest->run.asked), word(slowest->run.asked.task.transport))
            : ""));
  // Only for one run: several runs have different conditions.
  const auto missed =
      summaries.size() == 1 ? summaries.front().missed_probability : statistics::Probability{};
  if (verdict.word == Verdict::Word::yes && missed.events == 0 && missed.messages > 0)
    further.push_back(fmt::format(
        "If conditions stay the same, the deadline is missed fewer than {} messages (95 % confidence), by "
        "one "
        "message or several in a row.",
        missed.bound > 0.01 ? fmt::format("{:.2g} times in 100", rounded_up(missed.bound * 100))
                            : fmt::format("{:g} times in a million", rounded_up(missed.bound * 1e6))));
  if (with_missed > 0)
    further.push_back(fmt::format("{} missed a requirement.", many(with_missed, "run", "runs")));
  if (with_open > 0)
    further.push_back(fmt::format("A requirement of {} is open.", many(with_open, "run", "runs")));
  if (without_limit > 0)
    further.push_back(
        fmt::format("{} had no limit, so no message counts as late.", many(without_limit, "run", "runs")));
  if (unfinished > 0)
    further.push_back(fmt::format("{} did not run to the end.", many(unfinished, "run", "runs")));
  for (const auto& [why, runs] : flaws)
    further.push_back(fmt::format("{}: {}.", many(runs, "run", "runs"), why));
  verdict.further = join(further, " ");
  return verdict;
}

}  // namespace ontime::report
