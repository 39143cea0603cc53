// SPDX-License-Identifier: Apache-2.0
// Background topics, over topics inside this process.
#include <condition_variable>
#include <deque>
#include <map>
#include <mutex>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "message/message.hpp"
#include "roundtrip/roundtrip.hpp"
#include "transport/clock.hpp"

namespace ontime::roundtrip {
namespace {

using namespace std::chrono_literals;
using testing::ElementsAre;
using transport::Config;
using transport::Endpoint;
using transport::Role;

// What was sent on it waits for its one reader.
class Topic {
 public:
  void send(std::uint64_t sequence) {
    {
      const std::lock_guard lock(mutex_);
      waiting_.push_back(sequence);
    }
    changed_.notify_all();
  }
  std::optional<std::uint64_t> take() {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [this] { return interrupted_ || !waiting_.empty(); });
    if (interrupted_) return {};
    const auto sequence = waiting_.front();
    waiting_.pop_front();
    return sequence;
  }
  void interrupt() {
    {
      const std::lock_guard lock(mutex_);
      interrupted_ = true;
    }
    changed_.notify_all();
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<std::uint64_t> waiting_;
  bool interrupted_ = false;
};

class Topics final : public Endpoint {
 public:
  static std::map<std::string, Topic> all;
  static std::vector<std::string> closed;  // by what they were called, as they went
  static std::string refused;              // the one that does not open
  static bool all_background;              // that were opened, as they were asked for

  Topics(const Config& config, transport::Sink& sink)
      : name_(config.ping_topic),
        reads_(all[config.role == Role::client ? config.pong_topic : config.ping_topic]),
        writes_(all[config.role == Role::client ? config.ping_topic : config.pong_topic]),
        sink_(sink) {
    if (name_ == refused) throw transport::Error("no more topics");
    all_background = all_background && config.background;
  }
  ~Topics() override { closed.push_back(name_); }

  std::unique_ptr<Endpoint> beside(const Config& config, transport::Sink& sink, Where) override {
    return std::make_unique<Topics>(config, sink);
  }
  transport::Matched matched() override { return {1, 1}; }
  bool send(std::uint64_t sequence, std::span<const std::byte>) noexcept override {
    writes_.send(sequence);
    return true;
  }
  void receive() noexcept override {
    if (const auto sequence = reads_.take()) sink_.arrived(*sequence, {}, transport::now_ns());
  }
  void interrupt() noexcept override { reads_.interrupt(); }
  std::vector<transport::Thread> threads() override { return {}; }
  std::map<std::string, std::string> facts() override { return {}; }

 private:
  const std::string name_;
  Topic &reads_, &writes_;
  transport::Sink& sink_;
};
std::map<std::string, Topic> Topics::all;
std::vector<std::string> Topics::closed;
std::string Topics::refused;
bool Topics::all_background = true;

const transport::Plugin plugin{
    transport::abi,
    "topics",
    [] { return std::string(); },
    {.listener = true, .waitset = true, .max_payload_bytes = 500, .background = true, .nodes = true},
    {},
    [](const Config& config, transport::Sink& sink) {
      return std::unique_ptr<Endpoint>(new Topics(config, sink));
    }};

struct Nothing final : transport::Sink {
  void arrived(std::uint64_t, std::span<std::byte>, std::int64_t) noexcept override {}
};

class BackgroundInside : public testing::Test {
 protected:
  static constexpr auto duration = 200ms;
  static constexpr std::uint32_t session = 0x123456;

