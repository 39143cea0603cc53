// SPDX-License-Identifier: Apache-2.0
#include "search/knobs.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "scenario/scenario.hpp"
#include "settings/settings.hpp"
#include "trace/trace.hpp"
#include "transport/transport.hpp"

namespace ontime::search {
namespace {

constexpr const char* large_buffer = "4 MiB";  // as scenarios say it
constexpr int usual_priority = 60;             // the paper's, of the kernel's threads
constexpr int least_priority = 1, highest_priority = 98;

std::string last_word(const std::string& key) { return key.substr(key.rfind('.') + 1); }
bool is_of_kernel(const std::string& key) { return key.starts_with("kernel."); }
bool is_of_cpus(const std::string& key) { return key.ends_with("cpus"); }
bool is_priority(const std::string& key) {
  return key.ends_with(".priority") || key == "kernel.irq-threads" || key == "kernel.napi-threads" ||
         key == "kernel.ksoftirqd";
}

std::vector<std::string> each_of(const std::vector<int>& cpus) {
  std::vector<std::string> each;
  each.reserve(cpus.size());
  for (const int cpu : cpus) each.push_back(std::to_string(cpu));
  return each;
}

std::vector<Knob> all_knobs(const Bounds& bounds) {
  const auto priority = std::to_string(std::min(usual_priority, bounds.below_priority - 1));
  const auto cpus = each_of(bounds.cpus);
  std::vector<Knob> knobs = {{"realtime", {"on"}},
                             {"realtime.lock-memory", {"on"}},
                             {"realtime.cpu-latency", {"0 us"}},
                             {"kernel.ksoftirqd", {priority}},
                             {"kernel.napi-threads", {priority}},
                             {"kernel.irq-threads", {priority}},
                             {"kernel.napi-cpus", cpus},
                             {"kernel.irq-cpus", cpus},
                             {"kernel.rmem-max", {large_buffer}},
                             {"kernel.rmem-default", {large_buffer}},
                             {"kernel.rt-throttling", {"off"}},
                             {"kernel.coalescing", {"rx-usecs=0"}},
                             {"kernel.gro", {"off"}},
                             {"kernel.busy-poll", {"50"}},
                             {"kernel.timer-migration", {"off"}},
                             {"kernel.governor", {"performance"}}};
  for (const auto& key : conditions::keys())
    if (key.path.starts_with("realtime.") && (key.path.ends_with(".priority") || is_of_cpus(key.path)))
      knobs.push_back({key.path, {}});
  return knobs;
}

// `realtime: on` brings both, and so does each key of realtime.*, which switches all of it on.
bool is_part_of_realtime(const std::string& key) {
  return key == "realtime.lock-memory" || key == "realtime.cpu-latency";
}

// The keys that the knob would change in this run, of all keys and with those that it switches on.
std::set<std::string> changed_by(const Knob& knob, const conditions::Run& run) {
  static const std::vector<std::string> any = {"1", "2"};  // a priority or a CPU: one is not the present one
  const auto before = conditions::to_json(run);
  std::set<std::string> changed;
  for (const auto& value : knob.values.empty() ? any : knob.values) {
    auto with = run;
    if (!knob.part_of.empty()) conditions::key_named(knob.part_of)->set(with, "on");
    conditions::key_named(knob.key)->set(with, value);
    const auto after = conditions::to_json(with);
    for (const auto& key : conditions::keys())
      for (const auto& place : conditions::places_of(key.path))
        if (after.value(place, nlohmann::json()) != before.value(place, nlohmann::json()))
          changed.insert(key.path);
  }
  return changed;
}

bool is_excluded(const std::string& key, const Bounds& bounds) {
  return bounds.never.contains(key) || bounds.never.contains(last_word(key));
}

std::string why_not(const std::string& key, const conditions::Run& run, const Bounds& bounds) {
  if (is_excluded(key, bounds)) return "excluded by --never";
  if (is_part_of_realtime(key) && !run.task.realtime.on) return "realtime: on sets it, too";
  if (is_of_kernel(key) && scenario::any_past_the_kernel(run))
    return "this transport bypasses the kernel's network stack";
  if (is_of_kernel(key) && is_priority(key) && bounds.below_priority <= least_priority)
    return fmt::format("no priority is below {}", bounds.below_priority);
  if (is_of_cpus(key) && bounds.cpus.empty()) return "there is only one CPU";
  if (key.starts_with("kernel.napi-") && explain::stated(run, "kernel.threaded-napi") != "on")
    return "NAPI has threads only with kernel.threaded-napi: on in the scenario";
  return "";
}

// Removes values that change nothing or cannot be set here. Returns why none is left, for people; "": the
// knob can be tried.
std::string why_left_out(Knob& knob, const conditions::Run& run, const Bounds& bounds) {
  if (auto why = why_not(knob.key, run, bounds); !why.empty()) return why;
  if (!bounds.never.empty())
    for (const auto& key : changed_by(knob, run))
      if (is_excluded(key, bounds)) return fmt::format("it sets {}, too, which --never excludes", key);
  const auto present = explain::stated(run, knob.key);
  const auto is_no_change = [&](const std::string& value) {
    if (value != large_buffer) return value == present;
    return !present.empty() && std::stoull(present) >= conditions::bytes_of(value);
  };
  if (std::erase_if(knob.values, is_no_change) > 0 && knob.values.empty())
    return fmt::format("already {}", present);
  std::string last;
  std::erase_if(knob.values, [&](const std::string& value) {
    const auto why = bounds.cannot({knob.key, value});
    if (!why.empty()) last = why;
    return !why.empty();
  });
  return knob.values.empty() ? last : "";
}

// The values that satisfy a remedy's rule, such as "above the priority of X".
std::vector<Setting> resolved(const Setting& setting, const explain::Part& part, const conditions::Run& run,
                              const Bounds& bounds) {
  std::vector<Setting> all;
  if (is_part_of_realtime(setting.key) && !run.task.realtime.on) {
    all = {{"realtime", "on"}};
  } else if (is_of_cpus(setting.key)) {
    for (const auto& cpu : each_of(bounds.cpus)) all.push_back({setting.key, cpu});
  } else if (is_priority(setting.key)) {
    const bool is_ordinary = part.culprit_priority >= trace::least_ordinary;
    const int above = is_ordinary ? 1 : trace::least_ordinary - part.culprit_priority;
    const int least = is_of_kernel(setting.key) ? std::min(usual_priority, bounds.below_priority - 1) : 80;
    const int most = is_of_kernel(setting.key) ? bounds.below_priority - 1 : highest_priority;
    if (above <= most) all.push_back({setting.key, std::to_string(std::max(above, least))});
  } else if (setting.key == "kernel.rmem-max") {
    // The largest buffer that a socket may request, and the default.
    all = {{"kernel.rmem-max", large_buffer}, {"kernel.rmem-default", large_buffer}};
  } else {
    all.push_back(setting);
  }
  return all;
}

}  // namespace

std::vector<std::string> knob_keys() {
  std::vector<std::string> keys;
  for (const auto& knob : all_knobs({})) keys.push_back(knob.key);
  return keys;
}

Knobs knobs_of(const conditions::Run& run, const Bounds& bounds) {
  Knobs knobs;
  for (auto& knob : all_knobs(bounds)) {
    if (knob.key.starts_with("realtime.") && !run.task.realtime.on) knob.part_of = "realtime";
    if (const auto why = why_left_out(knob, run, bounds); why.empty())
      knobs.knobs.push_back(std::move(knob));
    else
      knobs.left_out.push_back({knob.key, why});
  }
  return knobs;
}

std::vector<std::string> contradictions(const conditions::Run& run) {
  std::vector<std::string> all;
  if (auto text = settings::warning(run.kernel, conditions::application_priority(run)); !text.empty())
    all.push_back(std::move(text));
  for (const auto* name : {"rmem-max", "rmem-default"})
    if (const auto found = run.kernel.find(name); found != run.kernel.end())
      if (const auto payload = run.task.client.payload_bytes; std::stoull(found->second) < payload)
        all.push_back(fmt::format("kernel.{} ({} bytes) is smaller than a message ({} bytes): increase it",
                                  name, found->second, payload));
  const auto& qos = run.task.config.qos;
  if (run.faults.loss > 0 && qos.reliability == transport::Reliability::reliable &&
      qos.history == transport::History::keep_last && qos.depth == 1)
    all.emplace_back(
        "qos.reliability: reliable with qos.depth: 1 on a lossy link: the next message replaces a lost one "
        "before it is resent. Increase qos.depth");
  return all;
}

std::vector<Finding> findings_of(const explain::Account& account, const record::Run& run,
                                 std::int64_t slow_ns, const Bounds& bounds) {
  std::vector<Finding> findings;
  for (const auto& message : account.messages) {
    const auto took = message.sample.received_ns - message.sample.sent_ns;
    if (message.parts.empty() || !(message.is_fault() || (slow_ns > 0 && took > slow_ns))) continue;
    const auto& part = message.parts.front();
    const auto cause = explain::sentence_of(part);
    auto found = std::ranges::find(findings, cause, &Finding::cause);
    if (found == findings.end()) {
      found = findings.insert(findings.end(), {cause, 0, {}});
      for (const auto& setting : explain::remedy_for(part, run).settings)
        for (auto& one : resolved(setting, part, run.asked, bounds))
          found->remedies.push_back(std::move(one));
    }
    ++found->messages;
  }
  return findings;
}

}  // namespace ontime::search
