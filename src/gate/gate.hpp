// SPDX-License-Identifier: Apache-2.0
// Gates: a limit on a metric, and whether a run meets it. Ordinary thread.
//
//   gate       = [ "response" ] figure ( ">" | "<=" ) limit
//   figure     = a name in statistics::metrics: "mean", "p99.9", "max", "late" …
//   limit      = number                                         messages: late and lost alone; 0 % is 0
//              | number ( "ns" | "us" | "µs" | "ms" | "s" | "%" )   a time, of late and lost a share
//              | ( "+" | "-" ) number ( "%" | "ns" … "s" | "points" )  against another run: of what it was,
//              or so much more
//
// Metrics are of the round trip, or of the response. `--fail-if` says ">", `require` says "<=".
#pragma once

#include <cstdint>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "statistics/statistics.hpp"

namespace ontime::gate {

// An error in an expression, with its column, for people.
struct Error : std::invalid_argument {
  using std::invalid_argument::invalid_argument;
};

enum class Use {
  fail_if,           // of a run by itself
  fail_if_compared,  // of a run, or against another
  require,           // a limit that must be met
  goal,              // as require, for `tune search`: < and = are comparisons, too
};

struct Gate {
  std::string text;
  statistics::Times times = statistics::Times::round_trip;
  statistics::Figure figure = statistics::Figure::p99;
  enum class Limit { count, absolute, ratio, difference } kind = Limit::absolute;
  double limit = 0;  // messages; ns or a share; 1.1 for +10%; ns or a share
  bool is_relative() const { return kind == Limit::ratio || kind == Limit::difference; }
  std::string requirement() const;  // the limit to meet: "p99 <= 2 ms", also for "p99 > 2 ms"
};
// `before`: what was typed before it, for the columns of errors.
Gate parse(const std::string& text, Use, std::string_view before = {});

// Probability of a late or lost message, as the gate requests, or of one slower than its limit.
statistics::Between probability_beyond(const Gate&, const statistics::Summary&);

// The first requested condition that was not met, for people: load, settings, reserved CPUs, link faults,
// traffic, background topics. Empty: none is known.
std::string absent(const record::Asked&, const record::Outcome&);

// Load that was there, but smaller than requested.
struct SmallerLoad {
  const char *host, *kind;  // "controller", "hdd"
  std::uint64_t requested_bytes, had_bytes;
  int divided_among;  // number of workers that shared it; 0: each had so little
};
std::vector<SmallerLoad> smaller_loads(const record::Asked&, const record::Outcome&);

// Settings that were requested and not permitted, each once.
std::vector<std::string> denied(const record::Outcome&);

// Of a run that is a step of a search: whether the search ends at its value. A message was late, also by
// response time, or lost, a cycle passed without one, or nothing was sent; not all of it was recorded; what
// was asked for beside it was absent, and will not be there with more; or there was no answer although there
// was one at the first value. Of one that failed in another way, or was interrupted, nothing is known.
bool ends_search(const record::Asked&, const record::Outcome&);

// What keeps a run from being judged, the most serious first. Reports, comparisons and gates use this list.
enum class Flaw : std::uint8_t {
  imported,  // from another tool: it has no messages
  failed,
  cut_off,     // not measured to its end
  worst_only,  // its counts are of all messages, its samples of the worst
  unrecorded,  // samples are missing
  misfit,      // its record has an invalid value
  nothing_sent,
  absent,  // load, traffic or the like that was requested, or a part of it
  denied,  // a setting that was requested
  none
};
Flaw flaw_of(const statistics::Summary&);
std::string unfit(const statistics::Summary&);  // its flaw, for people; empty for none
// Its messages were measured here, and its samples are not those of all of them.
inline bool lacks_samples(Flaw flaw) { return flaw > Flaw::imported && flaw <= Flaw::unrecorded; }

// Whether the run did not finish and a later one has the same repetition and conditions: `--resume` replaces
// it.
bool is_superseded(const statistics::Summary&, std::span<const statistics::Summary> all);

struct Judgement {
  // cannot_judge: the run cannot answer, whatever the limit is: it was cut off, or has too few messages. The
  // caller must not take that for a pass.
  enum class Result { held, missed, cannot_judge } result = Result::held;
  std::string run, gate;  // gate: the requirement
  std::string says;       // the metric, its interval, and what follows, for people; empty: `gate` says it all
  bool is_sure = true;    // false: it held, but only because chance may explain what was measured
};

// A number of messages and a maximum are what they are. All other metrics pass a limit only if chance does
// not explain it: statistics::exceeds(), ratio_exceeds(), difference_exceeds(). A percentile also keeps to
// its limit if the share of slower messages does. One without an answer is late, and slower than limits up to
// its time-out. Of a change: held and sure if its whole interval keeps to the limit. Beyond it, and perhaps
// by chance: held, or open if the true value may be more than twice what the limit permits. Of an imported
// run, which has no single messages, only the greatest wake-up latency is judged.
Judgement judge(const Gate&, const statistics::Summary&);  // one that is not relative
// Of repetitions. A side of one run is judged only if asked for: the interval is then about these runs, and
// not about what changes from one start to the next.
using Runs = std::vector<const statistics::Summary*>;
enum class SingleRuns { open, judged };
Judgement judge(const Gate&, const Runs& from, const Runs& to,
                SingleRuns = SingleRuns::open);  // one that is relative
// Kinds of notes in a run's record: a requirement that it missed, or that it could not be judged by.
inline constexpr const char *missed_note = "gate-missed", *open_note = "gate-not-judged";
// "ok", "ok, not certain", "FAIL" or "open".
const char* word_of(const Judgement&);
// "FAIL: p99 <= 2 ms (Test1.B udp (run 5)): p99 is 3.1 ms, 98 % interval [2.9 ms, 3.4 ms]".
std::string text_of(const Judgement&);
// All gates of one run that are not relative, and what its scenario required (from its record). Of a run that
// cannot be judged a single judgement, as_asked, says why.
std::vector<Judgement> judge_all(std::span<const Gate>, const statistics::Summary&);
// A gate of this name: the run finished with all requested conditions. An imported one was not requested.
inline constexpr const char* as_asked = "measured as asked";
Judgement judge_as_asked(const statistics::Summary&);

// "Test1.B cyclonedds #2 (run 5)"; of several: "Test1.B cyclonedds". An id of more characters is shortened.
inline constexpr int longest_id = 60;
std::string name_of(const statistics::Summary&);
std::string name_of(const Runs&);
using statistics::time_of;

}  // namespace ontime::gate
