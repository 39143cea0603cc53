// SPDX-License-Identifier: Apache-2.0
// A run of which a message is to be explained.
#pragma once

#include <algorithm>
#include <map>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "explain/explain.hpp"
#include "explain/packets.hpp"
#include "explain/timeline.hpp"

namespace ontime::explain {
namespace {

using nlohmann::json;
using roundtrip::Fate;
using roundtrip::Sample;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;
using trace::Event;
using trace::Kind;

constexpr std::int64_t us = 1'000, ms = 1'000'000;
constexpr std::int32_t asks = 10, hears = 11, answers = 20, hog = 99;
constexpr std::int32_t ordinary = 120, fifo_80 = 19;

trace::Thread named(std::int32_t id) {
  switch (id) {
    case 0:
      return {0, "swapper", 120};
    case asks:
      return {asks, "ping-send", ordinary};
    case hears:
      return {hears, "ping-receive", ordinary};
    case answers:
      return {answers, "pong-receive", ordinary};
    default:
      return {id, id == hog ? "hog" : "another", ordinary};
  }
}

// A run of which message 50 is to be explained. The message is due at 500 ms; usual ones take 10 µs to wake,
// 2 to be sent, 50 there, 3 to be answered, 40 back. By a kernel that says how a CPU leaves its idle thread,
// and by one that does not.
class Explained : public testing::TestWithParam<bool> {
 protected:
  static constexpr std::int64_t due = 500 * ms, sent = due + 12 * us;

  Explained() {
    window_.span = {50, due - ms, due + 400 * ms};
    for (std::uint64_t i = 0; i < 100; ++i)
      if (i != 50) samples_.push_back(usual(i));
  }

  static Sample usual(std::uint64_t index) {
    const auto at = static_cast<std::int64_t>(index) * 10 * ms;
    return {.index = index,
            .intended_ns = at,
            .due_ns = at,
            .woke_ns = at + 10 * us,
            .passed_wake_ns = 0,
            .sent_ns = at + 12 * us,
            .received_ns = at + 105 * us,
            .server_received_ns = at + 62 * us,
            .server_sent_ns = at + 65 * us,
            .skipped_cycles = 0,
            .fate = Fate::on_time};
  }
  static Sample late(std::int64_t woke, std::int64_t there, std::int64_t back) {
    auto sample = usual(50);
    sample.woke_ns += woke;
    sample.sent_ns += woke;
    sample.server_received_ns += woke + there;
    sample.server_sent_ns += woke + there;
    sample.received_ns += woke + there + back;
    sample.fate = Fate::late;
    return sample;
  }
  static Sample lost() {
    auto sample = usual(50);
    sample.received_ns = sample.server_received_ns = sample.server_sent_ns = 0;
    sample.fate = Fate::lost;
    return sample;
  }

