// SPDX-License-Identifier: Apache-2.0
#include "explain_fixture.hpp"

namespace ontime::explain {
namespace {

TEST_P(Explained, AThreadThatWaitsForACpuBehindAnother) {
  sender_wakes_and_sends();
  event(sent + 10 * us, 1, Kind::waking, answers, asks, "1");
  switched(sent + 20 * ms, 1, hog, "R", answers);
  switched(sent + 30 * ms, 1, answers, "S", hog);
  const auto message = this->message(late(0, 20 * ms, 0));
  const auto part = first(message);
  EXPECT_EQ(part.cause, Cause::cpu);
  EXPECT_EQ(part.culprit, "hog");
  EXPECT_THAT(part.culprit_threads, testing::ElementsAre(hog));
  EXPECT_EQ(part.stage, Stage::delivered);
  EXPECT_EQ(part.end, "component");
  EXPECT_EQ(part.thread, "receive");
  EXPECT_EQ(part.ns, 20 * ms - 10 * us);
  EXPECT_EQ(sentence_of(part), "pong's receive thread waited for a CPU while hog ran");
  EXPECT_THAT(remedy_of(part), HasSubstr("realtime: on"));
}

TEST_P(Explained, AThreadThatIsStopped) {
  event(due - 800 * us, 1, Kind::signal, answers, hog, "19");
  switched(due - 700 * us, 1, answers, "T", 0);
  switched(due - 600 * us, 1, hog, "S", 0);
  sender_wakes_and_sends();
  event(sent + 30 * ms, 1, Kind::waking, answers, hog, "1");
  switched(sent + 30 * ms + 5 * us, 1, 0, "R", answers);
  const auto part = first(message(late(0, 30 * ms, 0)));
  EXPECT_EQ(part.cause, Cause::stopped);
  EXPECT_EQ(part.end, "component");
  EXPECT_EQ(part.culprit, "hog");
}

TEST_P(Explained, AThreadThatIsReadyBesideAnIdleCpuThatLivesIsThrottled) {
  sender_wakes_and_sends();
  event(sent + 10 * us, 1, Kind::waking, answers, asks, "1");
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

TEST_P(Explained, ACpuThatShowsNoSignOfLife) {
  switched(sent - ms / 2, 1, hog, "S", 0);
  sender_wakes_and_sends();
  event(sent + 10 * us, 0, Kind::waking, answers, asks, "1");
  switched(sent + 6 * ms, 1, 0, "R", answers);
  switched(sent + 6 * ms + 60 * us, 1, answers, "S", 0);
  EXPECT_EQ(first(message(late(0, 6 * ms, 0))).cause,
            leaving_idle_is_told() ? Cause::idle_cpu : Cause::unknown)
      << "it may as well have run";
}

TEST_P(Explained, AThreadThatRunsOnAnIdleCpuIsBusyFromWhenItIsSeen) {
  switched(sent - ms / 2, 1, hog, "S", 0);
  sender_wakes_and_sends();
  event(sent + 10 * us, 0, Kind::waking, answers, asks, "1");
  switched(sent + 13 * us, 1, 0, "R", answers);
  event(sent + 2 * ms, 1, Kind::timer, answers);
  event(sent + 2 * ms + us, 1, Kind::timer_end, answers);
  switched(sent + 16 * ms, 1, answers, "S", 0);
  const auto part = first(message(late(0, 15 * ms, 0)));
  EXPECT_EQ(part.cause, Cause::busy);
  EXPECT_EQ(part.stage, Stage::delivered);
  EXPECT_GT(part.ns, leaving_idle_is_told() ? 14 * ms : 12 * ms);
}

TEST_P(Explained, WhoComesToAnIdleCpuIsNotAccusedBeforeItIsSeenToRun) {
  switched(sent - ms / 2, 1, answers, "S", 0);
  sender_wakes_and_sends();
  event(sent + 9 * us, 0, Kind::waking, hog, 0, "1");
  event(sent + 10 * us, 0, Kind::waking, answers, asks, "1");
  switched(sent + 8 * ms - us, 1, 0, "R", hog);  // the CPU was not run until then
  switched(sent + 8 * ms, 1, hog, "S", answers);
  EXPECT_THAT(first(message(late(0, 8 * ms, 0))).cause, testing::AnyOf(Cause::idle_cpu, Cause::unknown));
}

TEST(Scheduling, AThreadCameAfterItWasWokenAndTheIdleThreadDidItsLast) {
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
TEST(Scheduling, OfAsManyEventsAsMayBeIsInOrderOfTime) {
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

TEST_P(Explained, ATimerThatCameLate) {
  switched(due - ms / 2, 0, asks, "S", 0);
  sender_wakes_and_sends(3 * ms);
  const auto part = first(message(late(3 * ms, 0, 0)));
  EXPECT_EQ(part.cause, Cause::timer);
  EXPECT_EQ(part.stage, Stage::woke);
  EXPECT_EQ(part.ns, 3 * ms - (leaving_idle_is_told() ? 3 * us : 0))
      << "and for so long it waited for its idle CPU";
}

TEST_P(Explained, APacketThatIsHeldInAQueue) {
  event(due + 5 * us, 0, Kind::waking, asks, 0, "0");
  switched(due + 8 * us, 0, 0, "R", asks);
  event(sent + 5 * us, 0, Kind::queued, asks, 0, "veth", 1);
  event(sent + 15 * ms, 0, Kind::sent, 0, 0, "veth", 1);
  event(sent + 15 * ms + us, 0, Kind::received, 0, 0, "veth", 1);
  const auto part = first(message(late(0, 15 * ms, 0)));
  EXPECT_EQ(part.cause, Cause::queue);
  EXPECT_EQ(part.end, "controller");
  EXPECT_EQ(part.culprit, "veth");
  EXPECT_THAT(remedy_of(part), HasSubstr("tc -s qdisc show dev veth"));
}

TEST_P(Explained, APacketThatIsDropped) {
  sender_wakes_and_sends();
  event(sent + 10 * us, 0, Kind::dropped, asks, 0, "SOCKET_RCVBUFF", 1);
  const auto message = this->message(lost());
  EXPECT_EQ(first(message).cause, Cause::dropped);
  EXPECT_EQ(first(message).end, "component");
  EXPECT_EQ(first(message).culprit, "SOCKET_RCVBUFF");
  EXPECT_THAT(remedy_of(first(message)), HasSubstr("kernel.rmem-max"));
}

TEST_P(Explained, WhatKeptAMessageUntilItsTimeOutLostIt) {
  event(due - 800 * us, 1, Kind::signal, answers, hog, "19");
  switched(due - 700 * us, 1, answers, "T", 0);
  sender_wakes_and_sends();
  event(sent + 60 * ms, 1, Kind::waking, answers, hog, "1");
  switched(sent + 60 * ms + 5 * us, 1, 0, "R", answers);
  timeout_us_ = 50'000;
  const auto part = first(message(lost()));
  EXPECT_EQ(part.cause, Cause::stopped);
  EXPECT_EQ(part.end, "component");
}

TEST_P(Explained, SomebodyElsesPacketThatIsDroppedAccusesNobody) {
  sender_wakes_and_sends();
  event(sent + 10 * us, 0, Kind::dropped, hog, 0, "SOCKET_RCVBUFF", 2);
  EXPECT_EQ(first(message(lost())).cause, Cause::unknown);
}

TEST_P(Explained, WhatHadTheCpuBeforeItWasWantedIsNotAccused) {
  switched(due - ms / 2, 1, hog, "S", 0);
  sender_wakes_and_sends();
  event(sent + 10 * us, 1, Kind::waking, answers, asks, "1");
  switched(sent + 15 * us, 1, 0, "R", answers);
  switched(sent + 25 * us, 1, answers, "S", 0);
  const auto part = first(message(late(0, 0, 20 * ms)));
  EXPECT_EQ(part.cause, Cause::unknown);
  EXPECT_EQ(part.ns, 20 * ms);
}

TEST_P(Explained, ARealTimeThreadThatWaitsLongForAnOrdinaryOneIsThrottled) {
  sender_wakes_and_sends();
  event(sent + 10 * us, 1, Kind::waking, answers, asks, "1");
  window_.events.back().thread.priority = fifo_80;
  switched(sent + 50 * ms, 1, hog, "R", answers);
  window_.events.back().other.priority = fifo_80;
  EXPECT_EQ(first(message(late(0, 50 * ms, 0))).cause, Cause::throttled);
}

TEST_P(Explained, AMessageThatTookAsLongAsUsualAccusesNobody) {
  sender_wakes_and_sends();
  const auto message = this->message(usual(50));
  EXPECT_LT(message.delay_ns, 20 * us);
}

TEST_P(Explained, TheSameCulpritsAreOneGroup) {
  sender_wakes_and_sends();
  event(sent + 10 * us, 1, Kind::waking, answers, asks, "1");
  switched(sent + 20 * ms, 1, hog, "R", answers);
  const auto account = this->account(late(0, 20 * ms, 0));
  EXPECT_EQ(account.late, 1u);
  ASSERT_THAT(account.groups, SizeIs(1));
  EXPECT_EQ(account.groups[0].messages, 1u);
  EXPECT_EQ(account.groups[0].threads, 1u);
  EXPECT_THAT(account.limits, IsEmpty());
}

TEST_P(Explained, WhatCouldNotBeSeenIsSaid) {
  window_.whole = false;
  const auto limits = account(late(0, 20 * ms, 0), {{"controller", {{"missing", {"skb:kfree_skb (that …)"}}}},
                                                    {"component", {{"error", "no root"}}}})
                          .limits;
  EXPECT_THAT(limits, testing::UnorderedElementsAre(HasSubstr("skb:kfree_skb"), HasSubstr("no root"),
                                                    HasSubstr("a part of what the kernel did")));
}

TEST(Explain, OfMoreThreadsThanThereCanBeIsRefused) {
  record::Writer writer("");
  const auto run = writer.begin_run({{"id", "x"}});
  const json thread{{"tid", 1}, {"role", "receive"}};
  writer.trace(run, {"controller", {{0, 0, 1}, true, {}}});
  writer.end_run(run, {{"trace", {{"controller", json::object()}}},
                       {"hosts", {{"component", {{"threads", json(1001, thread)}}}}}});
  const auto reader = writer.reader();
  try {
    account_of(reader, reader.runs().at(0));
    FAIL();
  } catch (const record::WrongFile& error) {
    EXPECT_THAT(error.what(), HasSubstr("run 1 has 1001 threads at its component"));
  }
}

TEST_P(Explained, ARunWithoutTracesIsNotExplained) {
  record::Writer writer("");
  writer.begin_run({});
  const auto reader = writer.reader();
  EXPECT_FALSE(account_of(reader, reader.runs().at(0)).traced);
}

TEST_P(Explained, ThatAKernelDoesNotTellHowACpuLeavesIdleIsSaid) {
  sender_wakes_and_sends();
  for (int i = 1; i <= 11; ++i) {
    switched(sent + i * ms, 1, hog, "S", 0);
    switched(sent + i * ms + ms / 2, 1, 0, "R", hog);
  }
  const auto limits = account(late(0, 20 * ms, 0)).limits;
  if (leaving_idle_is_told())
    EXPECT_THAT(limits, IsEmpty());
  else
    EXPECT_THAT(limits, testing::ElementsAre(HasSubstr("does not tell when CPU 1 leaves idle")));
}

// What is kept of the time before a window is how each CPU came to what it was at, and no more.
TEST_P(Explained, OfCpusThatWereIdleBeforeAllThatNothingIsSaid) {
  for (int i = 20; i > 0; --i) switched(due - ms - i * us, 1, hog, "S", 0);
  sender_wakes_and_sends();
  EXPECT_THAT(account(late(0, 20 * ms, 0)).limits, IsEmpty());
}

TEST_P(Explained, APartSaysWhenItWas) {
  sender_wakes_and_sends();
  event(sent + 10 * us, 1, Kind::waking, answers, asks, "1");
  switched(sent + 20 * ms, 1, hog, "R", answers);
  const auto part = first(message(late(0, 20 * ms, 0)));
  ASSERT_THAT(part.when, SizeIs(1));
  EXPECT_EQ(part.when[0].from_ns, sent + 10 * us);
  EXPECT_EQ(part.when[0].to_ns, sent + 20 * ms);
  EXPECT_EQ(part.when[0].cpu, 1);
  EXPECT_EQ(part.thread_id, answers);
}

TEST_P(Explained, ANumberOfAPacketIsGivenToTheNext) {
  sender_wakes_and_sends();
  event(sent + 20 * us, 0, Kind::queued, asks, 0, "veth", 1);
  event(sent + 21 * us, 0, Kind::dropped, asks, 0, "QDISC_DROP", 1);
  event(sent + 30 * us, 0, Kind::queued, hog, 0, "veth", 1);
  event(sent + 31 * us, 0, Kind::sent, hog, 0, "veth", 1);
  const Timeline timeline(window_, 0);
  const auto packets = packets_of(
      timeline, [](std::int32_t thread) { return thread == asks; }, true, due, due + ms);
  ASSERT_THAT(packets, SizeIs(2));
  EXPECT_EQ(packets[0].received->at_ns, sent + 9 * us);
  EXPECT_EQ(packets[0].dropped, nullptr);
  EXPECT_EQ(packets[1].dropped->what, "QDISC_DROP");
  EXPECT_EQ(packets[1].sent, nullptr);
}

TEST_P(Explained, APacketThatABridgeHandsOnIsOne) {
  event(sent + 5 * us, 0, Kind::queued, asks, 0, "to-components", 1);
  event(sent + 6 * us, 0, Kind::sent, asks, 0, "to-components", 1);
  event(sent + 7 * us, 0, Kind::queued, asks, 0, "to-arm", 1);
  event(sent + 8 * us, 0, Kind::sent, asks, 0, "to-arm", 1);
  event(sent + 9 * us, 0, Kind::dropped, asks, 0, "NETFILTER_DROP", 1);
  const Timeline timeline(window_, 0);
  const auto packets = packets_of(
      timeline, [](std::int32_t thread) { return thread == asks; }, true, due, due + ms);
  ASSERT_THAT(packets, SizeIs(1));
  EXPECT_EQ(packets[0].sent->at_ns, sent + 8 * us);
  ASSERT_NE(packets[0].dropped, nullptr);
  EXPECT_EQ(packets[0].dropped->what, "NETFILTER_DROP");
}

// Of a link whose delay is on the bridge's port, or below a VLAN: who lets the packet go is not who queued
// it.
TEST_P(Explained, APacketThatIsHeldBehindABridgeIsHeldByThatQueue) {
  event(sent + 5 * us, 0, Kind::queued, asks, 0, "to-components", 1);
  event(sent + 6 * us, 0, Kind::sent, asks, 0, "to-components", 1);
  event(sent + 7 * us, 0, Kind::queued, asks, 0, "to-arm", 1);
  event(sent + 15 * ms, 1, Kind::sent, hog, 0, "to-arm", 1);
  event(sent + 15 * ms + 2 * us, 1, Kind::received, hog, 0, "to-component", 1);
  const auto part = first(message(late(0, 15 * ms, 0)));
  EXPECT_EQ(part.cause, Cause::queue);
  EXPECT_EQ(part.stage, Stage::queued);
  EXPECT_EQ(part.end, "controller");
  EXPECT_EQ(part.culprit, "to-arm");
  EXPECT_EQ(part.ns, 15 * ms - 7 * us);
}

TEST_P(Explained, APacketThatTwoQueuesHoldIsHeldByBoth) {
  event(sent + 5 * us, 0, Kind::queued, asks, 0, "to-components", 1);
  event(sent + 5 * ms, 1, Kind::sent, hog, 0, "to-components", 1);
  event(sent + 5 * ms + us, 1, Kind::queued, hog, 0, "to-arm", 1);
  event(sent + 15 * ms, 0, Kind::sent, hears, 0, "to-arm", 1);
  event(sent + 15 * ms + us, 0, Kind::received, hears, 0, "to-component", 1);
  const auto parts = message(late(0, 15 * ms, 0)).parts;
  ASSERT_GE(parts.size(), 2U);
  EXPECT_EQ(parts[0].cause, Cause::queue);
  EXPECT_EQ(parts[0].culprit, "to-arm");
  EXPECT_EQ(parts[0].ns, 10 * ms - us);
  EXPECT_EQ(parts[1].cause, Cause::queue);
  EXPECT_EQ(parts[1].culprit, "to-components");
  EXPECT_EQ(parts[1].ns, 5 * ms - 5 * us);
}

TEST_P(Explained, APacketThatNeverLeavesTheQueueBehindABridgeIsHeldThere) {
  event(sent + 5 * us, 0, Kind::queued, asks, 0, "to-components", 1);
  event(sent + 6 * us, 0, Kind::sent, asks, 0, "to-components", 1);
  event(sent + 7 * us, 0, Kind::queued, asks, 0, "to-arm", 1);
  const auto part = first(message(lost()));
  EXPECT_EQ(part.cause, Cause::queue);
  EXPECT_EQ(part.culprit, "to-arm");
}

TEST_P(Explained, ANumberThatAnotherThreadHasOnAnotherInterfaceIsAnotherPacket) {
  event(sent + 5 * us, 0, Kind::queued, asks, 0, "to-component", 1);
  event(sent + 6 * us, 0, Kind::sent, asks, 0, "to-component", 1);
  event(sent + 50 * us, 1, Kind::queued, hog, 0, "eth0", 1);
  event(sent + 15 * ms, 1, Kind::sent, hog, 0, "eth0", 1);
  const Timeline timeline(window_, 0);
  const auto packets = packets_of(
      timeline, [](std::int32_t thread) { return thread == asks; }, false, due, due + 20 * ms);
  ASSERT_THAT(packets, SizeIs(1));
  EXPECT_EQ(packets[0].sent->at_ns, sent + 6 * us);
}

// What is kept of the time before a window was kept for one of the two that a switch names.
TEST_P(Explained, WhoCameToACpuLongAgoIsNotThereStill) {
  event(due - 900 * ms, 1, Kind::switched, hog, asks, "R");  // hog is ready since; asks slept since then
  event(due - 2 * ms, 1, Kind::switched, answers, hog, "S");
  sender_wakes_and_sends(8 * ms);
  EXPECT_EQ(first(message(late(8 * ms, 0, 0))).cause, Cause::timer);
}

TEST(Scheduling, WhoSleptBeforeTheWindowDidNotComeByWhatAnotherDidThere) {
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

TEST_P(Explained, AThreadThatIsMovedWaitsForTheCpuThatItIsMovedTo) {
  switched(due - 300 * us, 0, 5, "S", 6);
  sender_wakes_and_sends();
  event(sent + 10 * us, 1, Kind::waking, answers, asks, "0");
  event(sent + 11 * us, 1, Kind::moved, answers, asks, "1");
  switched(sent + 20 * ms, 1, hog, "R", answers);
  const auto part = first(message(late(0, 20 * ms, 0)));
  EXPECT_EQ(part.cause, Cause::cpu);
  EXPECT_EQ(part.when.front().cpu, 1);
}

TEST_P(Explained, AReadyThreadThatTheSchedulerPassesOverForIdlingIsThrottled) {
  sender_wakes_and_sends();
  event(sent + 10 * us, 0, Kind::waking, answers, asks, "1");
  switched(sent + 14 * ms, 1, hog, "S", 0);
  event(sent + 18 * ms, 1, Kind::timer, 0);
  event(sent + 18 * ms + us, 1, Kind::timer_end, 0);
  switched(sent + 20 * ms, 1, 0, "R", answers);
  switched(sent + 20 * ms + 60 * us, 1, answers, "S", 0);
  const auto part = first(message(late(0, 20 * ms, 0)));
  EXPECT_EQ(part.cause, Cause::throttled) << "whoever had the CPU meanwhile took it from nobody";
  EXPECT_GT(part.ns, 17 * ms);
}

TEST_P(Explained, AThreadThatCameFirstWasNotTakenFromByWhoWasThereBefore) {
  sender_wakes_and_sends();
  event(sent + 10 * us, 0, Kind::waking, answers, asks, "1");
  switched(sent + 14 * ms, 1, hog, "S", 0);  // and it comes at once
  switched(sent + 14 * ms + 10 * us, 1, 0, "R", answers);
  switched(sent + 14 * ms + 60 * us, 1, answers, "S", 0);
  EXPECT_EQ(first(message(late(0, 14 * ms, 0))).cause, Cause::cpu);
}

TEST_P(Explained, ARealTimeThreadThatWaitsLongForSeveralOrdinaryOnesIsThrottled) {
  sender_wakes_and_sends();
  event(sent + 10 * us, 1, Kind::waking, answers, asks, "1");
  window_.events.back().thread.priority = fifo_80;
  for (int i = 0; i < 10; ++i) switched(sent + i * 5 * ms + 20 * us, 1, hog + i % 2, "R", hog + (i + 1) % 2);
  switched(sent + 50 * ms, 1, hog, "R", answers);
  window_.events.back().other.priority = fifo_80;
  const auto message = this->message(late(0, 50 * ms, 0));
  EXPECT_EQ(first(message).cause, Cause::throttled);
  EXPECT_GT(first(message).ns, 48 * ms);
}

// As the kernel says it of one that waits all the time.
TEST_P(Explained, WhoIsMovedHasThePriorityThatIsSaidThen) {
  event(sent, 1, Kind::moved, answers, 0, "1");
  window_.events.back().thread.priority = fifo_80;
  EXPECT_EQ(Timeline(window_, 0).priority_of(answers), fifo_80);
}

TEST_P(Explained, ARealTimeThreadThatWaitsForOrdinaryOnesOnTwoCpusIsThrottled) {
  sender_wakes_and_sends();
  event(sent + 10 * us, 1, Kind::waking, answers, asks, "1");
  window_.events.back().thread.priority = fifo_80;
  switched(sent + ms, 0, asks, "S", 6);
  event(sent + 6 * ms, 1, Kind::moved, answers, 0, "0");
  window_.events.back().thread.priority = fifo_80;
  switched(sent + 12 * ms, 0, 6, "R", answers);
  window_.events.back().other.priority = fifo_80;
  switched(sent + 13 * ms, 1, hog, "S", 0);
  const auto message = this->message(late(0, 12 * ms, 0));
  EXPECT_EQ(first(message).cause, Cause::throttled);
  EXPECT_GT(first(message).ns, 11 * ms);
}

TEST_P(Explained, AMessageForWhichThereWasNoRoute) {
  event(due + 5 * us, 0, Kind::waking, asks, 0, "0");
  switched(due + 8 * us, 0, 0, "R", asks);
  event(sent + 5 * us, 0, Kind::no_route, asks);
  const auto part = first(message(lost()));
  EXPECT_EQ(part.cause, Cause::unreachable);
  EXPECT_EQ(part.end, "controller");
  EXPECT_EQ(sentence_of(part), "the packet could not be sent at ping's side: no route");
}

TEST_P(Explained, AnAnswerForWhichTheOtherEndWasNotFound) {
  sender_wakes_and_sends();
  event(sent + 20 * us, 1, Kind::no_neighbour, answers);
  const auto part = first(message(lost()));
  EXPECT_EQ(part.cause, Cause::unreachable);
  EXPECT_EQ(part.end, "component");
  EXPECT_EQ(part.culprit, "no neighbour");
}

TEST_P(Explained, AMessageThatWentIsNotAccusedOfSomebodyElsesRoute) {
  sender_wakes_and_sends();
  event(sent + 10 * us, 0, Kind::no_route, asks);
  EXPECT_NE(first(message(lost())).cause, Cause::unreachable);
}

TEST_P(Explained, AMessageWhoseNeighbourAnsweredIsNotUnreachable) {
  event(sent + 5 * us, 0, Kind::no_neighbour, asks);
  event(sent + 300 * us, 0, Kind::queued, hog, 0, "veth", 1);  // whoever ran when the neighbour's answer came
  EXPECT_NE(first(message(lost())).cause, Cause::unreachable);
}

TEST_P(Explained, WhatAnotherThreadOfPingHasNoRouteForIsNotTheMessage) {
  event(sent + 5 * us, 0, Kind::no_route, hears);
  EXPECT_NE(first(message(lost())).cause, Cause::unreachable);
}

TEST_P(Explained, AnAnswerThatHadNoRouteWhenItsThreadRanAtLast) {
  sender_wakes_and_sends();
  event(sent + 10 * us, 1, Kind::waking, answers, asks, "1");
  switched(sent + 5 * ms, 1, hog, "R", answers);
  event(sent + 5 * ms + 20 * us, 1, Kind::no_route, answers);
  const auto part = first(message(lost()));
  EXPECT_EQ(part.cause, Cause::unreachable);
  EXPECT_EQ(part.end, "component");
}

// A run by hand, and what its pong kept: by a clock that shows 7 s more.
class ByHand : public Explained {
 protected:
  static constexpr std::int64_t ahead = 7'000 * ms;

  ByHand() : ping_(""), kept_("") {
    for (auto& sample : samples_) by_its_own_clock(sample);
    window_.span = {50, due - ms + ahead, due + 21 * ms + ahead};
    event(sent + ahead + 10 * us, 1, Kind::waking, answers, 0, "1");
    switched(sent + ahead + 20 * ms, 1, hog, "R", answers);
    run_ = ping_.begin_run({{"id", "ping"}, {"payload_bytes", 500}});
  }
  static void by_its_own_clock(Sample& sample) {
    sample.server_received_ns += ahead;
    sample.server_sent_ns += ahead;
  }
  void keep() { keep({{"component", window_}}); }
  void keep(const std::vector<record::Trace>& windows) {
    const auto run = kept_.begin_run({{"id", "pong"}});
    for (const auto& window : windows) kept_.trace(run, window);
    kept_.end_run(run, {{"trace", {{"component", json::object()}}},
                        {"hosts", {{"component", {{"threads", threads({{answers, "receive"}})}}}}}});
  }
  Account account_with(Sample sample) {
    samples_.insert(samples_.begin() + 50, sample);
    ping_.append(run_, samples_);
    ping_.end_run(run_, {{"hosts", {{"controller", {{"threads", threads({{asks, "send"}})}}}}}});
    const auto reader = ping_.reader();
    const auto run = reader.runs().at(0);
    const Pong pong(kept_.reader(), reader, run);
    return account_of(reader, run, &pong);
  }
  record::Writer ping_, kept_;
  std::int64_t run_ = 0;
};

TEST_P(ByHand, WhatPongKeptExplainsItsPart) {
  keep();
  auto sample = late(0, 20 * ms, 0);
  by_its_own_clock(sample);
  const auto account = account_with(sample);
  ASSERT_THAT(account.messages, SizeIs(1));
  const auto part = first(account.messages[0]);
  EXPECT_EQ(part.cause, Cause::cpu);
  EXPECT_EQ(part.culprit, "hog");
  EXPECT_EQ(part.end, "component");
  EXPECT_THAT(account.limits, testing::UnorderedElementsAre(
                                  HasSubstr("nothing is known of what the controller's machine did"),
                                  HasSubstr("known to within 46.0 us of the controller's")));
}

TEST_P(ByHand, OfWhatAnOutageLostAsManyAreLookedAtAsWithoutPong) {
  window_.span.to_ns = due + 400 * ms + ahead;
  keep();
  samples_.resize(50 + 49);
  for (std::size_t i = 51; i < samples_.size(); ++i) {  // 50 goes before them
    samples_[i].received_ns = samples_[i].server_received_ns = samples_[i].server_sent_ns = 0;
    samples_[i].fate = Fate::lost;
  }
  auto sample = late(0, 20 * ms, 0);
  by_its_own_clock(sample);
  const auto account = account_with(sample);
  EXPECT_THAT(account.messages, SizeIs(1 + 16));
  EXPECT_EQ(account.lost, 48U);
  EXPECT_THAT(account.limits, testing::Contains(HasSubstr("the first 16 of 48 lost")));
}

TEST_P(ByHand, WhatAnotherPongKeptIsRefused) {
  window_.span.from_ns += 60'000 * ms;
  window_.span.to_ns += 60'000 * ms;
  window_.events.clear();
  keep();
  auto sample = late(0, 20 * ms, 0);
  by_its_own_clock(sample);
  EXPECT_THROW(account_with(sample), record::WrongFile);
}

// One of two days may have been another's.
TEST_P(ByHand, WhatFitsOnceAndContradictsOnceIsAnothers) {
  auto later = window_;
  later.span.message = 70;
  keep({{"component", window_}, {"component", later}});
  auto sample = late(0, 20 * ms, 0);
  by_its_own_clock(sample);
  EXPECT_THROW(account_with(sample), record::WrongFile);
}

TEST_P(ByHand, AWindowThatIsCutOffContradictsNothing) {
  auto cut_off = window_;
  cut_off.whole = false;
  cut_off.span = {70, due + 195 * ms + ahead, due + 196 * ms + ahead};
  cut_off.events.clear();
  keep({{"component", window_}, {"component", cut_off}});
  auto sample = late(0, 20 * ms, 0);
  by_its_own_clock(sample);
  EXPECT_NO_THROW(account_with(sample));
}

TEST_P(ByHand, WhatACoordinatorsMachineDidIsNotPongs) {
  keep({{"controller", window_}});
  auto sample = late(0, 20 * ms, 0);
  by_its_own_clock(sample);
  EXPECT_THROW(account_with(sample), record::WrongFile);
}

TEST_P(ByHand, OfMessagesThatWereOnTimeNothingNeedBeKnown) {
  auto of_next = window_;
  of_next.span.message = 51;
  keep({{"component", window_}, {"component", of_next}});
  ping_.trace(run_, {"controller", {{50, due - ms, due + 21 * ms}, true, {}}});
  auto sample = late(0, 20 * ms, 0);
  by_its_own_clock(sample);
  EXPECT_THAT(account_with(sample).limits, testing::Each(testing::Not(HasSubstr("nothing is known"))));
}

TEST_P(ByHand, OfALateMessageThatPongDidNotKeepNobodyIsToldToDoWhatWasDone) {
  window_.span.message = 51;
  keep();
  ping_.trace(run_, {"controller", {{50, due - ms, due + 21 * ms}, true, {}}});
  auto sample = late(0, 20 * ms, 0);
  by_its_own_clock(sample);
  const auto limits = account_with(sample).limits;
  EXPECT_THAT(limits, testing::Contains(testing::AllOf(
                          HasSubstr("of 1 of the 1 late and lost messages that were looked at nothing is "
                                    "known of what the component's"),
                          testing::Not(HasSubstr("ontime pong")))));
}

// The second half of the run is an hour later, and the server's clock went 20 ppm faster.
class Drifting : public ByHand {
 protected:
  static constexpr std::int64_t hour = 3'600'000 * ms, drift = 72 * ms;
  Drifting() {
    for (auto& sample : samples_)
      if (sample.index >= 40) an_hour_later(sample);
    window_.span.from_ns += hour + drift;
    window_.span.to_ns += hour + drift;
    for (auto& event : window_.events) event.at_ns += hour + drift;
  }
  static void an_hour_later(Sample& sample) {
    for (auto* at : {&sample.intended_ns, &sample.due_ns, &sample.woke_ns, &sample.sent_ns}) *at += hour;
    for (auto* at : {&sample.received_ns, &sample.server_received_ns, &sample.server_sent_ns})
      if (*at != 0) *at += hour;
    for (auto* at : {&sample.server_received_ns, &sample.server_sent_ns})
      if (*at != 0) *at += drift;
  }
};

TEST_P(Drifting, AMessageIsRelatedByTheAnswersAroundIt) {
  keep();
  auto sample = late(0, 20 * ms, 0);
  by_its_own_clock(sample);
  an_hour_later(sample);
  const auto account = account_with(sample);
  ASSERT_THAT(account.messages, SizeIs(1));
  const auto part = first(account.messages[0]);
  EXPECT_EQ(part.cause, Cause::cpu);
  EXPECT_NEAR(static_cast<double>(part.ns), 20e6, 0.2e6);
  EXPECT_NEAR(static_cast<double>(account.messages[0].delay_ns), 20e6, 0.2e6);
  EXPECT_THAT(account.limits, testing::Contains(HasSubstr("known to within 46.0 us")));
}

TEST_P(Drifting, AMessageThatNeverCameIsLookedForAmongItsNeighbours) {
  window_.span.message = 51;
  keep();
  auto sample = lost();
  an_hour_later(sample);
  const auto account = account_with(sample);
  EXPECT_THAT(account.messages, SizeIs(2)) << "the lost one, and the one of that window";
}

// Where nothing was answered for an hour, the clocks are known as well as they may have drifted since.
TEST_P(Drifting, WhatNoAnswerSaysIsNotKnownWell) {
  std::erase_if(samples_, [](const Sample& sample) { return sample.index > 51; });
  std::erase_if(samples_, [](const Sample& sample) { return sample.index >= 40 && sample.index < 50; });
  record::Writer writer("");
  const auto run = writer.begin_run({{"id", "x"}});
  writer.append(run, samples_);
  writer.end_run(run, json::object());
  const Drift drifts(writer.reader(), run);
  EXPECT_EQ(drifts.at(samples_.front().sent_ns).uncertainty_ns, 45 * us);
  EXPECT_EQ(drifts.at(0).difference_ns, ahead + 5 * us);
  const auto between = drifts.at(hour / 2);
  EXPECT_GT(between.uncertainty_ns, 170 * ms);
  EXPECT_GE(between.uncertainty_ns, std::abs(between.difference_ns - ahead - drift / 2));
  EXPECT_EQ(drifts.at(samples_.back().sent_ns).difference_ns, ahead + drift + 5 * us);
}

INSTANTIATE_TEST_SUITE_P(Kernel, Drifting, testing::Values(true, false), [](const auto& told) {
  return told.param ? "TellsLeavingIdle" : "DoesNotTellLeavingIdle";
});

INSTANTIATE_TEST_SUITE_P(Kernel, ByHand, testing::Values(true, false), [](const auto& told) {
  return told.param ? "TellsLeavingIdle" : "DoesNotTellLeavingIdle";
});

INSTANTIATE_TEST_SUITE_P(Kernel, Explained, testing::Values(true, false), [](const auto& told) {
  return told.param ? "TellsLeavingIdle" : "DoesNotTellLeavingIdle";
});

}  // namespace
}  // namespace ontime::explain
