// SPDX-License-Identifier: Apache-2.0
#include "listen_results.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "gate/gate.hpp"
#include "listen_words.hpp"
#include "table/table.hpp"

namespace ontime::app {
namespace {

using namespace std::chrono_literals;
using listen::Row;
using nlohmann::json;

// A writer is recognized after eight stamps; until then its flow has no name for it.
constexpr auto named_after = 12s;
constexpr std::size_t most_notes = 1000;  // waiting to be written
constexpr std::size_t most_worst = 4;     // waiting to be written, of a flow
// A miss is known at most this long after its message arrived.
constexpr std::int64_t known_within_ns = 5'000'000'000;
constexpr std::chrono::seconds outcome_every = 1min;  // a kill or a power cut loses at most this much of it
const char* word_of(Row::Quantity quantity) { return quantity == Row::Quantity::age ? "age" : "period"; }

std::string name_of(const listen::Party& party, const char* unknown, bool with_process) {
  auto name = party.name.empty() ? unknown : table::printable(party.name);
  return with_process && party.process != 0 ? fmt::format("{} [{}]", name, party.process) : name;
}

std::string name_of(const listen::Flow& flow, bool with_processes) {
  auto name = name_of(flow.writer, "(writer not seen)", with_processes);
  for (const auto& node : flow.between) name += " → " + name_of(node, "(unknown)", with_processes);
  return name + " → " + name_of(flow.reader, "(no reader seen)", with_processes);
}

enum class Twin { none, possible, certain };

// Whether another flow has the same names. An end that is not known yet may have any.
Twin twin_of(const listen::Flow& flow, const std::vector<listen::Flow>& all) {
  const auto fit = [](const listen::Party& one, const listen::Party& other) {
    return one.name.empty() || other.name.empty() || one.name == other.name;
  };
  auto twin = Twin::none;
  for (const auto& other : all) {
    if (other.id == flow.id || other.topic != flow.topic || other.has_ended) continue;
    if (name_of(other, false) == name_of(flow, false)) return Twin::certain;
    if (other.between.empty() && fit(flow.writer, other.writer) && fit(flow.reader, other.reader))
      twin = Twin::possible;
  }
  return twin;
}

bool has_both_ends(const listen::Flow& flow) {
  return !flow.topic.empty() && flow.writer != listen::Party{} && flow.reader != listen::Party{};
}

json microseconds(std::optional<std::chrono::nanoseconds> limit) {
  return limit ? json(std::chrono::duration<double, std::micro>(*limit).count()) : json();
}

}  // namespace

ListenResults::ListenResults(record::Writer& writer, const listen::Limits& limits, json asked,
                             bool is_recording, bool keeps_worst)
    : writer_(writer),
      limits_(limits),
      asked_(std::move(asked)),
      is_recording_(is_recording),
      keeps_worst_(keeps_worst) {}

void ListenResults::forget() {
  for (const auto& [key, kept] : kept_)
    if (kept.run != 0) writer_.forget_run(kept.run);
  kept_.clear();
}

void ListenResults::add(Kept& kept, const roundtrip::Sample& sample, bool was_lost) {
  const bool is_lost = sample.fate == roundtrip::Fate::lost;
  kept.is_told = false;
  if (!is_lost) kept.values.add(sample.received_ns - sample.sent_ns);
  kept.lost += is_lost ? 1 : 0;
  kept.late += sample.fate == roundtrip::Fate::late ? 1 : 0;
  kept.lost -= was_lost ? 1 : 0;
  if (!kept.last || sample.index > kept.last->index) kept.last = sample;
  if (!keeps_worst_) {
    if (failed_) kept.samples.clear();  // the last one is enough to try whether it can be written
    kept.samples.push_back(sample);
    waiting_ += failed_ ? 0 : 1;
    return;
  }
  kept.latest.push_back(sample);
  const auto is_old = [&](const roundtrip::Sample& one) {
    return one.sent_ns < sample.sent_ns - known_within_ns;
  };
  while (kept.latest.size() > std::size_t{2 * record::samples_around} && is_old(kept.latest.front()))
    kept.latest.pop_front();
}

void ListenResults::keep(const Row& row) {
  if (failed_ && is_recording_) return;
  roundtrip::Sample sample{};
  sample.index = row.index;
  // If a clock was set, an age below zero counts as zero.
  const auto from_ns = row.to_ns == 0 ? row.from_ns : std::min(row.from_ns, row.to_ns);
  constexpr std::int64_t most_ns = std::int64_t{1} << 60;
  if (std::max(from_ns, row.to_ns) > most_ns || from_ns < -most_ns) {
    ++left_out_;
    return;
  }
  sample.intended_ns = sample.due_ns = sample.woke_ns = sample.sent_ns = from_ns;
  sample.received_ns = row.to_ns;
  sample.fate = row.to_ns == 0 ? roundtrip::Fate::lost
                : row.is_late  ? roundtrip::Fate::late
                               : roundtrip::Fate::on_time;
  add(kept_[{row.flow, row.quantity}], sample, row.was_lost);
}

void ListenResults::begin(Kept& kept, const listen::Flow& flow, Row::Quantity quantity, bool has_twin) {
  const auto topic = flow.topic.empty() ? "(unknown topic)" : table::printable(flow.topic);
  const auto beside = asked_.value("id", "");
  const auto id = fmt::format("{}{}{} {}", beside, beside.empty() ? "" : " ", topic, word_of(quantity));
  const auto varied = asked_.value("variant", "");
  // Not only of the second: another recording may see it first.
  auto variant = name_of(flow, has_twin);
  // Processes may share a name, and a process may have several readers.
  const auto name = [&] { return fmt::format("{}\n{}", id, variant); };
  for (int number = 1; names_.contains(name()); ++number)
    variant = name_of(flow, true) + (number > 1 ? fmt::format(" #{}", number) : "");
  auto asked = asked_;
  asked.update({{"id", id},
                {"measures", word_of(quantity)},
                {"topic", flow.topic},
                {"variant", varied.empty() ? variant : varied + ", " + variant},
                {"flow", variant},  // a condition: only the same writer and reader are compared
                {"repetition", asked_.value("repetition", 1)},
                {"schedule", "back-to-back"},  // no cycle is known in which a message was due
                {"deadline_us", microseconds(quantity == Row::Quantity::period ? limits_.longest_gap()
                                             : flow.between.empty()            ? limits_.age
                                                                               : flow.chain_limit)},
                {"ontime", ONTIME_VERSION}});
  if (keeps_worst_) asked["kept"] = "worst";
  kept.run = writer_.begin_run(asked);
  kept.name = name();
  names_.insert(kept.name);
  ++runs_;
}

void ListenResults::write(const std::vector<listen::Flow>& wanted, bool is_end) {
  waiting_ = 0;
  std::map<std::uint64_t, const listen::Flow*> flows;
  for (const auto& flow : wanted) flows.emplace(flow.id, &flow);
  const auto now = Clock::now();
  for (auto next = kept_.begin(); next != kept_.end();) {
    const auto one = next++;
    auto& [key, kept] = *one;
    const auto found = flows.find(key.first);
    const auto* flow = found == flows.end() ? nullptr : found->second;
    if (flow != nullptr)
      kept.counted = {flow->lost, flow->duplicated, flow->reordered,
                      flow->not_judged + flow->lost_not_judged};
    if (kept.samples.empty() && kept.latest.empty()) {
      if (flow == nullptr && kept.run == 0) kept_.erase(one);
      continue;
    }
    if (kept.run == 0) {
      const bool is_old = is_end || now - kept.since > named_after;
      const auto twin = flow != nullptr ? twin_of(*flow, wanted) : Twin::none;
      if (flow != nullptr && (is_old || (has_both_ends(*flow) && twin != Twin::possible)))
        begin(kept, *flow, key.second, twin == Twin::certain);
      else if (is_old)
        kept_.erase(one);
      if (flow == nullptr || kept.run == 0) continue;
    }
    writer_.append(kept.run, kept.samples);
    kept.samples.clear();
    for (const auto& note : kept.notes) writer_.note(kept.run, note);
    kept.notes.clear();
    if (!keeps_worst_) continue;
    const bool has_worst = !kept.worst.empty();  // which are within what is counted
    write_worst(kept);
    const bool has_gone = flow == nullptr && !is_end;  // its processes ended, and it was forgotten
    // Many topics have one message when a node starts, and then none for weeks.
    if (!has_gone && !has_worst && (kept.is_told || (kept.told_at && now - *kept.told_at < kept.tell_after)))
      continue;
    if (kept.told_at && !has_worst) kept.tell_after = std::min(2 * kept.tell_after, outcome_every);
    kept.told_at = now;
    kept.is_told = true;
    auto outcome = outcome_of(key.second, kept);
    outcome.update(recent_about());
    if (!has_gone) {
      outcome["counted_until_s"] = std::time(nullptr);
      outcome["recorder_began_s"] = began_s_;
      writer_.note_outcome(kept.run, outcome);
      continue;
    }
    writer_.end_run(kept.run, outcome);
    note_not_judged(kept);
    names_.erase(kept.name);
    kept_.erase(one);
  }
  // A recording waits for the disk, as nothing is missed meanwhile: else it fills the memory with what waits.
  if (is_recording_) writer_.flush();
}

void ListenResults::note(const listen::Miss& miss) {
  if (failed_ && is_recording_) return;
  const bool is_age = miss.kind == listen::Miss::Kind::age;
  const auto quantity = is_age ? Row::Quantity::age : Row::Quantity::period;
  auto& kept = kept_[{miss.flow, quantity}];
  kept.is_told = false;
  if (miss.why) ++(miss.why->is_seen ? kept.causes.seen : kept.causes.not_seen);
  if (failed_) return;  // else what waits fills the memory
  const auto row_in = [&](const auto& rows) -> std::optional<roundtrip::Sample> {
    const auto row = std::find_if(rows.rbegin(), rows.rend(), [&](const auto& sample) {
      return sample.fate == roundtrip::Fate::late && sample.received_ns - sample.sent_ns == miss.value_ns &&
             (miss.course.taken_ns == 0 || sample.received_ns == miss.course.taken_ns);  // 0: of a packet
    });
    return row == rows.rend() ? std::nullopt : std::optional(*row);
  };
  const auto row = keeps_worst_ ? row_in(kept.latest) : row_in(kept.samples);
  std::optional<record::Note> cause;
  if (miss.why && (miss.why->is_seen || !keeps_worst_))  // of the worst, `explain` looks at the trace again
    cause = note_of(miss, (is_age ? limits_.age : limits_.longest_gap()).value_or(0ns), keeps_worst_,
                    row ? std::optional(row->index) : std::nullopt);
  if (keeps_worst_) {
    if (row) keep(kept, *row, &miss, std::move(cause));
    // Causes that were not seen leave space for those that were.
  } else if (cause && kept.notes.size() < (miss.why->is_seen ? most_notes : most_notes / 2)) {
    kept.notes.push_back(*cause);
  }
}

void ListenResults::keep(Kept& kept, const roundtrip::Sample& sample, const listen::Miss* miss,
                         std::optional<record::Note> cause) {
  Bad bad{.value_ns = sample.received_ns - sample.sent_ns,
          .at_ns = sample.received_ns,
          .cause = std::move(cause)};
  // Of messages that one delay made late, only the worst is kept: its window has the others.
  const auto same = std::ranges::find_if(
      kept.worst, [&](const Bad& one) { return std::abs(one.at_ns - bad.at_ns) <= listen::window_after_ns; });
  if (same != kept.worst.end()) {
    if (same->value_ns >= bad.value_ns) return;
    kept.worst.erase(same);
  }
  const auto index = static_cast<std::int64_t>(sample.index);
  for (const auto& one : kept.latest)
    if (std::abs(static_cast<std::int64_t>(one.index) - index) <= record::samples_around)
      bad.around.push_back(one);
  bad.trace.host = record::both_hosts[0];
  if (miss != nullptr && miss->surroundings) {
    bad.trace.window = miss->surroundings->window;
    bad.trace.way = listen::way_of(*miss);
  } else {
    bad.trace.window = {{0, sample.sent_ns, sample.received_ns}, false, {}};
  }
  bad.trace.window.span.message = sample.index;
  kept.worst.push_back(std::move(bad));
  if (kept.worst.size() > most_worst)
    kept.worst.erase(
        std::min_element(kept.worst.begin(), kept.worst.end(),
                         [](const Bad& one, const Bad& other) { return one.value_ns < other.value_ns; }));
}

void ListenResults::write_worst(Kept& kept) {
  for (const auto& bad : kept.worst) {
    writer_.append(kept.run, bad.around);
    if (bad.cause) writer_.note(kept.run, *bad.cause);
    writer_.trace(kept.run, bad.trace);
  }
  kept.worst.clear();
}

// A silent topic is late until the end: no message ends its last period.
void ListenResults::add_silence(const listen::Flow& flow) {
  const auto found = kept_.find({flow.id, Row::Quantity::period});
  if (flow.silent_ns <= 0 || found == kept_.end() || !found->second.last) return;
  auto sample = *found->second.last;
  const auto from_ns = sample.received_ns;
  ++sample.index;
  sample.intended_ns = sample.due_ns = sample.woke_ns = sample.sent_ns = from_ns;
  sample.received_ns = from_ns + flow.silent_ns;
  sample.fate = roundtrip::Fate::late;
  add(found->second, sample);
  if (keeps_worst_) keep(found->second, sample, nullptr, std::nullopt);
  found->second.notes.push_back(
      {"silent", fmt::format("no message came {}", silence_of(flow)), std::nullopt, std::nullopt});
}

json ListenResults::outcome_of(Row::Quantity quantity, const Kept& kept) const {
  const bool is_age = quantity == Row::Quantity::age;
  const auto counted = counted_of(kept);
  json outcome{{"loss_unknown", !is_age || !counted.lost}};
  if (is_age) outcome.update({{"duplicates", counted.duplicated}, {"reordered", counted.reordered}});
  if (kept.causes.seen + kept.causes.not_seen > 0) outcome["causes"] = record::to_json(kept.causes);
  // Losses without rows: too many in a row, or too close to the end.
  const auto lost = is_age ? static_cast<std::int64_t>(counted.lost.value_or(0)) : 0;
  const auto without_rows = std::max<std::int64_t>(lost - kept.lost, 0);
  const auto missing = without_rows + kept.not_recorded;
  if (missing == 0 && !keeps_worst_) return outcome;
  outcome.update({{"sent", static_cast<std::int64_t>(kept.values.count()) + kept.lost + without_rows},
                  {"late", kept.late},
                  {"lost", kept.lost + without_rows}});
  if (!keeps_worst_) {
    outcome["dropped_records"] = missing;
  } else if (const auto& values = kept.values; values.count() > 0) {
    outcome["histogram"] = {{"values", values.values()},
                            {"beyond", 0},
                            {"beyond_from_ns", 0},
                            {"max_ns", values.max_ns()},
                            {"mean_ns", values.sum_ns() / static_cast<double>(values.count())}};
  }
  return outcome;
}

void ListenResults::note_not_judged(const Kept& kept) {
  if (const auto not_judged = counted_of(kept).not_judged; not_judged > 0)
    writer_.note(kept.run,
                 {"not-judged",
                  fmt::format("{} messages of the flow are not judged: ontime was setting or removing probes",
                              not_judged),
                  std::nullopt, std::nullopt});
}

ListenResults::Counted ListenResults::counted_of(const Kept& kept) {
  auto counted = kept.counted;
  const auto& before = kept.counted_before;
  if (counted.lost) *counted.lost -= std::min(*counted.lost, before.lost.value_or(0));
  for (const auto part : {&Counted::duplicated, &Counted::reordered, &Counted::not_judged})
    counted.*part -= std::min(counted.*part, before.*part);
  return counted;
}

// In the run of its ages, or, where none is known, of its periods.
void ListenResults::note_open_age(const listen::Flow& flow) {
  const auto text = open_age_of(flow);
  if (!is_recording_ || text.empty() || (!limits_.age && !is_age_known(flow))) return;
  for (const auto quantity : {Row::Quantity::age, Row::Quantity::period}) {
    const auto found = kept_.find({flow.id, quantity});
    if (found == kept_.end() || found->second.run == 0) continue;
    writer_.note(found->second.run,
                 {limits_.age ? gate::open_note : "age-unknown", limits_.age ? "open: --age: " + text : text,
                  std::nullopt, std::nullopt});
    return;
  }
}

json ListenResults::about_machine() const {
  if (is_recording_) return json::object();
  return {{"hosts", {{"controller", {{"machine", machine::describe()}}}}},
          {"conditions", {{"controller", machine::between(before_, machine::activity())}}}};
}

// It is of a preliminary outcome as well, with each late message that is kept: not measured each time.
const json& ListenResults::recent_about() {
  const auto now = Clock::now();
  if (!about_at_ || now - *about_at_ > outcome_every / 2) {
    about_ = about_machine();
    about_at_ = now;
  }
  return about_;
}

void ListenResults::end_runs(const listen::Findings& wanted, bool interrupted, const std::string& pauses) {
  write(wanted.flows, true);
  if (gaps_ > 0 || failed_) count_not_recorded();
  const auto about = about_machine();
  for (const auto& flow : wanted.flows) note_open_age(flow);
  for (const auto& [key, kept] : kept_) {
    if (kept.run == 0) continue;
    auto outcome = outcome_of(key.second, kept);
    outcome["interrupted"] = interrupted;
    outcome.update(about);
    const auto note = [this, run = kept.run](const char* kind, const std::string& text) {
      writer_.note(run, {kind, text, std::nullopt, std::nullopt});
    };
    if (wanted.sensor_lost > 0) note("sensor-lost", unseen_of(wanted.sensor_lost));
    for (const auto& remark : wanted.incomplete) note("incomplete", remark);
    note_not_judged(kept);
    if (!pauses.empty()) note("pauses", pauses);
    if (left_out_ > 0)
      note("left-out",
           fmt::format("{} messages of all topics are left out: their times are invalid", left_out_));
    writer_.end_run(kept.run, outcome);
  }
  writer_.flush();
}

void ListenResults::end(const listen::Findings& wanted, bool interrupted, const std::string& pauses) {
  until_it_fails([&] {
    for (const auto& flow : wanted.flows) add_silence(flow);
    end_runs(wanted, interrupted, pauses);
    if (is_recording_) forget_known();
  });
}

// A recording that is imported again is no repetition. By its own clock, its last message has the same times.
void ListenResults::forget_known() {
  const auto reader = writer_.reader();
  const auto runs = reader.runs();
  for (const auto& [key, kept] : kept_) {
    const auto own = std::ranges::find(runs, kept.run, &record::Run::number);
    if (own == runs.end()) continue;
    const auto is_same = [&, last = *kept.last](const record::Run& other) {
      if (other.key != own->key || other.outcome.document != own->outcome.document) return false;
      std::size_t same = 0, all = 0;
      try {
        reader.each_sample(other.number, last.index, [&](const roundtrip::Sample& sample) {
          ++all;
          if (sample.sent_ns == last.sent_ns && sample.received_ns == last.received_ns) ++same;
        });
      } catch (const record::Error&) {  // it is damaged
        return false;
      }
      return same == 1 && all == 1;
    };
    if (std::none_of(runs.begin(), own, is_same)) continue;
    writer_.forget_run(kept.run);
    --runs_;
    ++known_;
  }
}

std::vector<record::Note> notes_of(const record::Reader& reader, const record::Run& run) {
  auto notes = reader.notes(run.number);
  // By when its message was taken: of an older file, or of a message that was written before its cause was
  // known.
  std::map<std::int64_t, record::Note*> unnamed;
  for (auto& note : notes)
    if (record::tells_of_late(note) && note.at_ns && !note.message) unnamed[*note.at_ns] = &note;
  const bool keeps_worst = run.asked.keeps_worst();
  if (unnamed.empty() && !keeps_worst) return notes;
  std::map<std::uint64_t, std::int64_t> values_ns;
  reader.each_sample(run.number, [&](const auto& sample) {
    if (sample.fate != roundtrip::Fate::late) return;
    if (keeps_worst) values_ns[sample.index] = sample.received_ns - sample.sent_ns;
    if (const auto found = unnamed.find(sample.received_ns); found != unnamed.end())
      found->second->message = sample.index;
  });
  if (!keeps_worst) return notes;
  reader.each_trace(run.number, [&](const record::Trace& trace) {
    const auto message = trace.window.span.message;
    const auto miss = listen::explained_again(trace.way, trace.window);
    if (!miss) return;
    std::erase_if(notes, [&](const auto& note) {
      return note.kind == record::cause_of_late && note.message == message;
    });
    notes.push_back(note_of(*miss, run.asked.task.client.deadline, true, message));
  });
  std::ranges::stable_sort(notes, std::greater(), [&](const record::Note& note) {
    const auto found = note.message ? values_ns.find(*note.message) : values_ns.end();
    return found == values_ns.end() ? 0 : found->second;
  });
  return notes;
}

}  // namespace ontime::app