  void event(std::int64_t at, int cpu, Kind kind, std::int32_t thread, std::int32_t other = 0,
             const std::string& what = "", std::int32_t packet = 0) {
    window_.events.push_back({.at_ns = at,
                              .cpu = cpu,
                              .kind = kind,
                              .thread = named(thread),
                              .other = named(other),
                              .what = what,
                              .packet = packet,
                              .bytes = packet != 0 ? 550 : 0});
  }
  static bool leaving_idle_is_told() { return GetParam(); }
  void switched(std::int64_t at, int cpu, std::int32_t from, const char* state, std::int32_t to) {
    if (from != 0 || leaving_idle_is_told()) event(at, cpu, Kind::switched, from, to, state);
  }
  void sender_wakes(std::int64_t by = 0) {
    event(due + 5 * us + by, 0, Kind::waking, asks, 0, "0");
    switched(due + 8 * us + by, 0, 0, "R", asks);
  }
  void sender_wakes_and_queues(std::int64_t by = 0) {
    sender_wakes(by);
    event(sent + 5 * us + by, 0, Kind::queued, asks, 0, interface_of_controller_, 1);
    event(sent + 6 * us + by, 0, Kind::sent, asks, 0, interface_of_controller_, 1);
  }
  void sender_wakes_and_sends(std::int64_t by = 0) {
    sender_wakes_and_queues(by);
    event(sent + 9 * us + by, 0, Kind::received, asks, 0, interface_of_component_, 1);
  }
  void hog_lets_it_go_on(std::int64_t at) {
    event(at, 1, Kind::waking, answers, hog, "1");
    switched(at + 5 * us, 1, 0, "R", answers);
  }
  void has_the_message() {
    switched(due - ms / 2, 1, hog, "S", 0);
    sender_wakes_and_sends();
    event(sent + 10 * us, 0, Kind::waking, answers, asks, "1");
    switched(sent + 12 * us, 1, 0, "R", answers);
    event(sent + 20 * us, 1, Kind::timer, answers);
    event(sent + 21 * us, 1, Kind::timer_end, answers);
  }
  void in_order() {
    std::stable_sort(window_.events.begin(), window_.events.end(),
                     [](const Event& one, const Event& other) { return one.at_ns < other.at_ns; });
  }
  static std::string advice(const Part& part, const json& asked = {}) {
    record::Run run;
    run.asked = asked;
    return text_of(remedy_for(part, run));
  }
  static json threads(std::initializer_list<std::pair<std::int32_t, const char*>> all) {
    auto list = json::array();
    for (const auto& [tid, role] : all) list.push_back({{"tid", tid}, {"role", role}});
    return list;
  }

  Account account(const Sample& sample, const json& traced = {{"controller", json::object()}}) {
    record::Writer writer("");
    json asked{
        {"id", "x"}, {"payload_bytes", 500}, {"deadline_us", deadline_us_}, {"timeout_us", timeout_us_}};
    asked.update(asked_);
    const auto run = writer.begin_run(asked);
    samples_.insert(samples_.begin() + 50, sample);
    writer.append(run, samples_);
    writer.trace(run, {"controller", window_});
    const json machine = {{"boot_id", "b"}};
    writer.end_run(
        run, {{"trace", traced},
              {"hosts",
               {{"controller",
                 {{"machine", machine},
                  {"threads", controller_threads_},
                  {"link", {{"interface", interface_of_controller_}, {"down", down_["controller"]}}}}},
                {"component",
                 {{"machine", machine},
                  {"transport", component_transport_},
                  {"threads", component_threads_},
                  {"cpu_quota", component_quota_},
                  {"link", {{"interface", interface_of_component_}, {"down", down_["component"]}}}}}}}});
    const auto reader = writer.reader();
    return account_of(reader, reader.runs().at(0));
  }
  Message message(const Sample& sample) {
    const auto account = this->account(sample);
    EXPECT_THAT(account.messages, SizeIs(1));
    return account.messages.at(0);
  }
  static Part first(const Message& message) {
    std::int64_t sum = 0;
    for (const auto& part : message.parts) sum += part.ns;
    EXPECT_EQ(sum, message.delay_ns) << "it adds up";
    return message.parts.empty() ? Part{} : message.parts.front();
  }

  trace::Window window_;
  std::vector<Sample> samples_;
  std::string interface_of_controller_ = "to-component", interface_of_component_ = "to-controller";
  std::map<std::string, json> down_;  // of whose link
  int deadline_us_ = 0, timeout_us_ = 0;
  json asked_ = json::object();  // besides
  json component_transport_;     // as its end reported it
  json component_quota_;
  json controller_threads_ = threads({{asks, "send"}, {hears, "receive"}});
  json component_threads_ = threads({{answers, "receive"}});
};

std::string name_of_kernel(const testing::TestParamInfo<bool>& tells_leaving_idle) {
  return tells_leaving_idle.param ? "TellsLeavingIdle" : "DoesNotTellLeavingIdle";
}

}  // namespace
}  // namespace ontime::explain
