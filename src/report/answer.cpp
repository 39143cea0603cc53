// SPDX-License-Identifier: Apache-2.0
#include "report/answer.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "gate/gate.hpp"
#include "report/answer_entries.hpp"
#include "report/comparison.hpp"
#include "report/conditions.hpp"
#include "report/runs.hpp"
#include "report/words.hpp"

namespace ontime::report {
namespace {

using Row = Answer::Row;
using State = Answer::State;

// --- the sentence ---

struct Class {
  Regime regime;
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
    if (!is_meant(entry.row.state) || entry.row.cycles == 0 || !entry.row.knows_missed) continue;
    if (std::ranges::all_of(entry.runs, has_no_sample)) continue;
    const auto regime = regime_of(*entry.runs.front());
    auto same = std::ranges::find(classes, regime, &Class::regime);
    if (same == classes.end()) same = classes.insert(classes.end(), {regime, {}});
    same->entries.push_back(&entry);
    same->low = std::min(same->low, share_of(entry.row));
    same->high = std::max(same->high, share_of(entry.row));
  }
  return classes;
}

// "traffic, load or link faults".
std::string listed(std::vector<std::string> all, const char* before_last) {
  const auto last = all.back();
  all.pop_back();
  return all.empty() ? last : join(all, ", ") + before_last + last;
}
// `lacking`: what other runs have, if this is none.
std::string stress_words(const std::vector<Stress>& stress, const std::string& lacking) {
  if (stress.empty()) return "without " + lacking;
  return (stress.front().what.starts_with("link") ? "with " : "under ") +
         listed(words_of(stress, " of another component"), " and ");
}
std::string tuned_words(const std::vector<std::string>& tuned, const std::string& lacking) {
  return tuned.empty() ? "without " + lacking
                       : "with " + replace_all(listed(tuned, " and "), "RT", "real-time settings");
}
// What a class is without: all that any of these have.
struct Lacking {
  std::string stress = "load", tuned = "real-time settings";
};
Lacking lacking_of(const std::vector<Class>& classes) {
  std::vector<std::string> stress, tuned;
  for (const auto& one : classes) {
    for (const auto& each : one.regime.stress) add_once(stress, each.what);
    for (const auto& each : one.regime.tuned) add_once(tuned, replace_all(each, "RT", "real-time settings"));
  }
  Lacking lacking;
  if (!stress.empty()) lacking.stress = listed(stress, " or ");
  if (!tuned.empty()) lacking.tuned = listed(tuned, " or ");
  return lacking;
}
// The parts of a regime that the sentence names.
struct Named {
  bool stress = false, tuned = false;
};
std::string words_of(const Regime& regime, Named parts, const Lacking& lacking) {
  auto stress = stress_words(regime.stress, lacking.stress), tuned = tuned_words(regime.tuned, lacking.tuned);
  if (!parts.tuned) return stress;
  if (!parts.stress) return tuned;
  return stress + (regime.stress.empty() ? " and " : " ") + tuned;
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
    return one.regime.stress == worst.regime.stress ? 2 : one.regime.tuned == worst.regime.tuned ? 1 : 0;
  };
  for (const auto& one : classes)
    if (&one != &worst && (best == nullptr || rank(one) > rank(*best))) best = &one;
  return best;
}

const Entry* worst_of(const Class& one) {
  return *std::ranges::max_element(one.entries, {}, [](const Entry* entry) { return share_of(entry->row); });
}

std::string worst_named(const Class& worst) {
  if (worst.entries.size() < 2 || worst.low == worst.high) return "";
  const bool with_id = worst.entries.front()->row.id != worst.entries.back()->row.id;
  return fmt::format("; worst: {}", name_of(worst_of(worst)->row, with_id));
}

// Of rows that the sentence is not about.
struct Counted {
  std::uint64_t all = 0, missed = 0;
};
// A robot's own messages apart: they are no cycles, and have no answer.
struct CountedApart {
  Counted cycles, messages;
  void add(const Entry& entry) {
    auto& of = entry.runs.front()->run.asked.is_listened() ? messages : cycles;
    of.all += entry.row.cycles;
    of.missed += entry.row.missed;
  }
};

