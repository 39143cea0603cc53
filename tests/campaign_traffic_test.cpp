// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "campaign/traffic.hpp"
#include "campaign_scenario.hpp"

namespace ontime::campaign {
namespace {

using namespace std::chrono_literals;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;

const Hosts two{Hosts::Kind::stated,
                {"", {}, {"left"}, "", "eth0", "10.0.0.1"},
                {{"component", {"", {}, {"right"}, "", "eth1", "10.0.0.2:99"}}},
                {},
                {}};

TEST(Address, IsWithoutItsPort) {
  EXPECT_EQ(without_port("10.0.0.2:99"), "10.0.0.2");
  EXPECT_EQ(without_port("robot:99"), "robot");
  for (const auto* address : {"10.0.0.2", "robot", "fe80::1", "::1", ""})
    EXPECT_EQ(without_port(address), address);
}

TEST(Streams, ComponentServesBothDirections) {
  const Traffic traffic{.bits_per_s = 1000, .datagram_bytes = 100, .priority = 3};
  EXPECT_THAT(ways_of(traffic), ElementsAre("to_component", "to_controller"));
  EXPECT_TRUE(ways_of({}).empty());
  campaign::Run run;
  run.traffic = traffic;
  const auto serves = stream_of(run, "to_component", "component", two);
  EXPECT_TRUE(serves.serves);
  EXPECT_THAT(serves.place, ElementsAre("right"));
  EXPECT_EQ(serves.address, "10.0.0.2") << "the port is a transport's";
  const auto back = stream_of(run, "to_controller", "controller", two);
  EXPECT_FALSE(back.serves);
  EXPECT_TRUE(back.receives);
  EXPECT_THAT(back.place, ElementsAre("left"));
  EXPECT_NE(back.port, serves.port);
}

nlohmann::json both(double sent, nlohmann::json received, bool running = true) {
  return {{"controller", {{"to_component", {{"bit_s", sent}, {"running", running}}}}},
          {"component", {{"to_component", {{"bit_s", std::move(received)}, {"running", true}}}}}};
}

TEST(Achieved, ShortfallIsLessThan95PercentArrived) {
  campaign::Run run;
  run.traffic = {Traffic::Direction::to_component, 80'000'000};
  const auto enough = achieved(run, 5s, both(80e6, 76e6));
  EXPECT_EQ(enough.at("to_component").received_bit_s, 76e6);
  EXPECT_TRUE(shortfalls(enough).empty());
  EXPECT_THAT(
      shortfalls(achieved(run, 5s, both(80e6, 75.9e6))),
      ElementsAre(AllOf(HasSubstr("75.9 of 80 Mbit/s"), HasSubstr("component"), HasSubstr("(80 sent"))));
  EXPECT_THAT(shortfalls(achieved(run, 5s, both(80e6, nullptr))), ElementsAre(HasSubstr("unknown")))
      << "what is unknown is not taken for achieved";
  EXPECT_THAT(shortfalls(achieved(run, 5s, both(80e6, 1e6, false))), ElementsAre(HasSubstr("died")));
  EXPECT_THAT(shortfalls(achieved(run, 5s, both(80e6, 80e6, false))), ElementsAre(HasSubstr("died")))
      << "it was not there to the end";
  EXPECT_THAT(shortfalls(achieved(run, 5s, nlohmann::json::object())), ElementsAre(HasSubstr("SHORTFALL")));
  EXPECT_TRUE(achieved({}, 5s, both(1, 1)).empty());
}

// What the run itself has the link drop is no shortfall.
TEST(Achieved, LessArrivesThroughRequestedFaults) {
  campaign::Run run;
  run.traffic = {Traffic::Direction::to_component, 10'000'000, 1470};
  const auto is_short = [&](double arrived) {
    return achieved(run, run.task.client.duration, both(10e6, arrived)).at("to_component").is_short;
  };
  run.faults.loss = 0.1;
  EXPECT_FALSE(*is_short(9e6));
  EXPECT_TRUE(*is_short(8.5e6));
  run.traffic.datagram_bytes = 4000;  // in three frames
  EXPECT_FALSE(*is_short(7.29e6));
  EXPECT_TRUE(*is_short(6.8e6));
  run.faults.loss = 0;
  run.task.client.duration = 5s;
  run.cut = conditions::Cut{1s, 1s};
  EXPECT_FALSE(*is_short(8e6));
  EXPECT_TRUE(*is_short(7.5e6));
  run.faults.loss = 0.5;
  EXPECT_DOUBLE_EQ(share_that_arrives(run, 5s, 1000), 0.4);
  EXPECT_DOUBLE_EQ(share_that_arrives(run, 5s, 1000, true), 0.8) << "what is lost is sent again";
  run.faults.loss = 0;
  run.cut->at = 4500ms;  // it ends with the run
  EXPECT_TRUE(*is_short(8e6));
}

TEST(Achieved, OfAnInterruptedRunTheCutHasItsOwnShare) {
  campaign::Run run;
  run.task.client.duration = 60s;
  run.cut = conditions::Cut{1s, 1s};
  EXPECT_DOUBLE_EQ(share_that_arrives(run, 4s, 1000), 0.75);
  EXPECT_DOUBLE_EQ(share_that_arrives(run, 1s, 1000), 1) << "before the cut";
}

TEST(Achieved, CopiesThatTheLinkMakesDoNotHideAShortfall) {
  campaign::Run run;
  run.traffic = {Traffic::Direction::to_component, 10'000'000, 1000};
  run.faults.duplicates = 0.2;
  const auto is_short = [&](double arrived) {
    return *achieved(run, 5s, both(10e6, arrived)).at("to_component").is_short;
  };
  EXPECT_FALSE(is_short(12e6));
  EXPECT_TRUE(is_short(10e6)) << "a sixth of the datagrams is missing";
  run.traffic.datagram_bytes = 4000;
  EXPECT_FALSE(is_short(10e6)) << "copies of fragments make no datagram";
}

TEST_F(ScenarioFile, TrafficKeysAreReadAndRecorded) {
  const auto runs = read(
                        "defaults: {transport: udp, traffic: {rate: 80 Mbit/s}}\n"
                        "runs:\n"
                        "  - id: a\n"
                        "  - {id: b, traffic: {rate: 1.5 Mbit/s, direction: to-controller, datagram: 200 B, "
                        "priority: 5}}\n")
                        .runs;
  EXPECT_EQ(runs.at(0).traffic.bits_per_s, 80'000'000U);
  EXPECT_EQ(asked(runs.at(0), {}).at("traffic").at("direction"), "both");
  EXPECT_EQ(runs.at(1).traffic, (Traffic{Traffic::Direction::to_controller, 1'500'000, 200, 5}));
  EXPECT_EQ(asked(campaign::Run{}, {}).at("traffic"), nullptr) << "keys of earlier runs stay as they were";
}

TEST_F(ScenarioFile, LinkFaultKeysAreReadAndRecorded) {
  const auto run =
      read(
          "runs: [{id: a, transport: udp, link: {loss: 1%, duplicate: 0.5 %, delay: 2 ms, jitter: 500 us, "
          "reorder: 25 %, cut: 5 s for 500 ms}}]\n")
          .runs.at(0);
  EXPECT_EQ(run.faults, (background::Faults{0.01, 0.005, 2ms, 500us, 0.25, true}));
  EXPECT_EQ(run.cut->at, 5s);
  EXPECT_EQ(run.cut->length, 500ms);
  EXPECT_EQ(asked(run, {}).at("link").at("cut").at("for_ms"), 500);
  EXPECT_EQ(asked(campaign::Run{}, {}).at("link"), nullptr) << "keys of earlier runs stay as they were";
}

TEST_F(ScenarioFile, ALaunchTimeNeedsAnEtfAndAnEtfALaunchTime) {
  const std::string etf = "etf clockid CLOCK_TAI delta 300000", below = "prio bands 2 below 1 " + etf;
  const auto of = [&](const std::string& keys, const std::string& transport = "udp") {
    return "runs: [{id: a, transport: " + transport + ", " + keys + "}]\n";
  };
  const auto whole = of("launch-time: 300 us, link: {message-priority: 6, qdisc: " + below + "}");
  const auto run = read(whole).runs.at(0);
  EXPECT_EQ(run.task.config.launch_ns, 300'000);
  EXPECT_EQ(run.task.config.priority, std::nullopt) << "the packet filter gives it";
  EXPECT_EQ(asked(run, {}).at("launch_us"), 300);
  EXPECT_EQ(asked(campaign::Run{}, {}).at("launch_us"), nullptr) << "keys of earlier runs stay as they were";
  EXPECT_THAT(error(of("launch-time: 300 us")), HasSubstr("launch-time needs an etf"));
  EXPECT_THAT(error(of("link: {qdisc: " + below + "}")), HasSubstr("add launch-time"));
  EXPECT_THAT(error(of("launch-time: 0 us, link: {qdisc: " + below + "}")), HasSubstr("'0 us'"));
  const auto also = [&](const std::string& qdisc, const std::string& keys = "schedule: fixed") {
    return "launch-time: 1 ms, link: {qdisc: " + qdisc + "}, " + keys;
  };
  EXPECT_THAT(error(of(also(etf))), HasSubstr("drops ARP"));
  EXPECT_EQ(error(of(also(etf), "ethernet")), "no error") << "which has none";
  EXPECT_THAT(error(of(also(below + " deadline_mode"))), HasSubstr("deadline_mode"));
  EXPECT_THAT(error(of(also(below + " dead"))), HasSubstr("deadline_mode")) << "as tc takes it";
  EXPECT_THAT(error(of(also(below, "timeout: 2 ms"))), HasSubstr("every message would be lost"));
  EXPECT_THAT(error(of("launch-time: 1 ms, link: {duplicate: 1 %, qdisc: " + below + "}")),
              HasSubstr("link.duplicate"));
  const auto beside = [&](const std::string& priorities) {
    return of("launch-time: 1 ms, traffic: {rate: 1 Mbit/s}, link: {qdisc: " + below + ", " + priorities +
              "}");
  };
  EXPECT_THAT(error(beside("message-priority: 6")), HasSubstr("link.traffic-priority"));
  EXPECT_THAT(error(beside("message-priority: 6, traffic-priority: 6")), HasSubstr("link.traffic-priority"));
  EXPECT_EQ(error(beside("message-priority: 6, traffic-priority: 2")), "no error");
  EXPECT_THAT(error(of(also(etf, "traffic: {rate: 1 Mbit/s, priority: 1}"), "ethernet")),
              HasSubstr("link.traffic-priority"));
  EXPECT_THAT(error(of(also(below, "schedule: back-to-back"))), HasSubstr("back-to-back"));
  EXPECT_THAT(error(of(also(below, "explain: on"))), HasSubstr("explain"));
}

TEST_F(ScenarioFile, MessagesBelowIpGetPriorityFromTheirSocket) {
  const auto run = read("runs: [{id: a, transport: ethernet, link: {message-priority: 6}}]\n").runs.at(0);
  EXPECT_EQ(run.task.config.priority, 6);
  EXPECT_THAT(error("runs: [{id: a, transport: xdp, link: {message-priority: 6}}]\n"), HasSubstr("xdp"));
}

}  // namespace
}  // namespace ontime::campaign