  BackgroundInside() {
    Topics::all.clear();
    Topics::closed.clear();
    Topics::refused.clear();
    Topics::all_background = true;
  }
  static Config config_of(Role role) {
    Config config;
    config.role = role;
    config.receive = transport::Receive::waitset;
    return config;
  }
  std::unique_ptr<BackgroundTopics> open(Role role, std::chrono::nanoseconds time = duration,
                                         Endpoint* critical = nullptr) const {
    return std::make_unique<BackgroundTopics>(plugin, critical, config_of(role), options_, time);
  }
  static void await(const std::function<bool()>& true_now) {
    for (int tries = 0; tries < 10'000 && !true_now(); ++tries) std::this_thread::sleep_for(1ms);
    EXPECT_TRUE(true_now());
  }
  static void go(BackgroundTopics& one, BackgroundTopics& other) {
    for (auto* end : {&one, &other}) end->start();
    for (auto* end : {&one, &other}) end->go();
  }
  static std::uint64_t cycles(const BackgroundTopics& one) {
    const auto counted = one.counters();
    return counted.sent + counted.refused + counted.skipped_cycles;
  }

  BackgroundOptions options_{.topics = 3, .payload_bytes = 10, .period = 20ms, .session = session};
};

TEST_F(BackgroundInside, PlacesOfNodesAreRefusedWhereATransportDeclaresNone) {
  auto without_nodes = plugin;
  without_nodes.capabilities.nodes = false;
  const auto open_in = [&](Where where) {
    options_.where = where;
    const BackgroundTopics background(without_nodes, nullptr, config_of(Role::client), options_, duration);
  };
  EXPECT_THROW(open_in(Where::own_executor), transport::WrongInput);
  EXPECT_NO_THROW(open_in(Where::other_process));
}

TEST_F(BackgroundInside, AreOpenedAsBackgroundInAProcessOfTheirOwnToo) {
  const auto client = open(Role::client);
  EXPECT_TRUE(Topics::all_background);
}

TEST_F(BackgroundInside, AreCountedAtBothEnds) {
  Nothing sink;
  const auto critical = plugin.open(config_of(Role::client), sink);
  const auto client = open(Role::client, duration, critical.get());
  const auto server = open(Role::server);
  EXPECT_TRUE(client->matched());
  EXPECT_EQ(client->threads().size(), 4U) << "one sends, one waits for each topic";
  go(*client, *server);
  await([&] { return cycles(*client) == 30 && cycles(*server) == 30; });
  await([&] { return server->counters().received == client->counters().sent; });
  await([&] { return client->counters().received == server->counters().sent; });
  EXPECT_GT(client->counters().sent, 0U);
  EXPECT_EQ(client->counters().strays + client->counters().overruns, 0U);
}

TEST_F(BackgroundInside, IgnoreForeignSenderThatCameFirst) {
  const auto client = open(Role::client), server = open(Role::server);
  auto& pong = Topics::all.at("/background_1/pong");
  for (const auto other : {session + 2, session + 3}) pong.send(message::sequence_of(other, 0));
  await([&] { return client->counters().strays == 2; });
  go(*client, *server);
  await([&] { return cycles(*server) == 30; });
  await([&] { return client->counters().received == server->counters().sent; });
  EXPECT_EQ(client->counters().strays, 2U);
}

TEST_F(BackgroundInside, OverlongCallbacksAreReported) {
  options_.callback = 2 * options_.period;
  const auto client = open(Role::client), server = open(Role::server);
  go(*client, *server);
  await([&] { return client->counters().overruns > 0; });
}

TEST_F(BackgroundInside, CanBeStoppedAndGivenUpAtAnyMoment) {
  for (int round = 0; round < 20; ++round) {
    Topics::all.clear();
    const auto client = open(Role::client, 1h), server = open(Role::server, 1h);
    if (round % 2 == 0) client->start();
    if (round % 4 == 0) client->go();
    std::this_thread::sleep_for(round * 1ms);
    if (round % 3 == 0) client->stop();
  }
}

TEST_F(BackgroundInside, GoBeforeWhatTheyAreBeside) {
  open(Role::client);
  EXPECT_THAT(Topics::closed, ElementsAre("/background_3/ping", "/background_2/ping", "/background_1/ping"));
  Topics::closed.clear();
  Topics::refused = "/background_3/ping";
  EXPECT_THROW(open(Role::client), transport::Error);
  EXPECT_THAT(Topics::closed, ElementsAre("/background_2/ping", "/background_1/ping"));
}

TEST(BackgroundMessages, AreThoseThatAreDueInTime) {
  const auto asked = [](int topics, std::chrono::nanoseconds period, std::chrono::nanoseconds duration) {
    return messages_asked({.topics = topics, .period = period}, duration);
  };
  EXPECT_EQ(asked(3, 20ms, 200ms), 30U);
  EXPECT_EQ(asked(1, 1s, 2400ms), 2U);
  EXPECT_EQ(asked(1, 2s, 5s), 2U) << "the third would be due at its end and a second more";
  EXPECT_EQ(asked(1, 142'857'143ns, 1s), 7U) << "a seventh of a second, in whole ns";
  EXPECT_EQ(asked(1, 10s, 1s), 1U);
}

}  // namespace
}  // namespace ontime::roundtrip
