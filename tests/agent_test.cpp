// SPDX-License-Identifier: Apache-2.0
#include "agent/agent.hpp"

#include <array>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <set>
#include <sstream>
#include <string>
#include <string_view>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include "agent/end.hpp"
#include "orders/orders.hpp"
#include "own_link.hpp"

namespace ontime::agent {
namespace {

using namespace std::chrono_literals;
using nlohmann::json;
using testing::HasSubstr;

TEST(Task, IsUnchangedAfterJson) {
  Task task;
  task.transport = "udp";
  task.config.role = transport::Role::server;
  task.config.receive = transport::Receive::waitset;
  task.config.qos = {transport::Reliability::reliable, transport::History::keep_all, 7,
                     transport::Durability::transient_local};
  task.config.max_payload_bytes = 9;
  task.config.interface = "lo";
  task.config.address = "c";
  task.config.peers = {"a", "b:1"};
  task.config.domain = 3;
  task.config.launch_ns = 4;
  task.config.priority = 5;
  task.config.options = {{"k", "v"}};
  task.config.security = transport::Security{"sign", "a", "b", "c", "d", "e", "f"};
  task.client.schedule = roundtrip::Schedule::fixed;
  task.client.period = 1us;
  task.client.deadline = 2us;
  task.client.timeout = 3us;
  task.client.duration = 4us;
  task.client.payload_bytes = 5;
  task.client.warm_up = 6;
  task.background = {.topics = 2,
                     .where = roundtrip::Where::other_process,
                     .payload_bytes = 7,
                     .period = 9us,
                     .reliability = transport::Reliability::reliable,
                     .there = false,
                     .back = true,
                     .priority = 3,
                     .callback = 4us,
                     .session = 5};
  task.realtime.on = task.realtime.lock_memory = true;
  task.realtime.cpu_latency = 8us;
  task.realtime.threads["send"] = {realtime::Policy::deadline, 0, {0, 1}, 1us, 2us, 3us};
  EXPECT_EQ(to_json(agent::task_of(to_json(task))), to_json(task));
  EXPECT_EQ(to_json(task).at("end").dump().find("null"), std::string::npos) << "nothing of it was left out";
}

TEST(Interface, PortOfABridgeGetsNoAddressOfItsOwn) {
  const std::vector<machine::Interface> all{{"eth1", {}, true, false}, {"br0", {"10.10.0.2"}, true, false}};
  const auto of_port = lacks_address("eth1", "br0", all);
  EXPECT_THAT(of_port,
              testing::AllOf(HasSubstr("br0, which has the address 10.10.0.2"), HasSubstr("interface: br0"),
                             testing::Not(HasSubstr("ip address add"))));
  EXPECT_THAT(lacks_address("eth1", "br1", all), HasSubstr("dev br1"));
  EXPECT_THAT(lacks_address("eth1", "", all), HasSubstr("dev eth1"));
}

using orders::Coordinator;
using orders::Error;

class Agent : public testing::Test {
 protected:
  using Hand = Coordinator::Hand;
  static std::vector<std::string> command() { return {orders::this_program(), "agent"}; }
  json ask(Hand& hand, const std::string& order, const std::string& answer, json body = json::object()) {
    hand.order(order, std::move(body));
    return coordinator_.await(hand, answer, 60s);
  }
  std::string failure(const Task& task, std::chrono::nanoseconds wait = 100ms, bool served = false) {
    try {
      Hand agent(coordinator_, "the agent", command(), sample_layout());
      ask(agent, "open", "opened", {{"task", to_json(task)}});
      ask(agent, "start", "ready", {{"wait_ns", wait.count()}, {"served", served}});
    } catch (const Error& error) {
      return std::to_string(error.exit) + " " + error.what();
    }
    return "none";
  }

