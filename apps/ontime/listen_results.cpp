// SPDX-License-Identifier: Apache-2.0
#include "listen_results.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "table/table.hpp"

namespace ontime::app {
namespace {

using namespace std::chrono_literals;
using listen::Row;
using nlohmann::json;

// A writer is recognized by its stamps after eight messages; until then its flow has no name for it.
constexpr auto named_after = 12s;
constexpr std::size_t most_notes = 1000;  // that wait to be written

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

bool has_both_ends(const listen::Flow& flow) {
  return !flow.topic.empty() && flow.writer != listen::Party{} && flow.reader != listen::Party{};
}

json microseconds(std::optional<std::chrono::nanoseconds> limit) {
  return limit ? json(std::chrono::duration<double, std::micro>(*limit).count()) : json();
}

}  // namespace

ListenResults::ListenResults(record::Writer& writer, const listen::Limits& limits, json asked,
                             bool is_recording)
    : writer_(writer), limits_(limits), asked_(std::move(asked)), is_recording_(is_recording) {}

void ListenResults::forget() {
  for (const auto& [key, kept] : kept_)
    if (kept.run != 0) writer_.forget_run(kept.run);
  kept_.clear();
}

void ListenResults::add(Kept& kept, const roundtrip::Sample& sample) {
  const bool is_lost = sample.fate == roundtrip::Fate::lost;
  kept.lost += is_lost ? 1 : 0;
  kept.late += sample.fate == roundtrip::Fate::late ? 1 : 0;
  // It came after all.
  if (kept.last && sample.index < kept.last->index && !is_lost) --kept.lost;
  if (!kept.last || sample.index > kept.last->index) kept.last = sample;
  kept.samples.push_back(sample);
  ++waiting_;
}

void ListenResults::keep(const Row& row) {
  if (!failure_.empty()) return;
  roundtrip::Sample sample{};
  sample.index = row.index;
  // Clocks that moved: an age below zero counts as zero.
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
  add(kept_[{row.flow, row.quantity}], sample);
}

std::int64_t ListenResults::begin(const listen::Flow& flow, Row::Quantity quantity) {
  const auto topic = flow.topic.empty() ? "(unknown topic)" : table::printable(flow.topic);
  const auto beside = asked_.value("id", "");
  const auto id = fmt::format("{}{}{} {}", beside, beside.empty() ? "" : " ", topic, word_of(quantity));
  const auto varied = asked_.value("variant", "");
  auto variant = name_of(flow, false);
  // Processes of one name, and several readers in one process.
  for (int number = 1; !names_.insert(fmt::format("{}\n{}", id, variant)).second; ++number)
    variant = name_of(flow, true) + (number > 1 ? fmt::format(" #{}", number) : "");
  ++runs_;
  auto asked = asked_;
  asked.update(
      {{"id", id},
       {"measures", word_of(quantity)},
       {"topic", flow.topic},
       {"variant", varied.empty() ? variant : varied + ", " + variant},
       {"flow", variant},  // a condition: other ends are not compared with these
       {"repetition", asked_.value("repetition", 1)},
       {"schedule", "back-to-back"},  // of its own accord: no cycle is known in which a message was due
       {"deadline_us", microseconds(quantity == Row::Quantity::period ? limits_.longest_gap()
                                    : flow.between.empty()            ? limits_.age
                                                                      : flow.chain_limit)},
       {"ontime", ONTIME_VERSION}});
  return writer_.begin_run(asked);
}

// A disk that is full ends neither listening nor what is printed.
template <class Do>
void ListenResults::until_it_fails(const Do& what) {
  if (!failure_.empty()) return;
  try {
    what();
  } catch (const record::Error& error) {
    failure_ = error.what();
    kept_.clear();
  }
}

void ListenResults::write(const std::vector<listen::Flow>& wanted) {
  until_it_fails([&] { write(wanted, false); });
}

void ListenResults::write(const std::vector<listen::Flow>& wanted, bool is_end) {
  waiting_ = 0;
  std::map<std::uint64_t, const listen::Flow*> flows;
  for (const auto& flow : wanted) flows.emplace(flow.id, &flow);
  for (auto& [key, kept] : kept_) {
    if (kept.samples.empty()) continue;
    if (kept.run == 0) {
      const auto flow = flows.find(key.first);
      const bool is_old = is_end || Clock::now() - kept.since > named_after;
      if (flow != flows.end() && (is_old || has_both_ends(*flow->second)))
        kept.run = begin(*flow->second, key.second);
      else if (is_old)
        kept.samples.clear();
    }
    if (kept.run == 0) continue;
    writer_.append(kept.run, kept.samples);
    kept.samples.clear();
    for (const auto& note : kept.notes) writer_.note(kept.run, note);
    kept.notes.clear();
  }
}

void ListenResults::note(const listen::Miss& miss) {
  if (!miss.why || !miss.why->is_seen || !failure_.empty()) return;
  const auto quantity = miss.kind == listen::Miss::Kind::age ? Row::Quantity::age : Row::Quantity::period;
  auto& kept = kept_[{miss.flow, quantity}];
  if (kept.notes.size() < most_notes)
    kept.notes.push_back(
        {record::cause_of_late,
         fmt::format("{:.1f} ms late: {}{}", static_cast<double>(miss.value_ns) / 1e6, miss.why->sentence,
                     miss.why->fix.empty() ? "" : "; fix: " + miss.why->fix),
         miss.course.taken_ns, std::nullopt});
}

// A topic that fell silent is late until the end: its last period has no message that ends it.
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
  found->second.notes.push_back(
      {"silent",
       fmt::format("no message came in the last {:.1f} s", static_cast<double>(flow.silent_ns) / 1e9),
       std::nullopt, std::nullopt});
}

