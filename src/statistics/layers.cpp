// SPDX-License-Identifier: Apache-2.0
#include <array>
#include <functional>
#include <map>
#include <set>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "conditions/conditions.hpp"
#include "statistics/statistics.hpp"

namespace ontime::statistics {
namespace {

using nlohmann::json;
using record::at;
using Value = std::function<std::optional<double>(const Summary&)>;

std::optional<double> round_trip(const Summary& summary) {
  if (summary.round_trip.count == 0) return {};
  return static_cast<double>(summary.round_trip[Figure::p50]);
}

// The sum over all threads that serve messages, on all hosts, per message, times `unit`.
template <typename Number>
Value a_message(std::optional<Number> record::Thread::*value, double unit = 1) {
  return [=](const Summary& summary) -> std::optional<double> {
    double sum = 0;
    std::size_t threads = 0;
    for (const auto& [name, host] : summary.run.outcome.hosts)
      for (const auto& thread : host.threads) {
        if (thread.is_of_background_topics()) continue;
        if (!(thread.*value)) return {};
        sum += static_cast<double>(*(thread.*value));
        ++threads;
      }
    if (threads == 0 || summary.sent == 0) return {};
    return sum / static_cast<double>(summary.sent) * unit;
  };
}

// A session of a file, and a repetition within: what is compared was measured side by side.
using Repetition = std::pair<std::size_t, std::int64_t>;

class Sessions {
 public:
  // In the order of the file. A new session begins with another command line, or with a repetition that the
  // session already has.
  Repetition next(const Summary& summary) {
    const auto number = summary.run.asked.repetition;
    const auto call = std::make_pair(summary.run.asked.command_line, summary.run.asked.scenario_file);
    if (call != call_ || seen_.contains({summary.run.key, number})) {
      ++session_;
      seen_.clear();
      call_ = call;
    }
    seen_.insert({summary.run.key, number});
    return {session_, number};
  }