std::string no_sample_words(const CountedApart& counted) {
  std::vector<std::string> all;
  if (counted.cycles.all > 0) all.push_back(many(counted.cycles.all, "cycle", "cycles"));
  if (counted.messages.all > 0) all.push_back(many(counted.messages.all, "message", "messages"));
  return all.empty() ? "" : fmt::format("No sample was recorded of {}.", join(all, " and "));
}

// `whose`: "its" or "their".
std::string missed_words(const CountedApart& counted, const char* whose) {
  std::vector<std::string> all;
  for (const auto& [of, how] : {std::pair(counted.cycles, "cycles had no answer in time"),
                                {counted.messages, "messages were late or lost"}})
    if (of.missed > 0)
      all.push_back(fmt::format("{} of {} {} {}", grouped(of.missed), whose, grouped(of.all), how));
  return all.empty() ? "" : ": " + join(all, ", ");
}

constexpr const char* no_limit_words =
    "No limit is set (--deadline, --period, --age): no message counts as late.";

// Of a robot's own messages, whose class has some that can be late or lost.
std::string sentence_of_listened(const Class& all) {
  const auto any = [&](auto... knows) {
    return std::ranges::any_of(all.entries, [&](const Entry* entry) {
      return std::ranges::all_of(entry->runs, [&](const auto* run) { return (knows(run->run) && ...); });
    });
  };
  const bool has_limit = any(statistics::knows_late), knows_loss = any(statistics::knows_loss);
  if (all.high > 0)
    return fmt::format("{} of the messages were late or lost{}.", all.range(), worst_named(all));
  if (!knows_loss)
    return fmt::format("{} Lost messages are unknown.", has_limit ? "No message was late." : no_limit_words);
  if (!has_limit) return fmt::format("No message was lost. {}", no_limit_words);
  return any(statistics::knows_late, statistics::knows_loss)
             ? "No message was late or lost."
             : "No message was late or lost, as far as is known.";
}

