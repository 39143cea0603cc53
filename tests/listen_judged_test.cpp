// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "listen/messages.hpp"
#include "listen_pair.hpp"

namespace ontime::listen {
namespace {

using namespace std::chrono_literals;

struct AgedPair : OnePair {
  AgedPair() : OnePair(Limits{.deadline = {}, .period = {}, .age = 1ms}) {}
};

TEST_F(AgedPair, PeriodsThatHaveNoLimitLeaveNoMessageUnjudged) {
  get_acquainted();
  messages.add_probing(at(9) + 100'000, at(10) - 100'000);
  arrive(at(10));
  EXPECT_EQ(flow().not_judged, 0U);
  EXPECT_EQ(flow().age->max_ns(), 48'000);
}

struct JudgedPair : OnePair {
  JudgedPair() : OnePair(Limits{.deadline = 15ms, .period = {}, .age = 1ms}) {}
};

TEST_F(JudgedPair, GapBeyondTheDeadlineIsLate) {
  get_acquainted();
  arrive(at(12));
  EXPECT_EQ(flow().late, 1U);
  const auto misses = messages.take_misses(at(100'000));
  ASSERT_EQ(misses.size(), 1U);
  EXPECT_EQ(misses[0].kind, Miss::Kind::gap);
  EXPECT_EQ(misses[0].value_ns, 30'000'000);
}

TEST_F(JudgedPair, AgeBeyondItsLimitIsLate) {
  get_acquainted();
  publish(at(10));
  take(at(10) + 3'000'000, at(10) + 2'000);
  EXPECT_EQ(flow().late, 1U);
  const auto misses = messages.take_misses(at(100'000));
  ASSERT_EQ(misses.size(), 1U);
  EXPECT_EQ(misses[0].kind, Miss::Kind::age);
  EXPECT_EQ(misses[0].value_ns, 2'998'000);
}

TEST_F(JudgedPair, MessageUnderWayWhileProbesAreSetIsNotJudged) {
  std::vector<Row> rows;
  messages.keep_rows([&](const Row& row) { rows.push_back(row); });
  get_acquainted();
  const auto before = flow();
  publish(at(10));
  rows.clear();
  messages.add_probing(at(10) + 100'000, at(12));
  take(at(12) + 100'000, at(10) + 2'000);
  EXPECT_EQ(flow().late, 0U);
  EXPECT_EQ(flow().not_judged, 1U);
  EXPECT_EQ(flow().period.count(), before.period.count());
  EXPECT_EQ(flow().age->count(), before.age->count());
  EXPECT_EQ(flow().messages, before.messages + 1);
  EXPECT_EQ(flow().lost, 0U);
  EXPECT_TRUE(messages.take_misses(at(13)).empty());
  EXPECT_TRUE(rows.empty());
  // What is late afterwards, and what is lost, counts.
  publish(at(13));
  publish(at(14));
  take(at(14) + 2'000'000, at(14) + 2'000);
  EXPECT_EQ(flow().late, 1U);
  EXPECT_EQ(flow().not_judged, 1U);
  EXPECT_EQ(flow().lost, 1U);
}

TEST_F(JudgedPair, LossWhileProbesAreSetIsNotJudged) {
  std::vector<Row> rows;
  messages.keep_rows([&](const Row& row) { rows.push_back(row); });
  get_acquainted();
  publish(at(10));  // overwritten by the next, while its reader is held up
  messages.add_probing(at(10) + 1'000'000, at(12));
  publish(at(11));
  publish(at(12) + 1'000);
  take(at(12) + 50'000, at(12) + 3'000);
  EXPECT_EQ(flow().lost, 0U);
  EXPECT_EQ(flow().lost_not_judged, 2U);
  publish(at(13));
  arrive(at(14));
  EXPECT_EQ(flow().lost, 1U);
  EXPECT_EQ(flow().lost_not_judged, 2U);
  EXPECT_EQ(std::ranges::count(rows, 0, &Row::to_ns), 1);
}

TEST_F(JudgedPair, GapThatIsTooLongWithoutTheProbesIsLate) {
  get_acquainted();
  messages.add_probing(at(10), at(10) + 1'000'000);
  arrive(at(13));
  EXPECT_EQ(flow().late, 1U);
  EXPECT_EQ(flow().not_judged, 0U);
}

TEST_F(JudgedPair, LossThatProbesMayExplainMayComeAfterAll) {
  get_acquainted();
  publish(at(10));
  messages.add_probing(at(10) + 100'000, at(11));
  publish(at(11) + 1'000);
  take(at(11) + 50'000, at(11) + 3'000);
  EXPECT_EQ(flow().lost, 0U);
  EXPECT_EQ(flow().lost_not_judged, 1U);
  take(at(11) + 60'000, at(10) + 2'000);
  EXPECT_EQ(flow().lost, 0U);
  EXPECT_EQ(flow().lost_not_judged, 0U);
  EXPECT_EQ(flow().reordered, 1U);
  EXPECT_EQ(flow().duplicated, 0U);
}

TEST_F(JudgedPair, WriterThatProbesHeldUpIsNotJudgedByItsPeriod) {
  publish(at(0), 1, 0xc);
  messages.add_probing(at(1), at(3));
  publish(at(3) + 1'000, 1, 0xc);
  publish(at(4), 1, 0xc);
  EXPECT_EQ(flow().late, 0U);
  EXPECT_EQ(flow().not_judged, 1U);
  publish(at(6), 1, 0xc);
  EXPECT_EQ(flow().late, 1U);
}

TEST_F(JudgedPair, MissBeforeTheTopicHasItsNameWaitsForIt) {
  constexpr std::uint64_t unnamed = 0xc;
  const auto take_unnamed = [&](std::int64_t at_ns) {
    messages.add({.kind = Observation::Kind::taken, .at_ns = at_ns, .endpoint = unnamed, .process = 2});
  };
  take_unnamed(at(0));
  take_unnamed(at(3));
  EXPECT_TRUE(messages.take_misses(at(4)).empty());
  messages.name_topic(2, unnamed, "/odom");
  EXPECT_THAT(messages.take_misses(at(4)), testing::ElementsAre(testing::Field(&Miss::topic, "/odom")));
  take_unnamed(at(6));
  EXPECT_EQ(messages.take_misses(at(7)).size(), 1U);
}

TEST_F(JudgedPair, MissOfAProcessThatJustBeganHasItsName) {
  const auto take_in_new = [&](std::int64_t at_ns) {
    messages.add({.kind = Observation::Kind::taken, .at_ns = at_ns, .endpoint = 0xd, .process = 3});
  };
  messages.name_topic(3, 0xd, "/odom");
  take_in_new(at(0));
  take_in_new(at(3));
  messages.begin_process(3, "navigation");
  const auto misses = messages.take_misses(at(4));
  ASSERT_EQ(misses.size(), 1U);
  EXPECT_EQ(misses[0].reader, (Party{3, "navigation"}));
}

TEST_F(JudgedPair, MissOfATopicWithoutANameIsToldAfterAWhile) {
  const auto take_unnamed = [&](std::int64_t at_ns) {
    messages.add({.kind = Observation::Kind::taken, .at_ns = at_ns, .endpoint = 0xc, .process = 2});
  };
  take_unnamed(at(0));
  take_unnamed(at(3));
  EXPECT_TRUE(messages.take_misses(at(3) + Messages::named_within_ns - 1).empty());
  EXPECT_EQ(messages.take_misses(at(3) + Messages::named_within_ns).size(), 1U);
}

TEST_F(JudgedPair, MemoryOfMissesIsBounded) {
  get_acquainted();
  for (int i = 0; i < 3000; ++i) arrive(at(20 + i * 5));
  EXPECT_EQ(messages.take_misses(at(100'000)).size(), most_misses);
  EXPECT_EQ(messages.findings().misses_left_out.at("/cmd_vel"), 2000U);
  EXPECT_EQ(flow().late, 3000U);
}

TEST_F(JudgedPair, FlowOfEndedProcessesStaysUntilThereAreTooMany) {
  constexpr auto most = static_cast<std::uint32_t>(Messages::most_ended);
  for (std::uint32_t process = 10; process < 10 + most + 5; ++process) {
    messages.begin_process(process, "node");
    messages.name_topic(process, 0xa, "/scan");
    publish(at(0), process);
    publish(at(1), process);
    messages.end_process(process, at(2));
  }
  messages.retire_ended(at(2) + Messages::still_taken_ns - 1);
  EXPECT_EQ(messages.findings().flows.size(), most + 5U) << "its last messages may still be taken";
  messages.retire_ended(at(2) + Messages::still_taken_ns);
  const auto findings = messages.findings();
  ASSERT_EQ(findings.flows.size(), most);
  EXPECT_EQ(findings.flows.back().writer, (Party{10 + most + 4, "node"}));
  EXPECT_EQ(findings.flows.back().topic, "/scan");
  const auto& forgotten = findings.forgotten.at("/scan");
  EXPECT_EQ(forgotten.flows, 5U);
  EXPECT_EQ(forgotten.messages, 10U);
  EXPECT_EQ(forgotten.with_misses, 5U) << "they fell silent, and a deadline is stated";
  EXPECT_EQ(findings.all_forgotten().messages, 10U);
}

// As one process may give its endpoint ever other names.
TEST_F(JudgedPair, TopicsBeyondTheBoundShareOneName) {
  messages.begin_process(9, "node");
  const auto more = Findings::most_topics + Messages::most_ended + 2;
  for (std::size_t topic = 0; topic < more; ++topic) {
    messages.name_topic(9, 0xa, "/" + std::to_string(topic));
    publish(at(0), 9);
  }
  const auto findings = messages.findings();
  EXPECT_EQ(findings.forgotten.size(), Findings::most_topics + 1);
  EXPECT_EQ(findings.forgotten.at(Findings::any_topic).with_misses, 1U);
}

// Of stamps nothing is known then; periods are by a clock that cannot be set.
TEST_F(JudgedPair, ClockThatIsSetHidesNoGap) {
  get_acquainted();
  const auto before = flow();
  messages.forget_stamps(at(100));
  publish(at(12));
  take(at(12) + 50'000, at(12) - 3'000'000'000);
  EXPECT_EQ(flow().late, 1U) << "20 ms without a message";
  EXPECT_EQ(flow().age->count(), before.age->count());
  arrive(at(101));
  EXPECT_EQ(flow().late, 2U);
  EXPECT_EQ(flow().age->count(), before.age->count() + 1);
  EXPECT_EQ(flow().lost, 0U);
}

TEST_F(JudgedPair, SilenceThatAPauseEndsIsOneLatePeriod) {
  std::vector<Row> rows;
  messages.keep_rows([&](const Row& row) { rows.push_back(row); });
  get_acquainted();
  const auto before = flow().period.count();
  for (int pause = 1; pause <= 2; ++pause) {
    messages.count_silence(flow().id, at(10), 500'000'000);
    messages.interrupt(at(100 * pause));
  }
  EXPECT_EQ(flow().late, 1U);
  EXPECT_EQ(flow().period.count(), before + 1);
  EXPECT_TRUE(rows.back().is_late);
  EXPECT_EQ(rows.back().to_ns - rows.back().from_ns, 500'000'000);
  arrive(at(201));
  messages.count_silence(flow().id, at(202), 500'000'000);
  EXPECT_EQ(flow().late, 2U) << "another silence";
  messages.end_process(2, at(210));
  messages.retire_ended(at(210) + Messages::still_taken_ns);
  messages.count_silence(flow().id, at(2000), 500'000'000);
  EXPECT_EQ(flow().late, 2U) << "the same";
}

TEST_F(JudgedPair, SilenceOfARetiredFlowHasARowToo) {
  std::vector<Row> rows;
  messages.keep_rows([&](const Row& row) { rows.push_back(row); });
  get_acquainted();
  const auto before = flow();
  messages.end_process(2, at(10));
  messages.retire_ended(at(10) + Messages::still_taken_ns);
  messages.count_silence(before.id, at(10), 500'000'000);
  EXPECT_EQ(flow().late, 1U);
  EXPECT_EQ(rows.back().flow, before.id);
  EXPECT_TRUE(rows.back().is_late);
  EXPECT_EQ(rows.back().index, before.period.count());
  EXPECT_EQ(rows.back().to_ns - rows.back().from_ns, 500'000'000);
}

TEST_F(JudgedPair, RetiredFlowHasEndedWhereItsProcessEndsLater) {
  get_acquainted();
  messages.name_topic(2, 0xb, "/scan");  // the endpoint's memory has another topic
  EXPECT_FALSE(flow().has_ended);
  messages.end_process(1, at(20));
  EXPECT_TRUE(flow().has_ended);
}

TEST_F(JudgedPair, FlowHasEndedWhereOneOfItsProcessesHas) {
  get_acquainted();
  EXPECT_FALSE(flow().has_ended);
  messages.end_process(1, at(10));
  EXPECT_TRUE(flow().has_ended);
  messages.retire_ended(at(10) + Messages::still_taken_ns);
  EXPECT_TRUE(flow().has_ended);
}

}  // namespace
}  // namespace ontime::listen
