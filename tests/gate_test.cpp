// SPDX-License-Identifier: Apache-2.0
#include "gate/gate.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "amend.hpp"
#include "gate_runs.hpp"
#include "json.hpp"

namespace ontime::gate {
namespace {

using nlohmann::json;
using statistics::Measured;
using statistics::Summary;
using ::testing::HasSubstr;
using Result = Judgement::Result;

// --- what a run of this many milliseconds in p99 surely lies between comes to ---

TEST(Judge, AGateFailsOnlyIfTheIntervalExceedsTheLimit) {
  EXPECT_EQ(judged("p99 > 2 ms", run(measured(3, 2.5, 3.5))).result, Result::missed);
  EXPECT_EQ(judged("p99 > 2 ms", run(measured(1, 0.5, 1.5))).result, Result::held);
  const auto unsure = judged("p99 > 2 ms", run(measured(2.1, 1.9, 2.4)));
  EXPECT_EQ(unsure.result, Result::held);
  EXPECT_FALSE(unsure.is_sure);
  EXPECT_THAT(unsure.says, HasSubstr("to be certain"));
  EXPECT_TRUE(judged("p99 > 2 ms", run(measured(1, 0.5, 1.5))).is_sure);
}

TEST(Judge, NamesGateRunFigureAndInterval) {
  const auto missed = judged("p99 > 2 ms", run(measured(3, 2.5, 3.5)));
  EXPECT_EQ(text_of(missed),
            "FAIL: p99 <= 2 ms (Test1.B udp #2 (run 5)): p99 is 3 ms, 98 % interval [2.5 ms, 3.5 ms]");
  EXPECT_THAT(text_of(judged("p99 > 4 ms", run(measured(3, 2.5, 3.5)))),
              ::testing::StartsWith("ok: p99 <= 4 ms"));
  EXPECT_THAT(text_of(judged("p99 > 3 ms", run(measured(3.1, 2.5, 3.5)))),
              ::testing::StartsWith("ok, not certain: p99 <= 3 ms"));
  EXPECT_THAT(text_of(judged("p99 > 2 ms", {})), ::testing::StartsWith("open: p99 <= 2 ms"));
}

TEST(Judge, NameFromAForeignFileIsOneLine) {
  auto one = run(measured(3, 2.5, 3.5));
  one.run.asked.id = "a\n  sudo reboot\x1b[31m";
  EXPECT_THAT(text_of(judged("p99 > 2 ms", one)), HasSubstr("(a   sudo reboot?[31m udp #2 (run 5))"));
}

// Of so many answers so many are slower than 2 ms, and the p99 has no upper end.
Summary slower(std::uint64_t events, std::uint64_t answers, double effect = 1) {
  auto one = run(measured(1, 0.5, {}));
  one.sent = one.round_trip.count = answers;
  one.round_trip_certainty[statistics::Figure::p99].effect =
      one.round_trip_certainty[statistics::Figure::p99_9].effect = effect;
  one.round_trip_certainty.slowest_effect = effect;
  one.shape.round_trip_ranks = {{answers - events, 1'000'000}};
  if (events > 0) one.shape.round_trip_ranks.push_back({answers - events + 1, 3'000'000});
  return one;
}

TEST(Judge, ARunTooShortForThePercentileIsOpen) {
  const auto judgement = judged("p99 > 2 ms", slower(0, 200));
  EXPECT_EQ(judgement.result, Result::cannot_judge);
  EXPECT_THAT(judgement.says, HasSubstr("measure longer"));
  EXPECT_EQ(judged("p99 > 2 ms", run(measured(3, 2.5, {}))).result, Result::missed) << "sure enough";
}

TEST(Judge, ARunFailsIfEveryMessageIsSlowerDespiteADesignEffect) {
  auto all = slower(150, 150, 40);
  all.round_trip_certainty[statistics::Figure::p99].value = 3'100'000;
  all.round_trip_certainty[statistics::Figure::p99].sure =
      all.round_trip_certainty[statistics::Figure::p99].surer = {};
  EXPECT_EQ(judged("p99 > 2 ms", all).result, Result::missed);
}

// Of 20,000 between 10,000 and 10,225 are slower: whether the median is above the limit is not known.
TEST(Judge, APercentileFailsByTheLeastNumberOfSlowerMessages) {
  auto one = run({});
  one.round_trip.count = 20'000;
  one.round_trip_certainty[statistics::Figure::p50] = measured(2.01, 1.99, 2.03);
  one.shape.round_trip_ranks = {{9775, 1'990'000}, {10'001, 2'010'000}, {20'000, 3'000'000}};
  const auto judgement = judged("p50 > 2 ms", one);
  EXPECT_STREQ(word_of(judgement), "ok, not certain");
  EXPECT_THAT(judgement.says, HasSubstr("; 10,000 to 10,225 of 20,000 slower"));
  one.shape.round_trip_ranks[1].rank = 9800;
  EXPECT_EQ(judged("p50 > 2 ms", one).result, Result::missed) << "10,201 at least";
}

TEST(Judge, APercentileHoldsIfFewMessagesExceedTheLimit) {
  const auto none = judged("p99 > 2 ms", slower(0, 1500));
  EXPECT_EQ(none.result, Result::held);
  EXPECT_TRUE(none.is_sure);
  EXPECT_THAT(none.says, HasSubstr("0 of 1,500 slower"));
  const auto in_bursts = judged("p99 > 2 ms", slower(0, 1500, 5));
  EXPECT_EQ(in_bursts.result, Result::held) << "as of `late > 1%`: whether it can pass is not left to chance";
  EXPECT_FALSE(in_bursts.is_sure);
  EXPECT_TRUE(judged("p99 > 2 ms", slower(2, 1500)).is_sure);
  EXPECT_FALSE(judged("p99 > 2 ms", slower(14, 1500)).is_sure);
  EXPECT_EQ(judged("p99.9 > 2 ms", slower(0, 1500)).result, Result::cannot_judge) << "that takes 3,000";
}

TEST(Judge, UnknownLossOrLatenessIsOpen) {
  auto one = run(measured(1, 0.9, 1.1));
  one.run.asked.measures = "age";
  EXPECT_EQ(judged("lost > 0", one).result, Result::held);
  one.run.outcome.loss_unknown = true;
  EXPECT_EQ(judged("lost > 0", one).result, Result::cannot_judge);
  EXPECT_EQ(judged("lost > 1 %", one).result, Result::cannot_judge);
  one.run.asked.task.client.deadline = {};
  EXPECT_EQ(judged("late > 0", one).result, Result::cannot_judge) << "no limit was stated";
}

TEST(Judge, MessageWithoutAnAnswerIsLate) {
  auto one = run({}, 3);
  one.lost = 20;
  one.missed_probability.value = 0.023;
  one.missed_probability.surer = {0.014, 0.036};
  one.missed_probability.messages = 1000;
  one.late_probability.messages = 1000;
  EXPECT_EQ(judged("late > 22", one).says, "23 of 1,000 messages (20 had no answer)");
  EXPECT_EQ(judged("late > 22", one).result, Result::missed);
  EXPECT_EQ(judged("late > 23", one).result, Result::held);
  EXPECT_EQ(judged("late > 1 %", one).result, Result::missed);
  EXPECT_THAT(judged("late > 1 %", one).says, HasSubstr("2.3 % (20 had no answer)"));
  one.run.asked.task.client.deadline = std::chrono::milliseconds(10);
  one.run.asked.measures = "age";  // of a robot's topic each of both has its own count
  EXPECT_EQ(judged("late > 3", one).says, "3 of 1,000 messages");
}

TEST(Judge, MessageWithoutAnAnswerIsSlowerThanLimitsUpToItsTimeout) {
  auto one = slower(0, 1500);
  one.run.asked.task.client.timeout = std::chrono::milliseconds(500);
  one.sent = 1600;
  one.lost = 100;
  one.response = one.round_trip;
  one.response_certainty = one.round_trip_certainty;
  one.shape.response_ranks = one.shape.round_trip_ranks;
  for (const auto* text : {"p99 > 2 ms", "response p99 > 2 ms", "max > 500 ms"}) {
    const auto judgement = judged(text, one);
    EXPECT_EQ(judgement.result, Result::missed) << text;
    EXPECT_THAT(judgement.says, HasSubstr("100 of 1,600 slower (100 had no answer)")) << text;
  }
  for (const auto* text : {"p99 > 501 ms", "max > 2 s"}) {
    const auto judgement = judged(text, one);
    EXPECT_EQ(judgement.result, Result::held) << text;
    EXPECT_FALSE(judgement.is_sure) << text;
    EXPECT_THAT(judgement.says, HasSubstr("100 of 1,600 messages were lost")) << text;
  }
  auto silent = one;
  silent.lost = silent.sent;
  silent.round_trip = {};
  EXPECT_EQ(judged("max > 2 ms", silent).result, Result::missed);
  EXPECT_EQ(judged("max > 501 ms", silent).result, Result::cannot_judge);
  const auto half = judged("p50 > 2 ms", one);
  EXPECT_EQ(half.result, Result::held);
  EXPECT_TRUE(half.is_sure);
  one.round_trip_certainty.mean = measured(1, 0.9, 1.1);
  EXPECT_FALSE(judged("mean > 5 ms", one).is_sure);
}

TEST(Judge, AMeanBeyondTheLimitIsOpenIfItMayBeFarBeyond) {
  auto one = run(measured(1, 0.9, 1.1));
  one.round_trip_certainty.mean = measured(0.134, 0.006, 25);
  EXPECT_EQ(judged("mean > 10 us", one).result, Result::cannot_judge);
  EXPECT_EQ(judged("mean > 200 us", one).result, Result::held) << "it was measured below";
  one.round_trip_certainty.mean = measured(0.011, 0.009, 0.015);
  EXPECT_EQ(judged("mean > 10 us", one).result, Result::held) << "at most twice the limit";
}

TEST(Judge, AMaximumJustBeyondTheLimitHasTheDigitsThatShowIt) {
  auto one = run(measured(1, 0.9, 1.1));
  one.round_trip.max = 5'000'300;
  EXPECT_EQ(judged("max > 5 ms", one).says, "max is 5.0003 ms");
}

TEST(Judge, ALevelThatChangedIsNamed) {
  auto one = slower(0, 200);
  one.sent = 200;
  one.round_trip_certainty.shift = statistics::Shift{0.5, 150'000, 300'000, 100e9};
  EXPECT_THAT(judged("p99 > 2 ms", one).says, HasSubstr("the median rises from 150 µs to 300 µs at 100 s"));
  one.round_trip_certainty.shift = statistics::Shift{0.5, 160'000, 20'450'000, 100e9};
  EXPECT_THAT(statistics::shift_text(one), HasSubstr("rises from 160 µs to 20.45 ms"));
}

// `lost` of so many messages, evenly.
Summary losing(std::uint64_t lost, std::uint64_t messages, double effect_of_few = 1) {
  statistics::Batches batches;
  for (std::uint64_t i = 0; i < messages; ++i) batches.add(lost > 0 && i % (messages / lost) == 0);
  auto one = run(measured(1, 0.5, 1.5));
  one.lost_probability = statistics::probability(batches.all(), effect_of_few);
  return one;
}

TEST(Judge, ARunTooShortForAShareIsOpen) {
  const auto result = [](const Summary& of) { return judged("lost > 1%", of).result; };
  EXPECT_EQ(result(losing(2, 20)), Result::cannot_judge);
  EXPECT_EQ(result(losing(0, 20)), Result::cannot_judge) << "300 without a loss are needed";
  EXPECT_THAT(judged("lost > 1%", losing(0, 20)).says, HasSubstr("20 messages are"));
  EXPECT_THAT(judged("lost > 1%", losing(0, 1)).says, HasSubstr("1 message is"));
  EXPECT_EQ(result(losing(0, 1000)), Result::held);
  EXPECT_EQ(result(losing(0, 1000, 20)), Result::held) << "what it can hold hangs on no chance";
  EXPECT_EQ(result(losing(1, 1000, 20)), Result::cannot_judge) << "as many as 50";
  EXPECT_EQ(result(losing(12, 1200)), Result::held) << "it is long enough, and it cannot be told";
  EXPECT_EQ(result(losing(10, 20)), Result::missed) << "sure enough";
}

TEST(Judge, CountsAndMaximaAreComparedWithoutAnInterval) {
  EXPECT_EQ(judged("late > 0", run({}, 1)).result, Result::missed);
  EXPECT_EQ(judged("late > 0", run({}, 0)).result, Result::held);
  EXPECT_EQ(judged("late > 1", run({}, 1)).result, Result::held);
  EXPECT_EQ(judged("max > 5 ms", run({})).result, Result::missed);
  EXPECT_EQ(judged("max > 7 ms", run({})).result, Result::held);
  EXPECT_EQ(judged("response late > 0", run({})).result, Result::cannot_judge)
      << "nothing is known of a deadline";
  auto stalled = run({});
  stalled.skipped_cycles = 299;
  stalled.late_by_response = 300;
  EXPECT_EQ(judged("response late > 0", stalled).says, "300 of 1,299 cycles");
  const auto held = judged("late > 0", stalled);
  EXPECT_EQ(held.result, Result::held);
  EXPECT_FALSE(held.is_sure);
  EXPECT_THAT(held.says, HasSubstr("300 of 1,299 cycles"));
  EXPECT_FALSE(judged("max > 7 ms", stalled).is_sure);
  EXPECT_THAT(judged("max > 7 ms", stalled).says, HasSubstr("response max"));
}

TEST(Judge, UnmeasuredRunsAreOpen) {
  for (const auto& outcome : {json(), json{{"interrupted", true}}, json{{"error", "no pong"}},
                              json{{"interrupted", false}, {"dropped_records", 3}}}) {
    auto cut_off = run(measured(1, 0.5, 1.5));
    cut_off.run.outcome = outcome;
    for (const auto* gate : {"late > 0", "p99 > 2 ms", "max > 9 ms"})
      EXPECT_EQ(judged(gate, cut_off).result, Result::cannot_judge) << outcome << gate;
  }
  auto incomplete = run({});
  for (const auto& [count, says] : {std::pair(1, "1 of its samples was"), {3, "3 of its samples were"}}) {
    incomplete.run.outcome = json{{"interrupted", false}, {"dropped_records", count}};
    EXPECT_THAT(judged("late > 0", incomplete).says, HasSubstr(says));
  }
  auto silent = run({});
  silent.sent = 0;
  EXPECT_EQ(judged("lost > 0", silent).result, Result::cannot_judge);
  auto imported = run({});
  imported.imported.emplace();
  EXPECT_EQ(judged("late > 0", imported).result, Result::cannot_judge);
}

TEST(Judge, OfAnImportedRunTheMaximumIsJudgedAndOtherGatesAreNamedOpen) {
  auto imported = run({});
  imported.imported.emplace();
  imported.sent = 0;
  imported.wake_up.count = 1000;
  imported.wake_up.max = 99'000;
  EXPECT_EQ(text_of(judged("max > 50 us", imported)),
            "FAIL: max <= 50 us (Test1.B udp #2 (run 5)): max wake-up latency is 99 µs");
  EXPECT_EQ(judged("max > 100 us", imported).result, Result::held);
  EXPECT_EQ(judged("response max > 100 us", imported).result, Result::cannot_judge);
  const std::vector gates{parse("p99 > 50 us", Use::fail_if), parse("max > 50 us", Use::fail_if)};
  const auto all = judge_all(gates, imported);
  ASSERT_EQ(all.size(), 2U);
  EXPECT_EQ(all[0].gate, "p99 <= 50 us");
  EXPECT_EQ(all[0].result, Result::cannot_judge);
  EXPECT_THAT(all[0].says, HasSubstr("no order in time, so only max is judged. Fix: limit max"));
  EXPECT_EQ(all[1].result, Result::missed);
  EXPECT_EQ(judge_as_asked(imported).result, Result::held) << "nothing was requested of it";
}

TEST(EndsSearch, AtMissesAndAtShortfalls) {
  const json asked{{"link", {{"loss", 0.01}}}, {"search", {{"step", 1}}}};
  for (const auto* what :
       {R"({"late": 1})", R"({"lost": 1})", R"({"skipped_cycles": 1})",
        R"({"sent": 9, "late_by_response_only": 1})", R"({"late": "x"})", R"({"sent": 0})",
        R"({"dropped_records": 1})", R"({"neighbours": {"to_component": {"short": true}}})",
        R"({"traffic": {"to_controller": {"short": true}}})",
        R"({"hosts": {"component": {"load_running": false}}})",
        R"({"hosts": {"controller": {"link": {"gone": "the table"}}}})",
        R"({"error": "no answer", "unanswered": true})"})
    EXPECT_TRUE(ends_search(asked, parsed_json(what))) << what;
  for (const auto* what :
       {R"({"sent": 9, "late": 0, "lost": 0, "skipped_cycles": 0, "dropped_records": 0})",
        R"({"sent": 9, "late": 0, "traffic": {"to_component": {}}, "hosts": 1})",
        R"({"sent": 9, "neighbours": {"to_component": {"short": false}}})",
        R"({"late": 1, "interrupted": true})", R"({"error": "the connection is gone", "late": 1})",
        R"({"error": "no answer", "unanswered": true, "interrupted": true})", "null"})
    EXPECT_FALSE(ends_search(asked, parsed_json(what))) << what;
}

TEST(EndsSearch, UnansweredEndsOnlyAfterAnAnswer) {
  const json unanswered{{"error", "no answer"}, {"unanswered", true}};
  EXPECT_FALSE(ends_search(json{{"search", {{"step", 0}}}}, unanswered))
      << "nor would there be an answer at another value";
  EXPECT_FALSE(ends_search(json{{"search", nullptr}}, unanswered)) << "a run that is no step of one";
}

TEST(Judge, ARunWithoutItsRequestedConditionsIsOpen) {
  auto idle = run(measured(1, 0.5, 1.5));
  amend(idle.run.outcome, "/hosts/component", {{"load_running", false}});
  EXPECT_THAT(judged("p99 > 2 ms", idle).says, HasSubstr("load on the component"));
  EXPECT_EQ(judged("late > 0", idle).result, Result::cannot_judge);
  amend(idle.run.outcome, "/hosts/component/load_running", nullptr);  // none was asked for
  EXPECT_EQ(judged("p99 > 2 ms", idle).result, Result::held);
  amend(idle.run.outcome, "/traffic",
        {{"to_component", {{"short", false}}}, {"to_controller", {{"short", true}}}});
  EXPECT_THAT(judged("p99 > 2 ms", idle).says, HasSubstr("traffic"));
  EXPECT_EQ(judged("late > 0", idle).result, Result::cannot_judge);
  auto tuned = run(measured(1, 0.5, 1.5));
  auto& set = tuned.run.outcome.hosts["controller"].kernel;
  set = {{"irq-threads", "irq/1", "fifo 50", "fifo 90", "fifo 90"}};
  EXPECT_EQ(judged("p99 > 2 ms", tuned).result, Result::held);
  for (const auto& now : {json("other"), json()}) {
    set[0].now = now;
    EXPECT_EQ(judged("p99 > 2 ms", tuned).result, Result::cannot_judge);
    EXPECT_THAT(judged("late > 0", tuned).says, HasSubstr("kernel.irq-threads on the controller"));
  }
  auto whole = run(measured(1, 0.5, 1.5));
  amend(whole.run.outcome, "/hosts/component/link/gone", "another process removed the rules");
  EXPECT_EQ(judged("p99 > 2 ms", whole).result, Result::held) << "there were to be no faults";
  amend(whole.run.asked, "/link", {{"loss", 0.1}});
  EXPECT_EQ(judged("p99 > 2 ms", whole).result, Result::cannot_judge);
}

TEST(Judge, DeniedSettingsAndSmallerLoadAreOpen) {
  auto denied = run(measured(1, 0.5, 1.5));
  denied.run.outcome.counters.sent = 1000;
  denied.run.outcome.hosts["controller"].refusals = {{"lock memory", "EPERM", ""}, {"fifo 80", "EPERM", ""}};
  denied.run.outcome.hosts["component"].refusals = {{"lock memory", "EPERM", ""}};
  EXPECT_EQ(judged("p99 > 2 ms", denied).result, Result::cannot_judge);
  EXPECT_EQ(judged("late > 0", denied).says, "denied: lock memory, fifo 80");
  EXPECT_EQ(judge_as_asked(denied).result, Result::cannot_judge);
  EXPECT_FALSE(ends_search(denied.run.asked, denied.run.outcome)) << "it is denied at every step";
  auto small = run(measured(1, 0.5, 1.5));
  small.run.outcome.counters.sent = 1000;
  auto& load = small.run.outcome.hosts["component"].load;
  load = {{}, {}, 1 << 30, 1'000'000};
  EXPECT_THAT(judged("p99 > 2 ms", small).says, HasSubstr("hdd load on the component"));
  EXPECT_TRUE(ends_search(small.run.asked, small.run.outcome))
      << "a step that was never there was not passed";
  load->hdd_file_bytes = 1 << 29;
  EXPECT_EQ(judged("p99 > 2 ms", small).result, Result::held);
  load.reset();
  small.run.outcome.hosts["component"].load_running = true;
  amend(small.run.asked, "/load/component", {{"vm", 4}, {"vm_bytes", 256 << 20}});
  EXPECT_THAT(judged("p99 > 2 ms", small).says, HasSubstr("vm load on the component"));
}

TEST(Judge, RequiredGatesAreJudged) {
  auto of = run(measured(3, 2.5, 3.5), 1);
  amend(of.run.asked, "/require", {"p99 <= 2 ms", "late <= 1", "what is this", 7});
  const auto judgements = judge_all({}, of);
  ASSERT_EQ(judgements.size(), 4U);
  EXPECT_EQ(judgements[0].result, Result::missed);
  EXPECT_EQ(judgements[1].result, Result::held);
  EXPECT_EQ(judgements[2].result, Result::cannot_judge) << "it is no gate";
  EXPECT_EQ(judgements[2].gate, "\"what is this\"");
  EXPECT_EQ(judgements[3].gate, "7");
  amend(of.run.asked, "/require", nullptr);
  EXPECT_TRUE(judge_all({}, of).empty());
  amend(of.run.asked, "/require", "p99 <= 2 ms");
  EXPECT_EQ(judge_all({}, of).at(0).result, Result::missed);
  of.run.asked = json("text");
  EXPECT_TRUE(judge_all({}, of).empty());
}

TEST(Judge, ARunThatFailedIsJudgedOnce) {
  auto failed = run(measured(3, 2.5, 3.5));
  amend(failed.run.asked, "/require", {"p99 <= 2 ms", "late <= 1"});
  failed.run.outcome = json{{"error", "no pong"}};
  const std::vector gates = {parse("max > 5 ms", Use::fail_if)};
  const auto judgements = judge_all(gates, failed);
  ASSERT_EQ(judgements.size(), 1U);
  EXPECT_EQ(judgements[0].result, Result::cannot_judge);
  EXPECT_EQ(judgements[0].gate, as_asked);
  EXPECT_THAT(judgements[0].says, HasSubstr("no pong"));
  EXPECT_EQ(judge_all(gates, run(measured(3, 2.5, 3.5))).size(), 1U);
  amend(failed.run.asked, "/require", nullptr);
  EXPECT_TRUE(judge_all({}, failed).empty()) << "no gate was asked for";
  EXPECT_EQ(judge_as_asked(run({})).result, Result::held);
}

TEST(Judge, ARunThatALaterOneRepeatsIsSuperseded) {
  const auto at = [](std::int64_t number, const char* key, int repetition, const json& outcome) {
    auto of = run({});
    of.run.number = number;
    of.run.key = key;
    amend(of.run.asked, "/repetition", repetition);
    of.run.outcome = outcome;
    return of;
  };
  const json complete = {{"interrupted", false}}, interrupted = {{"interrupted", true}};
  const std::vector<Summary> all = {at(1, "a", 1, interrupted), at(2, "a", 2, json()),
                                    at(3, "b", 1, interrupted), at(4, "a", 1, {{"error", "no pong"}}),
                                    at(5, "a", 1, complete),    at(6, "a", 1, interrupted),
                                    at(7, "", 1, interrupted),  at(8, "", 1, complete)};
  const auto is_superseded = [&](std::size_t number) { return gate::is_superseded(all[number - 1], all); };
  EXPECT_TRUE(is_superseded(1));
  EXPECT_FALSE(is_superseded(2)) << "of that repetition there is no other";
  EXPECT_FALSE(is_superseded(3)) << "under those conditions there is no other";
  EXPECT_TRUE(is_superseded(4));
  EXPECT_FALSE(is_superseded(5)) << "it was measured to its end";
  EXPECT_FALSE(is_superseded(6)) << "it is the last";
  EXPECT_FALSE(is_superseded(7)) << "its conditions are not known";
}

// --- against another run ---

}  // namespace
}  // namespace ontime::gate
