// SPDX-License-Identifier: Apache-2.0
#include "report/answer.hpp"

#include <algorithm>
#include <cmath>
#include <set>

#include <fmt/format.h>

#include "gate/gate.hpp"
#include "report/comparison.hpp"
#include "report/conditions.hpp"
#include "report/runs.hpp"
#include "report/words.hpp"

namespace ontime::report {
namespace {

using gate::Flaw;
using statistics::Figure;
using statistics::Summary;
using Row = Answer::Row;
using State = Answer::State;

// Stress on the machines and the link, and the settings against it, one word each.
struct Conditions {
  std::string stress, tuned;
  bool is_listened = false;  // to a robot's own messages
  bool operator==(const Conditions&) const = default;
};

Conditions conditions_of(const Summary& run) {
  const auto& asked = run.run.asked;
  std::vector<std::string> stress, tuned;
  if (asked.controller_load.any() || asked.component_load.any()) stress.emplace_back("load");
  if (asked.traffic.any()) stress.emplace_back("traffic");
  if (asked.task.background.topics > 0) stress.emplace_back("background topics");
  if (asked.faults.any()) stress.emplace_back("link faults");
  if (asked.task.realtime.on) tuned.emplace_back("RT");
  if (!asked.kernel.empty()) tuned.emplace_back("kernel settings");
  if (asked.isolation.any()) tuned.emplace_back("reserved CPUs");
  return {join(stress, ", "), join(tuned, ", "), asked.is_listened()};
}

// "load, RT". Only a scenario says that a machine was idle: `ontime ping` does not know what else runs.
std::string in_words(const Summary& run) {
  const auto [stress, tuned, is_listened] = conditions_of(run);
  const auto first = stress.empty() && !run.run.asked.scenario_file.empty() ? "idle" : stress;
  return first.empty() ? tuned : tuned.empty() ? first : first + ", " + tuned;
}

// Cycles without an answer in time. Where samples are missing, at least what the client counted.
std::uint64_t missed_of(const Summary& run) {
  const auto seen = run.late_by_response.value_or(run.late + run.lost);
  const auto& counted = run.run.outcome.counters;
  return std::max({seen, run.late + run.lost, counted.late + counted.lost});
}

struct Wait {
  double ns;
  bool is_open;  // no answer ended it, or none whose time is known
};
Wait worst_wait_of(const Summary& run) {
  const auto& client = run.run.asked.task.client;
  const auto& counted = run.run.outcome.counters;
  const auto ended_ns = static_cast<double>(std::max(run.response.max, run.round_trip.max));
  auto open_ns = static_cast<double>(run.open_wait_ns);
  // Where samples are missing, the client's counts tell at least how long the waits were.
  if (std::max(run.lost, counted.lost) > 0)
    open_ns = std::max(open_ns, static_cast<double>(client.timeout.count()));
  if (counted.late > run.late) open_ns = std::max(open_ns, static_cast<double>(client.deadline.count()));
  return {std::max(ended_ns, open_ns), open_ns > 0 && open_ns >= ended_ns};
}

Row row_of(const Group& runs, const std::string& name) {
  const auto& first = *runs.front();
  Row row;
  row.id = id_of(first.run.asked);
  row.conditions = in_words(first);
  row.name = runs.size() == 1 ? name : fmt::format("{} ×{}", name, runs.size());
  for (const auto* run : runs) {
    row.runs.push_back(run->run.number);
    row.state = std::max(row.state, state_of(*run));
    row.missed_requirement = row.missed_requirement || has_note(*run, gate::missed_note);
    row.open_requirement = row.open_requirement || has_note(*run, gate::open_note);
    if (run->imported) continue;
    row.cycles += sent_of(*run) + run->skipped_cycles;
    row.missed += missed_of(*run);
    const auto [wait_ns, is_open] = worst_wait_of(*run);
    const auto before_ns = row.worst_wait_ns.value_or(0);
    if (wait_ns > before_ns) row.worst_wait_ns = wait_ns;
    if (wait_ns > 0 && wait_ns >= before_ns) row.is_open = is_open || (row.is_open && wait_ns == before_ns);
  }
  row.p50 = spread_of(runs, Figure::p50);
  row.p99 = spread_of(runs, Figure::p99);
  // A run without an answer hides no slow answer of another.
  for (const auto* run : runs)
    if (const auto& of = run->imported ? run->wake_up : run->round_trip; of.count > 0)
      row.max_ns = std::max(row.max_ns.value_or(0), static_cast<double>(of[Figure::max]));
  return row;
}

// Repetitions together, in the order of the first.
struct Entry {
  Group runs;
  Row row;
};
std::vector<Entry> entries_of(const Summaries& summaries) {
  std::vector<Entry> entries;
  for (const auto& all : by_id(summaries)) {
    Group group;
    std::ranges::copy_if(all, std::back_inserter(group),
                         [&](const auto* run) { return !gate::is_superseded(*run, summaries); });
    for (const auto& [label, runs] : alike(group)) entries.push_back({runs, row_of(runs, label)});
  }
  return entries;
}

// --- the sentence ---

double share_of(const Row& row) {
  return row.cycles == 0 ? 0 : static_cast<double>(row.missed) / static_cast<double>(row.cycles);
}

struct Class {
  Conditions conditions;
  std::vector<const Entry*> entries;
  double low = 1, high = 0;  // shares of cycles without an answer in time

