// SPDX-License-Identifier: Apache-2.0
// The sender's walk through the cycles and the ledger behind it, in a world whose time is the test's own:
// random stalls of either end, losses, duplicates, reorderings, and reports that come long after their
// stamps.
#include <array>
#include <limits>
#include <map>
#include <random>
#include <set>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "roundtrip/cycles.hpp"
#include "roundtrip/ledger.hpp"

namespace ontime::roundtrip {
namespace {

constexpr std::int64_t never = std::numeric_limits<std::int64_t>::max();
constexpr std::int64_t us = 1000;

struct Stall {
  std::int64_t begin_ns, end_ns;
  // A thread that would run at that time runs at its end.
  std::int64_t after(std::int64_t at_ns) const {
    return at_ns >= begin_ns && at_ns < end_ns ? end_ns : at_ns;
  }
};

struct Conditions {
  Schedule schedule = Schedule::next_free;
  std::int64_t period_ns = 1000 * us, deadline_ns = 1000 * us, timeout_ns = 20'000 * us;
  std::int64_t first_ns = 10'000 * us, end_ns = 210'000 * us, stop_ns = never;
  bool stop_wakes = true;  // else who stops has said so already, and the sleeper is not woken yet
  Stall sender{0, 0}, peer{0, 0};
  std::int64_t delay_ns = 300 * us, wake_ns = 50 * us, send_ns = 20 * us;  // up to
  double outliers = 0, losses = 0, duplicates = 0, belated = 0;            // shares of the answers
  unsigned seed = 0;
};

struct Run {
  std::vector<Sample> samples;  // by index
  Counters counters;
};

// One run; also what walk() asks of a sender.
class World {
 public:
  explicit World(const Conditions& conditions)
      : c_(conditions),
        random_(conditions.seed),
        ledger_(c_.deadline_ns, c_.timeout_ns, {64, 512},
                c_.schedule == Schedule::fixed ? Ledger::From::due : Ledger::From::sent) {}

  Run run() {
    const auto rest = walk(*this, c_.first_ns, c_.period_ns, c_.end_ns);
    while (!ledger_.idle()) {
      advance(now_ns_ + 1000 * us);
      ledger_.settle(now_ns_);
    }
    ledger_.close(rest);
    Run run{{}, ledger_.counters()};
    std::vector<Sample> drained(ledger_.undrained());
    ledger_.drain(drained);
    for (const auto& sample : drained) {
      if (sample.index == run.samples.size())
        run.samples.push_back(sample);
      else
        run.samples.at(sample.index) = sample;
    }
    return run;
  }

  void sleep_until(std::int64_t due_ns) {
    if (now_ns_ >= due_ns || (c_.stop_wakes && stopped())) return;
    advance((c_.stop_wakes ? std::min(due_ns, c_.stop_ns) : due_ns) + up_to(c_.wake_ns));
  }
  std::int64_t now_ns() const { return now_ns_; }
  std::int64_t stopped_ns() const { return stopped() ? c_.stop_ns : never; }
  bool may_send(std::int64_t at_ns) {
    EXPECT_EQ(at_ns, now_ns_);
    ledger_.settle(at_ns);
    return (c_.schedule == Schedule::fixed || ledger_.idle()) && ledger_.claim();
  }
  void post(const Turn& turn) {
    advance(now_ns_ + up_to(c_.send_ns));
    const auto index = ledger_.post(turn, now_ns_);
    for (int answers = chance(c_.losses) ? 0 : chance(c_.duplicates) ? 2 : 1; answers > 0; --answers) {
      const auto delay_ns = 1 + up_to(chance(c_.outliers) ? 2 * c_.timeout_ns : c_.delay_ns);
      const auto at_ns = c_.peer.after(now_ns_ + delay_ns);
      reports_.insert({at_ns + (chance(c_.belated) ? up_to(2 * c_.timeout_ns) : 0), at_ns, index});
    }
    advance(now_ns_ + up_to(c_.send_ns));
  }

 private:
  struct Report {
    std::int64_t seen_ns, at_ns;
    std::uint64_t index;
    bool operator<(const Report& other) const { return seen_ns < other.seen_ns; }
  };

