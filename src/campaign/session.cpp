// SPDX-License-Identifier: Apache-2.0
#include "campaign/session.hpp"

#include <fmt/format.h>

namespace ontime::campaign {
namespace {

using namespace std::chrono_literals;
using nlohmann::json;
using Clock = std::chrono::steady_clock;

// Longer than anything takes on a machine under full load; only a hang lasts so long.
constexpr auto patience = 120s;

std::vector<std::string> before_the_program(const Host& host) {
  auto words = host.reach;
  words.insert(words.end(), host.place.begin(), host.place.end());
  return words;
}

agent::Task client_task(const Run& run, const Host& host, const std::optional<Host>& component) {
  auto task = run.task;
  task.config.role = transport::Role::client;
  task.config.max_payload_bytes = task.client.payload_bytes;
  if (!host.interface.empty()) task.config.interface = host.interface;
  if (component) task.config.peers = {component->address};
  task.load = run.controller_load;
  return task;
}

json host_record(const json& opened, const json& closed) {
  json host{{"machine", opened.at("machine")}, {"transport", opened.at("transport")}};
  host["transport"]["facts"] = closed.at("facts");
  host["threads"] = closed.at("threads");
  host["refusals"] = closed.at("refusals");
  host["load_running"] = closed.at("load_running");
  return host;
}

}  // namespace

agent::Task server_task(const Run& run, const Host& host) {
  auto task = run.task;
  task.config.role = transport::Role::server;
  if (task.config.max_payload_bytes == 0) task.config.max_payload_bytes = task.client.payload_bytes;
  if (!host.interface.empty()) task.config.interface = host.interface;
  task.load = run.component_load;
  if (!run.component_transport.empty()) {
    task.transport = run.component_transport;
    task.config.options = run.component_options;
  }
  return task;
}

Session::Session(const Run& run, const Host& controller, const std::optional<Host>& component)
    : run_(run), controller_host_(controller), component_host_(component) {}

json Session::await(End& end, const std::string& event, const Interrupts& interrupts, int tolerated) {
  const auto until = Clock::now() + patience;
  while (Clock::now() < until) {
    if (interrupts > tolerated) throw Interrupted{};
    const auto got = end.agent.event(100ms);
    if (got && got->at("event") == event) return *got;
  }
  throw Error(
      3, fmt::format("the agent of {} did not come to '{}' within {} s", end.host, event, patience.count()));
}

void Session::open(End& end, const agent::Task& task, Observer& observer, const Interrupts& interrupts) {
  end.agent.order("open", {{"task", task}});
  end.opened = await(end, "opened", interrupts);
  for (const auto& note : end.opened.at("notes")) observer.note(note);
}

json Session::measure(std::chrono::nanoseconds wait, std::int64_t number, record::Writer& writer,
                      Observer& observer, const Interrupts& interrupts) {
  if (component_host_) {
    component_.emplace(End{"component", agent::Handle(before_the_program(*component_host_)), {}, {}});
    open(*component_, server_task(run_, *component_host_), observer, interrupts);
  }
  controller_.emplace(End{"controller", agent::Handle(before_the_program(controller_host_)), {}, {}});
  open(*controller_, client_task(run_, controller_host_, component_host_), observer, interrupts);

  std::vector<End*> loaded;
  if (run_.controller_load.any()) loaded.push_back(&*controller_);
  if (run_.component_load.any() && component_) loaded.push_back(&*component_);
  for (auto* end : loaded) end->agent.order("load");
  for (auto* end : loaded) await(*end, "loaded", interrupts);

  controller_->agent.order("start", {{"wait_ns", wait.count()}});
  const auto finished = pump(number, writer, observer, interrupts);

  json hosts = json::object(), conditions = json::object();
  for (auto* end : {&controller_, &component_}) {
    if (!*end) continue;
    (*end)->agent.order("close");
    (*end)->closed = await(**end, "closed", interrupts, 1);
    hosts[(*end)->host] = host_record((*end)->opened, (*end)->closed);
    conditions[(*end)->host] = (*end)->closed.at("conditions");
  }
  auto outcome = finished.at("counters");
  outcome["interrupted"] = interrupts > 0;
  outcome["hosts"] = hosts;
  outcome["conditions"] = conditions;
  return outcome;
}

// Until the client has finished: its samples to the record, its progress to the observer.
json Session::pump(std::int64_t number, record::Writer& writer, Observer& observer,
                   const Interrupts& interrupts) {
  bool stopped = false;
  auto started = Clock::now();
  while (true) {
    if (interrupts > 1) throw Interrupted{};
    if (interrupts > 0 && !stopped) {
      stopped = true;
      controller_->agent.order("stop");
    }
    const auto event = controller_->agent.event(100ms);
    if (component_) component_->agent.event(0ms);  // throws if it is gone
    if (!event) continue;
    const std::string name = event->at("event");
    if (name == "measuring") {
      started = Clock::now();
      // Only now: what the warm-up made the server's threads do for the first time is not of the run.
      if (component_) component_->agent.order("start", {{"wait_ns", 0}});
    }
    if (name == "samples") writer.append(number, agent::samples_of(event->at("samples")));
    if (name == "progress")
      observer.progress(
          agent::counters_of(event->at("counters")),
          std::min<std::chrono::nanoseconds>(Clock::now() - started, run_.task.client.duration));
    if (name == "finished") return *event;
  }
}

}  // namespace ontime::campaign
