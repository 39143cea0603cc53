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

// A writer is recognized by its stamps after a second or so; until then its flow has no name for it.
constexpr auto named_after = 5s;

const char* word_of(Row::Quantity quantity) { return quantity == Row::Quantity::age ? "age" : "period"; }

std::string name_of(const listen::Party& party, const char* unknown, bool with_process) {
  auto name = party.name.empty() ? unknown : table::printable(party.name);
  return with_process && party.process != 0 ? fmt::format("{} [{}]", name, party.process) : name;
}

std::string name_of(const listen::Flow& flow, bool with_processes) {
  return fmt::format("{} → {}", name_of(flow.writer, "(writer not seen)", with_processes),
                     name_of(flow.reader, "(no reader seen)", with_processes));
}

bool has_both_ends(const listen::Flow& flow) {
  return !flow.topic.empty() && flow.writer != listen::Party{} && flow.reader != listen::Party{};
}

json microseconds(std::optional<std::chrono::nanoseconds> limit) {
  return limit ? json(std::chrono::duration<double, std::micro>(*limit).count()) : json();
}

}  // namespace

ListenResults::ListenResults(const std::string& path, const listen::Limits& limits, const json& command_line,
                             bool is_recording)
    : writer_(path), limits_(limits), command_line_(command_line), is_recording_(is_recording) {}

void ListenResults::forget() {
  for (const auto& [key, kept] : kept_)
    if (kept.run != 0) writer_.forget_run(kept.run);
  kept_.clear();
}

void ListenResults::keep(const Row& row) {
  roundtrip::Sample sample{};
  sample.index = row.index;
  sample.intended_ns = sample.due_ns = sample.woke_ns = sample.sent_ns = row.from_ns;
  // Clocks that moved: an age below zero counts as zero.
  sample.received_ns = row.to_ns == 0 ? 0 : std::max(row.to_ns, row.from_ns);
  sample.fate = row.to_ns == 0 ? roundtrip::Fate::lost
                : row.is_late  ? roundtrip::Fate::late
                               : roundtrip::Fate::on_time;
  kept_[{row.flow, row.quantity}].samples.push_back(sample);
  ++waiting_;
}

std::int64_t ListenResults::begin(const listen::Flow& flow, Row::Quantity quantity) {
  const auto topic = flow.topic.empty() ? "(unknown topic)" : table::printable(flow.topic);
  const auto id = fmt::format("{} {}", topic, word_of(quantity));
  auto variant = name_of(flow, false);
  if (!names_.insert(id + "\n" + variant).second) variant = name_of(flow, true);
  ++runs_;
  return writer_.begin_run(
      {{"id", id},
       {"measures", word_of(quantity)},
       {"topic", flow.topic},
       {"variant", variant},
       {"repetition", 1},
       {"schedule", "back-to-back"},  // of its own accord: no cycle is known in which a message was due
       {"deadline_us", microseconds(quantity == Row::Quantity::age ? limits_.age : limits_.longest_gap())},
       {"ontime", ONTIME_VERSION},
       {"command_line", command_line_}});
}

void ListenResults::write(const std::vector<listen::Flow>& wanted) { write(wanted, false); }

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
  }
}

void ListenResults::note(const listen::Miss& miss) {
  if (!miss.why || !miss.why->is_seen) return;
  const auto quantity = miss.kind == listen::Miss::Kind::age ? Row::Quantity::age : Row::Quantity::period;
  const auto kept = kept_.find({miss.flow, quantity});
  if (kept == kept_.end() || kept->second.run == 0) return;
  writer_.note(kept->second.run,
               {record::cause_of_late,
                fmt::format("{:.1f} ms late: {}{}", static_cast<double>(miss.value_ns) / 1e6,
                            miss.why->sentence, miss.why->fix.empty() ? "" : "; fix: " + miss.why->fix),
                miss.course.taken_ns, std::nullopt});
}

void ListenResults::end(const listen::Findings& wanted, bool interrupted) {
  write(wanted.flows, true);
  const auto machine = machine::describe();
  const auto activity = machine::between(before_, machine::activity());
  std::map<std::uint64_t, const listen::Flow*> flows;
  for (const auto& flow : wanted.flows) flows.emplace(flow.id, &flow);
  for (const auto& [key, kept] : kept_) {
    if (kept.run == 0) continue;
    json outcome{{"interrupted", interrupted}};
    if (!is_recording_)
      outcome.update(
          {{"hosts", {{"controller", {{"machine", machine}}}}}, {"conditions", {{"controller", activity}}}});
    const auto found = flows.find(key.first);
    const bool is_age = key.second == Row::Quantity::age;
    if (found != flows.end() && is_age)
      outcome.update({{"duplicates", found->second->duplicated}, {"reordered", found->second->reordered}});
    if (found != flows.end() && !is_age && found->second->silent_ns > 0)
      writer_.note(kept.run, {"silent",
                              fmt::format("no message came in the last {:.1f} s",
                                          static_cast<double>(found->second->silent_ns) / 1e9),
                              std::nullopt, std::nullopt});
    if (wanted.sensor_lost > 0)
      writer_.note(kept.run, {"sensor-lost",
                              fmt::format("the sensor lost {} events of all topics: no loss and no period is "
                                          "counted across them",
                                          wanted.sensor_lost),
                              std::nullopt, std::nullopt});
    writer_.end_run(kept.run, outcome);
  }
  writer_.flush();
}

}  // namespace ontime::app
