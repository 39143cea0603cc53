// SPDX-License-Identifier: Apache-2.0
#include "roundtrip/roundtrip.hpp"

#include <condition_variable>
#include <deque>
#include <mutex>
#include <random>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "message/message.hpp"
#include "roundtrip/clock.hpp"
#include "roundtrip/ledger.hpp"

namespace ontime::roundtrip {
namespace {

using namespace std::chrono_literals;

constexpr std::int64_t us = 1000, ms = 1000 * us;

// --- the ledger, on a clock of the test's own ---

std::vector<Sample> drained(Ledger& ledger) {
  std::vector<Sample> samples(100'000);
  samples.resize(ledger.drain(samples));
  return samples;
}

TEST(Ledger, JudgesByDeadlineAndTimeOut) {
  Ledger ledger(10 * ms, 500 * ms, {64, 64});
  const auto send = [&](std::int64_t at) { return ledger.post({at, at, at, at, 0}); };
  EXPECT_TRUE(ledger.arrived(send(0), 10 * ms, {}));       // exactly at the deadline
  EXPECT_TRUE(ledger.arrived(send(0), 10 * ms + 1, {}));   // just beyond
  EXPECT_TRUE(ledger.arrived(send(0), 500 * ms, {}));      // exactly at the time-out
  EXPECT_TRUE(ledger.arrived(send(0), 500 * ms + 1, {}));  // it came, but too late to count
  send(0);                                                 // never answered
  ledger.settle(500 * ms);
  EXPECT_FALSE(ledger.idle()) << "the last may still be answered";
  ledger.settle(500 * ms + 1);
  EXPECT_TRUE(ledger.idle());

  std::vector<Fate> fates;
  for (const auto& sample : drained(ledger)) fates.push_back(sample.fate);
  EXPECT_THAT(fates, testing::ElementsAre(Fate::on_time, Fate::late, Fate::late, Fate::lost, Fate::lost));
  EXPECT_EQ(ledger.counters().strays, 1U) << "the answer after the time-out";
}

TEST(Ledger, CountsWhatIsNoFirstAnswerBeside) {
  Ledger ledger(10 * ms, 100 * ms, {4, 64});
  const auto first = ledger.post({0, 0, 0, 0, 0});
  const auto second = ledger.post({0, 0, 0, 0, 0});
  EXPECT_TRUE(ledger.arrived(second, 1 * ms, {}));
  EXPECT_TRUE(ledger.arrived(first, 2 * ms, {}));   // after the answer to a later message
  EXPECT_FALSE(ledger.arrived(first, 3 * ms, {}));  // a duplicate, not yet settled
  ledger.settle(4 * ms);
  EXPECT_FALSE(ledger.arrived(second, 5 * ms, {}));  // a duplicate, settled
  EXPECT_FALSE(ledger.arrived(99, 5 * ms, {}));      // never sent
  const auto third = ledger.post({0, 0, 0, 0, 0});
  ledger.settle(200 * ms);
  EXPECT_FALSE(ledger.arrived(third, 201 * ms, {}));  // long lost
  const auto counters = ledger.counters();
  EXPECT_EQ(counters.reordered, 1U);
  EXPECT_EQ(counters.duplicates, 2U);
  EXPECT_EQ(counters.strays, 2U);
  EXPECT_EQ(counters.sent, 3U);
  EXPECT_EQ(counters.on_time, 2U);
  EXPECT_EQ(counters.lost, 1U);
}

TEST(Ledger, KeepsWhatTheServerSaid) {
  Ledger ledger(10 * ms, 100 * ms, {4, 4});
  ledger.arrived(ledger.post({1, 2, 3, 4, 5}), 6, message::ServerTimes{7, 8});
  ledger.settle(10);
  const auto samples = drained(ledger);
  ASSERT_EQ(samples.size(), 1U);
  const auto& sample = samples[0];
  EXPECT_EQ(std::tie(sample.intended_ns, sample.due_ns, sample.woke_ns, sample.sent_ns, sample.received_ns,
                     sample.server_received_ns, sample.server_sent_ns),
            std::make_tuple(1, 2, 3, 4, 6, 7, 8));
  EXPECT_EQ(sample.skipped_cycles, 5U);
  EXPECT_EQ(ledger.counters().skipped_cycles, 5U);
}

TEST(Ledger, SaysHowManySamplesNobodyDrained) {
  Ledger ledger(10 * ms, 100 * ms, {4, 3});
  for (int i = 0; i < 10; ++i) {
    ledger.arrived(ledger.post({0, 0, 0, 0, 0}), 1, {});
    ledger.settle(1);
  }
  EXPECT_EQ(ledger.counters().on_time, 10U);
  EXPECT_EQ(drained(ledger).size() + ledger.counters().dropped_records, 10U);
}

// The law: whatever the network does, every message meets exactly one fate, and the fate that its stamps say.
TEST(Ledger, AddsUpWhateverArrives) {
  for (unsigned seed = 0; seed < 200; ++seed) {
    std::mt19937 random(seed);
    Ledger ledger(10 * ms, 50 * ms, {256, 100'000});
    struct Arrival {
      std::int64_t at;
      std::uint64_t index;
      bool operator<(const Arrival& other) const { return at < other.at; }
    };
    std::multiset<Arrival> network;
    std::map<std::uint64_t, std::int64_t> first_answer;
    std::uint64_t answers = 0;
    std::int64_t now = 1 * ms;
    const int messages = 300;
    for (int sent = 0; sent < messages || !ledger.idle(); now += 1 * ms) {
      for (; !network.empty() && network.begin()->at <= now; network.erase(network.begin())) {
        const auto [at, index] = *network.begin();
        first_answer.try_emplace(index, at);
        ledger.arrived(index, at, {});
        ++answers;
      }
      ledger.settle(now);
      const auto c = ledger.counters();
      ASSERT_LE(c.on_time + c.late + c.lost, c.sent);
      if (sent == messages || ledger.full() || random() % 3 == 0) continue;
      const auto index = ledger.post({now, now, now, now, 0});
      ++sent;
      for (auto copies = random() % 3; copies > 0; --copies)  // lost, once, or twice
        network.insert({now + static_cast<std::int64_t>(random() % 80) * ms, index});
    }
    const auto samples = drained(ledger);
    ASSERT_EQ(samples.size(), static_cast<std::size_t>(messages));
    std::uint64_t counted_answers = 0;
    for (std::size_t i = 0; i < samples.size(); ++i) {
      const auto& sample = samples[i];
      ASSERT_EQ(sample.index, i) << "in order, none twice, none left out";
      const auto answer = first_answer.find(i);
      const auto took = answer == first_answer.end() ? 51 * ms : answer->second - sample.sent_ns;
      const auto fate = took > 50 * ms ? Fate::lost : took > 10 * ms ? Fate::late : Fate::on_time;
      ASSERT_EQ(sample.fate, fate) << i;
      ASSERT_EQ(sample.received_ns == 0, fate == Fate::lost);
      counted_answers += fate != Fate::lost;
    }
    const auto c = ledger.counters();
    EXPECT_EQ(c.sent, c.on_time + c.late + c.lost);
    EXPECT_EQ(answers, counted_answers + c.duplicates + c.strays) << "every arrival is accounted for";
  }
}

// --- both ends, over a network inside this process ---

// Echoes by a thread of its own, as a middleware would, through a rule of the test's.
class FakeNetwork final : public transport::Endpoint {
 public:
  using Rule = std::function<int(std::uint64_t index)>;  // how many answers
  static Rule rule;
  static std::atomic<bool> accepts;

  explicit FakeNetwork(transport::Sink& sink) : sink_(sink), thread_([this] { deliver(); }) {}
  ~FakeNetwork() override {
    {
      const std::lock_guard lock(mutex_);
      ending_ = true;
    }
    wake_.notify_one();
    thread_.join();
  }
  transport::Matched matched() override { return {1, 1}; }
  bool send(std::uint64_t sequence, std::span<const std::byte> payload) noexcept override {
    if (!accepts) return false;
    {
      const std::lock_guard lock(mutex_);
      queue_.push_back({sequence, {payload.begin(), payload.end()}});
    }
    wake_.notify_one();
    return true;
  }
  std::vector<transport::Thread> threads() override { return {}; }
  std::map<std::string, std::string> facts() override { return {}; }

 private:
  void deliver() {
    std::unique_lock lock(mutex_);
    while (true) {
      wake_.wait(lock, [&] { return ending_ || !queue_.empty(); });
      if (ending_) return;
      auto [sequence, payload] = std::move(queue_.front());
      queue_.pop_front();
      lock.unlock();
      for (int answers = rule(message::index_of(sequence)); answers > 0; --answers)
        sink_.arrived(sequence, payload, now_ns());
      lock.lock();
    }
  }
  transport::Sink& sink_;
  std::mutex mutex_;
  std::condition_variable wake_;
  std::deque<std::pair<std::uint64_t, std::vector<std::byte>>> queue_;
  bool ending_ = false;
  std::thread thread_;
};
FakeNetwork::Rule FakeNetwork::rule;
std::atomic<bool> FakeNetwork::accepts{true};

const transport::Plugin fake{transport::abi,
                             "fake",
                             [] { return std::string(); },
                             {},
                             {},
                             [](const transport::Config&, transport::Sink& sink) {
                               return std::unique_ptr<transport::Endpoint>(new FakeNetwork(sink));
                             }};

std::vector<Sample> measure(const ClientOptions& options, Counters* counters = nullptr,
                            std::function<void(Client&)> meanwhile = {}) {
  Client client(fake, {}, options);
  client.start();
  std::vector<Sample> samples, batch(4096);
  bool finished = false;
  while (!finished) {
    finished = client.state() == Client::State::finished;
    if (meanwhile) meanwhile(client);
    while (const auto count = client.drain(batch))
      samples.insert(samples.end(), batch.begin(), batch.begin() + static_cast<std::ptrdiff_t>(count));
    std::this_thread::sleep_for(1ms);
  }
  if (counters != nullptr) *counters = client.counters();
  return samples;
}

void expect_complete(const std::vector<Sample>& samples, const Counters& counters) {
  EXPECT_EQ(counters.sent, samples.size());
  EXPECT_EQ(counters.sent, counters.on_time + counters.late + counters.lost);
  for (std::size_t i = 0; i < samples.size(); ++i) {
    const auto& s = samples[i];
    ASSERT_EQ(s.index, i);
    ASSERT_LE(s.intended_ns, s.due_ns);
    ASSERT_LE(s.due_ns, s.woke_ns);
    ASSERT_LE(s.woke_ns, s.sent_ns);
    if (s.fate != Fate::lost) {
      ASSERT_LT(s.sent_ns, s.received_ns);
    }
  }
}

class EverySchedule : public testing::TestWithParam<Schedule> {
 protected:
  void SetUp() override {
    FakeNetwork::rule = [](auto) { return 1; };
    FakeNetwork::accepts = true;
    options.schedule = GetParam();
    options.period = 1ms;
    options.deadline = 1ms;
    options.timeout = 20ms;
    options.duration = 100ms;
  }
  ClientOptions options;
};

INSTANTIATE_TEST_SUITE_P(Schedules, EverySchedule,
                         testing::Values(Schedule::next_free, Schedule::fixed, Schedule::back_to_back),
                         [](const auto& schedule) {
                           std::string name = word_of(schedule.param);
                           std::erase(name, '-');
                           return name;
                         });

TEST_P(EverySchedule, AnswersEachMessageOnce) {
  Counters counters;
  const auto samples = measure(options, &counters);
  EXPECT_GT(samples.size(), 0U);
  expect_complete(samples, counters);
  EXPECT_EQ(counters.duplicates + counters.strays + counters.refused_sends, 0U);
}

TEST_P(EverySchedule, GoesOnAfterALoss) {
  FakeNetwork::rule = [](std::uint64_t index) { return index % 3 == 1 ? 0 : 1; };
  options.warm_up = 1;
  Counters counters;
  const auto samples = measure(options, &counters);
  expect_complete(samples, counters);
  EXPECT_GT(counters.lost, 0U);
  EXPECT_GT(counters.on_time + counters.late, 0U);
  for (const auto& sample : samples)
    if (sample.index % 3 == 1) {
      EXPECT_EQ(sample.fate, Fate::lost);
    }
}

TEST_P(EverySchedule, CountsDuplicatesBeside) {
  FakeNetwork::rule = [](auto) { return 2; };
  Counters counters;
  const auto samples = measure(options, &counters);
  expect_complete(samples, counters);
  EXPECT_GT(counters.duplicates, 0U);
}

TEST_P(EverySchedule, RefusedMessagesAreLost) {
  Counters counters;
  options.timeout = 5ms;
  const auto samples = measure(options, &counters, [](Client& client) {
    if (client.state() == Client::State::measuring) FakeNetwork::accepts = false;
  });
  expect_complete(samples, counters);
  EXPECT_GT(counters.refused_sends, 0U);
  EXPECT_GE(counters.lost, counters.refused_sends);
}

TEST_P(EverySchedule, KeepsAllUpToAnInterruption) {
  options.duration = std::chrono::hours(1);
  Counters counters;
  const auto samples = measure(options, &counters, [](Client& client) {
    if (client.counters().sent > 10) client.stop();
  });
  EXPECT_GT(counters.sent, 10U);
  expect_complete(samples, counters);
}

TEST_P(EverySchedule, CanBeGivenUpAtAnyMoment) {
  options.duration = std::chrono::hours(1);
  for (int round = 0; round < 20; ++round) {
    Client client(fake, {}, options);
    if (round % 2 == 0) client.start();
    std::this_thread::sleep_for(round * 1ms);
  }
}

TEST_P(EverySchedule, DoesNotCountTheWarmUp) {
  options.warm_up = 50;
  options.duration = 5ms;
  Counters counters;
  measure(options, &counters);
  if (GetParam() != Schedule::back_to_back) {
    EXPECT_LE(counters.sent, 5U);
  }
}

TEST(NextFree, MovesToTheNextFreeCycleAndHidesNoStall) {
  FakeNetwork::rule = [](std::uint64_t index) {
    if (index == 20) std::this_thread::sleep_for(9500us);
    return 1;
  };
  ClientOptions options;
  options.period = options.deadline = 2ms;
  options.duration = 100ms;
  options.warm_up = 1;
  Counters counters;
  const auto samples = measure(options, &counters);
  expect_complete(samples, counters);
  const auto period_ns = std::chrono::nanoseconds(options.period).count();
  std::uint64_t skipped = 0;
  for (std::size_t i = 0; i < samples.size(); ++i) {
    const auto& s = samples[i];
    skipped += s.skipped_cycles;
    ASSERT_EQ(s.due_ns, s.intended_ns + std::int64_t{s.skipped_cycles} * period_ns);
    if (i == 0) continue;
    ASSERT_EQ(s.intended_ns, samples[i - 1].due_ns + period_ns)
        << "due from the first cycle that was not served";
    ASSERT_GE(s.woke_ns, samples[i - 1].received_ns) << "never two in flight";
  }
  EXPECT_EQ(samples.at(20).fate, Fate::late);
  EXPECT_GE(samples.at(21).skipped_cycles, 4U);
  EXPECT_EQ(skipped, counters.skipped_cycles);
}

TEST(Fixed, SendsInEveryCycleWhateverHappens) {
  FakeNetwork::rule = [](std::uint64_t index) {
    if (index == 20) std::this_thread::sleep_for(15ms);
    return 1;
  };
  ClientOptions options;
  options.schedule = Schedule::fixed;
  options.period = options.deadline = 1ms;
  options.duration = 100ms;
  options.warm_up = 1;
  Counters counters;
  const auto samples = measure(options, &counters);
  expect_complete(samples, counters);
  EXPECT_EQ(samples.size(), 100U);
  for (std::size_t i = 1; i < samples.size(); ++i)
    ASSERT_EQ(samples[i].intended_ns - samples[i - 1].intended_ns, 1 * ms);
  EXPECT_EQ(counters.skipped_cycles, 0U);
  EXPECT_EQ(samples.at(20).fate, Fate::late);
  EXPECT_EQ(samples.at(25).fate, Fate::late) << "it stood behind the one that stalled";
}

TEST(Client, TellsItsAnswersFromSomebodyElses) {
  FakeNetwork::rule = [](auto) { return 1; };
  class Stray final : public transport::Endpoint {
   public:
    explicit Stray(transport::Sink& sink) : sink_(sink) {}
    transport::Matched matched() override { return {1, 1}; }
    bool send(std::uint64_t sequence, std::span<const std::byte> payload) noexcept override {
      std::vector<std::byte> copy(payload.begin(), payload.end());
      const auto session = message::session_of(sequence);
      sink_.arrived(message::sequence_of(session ^ 0x800000, message::index_of(sequence)), copy, now_ns());
      sink_.arrived(sequence, copy, now_ns());
      return true;
    }
    std::vector<transport::Thread> threads() override { return {}; }
    std::map<std::string, std::string> facts() override { return {}; }

   private:
    transport::Sink& sink_;
  };
  const transport::Plugin plugin{transport::abi,
                                 "stray",
                                 [] { return std::string(); },
                                 {},
                                 {},
                                 [](const transport::Config&, transport::Sink& sink) {
                                   return std::unique_ptr<transport::Endpoint>(new Stray(sink));
                                 }};
  ClientOptions options;
  options.period = 1ms;
  options.duration = 20ms;
  Client client(plugin, {}, options);
  client.start();
  while (client.state() != Client::State::finished) std::this_thread::sleep_for(1ms);
  const auto counters = client.counters();
  EXPECT_GT(counters.on_time, 0U);
  EXPECT_EQ(counters.strays, counters.sent);
  EXPECT_EQ(counters.on_time + counters.late, counters.sent);
}

TEST(Words, ArePairs) {
  for (const auto schedule : {Schedule::next_free, Schedule::fixed, Schedule::back_to_back})
    EXPECT_EQ(schedule_of(word_of(schedule)), schedule);
  EXPECT_FALSE(schedule_of("sometimes"));
}

}  // namespace
}  // namespace ontime::roundtrip
