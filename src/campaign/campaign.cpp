// SPDX-License-Identifier: Apache-2.0
#include "campaign/campaign.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "campaign/session.hpp"
#include "machine/machine.hpp"

namespace ontime::campaign {
namespace {

using namespace std::chrono_literals;
using nlohmann::json;

constexpr auto wait_for_own_server = 10s;
constexpr std::size_t pong_max_payload_bytes = 60'000;  // where none is stated: what every transport carries

double microseconds(std::chrono::nanoseconds time) { return static_cast<double>(time.count()) / 1e3; }

// What a run leaves in the record, however it ends. Returns the exit code.
int carry_out(const Run& run, Session& session, std::chrono::nanoseconds wait, record::Writer& writer,
              Observer& observer, const Interrupts& interrupts, json asked) {
  const auto number = writer.begin_run(asked);
  try {
    const auto outcome = session.measure(wait, number, writer, observer, interrupts);
    writer.end_run(number, outcome);
    observer.ends(agent::counters_of(outcome));
    return interrupts > 0 ? 130 : 0;
  } catch (const Interrupted&) {
    writer.flush();
    return 130;
  } catch (const Error& error) {
    writer.end_run(number, {{"error", error.what()}});
    observer.note(fmt::format("{} over {}: {}", run.id, run.task.transport, error.what()));
    return error.exit;
  }
}

// The hosts of a scenario, made where they are ours to make.
Hosts prepare(const Scenario& scenario, machine::Journal& journal, Observer& observer) {
  auto hosts = scenario.hosts;
  if (hosts.kind == Hosts::Kind::namespaces && !machine::may_join_namespaces()) {
    observer.note(
        "no permission to make network namespaces: the two ends are two processes on loopback instead. "
        "To have two \"machines\", run as root: sudo ontime run …");
    hosts.kind = Hosts::Kind::loopback;
  }
  if (hosts.kind == Hosts::Kind::namespaces) {
    const auto pair = machine::join_namespaces(journal);
    hosts.controller = {{}, pair.controller.prefix, "", pair.controller.interface, pair.controller.address};
    hosts.component = {{}, pair.component.prefix, "", pair.component.interface, pair.component.address};
  } else if (hosts.kind == Hosts::Kind::loopback) {
    hosts.controller = hosts.component = {{}, {}, "", "lo", "127.0.0.1"};
  }
  return hosts;
}

const char* word_of(Hosts::Kind kind) {
  switch (kind) {
    case Hosts::Kind::namespaces:
      return "namespaces";
    case Hosts::Kind::loopback:
      return "loopback";
    case Hosts::Kind::stated:
      return "stated";
  }
  return "";
}

}  // namespace

json asked(const Run& run) {
  const auto& client = run.task.client;
  return {
      {"id", run.id},
      {"title", run.title},
      {"variant", run.variant},
      {"adds_to", run.adds_to},
      {"repetition", run.repetition},
      {"transport", run.task.transport},
      {"options", run.task.config.options},
      {"component_transport", run.component_transport.empty() ? run.task.transport : run.component_transport},
      {"component_options",
       run.component_transport.empty() ? run.task.config.options : run.component_options},
      {"domain", run.task.config.domain},
      {"payload_bytes", client.payload_bytes},
      {"period_us", microseconds(client.period)},
      {"deadline_us", microseconds(client.deadline)},
      {"timeout_us", microseconds(client.timeout)},
      {"duration_s", microseconds(client.duration) / 1e6},
      {"schedule", roundtrip::word_of(client.schedule)},
      {"receive", agent::word_of(run.task.config.receive)},
      {"warm_up", client.warm_up},
      {"realtime", run.task.realtime.on},
      {"realtime_settings", run.task.realtime},
      {"qos", agent::to_json(run.task.config.qos)},
      {"load",
       {{"controller", agent::to_json(run.controller_load)},
        {"component", agent::to_json(run.component_load)}}},
      {"ontime", ONTIME_VERSION}};
}

int execute(const Scenario& scenario, record::Writer& writer, Observer& observer,
            const Interrupts& interrupts, const json& command_line) {
  for (const auto& note : machine::revert_abandoned()) observer.note(note);
  machine::Journal journal;
  const auto hosts = prepare(scenario, journal, observer);
  int code = 0;
  for (std::size_t i = 0; i < scenario.size() && code != 130; ++i) {
    const auto run = scenario.at(i);
    observer.begins(run, i + 1, scenario.size());
    auto record = asked(run);
    record["scenario"] = scenario.text;
    record["scenario_file"] = scenario.file;
    record["hosts"] = word_of(hosts.kind);
    record["command_line"] = command_line;
    {
      Session session(run, hosts.controller, hosts.component);
      code =
          std::max(code, carry_out(run, session, wait_for_own_server, writer, observer, interrupts, record));
    }
    machine::revert_abandoned();  // of an agent that was killed, a folder may still be there
  }
  return code;
}

int ping(const Run& run, std::chrono::nanoseconds wait, record::Writer& writer, Observer& observer,
         const Interrupts& interrupts, const json& command_line) {
  for (const auto& note : machine::revert_abandoned()) observer.note(note);
  auto record = asked(run);
  record["command_line"] = command_line;
  observer.begins(run, 1, 1);
  Session session(run, Host{}, {});
  return carry_out(run, session, wait, writer, observer, interrupts, record);
}

int pong(const Run& run, const Interrupts& interrupts, const std::function<void(const json&)>& told,
         json& closed) {
  agent::Handle agent({});
  auto task = server_task(run, Host{});
  if (run.task.config.max_payload_bytes == 0) task.config.max_payload_bytes = pong_max_payload_bytes;
  agent.order("open", {{"task", task}});
  const auto await = [&](const std::string& name) {
    while (true) {
      const auto event = agent.event(200ms);
      if (event && event->at("event") == name) return *event;
      if (interrupts > 0 && name != "closed") return json();
      if (interrupts > 1) return json();
    }
  };
  const auto opened = await("opened");
  if (opened.is_null()) return 130;
  agent.order("start", {{"wait_ns", 0}});
  await("started");
  told(opened);
  while (interrupts == 0) agent.event(200ms);  // throws if the agent is gone
  agent.order("close");
  closed = await("closed");
  return 130;
}

}  // namespace ontime::campaign
