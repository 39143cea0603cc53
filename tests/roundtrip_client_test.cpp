// SPDX-License-Identifier: Apache-2.0
// The client and the server, each against a peer of the test's own.
#include <array>
#include <deque>
#include <functional>
#include <mutex>
#include <set>
#include <stop_token>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "message/message.hpp"
#include "roundtrip/roundtrip.hpp"
#include "transport/clock.hpp"

namespace ontime::roundtrip {
namespace {

using namespace std::chrono_literals;

using transport::now_ns;

// A peer that answers each message at once, in the sending thread, with what it likes.
class Peer final : public transport::Endpoint {
 public:
  static std::function<void(transport::Sink&, std::uint64_t sequence, std::vector<std::byte> payload)> answer;
  explicit Peer(transport::Sink& sink) : sink_(sink) {}
  transport::Matched matched() override { return {1, 1}; }
  bool send(std::uint64_t sequence, std::span<const std::byte> payload) noexcept override {
    answer(sink_, sequence, {payload.begin(), payload.end()});
    return true;
  }
  std::vector<transport::Thread> threads() override { return {}; }
  std::map<std::string, std::string> facts() override { return {}; }

 private:
  transport::Sink& sink_;
};
decltype(Peer::answer) Peer::answer;

constexpr std::uint64_t warm_up_of_peer = 3;
Counters counters_with(decltype(Peer::answer) answer, std::chrono::nanoseconds timeout = 10s) {
  Peer::answer = std::move(answer);
  const transport::Plugin plugin{transport::abi,
                                 "peer",
                                 [] { return std::string(); },
                                 {},
                                 {},
                                 [](const transport::Config&, transport::Sink& sink) {
                                   return std::unique_ptr<transport::Endpoint>(new Peer(sink));
                                 }};
  ClientOptions options;
  options.schedule = Schedule::back_to_back;  // it sends at least once, however busy the machine is
  options.duration = 20ms;
  options.timeout = timeout;
  options.warm_up = warm_up_of_peer;
  Client client(plugin, {}, options);
  client.start();
  client.go();
  while (client.state() != Client::State::finished) std::this_thread::sleep_for(1ms);
  return client.counters();
}

TEST(Client, AnswersToAnothersMessagesAreStrays) {
  const auto counters = counters_with([](auto& sink, auto sequence, auto payload) {
    const auto session = message::session_of(sequence);
    sink.arrived(message::sequence_of(session ^ 0x800000, message::index_of(sequence)), payload, now_ns());
    sink.arrived(sequence, payload, now_ns());
  });
  EXPECT_GT(counters.sent, 0U);
  EXPECT_EQ(counters.strays, counters.sent);
  EXPECT_EQ(counters.on_time + counters.late, counters.sent);
}

TEST(Client, AnswersToTheNextMessageAreStrays) {
  const auto counters = counters_with([](auto& sink, auto sequence, auto payload) {
    sink.arrived(sequence + 1, payload, now_ns());
    sink.arrived(sequence, payload, now_ns());
  });
  EXPECT_GT(counters.sent, 0U);
  EXPECT_EQ(counters.on_time + counters.late, counters.sent);
  EXPECT_EQ(counters.strays, counters.sent);
}

TEST(Client, AnswersOfAnotherSizeSettleNoMessage) {
  std::uint64_t answers = 0;
  const auto counters = counters_with(
      [&](auto& sink, auto sequence, auto payload) {
        if (answers++ >= warm_up_of_peer) payload.resize(payload.size() - 1);
        sink.arrived(sequence, payload, now_ns());
      },
      20ms);
  EXPECT_GT(counters.sent, 0U);
  EXPECT_EQ(counters.lost, counters.sent);
  EXPECT_EQ(counters.wrong_size, counters.sent);
}

TEST(Client, AnswersOfAnotherSizeEndNoWarmUp) {
  std::uint64_t answers = 0;
  const auto counters = counters_with([&](auto& sink, auto sequence, auto payload) {
    if (answers++ < 2) payload.push_back({});
    sink.arrived(sequence, payload, now_ns());
  });
  EXPECT_EQ(counters.wrong_size, 2U);
  EXPECT_EQ(counters.on_time + counters.late, counters.sent);
  EXPECT_EQ(answers, 2 + warm_up_of_peer + counters.sent);
}

// A link that carries one message after another, each in 30 ms, and loses every third.
TEST(Client, IsReadyOnceNoMessageOfTheWarmUpIsUnderWay) {
  struct Slow final : transport::Endpoint {
    explicit Slow(transport::Sink& sink) : sink_(sink) {}
    transport::Matched matched() override { return {1, 1}; }
    bool send(std::uint64_t sequence, std::span<const std::byte> payload) noexcept override {
      if (sent_++ % 3 != 1) {
        const std::lock_guard lock(mutex_);
        under_way.emplace_back(sequence, std::vector(payload.begin(), payload.end()));
      }
      return true;
    }
    std::vector<transport::Thread> threads() override { return {}; }
    std::map<std::string, std::string> facts() override { return {}; }
    void carry(const std::stop_token& stop) {
      while (!stop.stop_requested()) {
        std::this_thread::sleep_for(30ms);
        const std::lock_guard lock(mutex_);
        if (under_way.empty()) continue;
        auto [sequence, payload] = std::move(under_way.front());
        under_way.pop_front();
        sink_.arrived(sequence, payload, now_ns());
      }
    }
    std::size_t length() {
      const std::lock_guard lock(mutex_);
      return under_way.size();
    }

    transport::Sink& sink_;
    std::mutex mutex_;
    std::size_t sent_ = 0;
    std::deque<std::pair<std::uint64_t, std::vector<std::byte>>> under_way;
    std::jthread link{[this](const std::stop_token& stop) { carry(stop); }};
  };
  static Slow* slow = nullptr;
  const transport::Plugin plugin{transport::abi,
                                 "slow",
                                 [] { return std::string(); },
                                 {},
                                 {},
                                 [](const transport::Config&, transport::Sink& sink) {
                                   slow = new Slow(sink);
                                   return std::unique_ptr<transport::Endpoint>(slow);
                                 }};
  ClientOptions options;
  options.timeout = 10s;
  options.warm_up = 5;
  Client client(plugin, {}, options);
  client.start();
  while (client.state() < Client::State::ready) std::this_thread::sleep_for(1ms);
  EXPECT_EQ(slow->length(), 0U);
  EXPECT_GE(client.warm_up_answers(), 5U);
}

TEST(CounterNames, AreAllOfThem) {
  Counters counters;
  std::set<std::string> names;
  for (const auto& [name, member] : counter_names) {
    names.insert(name);
    EXPECT_EQ(counters.*member, 0U) << "each is named once";
    counters.*member = 1;
  }
  EXPECT_EQ(names.size(), counter_names.size());
  EXPECT_EQ((counter_names.size() + 2) * sizeof(std::uint64_t), sizeof(Counters)) << "and two moments";
}

TEST(Answers, AreNotedOnceThatIsAskedFor) {
  struct Answering final : transport::Endpoint {
    transport::Matched matched() override { return {1, 1}; }
    bool send(std::uint64_t, std::span<const std::byte>) noexcept override { return true; }
    std::vector<transport::Thread> threads() override { return {}; }
    std::map<std::string, std::string> facts() override { return {}; }
  };
  static transport::Sink* sink = nullptr;
  const transport::Plugin plugin{transport::abi,
                                 "answering",
                                 [] { return std::string(); },
                                 {},
                                 {},
                                 [](const transport::Config&, transport::Sink& given) {
                                   sink = &given;
                                   return std::unique_ptr<transport::Endpoint>(new Answering);
                                 }};
  Server server(plugin, {});
  std::array<std::byte, 16> payload{};
  sink->arrived(1, payload, 1000);
  server.note_answers();
  for (std::uint64_t i = 2; i < 70'000; ++i) sink->arrived(i, payload, static_cast<std::int64_t>(i));
  std::array<Server::Answer, 100> answers{};
  ASSERT_EQ(server.drain(answers), 100U);
  EXPECT_EQ(answers[0].sequence, 70'000U - 65'536) << "the oldest were written over";
  EXPECT_EQ(answers[99].sequence, answers[0].sequence + 99);
  EXPECT_EQ(answers[99].received_ns, static_cast<std::int64_t>(answers[99].sequence));
  EXPECT_GE(answers[99].sent_ns, answers[99].received_ns);
  std::size_t all = 100;
  while (const auto count = server.drain(answers)) all += count;
  EXPECT_EQ(all, 65'536U);
}

}  // namespace
}  // namespace ontime::roundtrip