// One class: its total. Two classes: their contrast. Never pooled over opposite conditions.
std::string sentence_of(const std::vector<Class>& classes, const Class* worst, const Class* contrast,
                        bool is_of_all) {
  if (worst->regime.is_listened) return sentence_of_listened(*worst);
  const auto within = in_time(classes);
  if (worst->high == 0) {
    std::uint64_t cycles = 0, skipped = 0;
    for (const auto& one : classes)
      for (const auto* entry : one.entries) {
        cycles += entry->row.cycles;
        for (const auto* run : entry->runs) skipped += statistics::fates_of(*run).skipped;
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
  const bool same_stress = worst->regime.stress == contrast->regime.stress;
  const bool same_tuned = worst->regime.tuned == contrast->regime.tuned;
  const auto lacking = lacking_of(classes);
  // Both parts, if these alone name another class, too.
  const auto name = [&](const Class& of, Named parts, bool is_beside_the_other) {
    const bool is_clear = std::ranges::none_of(classes, [&](const Class& one) {
      return &one != &of && !(is_beside_the_other && &one == contrast) &&
             (!parts.stress || one.regime.stress == of.regime.stress) &&
             (!parts.tuned || one.regime.tuned == of.regime.tuned);
    });
    return words_of(of.regime, is_clear ? parts : Named{true, true}, lacking);
  };
  const bool is_idle = same_stress && worst->regime.stress.empty();
  auto first = name(*worst, {.stress = !is_idle, .tuned = is_idle || !worst->regime.tuned.empty()}, true);
  const auto other = name(*contrast, {.stress = !same_stress, .tuned = !same_tuned}, false);
  first.front() = static_cast<char>(std::toupper(first.front()));
  return fmt::format("{} {} of the cycles had no answer {}; {} {}.", first, worst->range(), within, other,
                     contrast->range());
}

// Where no row is as requested: one of its repetitions may be.
std::string unfit_words(const std::vector<Entry>& entries, const Origin& origin) {
  std::size_t runs = 0, unfit = 0;
  for (const auto& entry : entries)
    for (const auto* run : entry.runs) {
      const auto state = state_of(*run, origin.running_from);
      if (state == State::running) continue;
      runs += state > State::no_limit ? 1 : 0;
      unfit += state > State::late ? 1 : 0;
    }
  if (unfit == 0) return "";
  if (unfit == runs) return " No run was measured as requested.";
  return fmt::format(" {} of {} runs {} not measured as requested.", unfit, runs,
                     unfit == 1 ? "was" : "were");
}

std::string running_words(const Summaries& summaries, const Origin& origin) {
  std::vector<std::int64_t> running;
  for (const auto& run : summaries)
    if (state_of(run, origin.running_from) == State::running) running.push_back(run.run.number);
  if (running.size() == 1) return fmt::format(" Run {} is being measured.", running.front());
  return running.empty() ? "" : fmt::format(" {} runs are being measured.", running.size());
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

// --- what to do next ---

// Whether a later one of the same scenario is complete in namespaces: without root, both ends are on
// loopback.
// --resume measures neither again.
bool is_measured_elsewhere(const Summary& run, const Summaries& all) {
  const auto is_on = [](const Summary& one, const char* hosts) {
    return record::at(one.run.asked.document, "hosts") == hosts;
  };
  if (!is_on(run, "loopback")) return false;
  const auto conditions_of = [](const record::Asked& asked) {
    auto conditions = record::conditions_of(asked.document);
    conditions.erase("hosts");
    return conditions;
  };
  const auto& asked = run.run.asked;
  return std::ranges::any_of(all, [&](const Summary& other) {
    return other.run.number > run.run.number && is_on(other, "namespaces") &&
           other.run.asked.id == asked.id && other.run.asked.scenario == asked.scenario &&
           other.run.asked.repetition == asked.repetition && statistics::is_complete(other.run) &&
           conditions_of(other.run.asked) == conditions_of(asked);
  });
}

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
  // A command is for all runs of its scenarios: the slowest of them takes longest.
  const auto& longer = found.longer->run.asked;
  const auto is_of_command = [&](const record::Asked& asked) {
    if (longer.scenario_file.empty()) return false;
    return asked.scenario_file == longer.scenario_file ||
           (!longer.command_line.empty() && asked.command_line == longer.command_line);
  };
  for (const auto& entry : entries)
    for (const auto* run : entry.runs)
      if (run == found.longer || is_of_command(run->run.asked))
        found.longer_ns =
            std::max(found.longer_ns, statistics::messages_to_claim(claim, run->missed_probability.effect) *
                                          run->message_every_ns);
  found.longer_tells =
      fmt::format("Prove < 1 miss in {}", grouped(static_cast<std::uint64_t>(std::llround(1 / claim))));
}

std::string common_conditions(const std::vector<Entry>& entries) {
  Group runs;
  for (const auto& entry : entries) runs.insert(runs.end(), entry.runs.begin(), entry.runs.end());
  using Client = roundtrip::ClientOptions;
  std::vector<std::string> unseen;  // what differs between rows that do not say so
  const auto common = [&](const char* name, const char* word, auto Client::*member,
                          auto form) -> std::string {
    const auto value_of = [&](const auto* run) { return run->run.asked.task.client.*member; };
    if (std::ranges::any_of(runs, [&](const auto* run) { return !run->run.asked.stated(name).is_number(); }))
      return "";
    const auto first = value_of(runs.front());
    if (std::ranges::all_of(runs, [&](const auto* run) { return value_of(run) == first; }))
      return form(first);
    if (std::ranges::any_of(entries, [&](const Entry& entry) {
          return entry.row.name.find(form(value_of(entry.runs.front()))) == std::string::npos;
        }))
      unseen.push_back(word);
    return "";
  };
  std::vector<std::string> parts;
  auto message = common("payload_bytes", "payload", &Client::payload_bytes, size);
  if (std::ranges::none_of(runs, [](const auto* run) {
        return run->run.asked.task.client.schedule == roundtrip::Schedule::back_to_back;
      }))
    if (const auto period = common("period_us", "period", &Client::period, duration); !period.empty())
      message += (message.empty() ? "every " : " every ") + period;
  if (!message.empty()) parts.push_back(message);
  if (const auto time = common("duration_s", "duration", &Client::duration, duration); !time.empty())
    parts.push_back(time + " a run");
  // The deadline is told only where it differs.
  common("deadline_us", "deadline", &Client::deadline, duration);
  std::vector<std::string> texts;
  if (!parts.empty()) texts.push_back(join(parts, ", "));
  if (!unseen.empty())
    texts.push_back(listed(unseen, " and ") + (unseen.size() == 1 ? " differs" : " differ"));
  return join(texts, "; ");
}

}  // namespace

Answer answer_of(const Summaries& summaries, const Origin& origin) {
  Answer answer;
  const auto entries = entries_of(summaries, origin.running_from);
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
      if (const auto of = state_of(*run, origin.running_from);
          found.unfinished == nullptr && (of == State::failed || of == State::cut_off) &&
          !is_measured_elsewhere(*run, summaries))
        found.unfinished = run;
    }
    if (entry.row.missed > 0 && (late == nullptr || share_of(entry.row) > share_of(late->row))) late = &entry;
  }
  if (late != nullptr) found.late = late->runs.front();
  if (all_ok && !origin.running_from) add_longer(found, entries);
  answer.conditions = common_conditions(entries);
  const auto is_listened = [](const Class& one) { return one.regime.is_listened; };
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
    const bool lacks_limit = std::ranges::any_of(
        answer.rows, [](const Row& row) { return row.state != State::imported && !row.knows_missed; });
    const bool has_open = std::ranges::any_of(answer.rows, &Row::open_requirement);
    const bool is_running =
        std::ranges::any_of(answer.rows, [](const Row& row) { return row.state == State::running; });
    CountedApart counted;
    for (const auto& entry : entries) counted.add(entry);
    const auto no_sample = no_sample_words(counted);
    answer.sentence = lacks_limit && has_open ? "Nothing tells which messages were late or lost."
                      : lacks_limit           ? std::string(no_limit_words) + " Lost messages are unknown."
                      : !no_sample.empty()    ? no_sample
                      : imported              ? "Imported: wake-up latencies of another tool, no messages."
                      : is_running            ? "No message is recorded yet."
                                              : "Nothing was measured. No message was sent.";
  } else {
    const auto worst = std::ranges::max_element(classes, {}, &Class::high);
    const auto* contrast = contrast_of(classes, *worst);
    std::size_t left_out = 0;
    bool is_of_all = true;
    CountedApart counted;  // of these
    for (const auto& entry : entries) {
      const auto state = entry.row.state;
      if (!held || as_requested(state) || state <= State::no_limit) continue;
      is_of_all = false;
      if (state == State::running) continue;
      ++left_out;
      counted.add(entry);
    }
    answer.sentence = sentence_of(classes, &*worst, contrast, is_of_all);
    if (late_listened > 0)
      answer.sentence += fmt::format(" {} of listened messages {} late or lost ones.",
                                     many(late_listened, "row", "rows"), late_listened == 1 ? "has" : "have");
    if (!held) answer.sentence += unfit_words(entries, origin);
    if (left_out > 0)
      answer.sentence += fmt::format(" {} of {} {} not measured as requested{}.", left_out,
                                     many(entries.size(), "row", "rows"), left_out == 1 ? "was" : "were",
                                     missed_words(counted, left_out == 1 ? "its" : "their"));
    if (contrast != nullptr && worst->high > 0) {
      const auto *from = worst_of(*worst)->runs.front(), *to = contrast->entries.front()->runs.front();
      if (can_compare(summaries, *from, *to)) {
        found.from = from;
        found.to = to;
      }
    }
  }
  answer.sentence += running_words(summaries, origin);
  answer.sentence += searches_sentence_of(summaries);
  answer.sentence += requirements(entries);
  answer.next = next_steps(found, origin);
  return answer;
}

}  // namespace ontime::report
