// SPDX-License-Identifier: Apache-2.0
// The settings of the two processes: their memory and threads.
#include "conditions/fields.hpp"

namespace ontime::conditions {
namespace {

using nlohmann::json;
using realtime::Policy;
using realtime::ThreadSettings;
using std::chrono::nanoseconds;

constexpr int paper_priority = 80;       // of what a message passes through
constexpr int background_priority = 70;  // of a middleware's other threads
const std::vector<std::string> message_roles{"send", "receive", "delivery"};
const std::vector<std::string> background_roles{"discovery", "timer", "other"};

// The paper's settings, and a latency request that it did not have: everything else builds on them.
void set_realtime_on(Run& run) {
  auto& settings = run.task.realtime;
  if (settings.on) return;
  settings.on = settings.lock_memory = true;
  settings.cpu_latency = std::chrono::microseconds(0);
  for (const auto& role : message_roles)
    settings.threads[role] = {.policy = Policy::fifo, .priority = paper_priority, .cpus = {}};
  for (const auto& role : background_roles)
    settings.threads[role] = {.policy = Policy::fifo, .priority = background_priority, .cpus = {}};
}

void set_realtime(Run& run, Text text) {
  run.realtime_refused = !yes_or_no(text);
  if (run.realtime_refused)
    run.task.realtime = {};
  else
    set_realtime_on(run);
}

json json_of(const RealtimeSettings&);

using SetSettings = std::function<void(RealtimeSettings&, Text)>;
// `parts`: of realtime_settings.
Field setting(Field how, const std::vector<std::string>& parts, SetSettings set) {
  how.end = both;
  for (const auto& part : parts) how.parts.push_back("realtime_settings." + part);
  how.stated = [set](Text text) {
    RealtimeSettings settings;
    set(settings, text);
    return json_of(settings);
  };
  return said(std::move(how), [set = std::move(set)](Run& run, Text text) {
    if (!run.realtime_refused) set_realtime_on(run);
    auto settings = run.task.realtime;
    set(settings, text);  // an invalid value is refused even where it has no effect
    if (!run.realtime_refused) run.task.realtime = std::move(settings);
  });
}

// The limit of idle states' exit latency: the kernel takes whole microseconds.
std::optional<std::chrono::microseconds> cpu_latency_of(Text text) {
  if (text == "any") return {};
  const auto latency = duration_of(text);
  const auto whole = std::chrono::duration_cast<std::chrono::microseconds>(latency);
  if (whole.count() < 0 || whole.count() > std::numeric_limits<std::int32_t>::max() || whole != latency)
    throw std::invalid_argument(
        fmt::format("'{}' is not a whole number of microseconds from 0 to 2147483647", text));
  return whole;
}

bool has_priority(Policy policy) { return policy == Policy::fifo || policy == Policy::round_robin; }

void set_policy(ThreadSettings& thread, Text text) {
  static const auto policies =
      words({Policy::other, Policy::fifo, Policy::round_robin, Policy::deadline}, realtime::word_of);
  thread.policy = policies.of_text(text);
  if (!has_priority(thread.policy)) thread.priority = 0;
  if (has_priority(thread.policy) && thread.priority == 0) thread.priority = paper_priority;
}
void set_priority(ThreadSettings& thread, Text text) {
  thread.priority = static_cast<int>(number_of(text, 1, 99));
}
void set_cpus(ThreadSettings& thread, Text text) {
  const auto cpus = realtime::cpus_of(text);
  if (!cpus)
    throw std::invalid_argument(
        fmt::format("'{}' is not a list of CPUs from 0 to 1023, such as 1 or 0-1,3", text));
  thread.cpus = *cpus;
}

void add_threads(Fields& all, const std::string& path, const std::string& flag,
                 const std::vector<std::string>& roles, const std::string& whose) {
  const auto each = [&](const char* name, const char* values, const std::string& help,
                        void (*set)(ThreadSettings&, Text)) {
    std::vector<std::string> parts;
    parts.reserve(roles.size());
    for (const auto& role : roles) parts.push_back(fmt::format("threads.{}.{}", role, name));
    all.push_back(setting({path + "." + name, flag + name, values, help + whose}, parts,
                          [set, roles](RealtimeSettings& settings, Text text) {
                            for (const auto& role : roles) set(settings.threads[role], text);
                          }));
  };
  each("policy", "other|fifo|rr|deadline", "policy of ", set_policy);
  each("priority", "1-99", "priority of ", set_priority);
  each("cpus", "LIST", "CPU affinity of ", set_cpus);
}

json json_of(const ThreadSettings& settings) {
  json to{{"policy", realtime::word_of(settings.policy)}, {"priority", settings.priority}};
  if (!settings.cpus.empty()) to["cpus"] = realtime::list_of(settings.cpus);
  if (settings.policy == Policy::deadline) {
    to["runtime_ns"] = settings.runtime.count();
    to["deadline_ns"] = settings.deadline.count();
    to["period_ns"] = settings.period.count();
  }
  return to;
}

ThreadSettings thread_of(Json from) {
  const auto time = [&](const char* name) {
    return nanoseconds(whole<std::int64_t>(from.value(name, json(0))));
  };
  return {.policy = realtime::policy_of(from.at("policy")).value(),
          .priority = whole<int>(from.at("priority")),
          .cpus = realtime::cpus_of(from.value("cpus", "")).value_or(std::vector<int>{}),
          .runtime = time("runtime_ns"),
          .deadline = time("deadline_ns"),
          .period = time("period_ns")};
}

json json_of(const RealtimeSettings& settings) {
  auto threads = json::object();
  for (const auto& [role, thread] : settings.threads) threads[role] = json_of(thread);
  return {{"on", settings.on},
          {"lock_memory", settings.lock_memory},
          {"cpu_latency_us", settings.cpu_latency ? json(settings.cpu_latency->count()) : json()},
          {"threads", threads}};
}

RealtimeSettings settings_of(Json from) {
  RealtimeSettings settings{
      .on = from.at("on"), .lock_memory = from.at("lock_memory"), .cpu_latency = {}, .threads = {}};
  if (const auto& latency = from.at("cpu_latency_us"); !latency.is_null())
    settings.cpu_latency = std::chrono::microseconds(whole<std::int32_t>(latency));
  for (const auto& [role, thread] : from.at("threads").items()) settings.threads[role] = thread_of(thread);
  return settings;
}

}  // namespace

Fields realtime_fields() {
  Fields all{
      said(field({"realtime", "--realtime", "",
                  "lock memory; avoid deep idle states; SCHED_FIFO 80 for threads that a message passes "
                  "through, 70 for the middleware's others",
                  both},
                 "realtime", on_or_off(), within(&Run::task, &Task::realtime, &RealtimeSettings::on)),
           set_realtime),
      setting({"realtime.lock-memory", "--lock-memory", "on|off",
               "lock and touch all memory before the first message"},
              {"lock_memory"}, [](auto& settings, Text text) { settings.lock_memory = yes_or_no(text); }),
      setting(
          {"realtime.cpu-latency", "--cpu-latency", "TIME|any", "longest exit latency of a CPU idle state"},
          {"cpu_latency_us"},
          [](auto& settings, Text text) { settings.cpu_latency = cpu_latency_of(text); })};
  add_threads(all, "realtime", "--", message_roles, "the threads that a message passes through");
  for (const auto& roles : {message_roles, background_roles})
    for (const auto& role : roles)
      add_threads(all, "realtime." + role, "--" + role + "-", {role}, "threads of role " + role);
  all.push_back(recorded(
      "realtime_settings",
      Codec<RealtimeSettings>{{}, {}, [](const auto& settings) { return json_of(settings); }, settings_of},
      within(&Run::task, &Task::realtime)));
  return all;
}

int application_priority(const Run& run) {
  constexpr int above_all = 100;
  std::optional<int> least;
  for (const auto& role : message_roles) {
    const auto thread = run.task.realtime.threads.find(role);
    if (thread == run.task.realtime.threads.end()) continue;
    const bool is_deadline = thread->second.policy == realtime::Policy::deadline;
    const int its = is_deadline ? above_all : thread->second.priority;
    least = std::min(least.value_or(its), its);
  }
  return least.value_or(0);
}

}  // namespace ontime::conditions
