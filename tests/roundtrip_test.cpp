// SPDX-License-Identifier: Apache-2.0
// Both ends, over a network inside this process.
#include "roundtrip/roundtrip.hpp"

#include <condition_variable>
#include <deque>
#include <functional>
#include <mutex>
#include <random>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "message/message.hpp"
#include "transport/clock.hpp"

namespace ontime::roundtrip {
namespace {

using namespace std::chrono_literals;

using transport::now_ns;

constexpr std::int64_t ms = 1'000'000;

// Echoes by a thread of its own, as a middleware would, through a rule of the test's.
class FakeNetwork final : public transport::Endpoint {
 public:
  using Rule = std::function<int(std::uint64_t index)>;  // how many answers
  static Rule rule;
  static std::function<void()> on_send;  // in the sending thread, the message being on its way
  static std::atomic<bool> accepts;
  static std::atomic<std::uint64_t> sends, callers;

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
    ++sends;
    if (!accepts) return false;
    EXPECT_EQ(++callers, 1U) << "one caller of send() at a time";
    {
      const std::lock_guard lock(mutex_);
      queue_.push_back({sequence, {payload.begin(), payload.end()}});
    }
    wake_.notify_one();
    if (on_send) on_send();
    --callers;
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
std::function<void()> FakeNetwork::on_send;
std::atomic<bool> FakeNetwork::accepts{true};
std::atomic<std::uint64_t> FakeNetwork::sends{0}, FakeNetwork::callers{0};

const transport::Plugin fake{transport::abi,
                             "fake",
                             [] { return std::string(); },
                             {},
                             {},
                             [](const transport::Config&, transport::Sink& sink) {
                               return std::unique_ptr<transport::Endpoint>(new FakeNetwork(sink));
                             }};

struct Run {
  std::vector<Sample> samples;  // by index, as last told
  Counters counters;
};

Run measure_once(const ClientOptions& options, const std::function<void(Client&)>& meanwhile) {
  FakeNetwork::accepts = true;
  Client client(fake, {}, options);
  client.start();
  client.go();
  Run run;
  std::vector<Sample> batch(4096);
  bool finished = false;
  while (!finished) {
    finished = client.state() == Client::State::finished;
    if (meanwhile) meanwhile(client);
    while (const auto count = client.drain(batch)) {
      for (std::size_t i = 0; i < count; ++i) {
        if (batch[i].index == run.samples.size())
          run.samples.push_back(batch[i]);
        else
          run.samples.at(batch[i].index) = batch[i];
      }
    }
    std::this_thread::sleep_for(1ms);
  }
  run.counters = client.counters();
  return run;
}

// On a busy machine the sender may sleep through a whole measurement: it is repeated until there is enough in
// it.
Run measure(
    const ClientOptions& options, const std::function<void(Client&)>& meanwhile = {},
    const std::function<bool(const Counters&)>& enough = [](const Counters& of) { return of.sent > 0; }) {
  constexpr int most_tries = 100;
  auto run = measure_once(options, meanwhile);
  for (int tries = 1; tries < most_tries && !enough(run.counters); ++tries)
    run = measure_once(options, meanwhile);
  return run;
}

void expect_complete(const Run& run, const ClientOptions& options) {
  const auto& [samples, counters] = run;
  EXPECT_EQ(counters.sent, samples.size());
  EXPECT_EQ(counters.sent, counters.on_time + counters.late + counters.lost);
  const auto cycles = options.duration / options.period;
  if (options.schedule != Schedule::back_to_back && options.duration < 1h) {
    EXPECT_EQ(counters.sent + counters.skipped_cycles, static_cast<std::uint64_t>(cycles));
  }
  auto skipped = counters.trailing_cycles;
  for (std::size_t i = 0; i < samples.size(); ++i) {
    const auto& s = samples[i];
    skipped += s.skipped_cycles;
    ASSERT_EQ(s.index, i);
    ASSERT_LE(s.intended_ns, s.due_ns);
    ASSERT_LE(s.due_ns, s.woke_ns);
    ASSERT_LE(s.woke_ns, s.sent_ns);
    if (s.fate != Fate::lost) {
      ASSERT_LT(s.sent_ns, s.received_ns);
    }
    if (options.schedule == Schedule::back_to_back || i == 0) continue;
    const auto period_ns = std::chrono::nanoseconds(options.period).count();
    ASSERT_EQ(s.due_ns, s.intended_ns + std::int64_t{s.skipped_cycles} * period_ns);
    ASSERT_EQ(s.intended_ns, samples[i - 1].due_ns + period_ns)
        << "due from the first cycle that was not served";
    ASSERT_LT(s.woke_ns, s.due_ns + period_ns) << "no message for a cycle that is past";
    if (options.schedule == Schedule::next_free && samples[i - 1].fate != Fate::lost) {
      ASSERT_GE(s.sent_ns, samples[i - 1].received_ns) << "never two in flight";
    }
  }
  EXPECT_EQ(skipped, counters.skipped_cycles);
}

class EverySchedule : public testing::TestWithParam<Schedule> {
 protected:
  void SetUp() override {
    FakeNetwork::rule = [](auto) { return 1; };
    FakeNetwork::on_send = {};
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
  options.timeout = 10s;
  const auto run = measure(options);
  EXPECT_GT(run.samples.size(), 0U);
  expect_complete(run, options);
  EXPECT_EQ(run.counters.duplicates + run.counters.strays + run.counters.refused_sends, 0U);
}

TEST_P(EverySchedule, GoesOnAfterALoss) {
  FakeNetwork::rule = [](std::uint64_t index) { return index % 3 == 1 ? 0 : 1; };
  options.warm_up = 1;
  const auto run =
      measure(options, {}, [](const Counters& of) { return of.lost > 0 && of.on_time + of.late > 0; });
  expect_complete(run, options);
  EXPECT_GT(run.counters.lost, 0U);
  EXPECT_GT(run.counters.on_time + run.counters.late, 0U);
  for (const auto& sample : run.samples)
    if (sample.index % 3 == 1) {
      EXPECT_EQ(sample.fate, Fate::lost);
    }
}

TEST_P(EverySchedule, CountsDuplicatesBeside) {
  FakeNetwork::rule = [](auto) { return 2; };
  const auto run = measure(options, {}, [](const Counters& of) { return of.duplicates > 0; });
  expect_complete(run, options);
  EXPECT_GT(run.counters.duplicates, 0U);
}

TEST_P(EverySchedule, RefusedMessagesAreLost) {
  options.timeout = 5ms;
  const auto refuse = [](Client& client) {
    if (client.state() == Client::State::measuring) FakeNetwork::accepts = false;
  };
  const auto run = measure(options, refuse, [](const Counters& of) { return of.refused_sends > 0; });
  expect_complete(run, options);
  EXPECT_GT(run.counters.refused_sends, 0U);
  EXPECT_GE(run.counters.lost, run.counters.refused_sends);
}

// The law, with threads: whichever is held up, nothing is left out and nothing is counted twice. (In a world
// whose time is the test's own, and with thousands of seeds: roundtrip_cycles_test.)
TEST_P(EverySchedule, AddsUpWhenAnyThreadStalls) {
  for (unsigned seed = 0; seed < 10; ++seed) {
    SCOPED_TRACE(seed);
    const auto held_up = [](std::mt19937& random) {
      if (random() % 8 == 0) std::this_thread::sleep_for(std::chrono::microseconds(random() % 15'000));
    };
    std::mt19937 sender(seed), peer(seed + 100);
    FakeNetwork::on_send = [&] { held_up(sender); };
    FakeNetwork::rule = [&](auto) {
      held_up(peer);
      return static_cast<int>(peer() % 8 == 0 ? 0 : 1 + peer() % 8 / 7);
    };
    options.timeout = seed % 2 == 0 ? 3ms : 20ms;
    expect_complete(measure(options), options);
  }
}

TEST_P(EverySchedule, KeepsAllUpToAnInterruption) {
  options.duration = std::chrono::hours(1);
  std::atomic<std::int64_t> before_ns{0}, after_ns{0};
  const auto run = measure(options, [&](Client& client) {
    if (client.counters().sent <= 10 || before_ns != 0) return;
    before_ns = now_ns();
    client.stop();
    after_ns = now_ns();
  });
  EXPECT_GT(run.counters.sent, 10U);
  expect_complete(run, options);
  if (options.schedule == Schedule::back_to_back) return;
  const auto cycles_until = [&](std::int64_t at_ns) {  // those that were due before
    return static_cast<std::uint64_t>((at_ns - run.samples.at(0).intended_ns + ms - 1) / ms);
  };
  EXPECT_GE(run.counters.sent + run.counters.skipped_cycles, cycles_until(before_ns));
  EXPECT_LE(run.counters.sent + run.counters.skipped_cycles, cycles_until(after_ns));
}

TEST_P(EverySchedule, CanBeGivenUpAtAnyMoment) {
  options.duration = std::chrono::hours(1);
  for (int round = 0; round < 10; ++round) {
    Client client(fake, {}, options);
    if (round % 2 == 0) client.start();
    if (round % 4 == 0) client.go();
    std::this_thread::sleep_for(round * 2ms);
  }
}

TEST_P(EverySchedule, IsSilentBetweenWarmUpAndGo) {
  options.warm_up = 20;
  options.period = 200us;
  options.duration = 500ms;
  Client client(fake, {}, options);
  client.start();
  while (client.state() < Client::State::ready) std::this_thread::sleep_for(1ms);
  EXPECT_GE(client.warm_up_answers(), 20U);
  const auto sends = FakeNetwork::sends.load();
  std::this_thread::sleep_for(20ms);
  EXPECT_EQ(FakeNetwork::sends, sends);
  EXPECT_EQ(client.state(), Client::State::ready);
  EXPECT_EQ(client.counters().sent, 0U) << "the warm-up is not counted";
  client.go();
  while (client.state() != Client::State::finished) std::this_thread::sleep_for(1ms);
  EXPECT_GT(client.counters().sent, 0U);
  EXPECT_EQ(FakeNetwork::sends, sends + client.counters().sent);
}

TEST_P(EverySchedule, IsFinishedWhenStoppedBeforeItWent) {
  for (const bool starts : {false, true}) {
    Client client(fake, {}, options);
    if (starts) client.start();
    while (starts && client.state() < Client::State::ready) std::this_thread::sleep_for(1ms);
    client.stop();
    while (client.state() != Client::State::finished) std::this_thread::sleep_for(1ms);
    EXPECT_EQ(client.counters().sent + client.counters().skipped_cycles, 0U);
  }
}

TEST_P(EverySchedule, SaysHowManySamplesWait) {
  options.timeout = 10s;  // what is given up and answered after all has two samples
  Client client(fake, {}, options);
  client.start();
  client.go();
  while (client.state() != Client::State::finished) std::this_thread::sleep_for(1ms);
  const auto waiting = std::min<std::size_t>(client.counters().sent, client.capacity());
  EXPECT_EQ(client.undrained(), waiting);
  EXPECT_EQ(client.counters().dropped_records, client.counters().sent - waiting);
  EXPECT_GE(client.capacity(), static_cast<std::size_t>(10s / options.period));
  std::vector<Sample> samples(1);
  EXPECT_EQ(client.drain(samples), std::min<std::size_t>(waiting, 1));
  EXPECT_EQ(client.undrained(), waiting - std::min<std::size_t>(waiting, 1));
}

// A stall in the middle of send() is one of the sending thread.
class EveryPeriod : public EverySchedule {};
INSTANTIATE_TEST_SUITE_P(Schedules, EveryPeriod, testing::Values(Schedule::next_free, Schedule::fixed),
                         [](const auto& schedule) {
                           return schedule.param == Schedule::fixed ? "fixed" : "nextfree";
                         });

TEST_P(EveryPeriod, SkipsWhatTheSenderSleptThrough) {
  std::atomic<int> sends{0};
  FakeNetwork::on_send = [&] {
    if (++sends == 5) std::this_thread::sleep_for(20ms);
  };
  options.warm_up = 0;
  options.duration = 500ms;
  const auto run = measure(options, {}, [&](const Counters& of) {
    if (of.sent <= 5) sends = 0;
    return of.sent > 5;
  });
  expect_complete(run, options);
  EXPECT_GE(run.samples.at(5).skipped_cycles, 18U);
  EXPECT_GE(run.samples.at(5).passed_wake_ns, 18 * ms);
}

TEST(NextFree, MovesToTheNextFreeCycle) {
  FakeNetwork::on_send = {};
  FakeNetwork::rule = [](std::uint64_t index) {
    if (index == 5)
      std::this_thread::sleep_for(10500us);  // after the cycle of 8 ms, which a late sender uses
    return 1;
  };
  ClientOptions options;
  options.period = options.deadline = 2ms;
  options.duration = 100ms;
  options.warm_up = 1;
  const auto run = measure(options, {}, [](const Counters& of) { return of.sent > 6; });
  expect_complete(run, options);
  EXPECT_EQ(run.samples.at(5).fate, Fate::late);
  EXPECT_GE(run.samples.at(6).skipped_cycles, 4U);
  EXPECT_GT(run.samples.at(6).passed_wake_ns, 0) << "the cycles passed over leave their wake-ups";
}

TEST(NextFree, CountsTheCyclesAfterTheLastMessage) {
  FakeNetwork::on_send = {};
  FakeNetwork::rule = [](auto) { return 0; };
  ClientOptions options;
  options.period = 1ms;
  options.duration = 100ms;
  options.timeout = 3s;  // however busy the machine is, the cycles end before
  options.warm_up = 0;
  const auto run = measure(options);
  expect_complete(run, options);
  ASSERT_EQ(run.counters.sent, 1U);
  EXPECT_EQ(run.counters.trailing_due_ns, run.samples[0].due_ns + ms);
  EXPECT_EQ(run.counters.trailing_until_ns, run.samples[0].sent_ns + 3000 * ms);
}

TEST(Fixed, DoesNotWaitForAnAnswerAndCountsFromWhenItWasDue) {
  FakeNetwork::on_send = {};
  FakeNetwork::rule = [](std::uint64_t index) {
    const auto later = FakeNetwork::sends + 2;
    for (int i = 0; index == 5 && i < 5000 && FakeNetwork::sends < later; ++i)
      std::this_thread::sleep_for(1ms);
    return 1;
  };
  ClientOptions options;
  options.schedule = Schedule::fixed;
  options.period = options.deadline = 1ms;
  options.duration = 100ms;
  options.timeout = 10s;
  options.warm_up = 1;
  const auto run = measure(options, {}, [](const Counters& of) { return of.sent > 7; });
  expect_complete(run, options);
  EXPECT_EQ(run.samples.at(5).fate, Fate::late);
  EXPECT_LT(run.samples.at(6).sent_ns, run.samples.at(5).received_ns) << "several in flight";
  for (const auto& sample : run.samples) {
    EXPECT_EQ(sample.fate, sample.received_ns - sample.due_ns > ms ? Fate::late : Fate::on_time);
  }
}

// An answer may come while the thread that sent is still in send(), the more so with a sender that is slow to
// return.
TEST(BackToBack, HasOneCallerOfSendAtATime) {
  // An early one is lost: a busy machine sends few in the time.
  FakeNetwork::rule = [](std::uint64_t index) { return index % 5 == 1 ? 0 : 1; };
  std::atomic<int> sends{0};
  FakeNetwork::on_send = [&] {
    if (++sends % 2 == 0) std::this_thread::sleep_for(100us);
    std::this_thread::yield();
  };
  ClientOptions options;
  options.schedule = Schedule::back_to_back;
  options.duration = 200ms;
  options.timeout = 1ms;
  const auto run =
      measure(options, {}, [](const Counters& of) { return of.lost > 0 && of.on_time + of.late > 0; });
  expect_complete(run, options);
  EXPECT_GT(run.counters.lost, 0U);
  EXPECT_GT(run.counters.on_time + run.counters.late, 0U);
}

}  // namespace
}  // namespace ontime::roundtrip