 private:
  std::size_t session_ = 0;
  std::pair<std::vector<std::string>, std::string> call_;
  std::set<std::pair<std::string, std::int64_t>> seen_;
};

// The complete runs of one key; of an id there may be several.
struct Candidate {
  const Summary* first;
  std::map<Repetition, const Summary*> runs;
};

struct MeasuredLayers {
  std::vector<Candidate> candidates;       // in order of their first run
  std::set<std::string> ids;               // of these
  std::vector<const Summary*> incomplete;  // in order
  std::set<std::string> below;             // ids that others add to
};

MeasuredLayers measured_of(const std::vector<Summary>& summaries) {
  MeasuredLayers all;
  std::map<std::string, std::size_t> by_key;
  Sessions sessions;
  for (const auto& summary : summaries) {
    const auto repetition = sessions.next(summary);
    if (const auto& below = summary.run.asked.adds_to; !below.empty()) all.below.insert(below);
    if (!is_complete(summary.run)) {
      all.incomplete.push_back(&summary);
      continue;
    }
    const auto [found, is_new] = by_key.try_emplace(summary.run.key, all.candidates.size());
    if (is_new) all.candidates.push_back({&summary, {}});
    all.ids.insert(summary.run.asked.id);
    all.candidates[found->second].runs[repetition] = &summary;
  }
  return all;
}

constexpr std::array a_layers_own = {"transport",         "options", "component_transport",
                                     "component_options", "receive", "security"};

json conditions_of(const Summary& summary) {
  auto conditions = record::conditions_of(summary.run.asked.document);
  if (!conditions.is_object()) return json::object();
  conditions.erase("id");
  for (const auto* key : a_layers_own) conditions.erase(key);
  return conditions;
}

// The scenario's key of a record's member: "payload" of "payload_bytes", "qos" of all that is in "qos".
std::string key_of(const std::string& member) {
  if (member == "others") return "components";
  for (const auto& key : conditions::keys()) {
    if (key.json == member) return key.path;
    if (key.json.starts_with(member + ".")) return key.path.substr(0, key.path.find('.'));
  }
  return member;
}

std::set<std::string> differing_keys(const json& one, const json& other) {
  std::set<std::string> keys;
  for (const auto& [key, value] : one.items())
    if (at(other, key.c_str()) != value) keys.insert(key_of(key));
  for (const auto& [key, value] : other.items())
    if (!one.contains(key) && !value.is_null()) keys.insert(key_of(key));
  return keys;
}

// How many of the layer-specific settings two runs share.
std::size_t likeness(const Summary& one, const Summary& other) {
  std::size_t same = 0;
  for (const auto* key : a_layers_own) {
    const auto &here = one.run.asked.stated(key), &there = other.run.asked.stated(key);
    if (!here.is_object()) {
      same += here == there ? 1 : 0;
      continue;
    }
    for (const auto& [name, value] : here.items())
      same += there.contains(name) && there.at(name) == value ? 1 : 0;
  }
  return same;
}

// Sets base, or the reason why it is missing.
const Candidate* find_base(Layer& layer, const std::vector<Candidate>& candidates) {
  const auto conditions = conditions_of(*layer.run);
  std::vector<const Candidate*> best;
  std::set<std::string> differing;
  for (const auto& candidate : candidates) {
    if (candidate.first->run.asked.id != layer.adds_to || candidate.first == layer.run) continue;
    if (const auto keys = differing_keys(conditions, conditions_of(*candidate.first)); !keys.empty()) {
      if (differing.empty() || keys.size() < differing.size()) differing = keys;
      continue;
    }
    const auto here = likeness(*layer.run, *candidate.first);
    const auto there = best.empty() ? 0 : likeness(*layer.run, *best.front()->first);
    if (here > there) best.clear();
    if (best.empty() || here == there) best.push_back(&candidate);
  }
  if (best.size() == 1) {
    layer.base = best.front()->first;
    return best.front();
  }
  if (best.size() > 1)
    layer.no_base = fmt::format("{} runs of '{}' match it equally well", best.size(), layer.adds_to);
  else if (differing.empty())
    layer.no_base = fmt::format("'{}' was not measured", layer.adds_to);
  else
    layer.no_base = fmt::format("no run of '{}' has the same {}", layer.adds_to, fmt::join(differing, ", "));
  return nullptr;
}

Cost cost(const Candidate& layer, const Candidate* base, const Value& value) {
  std::vector<double> totals, differences;
  for (const auto& [repetition, run] : layer.runs) {
    const auto here = value(*run);
    if (!here) continue;
    totals.push_back(*here);
    if (base == nullptr) continue;
    const auto below = base->runs.find(repetition);
    if (below == base->runs.end()) continue;
    if (const auto there = value(*below->second)) differences.push_back(*here - *there);
  }
  return {estimate(totals), estimate(differences)};
}

std::string reason_of(const Summary& incomplete) {
  const auto& outcome = incomplete.run.outcome;
  return outcome.has_ended() ? outcome.error.value_or("interrupted") : "not ended";
}

}  // namespace

Layers layers(const std::vector<Summary>& summaries) {
  const auto all = measured_of(summaries);
  Layers result;
  for (const auto& candidate : all.candidates) {
    Layer layer;
    layer.run = candidate.first;
    layer.adds_to = candidate.first->run.asked.adds_to;
    if (layer.adds_to.empty() && !all.below.contains(candidate.first->run.asked.id)) continue;
    const auto* base = layer.adds_to.empty() ? nullptr : find_base(layer, all.candidates);
    layer.round_trip_ns = cost(candidate, base, round_trip);
    layer.cpu_ns = cost(candidate, base, a_message(&record::Thread::cpu_time_us, 1e3));
    layer.instructions = cost(candidate, base, a_message(&record::Thread::instructions));
    result.measured.push_back(layer);
  }
  auto told = all.ids;
  for (const auto* summary : all.incomplete) {
    const auto& id = summary->run.asked.id;
    if ((all.below.contains(id) || !summary->run.asked.adds_to.empty()) && told.insert(id).second)
      result.missing.push_back({id, reason_of(*summary)});
  }
  for (const auto& id : all.below)
    if (told.insert(id).second) result.missing.push_back({id, ""});
  return result;
}

}  // namespace ontime::statistics