json ListenResults::outcome_of(const listen::Flow* flow, Row::Quantity quantity, const Kept& kept) const {
  const bool is_age = quantity == Row::Quantity::age;
  json outcome{{"loss_unknown", !is_age || flow == nullptr || !flow->lost}};
  if (flow == nullptr || !is_age) return outcome;
  outcome.update({{"duplicates", flow->duplicated}, {"reordered", flow->reordered}});
  // Lost in such numbers, or so near to the end, that not each has a row.
  const auto missing = static_cast<std::int64_t>(flow->lost.value_or(0)) - kept.lost;
  if (missing > 0)
    outcome.update(
        {{"dropped_records", missing},
         {"sent", static_cast<std::int64_t>(flow->age ? flow->age->count() : 0) + kept.lost + missing},
         {"late", kept.late},
         {"lost", kept.lost + missing}});
  return outcome;
}

void ListenResults::end(const listen::Findings& wanted, bool interrupted) {
  until_it_fails([&] { end_runs(wanted, interrupted); });
}

void ListenResults::end_runs(const listen::Findings& wanted, bool interrupted) {
  std::map<std::uint64_t, const listen::Flow*> flows;
  for (const auto& flow : wanted.flows) {
    flows.emplace(flow.id, &flow);
    add_silence(flow);
  }
  write(wanted.flows, true);
  const auto machine = machine::describe();
  const auto activity = machine::between(before_, machine::activity());
  for (const auto& [key, kept] : kept_) {
    if (kept.run == 0) continue;
    const auto found = flows.find(key.first);
    auto outcome = outcome_of(found == flows.end() ? nullptr : found->second, key.second, kept);
    outcome["interrupted"] = interrupted;
    if (!is_recording_)
      outcome.update(
          {{"hosts", {{"controller", {{"machine", machine}}}}}, {"conditions", {{"controller", activity}}}});
    const auto note = [this, run = kept.run](const char* kind, const std::string& text) {
      writer_.note(run, {kind, text, std::nullopt, std::nullopt});
    };
    if (wanted.sensor_lost > 0)
      note("sensor-lost", fmt::format("the sensor lost {} events of all topics: no loss and no period is "
                                      "counted across them",
                                      wanted.sensor_lost));
    if (left_out_ > 0)
      note("left-out", fmt::format("{} messages of all topics had times that no clock shows", left_out_));
    writer_.end_run(kept.run, outcome);
  }
  writer_.flush();
}

}  // namespace ontime::app
