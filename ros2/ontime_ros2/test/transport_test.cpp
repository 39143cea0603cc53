// SPDX-License-Identifier: Apache-2.0
// The transport through its interface: every executor, allocator and RMW carries requests and replies, and
// reports what it cannot do. Client and server are two processes (two_ends.hpp) in a separate network.
#include "transport/transport.hpp"

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <functional>
#include <string>
#include <thread>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <linux/capability.h>
#include <linux/filter.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include "ends.hpp"

namespace ontime::transport {
namespace {

using namespace std::chrono_literals;
using testing::AllOf;
using testing::HasSubstr;
using testing::Not;
using testing::StartsWith;

void check_facts(Endpoint& endpoint, const Options& options) {
  const auto facts = endpoint.facts();
  require(facts.at("rmw") == options.at("rmw"), "another RMW: " + facts.at("rmw"));
  require(facts.at("carrier") == "UDPv4", "carried by " + facts.at("carrier"));
  require(facts.at("executor") == options.at("executor"), "another executor: " + facts.at("executor"));
  require(facts.contains("middleware"), "no middleware's version");
}

void check_threads(Endpoint& endpoint, Receive receive) {
  const auto threads = endpoint.threads();
  const auto count = [&](auto of) { return std::count_if(threads.begin(), threads.end(), of); };
  std::string text;
  for (const Thread& thread : threads) text += " " + thread.role + "=" + thread.name;
  require(count([](const Thread& thread) { return thread.role == "discovery"; }) > 0, "no discovery:" + text);
  const auto ours = count([](const Thread& thread) { return thread.name == "ontime-executor"; });
  require((ours > 0) == (receive == Receive::listener), "executors' threads:" + text);
  const auto theirs = count(
      [](const Thread& thread) { return thread.role == "receive" && thread.name != "ontime-executor"; });
  require(theirs > 0, "nothing receives:" + text);
}

struct Case {
  std::string rmw;
  std::string executor;
  std::string allocator;
};

class Transport : public testing::TestWithParam<Case> {};

TEST_P(Transport, CarriesEverySizeThereAndBack) {
#ifndef ONTIME_HAS_TLSF
  if (GetParam().allocator == "tlsf") GTEST_SKIP() << "tlsf_cpp was not there when this was built";
#endif
  const Options options{
      {"rmw", GetParam().rmw}, {"executor", GetParam().executor}, {"allocator", GetParam().allocator}};
  const two_ends::Child server([&](int end, int) { two_ends::serve(config_of(Role::server, options), end); });
  EXPECT_EQ(in_own_process([&] {
              const Config config = config_of(Role::client, options);
              Answers answers;
              const auto endpoint = two_ends::plugin().open(config, answers);
              const Receiving receiving(*endpoint, config.receive);
              require(two_ends::await_match(*endpoint), "no match; seen: " + endpoint->seen());
              exchange(*endpoint, answers);
              check_facts(*endpoint, options);
              check_threads(*endpoint, config.receive);
            }),
            "");
}

std::vector<Case> cases() {
  std::vector<Case> all;
  for (const char* rmw : {"rmw_cyclonedds_cpp", "rmw_fastrtps_cpp"}) {
    for (const char* executor : {"single", "multi", "waitset", "wait"})
      all.push_back({rmw, executor, "default"});
    for (const char* allocator : {"tlsf", "pmr"}) all.push_back({rmw, "single", allocator});
    all.push_back({rmw, "waitset", "pmr"});
  }
  return all;
}

INSTANTIATE_TEST_SUITE_P(Every, Transport, testing::ValuesIn(cases()), [](const auto& each) {
  return each.param.rmw + "_" + each.param.executor + "_" + each.param.allocator;
});

TEST(Options, ImpossibleValuesAreRefusedWithTheFix) {
  const auto error = [](const Options& options) { return error_of(config_of(Role::client, options)); };
  const auto is_wrong = StartsWith("wrong input: ");
  EXPECT_THAT(error({{"executor", "guillotine"}}),
              AllOf(is_wrong, HasSubstr("single, multi, events, waitset, wait")));
  EXPECT_THAT(error({{"allocator", "hope"}}), AllOf(is_wrong, HasSubstr("default, tlsf, pmr")));
  EXPECT_THAT(error({{"statistics", "maybe"}}), AllOf(is_wrong, HasSubstr("off, on")));
  EXPECT_THAT(error({{"node", "not a name"}}), AllOf(is_wrong, HasSubstr("not a name")));
  EXPECT_THAT(error({{"loaned", "on"}, {"allocator", "pmr"}}),
              AllOf(is_wrong, HasSubstr("allocator default")));
  EXPECT_THAT(error({{"intra-process", "on"}, {"executor", "wait"}}),
              AllOf(is_wrong, HasSubstr("--receive listener")));
  Config config = config_of(Role::client, {{"executor", "waitset"}});
  config.receive = Receive::listener;
  EXPECT_THAT(error_of(config), AllOf(is_wrong, HasSubstr("--receive waitset")));
  config = config_of(Role::client, {});
  config.ping_topic = "ping";
  EXPECT_THAT(error_of(config), AllOf(is_wrong, HasSubstr("/robot/ping")));
}

TEST(Options, MissingRmwIsAnErrorOfTheMachineNotOfTheInput) {
  const auto error = [](const Options& options) { return error_of(config_of(Role::client, options)); };
  const auto is_wrong = StartsWith("wrong input: ");
  EXPECT_THAT(error({{"rmw", "rmw_smoke_signals_cpp"}}),
              AllOf(Not(is_wrong), HasSubstr("rmw_smoke_signals_cpp' is not installed"),
                    HasSubstr("rmw_cyclonedds_cpp"), HasSubstr("rmw-smoke-signals-cpp")));
  for (const char* part : {"cyclonedds", "rmw_cyclonedds"})
    EXPECT_THAT(error({{"rmw", part}}), AllOf(Not(is_wrong), HasSubstr("did you mean rmw_cyclonedds_cpp?"),
                                              Not(HasSubstr("install the package"))));
  EXPECT_THAT(error({{"loaned", "on"}}), AllOf(Not(is_wrong), HasSubstr("upper bound")));
}

TEST(Node, DuplicateNodeNameIsRefused) {
  for (const char* rmw : {"rmw_cyclonedds_cpp", "rmw_fastrtps_cpp"}) {
    two_ends::Child first([&](int end, int ready) {
      Answers answers;
      const auto endpoint = two_ends::plugin().open(config_of(Role::client, {{"rmw", rmw}}), answers);
      require(write(ready, "!", 1) == 1, "no pipe");
      close(ready);
      two_ends::await_end(end);
    });
    ASSERT_EQ(first.result(), "!") << rmw;
    std::string error;
    for (int i = 0; i < 5 && error.empty(); ++i)  // discovery gives no guarantee
      error = error_of(config_of(Role::client, {{"rmw", rmw}}));
    EXPECT_THAT(error, AllOf(HasSubstr("/ontime_ping already exists"), HasSubstr("--option node="))) << rmw;
    EXPECT_EQ(error_of(config_of(Role::client, {{"rmw", rmw}, {"node", "another"}})), "") << rmw;
  }
}

TEST(Qos, MismatchIsReportedWithItsPolicy) {
  for (const char* rmw : {"rmw_cyclonedds_cpp", "rmw_fastrtps_cpp"}) {
    const two_ends::Child server([&](int end, int) {
      two_ends::serve(config_of(Role::server, {{"rmw", rmw}}), end);
    });
    EXPECT_EQ(in_own_process([&] {
                Config config = config_of(Role::client, {{"rmw", rmw}});
                config.qos.reliability = Reliability::reliable;
                Answers answers;
                const auto endpoint = two_ends::plugin().open(config, answers);
                std::string seen;
                for (int i = 0;
                     i < 2000 && seen.find("offers best-effort, ontime requests reliable") == seen.npos;
                     ++i) {
                  std::this_thread::sleep_for(5ms);
                  seen = endpoint->seen();
                }
                require(seen.find("offers best-effort, ontime requests reliable") != seen.npos, seen);
              }),
              "")
        << rmw;
  }
}

bool eventually(const std::function<bool()>& is_so) {
  for (int i = 0; i < 2000 && !is_so(); ++i) std::this_thread::sleep_for(5ms);
  return is_so();
}

TEST(Matched, TellsWhoComesAndGoes) {
  for (const std::string rmw : rmws) {
    const auto serve_as = [&](const std::string& node) {
      return [&rmw, node](int end, int) {
        two_ends::serve(config_of(Role::server, {{"rmw", rmw}, {"node", node}}), end);
      };
    };
    two_ends::Child client([&](int, int result) {
      Answers answers;
      const auto endpoint = two_ends::plugin().open(config_of(Role::client, {{"rmw", rmw}}), answers);
      const auto tells = [&](int count) {
        std::int64_t since = endpoint->matched().changed_ns;
        const bool told = eventually([&] {
          const Matched now = endpoint->matched();
          return now.readers == count && now.writers == count && (count == 0 || now.both());
        });
        require(told, "never " + std::to_string(count) + " others");
        require(endpoint->matched().changed_ns >= since && endpoint->matched().changed_ns > 0,
                "a wrong time");
        require(write(result, "!", 1) == 1, "no pipe");
      };
      for (const int count : {1, 2, 1, 0}) tells(count);
    });
    const auto told = [&] { return client.result(1); };
    two_ends::Child first(serve_as("first"));
    ASSERT_EQ(told(), "!") << rmw;
    two_ends::Child second(serve_as("second"));
    ASSERT_EQ(told(), "!") << rmw;
    second.finish();
    ASSERT_EQ(told(), "!") << rmw;
    first.finish();
    ASSERT_EQ(told(), "!") << rmw;
  }
}

// Makes the sockets that receive users' data drop datagrams of more than so many bytes.
void drop_datagrams_above(std::uint32_t bytes, int domain) {
  sock_filter code[] = {BPF_STMT(BPF_LD | BPF_W | BPF_LEN, 0),
                        BPF_JUMP(BPF_JMP | BPF_JGT | BPF_K, bytes, 0, 1), BPF_STMT(BPF_RET | BPF_K, 0),
                        BPF_STMT(BPF_RET | BPF_K, 0xFFFFFFFF)};
  const sock_fprog program{static_cast<unsigned short>(std::size(code)), code};
  int found = 0;
  for (const auto& entry : std::filesystem::directory_iterator("/proc/self/fd")) {
    sockaddr_in address{};
    socklen_t length = sizeof address;
    const int socket = std::stoi(entry.path().filename());
    if (getsockname(socket, reinterpret_cast<sockaddr*>(&address), &length) != 0) continue;
    const int offset = ntohs(address.sin_port) - 7400 - 250 * domain;
    if (address.sin_family != AF_INET || offset < 0 || offset >= 250 || offset % 2 == 0) continue;
    found += setsockopt(socket, SOL_SOCKET, SO_ATTACH_FILTER, &program, sizeof program) == 0 ? 1 : 0;
  }
  require(found > 0, "no socket to filter");
}

TEST(Losses, OnlyFastDdsReportsLossesOnTheWay) {
  for (const std::string rmw : rmws) {
    const two_ends::Child server([&](int end, int) {
      two_ends::serve(config_of(Role::server, {{"rmw", rmw}}), end);
    });
    EXPECT_EQ(in_own_process([&] {
                const Config config = config_of(Role::client, {{"rmw", rmw}});
                Answers answers;
                const auto endpoint = two_ends::plugin().open(config, answers);
                require(two_ends::await_match(*endpoint), "no match; seen: " + endpoint->seen());
                std::uint64_t sequence = 0;
                const auto answered = [&] {
                  endpoint->send(++sequence, {});
                  return answers.await(sequence).has_value();
                };
                require(eventually(answered), "no answer");
                const Losses before = endpoint->losses();
                require(before.on_the_way.has_value() == rmw.starts_with("rmw_fastrtps"), "tells otherwise");
                require(!before.overwritten, "tells what it cannot know");
                if (!before.on_the_way) return;
                drop_datagrams_above(600, config.domain);
                for (int i = 0; i < 5; ++i) {
                  endpoint->send(++sequence, std::vector<std::byte>(700));
                  std::this_thread::sleep_for(20ms);
                }
                require(eventually(answered), "no answer after the losses");
                const auto lost = *endpoint->losses().on_the_way - *before.on_the_way;
                require(lost >= 5, std::to_string(lost) + " lost");
              }),
              "")
        << rmw;
  }
}

// `ontime ping` and pong are two processes: the RMW would carry everything.
TEST(IntraProcess, IsRefusedWithoutTheOtherEndInThisProcess) {
  EXPECT_THAT(error_of(config_of(Role::client, {{"rmw", "rmw_cyclonedds_cpp"}, {"intra-process", "on"}})),
              AllOf(StartsWith("wrong input: "), HasSubstr("two processes")));
}

TEST(IntraProcess, CarriesBetweenTwoEndsOfOneProcess) {
  EXPECT_EQ(in_own_process([] {
              two_ends::Echo echo;
              Answers answers;
              const Options options{{"rmw", "rmw_cyclonedds_cpp"}, {"intra-process", "on"}};
              const auto server = two_ends::plugin().open(config_of(Role::server, options), echo);
              echo.endpoint = server.get();
              const auto client = two_ends::plugin().open(config_of(Role::client, options), answers);
              require(two_ends::await_match(*client), "no match");
              exchange(*client, answers);
              require(client->facts().at("carrier") == "intra-process", client->facts().at("carrier"));
            }),
            "");
}

// A thread of this process that blocks the signal by which privileges are dropped, and has more than few.
std::string out_of_reach() {
  constexpr std::uint64_t few = (1ULL << CAP_SYS_NICE) | (1ULL << CAP_IPC_LOCK);
  for (const auto& task : std::filesystem::directory_iterator("/proc/self/task")) {
    std::ifstream status(task.path() / "status");
    std::string name;
    std::uint64_t blocked = 0, permitted = 0;
    for (std::string word; status >> word;) {
      if (word == "Name:") status >> name;
      if (word == "SigBlk:") status >> std::hex >> blocked;
      if (word == "CapPrm:") status >> std::hex >> permitted;
    }
    if (((blocked >> (SIGXCPU - 1)) & 1) != 0 && (permitted & ~few) != 0) return name;
  }
  return {};
}

// LTTng's, where ROS 2's trace points have it, start as it is loaded. Any thread blocks signals as it starts.
TEST(Threads, SignalBlockingThreadsStartWithFewPrivileges) {
  EXPECT_EQ(in_own_process([] {
              Answers answers;
              const Options options{{"rmw", "rmw_cyclonedds_cpp"}};
              const auto client = two_ends::plugin().open(config_of(Role::client, options), answers);
              std::string found = out_of_reach();
              for (int i = 0; i < 100 && !found.empty(); ++i) {
                std::this_thread::sleep_for(20ms);
                found = out_of_reach();
              }
              require(found.empty(), found + " has all privileges");
            }),
            "");
}

}  // namespace
}  // namespace ontime::transport
