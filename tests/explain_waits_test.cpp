// SPDX-License-Identifier: Apache-2.0
// Of threads that sleep and wait.
#include "explain_fixture.hpp"

namespace ontime::explain {
namespace {

class Waits : public Explained {
 protected:
  void waits_for_a_page(std::int64_t at) {
    switched(at, 1, answers, "D", hog);
    event(at + us, 1, Kind::waits, answers, 0,
          "schedule io_schedule filemap_fault handle_mm_fault exc_page_fault");
    event(at + 150 * us, 1, Kind::waking, answers, hog, "1");
    switched(at + 152 * us, 1, hog, "R", answers);
  }
};

TEST_P(Waits, ThreadThatSleptWithTheMessageWaited) {
  has_the_message();
  switched(sent + 30 * us, 1, answers, "S", 0);
  event(sent + 15 * ms, 0, Kind::waking, answers, hog, "1");
  switched(sent + 15 * ms + 2 * us, 1, 0, "R", answers);
  switched(sent + 15 * ms + 60 * us, 1, answers, "S", 0);
  const auto part = first(message(late(0, 15 * ms, 0)));
  EXPECT_EQ(part.cause, Cause::waited);
  EXPECT_EQ(part.culprit, "hog");
  EXPECT_EQ(part.ns, 15 * ms - 30 * us);
}

TEST_P(Waits, OneThatSleepsAfterAMessageThatIsLostIsNotAccused) {
  sender_wakes();
  switched(sent + 20 * us, 0, asks, "S", 0);  // no packet of it was seen
  EXPECT_EQ(first(message(lost())).cause, Cause::unknown);
}

TEST_P(Waits, ThreadInterruptedByATimerIsNotAccused) {
  has_the_message();
  switched(sent + 30 * us, 1, answers, "S", 0);
  event(sent + 15 * ms - us, 0, Kind::timer, hog);
  event(sent + 15 * ms, 0, Kind::waking, answers, hog, "1");
  event(sent + 15 * ms + us, 0, Kind::timer_end, hog);
  switched(sent + 15 * ms + 2 * us, 1, 0, "R", answers);
  switched(sent + 15 * ms + 60 * us, 1, answers, "S", 0);
  const auto part = first(message(late(0, 15 * ms, 0)));
  EXPECT_EQ(part.cause, Cause::waited);
  EXPECT_EQ(part.culprit, "");
}

TEST_P(Waits, KernelFunctionsTellWhatAThreadWaitedFor) {
  has_the_message();
  switched(sent + 30 * us, 1, answers, "D", 0);
  event(sent + 31 * us, 1, Kind::waits, answers, 0,
        "schedule io_schedule filemap_fault handle_mm_fault exc_page_fault");
  event(sent + 15 * ms, 0, Kind::waking, answers, hog, "1");
  switched(sent + 15 * ms + 2 * us, 1, 0, "R", answers);
  switched(sent + 15 * ms + 60 * us, 1, answers, "S", 0);
  const auto part = first(message(late(0, 15 * ms, 0)));
  EXPECT_EQ(part.cause, Cause::page_fault);
  EXPECT_EQ(part.culprit, "") << "who ended the wait has no part in it";
}

TEST_P(Waits, RunBetweenTwoPageFaultsCountsAsPageFault) {
  has_the_message();
  for (int i = 0; i < 50; ++i) waits_for_a_page(sent + 30 * us + i * 300 * us);
  switched(sent + 15 * ms + 60 * us, 1, answers, "S", 0);
  const auto message = this->message(late(0, 15 * ms, 0));
  EXPECT_EQ(first(message).cause, Cause::page_fault);
  EXPECT_GT(first(message).ns, 14 * ms);
}

TEST_P(Waits, IdleCpuBetweenTwoPageFaultsCountsAsPageFault) {
  has_the_message();
  for (int i = 0; i < 50; ++i) {
    const auto at = sent + 30 * us + i * 300 * us;
    switched(at, 1, answers, "D", 0);
    event(at + us, 1, Kind::waits, answers, 0, "schedule io_schedule handle_mm_fault exc_page_fault");
    event(at + 150 * us, 1, Kind::waking, answers, 0, "1");
    switched(at + 152 * us, 1, 0, "R", answers);
  }
  switched(sent + 15 * ms + 60 * us, 1, answers, "S", 0);
  const auto message = this->message(late(0, 15 * ms, 0));
  EXPECT_EQ(first(message).cause, Cause::page_fault);
  EXPECT_GT(first(message).ns, 14 * ms);
}

TEST_P(Waits, ComputingAfterAPageFaultIsBusy) {
  has_the_message();
  for (const auto at : {sent + 30 * us, sent + 14 * ms}) waits_for_a_page(at);
  switched(sent + 15 * ms + 60 * us, 1, answers, "S", 0);
  EXPECT_EQ(first(message(late(0, 15 * ms, 0))).cause, Cause::busy);
}

TEST(Causes, KernelFunctionsOfAWaitNameItsCause) {
  EXPECT_EQ(cause_of_wait("schedule rwsem_down_read_slowpath down_read lock_mm_and_find_vma exc_page_fault"),
            Cause::lock)
      << "not for the page, but to look it up";
  EXPECT_EQ(cause_of_wait("schedule schedule_preempt_disabled __mutex_lock.constprop.0 rtnl_lock"),
            Cause::lock);
  EXPECT_EQ(cause_of_wait("schedule io_schedule bit_wait_io"), Cause::disk);
  EXPECT_EQ(cause_of_wait("schedule synchronize_rcu"), Cause::blocked);
  EXPECT_EQ(cause_of_wait(""), Cause::blocked);
}

TEST_P(Waits, AThreadThatSleptUntilAPacketCameIsNotAccused) {
  has_the_message();
  switched(sent + 30 * us, 1, answers, "S", 0);
  event(sent + 15 * ms - us, 0, Kind::soft_interrupt, hog, 0, "NET_RX");
  event(sent + 15 * ms, 0, Kind::waking, answers, hog, "1");
  event(sent + 15 * ms + us, 0, Kind::soft_interrupt_end, hog, 0, "NET_RX");
  switched(sent + 15 * ms + 2 * us, 1, 0, "R", answers);
  switched(sent + 15 * ms + 60 * us, 1, answers, "S", 0);
  EXPECT_EQ(first(message(late(0, 15 * ms, 0))).cause, Cause::unknown);
}

TEST_P(Waits, WakerOfAnEarlierWaitIsNotAccused) {
  has_the_message();
  switched(sent + 30 * us, 1, answers, "S", 0);
  event(sent + 50 * us, 0, Kind::waking, answers, hog, "1");
  switched(sent + 52 * us, 1, 0, "R", answers);
  switched(sent + 90 * us, 1, answers, "S", 0);
  switched(sent + 15 * ms, 1, 0, "R", answers);  // who woke it is not known
  switched(sent + 15 * ms + 60 * us, 1, answers, "S", 0);
  for (const auto& part : message(late(0, 15 * ms, 0)).parts)
    EXPECT_TRUE(part.culprit != "hog" || part.ns <= 22 * us);
}

TEST_P(Waits, LateSenderIsAFaultEvenIfItsMessageIsQuick) {
  sender_wakes_and_sends();
  auto sample = usual(50);
  sample.intended_ns = due - 30 * ms;
  sample.skipped_cycles = 3;
  sample.passed_wake_ns = sample.woke_ns - sample.intended_ns;
  window_.span.from_ns = due - 31 * ms;
  window_.events.insert(window_.events.begin(), {.at_ns = due - 30 * ms - 100 * us,
                                                 .cpu = 0,
                                                 .kind = Kind::waking,
                                                 .thread = named(asks),
                                                 .other = named(0),
                                                 .what = "0"});
  deadline_us_ = 10'000;
  const auto account = this->account(sample);
  EXPECT_EQ(account.late, 0u);
  EXPECT_EQ(account.late_by_response, 0u);  // from when it was due itself: the skipped cycles count apart
  EXPECT_EQ(account.after_skipped, 1u);
  ASSERT_THAT(account.messages, SizeIs(1));
  EXPECT_TRUE(account.messages[0].late_by_response);
  const auto part = first(account.messages[0]);
  EXPECT_EQ(part.stage, Stage::woke);
  EXPECT_GT(part.ns, 25 * ms);
  EXPECT_THAT(account.groups, SizeIs(1));
}

TEST(Sample, CyclesDuringAWaitForAnAnswerAreNotSkippedBySleep) {
  Sample sample{.index = 1,
                .intended_ns = 10 * ms,
                .due_ns = 40 * ms,
                .woke_ns = 40 * ms + 10 * us,
                .passed_wake_ns = 50 * us,
                .sent_ns = 0,
                .received_ns = 0,
                .server_received_ns = 0,
                .server_sent_ns = 0,
                .skipped_cycles = 3,
                .fate = Fate::on_time};
  EXPECT_EQ(awaited_since_ns(sample), 40 * ms);
  sample.passed_wake_ns = 30 * ms + 10 * us;
  EXPECT_EQ(awaited_since_ns(sample), 10 * ms);
}

INSTANTIATE_TEST_SUITE_P(Kernel, Waits, testing::Values(true, false), name_of_kernel);

}  // namespace
}  // namespace ontime::explain
