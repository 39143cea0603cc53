// SPDX-License-Identifier: Apache-2.0
// The ledger, on a clock of the test's own.
#include <algorithm>
#include <array>
#include <atomic>
#include <limits>
#include <map>
#include <random>
#include <set>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "roundtrip/alarm.hpp"
#include "roundtrip/clocks.hpp"
#include "roundtrip/ledger.hpp"

namespace ontime::roundtrip {
namespace {

constexpr std::int64_t ms = 1'000'000;

std::uint64_t send(Ledger& ledger, std::int64_t at_ns) {
  EXPECT_TRUE(ledger.claim());
  return ledger.post({.intended_ns = at_ns, .due_ns = at_ns, .woke_ns = at_ns}, at_ns);
}

std::vector<Sample> drained(Ledger& ledger) {
  std::vector<Sample> samples(ledger.undrained());
  EXPECT_EQ(ledger.drain(samples), samples.size());
  return samples;
}

std::vector<Fate> fates(const std::vector<Sample>& samples) {
  std::vector<Fate> fates;
  fates.reserve(samples.size());
  for (const auto& sample : samples) fates.push_back(sample.fate);
  return fates;
}

TEST(Ledger, JudgesByDeadlineAndTimeOut) {
  Ledger ledger(10 * ms, 500 * ms, {64, 64});
  EXPECT_TRUE(ledger.arrived(send(ledger, 0), 10 * ms, {}));       // exactly at the deadline
  EXPECT_TRUE(ledger.arrived(send(ledger, 0), 10 * ms + 1, {}));   // just beyond
  EXPECT_TRUE(ledger.arrived(send(ledger, 0), 500 * ms, {}));      // exactly at the time-out
  EXPECT_TRUE(ledger.arrived(send(ledger, 0), 500 * ms + 1, {}));  // it came, but too late to count
  send(ledger, 0);                                                 // never answered
  ledger.settle(500 * ms);
  EXPECT_FALSE(ledger.idle()) << "the last may still be answered";
  ledger.settle(500 * ms + 1);
  EXPECT_TRUE(ledger.idle());
  EXPECT_THAT(fates(drained(ledger)),
              testing::ElementsAre(Fate::on_time, Fate::late, Fate::late, Fate::lost, Fate::lost));
  EXPECT_EQ(ledger.counters().strays, 1U) << "the answer after the time-out";
}

TEST(Ledger, JudgesFromWhatItIsToldTo) {
  const auto fate = [](Ledger::From from) {
    Ledger ledger(10 * ms, 500 * ms, {4, 4}, from);
    ledger.claim();
    const Turn turn{.intended_ns = 0, .due_ns = 20 * ms, .woke_ns = 28 * ms, .skipped_cycles = 2};
    ledger.arrived(ledger.post(turn, 29 * ms), 31 * ms, {});  // 2 ms after T1, 11 ms after it was due
    ledger.settle(31 * ms);
    return drained(ledger).at(0).fate;
  };
  EXPECT_EQ(fate(Ledger::From::sent), Fate::on_time);
  EXPECT_EQ(fate(Ledger::From::due), Fate::late);
}

TEST(Ledger, IndexThatWrapsAroundOnTheWireIsMatchedWithItsMessage) {
  constexpr auto first = message::max_index - 2;
  Ledger ledger(10 * ms, 100 * ms, {4, 64}, Ledger::From::sent, first);
  for (std::uint64_t i = 0; i < 6; ++i) {
    const auto index = send(ledger, 0);
    EXPECT_EQ(index, first + i) << "a sample's does not wrap around";
    EXPECT_TRUE(ledger.arrived(message::index_of(message::sequence_of(7, index)), 1 * ms, {}));
    EXPECT_FALSE(ledger.arrived(message::index_of(index), 2 * ms, {}));
    ledger.settle(3 * ms);
  }
  EXPECT_THAT(fates(drained(ledger)), testing::Each(Fate::on_time));
  EXPECT_EQ(ledger.counters().duplicates, 6U);
  EXPECT_EQ(ledger.counters().reordered, 0U);
  EXPECT_EQ(ledger.counters().strays, 0U);
}

TEST(Ledger, CountsWhatIsNoFirstAnswerBeside) {
  Ledger ledger(10 * ms, 100 * ms, {4, 64});
  const auto first = send(ledger, 0);
  const auto second = send(ledger, 0);
  EXPECT_TRUE(ledger.arrived(second, 1 * ms, {}));
  EXPECT_TRUE(ledger.arrived(first, 2 * ms, {}));   // after the answer to a later message
  EXPECT_FALSE(ledger.arrived(first, 3 * ms, {}));  // a duplicate, not yet settled
  ledger.settle(4 * ms);
  EXPECT_FALSE(ledger.arrived(second, 5 * ms, {}));  // a duplicate, settled
  EXPECT_FALSE(ledger.arrived(99, 5 * ms, {}));      // never sent
  const auto third = send(ledger, 0);
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

TEST(Ledger, AnswerFromBeforeItsMessageIsAStray) {
  Ledger ledger(10 * ms, 100 * ms, {4, 4});
  const auto message = send(ledger, 20 * ms);
  EXPECT_FALSE(ledger.arrived(message, 20 * ms - 1, {}));
  ledger.settle(21 * ms);
  EXPECT_FALSE(ledger.idle()) << "it is in flight still";
  EXPECT_TRUE(ledger.arrived(message, 22 * ms, {}));
  ledger.settle(22 * ms);
  EXPECT_THAT(fates(drained(ledger)), testing::ElementsAre(Fate::on_time));
  EXPECT_EQ(ledger.counters().strays, 1U);
}

TEST(Ledger, ServerTimesThatDoNotFitIntoTheRoundTripAreCountedAndLeftOut) {
  constexpr auto most = std::numeric_limits<std::int64_t>::max();
  const auto sample_with = [](message::ServerTimes times, std::uint64_t wrong) {
    Ledger ledger(10 * ms, 100 * ms, {4, 4});
    ledger.arrived(send(ledger, 5), 8, times);
    ledger.settle(8);
    EXPECT_EQ(ledger.counters().wrong_server_times, wrong) << times.received_ns << ' ' << times.sent_ns;
    return drained(ledger).at(0);
  };
  EXPECT_EQ(sample_with({700, 703}, 0).server_sent_ns, 703) << "as long as the round trip, by another clock";
  EXPECT_EQ(sample_with({0, 0}, 0).server_sent_ns, 0) << "the server gave none";
  for (const auto& times : {message::ServerTimes{700, 704}, {700, 699}, {1, most}}) {
    const auto sample = sample_with(times, 1);
    EXPECT_EQ(sample.fate, Fate::on_time);
    EXPECT_EQ(sample.server_received_ns, 0);
    EXPECT_EQ(sample.server_sent_ns, 0);
  }
}

TEST(Clocks, ServerTimesThatDoNotFitIntoTheRoundTripAreNotUsed) {
  const auto sample_with = [](std::int64_t server_received_ns, std::int64_t server_sent_ns) {
    Sample sample{};
    sample.sent_ns = 1000;
    sample.received_ns = 1100;
    sample.server_received_ns = server_received_ns;
    sample.server_sent_ns = server_sent_ns;
    return sample;
  };
  Clocks clocks;
  clocks.add(sample_with(5000, 9000));
  EXPECT_FALSE(clocks.difference_ns());
  clocks.add(sample_with(5040, 5060));
  EXPECT_EQ(clocks.difference_ns(), 4000);
  EXPECT_EQ(clocks.uncertainty_ns(), 40);
}

TEST(WakeUpLatency, CountsFromTheFirstCycleThatWasSleptThrough) {
  constexpr auto due_ms = 40;
  Sample sample{};
  sample.intended_ns = 20 * ms;
  sample.due_ns = due_ms * ms;
  sample.woke_ns = 49 * ms;
  sample.skipped_cycles = 2;
  EXPECT_EQ(wake_up_latency_ns(sample), 9 * ms) << "it was awake, and found the last message unanswered";
  sample.passed_wake_ns = 29 * ms;
  EXPECT_EQ(wake_up_latency_ns(sample), 29 * ms);
}

TEST(Alarm, RealTimeThreadThatSleepsByItHasNoTimerSlack) {
  int ordinary = 0, of_real_time = 0;
  bool permitted = false;
  std::thread([&] {
    wake_as_precisely_as_the_policy_allows();
    ordinary = prctl(PR_GET_TIMERSLACK);
    const sched_param priority{1};
    permitted = sched_setscheduler(0, SCHED_FIFO, &priority) == 0;
    wake_as_precisely_as_the_policy_allows();
    of_real_time = prctl(PR_GET_TIMERSLACK);
  }).join();
  EXPECT_EQ(ordinary, prctl(PR_GET_TIMERSLACK)) << "an ordinary thread sleeps as every program's";
  if (!permitted) GTEST_SKIP() << "this process may not have SCHED_FIFO";
  EXPECT_LE(of_real_time, 1) << "kernels from 6.12 on say 0";
}

TEST(Ledger, KeepsWhatTheServerSaid) {
  Ledger ledger(10 * ms, 100 * ms, {4, 4});
  ledger.claim();
  ledger.arrived(ledger.post({1, 2, 3, 5, 9}, 4), 6, message::ServerTimes{7, 8});
  ledger.settle(10);
  const auto samples = drained(ledger);
  ASSERT_EQ(samples.size(), 1U);
  const auto& sample = samples[0];
  EXPECT_EQ(std::tie(sample.intended_ns, sample.due_ns, sample.woke_ns, sample.sent_ns, sample.received_ns,
                     sample.server_received_ns, sample.server_sent_ns, sample.passed_wake_ns),
            std::make_tuple(1, 2, 3, 4, 6, 7, 8, 9));
  EXPECT_EQ(sample.skipped_cycles, 5U);
  EXPECT_EQ(ledger.counters().skipped_cycles, 5U);
}

TEST(Ledger, CountsWaitingAndDroppedSamples) {
  Ledger ledger(10 * ms, 100 * ms, {4, 3});
  EXPECT_EQ(ledger.capacity(), 3U);
  for (std::size_t i = 0; i < 10; ++i) {
    ledger.arrived(send(ledger, 0), 1, {});
    ledger.settle(1);
    EXPECT_EQ(ledger.undrained(), std::min<std::size_t>(i + 1, 3));
  }
  EXPECT_EQ(ledger.counters().on_time, 10U);
  EXPECT_EQ(drained(ledger).size() + ledger.counters().dropped_records, 10U);
}

// --- an answer that was there in time, but whose thread was kept from saying so ---

TEST(BelatedAnswer, SetsALossRight) {
  Ledger ledger(10 * ms, 100 * ms, {4, 64}, Ledger::From::sent);
  const auto on_time = send(ledger, 0), late = send(ledger, 0), beyond = send(ledger, 0);
  ledger.settle(200 * ms);
  EXPECT_EQ(ledger.counters().lost, 3U);
  EXPECT_FALSE(ledger.arrived(on_time, 10 * ms, message::ServerTimes{3, 4})) << "its chain has gone on";
  EXPECT_FALSE(ledger.arrived(late, 100 * ms, {}));
  EXPECT_FALSE(ledger.arrived(beyond, 100 * ms + 1, {}));
  EXPECT_FALSE(ledger.arrived(late, 101 * ms, {}));
  ledger.settle(200 * ms);
  EXPECT_FALSE(ledger.arrived(late, 102 * ms, {}));
  ledger.settle(201 * ms);

  const auto counters = ledger.counters();
  EXPECT_EQ(counters.on_time, 1U);
  EXPECT_EQ(counters.late, 1U);
  EXPECT_EQ(counters.lost, 1U);
  EXPECT_EQ(counters.strays, 1U) << "beyond the time-out";
  EXPECT_EQ(counters.duplicates, 2U) << "after the answer, before it was taken in and thereafter";
  std::map<std::uint64_t, Sample> last;
  const auto samples = drained(ledger);
  EXPECT_EQ(samples.size(), 5U);
  for (const auto& sample : samples) last[sample.index] = sample;
  EXPECT_EQ(last[on_time].fate, Fate::on_time);
  EXPECT_EQ(last[on_time].received_ns, 10 * ms);
  EXPECT_EQ(last[on_time].server_sent_ns, 4);
  EXPECT_EQ(last[late].fate, Fate::late);
  EXPECT_EQ(last[beyond].fate, Fate::lost);
}

TEST(BelatedAnswer, BeforeTheVerdictIsAnAnswerLikeAnyOther) {
  Ledger ledger(10 * ms, 100 * ms, {4, 64});
  const auto index = send(ledger, 0);
  EXPECT_TRUE(ledger.expire(index, 101 * ms));
  EXPECT_FALSE(ledger.arrived(index, 5 * ms, {})) << "who gave it up owns the ledger";
  ledger.settle(101 * ms);
  EXPECT_TRUE(ledger.idle());
  EXPECT_THAT(fates(drained(ledger)), testing::ElementsAre(Fate::on_time));
  EXPECT_EQ(ledger.counters().lost, 0U);
}

TEST(BelatedAnswer, KeepsItsSlotUntilItIsTakenIn) {
  Ledger ledger(10 * ms, 100 * ms, {4, 64});
  const auto lost = send(ledger, 0);
  ledger.settle(101 * ms);
  for (int i = 0; i < 3; ++i) ledger.arrived(send(ledger, 101 * ms), 102 * ms, {});
  ledger.arrived(lost, 5 * ms, {});
  EXPECT_FALSE(ledger.claim()) << "the next message would have its slot";
  ledger.settle(103 * ms);
  EXPECT_TRUE(ledger.claim());
  EXPECT_EQ(ledger.counters().on_time, 4U);
}

TEST(BelatedAnswer, IsAStrayOnceItsSlotIsUsedAnew) {
  Ledger ledger(10 * ms, 100 * ms, {4, 64});
  const auto lost = send(ledger, 0);
  ledger.settle(101 * ms);
  for (int i = 0; i < 3; ++i) send(ledger, 101 * ms);
  ledger.settle(300 * ms);
  EXPECT_TRUE(ledger.claim());
  EXPECT_FALSE(ledger.arrived(lost, 5 * ms, {})) << "claimed, though nothing is posted yet";
  EXPECT_EQ(ledger.counters().strays, 1U);
  EXPECT_EQ(ledger.counters().lost, 4U);
}

// --- the law: whatever the network does, every message meets exactly one fate, the one its stamps say ---

TEST(Ledger, AddsUpWhateverArrives) {
  for (unsigned seed = 0; seed < 200; ++seed) {
    SCOPED_TRACE(seed);
    std::mt19937 random(seed);
    Ledger ledger(10 * ms, 50 * ms, {256, 1000});
    struct Report {
      std::int64_t seen_ns, at_ns;
      std::uint64_t index;
      bool operator<(const Report& other) const { return seen_ns < other.seen_ns; }
    };
    std::multiset<Report> network;
    std::map<std::uint64_t, std::int64_t> answers;  // those that count, by their stamps
    std::uint64_t reports = 0;
    std::int64_t now = 1 * ms;
    const int messages = 300;
    for (int sent = 0; sent < messages || !ledger.idle() || !network.empty(); now += 1 * ms) {
      for (; !network.empty() && network.begin()->seen_ns <= now; network.erase(network.begin())) {
        const auto report = *network.begin();
        ledger.arrived(report.index, report.at_ns, {});
        ++reports;
      }
      ledger.settle(now);
      const auto c = ledger.counters();
      ASSERT_LE(c.on_time + c.late + c.lost, c.sent);
      if (sent == messages || random() % 3 == 0 || !ledger.claim()) continue;
      const auto index = ledger.post({.intended_ns = now, .due_ns = now, .woke_ns = now}, now);
      ++sent;
      for (auto copies = random() % 3; copies > 0; --copies) {  // lost, once, or twice
        const auto at_ns = now + static_cast<std::int64_t>(random() % 80) * ms;
        const auto held_up = random() % 4 == 0 ? static_cast<std::int64_t>(random() % 60) * ms : 0;
        network.insert({at_ns + held_up, at_ns, index});
      }
      // Of several answers the first that is reported in time counts; there are no more than two.
      std::vector<Report> in_time;
      for (const auto& report : network)
        if (report.index == index && report.at_ns - now <= 50 * ms) in_time.push_back(report);
      if (!in_time.empty()) answers[index] = in_time.front().at_ns;
    }
    const auto c = ledger.counters();
    std::map<std::uint64_t, Sample> last;
    std::uint64_t next = 0, answered = 0;
    for (const auto& sample : drained(ledger)) {
      if (sample.index == next)
        ++next;
      else
        ASSERT_EQ(last.at(sample.index).fate, Fate::lost) << "only losses are set right";
      last[sample.index] = sample;
    }
    ASSERT_EQ(last.size(), static_cast<std::size_t>(messages)) << "in order, none left out";
    std::array<std::uint64_t, 3> by_fate{};
    for (const auto& [index, sample] : last) {
      const auto answer = answers.find(index);
      ASSERT_EQ(sample.received_ns, answer == answers.end() ? 0 : answer->second) << index;
      const auto took = sample.received_ns - sample.sent_ns;
      const auto fate = answer == answers.end() ? Fate::lost : took > 10 * ms ? Fate::late : Fate::on_time;
      ASSERT_EQ(sample.fate, fate) << index;
      answered += fate != Fate::lost;
      ++by_fate[static_cast<std::size_t>(fate)];
    }
    EXPECT_THAT(by_fate, testing::ElementsAre(c.on_time, c.late, c.lost));
    EXPECT_EQ(c.sent, c.on_time + c.late + c.lost);
    EXPECT_EQ(reports, answered + c.duplicates + c.strays) << "every arrival is accounted for";
  }
}

// --- with threads ---

// An owner in a hurry, receivers that are slow to report, and a reader of the counters all the while.
TEST(Ledger, NeverHasMoreFatesThanMessagesWhenAnyThreadStalls) {
  constexpr std::uint64_t messages = 20'000;
  Ledger ledger(2, 8, {16, messages * 2});
  std::atomic<std::int64_t> now{100};
  std::atomic<std::uint64_t> posted{0};
  std::atomic<bool> over{false};
  std::atomic<int> running{0};
  std::vector<std::thread> others;
  for (unsigned seed = 0; seed < 2; ++seed)
    others.emplace_back([&, seed] {
      ++running;
      std::mt19937 random(seed);
      while (!over) {
        const auto count = posted.load();
        if (count == 0) continue;
        const auto index = count - 1 - std::min<std::uint64_t>(random() % 12, count - 1);
        const auto at_ns = now.load() - static_cast<std::int64_t>(random() % 8);
        if (random() % 4 == 0) std::this_thread::yield();
        ledger.arrived(index, at_ns, message::ServerTimes{at_ns, at_ns});
      }
    });
  others.emplace_back([&] {
    while (!over) {
      const auto c = ledger.counters();
      ASSERT_LE(c.on_time + c.late + c.lost, c.sent);
    }
  });
  while (running < 2) std::this_thread::yield();
  while (posted < messages) {
    const auto at_ns = ++now;
    ledger.settle(at_ns);
    if (!ledger.claim()) continue;
    ledger.post({.intended_ns = at_ns, .due_ns = at_ns, .woke_ns = at_ns}, at_ns);
    ++posted;
    if (at_ns % 16 == 0) std::this_thread::yield();
  }
  while (!ledger.idle()) ledger.settle(++now);
  over = true;
  for (auto& thread : others) thread.join();
  ledger.settle(now);

  const auto c = ledger.counters();
  EXPECT_EQ(c.sent, messages);
  EXPECT_EQ(c.on_time + c.late + c.lost, messages);
  EXPECT_EQ(c.dropped_records, 0U);
  std::vector<Sample> last(messages);
  std::uint64_t set_right = 0, next = 0;
  for (const auto& sample : drained(ledger)) {
    sample.index == next ? ++next : ++set_right;
    last.at(sample.index) = sample;
    if (sample.fate != Fate::lost) {
      ASSERT_EQ(sample.server_sent_ns, sample.received_ns) << "of one answer";
    }
  }
  EXPECT_EQ(next, messages);
  EXPECT_GT(set_right, 0U);
  const auto of = [&](Fate fate) {
    return static_cast<std::uint64_t>(
        std::count_if(last.begin(), last.end(), [&](const auto& sample) { return sample.fate == fate; }));
  };
  EXPECT_EQ(of(Fate::on_time), c.on_time);
  EXPECT_EQ(of(Fate::late), c.late);
  EXPECT_EQ(of(Fate::lost), c.lost);
}

// As the sending thread of back-to-back is woken where there is no room for a message.
TEST(Alarm, SleepsAgainAfterReset) {
  constexpr auto never_ns = std::numeric_limits<std::int64_t>::max();
  Alarm alarm;
  alarm.ring();
  alarm.sleep_until(never_ns);
  alarm.reset();
  EXPECT_FALSE(alarm.rung());
  const auto due_ns = transport::now_ns() + ms;
  alarm.sleep_until(due_ns);
  EXPECT_GE(transport::now_ns(), due_ns);
  std::thread ringing([&] { alarm.ring(); });
  alarm.sleep_until(never_ns);
  ringing.join();
  EXPECT_TRUE(alarm.rung());
}

}  // namespace
}  // namespace ontime::roundtrip
