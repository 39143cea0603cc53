// SPDX-License-Identifier: Apache-2.0
// What an event proves, and what it does not: no thread is accused without evidence.
#include "explain_fixture.hpp"

namespace ontime::explain {
namespace {

class Evidence : public Explained {
 protected:
  // The tick of a CPU that another thread has.
  void ticks(std::int64_t period) {
    for (auto at = due; at < due + 100 * ms; at += period) {
      event(at, 2, Kind::timer, another);
      event(at + us, 2, Kind::timer_end, another);
    }
    in_order();
  }
  // The hog has the CPU of pong's real-time thread for so long after that thread is woken.
  void waits_with_priority_behind_the_hog(std::int64_t ns) {
    switched(due - ms / 2, 1, 0, "R", hog);
    event(due - ms / 3, 1, Kind::timer, hog);
    event(due - ms / 3 + us, 1, Kind::timer_end, hog);
    sender_wakes_and_sends();
    event(sent + 10 * us, 0, Kind::waking, answers, asks, "1");
    window_.events.back().thread.priority = fifo_80;
    switched(sent + ns, 1, hog, "R", answers);
    window_.events.back().other.priority = fifo_80;
  }
  // The message is on pong's machine, whose thread sleeps in it from `sent + 30 us` on until `until`.
  void sleeps_with_the_message(std::int64_t until, std::int32_t waker) {
    has_the_message();
    switched(sent + 30 * us, 1, answers, "S", 0);
    event(until, 2, Kind::waking, answers, waker, "1");
    switched(until + 2 * us, 1, 0, "R", answers);
    switched(until + 60 * us, 1, answers, "S", 0);
  }
  // The message is taken in by a softirq that wakes its reader, and then loses its CPU to a thread.
  void preempted_in_its_softirq(std::int64_t at, std::int32_t by) {
    switched(due - ms / 2, 1, hog, "S", softirqs);
    sender_wakes_and_sends();
    event(sent + 10 * us, 1, Kind::soft_interrupt, softirqs, 0, "NET_RX");
    event(sent + 15 * us, 1, Kind::waking, hog, softirqs, "1");
    event(sent + 20 * us, 1, Kind::waking, answers, softirqs, "1");
    switched(at, 1, softirqs, "R", by);
  }
  void ends_its_softirq(std::int64_t at, std::int32_t after) {
    if (after != softirqs) switched(at - us, 1, after, "S", softirqs);
    event(at, 1, Kind::soft_interrupt_end, softirqs, 0, "NET_RX");
    switched(at + us, 1, softirqs, "S", after == softirqs ? answers : 0);
  }
  static std::string word(const Part& part) { return word_of(part.cause); }
  static constexpr std::int32_t another = 6, softirqs = 7;
};

TEST_P(Evidence, TimeInTheSendCallIsTheSendThreads) {
  switched(due - ms / 2, 1, hog, "S", 0);
  sender_wakes();
  event(sent + us, 0, Kind::timer, asks);
  event(sent + 2 * us, 0, Kind::timer_end, asks);
  for (const auto& [after, kind] :
       {std::pair(5 * us, Kind::queued), {6 * us, Kind::sent}, {9 * us, Kind::received}})
    event(sent + 6 * ms + after, 0, kind, asks, 0, "to-component", 1);
  event(sent + 6 * ms + 10 * us, 0, Kind::waking, answers, asks, "1");
  switched(sent + 6 * ms + 12 * us, 1, 0, "R", answers);
  event(sent + 6 * ms + 15 * us, 1, Kind::timer, answers);
  event(sent + 6 * ms + 16 * us, 1, Kind::timer_end, answers);
  switched(sent + 6 * ms + 60 * us, 1, answers, "S", 0);
  const auto part = first(message(late(0, 6 * ms, 0)));
  EXPECT_EQ(word(part), "busy");
  EXPECT_EQ(part.end, "controller");
  EXPECT_EQ(part.thread, "send");
  EXPECT_EQ(part.stage, Stage::left);
  EXPECT_GT(part.ns, 5 * ms);
}

TEST_P(Evidence, TimeInTheSoftirqThatTakesAPacketInIsItsOwn) {
  switched(due - ms / 2, 1, hog, "S", 0);
  sender_wakes_and_queues();
  event(sent + 7 * us, 0, Kind::soft_interrupt, asks, 0, "NET_RX");
  event(sent + 9 * us, 0, Kind::received, asks, 0, "to-controller", 1);
  event(sent + 6 * ms, 0, Kind::waking, answers, asks, "1");
  event(sent + 6 * ms + us, 0, Kind::soft_interrupt_end, asks, 0, "NET_RX");
  switched(sent + 6 * ms + 2 * us, 1, 0, "R", answers);
  switched(sent + 6 * ms + 60 * us, 1, answers, "S", 0);
  const auto part = first(message(late(0, 6 * ms, 0)));
  EXPECT_EQ(word(part), "busy");
  EXPECT_EQ(part.thread, "NET_RX");
  EXPECT_EQ(part.stage, Stage::travelled);
  EXPECT_EQ(part.end, "component");
  EXPECT_GT(part.ns, 5 * ms);
}

// A thread of a PREEMPT_RT kernel may lose its CPU inside a softirq.
TEST_P(Evidence, APreemptedSoftirqTakesNoCpu) {
  preempted_in_its_softirq(sent + 22 * us, answers);
  event(sent + 20 * ms, 1, Kind::queued, answers, 0, "to-controller", 2);
  event(sent + 20 * ms + us, 1, Kind::sent, answers, 0, "to-controller", 2);
  ends_its_softirq(sent + 20 * ms + 60 * us, answers);
  auto sample = late(0, 0, 20 * ms);  // the reader computed before it answered
  sample.server_sent_ns += 20 * ms;
  const auto part = first(message(sample));
  EXPECT_EQ(word(part), "busy");
  EXPECT_EQ(part.thread, "receive");
  EXPECT_EQ(part.stage, Stage::answered);
}

TEST_P(Evidence, AThreadThatPreemptedASoftirqIsNamedInsteadOfIt) {
  preempted_in_its_softirq(sent + 22 * us, hog);
  for (auto at = 4 * ms; at < 20 * ms; at += 4 * ms) {
    event(sent + at, 1, Kind::timer, hog);
    event(sent + at + us, 1, Kind::timer_end, hog);
  }
  switched(sent + 20 * ms, 1, hog, "S", answers);
  ends_its_softirq(sent + 20 * ms + 60 * us, answers);
  const auto part = first(message(late(0, 20 * ms, 0)));
  EXPECT_EQ(word(part), "cpu");
  EXPECT_EQ(part.culprit, "hog");
}

TEST_P(Evidence, ASoftirqThatIsPreemptedBeforeItWakesTheReaderWaits) {
  switched(due - ms / 2, 1, hog, "S", softirqs);
  window_.events.back().other.name = "ksoftirqd/1";
  sender_wakes_and_queues();
  event(sent + 8 * us, 1, Kind::soft_interrupt, softirqs, 0, "NET_RX");
  event(sent + 9 * us, 1, Kind::received, softirqs, 0, "to-controller", 1);
  switched(sent + 12 * us, 1, softirqs, "R", hog);
  switched(sent + 20 * ms, 1, hog, "S", softirqs);
  event(sent + 20 * ms + 5 * us, 1, Kind::waking, answers, softirqs, "1");
  ends_its_softirq(sent + 20 * ms + 10 * us, softirqs);
  const auto part = first(message(late(0, 20 * ms, 0)));
  EXPECT_EQ(word(part), "cpu");
  EXPECT_EQ(part.thread, "ksoftirqd/1");
  EXPECT_EQ(part.culprit, "hog");
}

TEST_P(Evidence, ASoftirqGoesOnWhenItsThreadReturns) {
  preempted_in_its_softirq(sent + 22 * us, hog);
  switched(sent + 40 * us, 1, hog, "S", softirqs);
  ends_its_softirq(sent + 20 * ms, softirqs);
  const auto part = first(message(late(0, 20 * ms, 0)));
  EXPECT_EQ(word(part), "interrupts");
  EXPECT_EQ(part.culprit, "NET_RX");
  EXPECT_NEAR(static_cast<double>(part.ns), 20e6, 0.1e6);
}

TEST_P(Evidence, PendingInterruptsOfAnIdleCpuThatWakesAreNoThrottling) {
  switched(sent - ms / 2, 1, hog, "S", 0);
  sender_wakes_and_sends();
  event(sent + 10 * us, 0, Kind::waking, answers, asks, "1");
  event(sent + 6 * ms - 60 * us, 1, Kind::timer, 0);
  event(sent + 6 * ms - 50 * us, 1, Kind::timer_end, 0);
  switched(sent + 6 * ms, 1, 0, "R", answers);
  switched(sent + 6 * ms + 60 * us, 1, answers, "S", 0);
  EXPECT_EQ(word(first(message(late(0, 6 * ms, 0)))), "idle-cpu");
}

TEST_P(Evidence, ACpuThatIdlesInsteadOfAReadyThreadThrottles) {
  switched(sent - ms / 2, 1, hog, "R", 0);
  sender_wakes_and_sends();
  event(sent + 10 * us, 0, Kind::waking, answers, asks, "1");
  event(sent + 6 * ms - 60 * us, 1, Kind::timer, 0);
  event(sent + 6 * ms - 50 * us, 1, Kind::timer_end, 0);
  switched(sent + 6 * ms, 1, 0, "R", answers);
  switched(sent + 6 * ms + 60 * us, 1, answers, "S", 0);
  EXPECT_EQ(word(first(message(late(0, 6 * ms, 0)))), "throttled");
}

TEST_P(Evidence, SilenceLongerThanTheTickIsNoThrottling) {
  waits_with_priority_behind_the_hog(10 * ms + 500 * us);
  ticks(4 * ms);
  EXPECT_EQ(word(first(message(late(0, 10 * ms, 0)))), "idle-cpu");
}

TEST_P(Evidence, APauseShorterThanTheTickAccusesNoThreadOfLowerPriority) {
  waits_with_priority_behind_the_hog(6 * ms);
  const auto part = first(message(late(0, 6 * ms, 0)));
  EXPECT_EQ(word(part), "not-preempted");
  EXPECT_EQ(part.culprit, "");
  EXPECT_THAT(advice(part), testing::Not(HasSubstr("priority above")));
}

TEST_P(Evidence, ThreadOfLowerPriorityThatRanOnIsNamed) {
  waits_with_priority_behind_the_hog(6 * ms);
  for (const auto at : {2 * ms, 4 * ms}) {
    event(sent + at, 1, Kind::timer, hog);
    event(sent + at + us, 1, Kind::timer_end, hog);
  }
  in_order();
  const auto part = first(message(late(0, 6 * ms, 0)));
  EXPECT_EQ(word(part), "not-preempted");
  EXPECT_EQ(part.culprit, "hog");
}

TEST_P(Evidence, AKernelThatIsNotPreemptibleThrottlesNoThread) {
  waits_with_priority_behind_the_hog(12 * ms);
  for (auto at = ms; at < 12 * ms; at += 4 * ms) {
    event(sent + at, 1, Kind::timer, hog);
    event(sent + at + us, 1, Kind::timer_end, hog);
  }
  in_order();
  EXPECT_EQ(word(first(message(late(0, 12 * ms, 0)))), "not-preempted");
}

TEST_P(Evidence, OrdinaryThreadInsteadOfARealTimeOneIsThrottling) {
  switched(due - ms / 2, 1, another, "R", hog);  // which is as ready as it was
  window_.events.back().thread.priority = fifo_80 + 70;
  sender_wakes_and_sends();
  event(sent + 10 * us, 0, Kind::waking, answers, asks, "1");
  window_.events.back().thread.priority = fifo_80;
  switched(sent + 8 * ms, 1, hog, "R", answers);
  window_.events.back().other.priority = fifo_80;
  EXPECT_EQ(word(first(message(late(0, 8 * ms, 0)))), "throttled");
}

TEST_P(Evidence, TimerInterruptHasNoRemedy) {
  const Part part{
      .cause = Cause::interrupts, .end = "component", .thread = "receive", .culprit = "timer interrupt"};
  EXPECT_THAT(advice(part), testing::Not(HasSubstr("kernel.irq-cpus:")));
  EXPECT_THAT(advice(part), HasSubstr("no setting"));
}

TEST_P(Evidence, EventOfAnotherThreadInfersASwitch) {
  switched(due - ms / 2, 1, 0, "R", hog);
  event(due - ms / 3, 1, Kind::timer, hog);
  event(due - ms / 3 + us, 1, Kind::timer_end, hog);
  sender_wakes_and_sends();
  event(sent + 10 * us, 0, Kind::waking, answers, asks, "1");
  event(sent + 100 * us, 1, Kind::timer, another);  // the switch to it was not traced
  event(sent + 101 * us, 1, Kind::timer_end, another);
  switched(sent + 20 * ms, 1, another, "R", answers);
  const auto part = first(message(late(0, 20 * ms, 0)));
  EXPECT_EQ(word(part), "cpu");
  EXPECT_EQ(part.culprit, "another");
}

TEST_P(Evidence, ThreadThatLeftWithoutAnEventIsNotAccused) {
  switched(due - ms / 2, 1, 0, "R", hog);
  event(due - ms / 3, 1, Kind::timer, hog);
  event(due - ms / 3 + us, 1, Kind::timer_end, hog);
  sender_wakes_and_sends();
  event(sent + 10 * us, 0, Kind::waking, answers, asks, "1");
  switched(sent + 20 * ms, 1, another, "R", answers);  // when it came is not known
  EXPECT_EQ(word(first(message(late(0, 20 * ms, 0)))), "unknown");
}

TEST_P(Evidence, ASenderThatAnotherThreadWokeHadNoLateTimer) {
  switched(due - ms / 2, 0, asks, "S", 0);
  event(due + 30 * ms, 1, Kind::waking, asks, hog, "0");
  switched(due + 30 * ms + 3 * us, 0, 0, "R", asks);
  ticks(4 * ms);  // of interrupts of timers, the kernel tells
  const auto part = first(message(late(30 * ms, 0, 0)));
  EXPECT_EQ(word(part), "waited");
  EXPECT_EQ(part.culprit, "hog");
}

TEST_P(Evidence, AThreadInTheRefrigeratorIsFrozen) {
  has_the_message();
  switched(sent + 30 * us, 1, answers, "D", 0);
  event(sent + 31 * us, 1, Kind::waits, answers, 0,
        "schedule __refrigerator get_signal arch_do_signal_or_restart");
  event(sent + 15 * ms, 2, Kind::waking, answers, hog, "1");
  switched(sent + 15 * ms + 2 * us, 1, 0, "R", answers);
  switched(sent + 15 * ms + 60 * us, 1, answers, "S", 0);
  const auto part = first(message(late(0, 15 * ms, 0)));
  EXPECT_EQ(word(part), "frozen");
  EXPECT_EQ(part.culprit, "hog");
  EXPECT_THAT(advice(part), testing::Not(HasSubstr("lock-memory")));
}

TEST_P(Evidence, AThreadOfAControlGroupThatIsThawedWasFrozen) {
  has_the_message();
  switched(sent + 30 * us, 1, answers, "S", 0);
  event(sent + 15 * ms - 5 * us, 2, Kind::thaw, hog, 0, "/robot");
  event(sent + 15 * ms, 2, Kind::waking, answers, hog, "1");
  switched(sent + 15 * ms + 2 * us, 1, 0, "R", answers);
  switched(sent + 15 * ms + 60 * us, 1, answers, "S", 0);
  const auto part = first(message(late(0, 15 * ms, 0)));
  EXPECT_EQ(word(part), "frozen");
  EXPECT_EQ(part.culprit, "hog");
}

TEST_P(Evidence, AThreadThatFreesMemoryItselfIsNotBusy) {
  has_the_message();
  event(sent + 30 * us, 1, Kind::reclaim, answers);
  event(sent + 14 * ms, 1, Kind::reclaim_end, answers);
  switched(sent + 15 * ms + 60 * us, 1, answers, "S", 0);
  const auto part = first(message(late(0, 15 * ms, 0)));
  EXPECT_EQ(word(part), "page-fault");
  EXPECT_GT(part.ns, 13 * ms);
}

TEST_P(Evidence, AnInterruptWhileAThreadFreesMemoryCountsOnce) {
  has_the_message();
  event(sent + 30 * us, 1, Kind::reclaim, answers);
  event(sent + 3 * ms, 1, Kind::interrupt, answers, 0, "eth1");
  event(sent + 6 * ms, 1, Kind::interrupt_end, answers);
  event(sent + 14 * ms, 1, Kind::reclaim_end, answers);
  switched(sent + 15 * ms + 60 * us, 1, answers, "S", 0);
  const auto of = message(late(0, 15 * ms, 0));
  std::int64_t sum_ns = 0, interrupts_ns = 0;
  for (const auto& part : of.parts) {
    sum_ns += part.ns;
    if (part.cause == Cause::interrupts) interrupts_ns += part.ns;
  }
  EXPECT_LE(std::abs(interrupts_ns - 3 * ms), 5 * us);  // and the one that brought the message
  EXPECT_EQ(sum_ns, of.delay_ns);
  EXPECT_LE(of.delay_ns, of.sample.received_ns - of.sample.due_ns);
}

TEST_P(Evidence, AWaitInTheKernelForSomethingElseHasNoRemedyOfMemory) {
  EXPECT_EQ(advice({.cause = Cause::blocked, .thread = "receive"}), "");
}

TEST_P(Evidence, ATracedThreadNamesItsTracer) {
  has_the_message();
  switched(sent + 30 * us, 1, answers, "t", 0);
  event(sent + 15 * ms, 2, Kind::waking, answers, hog, "1");
  switched(sent + 15 * ms + 2 * us, 1, 0, "R", answers);
  switched(sent + 15 * ms + 60 * us, 1, answers, "S", 0);
  const auto part = first(message(late(0, 15 * ms, 0)));
  EXPECT_EQ(word(part), "traced");
  EXPECT_EQ(part.culprit, "hog");
}

TEST_P(Evidence, AHolderThatWaitedForACpuIsNotTheCulprit) {
  switched(due - ms / 2, 2, hog, "R", another);
  has_the_message();
  switched(sent + 30 * us, 1, answers, "S", 0);
  switched(sent + 40 * us, 2, another, "R", hog);
  switched(sent + 14 * ms, 2, hog, "S", another);
  event(sent + 15 * ms, 2, Kind::waking, answers, another, "1");
  switched(sent + 15 * ms + 2 * us, 1, 0, "R", answers);
  switched(sent + 15 * ms + 60 * us, 1, answers, "S", 0);
  const auto part = first(message(late(0, 15 * ms, 0)));
  EXPECT_EQ(word(part), "cpu");
  EXPECT_EQ(part.culprit, "hog");
  EXPECT_EQ(part.thread, "receive");
  EXPECT_THAT(sentence_of(part), HasSubstr("another"));
  EXPECT_NEAR(static_cast<double>(part.ns), 14e6, 0.2e6);
}

TEST_P(Evidence, AHolderThatRanIsTheCulprit) {
  switched(due - ms / 2, 2, hog, "R", another);
  sleeps_with_the_message(sent + 15 * ms, another);
  const auto part = first(message(late(0, 15 * ms, 0)));
  EXPECT_EQ(word(part), "waited");
  EXPECT_EQ(part.culprit, "another");
}

// As with NFQUEUE, or until a background topic's address is known.
TEST_P(Evidence, APacketThatAnotherThreadQueuedIsUnknownAtTheSendersEnd) {
  sender_wakes();
  switched(sent + 10 * us, 0, asks, "S", another);
  for (const auto kind : {Kind::queued, Kind::sent})
    event(sent + 15 * ms, 0, kind, another, 0, "to-component", 1);
  event(sent + 15 * ms + us, 0, Kind::received, another, 0, "to-controller", 1);
  event(sent + 15 * ms + 2 * us, 0, Kind::waking, answers, another, "1");
  switched(sent + 15 * ms + 5 * us, 1, 0, "R", answers);
  const auto part = first(message(late(0, 15 * ms, 0)));
  EXPECT_EQ(word(part), "unknown");
  EXPECT_EQ(part.end, "controller");
  EXPECT_EQ(part.stage, Stage::left);
  EXPECT_THAT(sentence_of(part), HasSubstr("at ping's side"));
}

TEST_P(Evidence, LostMessageNeverGivenToTheKernelIsReported) {
  sender_wakes();
  const auto part = first(message(lost()));
  EXPECT_EQ(word(part), "unknown");
  EXPECT_EQ(part.end, "controller");
  EXPECT_EQ(part.stage, Stage::left);
}

TEST_P(Evidence, LostMessageThatLeftIsReported) {
  sender_wakes_and_queues();
  const auto part = first(message(lost()));
  EXPECT_EQ(part.end, "component");
  EXPECT_EQ(part.stage, Stage::travelled);
  EXPECT_THAT(sentence_of(part), HasSubstr("left ping's"));
}

TEST_P(Evidence, LostMessageThatArrivedIsReported) {
  sender_wakes_and_sends();
  const auto part = first(message(lost()));
  EXPECT_EQ(part.end, "component");
  EXPECT_EQ(part.stage, Stage::delivered);
  EXPECT_THAT(sentence_of(part), HasSubstr("came to pong's"));
}

TEST_P(Evidence, LostAnswerThatArrivedIsReported) {
  has_the_message();
  for (const auto& [after, kind] :
       {std::pair(40 * us, Kind::queued), {41 * us, Kind::sent}, {42 * us, Kind::received}})
    event(sent + after, 1, kind, answers, 0, kind == Kind::received ? "to-component" : "to-controller", 2);
  const auto part = first(message(lost()));
  EXPECT_EQ(word(part), "unknown");
  EXPECT_EQ(part.end, "controller");
  EXPECT_EQ(part.stage, Stage::delivered);
}

INSTANTIATE_TEST_SUITE_P(Kernel, Evidence, testing::Values(true, false), name_of_kernel);

}  // namespace
}  // namespace ontime::explain