  orders::Interrupts interrupts_{0};
  Coordinator coordinator_{interrupts_};
};

Task task_of(transport::Role role, int domain) {
  Task task;
  task.transport = "udp";
  task.config.role = role;
  task.config.interface = "lo";
  task.config.max_payload_bytes = 500;
  task.config.domain = domain;
  task.config.peers = {"127.0.0.1"};
  task.client.period = 1ms;
  task.client.duration = 500ms;
  return task;
}

// A port that is most likely free; two tests of this file never run in one moment on one.
int some_domain() { return 1000 + getpid() % 20000; }

// A server and a client.
class TwoAgents : public Agent {
 protected:
  // Opens and starts both; returns what the client said when it was opened.
  json ready(const Task& of_client, const json& more = json::object()) {
    ask(server_, "open", "opened",
        {{"task", to_json(task_of(transport::Role::server, of_client.config.domain))}});
    json open{{"task", to_json(of_client)}};
    open.update(more);
    auto opened = ask(client_, "open", "opened", open);
    ask(server_, "start", "ready", {{"wait_ns", 0}});
    ask(client_, "start", "ready", {{"wait_ns", 60'000'000'000}});
    return opened;
  }
  // Until the client has finished; returns what it said then.
  json measure(const std::function<void()>& once_begun = [] {}) {
    ask(server_, "begin", "begun");
    ask(client_, "begin", "begun");
    once_begun();
    client_.on("samples", [this](const orders::Frame& frame) {
      for (const auto& sample : samples_of(frame.bytes)) samples_.push_back(sample);
    });
    client_.on("finished", [this](const orders::Frame& frame) { finished_ = frame.message; });
    client_.order("go");
    coordinator_.until([this] { return finished_.has_value(); });
    return *finished_;
  }

  Hand server_{coordinator_, "server", command(), sample_layout()},
      client_{coordinator_, "client", command(), sample_layout()};
  std::vector<roundtrip::Sample> samples_;
  std::optional<json> finished_;
};

TEST_F(TwoAgents, MeasureByOrders) {
  const auto opened = ready(task_of(transport::Role::client, some_domain()));
  EXPECT_EQ(opened.at("transport").at("name"), "udp");
  client_.on("progress", [](auto&) {});
  const auto counters = counters_of(measure().at("counters"));
  EXPECT_GT(counters.sent, 0U);
  EXPECT_EQ(counters.sent, samples_.size());
  EXPECT_EQ(counters.sent, counters.on_time + counters.late + counters.lost);
  const auto ended = ask(client_, "end", "ended");
  EXPECT_EQ(ended.at("threads").at(0).at("role"), "send");
  EXPECT_GE(ended.at("link").at("sent_bytes"), counters.sent * 500);
  EXPECT_TRUE(ended.at("shared_memory").empty());
  const auto answered = [&] { return ask(server_, "end", "ended").at("answered").get<std::uint64_t>(); };
  for (int look = 0; look < 1000 && answered() < counters.on_time; ++look)
    usleep(1000);  // the last is counted later
  EXPECT_GE(answered(), counters.on_time);
}

TEST_F(TwoAgents, AllNotedAnswersComeBeforeEnded) {
  const auto task = task_of(transport::Role::client, some_domain());
  ask(server_, "open", "opened", {{"task", to_json(task_of(transport::Role::server, task.config.domain))}});
  ask(client_, "open", "opened", {{"task", to_json(task)}});
  std::size_t told = 0;
  server_.on("answered", [&](const orders::Frame& frame) { told += answers_of(frame.bytes).size(); });
  ask(server_, "start", "ready", {{"wait_ns", 0}, {"note_answers", true}});
  ask(client_, "start", "ready", {{"wait_ns", 60'000'000'000}});
  client_.on("progress", [](auto&) {});
  const auto counters = counters_of(measure().at("counters"));
  ask(server_, "end", "ended");
  EXPECT_GE(told + 1, counters.on_time) << "of the last the note may be written a moment later";
}

// Who goes by ssh to a machine of which nothing else is known may take the link under test.
TEST_F(TwoAgents, SamplesWaitIfSshMayUseTheLinkUnderTest) {
  auto task = task_of(transport::Role::client, some_domain());
  task.client.duration = 5s;
  EXPECT_TRUE(ready(task, {{"ssh", true}}).at("ssh_link").at("shared"));
  int progress = 0;
  client_.on("progress", [&](auto&) {
    ++progress;
    EXPECT_TRUE(samples_.empty());
  });
  const auto finished = measure();
  EXPECT_GT(progress, 0);
  EXPECT_EQ(counters_of(finished.at("counters")).sent, samples_.size());
  EXPECT_EQ(finished.at("waited_bytes"), samples_.size() * sizeof(roundtrip::Sample));
  for (std::size_t i = 0; i < samples_.size(); ++i) EXPECT_EQ(samples_[i].index, i);
}

// Where a process of ours has reserved addresses: its threads' arenas of the heap, and their stacks' guards.
std::set<std::string> reservations(const json& pid) {
  std::ifstream maps("/proc/" + pid.dump() + "/maps");
  std::set<std::string> found;
  for (std::string line; std::getline(maps, line);)
    if (line.find(" ---p ") != line.npos) found.insert(line.substr(0, line.find(' ')).substr(line.find('-')));
  return found;
}

TEST_F(TwoAgents, NoHeapArenaIsCreatedDuringTheRun) {
  auto task = task_of(transport::Role::client, some_domain());
  task.client.duration = orders::beat_period + 1500ms;  // so that heartbeats and samples fall into it
  ready(task);
  const std::array pids{ask(client_, "identify", "identified").at("pid"),
                        ask(server_, "identify", "identified").at("pid")};
  std::array<std::set<std::string>, 2> before;
  int progress = 0;
  client_.on("progress", [&](auto&) {
    ++progress;
    for (std::size_t i = 0; i < pids.size(); ++i) EXPECT_EQ(reservations(pids[i]), before[i]);
  });
  measure([&] {
    for (std::size_t i = 0; i < pids.size(); ++i) before[i] = reservations(pids[i]);
  });
  EXPECT_GT(progress, 0);
}

TEST_F(TwoAgents, SendNothingBetweenReadyAndGo) {
  ready(task_of(transport::Role::client, some_domain()));
  const auto answered = [&] { return ask(server_, "end", "ended").at("answered").get<std::uint64_t>(); };
  // What waits of the warm-up is answered meanwhile.
  auto before = answered();
  for (int look = 0; look < 20; ++look) {
    usleep(500'000);
    const auto now = answered();
    if (now == before) break;
    before = now;
  }
  usleep(50'000);
  EXPECT_EQ(answered(), before);
}

// What its middleware's threads read, any host on the network may have sent.
TEST_F(Agent, OfRootKeepsFewCapabilitiesOnceItIsOpen) {
  if (geteuid() != 0) GTEST_SKIP() << "needs root";
#ifdef __SANITIZE_THREAD__
  GTEST_SKIP() << "the thread sanitizer has a thread of its own, which drops nothing";
#endif
  constexpr std::uint64_t nice_and_lock = (1ULL << 23) | (1ULL << 14), perfmon = 1ULL << 38;
  const auto permitted = process::field(process::text_of("/proc/self/status").value_or(""), "CapPrm");
  const auto own = std::stoull(permitted.value_or("0"), nullptr, 16);
  for (const std::string transport :
       {"udp", "udp that counts instructions", "ethernet", "cyclonedds", "fastdds"}) {
    Hand agent(coordinator_, "the agent", command(), sample_layout());
    auto task = task_of(transport::Role::server, transport.starts_with("udp") ? some_domain() : 77);
    task.transport = transport.substr(0, transport.find(' '));
    task.count_instructions = transport != task.transport;
    const auto kept = nice_and_lock | (task.count_instructions ? own & perfmon : 0);
    if (task.transport == "ethernet") task.config.peers.clear();
    try {
      ask(agent, "open", "opened", {{"task", to_json(task)}});
    } catch (const Error& error) {  // it is not here
      EXPECT_NE(task.transport, "udp") << error.what();
      continue;
    }
    const int pid = ask(agent, "identify", "identified").at("pid");
    int threads = 0;
    for (const auto& entry : std::filesystem::directory_iterator("/proc/" + std::to_string(pid) + "/task")) {
      std::ifstream status(entry.path() / "status");
      ++threads;
      for (std::string line; std::getline(status, line);) {
        if (line.starts_with("CapPrm:") || line.starts_with("CapEff:")) {
          EXPECT_EQ(std::stoull(line.substr(7), nullptr, 16), kept) << transport << ' ' << line;
        }
        if (line.starts_with("CapInh:") || line.starts_with("CapAmb:")) {
          EXPECT_EQ(std::stoull(line.substr(7), nullptr, 16), 0U) << transport << ' ' << line;
        }
        if (line.starts_with("NoNewPrivs:")) {
          EXPECT_EQ(line, "NoNewPrivs:\t1") << transport;
        }
      }
    }
    EXPECT_GE(threads, 2) << transport;
  }
}

TEST(Memory, EndIsRefusedIfLockedPagesExceedTheReserve) {
  const auto refusal = [](int available_mib) {
    std::istringstream meminfo(
        fmt::format("MemTotal: {} kB\nMemFree: 1 kB\nMemAvailable: {} kB\nBuffers: 1 kB\n", 2000 * 1024,
                    available_mib * 1024));
    return lacks_memory(meminfo, {});
  };
  EXPECT_EQ(refusal(292), "");
  EXPECT_THAT(refusal(291),
              ::testing::AllOf(::testing::HasSubstr("192 MiB"), ::testing::HasSubstr("291 MiB free"),
                               ::testing::HasSubstr("100 MiB")));
  std::istringstream large(fmt::format("MemTotal: {} kB\nMemAvailable: {} kB\n", 32U << 20U, 448 << 10));
  EXPECT_EQ(lacks_memory(large, {}), "") << "the reserve is 256 MiB at most";
  std::istringstream unknown("nothing");
  EXPECT_EQ(lacks_memory(unknown, {}), "") << "what the kernel does not tell refuses nothing";
}

TEST(Memory, EndIsRefusedIfItsControlGroupHasTooLittleLeft) {
  const auto refusal = [](std::uint64_t limit_mib, std::uint64_t used_mib, int available_mib = 4000) {
    std::istringstream meminfo(
        fmt::format("MemTotal: {} kB\nMemAvailable: {} kB\n", 8000 * 1024, available_mib * 1024));
    return lacks_memory(meminfo, machine::GroupMemory{limit_mib << 20U, used_mib << 20U});
  };
  EXPECT_EQ(refusal(72, 8), "") << "an end of udp may fit";
  EXPECT_THAT(refusal(71, 8), testing::AllOf(HasSubstr("64 MiB or more"), HasSubstr("63 MiB left of 71 MiB"),
                                             HasSubstr("lock-memory: off")));
  EXPECT_THAT(refusal(150, 160), HasSubstr("has 0 MiB left of 150 MiB"));
  EXPECT_THAT(refusal(150, 100, 30), HasSubstr("This machine has 30 MiB free")) << "which is less";
  EXPECT_EQ(refusal(std::uint64_t{1} << 40U, 8), "") << "no limit";
}

TEST_F(Agent, ServerOnAnotherLinkIsToldWithTheRouteToIt) {
  if (geteuid() != 0) GTEST_SKIP() << "network namespaces need root";
  const OwnLink link;
  auto task = task_of(transport::Role::client, some_domain());
  task.config.interface = "far";
  task.config.peers = {"10.9.0.9:7900"};
  EXPECT_THAT(failure(task), testing::AllOf(HasSubstr("route to 10.9.0.9 is by near"),
                                            HasSubstr("ontime pong"), HasSubstr("--interface near")));
  EXPECT_THAT(failure(task, 100ms, true), testing::AllOf(HasSubstr("controller's interface: near"),
                                                         testing::Not(HasSubstr("ontime pong"))));
  task.config.interface = "near";
  EXPECT_THAT(failure(task), testing::Not(HasSubstr("the route to")));
}

TEST_F(Agent, UnusableTaskIsRefusedWithReason) {
  auto task = task_of(transport::Role::client, some_domain());
  EXPECT_THAT(failure(task),
              testing::AllOf(HasSubstr("3 no server (pong)"), HasSubstr("over udp"), HasSubstr("refuses")));
  task.transport = "telepathy";
  EXPECT_THAT(failure(task), testing::AllOf(HasSubstr("no transport 'telepathy'"), HasSubstr("udp")));
  task.transport = "udp";
  task.config.interface = "nonet0";
  EXPECT_THAT(failure(task),
              testing::AllOf(HasSubstr("2 "), HasSubstr("no interface 'nonet0'"), HasSubstr("lo")));
  task.config.interface = "lo";
  task.config.max_payload_bytes = 70'000;
  EXPECT_THAT(failure(task), HasSubstr("2 transport udp carries at most"));
  task.config.max_payload_bytes = 500;
  task.config.options = {{"colour", "red"}};
  EXPECT_THAT(failure(task),
              testing::AllOf(HasSubstr("2 transport udp has no option 'colour'"), HasSubstr("port")));
}

TEST_F(Agent, LaunchTimeIsRefusedWithoutOwnSocket) {
  auto task = task_of(transport::Role::server, some_domain());
  task.config.launch_ns = 1'000'000;
  int refused = 0;
  for (const auto* name : {"xdp", "cyclonedds", "fastdds"}) {
    if (const auto names = transport::available(); std::find(names.begin(), names.end(), name) == names.end())
      continue;
    task.transport = name;
    EXPECT_THAT(failure(task),
                testing::AllOf(HasSubstr(std::string("2 transport ") + name), HasSubstr("launch-time")));
    ++refused;
  }
  if (refused == 0) GTEST_SKIP() << "there are udp and ethernet alone";
}

// By what a transport declares, whatever its name.
TEST_F(Agent, UndeclaredCapabilityIsRefused) {
  Task task;
  task.transport = "modest";
  task.config.role = transport::Role::server;
  task.config.max_payload_bytes = 500;
  EXPECT_EQ(failure(task), "none");
  const auto refusal_with = [&](const auto& ask_for_more) {
    auto more = task;
    ask_for_more(more);
    return failure(more);
  };
  const auto refused = [](const char* why) {
    return testing::AllOf(HasSubstr("2 transport modest "), HasSubstr(why));
  };
  EXPECT_THAT(refusal_with([](Task& more) { more.config.receive = transport::Receive::waitset; }),
              refused("receive: waitset"));
  EXPECT_THAT(refusal_with([](Task& more) { more.config.max_payload_bytes = 501; }), refused("at most 500"));
  EXPECT_THAT(refusal_with([](Task& more) { more.config.security.emplace().level = "sign"; }),
              refused("security: sign"));
  EXPECT_THAT(refusal_with([](Task& more) { more.config.launch_ns = 1; }), refused("launch-time"));
  EXPECT_THAT(refusal_with([](Task& more) { more.config.pong_topic = "/arm/pong"; }), refused("/arm/pong"));
  EXPECT_THAT(refusal_with([](Task& more) { more.background = {.topics = 1, .payload_bytes = 10}; }),
              refused("has no background topics"));
}

TEST_F(Agent, BusyPortIsReported) {
  const auto task = task_of(transport::Role::server, some_domain());
  Hand first(coordinator_, "the first", command(), sample_layout());
  ask(first, "open", "opened", {{"task", to_json(task)}});
  EXPECT_THAT(failure(task), HasSubstr("busy"));
}

TEST_F(Agent, RefusesOrdersOutOfTurn) {
  Hand agent(coordinator_, "the agent", command(), sample_layout());
  agent.order("go");
  EXPECT_THROW(coordinator_.until([] { return false; }), Error);
}

}  // namespace
}  // namespace ontime::agent

// The agents of these tests are this program.
int main(int argc, char** argv) {
  const char* const path = "ONTIME_TRANSPORT_PATH";
  const char* const found = std::getenv(path);  // NOLINT(concurrency-mt-unsafe): there is one thread yet
  const std::string with_modest = std::string(found != nullptr ? found : "") + ":" ONTIME_TEST_TRANSPORTS;
  setenv(path, with_modest.c_str(), 1);  // NOLINT(concurrency-mt-unsafe)
  if (argc > 1 && std::string_view(argv[1]) == "agent") return ontime::agent::serve();
  ontime::orders::on_termination([](int) { _exit(130); });
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