  std::string range() const {
    const auto least = percent(low), most = percent(high);
    return least == most ? most + " %" : fmt::format("{} to {} %", least, most);
  }
};

// Its file has none of its samples: only the client counted its messages.
bool has_no_sample(const Summary* run) { return run->sent == 0 && run->run.outcome.counters.sent > 0; }

std::vector<Class> classes_of(const std::vector<Entry>& entries, bool (*is_meant)(State)) {
  std::vector<Class> classes;
  for (const auto& entry : entries) {
    if (!is_meant(entry.row.state) || entry.row.cycles == 0) continue;
    if (std::ranges::all_of(entry.runs, has_no_sample)) continue;
    const auto conditions = conditions_of(*entry.runs.front());
    auto same = std::ranges::find(classes, conditions, &Class::conditions);
    if (same == classes.end()) same = classes.insert(classes.end(), {conditions, {}});
    same->entries.push_back(&entry);
    same->low = std::min(same->low, share_of(entry.row));
    same->high = std::max(same->high, share_of(entry.row));
  }
  return classes;
}

// `lacking`: what the other runs have, if this is none.
std::string stress_words(const std::string& stress, const std::string& lacking = "load") {
  return stress.empty()               ? "without " + lacking
         : stress.starts_with("link") ? "with " + stress
                                      : "under " + stress;
}
std::string tuned_words(const std::string& tuned) {
  if (tuned.empty()) return "without real-time settings";
  return "with " + replace_all(tuned, "RT", "real-time settings");
}
std::string all_words(const Conditions& conditions, const std::string& lacking = "load") {
  const auto stress = stress_words(conditions.stress, lacking);
  return conditions.tuned.empty() ? stress : stress + " " + tuned_words(conditions.tuned);
}

// "within 10 ms"; with several deadlines "in time"; without one a note that none is set.
std::string in_time(const std::vector<Class>& classes) {
  const auto deadline_of = [](const Entry* entry) {
    return entry->runs.front()->run.asked.task.client.deadline;
  };
  const auto deadline = deadline_of(classes.front().entries.front());
  for (const auto& one : classes)
    for (const auto* entry : one.entries)
      if (deadline_of(entry) != deadline) return "in time";
  return deadline.count() > 0 ? "within " + duration(deadline) : "(no deadline set)";
}

const Class* contrast_of(const std::vector<Class>& classes, const Class& worst) {
  const Class* best = nullptr;
  const auto rank = [&](const Class& one) {  // the same stress tells more than the same settings
    return one.conditions.stress == worst.conditions.stress ? 2
           : one.conditions.tuned == worst.conditions.tuned ? 1
                                                            : 0;
  };
  for (const auto& one : classes)
    if (&one != &worst && (best == nullptr || rank(one) > rank(*best))) best = &one;
  return best;
}

const Entry* worst_of(const Class& one) {
  return *std::ranges::max_element(one.entries, {}, [](const Entry* entry) { return share_of(entry->row); });
}

std::string name_of(const Row& row, bool with_id) { return with_id ? row.id + " " + row.name : row.name; }

std::string worst_named(const Class& worst) {
  if (worst.entries.size() < 2 || worst.low == worst.high) return "";
  const bool with_id = worst.entries.front()->row.id != worst.entries.back()->row.id;
  return fmt::format("; worst: {}", name_of(worst_of(worst)->row, with_id));
}

constexpr const char* no_limit_words =
    "No limit is set (--deadline, --period, --age): no message counts as late.";

// Of a robot's own messages, whose class has some that can be late or lost.
std::string sentence_of_listened(const Class& all) {
  const bool has_limit = std::ranges::any_of(
      all.entries, [](const Entry* entry) { return statistics::knows_late(entry->runs.front()->run); });
  const bool knows_loss = std::ranges::any_of(
      all.entries, [](const Entry* entry) { return statistics::knows_loss(entry->runs.front()->run); });
  if (all.high > 0)
    return fmt::format("{} of the messages were late or lost{}.", all.range(), worst_named(all));
  if (!knows_loss) return "No message was late. Lost messages are unknown.";
  return has_limit ? "No message was late or lost." : fmt::format("No message was lost. {}", no_limit_words);
}

// One class: its total. Two classes: their contrast. Never pooled over opposite conditions.
std::string sentence_of(const std::vector<Class>& classes, const Class* worst, const Class* contrast,
                        bool is_of_all) {
  if (worst->conditions.is_listened) return sentence_of_listened(*worst);
  const auto within = in_time(classes);
  if (worst->high == 0) {
    std::uint64_t cycles = 0, skipped = 0;
    for (const auto& one : classes)
      for (const auto* entry : one.entries) {
        cycles += entry->row.cycles;
        for (const auto* run : entry->runs) skipped += run->skipped_cycles;
      }
    if (skipped > 0)  // their wait ended in time, but by the answer to a message of another cycle
      return fmt::format("{} messages had an answer {}, but {} of {} cycles had no message.",
                         is_of_all ? "All" : "The", within, grouped(skipped), grouped(cycles));
    if (cycles == 1 && classes.size() == 1)
      return fmt::format("{} cycle had an answer {}.", is_of_all ? "The only" : "1", within);
    if (classes.size() == 1)
      return fmt::format("{}{} cycles had an answer {}.", is_of_all ? "All " : "", grouped(cycles), within);
    return fmt::format("{} cycles had an answer {}, under each of {} conditions.", is_of_all ? "All" : "The",
                       within, classes.size());
  }
  if (contrast == nullptr)
    return fmt::format("{} of the cycles had no answer {}{}.", worst->range(), within, worst_named(*worst));
  const bool same_stress = worst->conditions.stress == contrast->conditions.stress;
  const bool same_tuned = worst->conditions.tuned == contrast->conditions.tuned;
  const auto lacking = split(worst->conditions.stress, ',').front();  // load, or only link faults
  const auto other = same_stress  ? tuned_words(contrast->conditions.tuned)
                     : same_tuned ? stress_words(contrast->conditions.stress, lacking)
                                  : all_words(contrast->conditions, lacking);
  auto first = same_stress && worst->conditions.stress.empty() ? tuned_words(worst->conditions.tuned)
                                                               : all_words(worst->conditions);
  first.front() = static_cast<char>(std::toupper(first.front()));
  return fmt::format("{} {} of the cycles had no answer {}; {} {}.", first, worst->range(), within, other,
                     contrast->range());
}

std::string requirements(const std::vector<Entry>& entries) {
  std::size_t runs = 0, missed = 0, open = 0;
  for (const auto& entry : entries)
    for (const auto* run : entry.runs) {
      ++runs;
      missed += has_note(*run, gate::missed_note) ? 1 : 0;
      open += has_note(*run, gate::open_note) ? 1 : 0;
    }
  std::string text;
  if (missed > 0)
    text += runs == 1 ? " A requirement was missed."
                      : fmt::format(" {} of {} runs missed a requirement.", missed, runs);
  if (open > 0)
    text += runs == 1 ? " A requirement is open."
                      : fmt::format(" A requirement of {} of {} runs is open.", open, runs);
  return text;
}

// --- cautions ---

std::vector<std::string> cautions_of(const std::vector<Entry>& entries) {
  Group runs;
  std::vector<std::size_t> row_of_run;
  std::vector<std::string> names;
  const bool several_ids = entries.front().row.id != entries.back().row.id;
  for (std::size_t i = 0; i < entries.size(); ++i) {
    names.push_back(name_of(entries[i].row, several_ids));
    for (const auto* run : entries[i].runs)
      if (!run->imported) {
        runs.push_back(run);
        row_of_run.push_back(i);
      }
  }
  const auto remarks = shared_remarks(runs);
  std::vector<std::string> cautions;
  const auto about = [&](std::vector<std::size_t> places, const std::string& text) {
    std::ranges::sort(places);
    places.erase(std::unique(places.begin(), places.end()), places.end());
    cautions.push_back(places.size() == names.size() ? text : name_of_some(names, places) + ": " + text);
  };
  using enum Remark::Requirement;
  const auto add = [&](Remark::Requirement requirement, Remark::Weight weight = Remark::Weight::caution) {
    for (const auto& remark : remarks) {
      if (remark.weight != weight || remark.requirement != requirement) continue;
      std::vector<std::size_t> places;
      for (const auto run : remark.runs) places.push_back(row_of_run[run]);
      about(places, remark.text);
    }
  };
  // Many say the same of several runs: these are one caution.
  const auto tell_of = [&](Remark::Requirement requirement, std::size_t most, const char* what) {
    std::vector<const SharedRemark*> told;
    std::vector<std::size_t> places;
    std::set<std::size_t> of_runs;
    for (const auto& remark : remarks) {
      if (remark.requirement != requirement) continue;
      told.push_back(&remark);
      of_runs.insert(remark.runs.begin(), remark.runs.end());
    }
    for (const auto run : of_runs) places.push_back(row_of_run[run]);
    if (told.size() <= most) return add(requirement);
    const auto& text = told.front()->text;  // "FAIL: p99 <= 1 ms: …"
    about(places, fmt::format("{} in {}, such as {}{}", what, many(of_runs.size(), "run", "runs"),
                              names.size() > 1 ? names[row_of_run[told.front()->runs.front()]] + ": " : "",
                              text.substr(text.find(' ') + 1)));
  };
  tell_of(missed, 2, "missed requirements");  // the exit code tells of these
  tell_of(open, 1, "open requirements");
  add(none, Remark::Weight::not_applied);
  std::vector<std::string> denied;
  std::size_t denied_in = 0;
  for (const auto* run : runs) {
    const auto of_run = gate::denied(run->run.outcome);
    denied_in += of_run.empty() ? 0 : 1;
    for (const auto& asked : of_run) add_once(denied, word(asked));
  }
  if (denied_in > 0)
    cautions.push_back(fmt::format(
        "denied{}: {}", runs.size() > 1 ? fmt::format(" in {} of {} runs", denied_in, runs.size()) : "",
        join(denied, ", ")));
  add(none);
  std::uint64_t fewest = UINT64_MAX;
  for (const auto* run : runs)
    if (run->sent > 0) fewest = std::min(fewest, run->round_trip.count);
  const auto* const where = runs.size() > 1 ? " in a run" : "";
  const auto* const what = all_listened(runs) ? "messages" : "answers";
  if (fewest < statistics::metric_of(Figure::p99).one_in)
    cautions.push_back(fmt::format("too few {} ({}{}) for p99", what, grouped(fewest), where));
  else if (fewest < 1000)
    cautions.push_back(fmt::format("few {} ({}{}): p99 is a rough estimate", what, grouped(fewest), where));
  else if (fewest < 30'000 && fewest != UINT64_MAX)  // 30 must be slower: statistics/course.cpp
    cautions.push_back(fmt::format("{} {}{} are too few to bound {}", grouped(fewest), what, where,
                                   fewest < 3'000 ? "p99" : "p99.9"));
  return cautions;
}

// --- what to do next ---

// So long a run without a late message would bound their share by the next power of ten.
void add_longer(Findings& found, const std::vector<Entry>& entries) {
  double bound = 0;
  for (const auto& entry : entries)
    for (const auto* run : entry.runs)
      if (const auto& missed = run->missed_probability; missed.messages > 0 && missed.bound > bound) {
        bound = missed.bound;
        found.longer = run;
      }
  if (bound <= 1e-6) found.longer = nullptr;
  if (found.longer == nullptr) return;
  double claim = std::min(0.01, std::pow(10, std::floor(std::log10(bound))));
  if (claim * 2 > bound) claim /= 10;
  // A scenario's command is for all its runs: the slowest of them takes longest.
  const auto& scenario = found.longer->run.asked.scenario_file;
  for (const auto& entry : entries)
    for (const auto* run : entry.runs)
      if (run == found.longer || (!scenario.empty() && run->run.asked.scenario_file == scenario))
        found.longer_ns =
            std::max(found.longer_ns, statistics::messages_to_claim(claim, run->missed_probability.effect) *
                                          run->message_every_ns);
  found.longer_tells =
      fmt::format("Prove < 1 in {}", grouped(static_cast<std::uint64_t>(std::llround(1 / claim))));
}

std::string common_conditions(const std::vector<Entry>& entries) {
  Group runs;
  for (const auto& entry : entries) runs.insert(runs.end(), entry.runs.begin(), entry.runs.end());
  using Client = roundtrip::ClientOptions;
  const auto common = [&](const char* name, auto Client::*member, auto form) -> std::string {
    const auto first = runs.front()->run.asked.task.client.*member;
    const bool same = std::ranges::all_of(runs, [&](const auto* run) {
      const auto& asked = run->run.asked;
      return asked.stated(name).is_number() && asked.task.client.*member == first;
    });
    return same ? form(first) : "";
  };
  std::vector<std::string> parts;
  auto message = common("payload_bytes", &Client::payload_bytes, size);
  if (std::ranges::none_of(runs, [](const auto* run) {
        return run->run.asked.task.client.schedule == roundtrip::Schedule::back_to_back;
      }))
    if (const auto period = common("period_us", &Client::period, duration); !period.empty())
      message += (message.empty() ? "every " : " every ") + period;
  if (!message.empty()) parts.push_back(message);
  if (const auto time = common("duration_s", &Client::duration, duration); !time.empty())
    parts.push_back(time + " a run");
  return join(parts, ", ");
}

}  // namespace

State state_of(const Summary& run) {
  const bool is_late = missed_of(run) > 0;
  const bool can_be_late = statistics::knows_late(run.run) || statistics::knows_loss(run.run);
  switch (gate::flaw_of(run)) {
    case Flaw::imported:
      return State::imported;
    case Flaw::failed:
      return State::failed;
    case Flaw::cut_off:
      return State::cut_off;
    case Flaw::worst_only:  // its counts are of all messages
    case Flaw::none:
      return is_late ? State::late : can_be_late ? State::ok : State::no_limit;
    default:
      break;
  }
  // `ontime listen` requests nothing: its late and lost messages count even where samples are missing.
  return run.run.asked.is_listened() && is_late ? State::late : State::not_applied;
}

bool has_note(const Summary& run, const char* kind) {
  return std::ranges::find(run.notes, kind, &record::Note::kind) != run.notes.end();
}

std::optional<Answer::Spread> spread_of(const Group& runs, Figure figure) {
  const auto one_in = std::max<std::uint64_t>(statistics::metric_of(figure).one_in, 1);
  std::vector<double> values;
  bool is_least = false;
  for (const auto* run : runs) {
    const auto& of = run->imported ? run->wake_up : run->round_trip;
    if (of.count >= one_in)
      values.push_back(static_cast<double>(of[figure]));
    else if (statistics::is_complete(run->run))
      return std::nullopt;
    is_least = is_least || statistics::is_lower_bound(*run, figure);
  }
  if (values.empty()) return std::nullopt;
  const auto [low, high] = std::ranges::minmax_element(values);
  return Answer::Spread{*low, statistics::estimate(values)->median, *high, is_least};
}

Answer answer_of(const Summaries& summaries, const Origin& origin) {
  Answer answer;
  const auto entries = entries_of(summaries);
  if (entries.empty()) {
    answer.sentence = "There are no runs.";
    return answer;
  }
  Findings found;
  found.any = entries.front().runs.front();
  const Entry* late = nullptr;
  bool all_ok = true;
  for (const auto& entry : entries) {
    answer.rows.push_back(entry.row);
    const auto state = entry.row.state;
    all_ok = all_ok && state == State::ok;
    found.failed = found.failed || state == State::failed;
    for (const auto* run : entry.runs) {
      if (found.denied == nullptr && !gate::denied(run->run.outcome).empty()) found.denied = run;
      if (const auto of = state_of(*run);
          found.unfinished == nullptr && (of == State::failed || of == State::cut_off))
        found.unfinished = run;
    }
    if (entry.row.missed > 0 && (late == nullptr || share_of(entry.row) > share_of(late->row))) late = &entry;
  }
  if (late != nullptr) found.late = late->runs.front();
  if (all_ok) add_longer(found, entries);
  answer.conditions = common_conditions(entries);
  const auto is_listened = [](const Class& one) { return one.conditions.is_listened; };
  const auto is_imported = [](const Entry& entry) { return entry.row.state == State::imported; };
  if (std::ranges::all_of(entries, is_imported))
    answer.times = "wake-up latencies";
  else if (std::ranges::any_of(entries, [&](const Entry& entry) {
             return is_imported(entry) || entry.runs.front()->run.asked.is_listened();
           }))
    answer.times = "times";
  answer.cautions = cautions_of(entries);

  const auto as_requested = [](State state) { return state == State::ok || state == State::late; };
  auto classes = classes_of(entries, as_requested);
  const bool held = !classes.empty();
  if (!held) classes = classes_of(entries, [](State state) { return state > State::no_limit; });
  // With both round trips and listened messages, the sentence is about the round trips: the experiment.
  std::size_t late_listened = 0;
  if (!std::ranges::all_of(classes, is_listened)) {
    for (const auto& one : classes)
      if (is_listened(one))
        late_listened += static_cast<std::size_t>(
            std::ranges::count_if(one.entries, [](const Entry* entry) { return entry->row.missed > 0; }));
    std::erase_if(classes, is_listened);
  }
  if (classes.empty()) {
    const bool imported = entries.front().row.state == State::imported;
    const bool lacks_limit =
        std::ranges::any_of(answer.rows, [](const Row& row) { return row.state == State::no_limit; });
    std::uint64_t cycles = 0;
    for (const auto& row : answer.rows) cycles += row.cycles;
    answer.sentence = lacks_limit  ? std::string(no_limit_words) + " Lost messages are unknown."
                      : cycles > 0 ? fmt::format("No sample was recorded of {} cycles.", grouped(cycles))
                      : imported   ? "Imported: wake-up latencies of another tool, no messages."
                                   : "Nothing was measured. No message was sent.";
  } else {
    const auto worst = std::ranges::max_element(classes, {}, &Class::high);
    const auto* contrast = contrast_of(classes, *worst);
    const auto left_out = std::ranges::count_if(answer.rows, [&](const Row& row) {
      return held && !as_requested(row.state) && row.state > State::no_limit;
    });
    answer.sentence = sentence_of(classes, &*worst, contrast, left_out == 0);
    if (late_listened > 0)
      answer.sentence += fmt::format(" {} of listened messages {} late.", many(late_listened, "row", "rows"),
                                     late_listened == 1 ? "is" : "are");
    if (!held) answer.sentence += " But no run was measured as requested.";
    if (left_out > 0)
      answer.sentence += fmt::format(" {} of {} {} not measured as requested.", left_out,
                                     many(entries.size(), "row", "rows"), left_out == 1 ? "was" : "were");
    if (contrast != nullptr && worst->high > 0) {
      const auto *from = worst_of(*worst)->runs.front(), *to = contrast->entries.front()->runs.front();
      if (can_compare(summaries, *from, *to)) {
        found.from = from;
        found.to = to;
      }
    }
  }
  answer.sentence += searches_sentence_of(summaries);
  answer.sentence += requirements(entries);
  answer.next = next_steps(found, origin);
  return answer;
}

}  // namespace ontime::report
