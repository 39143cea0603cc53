// SPDX-License-Identifier: Apache-2.0
#include "keeper/flows.hpp"

#include <algorithm>

namespace ontime::keeper {
namespace {

using nlohmann::json;

constexpr double late_report_s = 1;  // of an iperf3 that is starved, but still runs

}  // namespace

void Flows::add(const std::string& host, const std::string& way, const background::Stream& stream) {
  flows_.push_back({host, way, background::traffic(stream), {}});
}

void Flows::listen() {
  for (auto& flow : flows_) flow.traffic->moved();
}

void Flows::begin() {
  for (auto& flow : flows_) flow.before = flow.traffic->moved();
  begun_ = Clock::now();
}

json Flows::end() {
  const std::chrono::duration<double> elapsed = Clock::now() - begun_;
  auto account = json::object();
  for (auto& flow : flows_) {
    const bool running = flow.traffic->running();
    const auto bit_s = bits_per_second(flow.before, flow.traffic->moved(), elapsed, running);
    account[flow.host][flow.way] = {{"bit_s", bit_s ? json(*bit_s) : json()}, {"running", running}};
  }
  return account;
}

std::optional<double> bits_per_second(const background::Moved& before, const background::Moved& after,
                                      std::chrono::duration<double> elapsed, bool running) {
  const double reported = after.seconds - before.seconds;
  const double time = std::max(reported, elapsed.count() - (running ? late_report_s : 0));
  if (time <= 0) return {};
  return (after.bits - before.bits) / time;
}

}  // namespace ontime::keeper
