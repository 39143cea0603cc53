// SPDX-License-Identifier: Apache-2.0
// Output about runs: JSON and CSV for programs, tables for users.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "statistics/statistics.hpp"
#include "table/table.hpp"

namespace ontime::report {

using nlohmann::ordered_json;
using statistics::Figure;
using statistics::Summary;
using Summaries = std::vector<statistics::Summary>;
using Group = std::vector<const statistics::Summary*>;

Group all_of(const Summaries&);
Group last_of(const Summaries&);             // without those that were measured again
std::vector<Group> by_id(const Summaries&);  // in the order of their first runs
std::string quantity_of(const Group&);       // "Round trip", "Age" …; "Time" if they differ
bool all_listened(const Group&);             // to a robot's own messages: without answers and cycles

// After the first message was due. A damaged file's times do not overflow.
inline double seconds_into(const statistics::Summary& run, std::int64_t at_ns) {
  return (static_cast<double>(at_ns) - static_cast<double>(run.start_ns)) / 1e9;
}

// Late messages of `ontime listen` with the same cause.
struct SameCause {
  std::vector<const record::Note*> notes{};  // the earliest first
  // What they say: of each time the shortest and the longest; details, such as a CPU, only if all have the
  // same. Notes of an older ontime are the same if their texts are, but for numbers: the first one's text,
  // which includes the fix.
  std::string text{}, fix{};  // fix: "" if nothing helps
};
// Of notes why a message was late, which stay where they are. The most messages first.
std::vector<SameCause> same_causes_of(const std::vector<const record::Note*>&);
// One line: "2026-11-25 03:50:43  26.1 ms old (limit 5 ms): …; fix: …".
std::string text_of(const record::LateCause&);
std::string text_of(const record::Note&);  // in every output: its cause, if that is known
// docs/reference/json.md. `running_from`: as in Origin.
nlohmann::ordered_json json_of(const statistics::Summary&, std::optional<std::int64_t> running_from = {});
std::string csv_of(const Summaries&, std::optional<std::int64_t> running_from = {});
// "starts of the runs: 2026-11-30 17:20 to 17:31 UTC", of the first and the last. Empty: not known.
std::string when_of(const Summaries&);
table::Page page_of(const Summaries&, std::optional<std::int64_t> running_from = {});

// Whether judging by response time (from the due time, not from sending) gives another number of misses than
// late + lost: then it has its own column.
bool differs_by_response(const statistics::Summary&);
bool any_of_paper(const Summaries&);  // whether the paper has rows for one of them

// The estimate; certainty_table() shows its interval. "-" if no value is above the percentile, a "~" in front
// if fewer than ten are.
std::string percentile(const statistics::Distribution&, statistics::Figure);
// 95 % confidence intervals of runs' percentiles, by their labels; without a title. No rows where none is
// known. "≥ x": no upper limit. The value itself may be x, because limits are values that were seen.
table::Table certainty_table(const std::vector<std::string>& labels, const Group&);
// The extrapolated worst case. Runs without one have no row.
table::Table worst_case_table(const std::vector<std::string>& labels, const Group&);
// Why runs have no extrapolated worst case: each reason once, with the names of its runs.
std::vector<std::string> unbounded_notes(const std::vector<std::string>& names, const Group&);
// A note that an older ontime, with other intervals and gates, measured one of these; else empty.
std::string older_note(const Group&);
std::string refusal_of(const statistics::Extremes&);  // why there is no bound; empty if there is one
// The stages of a response time: a stall of ontime's own thread is not the network's.
table::Table stages_table(const std::vector<std::string>& labels, const Group&);
void add_certainty(nlohmann::ordered_json& run, const statistics::Summary&);

// The greatest value of a key without a miss; no rows without a search.
table::Table searches_table(const Group&);
// " Highest background.rate without a miss: 400 Hz."; "" without a search.
std::string searches_sentence_of(const Summaries&);
nlohmann::ordered_json searches_json_of(const Summaries&);

// A caution about a run: a fault, or a count that the table does not show.
struct Remark {
  enum class Weight { detail, caution, not_applied } weight;  // not_applied: not the run that was requested
  std::string text;                                           // "{}" stands for `amount`
  std::optional<double> amount = {};
  std::string (*shown)(double) = nullptr;
  // About a gate that the run missed, or that could not be judged.
  enum class Requirement { none, open, missed } requirement = Requirement::none;
};
std::vector<Remark> remarks_of(const statistics::Summary&);
std::string remarks(const statistics::Summary&);  // in one text; empty without remarks
// Remarks about the link's traffic and losses. An empty text: no remark.
// "12 at the component, 3 at the controller": what each end's own reader lost.
std::string losses_text(const record::Outcome&, std::optional<std::uint64_t> record::Losses::*kind,
                        const char* where);
Remark traffic_remark(const record::Outcome&);
Remark background_remark(const record::Outcome&);
std::string drops_text(const record::Outcome&);
std::string link_faults_text(const record::Outcome&);
std::string missed_launches_text(const record::Outcome&);
std::vector<std::string> other_traffic(const statistics::Summary&);
// Each remark once, with the range of its amounts and the places of the runs that have it.
struct SharedRemark {
  Remark::Weight weight;
  std::string text;
  std::vector<std::size_t> runs;
  Remark::Requirement requirement;
  bool names_a_run = false;
};
// "udp, fastdds", "all runs", "9 of 12 runs (udp, fastdds, …)".
std::string name_of_some(const std::vector<std::string>& names, const std::vector<std::size_t>& places);
std::vector<SharedRemark> shared_remarks(const Group&);
// Where more than two requirements are missed, or more than one is open, one remark stands for them: "missed
// requirements in 6 runs, such as idle udp (run 1): p99 <= 1 ms: …". `names`: of the runs.
void gather_requirements(std::vector<SharedRemark>&, const std::vector<std::string>& names);
// One line for all remarks of the same runs, after the names of these runs.
std::vector<std::string> remark_lines(const std::vector<std::string>& names, const Group&);
// Settings that these runs requested and the machines denied, one text for each remedy.
std::vector<std::string> refusals(const Summaries&);

// The imported runs of an id.
table::Table imported_table_of(const Group&);
nlohmann::ordered_json imported_json_of(const statistics::Summary&);  // null, if it was measured
// Whether messages arrived on time, in a sentence.
struct Verdict {
  // partly: all present messages are on time, but some data are missing, or a requirement is open. no: also
  // if one was missed
  enum class Word { yes, partly, no, nothing } word = Word::nothing;
  std::string sentence, further;
};
Verdict verdict_of(const Summaries&);
// Such as gate::missed_note: gates are judged when a run is measured.
bool has_note(const statistics::Summary&, const char* kind);

// What was requested and what was found.
table::Table differences_of(const Summaries&);  // the conditions that differ between the runs
table::Table loads_of(const Summaries&);        // requested and achieved, and what the link carried
table::Table machines_of(const Summaries&);

nlohmann::ordered_json threads_json_of(const Summaries&);
std::string threads_csv_of(const Summaries&);
table::Page threads_page_of(const Summaries&);

// What each layer costs; for runs that name a baseline.
nlohmann::ordered_json layers_json_of(const Summaries&);
std::string layers_csv_of(const Summaries&);
table::Page layers_page_of(const Summaries&);

}  // namespace ontime::report