  bool stopped() const { return now_ns_ >= c_.stop_ns; }
  void advance(std::int64_t to_ns) {
    now_ns_ = c_.sender.after(to_ns);
    for (; !reports_.empty() && reports_.begin()->seen_ns <= now_ns_; reports_.erase(reports_.begin()))
      ledger_.arrived(reports_.begin()->index, reports_.begin()->at_ns, {});
  }
  std::int64_t up_to(std::int64_t ns) { return std::uniform_int_distribution<std::int64_t>(0, ns)(random_); }
  bool chance(double share) { return std::bernoulli_distribution(share)(random_); }

  const Conditions c_;
  std::mt19937 random_;
  Ledger ledger_;
  std::multiset<Report> reports_;
  std::int64_t now_ns_ = 0;
};

// Of each cycle of the duration that was answered for: from when it was due to the answer that ended the
// wait.
std::vector<std::int64_t> responses(const Run& run, std::int64_t period_ns) {
  std::vector<std::int64_t> result, waiting;  // of the latter when they were due
  const auto end_wait = [&](std::int64_t at_ns) {
    for (const auto due_ns : waiting) result.push_back(at_ns - due_ns);
    waiting.clear();
  };
  for (const auto& sample : run.samples) {
    for (auto due_ns = sample.intended_ns; due_ns < sample.due_ns; due_ns += period_ns)
      waiting.push_back(due_ns);
    if (sample.fate == Fate::lost) continue;
    end_wait(sample.received_ns);
    result.push_back(sample.received_ns - sample.due_ns);
  }
  for (std::uint64_t i = 0; i < run.counters.trailing_cycles; ++i)
    waiting.push_back(run.counters.trailing_due_ns + static_cast<std::int64_t>(i) * period_ns);
  end_wait(run.counters.trailing_until_ns);
  return result;
}

std::uint64_t cycles_of(const Conditions& c) {
  const auto end_ns = std::max(c.first_ns, std::min(c.end_ns, c.stop_ns));
  return static_cast<std::uint64_t>((end_ns - c.first_ns + c.period_ns - 1) / c.period_ns);
}

void expect_law(const Run& run, const Conditions& c) {
  const auto& counters = run.counters;
  EXPECT_EQ(counters.sent, run.samples.size());
  EXPECT_EQ(counters.sent, counters.on_time + counters.late + counters.lost);
  EXPECT_EQ(counters.sent + counters.skipped_cycles, cycles_of(c));
  EXPECT_EQ(counters.dropped_records, 0U);
  auto next_ns = c.first_ns;
  std::uint64_t skipped = 0;
  std::array<std::uint64_t, 3> fates{};
  for (std::size_t i = 0; i < run.samples.size(); ++i) {
    const auto& s = run.samples[i];
    ASSERT_EQ(s.index, i);
    ASSERT_EQ(s.intended_ns, next_ns) << "each cycle has an owner";
    ASSERT_EQ(s.due_ns, s.intended_ns + std::int64_t{s.skipped_cycles} * c.period_ns);
    ASSERT_LE(s.due_ns, s.woke_ns);
    ASSERT_LT(s.woke_ns, s.due_ns + c.period_ns) << "never for a cycle that is past";
    ASSERT_LE(s.woke_ns, s.sent_ns);
    ASSERT_EQ(s.passed_wake_ns > 0, s.skipped_cycles > 0) << "wake-ups took some time in this world";
    next_ns = s.due_ns + c.period_ns;
    skipped += s.skipped_cycles;
    ++fates[static_cast<std::size_t>(s.fate)];
    if (s.fate == Fate::lost) continue;
    ASSERT_LE(s.received_ns - s.sent_ns, c.timeout_ns);
    const auto judged_ns = s.received_ns - (c.schedule == Schedule::fixed ? s.due_ns : s.sent_ns);
    ASSERT_EQ(s.fate == Fate::late, judged_ns > c.deadline_ns);
    ASSERT_GE(s.received_ns - s.due_ns, s.received_ns - s.sent_ns) << "response ≥ round trip";
  }
  EXPECT_THAT(fates, testing::ElementsAre(counters.on_time, counters.late, counters.lost));
  EXPECT_EQ(skipped + counters.trailing_cycles, counters.skipped_cycles);
  if (counters.trailing_cycles > 0) {
    EXPECT_EQ(counters.trailing_due_ns, next_ns);
    EXPECT_GT(counters.trailing_until_ns,
              next_ns + static_cast<std::int64_t>(counters.trailing_cycles - 1) * c.period_ns);
  }
  const auto all = responses(run, c.period_ns);
  EXPECT_EQ(all.size() + counters.lost, cycles_of(c)) << "each cycle has its response, or was lost";
  for (const auto response : all) ASSERT_GT(response, 0);
}

Conditions random_conditions(unsigned seed, Schedule schedule) {
  std::mt19937 random(seed);
  const auto up_to = [&](std::int64_t ns) {
    return std::uniform_int_distribution<std::int64_t>(0, ns)(random);
  };
  const auto one_of = [&](auto... values) { return std::array{values...}.at(random() % sizeof...(values)); };
  Conditions c;
  c.schedule = schedule;
  c.seed = seed;
  c.deadline_ns = one_of(300, 1000, 2500) * us;
  c.timeout_ns = one_of(2000, 5000, 20'000) * us;
  c.end_ns = c.first_ns + 20'000 * us + up_to(200'000 * us);
  if (random() % 3 == 0) c.stop_ns = up_to(c.end_ns + 5000 * us);
  c.delay_ns = one_of(100, 900, 1500, 4000) * us;
  c.wake_ns = one_of(50, 900, 3000) * us;
  c.outliers = one_of(0., 0., 0.1);
  c.losses = one_of(0., 0.05, 0.5);
  c.duplicates = one_of(0., 0.2);
  c.belated = one_of(0., 0.2, 1.);
  const auto stall = [&] {
    const auto begin_ns = up_to(c.end_ns + 5000 * us);
    return Stall{begin_ns, begin_ns + up_to(100'000 * us)};
  };
  if (random() % 2 == 0) c.sender = stall();
  if (random() % 2 == 0) c.peer = stall();
  return c;
}

class EitherSchedule : public testing::TestWithParam<Schedule> {};
INSTANTIATE_TEST_SUITE_P(, EitherSchedule, testing::Values(Schedule::next_free, Schedule::fixed),
                         [](const auto& schedule) {
                           return schedule.param == Schedule::fixed ? "fixed" : "nextfree";
                         });

TEST_P(EitherSchedule, AccountsForEveryCycleWhateverHappens) {
  for (unsigned seed = 0; seed < 2000; ++seed) {
    SCOPED_TRACE(seed);
    auto c = random_conditions(seed, GetParam());
    expect_law(World(c).run(), c);
    if (HasFailure()) return;
  }
}

// A stall of s at period p and deadline d cannot be hidden: (s - d)/p - 1 cycles, or more, waited beyond the
// deadline. What was lost waits without end.
TEST_P(EitherSchedule, ShowsAStallInAllTheCyclesThatItTook) {
  for (unsigned seed = 0; seed < 2000; ++seed) {
    SCOPED_TRACE(seed);
    std::mt19937 random(seed);
    Conditions c;
    c.schedule = GetParam();
    c.seed = seed;
    c.deadline_ns = (seed % 2 == 0 ? 1000 : 2500) * us;
    c.losses = seed % 3 == 0 ? 0.1 : 0;
    const auto begin_ns = c.first_ns + static_cast<std::int64_t>(random() % 100'000) * us;
    const Stall stall{begin_ns, begin_ns + static_cast<std::int64_t>(random() % 100'000) * us};
    (seed % 4 < 2 ? c.sender : c.peer) = stall;
    const auto run = World(c).run();
    expect_law(run, c);
    auto beyond = static_cast<std::int64_t>(run.counters.lost);
    for (const auto response : responses(run, c.period_ns)) beyond += response > c.deadline_ns;
    const auto took_ns = stall.end_ns - stall.begin_ns;
    EXPECT_GE(beyond * c.period_ns, took_ns - c.deadline_ns - c.period_ns) << took_ns;
    if (HasFailure()) return;
  }
}

TEST(NextFree, WaitsForTheAnswerAndLeavesTheWakeUpsMeanwhile) {
  Conditions c;
  c.peer = {50'200 * us, 57'300 * us};
  const auto run = World(c).run();
  expect_law(run, c);
  const auto after = std::find_if(run.samples.begin(), run.samples.end(),
                                  [](const auto& sample) { return sample.skipped_cycles > 0; });
  ASSERT_NE(after, run.samples.end());
  EXPECT_GE(after->skipped_cycles, 6U);
  EXPECT_GE(after->woke_ns, c.peer.end_ns) << "never two in flight";
  EXPECT_GT(after->passed_wake_ns, 0);
  EXPECT_LE(after->passed_wake_ns, c.wake_ns) << "the thread was there, each time";
}

TEST(Fixed, SendsInEveryCycleWhateverTheAnswersDo) {
  Conditions c;
  c.schedule = Schedule::fixed;
  c.peer = {50'200 * us, 60'300 * us};
  const auto run = World(c).run();
  expect_law(run, c);
  EXPECT_EQ(run.counters.skipped_cycles, 0U);
  EXPECT_GE(run.counters.late, 9U);
}

TEST(Fixed, SendsOnceAfterAStallOfTheSender) {
  Conditions c;
  c.schedule = Schedule::fixed;
  c.sender = {49'900 * us, 60'300 * us};
  const auto run = World(c).run();
  expect_law(run, c);
  const auto& after = run.samples.at(40);
  EXPECT_EQ(after.intended_ns, 50'000 * us);
  EXPECT_EQ(after.skipped_cycles, 10U);
  EXPECT_EQ(after.due_ns, 60'000 * us) << "the present cycle's, not forty stale ones";
  EXPECT_EQ(after.passed_wake_ns, 10'300 * us) << "how long the wake-up took";
  EXPECT_EQ(run.samples.at(41).skipped_cycles, 0U);
}

TEST(Trailing, AreCountedUntilTheLastAnswer) {
  Conditions c;
  c.timeout_ns = 500'000 * us;
  c.peer = {100'000 * us, 300'000 * us};  // beyond the end
  const auto run = World(c).run();
  expect_law(run, c);
  EXPECT_GE(run.counters.trailing_cycles, 108U);
  EXPECT_EQ(run.counters.trailing_until_ns, c.peer.end_ns);
}

TEST(Trailing, AreCountedUntilTheTimeOutOfTheLast) {
  Conditions c;
  c.timeout_ns = 500'000 * us;
  c.losses = 1;
  const auto run = World(c).run();
  expect_law(run, c);
  EXPECT_EQ(run.counters.sent, 1U);
  EXPECT_EQ(run.counters.trailing_cycles, 199U);
  EXPECT_EQ(run.counters.trailing_until_ns, run.samples.at(0).sent_ns + c.timeout_ns);
}

TEST(Trailing, AreCountedUntilTheSendersReturn) {
  for (const auto schedule : {Schedule::next_free, Schedule::fixed}) {
    Conditions c;
    c.schedule = schedule;
    c.sender = {149'999 * us, 400'000 * us};
    const auto run = World(c).run();
    expect_law(run, c);
    EXPECT_EQ(run.counters.trailing_cycles, 60U);
    EXPECT_EQ(run.counters.trailing_until_ns, c.sender.end_ns);
  }
}

TEST(Stop, StopBetweenFlagAndAlarmSendsNothingMore) {
  for (const auto schedule : {Schedule::next_free, Schedule::fixed})
    for (unsigned seed = 0; seed < 50; ++seed) {
      Conditions c;
      c.schedule = schedule;
      c.seed = seed;
      c.stop_ns = 150'500 * us + seed * us;  // while it sleeps until the next cycle
      c.stop_wakes = false;
      const auto run = World(c).run();
      expect_law(run, c);
      EXPECT_EQ(run.counters.sent, 141U);
      EXPECT_LT(run.samples.back().woke_ns, c.stop_ns);
    }
}

TEST(Trailing, AreThoseDueBeforeAStop) {
  Conditions c;
  c.timeout_ns = 500'000 * us;
  c.peer = {100'000 * us, 300'000 * us};
  c.stop_ns = 150'500 * us;
  const auto run = World(c).run();
  expect_law(run, c);
  EXPECT_EQ(run.counters.sent + run.counters.skipped_cycles, 141U);
  EXPECT_EQ(run.counters.trailing_until_ns, c.peer.end_ns);
}

}  // namespace
}  // namespace ontime::roundtrip
