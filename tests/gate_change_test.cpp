// SPDX-License-Identifier: Apache-2.0
// Gates on what changed between two sides.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "amend.hpp"
#include "gate_runs.hpp"

namespace ontime::gate {
namespace {

using nlohmann::json;
using statistics::Measured;
using statistics::Summary;
using ::testing::ContainsRegex;
using ::testing::HasSubstr;
using Result = Judgement::Result;

Judgement compared(const char* text, const Measured& from, const Measured& to) {
  const auto a = run(from), b = run(to);
  return judge(parse(text, Use::fail_if_compared), {&a, &a}, {&b, &b});
}

TEST(JudgeAChange, FailsOnlyIfChanceDoesNotExplainIt) {
  EXPECT_EQ(compared("p99 > +10%", measured(1, 0.98, 1.02), measured(1.3, 1.28, 1.32)).result,
            Result::missed);
  EXPECT_EQ(compared("p99 > +10%", measured(1, 0.98, 1.02), measured(1.05, 1.03, 1.07)).result, Result::held);
  const auto unsure = compared("p99 > +10%", measured(1, 0.8, 1.2), measured(1.3, 0.9, 1.8));
  EXPECT_EQ(unsure.result, Result::held);
  EXPECT_FALSE(unsure.is_sure);
  EXPECT_EQ(compared("p99 > +0.2 ms", measured(1, 0.98, 1.02), measured(1.3, 1.28, 1.32)).result,
            Result::missed);
  EXPECT_EQ(compared("p99 > +0.4 ms", measured(1, 0.98, 1.02), measured(1.3, 1.28, 1.32)).result,
            Result::held);
}

TEST(JudgeAChange, IsOpenIfTheMeasuredChangeIsBeyondTheLimitAndMayBeTwiceIt) {
  // Two runs a side say so little that 54 times as long may be chance.
  const auto fast = run(measured(0.15, 0.1, 0.2)), faster = run(measured(0.1, 0.08, 0.2)),
             slow = run(measured(11.6, 11, 12)), slower = run(measured(4.9, 4, 5));
  for (const auto* text : {"p99 > +10%", "p99 > +10 us"}) {
    const auto judgement = judge(parse(text, Use::fail_if_compared), {&fast, &faster}, {&slow, &slower});
    EXPECT_EQ(judgement.result, Result::cannot_judge) << text;
    EXPECT_THAT(judgement.says, HasSubstr("Repeat the runs more often")) << text;
  }
  EXPECT_EQ(compared("p99 > +10%", measured(1, 0.5, 2), measured(1.3, 0.6, 2.2)).result,
            Result::cannot_judge);
  const auto base = run(measured(1, 0.8, 1.2)), unbounded = run(measured(1.3, 1, {}));
  EXPECT_EQ(
      judge(parse("p99 > +10%", Use::fail_if_compared), {&base}, {&unbounded}, SingleRuns::judged).result,
      Result::cannot_judge);
  EXPECT_EQ(compared("p99 > +60%", measured(1, 0.5, 2), measured(1.3, 0.6, 2.2)).result, Result::held)
      << "the measured change is within the limit";
}

TEST(JudgeAChange, WithinTheLimitIsNotCertainIfTheIntervalIsNot) {
  const auto sure = compared("p99 > +10%", measured(1, 0.99, 1.01), measured(1.02, 1.01, 1.03));
  EXPECT_TRUE(sure.is_sure) << sure.says;
  // Two runs a side that differ by far more than the limit tell nothing of it.
  const auto fast = run(measured(0.15, 0.1, 0.2)), slow = run(measured(11.6, 11, 12));
  for (const auto* text : {"p99 > +10%", "p99 > +10 us"}) {
    const auto judgement = judge(parse(text, Use::fail_if_compared), {&fast, &slow}, {&slow, &fast});
    EXPECT_STREQ(word_of(judgement), "ok, not certain") << text;
    EXPECT_THAT(judgement.says, HasSubstr("too few runs or messages")) << text;
  }
}

TEST(JudgeAChange, OfAShareThatWasZeroGoesByTheLimitToo) {
  const auto losing = [](double value, double high) {
    auto one = run({});
    one.lost_probability.messages = 60;
    one.lost_probability.value = value;
    one.lost_probability.surer = {0.0, high};
    return one;
  };
  const auto none = losing(0, 0.02), some = losing(0.02, 0.08);
  const auto result_of = [&](const char* text, const Summary& to) {
    return word_of(judge(parse(text, Use::fail_if_compared), {&none}, {&to}, SingleRuns::judged));
  };
  for (const auto* text : {"lost > +0.1 points", "lost > +1 points", "lost > +10%"}) {
    EXPECT_STREQ(result_of(text, some), "open") << text << ": 2 % may be chance, and may be 8 %";
  }
  EXPECT_STREQ(result_of("lost > +1 points", none), "ok, not certain") << "2 % may be lost";
  EXPECT_STREQ(result_of("lost > +3 points", none), "ok");
  EXPECT_STREQ(result_of("lost > +3 points", some), "ok, not certain");
  for (const auto* text : {"lost > +0 points", "lost > +10%"})
    EXPECT_STREQ(result_of(text, none), "ok") << text << ": no run could prove that none is ever lost";
}

TEST(JudgeAChange, LimitInPointsIsAnsweredInPoints) {
  const auto losing = [](double value, double low, double high) {
    auto one = run({});
    one.lost_probability.messages = 1000;
    one.lost_probability.value = value;
    one.lost_probability.surer = {low, high};
    return one;
  };
  const auto says_of = [](const char* text, const Summary& from, const Summary& to) {
    return judge(parse(text, Use::fail_if_compared), {&from}, {&to}, SingleRuns::judged).says;
  };
  const auto none = losing(0, 0, 0.004), rare = losing(0.001, 0.00098, 0.00102),
             many = losing(0.2, 0.196, 0.204);
  const auto points = says_of("lost > +0.1 points", rare, many);
  EXPECT_THAT(points, HasSubstr("from 0.1 % to 20 % (+19.9 points), 98 % interval [+19."));
  EXPECT_THAT(points, testing::EndsWith(" points]"));
  EXPECT_THAT(says_of("lost > +10%", rare, many), HasSubstr("(over 100 times), 98 % interval [over 100"));
  EXPECT_THAT(says_of("lost > +10%", many, rare), HasSubstr("(-99.5 %)"));
  EXPECT_THAT(says_of("lost > +0.1 points", many, rare), HasSubstr("(-19.9 points), 98 % interval [-19.9"));
  EXPECT_THAT(says_of("lost > +0.1 points", rare, losing(0.002, 1e-9, 1)),
              HasSubstr("(+0.1 points), 98 % interval [-0.1 points, +"));
  EXPECT_THAT(says_of("lost > +0.1 points", losing(0.001, 1e-5, 0.01), losing(0.002, 1e-9, 1)),
              testing::AllOf(HasSubstr("+100 points]"), HasSubstr("too")))
      << "not more than all messages";
  EXPECT_THAT(says_of("lost > +0.1 points", none, losing(0.99998, 0.99997, 0.99999)),
              HasSubstr("from 0 % to 99.998 % (+99.998 points)"));
  const auto most = run(measured(10, 9.9, 10.1)), hardly = run(measured(0.002, 0.0019, 0.0021));
  EXPECT_THAT(says_of("p99 > +10%", most, hardly), HasSubstr("(-99.98 %), 98 % interval [-99.9"));
  // Without a ratio an interval in percent would read as one.
  for (const auto* text : {"lost > +0.1 points", "lost > +10%"})
    EXPECT_THAT(says_of(text, none, many), HasSubstr("from 0 % to 20 % (+20 points), 98 % interval [+19."))
        << text;
}

TEST(JudgeAChange, IsNotCertainWhereMoreWasLostThanThePercentileLeavesOut) {
  const auto from = run(measured(1, 0.98, 1.02));
  auto to = from;
  EXPECT_TRUE(judge(parse("p99 > +10%", Use::fail_if_compared), {&from, &from}, {&to, &to}).is_sure);
  to.lost = 490;
  for (const auto* text : {"p99 > +10%", "p99 > +1 ms"}) {
    const auto judgement = judge(parse(text, Use::fail_if_compared), {&from, &from}, {&to, &to});
    EXPECT_EQ(judgement.result, Result::held) << text;
    EXPECT_FALSE(judgement.is_sure) << text;
    EXPECT_THAT(judgement.says, HasSubstr("490 of 1,000 messages were lost")) << text;
  }
}

TEST(JudgeAChange, NamesBothValuesAndTheirChange) {
  EXPECT_THAT(text_of(compared("p99 > +10%", measured(1, 0.98, 1.02), measured(1.3, 1.28, 1.32))),
              ::testing::AllOf(HasSubstr("FAIL: p99 <= +10% (Test1.B udp)"),
                               HasSubstr("from 1 ms to 1.3 ms (+30 %)"), HasSubstr("98 % interval [+")));
}

TEST(JudgeAChange, OneRunPerSideIsOpenUnlessSingleRunsAreJudged) {
  const auto a = run(measured(1, 0.98, 1.02)), b = run(measured(1.3, 1.28, 1.32));
  const auto gate = parse("p99 > +10%", Use::fail_if_compared);
  for (const auto& [from, to] : {std::pair<Runs, Runs>{{&a}, {&b}}, {{&a}, {&a}}, {{&a, &a}, {&b}}}) {
    const auto judgement = judge(gate, from, to);
    EXPECT_EQ(judgement.result, Result::cannot_judge);
    EXPECT_THAT(judgement.says, HasSubstr("repeat: 5"));
  }
  EXPECT_EQ(judge(gate, {&a}, {&b}, SingleRuns::judged).result, Result::missed);
  EXPECT_EQ(judge(gate, {&a}, {&a}, SingleRuns::judged).result, Result::held);
}

TEST(JudgeAChange, TooFewMessagesInSingleRunsAreOpen) {
  const auto a = run(measured(1, 0.9, {})), b = run(measured(0.9, 0.8, 1));
  EXPECT_EQ(judge(parse("p99 > +10%", Use::fail_if_compared), {&a}, {&b}, SingleRuns::judged).result,
            Result::cannot_judge);
}

TEST(JudgeAChange, PercentileOfTooFewMessagesIsOpen) {
  auto a = run({}), b = run({});
  a.round_trip_certainty[statistics::Figure::p99_99] = measured(1, 0.98, 1.02);
  b.round_trip_certainty[statistics::Figure::p99_99] = measured(9, 8.98, 9.02);
  for (const auto* text : {"p99.99 > +10%", "p99.99 > +1 ms"}) {
    const auto judgement = judge(parse(text, Use::fail_if_compared), {&a, &a}, {&b, &b});
    EXPECT_EQ(judgement.result, Result::cannot_judge) << "of 1,000 it is the maximum";
    EXPECT_THAT(judgement.says, HasSubstr("too few messages")) << text;
  }
}

TEST(JudgeAChange, DifferenceAndRatioAreJudgedByTheSameInterval) {
  const auto low = run(measured(0.3, 0.29, 0.31));
  const auto some = run(measured(3, 2.9, 3.1)), more = run(measured(9, 8.9, 9.1)),
             most = run(measured(30, 29, 31));
  for (const auto& [text, says] :
       {std::pair("p99 > +1%", R"(\(\+3500 %\), 98 % interval \[\+394 %, over 100 times\])"),
        {"p99 > +10 us", R"(\(\+10.5 ms\), 98 % interval \[\+1.18. ms, \+36.4 ms\])"}}) {
    const auto judgement = judge(parse(text, Use::fail_if_compared), {&low, &low, &low, &low, &low},
                                 {&some, &more, &most, &some, &more});
    EXPECT_EQ(judgement.result, Result::missed) << text;
    EXPECT_THAT(judgement.says, ContainsRegex(says)) << "in the unit of the limit";
  }
}

TEST(JudgeAChange, AnyIncreaseFromZeroExceedsARatio) {
  auto a = run({}), b = run({}, 100);
  const auto share = [](double value, double low, double high) {
    statistics::Probability result;
    result.value = value;
    result.surer = {low, high};
    result.messages = 1000;
    return result;
  };
  a.late_probability = share(0, 0, 0.004);
  b.late_probability = share(0.1, 0.08, 0.12);
  const auto gate = parse("late > +10%", Use::fail_if_compared);
  EXPECT_EQ(judge(gate, {&a}, {&b}, SingleRuns::judged).result, Result::missed);
  EXPECT_EQ(judge(gate, {&a}, {&a}, SingleRuns::judged).result, Result::held);
  b.late_probability = share(0.001, 0, 0.005);
  EXPECT_EQ(judge(gate, {&a}, {&b}, SingleRuns::judged).result, Result::cannot_judge)
      << "one message may be chance";
}

TEST(JudgeAChange, ARepetitionThatAnsweredNothingIsNotPassedOver) {
  const auto a = run(measured(1, 0.98, 1.02)), b = run(measured(1, 0.98, 1.02));
  auto lost = b;
  lost.round_trip = {};
  const auto judgement = judge(parse("p99 > +10%", Use::fail_if_compared), {&a}, {&b, &lost});
  EXPECT_EQ(judgement.result, Result::cannot_judge);
  EXPECT_THAT(judgement.says, HasSubstr("of B: no message"));
}

TEST(JudgeAChange, LateIsOfAnswersSoLossesMakeItUncertain) {
  const auto gate = parse("late > +1 points", Use::fail_if_compared);
  auto a = run({}), b = run({});
  for (auto* one : {&a, &b}) {
    one->late_probability.surer = {0, 0.004};
    one->late_probability.messages = 1000;
  }
  EXPECT_TRUE(judge(gate, {&a}, {&b}, SingleRuns::judged).is_sure);
  b.lost = 20;
  EXPECT_FALSE(judge(gate, {&a}, {&b}, SingleRuns::judged).is_sure);
  b.lost = b.sent;
  EXPECT_EQ(judge(gate, {&a}, {&b}, SingleRuns::judged).result, Result::cannot_judge);
}

TEST(JudgeAChange, UnknownLossOrLatenessIsOpen) {
  auto one = run(measured(1, 0.9, 1.1));
  one.late_probability.messages = one.lost_probability.messages = 1500;
  one.run.asked.measures = "age";
  one.run.asked.task.client.deadline = {};
  one.run.outcome.loss_unknown = true;
  for (const auto* text : {"lost > +0 points", "lost > +10%", "late > +0.1 points"}) {
    const auto judgement = judge(parse(text, Use::fail_if_compared), {&one, &one}, {&one, &one});
    EXPECT_EQ(judgement.result, Result::cannot_judge) << text;
  }
}

TEST(JudgeAChange, ARunThatFailedIsNotComparedWith) {
  const auto a = run(measured(1, 0.98, 1.02));
  auto b = run(measured(1, 0.98, 1.02));
  b.run.outcome = {};
  const auto judgement = judge(parse("p99 > +10%", Use::fail_if_compared), {&a}, {&b});
  EXPECT_EQ(judgement.result, Result::cannot_judge);
  EXPECT_THAT(judgement.says, HasSubstr("of B"));
}

}  // namespace
}  // namespace ontime::gate
