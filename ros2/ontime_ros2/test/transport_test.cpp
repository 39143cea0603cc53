// SPDX-License-Identifier: Apache-2.0
// The transport through its port: every executor, allocator and RMW carries messages there and back, and what
// cannot be is said. Each end is a process of its own (two_ends.hpp), all in a network of their own.
#include "transport/transport.hpp"

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <cstdlib>
#include <functional>
#include <mutex>
#include <optional>
#include <random>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include "message/message.hpp"
#include "two_ends/two_ends.hpp"

namespace ontime::transport {
namespace {

using namespace std::chrono_literals;
using testing::AllOf;
using testing::HasSubstr;
using Options = std::map<std::string, std::string>;

constexpr std::size_t payload_sizes[] = {0, 1, 500, 32'768};

int domain = 0;

class Isolation : public testing::Environment {
  void SetUp() override {
    if (!two_ends::isolate()) domain = 100 + getpid() % 100;  // the best chance to be alone
  }
};
const auto* const isolation = testing::AddGlobalTestEnvironment(new Isolation);

Config config_of(Role role, const Options& options) {
  Config config;
  config.role = role;
  const auto executor = options.find("executor");
  if (executor != options.end() && executor->second.starts_with("wait")) config.receive = Receive::waitset;
  config.max_payload_bytes = *std::max_element(std::begin(payload_sizes), std::end(payload_sizes));
  config.interface = "lo";
  config.address = "127.0.0.1";
  config.domain = domain;
  config.options = options;
  return config;
}

void require(bool condition, const std::string& what) {
  if (!condition) throw std::runtime_error(what);
}

// What the function throws, as text; of a process of its own.
std::string in_own_process(const std::function<void()>& run) {
  return two_ends::Child([&](int, int) { run(); }).result();
}

class Answers final : public Sink {
 public:
  void arrived(std::uint64_t sequence, std::span<std::byte> payload, std::int64_t) noexcept override {
    const std::lock_guard lock(mutex_);
    sequence_ = sequence;
    payload_.assign(payload.begin(), payload.end());
    changed_.notify_one();
  }
  std::optional<std::vector<std::byte>> await(std::uint64_t sequence) {
    std::unique_lock lock(mutex_);
    if (!changed_.wait_for(lock, 500ms, [&] { return sequence_ == sequence; })) return {};
    return payload_;
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  std::uint64_t sequence_ = 0;
  std::vector<std::byte> payload_;
};

void exchange(Endpoint& endpoint, Answers& answers) {
  std::mt19937 random(1);
  std::uint64_t sequence = message::sequence_of(0xABCDEF, message::max_index - 10);
  for (const std::size_t bytes : payload_sizes) {
    std::vector<std::byte> payload(bytes);
    for (std::byte& byte : payload) byte = static_cast<std::byte>(random());
    std::optional<std::vector<std::byte>> answer;
    for (int i = 0; i < 20 && !answer; ++i) {  // best effort may lose some
      require(endpoint.send(++sequence, payload), "refused " + std::to_string(bytes) + " bytes");
      answer = answers.await(sequence);
    }
    require(answer.has_value(), "no answer to " + std::to_string(bytes) + " bytes");
    require(*answer == payload, "other bytes came back");
  }
}

// The threads that receive where the transport does not by itself.
class Receiving {
 public:
  Receiving(Endpoint& endpoint, Receive receive) : endpoint_(endpoint) {
    if (receive == Receive::waitset)
      thread_ = std::thread([this] {
        while (!ends_) endpoint_.receive();
      });
  }
  ~Receiving() {
    ends_ = true;
    endpoint_.interrupt();
    if (thread_.joinable()) thread_.join();
  }
  Receiving(const Receiving&) = delete;
  Receiving& operator=(const Receiving&) = delete;

 private:
  Endpoint& endpoint_;
  std::atomic<bool> ends_{false};
  std::thread thread_;
};

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

std::string error_of(
    const Config& config, const std::function<void()>& before = [] {}) {
  return in_own_process([&] {
    before();
    Answers answers;
    two_ends::plugin().open(config, answers);
  });
}

void set(const char* name, const char* value) { setenv(name, value, 1); }  // NOLINT(concurrency-mt-unsafe)

TEST(Options, ThatCannotBeAreRefusedWithWhatToDo) {
  const auto error = [](const Options& options) { return error_of(config_of(Role::client, options)); };
  EXPECT_THAT(error({{"rmw", "rmw_smoke_signals_cpp"}}),
              AllOf(HasSubstr("rmw_smoke_signals_cpp' is not installed"), HasSubstr("rmw_cyclonedds_cpp"),
                    HasSubstr("rmw-smoke-signals-cpp")));
  EXPECT_THAT(error({{"executor", "guillotine"}}), HasSubstr("single, multi, events, waitset, wait"));
  EXPECT_THAT(error({{"colour", "red"}}), HasSubstr("executor"));
  EXPECT_THAT(error({{"loaned", "on"}}), HasSubstr("upper bound"));
  EXPECT_THAT(error({{"node", "not a name"}}), HasSubstr("not a name"));
  Config config = config_of(Role::client, {{"executor", "waitset"}});
  config.receive = Receive::listener;
  EXPECT_THAT(error_of(config), HasSubstr("--receive waitset"));
}

TEST(Environment, ThatContradictsIsSaid) {
  const Config config = config_of(Role::client, {});
  EXPECT_THAT(error_of(config, [] { set("RMW_IMPLEMENTATION", "rmw_smoke_signals_cpp"); }),
              HasSubstr("is not installed"));
  EXPECT_THAT(error_of(config, [] { set("AMENT_PREFIX_PATH", ""); }), HasSubstr("setup.bash"));
  Config elsewhere = config;
  elsewhere.interface = "veth0";
  elsewhere.address = "10.0.0.1";
  EXPECT_THAT(error_of(elsewhere, [] { set("ROS_LOCALHOST_ONLY", "1"); }),
              HasSubstr("unset ROS_LOCALHOST_ONLY"));
  EXPECT_EQ(error_of(config, [] { set("ROS_LOCALHOST_ONLY", "1"); }), "");
}

TEST(Rmw, OtherThanTheOneThatLoadedIsRefused) {
  EXPECT_THAT(
      in_own_process([] {
        Answers answers;
        const auto open = [&](const char* rmw) {
          two_ends::plugin().open(config_of(Role::client, {{"rmw", rmw}}), answers);
        };
        open("rmw_cyclonedds_cpp");
        open("rmw_fastrtps_cpp");
      }),
      AllOf(HasSubstr("rmw_fastrtps_cpp was asked for"), HasSubstr("rmw_cyclonedds_cpp is what loaded")));
}

TEST(Node, OfTheSameNameIsRefused) {
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
    EXPECT_THAT(error, AllOf(HasSubstr("/ontime_ping already"), HasSubstr("--option node="))) << rmw;
    EXPECT_EQ(error_of(config_of(Role::client, {{"rmw", rmw}, {"node", "another"}})), "") << rmw;
  }
}

TEST(Qos, ThatDoesNotMatchIsSeenByItsPolicy) {
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
                for (int i = 0; i < 2000 && seen.find("offers best-effort, we ask for reliable") == seen.npos;
                     ++i) {
                  std::this_thread::sleep_for(5ms);
                  seen = endpoint->seen();
                }
                require(seen.find("offers best-effort, we ask for reliable") != seen.npos, seen);
              }),
              "")
        << rmw;
  }
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

}  // namespace
}  // namespace ontime::transport
