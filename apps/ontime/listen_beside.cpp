// SPDX-License-Identifier: Apache-2.0
#include "listen_beside.hpp"

#include <utility>

#include <fmt/format.h>

#include "listening.hpp"
#include "spelling/spelling.hpp"
#include "terminal.hpp"

namespace ontime::app {
namespace {

using namespace std::chrono_literals;
using nlohmann::json;

// The conditions of the run, which are also those of these messages: only members that differ from the
// defaults.
json asked_around(const campaign::Run& run, const json& command_line) {
  campaign::Run around;
  around.id = fmt::format("{} {}", run.id, run.task.transport);
  around.variant = run.variant;
  around.varied = run.varied;
  around.repetition = run.repetition;
  around.controller_load = run.controller_load;
  around.component_load = run.component_load;
  around.traffic = run.traffic;
  around.faults = run.faults;
  around.cut = run.cut;
  around.kernel = run.kernel;
  around.isolation = run.isolation;
  auto asked = json::object();
  const auto usual = conditions::to_json(campaign::Run{});
  const auto all = conditions::to_json(around);
  for (const auto& [name, value] : all.items())
    if (value != usual.value(name, json())) asked[name] = value;
  asked["command_line"] = command_line;
  return asked;
}

}  // namespace

ListenBeside::ListenBeside(record::Writer& writer, const campaign::Run& run, const json& command_line)
    : topics_(run.listening.topics.begin(), run.listening.topics.end()),
      limits_{run.listening.deadline, run.listening.period, run.listening.age},
      results_(writer, limits_, asked_around(run, command_line), false) {
  thread_ = thread_without_signals([this](const std::stop_token& stop) { listen(stop); });
}

void ListenBeside::listen(const std::stop_token& stop) try {
  const auto sensor = sensor_in_processes(limits_);
  sensor->keep_rows([this](const listen::Row& row) {
    const std::lock_guard lock(mutex_);
    rows_.push_back(row);
  });
  sensor->listen_for(0ms);  // finds the nodes
  there_ = true;
  const auto find = [&] {
    auto findings = sensor->findings();
    const std::lock_guard lock(mutex_);
    findings_ = std::move(findings);
  };
  std::chrono::steady_clock::time_point find_at;
  while (!stop.stop_requested()) {
    sensor->listen_for(200ms);
    // This copies all flows: once a second is enough.
    if (const auto now = std::chrono::steady_clock::now(); now >= find_at) {
      find_at = now + 1s;
      find();
    }
  }
  find();
} catch (const std::exception& error) {
  const std::lock_guard lock(mutex_);
  failure_ = error.what();
}

bool ListenBeside::is_there() const {
  const std::lock_guard lock(mutex_);
  if (!failure_.empty()) throw campaign::Error(3, "listen.topics: " + failure_);
  return there_;
}

listen::Findings ListenBeside::wanted() {
  const std::lock_guard lock(mutex_);
  auto findings = findings_;
  std::erase_if(findings.flows, [this](const auto& flow) { return !topics_.contains(flow.topic); });
  return findings;
}

void ListenBeside::keep_rows() {
  std::vector<listen::Row> rows;
  {
    const std::lock_guard lock(mutex_);
    rows.swap(rows_);
  }
  for (const auto& row : rows) results_.keep(row);
}

void ListenBeside::write() {
  const auto now = std::chrono::steady_clock::now();
  if (now < write_at_) return;
  write_at_ = now + 1s;
  keep_rows();
  results_.write(wanted().flows);
}

std::vector<std::string> ListenBeside::end(bool interrupted) {
  thread_.request_stop();
  thread_.join();
  keep_rows();
  const auto findings = wanted();
  results_.end(findings, interrupted || !failure_.empty());
  // If it failed before it was there, is_there() has thrown.
  if (!failure_.empty())
    return there_ ? std::vector{"listening ended before the run ended: " + failure_}
                  : std::vector<std::string>{};
  std::set<std::string> seen, others;
  for (const auto& flow : findings.flows) seen.insert(flow.topic);
  for (const auto& flow : findings_.flows) others.insert(flow.topic);
  std::vector<std::string> remarks;
  for (const auto& topic : topics_)
    if (!seen.contains(topic))
      remarks.push_back(
          fmt::format("no message of '{}' was seen on this machine{}; list all topics: ontime listen --list",
                      topic, spelling::suggestion(topic, {others.begin(), others.end()})));
  if (auto news = results_.take_news(); !news.empty()) remarks.push_back(std::move(news));
  return remarks;
}

}  // namespace ontime::app
