// SPDX-License-Identifier: Apache-2.0
#include "agent/agent.hpp"

#include <csignal>
#include <string_view>

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <unistd.h>

#include "agent/frames.hpp"

namespace ontime::agent {
namespace {

using namespace std::chrono_literals;
using nlohmann::json;
using testing::HasSubstr;

class FramesTest : public testing::Test {
 protected:
  FramesTest() { EXPECT_EQ(socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends_), 0); }
  ~FramesTest() override {
    close(ends_[0]);
    if (ends_[1] >= 0) close(ends_[1]);
  }
  int ends_[2] = {-1, -1};
};

TEST_F(FramesTest, WhatIsSentIsReceived) {
  Frames here(ends_[0], ends_[0]), there(ends_[1], ends_[1]);
  const std::vector<json> sent{{{"a", 1}}, {{"bytes", json::binary({0, 1, 2})}}, json::object()};
  for (const auto& frame : sent) here.send(frame);
  for (const auto& frame : sent) EXPECT_EQ(there.receive(1s), frame);
  EXPECT_FALSE(there.receive(0ms));
}

TEST_F(FramesTest, ABrokenPipeIsSaid) {
  Frames here(ends_[0], ends_[0]);
  close(std::exchange(ends_[1], -1));
  EXPECT_THROW(here.receive(1s), Broken);
}

TEST_F(FramesTest, NoiseIsNotTakenForAnOrder) {
  Frames here(ends_[0], ends_[0]);
  const std::string noise = "bash: ontime: command not found\n";
  ASSERT_EQ(write(ends_[1], noise.data(), noise.size()), static_cast<ssize_t>(noise.size()));
  EXPECT_THROW(here.receive(1s), Broken);
}

TEST(Task, SurvivesItsJourney) {
  Task task;
  task.transport = "udp";
  task.config.role = transport::Role::server;
  task.config.receive = transport::Receive::waitset;
  task.config.qos = {transport::Reliability::reliable, transport::History::keep_all, 7,
                     transport::Durability::transient_local};
  task.config.max_payload_bytes = 9;
  task.config.interface = "lo";
  task.config.peers = {"a", "b:1"};
  task.config.domain = 3;
  task.config.options = {{"k", "v"}};
  task.client.schedule = roundtrip::Schedule::fixed;
  task.client.period = 1us;
  task.client.deadline = 2us;
  task.client.timeout = 3us;
  task.client.duration = 4us;
  task.client.payload_bytes = 5;
  task.client.warm_up = 6;
  task.realtime.on = task.realtime.lock_memory = true;
  task.realtime.cpu_latency = 8us;
  task.realtime.threads["send"] = {realtime::Policy::deadline, 0, {0, 1}, 1us, 2us, 3us};
  task.load = {1, 2, 3, 4, 5, 6};
  EXPECT_EQ(json(json(task).get<Task>()), json(task));
  EXPECT_EQ(json(task).dump().find("null"), std::string::npos) << "nothing of it was left out";
}

json event(Handle& agent, const std::string& name) {
  for (int tries = 0; tries < 600; ++tries)
    if (const auto event = agent.event(100ms); event && event->at("event") == name) return *event;
  throw std::runtime_error("no event " + name);
}

Task task_of(transport::Role role, int domain) {
  Task task;
  task.transport = "udp";
  task.config.role = role;
  task.config.interface = "lo";
  task.config.max_payload_bytes = 500;
  task.config.domain = domain;
  task.config.peers = {"127.0.0.1"};
  task.client.period = 1ms;
  task.client.duration = 50ms;
  return task;
}

// A port that is most likely free; two tests of this file never run in one moment on one.
int some_domain() { return 1000 + getpid() % 20000; }

TEST(Agent, MeasuresByOrders) {
  const int domain = some_domain();
  Handle server({}), client({});
  server.order("open", {{"task", task_of(transport::Role::server, domain)}});
  event(server, "opened");
  client.order("open", {{"task", task_of(transport::Role::client, domain)}});
  const auto opened = event(client, "opened");
  EXPECT_EQ(opened.at("transport").at("name"), "udp");
  server.order("start", {{"wait_ns", 0}});
  event(server, "started");
  client.order("start", {{"wait_ns", 5'000'000'000}});
  std::size_t samples = 0;
  json finished;
  while (finished.is_null()) {
    const auto got = client.event(1s);
    ASSERT_TRUE(got);
    if (got->at("event") == "samples") samples += samples_of(got->at("samples")).size();
    if (got->at("event") == "finished") finished = *got;
  }
  const auto counters = counters_of(finished.at("counters"));
  EXPECT_GT(counters.sent, 0U);
  EXPECT_EQ(counters.sent, samples);
  EXPECT_EQ(counters.sent, counters.on_time + counters.late + counters.lost);
  client.order("close");
  const auto closed = event(client, "closed");
  EXPECT_EQ(closed.at("threads").at(0).at("role"), "send");
  server.order("close");
  EXPECT_GE(event(server, "closed").at("answered"), counters.on_time);
}

std::string failure(const Task& task, std::chrono::nanoseconds wait = 100ms) {
  try {
    Handle agent({});
    agent.order("open", {{"task", task}});
    event(agent, "opened");
    agent.order("start", {{"wait_ns", wait.count()}});
    event(agent, "finished");
  } catch (const Error& error) {
    return std::to_string(error.exit) + " " + error.what();
  }
  return "none";
}

TEST(Agent, SaysWhyItCannot) {
  auto task = task_of(transport::Role::client, some_domain());
  EXPECT_THAT(failure(task), testing::AllOf(HasSubstr("3 no pong was found over udp"), HasSubstr("refuses")));
  task.transport = "telepathy";
  EXPECT_THAT(failure(task), testing::AllOf(HasSubstr("no transport 'telepathy'"), HasSubstr("udp")));
  task.transport = "udp";
  task.config.interface = "nonet0";
  EXPECT_THAT(failure(task), testing::AllOf(HasSubstr("2 there is no interface 'nonet0'"), HasSubstr("lo")));
  task.config.interface = "lo";
  task.config.max_payload_bytes = 70'000;
  EXPECT_THAT(failure(task), HasSubstr("2 transport udp carries at most"));
  task.config.max_payload_bytes = 500;
  task.config.options = {{"colour", "red"}};
  EXPECT_THAT(failure(task),
              testing::AllOf(HasSubstr("2 transport udp has no option 'colour'"), HasSubstr("port")));
}

TEST(Agent, SaysThatAPortIsBusy) {
  const auto task = task_of(transport::Role::server, some_domain());
  Handle first({});
  first.order("open", {{"task", task}});
  event(first, "opened");
  EXPECT_THAT(failure(task), HasSubstr("busy"));
}

TEST(Agent, ThatCannotBeStartedIsNamed) {
  const auto open = [](const std::vector<std::string>& prefix) {
    Handle agent(prefix);
    agent.order("open", {{"task", task_of(transport::Role::client, 1)}});
    event(agent, "opened");
  };
  EXPECT_THROW(open({"/no/such/program"}), Error);
  EXPECT_THROW(open({"false"}), Error);
}

TEST(Agent, LeavesWhenThePipeBreaks) {
  // The destructor waits until it has left, and would kill it after 10 s: that it left by itself shows in
  // time to spare.
  Handle agent({});
  agent.order("open", {{"task", task_of(transport::Role::server, some_domain())}});
  event(agent, "opened");
}

}  // namespace
}  // namespace ontime::agent

// The agents of these tests are this program.
int main(int argc, char** argv) {
  if (argc > 1 && std::string_view(argv[1]) == "agent") return ontime::agent::serve();
  std::signal(SIGPIPE, SIG_IGN);
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
