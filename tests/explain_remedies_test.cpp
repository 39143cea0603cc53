// SPDX-License-Identifier: Apache-2.0
// A remedy can help this thread, and is not set already.
#include "explain_fixture.hpp"

namespace ontime::explain {
namespace {

class Remedies : public Explained {
 protected:
  static Part receiver(Cause cause, std::int32_t priority, const std::string& culprit = "") {
    return {.cause = cause,
            .stage = Stage::delivered,
            .end = "component",
            .thread = "receive",
            .culprit = culprit,
            .priority = priority,
            .culprit_priority = ordinary};
  }
  static std::vector<Setting> settings(const Part& part, const json& asked = {}) {
    record::Run run;
    run.asked = asked;
    return remedy_for(part, run).settings;
  }
};

TEST_F(Remedies, AnOrdinaryThreadBehindAnotherBecomesRealTime) {
  EXPECT_THAT(settings(receiver(Cause::cpu, ordinary, "hog")),
              testing::ElementsAre(Setting{"realtime", "on"}));
}

TEST_F(Remedies, ARealTimeThreadBehindAMoreUrgentOneGetsAPriorityOrACpu) {
  EXPECT_THAT(settings(receiver(Cause::cpu, fifo_80, "hog")),
              testing::ElementsAre(Setting{"realtime.receive.priority", "above the priority of hog"},
                                   Setting{"realtime.receive.cpus", "other CPUs than those of hog"}));
}

// The kernel's own thread has the highest priority of SCHED_FIFO, and those of SCHED_DEADLINE come before.
TEST_F(Remedies, NoPriorityIsAboveTheHighest) {
  for (const auto highest : {0, -1}) {
    auto part = receiver(Cause::cpu, fifo_80, "migration/1");
    part.culprit_priority = highest;
    const auto other_cpus =
        testing::ElementsAre(Setting{"realtime.receive.cpus", "other CPUs than those of migration/1"});
    EXPECT_THAT(settings(part), other_cpus);
    part.priority = ordinary;
    EXPECT_THAT(settings(part), other_cpus) << "nor is any real-time thread above it";
  }
}

TEST_F(Remedies, NoKernelThreadGetsAPriorityAboveTheHighest) {
  auto part = receiver(Cause::cpu, ordinary, "migration/1");
  part.stage = Stage::travelled;
  part.culprit_priority = 0;
  part.thread = "napi/eth1-1";
  EXPECT_THAT(settings(part),
              testing::ElementsAre(Setting{"kernel.napi-cpus", "other CPUs than those of migration/1"}));
  part.thread = "ksoftirqd/1";
  EXPECT_THAT(settings(part), IsEmpty());
}

TEST_F(Remedies, RealtimeOnButDeniedIsReportedAsDenied) {
  const json asked{{"realtime", true}};
  EXPECT_THAT(settings(receiver(Cause::cpu, ordinary, "hog"), asked), IsEmpty());
  EXPECT_THAT(advice(receiver(Cause::cpu, ordinary, "hog"), asked), HasSubstr("denied"));
}

TEST_F(Remedies, MemoryThatIsLockedAlreadyIsNotLockedAgain) {
  EXPECT_EQ(advice(receiver(Cause::page_fault, fifo_80)), "realtime.lock-memory: on");
  const json locked{{"on", false}, {"lock_memory", true}, {"cpu_latency_us", nullptr}, {"threads", {}}};
  EXPECT_EQ(advice(receiver(Cause::page_fault, fifo_80), {{"realtime_settings", locked}}), "");
}

TEST_F(Remedies, ThrottledOrdinaryThreadIsNotHelpedByRtThrottling) {
  EXPECT_THAT(settings(receiver(Cause::throttled, ordinary)), IsEmpty());
  EXPECT_THAT(settings(receiver(Cause::throttled, fifo_80)),
              testing::ElementsAre(Setting{"kernel.rt-throttling", "off"}));
  EXPECT_THAT(settings(receiver(Cause::throttled, fifo_80), {{"kernel", {{"rt-throttling", "off"}}}}),
              IsEmpty());
}

TEST_F(Remedies, SoftirqsOfACpusOwnWorkAreNotMovedWithInterrupts) {
  EXPECT_THAT(settings(receiver(Cause::interrupts, fifo_80, "RCU")), IsEmpty());
  EXPECT_THAT(settings(receiver(Cause::interrupts, fifo_80, "NET_RX")), SizeIs(1));
}

TEST_F(Remedies, AThreadThatTakesPacketsInHasItsOwnKey) {
  auto part = receiver(Cause::cpu, ordinary, "hog");
  part.stage = Stage::travelled;
  part.thread = "napi/eth1-1";
  EXPECT_THAT(settings(part),
              testing::ElementsAre(Setting{"kernel.napi-threads", "above the priority of hog"},
                                   Setting{"kernel.napi-cpus", "other CPUs than those of hog"}));
}

TEST_F(Remedies, FaultsThatTheRunAskedForAreNotBlamedOnTheUsersPacketFilter) {
  const json link{{"link", {{"loss", 0.02}, {"cut", {{"at_s", 0.5}, {"for_ms", 200}}}}}};
  const auto dropped = receiver(Cause::dropped, ordinary, "NETFILTER_DROP");
  EXPECT_THAT(advice(dropped), HasSubstr("nft"));
  EXPECT_THAT(advice(dropped, {{"link", {{"delay_us", 1000}}}}), HasSubstr("nft"))
      << "needs no packet filter";
  EXPECT_THAT(advice(dropped, link), AllOf(HasSubstr("link.loss or link.cut"), Not(HasSubstr("nft"))));
  EXPECT_THAT(advice(dropped, {{"link", {{"loss", 0.02}}}}),
              AllOf(HasSubstr("link.loss"), Not(HasSubstr("link.cut"))));
  const auto softirqs = receiver(Cause::interrupts, ordinary, "NET_RX");
  EXPECT_THAT(advice(softirqs), HasSubstr("nft"));
  EXPECT_THAT(advice(softirqs, link), AllOf(HasSubstr("link.loss"), Not(HasSubstr("nft"))));
  EXPECT_EQ(settings(softirqs, link), settings(softirqs)) << "CPUs of interrupts help as before";
}

TEST_F(Remedies, QueueThatTheRunAskedForIsNotBlamedOnTheMachine) {
  const auto queue = receiver(Cause::queue, ordinary, "eth0");
  EXPECT_THAT(advice(queue), HasSubstr("tc "));
  EXPECT_THAT(advice(queue, {{"link", {{"loss", 0.02}}}}), HasSubstr("tc "));
  EXPECT_THAT(advice(queue, {{"link", {{"delay_us", 1000}, {"jitter_us", 500}}}}),
              AllOf(HasSubstr("link.delay with link.jitter"), Not(HasSubstr("tc "))));
  EXPECT_THAT(advice(receiver(Cause::dropped, ordinary, "QDISC_DROP"), {{"link", {{"qdisc", "fq"}}}}),
              HasSubstr("link.qdisc"));
}

}  // namespace
}  // namespace ontime::explain
