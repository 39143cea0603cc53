// SPDX-License-Identifier: Apache-2.0
// Which thread had the CPU that another one waited for.
#include "explain_fixture.hpp"

namespace ontime::explain {
namespace {

class Cpus : public Explained {};

TEST_P(Cpus, AThreadThatIsReadyBesideAnIdleCpuThatLivesIsThrottled) {
  sender_wakes_and_sends();
  event(sent + 10 * us, 0, Kind::waking, answers, asks, "1");
  switched(sent + 15 * us, 1, 0, "R", answers);
  switched(sent + 18 * us, 1, answers, "R", 0);
  event(sent + 10 * ms, 1, Kind::timer, 0);
  event(sent + 10 * ms + us, 1, Kind::timer_end, 0);
  event(sent + 20 * ms - 3 * us, 1, Kind::timer, 0);
  event(sent + 20 * ms - 2 * us, 1, Kind::timer_end, 0);
  switched(sent + 20 * ms, 1, 0, "R", answers);
  switched(sent + 20 * ms + 60 * us, 1, answers, "S", 0);
  EXPECT_EQ(first(message(late(0, 20 * ms, 0))).cause, Cause::throttled);
}

TEST_P(Cpus, ACpuThatShowsNoSignOfLife) {
  switched(sent - ms / 2, 1, hog, "S", 0);
  sender_wakes_and_sends();
  event(sent + 10 * us, 0, Kind::waking, answers, asks, "1");
  switched(sent + 6 * ms, 1, 0, "R", answers);
  switched(sent + 6 * ms + 60 * us, 1, answers, "S", 0);
  EXPECT_EQ(first(message(late(0, 6 * ms, 0))).cause,
            leaving_idle_is_told() ? Cause::idle_cpu : Cause::unknown)
      << "it may as well have run";
}

TEST_P(Cpus, ThreadComingToAnIdleCpuIsAccusedOnlyOnceItRuns) {
  switched(sent - ms / 2, 1, answers, "S", 0);
  sender_wakes_and_sends();
  event(sent + 9 * us, 0, Kind::waking, hog, 0, "1");
  event(sent + 10 * us, 0, Kind::waking, answers, asks, "1");
  switched(sent + 8 * ms - us, 1, 0, "R", hog);  // the CPU was not run until then
  switched(sent + 8 * ms, 1, hog, "S", answers);
  EXPECT_THAT(first(message(late(0, 8 * ms, 0))).cause, testing::AnyOf(Cause::idle_cpu, Cause::unknown));
}

TEST(Scheduling, InferredSwitchIsAfterTheWakeUpAndTheLastIdleEvent) {
  const auto at = [](std::int64_t at_ns, Kind kind, std::int32_t thread, std::int32_t other,
                     const char* what) {
    return Event{
        .at_ns = at_ns, .cpu = 1, .kind = kind, .thread = named(thread), .other = named(other), .what = what};
  };
  const auto all =
      scheduling_of({at(10, Kind::switched, hog, 0, "S"), at(20, Kind::timer, 0, 0, ""),
                     at(21, Kind::waking, answers, 0, "1"), at(22, Kind::timer_end, 0, 0, ""),
                     at(30, Kind::queued, answers, 0, "veth"), at(40, Kind::switched, answers, 0, "S")},
                    0);
  ASSERT_THAT(all, SizeIs(4));
  const auto& came = all[2];
  EXPECT_EQ(came.event.at_ns, 22);
  EXPECT_EQ(came.latest_ns, 30);
  EXPECT_EQ(came.event.thread.id, 0);
  EXPECT_EQ(came.event.other, named(answers));
  EXPECT_EQ(all[3].latest_ns, all[3].event.at_ns) << "what the kernel says is sure";
}

// As many as a window may have, of which each CPU that was idle tells so at the end.
TEST(Scheduling, MostEventsOfAWindowAreInOrderOfTime) {
  constexpr std::int32_t cpus = 8192, wakings = 33'000;
  std::vector<Event> events;
  for (int cpu = 0; cpu < cpus; ++cpu)
    events.push_back(
        {.at_ns = cpu, .cpu = cpu, .kind = Kind::switched, .thread = named(hog), .other = named(0)});
  for (int i = 0; i < wakings; ++i)
    events.push_back({.at_ns = cpus + i, .cpu = cpus, .kind = Kind::waking, .thread = named(hears)});
  for (int cpu = 0; cpu < cpus; ++cpu)
    events.push_back({.at_ns = cpus + wakings, .cpu = cpu, .kind = Kind::queued, .thread = named(answers)});
  const auto all = scheduling_of(events, 0);
  EXPECT_THAT(all, SizeIs(2 * cpus + wakings));
  EXPECT_TRUE(std::is_sorted(all.begin(), all.end(), [](const auto& one, const auto& other) {
    return one.event.at_ns < other.event.at_ns;
  }));
  EXPECT_EQ(all.at(1).event.other.id, answers) << "as soon as it can have been";
}

TEST_P(Cpus, ARealTimeThreadThatWaitsLongForAnOrdinaryOneIsThrottled) {
  sender_wakes_and_sends();
  event(sent + 10 * us, 0, Kind::waking, answers, asks, "1");
  window_.events.back().thread.priority = fifo_80;
  for (int i = 1; i < 13; ++i) {
    event(sent + i * 4 * ms, 1, Kind::timer, hog);
    event(sent + i * 4 * ms + us, 1, Kind::timer_end, hog);
  }
  switched(sent + 50 * ms, 1, hog, "R", answers);
  window_.events.back().other.priority = fifo_80;
  EXPECT_EQ(first(message(late(0, 50 * ms, 0))).cause, Cause::throttled);
}

TEST_P(Cpus, CpuWithoutEventsUnderAnOrdinaryThreadDidNotRun) {
  sender_wakes_and_sends();
  event(sent + 10 * us, 0, Kind::waking, answers, asks, "1");
  window_.events.back().thread.priority = fifo_80;
  event(sent + 4 * ms, 1, Kind::timer, hog);
  event(sent + 4 * ms + us, 1, Kind::timer_end, hog);
  switched(sent + 50 * ms, 1, hog, "R", answers);
  window_.events.back().other.priority = fifo_80;
  EXPECT_EQ(first(message(late(0, 50 * ms, 0))).cause, Cause::idle_cpu);
}

TEST_P(Cpus, PriorityRaisedWhileRunningThrottlesNoThread) {
  switched(due - ms, 1, 0, "R", hog);
  sender_wakes_and_sends();
  event(sent + 10 * us, 0, Kind::waking, answers, asks, "1");
  window_.events.back().thread.priority = fifo_80;
  switched(sent + 50 * ms, 1, hog, "R", answers);
  window_.events.back().thread = {hog, "renamed", fifo_80 - 1};
  window_.events.back().other.priority = fifo_80;
  const auto part = first(message(late(0, 50 * ms, 0)));
  EXPECT_EQ(part.cause, Cause::cpu);
  EXPECT_EQ(part.culprit, "renamed");
  EXPECT_EQ(part.culprit_priority, fifo_80 - 1);
}

TEST_P(Cpus, UntracedSwitchesFromIdleAreALimit) {
  sender_wakes_and_sends();
  for (int i = 1; i <= 11; ++i) {
    switched(sent + i * ms, 1, hog, "S", 0);
    switched(sent + i * ms + ms / 2, 1, 0, "R", hog);
  }
  const auto limits = account(late(0, 20 * ms, 0)).limits;
  if (leaving_idle_is_told())
    EXPECT_THAT(limits, IsEmpty());
  else
    EXPECT_THAT(limits, testing::ElementsAre(HasSubstr("switches of CPU 1")));
}

// What is kept of the time before a window is how each CPU came to what it was at, and no more.
TEST_P(Cpus, CpusIdleBeforeTheWindowGiveNoLimit) {
  for (int i = 20; i > 0; --i) switched(due - ms - i * us, 1, hog, "S", 0);
  sender_wakes_and_sends();
  EXPECT_THAT(account(late(0, 20 * ms, 0)).limits, IsEmpty());
}

// What is kept of the time before a window was kept for one of the two that a switch names.
TEST_P(Cpus, OldSwitchDoesNotNameTheRunningThread) {
  event(due - 900 * ms, 1, Kind::switched, hog, asks, "R");  // hog is ready since; asks slept since then
  event(due - 2 * ms, 1, Kind::switched, answers, hog, "S");
  sender_wakes_and_sends(8 * ms);
  EXPECT_EQ(first(message(late(8 * ms, 0, 0))).cause, Cause::timer);
}

TEST(Scheduling, ThreadThatSleptBeforeTheWindowIsNotInferredToRun) {
  const auto at = [](std::int64_t at_ns, Kind kind, std::int32_t thread, std::int32_t other,
                     const char* what) {
    return Event{
        .at_ns = at_ns, .cpu = 1, .kind = kind, .thread = named(thread), .other = named(other), .what = what};
  };
  const trace::Window window{{1, 1000, 2000},
                             true,
                             {at(10, Kind::switched, hog, 0, "R"), at(20, Kind::waking, hears, answers, "1"),
                              at(900, Kind::switched, asks, 0, "S")}};
  const Timeline timeline(window, 0);
  EXPECT_NE(timeline.state_at(answers, 1500), State::runs) << "who woke another has left since";
  EXPECT_EQ(timeline.state_at(hears, 1500), State::ready);
  EXPECT_EQ(timeline.state_at(hog, 1500), State::ready);
}

TEST_P(Cpus, AThreadThatIsMovedWaitsForTheCpuThatItIsMovedTo) {
  switched(due - 300 * us, 0, 5, "S", 6);
  sender_wakes_and_sends();
  event(sent + 10 * us, 0, Kind::waking, answers, asks, "0");
  event(sent + 11 * us, 0, Kind::moved, answers, asks, "1");
  switched(sent + 20 * ms, 1, hog, "R", answers);
  const auto part = first(message(late(0, 20 * ms, 0)));
  EXPECT_EQ(part.cause, Cause::cpu);
  EXPECT_EQ(part.when.front().cpu, 1);
}

TEST_P(Cpus, AReadyThreadThatTheSchedulerPassesOverForIdlingIsThrottled) {
  sender_wakes_and_sends();
  event(sent + 10 * us, 0, Kind::waking, answers, asks, "1");
  switched(sent + 14 * ms, 1, hog, "S", 0);
  event(sent + 18 * ms, 1, Kind::timer, 0);
  event(sent + 18 * ms + us, 1, Kind::timer_end, 0);
  switched(sent + 20 * ms, 1, 0, "R", answers);
  switched(sent + 20 * ms + 60 * us, 1, answers, "S", 0);
  const auto part = first(message(late(0, 20 * ms, 0)));
  EXPECT_EQ(part.cause, Cause::throttled) << "the thread that had the CPU meanwhile took it from no other";
  EXPECT_GT(part.ns, 17 * ms);
}

TEST_P(Cpus, ARealTimeThreadThatWaitsLongForSeveralOrdinaryOnesIsThrottled) {
  sender_wakes_and_sends();
  event(sent + 10 * us, 0, Kind::waking, answers, asks, "1");
  window_.events.back().thread.priority = fifo_80;
  for (int i = 0; i < 10; ++i) switched(sent + i * 5 * ms + 20 * us, 1, hog + i % 2, "R", hog + (i + 1) % 2);
  switched(sent + 50 * ms, 1, hog, "R", answers);
  window_.events.back().other.priority = fifo_80;
  const auto message = this->message(late(0, 50 * ms, 0));
  EXPECT_EQ(first(message).cause, Cause::throttled);
  EXPECT_GT(first(message).ns, 48 * ms);
}

// As the kernel says it of one that waits all the time.
TEST_P(Cpus, MovedThreadHasThePriorityOfTheMove) {
  event(sent, 1, Kind::moved, answers, 0, "1");
  window_.events.back().thread.priority = fifo_80;
  EXPECT_EQ(Timeline(window_, 0).priority_of(answers), fifo_80);
}

TEST_P(Cpus, ARealTimeThreadThatWaitsForOrdinaryOnesOnTwoCpusIsThrottled) {
  sender_wakes_and_sends();
  event(sent + 10 * us, 0, Kind::waking, answers, asks, "1");
  window_.events.back().thread.priority = fifo_80;
  switched(sent + ms, 0, asks, "S", 6);
  switched(sent + 3 * ms, 1, hog, "R", 7);
  event(sent + 6 * ms, 0, Kind::moved, answers, 6, "0");
  window_.events.back().thread.priority = fifo_80;
  switched(sent + 12 * ms, 0, 6, "R", answers);
  window_.events.back().other.priority = fifo_80;
  switched(sent + 13 * ms, 1, 7, "S", 0);
  const auto message = this->message(late(0, 12 * ms, 0));
  EXPECT_EQ(first(message).cause, Cause::throttled);
  EXPECT_GT(first(message).ns, 11 * ms);
}

INSTANTIATE_TEST_SUITE_P(Kernel, Cpus, testing::Values(true, false), name_of_kernel);

}  // namespace
}  // namespace ontime::explain
