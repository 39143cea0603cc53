// SPDX-License-Identifier: Apache-2.0
#include "gate/gate.hpp"
#include "json.hpp"
#include "report/answer_entries.hpp"
#include "report_answers.hpp"

namespace ontime::report {
namespace {

using ::testing::AllOf;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::EndsWith;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using ::testing::StartsWith;
using State = Answer::State;

TEST(Answer, OppositeConditionsAreNeverPooled) {
  const auto answer = answer_of(demo(), kept);
  // "with real-time settings 0 %" would contradict a late row of "idle, RT"
  EXPECT_EQ(
      answer.sentence,
      "Under load 24 to 28 % of the cycles had no answer within 10 ms; under load with real-time settings "
      "0 %.");
  EXPECT_EQ(answer.conditions, "500 B every 10 ms, 20 s a run");
  ASSERT_EQ(answer.rows.size(), 12u);
  EXPECT_EQ(answer.rows[3].conditions, "load");
  EXPECT_EQ(answer.rows[3].state, State::late);
  EXPECT_EQ(answer.rows[11].conditions, "load, RT");
  EXPECT_EQ(answer.rows[11].state, State::ok);
  EXPECT_THAT(commands_of(answer), ElementsAre("ontime run scenarios/demo.yaml --only Test1.B --explain",
                                               "ontime compare demo.ontime --from Test1.B --to Test1.D",
                                               "ontime report demo.ontime --full"));
}

TEST(Answer, TwelveRunsFitTheScreen) {
  const auto lines = lines_of(text_of(answer_of(demo(), kept), 80));
  EXPECT_LE(lines.size(), screen_lines);
  for (const auto& line : lines) EXPECT_LE(width_of(line), 80u) << line;
  EXPECT_THAT(lines, Contains(AllOf(StartsWith("Test1.B load"), HasSubstr("480 (24 %)"), HasSubstr("LATE"))));
  EXPECT_THAT(lines, Contains(HasSubstr("of 2,000")));
}

TEST(Answer, CautionIsCutOnlyWhereRowsNeedTheLines) {
  std::string words = "no permission";
  for (int i = 0; i < 40; ++i) words += " word" + std::to_string(i);
  auto one = run(1, "a", "udp", {});
  one.notes = {{"peer-left", words + " FIX", {}, {}}};
  EXPECT_THAT(text_of(answer_of({one}, kept), 80), HasSubstr("FIX"));
  auto runs = demo();
  runs[0].notes = one.notes;
  const auto lines = lines_of(text_of(answer_of(runs, kept), 80));
  EXPECT_LE(lines.size(), screen_lines);
  EXPECT_THAT(lines, Contains(StartsWith("Test1.D")));
  EXPECT_THAT(lines, Not(Contains(HasSubstr("FIX"))));
}

TEST(Answer, RowsThatFitAreNotLeftOutForCautions) {
  std::string words = "no permission";
  for (int i = 0; i < 40; ++i) words += " word" + std::to_string(i);
  auto runs = demo();
  for (std::size_t i = 0; i < 3; ++i) runs[i].notes = {{"peer-left", std::to_string(i) + words, {}, {}}};
  const auto lines = lines_of(text_of(answer_of(runs, kept), 80));
  EXPECT_LE(lines.size(), screen_lines);
  EXPECT_EQ(std::ranges::count_if(lines, [](const auto& line) { return line.ends_with("ok"); }), 9);
  EXPECT_EQ(std::ranges::count_if(lines, [](const auto& line) { return line.starts_with("Caution"); }), 3);
}

TEST(Answer, WideLettersTakeTwoColumns) {
  EXPECT_EQ(width_of("ロボットa"), 9u);
  EXPECT_EQ(width_of("µs ≥…"), 5u);
  EXPECT_EQ(table::shortened("ロボットa", 5), "ロボ…");
  EXPECT_EQ(table::shortened("ロボットa", 9), "ロボットa");
  std::vector runs{run(1, "ロボットの腕の検査", "udp", {}), run(2, "arm", "udp", {})};
  const auto lines = lines_of(text_of(answer_of(runs, kept), 80));
  std::vector<std::size_t> widths;
  for (const auto& line : lines)
    if (line.ends_with("  ok")) widths.push_back(width_of(line));
  EXPECT_THAT(widths, ElementsAre(widths.at(0), widths.at(0)));
}

TEST(Answer, MoreRunsThanFitLeaveTheWorstAndTheirNumber) {
  std::vector<Summary> runs;
  for (int i = 1; i <= 60; ++i) runs.push_back(run(i, "run" + std::to_string(i), "udp", {}, i == 47 ? 9 : 0));
  const auto text = text_of(answer_of(runs, kept), 80);
  EXPECT_LE(lines_of(text).size(), screen_lines);
  EXPECT_THAT(text, AllOf(HasSubstr("run47"), HasSubstr("more rows, none worse\n")));
  for (auto& one : runs) one.late = *one.late_by_response = 9;
  EXPECT_THAT(text_of(answer_of(runs, kept), 80),
              HasSubstr("… and 44 more rows, none worse, but 44 not ok\n"));
}

TEST(Answer, ANarrowTerminalDropsColumnsAndKeepsTheVerdict) {
  for (const std::size_t width : {40u, 60u, 200u}) {
    const auto text = text_of(answer_of(demo(), kept), width);
    EXPECT_THAT(text, HasSubstr("LATE")) << width;
    for (const auto& line : lines_of(text))
      EXPECT_TRUE(width_of(line) <= width || line.find("ontime ") != line.npos) << line;
  }
}

TEST(Answer, RepetitionsAreOneRowWithTheirSpread) {
  std::vector<Summary> runs;
  for (int i = 1; i <= 5; ++i) {
    runs.push_back(run(i, "a", "udp", {}, i == 5 ? 3 : 0, i));
    runs.back().round_trip[statistics::Figure::p99] = i * 1000 * 1000;
  }
  const auto answer = answer_of(runs, kept);
  ASSERT_EQ(answer.rows.size(), 1u);
  const auto& row = answer.rows.front();
  EXPECT_EQ(row.name, "udp ×5");
  EXPECT_EQ(row.cycles, 10'000u);
  EXPECT_EQ(row.missed, 3u);
  EXPECT_EQ(row.state, State::late);
  EXPECT_EQ(row.p99->low_ns, 1.0 * ms);
  EXPECT_EQ(row.p99->median_ns, 3.0 * ms);
  EXPECT_EQ(row.p99->high_ns, 5.0 * ms);
  EXPECT_THAT(text_of(answer, 80), HasSubstr("1.0–5.0"));
}

TEST(Answer, RepetitionWithTooFewAnswersForP99LeavesItOpen) {
  std::vector runs{run(1, "a", "udp", {}, 0, 1), run(2, "a", "udp", {}, 40, 2)};
  runs[1].sent = 100;
  runs[1].round_trip.count = 99;
  const auto row = answer_of(runs, kept).rows.front();
  EXPECT_FALSE(row.p99);
  EXPECT_TRUE(row.p50);
  EXPECT_TRUE(row.max_ns);
  amend(runs[1].run.outcome, "/interrupted", true);
  EXPECT_TRUE(answer_of(runs, kept).rows.front().p99) << "it was cut off, so few answers tell nothing";
}

TEST(Answer, RowThatIsNotAsRequestedIsNoPartOfAll) {
  std::vector runs{run(1, "a", "udp", {}), run(2, "b", "udp", {}, 200)};
  runs[1].run.outcome = {};
  EXPECT_EQ(answer_of(runs, kept).sentence,
            "2,000 cycles had an answer within 10 ms. 1 of 2 rows was not measured as requested: 200 of its "
            "2,000 cycles had no answer in time.");
  amend(runs[0].run.asked, "/load", {{"controller", {{"cpu", 1}}}});
  runs.push_back(run(3, "c", "udp", {}));
  EXPECT_EQ(answer_of(runs, kept).sentence,
            "The cycles had an answer within 10 ms, under each of 2 conditions. 1 of 3 rows was not measured "
            "as requested: 200 of its 2,000 cycles had no answer in time.");
  runs[1].late = *runs[1].late_by_response = 0;
  EXPECT_THAT(answer_of(runs, kept).sentence, EndsWith("1 of 3 rows was not measured as requested."));
}

TEST(Answer, RepetitionsOfAnUnfitRowThatAreAsRequestedCount) {
  std::vector runs{run(1, "a", "udp", {}, 0, 1), run(2, "a", "udp", {}, 0, 2)};
  amend(runs[1].run.outcome, "/interrupted", true);
  EXPECT_THAT(answer_of(runs, kept).sentence, EndsWith(" 1 of 2 runs was not measured as requested."));
  amend(runs[0].run.outcome, "/interrupted", true);
  EXPECT_THAT(answer_of(runs, kept).sentence, EndsWith(" No run was measured as requested."));
}

TEST(Answer, DeniedSettingsAreNoVerdictOnThem) {
  auto one = run(1, "a", "udp", {false, true});
  amend(one.run.outcome, "/hosts/controller/refusals",
        {{{"asked", "SCHED_FIFO 80 for thread send"},
          {"found", "Operation not permitted"},
          {"remedy", "run as root"}}});
  const auto answer = answer_of({one}, {.file = "r.ontime", .is_own = true});
  EXPECT_EQ(answer.rows.front().state, State::not_applied);
  EXPECT_THAT(answer.sentence, HasSubstr("No run was measured as requested"));
  EXPECT_THAT(answer.cautions, Contains(HasSubstr("denied: SCHED_FIFO 80 for thread send")));
  EXPECT_THAT(commands_of(answer), Contains("sudo ontime run scenarios/demo.yaml"));
}

TEST(Answer, AFailedRunIsNamedWithItsError) {
  auto failed = run(2, "b", "udp", {});
  failed = summary(failed.run.asked.document, {{"error", "no peer found"}}, 0);
  amend(failed.run.asked, "/scenario_file", "demo.yaml");
  const auto answer = answer_of({failed}, kept);
  EXPECT_EQ(answer.rows.front().state, State::failed);
  EXPECT_THAT(answer.sentence, HasSubstr("Nothing was measured."));
  EXPECT_THAT(answer.cautions, Contains(HasSubstr("failed: no peer found")));
  EXPECT_THAT(commands_of(answer), Contains(HasSubstr("--resume --results demo.ontime")));
}

TEST(Answer, FileWithoutSamplesIsNoSuccess) {
  auto one = summary(asked("a", "udp"), outcome(), 0);
  amend(one.run.outcome, "/dropped_records", 2000);
  const auto answer = answer_of({one}, kept);
  EXPECT_EQ(answer.sentence, "No sample was recorded of 2,000 cycles.");
  amend(one.run.outcome, "/dropped_records", 1);
  amend(one.run.outcome, "/sent", 1);
  EXPECT_EQ(answer_of({one}, kept).sentence, "No sample was recorded of 1 cycle.");
  EXPECT_EQ(answer.rows.front().state, State::not_applied);
}

TEST(Answer, MissingDeadlineIsNamed) {
  auto one = run(1, "a", "udp", {});
  one.run.asked.task.client.deadline = {};
  EXPECT_EQ(answer_of({one}, kept).sentence, "All 2,000 cycles had an answer (no deadline set).");
}

TEST(Answer, EmptyPayloadIsShownAndAnUnknownOneIsNot) {
  auto one = run(1, "a", "udp", {});
  amend(one.run.asked, "/payload_bytes", 0);
  EXPECT_EQ(answer_of({one}, kept).conditions, "0 B every 10 ms, 20 s a run");
  amend(one.run.asked, "/payload_bytes", nullptr);
  EXPECT_EQ(answer_of({one}, kept).conditions, "every 10 ms, 20 s a run");
}

TEST(Answer, AShareOfOneInAMillionIsNotPrintedAsNone) {
  auto one = run(1, "a", "udp", {}, 1);
  one.sent = 1'000'000;
  const auto text = text_of(answer_of({one}, kept), 80);
  EXPECT_THAT(text, HasSubstr("1 (0.0001 %)"));
  one.sent = 20'000'000;
  EXPECT_THAT(text_of(answer_of({one}, kept), 80), HasSubstr("0.000005 % of the cycles"));
}

TEST(Answer, AShareOfNearlyAllIsNotPrintedAsAll) {
  auto one = run(1, "a", "udp", {}, 1999);
  one.sent = 2000;
  const auto text = text_of(answer_of({one}, kept), 80);
  EXPECT_THAT(text, HasSubstr("1,999 (99.95 %)"));
  EXPECT_THAT(text, HasSubstr("99.95 % of the cycles"));
}

TEST(Answer, APercentileBeyondAnImportedHistogramIsALowerBound) {
  auto one = run(1, "a", "", {});
  one.imported.emplace();
  one.imported->beyond = 100;
  const auto answer = answer_of({one}, kept);
  EXPECT_FALSE(answer.rows.front().p50->is_least);
  EXPECT_TRUE(answer.rows.front().p99->is_least);
  EXPECT_THAT(text_of(answer, 80), HasSubstr("≥ 2.0"));
  EXPECT_THAT(text_of(answer, 80), HasSubstr("wake-up latencies in ms"));
  EXPECT_TRUE(json_of(answer).at("rows").at(0).at("p99_ms").is_null());
}

TEST(Answer, CyclesWithoutAMessageCountAsNotInTime) {
  auto one = run(1, "a", "udp", {});
  one.skipped_cycles = 500;
  one.late_by_response = 600;
  const auto row = answer_of({one}, kept).rows.front();
  EXPECT_EQ(row.cycles, 2500u);
  EXPECT_EQ(row.missed, 600u);
  EXPECT_EQ(row.state, State::late);
}

TEST(Answer, CyclesWithoutAMessageHadNoAnswerOfTheirOwn) {
  auto one = run(1, "a", "udp", {});  // a period of 10 us, a deadline of 10 ms: each wait ends in time
  one.skipped_cycles = 8000;
  const auto answer = answer_of({one}, kept);
  EXPECT_EQ(answer.sentence,
            "All messages had an answer within 10 ms, but 8,000 of 10,000 cycles had no message.");
  EXPECT_THAT(answer.cautions, Contains(HasSubstr("skipped cycles: 8,000")));
  one.skipped_cycles = 5;
  EXPECT_THAT(answer_of({one}, kept).cautions, Not(Contains(HasSubstr("skipped cycles")))) << "of a stall";
}

TEST(Answer, WorstWaitThatNoAnswerEndedIsOpen) {
  auto one = run(1, "a", "udp", {}, 1);
  one.response.max = one.open_wait_ns = 530 * ms;
  for (const auto lost : {0U, 1U}) {  // of a time-out of 500 ms
    one.lost = lost;
    const auto row = answer_of({one}, kept).rows.front();
    EXPECT_EQ(row.worst_wait_ns, 530.0 * ms);
    EXPECT_TRUE(row.is_open);
  }
}

TEST(Answer, ALostMessageWithoutASampleWaitedAtLeastTheTimeOut) {
  auto one = run(1, "a", "udp", {}, 1);
  one.late = 0;
  amend(one.run.outcome, {{"lost", 1}, {"dropped_records", 1}});
  const auto answer = answer_of({one}, kept);
  EXPECT_EQ(answer.rows.front().worst_wait_ns, 500.0 * ms);
  EXPECT_TRUE(answer.rows.front().is_open);
  EXPECT_THAT(text_of(answer, 80), HasSubstr("≥ 500"));
}

TEST(Answer, CautionsAreSaidOnceAndTheGravestFirst) {
  auto runs = demo();
  double stolen = 0.01;
  for (auto& one : runs) {
    for (const auto* host : {"controller", "component"}) {
      amend(one.run.outcome, std::string("/conditions/") + host + "/cpu_stolen", stolen);
      amend(one.run.outcome, std::string("/hosts/") + host + "/machine/boot_id", "b");
    }
    stolen += 0.005;
  }
  amend(runs[4].run.outcome, "/hosts/controller/load_running", false);
  const auto answer = answer_of(runs, kept);
  EXPECT_THAT(answer.cautions.front(),
              AllOf(HasSubstr("Test1.B cyclonedds: "), HasSubstr("load on the controller")));
  EXPECT_THAT(answer.cautions, Contains(AllOf(HasSubstr("1 % to 6.5 %"), HasSubstr("of CPU time (steal)"))));
  EXPECT_EQ(answer.rows[4].state, State::not_applied);
}

TEST(Answer, CautionNamesWholeConditionsAndCountsManyRows) {
  const auto stolen_from = [](std::initializer_list<std::size_t> rows) {
    auto runs = demo();
    for (const auto i : rows)
      for (const auto* host : {"controller", "component"}) {
        amend(runs[i].run.outcome, std::string("/conditions/") + host + "/cpu_stolen", 0.05);
        amend(runs[i].run.outcome, std::string("/hosts/") + host + "/machine/boot_id", "b");
      }
    return text_of(answer_of(runs, kept), 80);
  };
  const std::string what = ": the hypervisor took 5 % of CPU time (steal)\n";
  EXPECT_THAT(stolen_from({3, 4, 5}), HasSubstr("\nCaution: Test1.B" + what));
  EXPECT_THAT(stolen_from({0, 1, 2, 3}), HasSubstr("\nCaution: Test1.A, Test1.B udp" + what));
  EXPECT_THAT(stolen_from({0, 3, 4, 7}), HasSubstr("\nCaution: 4 of 12 rows" + what));
}

TEST(Answer, MissedRequirementIsInTheSentenceAndTheFirstCaution) {
  std::vector runs{run(1, "a", "udp", {}, 2), run(2, "b", "udp", {})};
  EXPECT_THAT(answer_of(runs, kept).sentence, Not(HasSubstr("requirement")));
  amend(runs[0].run.outcome, "/hosts/controller/load_running", false);
  runs[0].notes.assign(5, {"peer-left", "the pong left", {}, {}});
  runs[0].notes.push_back({gate::missed_note, "FAIL: late <= 0: 2 of 2000 messages", {}, {}});
  runs[0].notes.push_back({gate::missed_note, "FAIL: p99 <= 1 us: p99 is 2 ms", {}, {}});
  auto answer = answer_of(runs, kept);
  EXPECT_THAT(answer.sentence, HasSubstr(" 1 of 2 runs missed a requirement."));
  ASSERT_GE(answer.cautions.size(), 4u);
  EXPECT_THAT(answer.cautions[0], HasSubstr("a udp: FAIL: late <= 0"));
  EXPECT_THAT(answer.cautions[1], HasSubstr("a udp: FAIL: p99 <= 1 us"));
  EXPECT_THAT(answer.cautions[2], HasSubstr("load on the controller"));
  EXPECT_THAT(answer_of({runs[0]}, kept).sentence, HasSubstr(" A requirement was missed."));
}

TEST(Answer, ManyMissedRequirementsAreOneCaution) {
  std::vector runs{run(1, "a", "udp", {}), run(2, "b", "udp", {}), run(3, "c", "udp", {})};
  for (auto& one : runs)
    one.notes.push_back(
        {gate::missed_note, fmt::format("FAIL: p99 <= 1 ms: p99 is {} ms", one.run.number + 1), {}, {}});
  const auto answer = answer_of(runs, kept);
  EXPECT_THAT(answer.cautions[0],
              HasSubstr("missed requirements in 3 runs, such as a udp (run 1): p99 <= 1 ms: p99 is 2 ms"));
  EXPECT_THAT(answer.cautions, Not(Contains(HasSubstr("p99 is 3 ms"))));
}

TEST(Answer, CautionsWithoutSpaceAreCounted) {
  auto one = run(1, "a", "udp", {});
  for (const auto* const text : {"x", "y", "z", "q"}) one.notes.push_back({"some", text, {}, {}});
  const auto answer = answer_of({one}, kept);
  EXPECT_THAT(text_of(answer, 80),
              HasSubstr(fmt::format("… and {} more cautions (--full)", answer.cautions.size() - 3)));
}

TEST(Answer, MissedRequirementsComeBeforeOpenOnesWhichAreOneCaution) {
  std::vector runs{run(1, "a", "udp", {}), run(2, "b", "udp", {}), run(3, "c", "udp", {})};
  runs[0].notes.push_back({gate::open_note, "open: p99 <= 5 ms: 100 messages", {}, {}});
  runs[1].notes.push_back({gate::open_note, "open: p99 <= 5 ms: 101 messages", {}, {}});
  runs[2].notes.push_back({gate::open_note, "open: p99 <= 5 ms: 102 messages", {}, {}});
  runs[2].notes.push_back({gate::missed_note, "FAIL: lost <= 0", {}, {}});
  const auto answer = answer_of(runs, kept);
  EXPECT_THAT(answer.cautions[0], HasSubstr("FAIL: lost <= 0"));
  EXPECT_THAT(answer.cautions[1], AllOf(HasSubstr("in 3 runs"), HasSubstr("p99 <= 5 ms: 100 messages")));
  EXPECT_THAT(answer.cautions, Not(Contains(HasSubstr("101 messages"))));
  const auto rows = json_of(answer).at("rows");
  EXPECT_EQ(rows.at(0).at("requirement"), "open");
  EXPECT_EQ(rows.at(2).at("requirement"), "FAIL");
  EXPECT_EQ(rows.at(2).at("state"), "ok");
  EXPECT_THAT(text_of(answer, 80), AllOf(HasSubstr("  open\n"), HasSubstr("  FAIL\n")));
}

TEST(Answer, NamesThatTellRowsApartAreNotCut) {
  std::vector<Summary> runs;
  for (const int payload : {100, 10'000})
    for (const auto* component : {"arm", "base"}) {
      runs.push_back(run(std::ssize(runs) + 1, "a-rather-long-name-for-a-condition", "cyclonedds", {}));
      amend(runs.back().run.asked, {{"payload_bytes", payload}, {"variant", component}});
    }
  const auto text = text_of(answer_of(runs, kept), 80);
  for (const auto* name : {"100 B arm", "100 B base", "10000 B arm", "10000 B base"})
    EXPECT_THAT(text, HasSubstr(name));
  EXPECT_THAT(text, HasSubstr("\na-rather-long-name-for-a-condition"));
}

TEST(Answer, SentenceNamesTheStressThatOtherRunsLack) {
  std::vector runs{run(1, "a", "udp", {}, 200), run(2, "b", "udp", {})};
  amend(runs[0].run.asked, "/link/loss", 0.2);
  EXPECT_THAT(answer_of(runs, kept).sentence,
              AllOf(StartsWith("With link faults"), HasSubstr("without link faults")));
}

TEST(Answer, ContrastLacksWhatEachOtherRunHas) {
  std::vector runs{run(1, "a", "udp", {}, 200), run(2, "b", "udp", {}), run(3, "c", "udp", {true}, 100)};
  amend(runs[0].run.asked, "/link/loss", 0.2);
  EXPECT_THAT(answer_of(runs, kept).sentence,
              AllOf(StartsWith("With link faults"), HasSubstr("; without link faults or load 0 %")));
}

TEST(Answer, MarkedPacketsAndLimitsOfTheLoadAreSettings) {
  for (const auto& [place, value, words] : {std::tuple("/link/message_priority", json(6), "traffic control"),
                                            {"/link/qdisc", "prio bands 3", "traffic control"},
                                            {"/link/dscp", 46, "DSCP"},
                                            {"/isolation/load_quota", 0.3, "load limits"},
                                            {"/isolation/load_weight", 20, "load limits"},
                                            {"/isolation/cpus", "1", "reserved CPUs"}}) {
    auto one = run(1, "a", "udp", {});
    amend(one.run.asked, place, value);
    const auto regime = regime_of(one);
    EXPECT_THAT(regime.stress, ::testing::IsEmpty()) << place;
    EXPECT_THAT(regime.tuned, ::testing::ElementsAre(words));
  }
}

// {load, real-time settings}
TEST(Answer, SentenceNamesNoConditionThatAnotherRowContradicts) {
  // The worst row is idle, and other rows have real-time settings, too.
  std::vector runs{run(1, "idle", "udp", {}), run(2, "idle, RT", "udp", {false, true}, 200),
                   run(3, "load, RT", "udp", {true, true}, 100)};
  EXPECT_THAT(answer_of(runs, kept).sentence,
              AllOf(StartsWith("Without load and with real-time settings 10 %"),
                    HasSubstr("; without real-time settings 0 %")));
  // Two rows have no load.
  runs = {run(1, "load", "udp", {true}, 200), run(2, "idle", "udp", {}),
          run(3, "idle, RT", "udp", {false, true}, 100)};
  EXPECT_THAT(
      answer_of(runs, kept).sentence,
      AllOf(StartsWith("Under load 10 %"), HasSubstr("; without load and without real-time settings 0 %")));
  // Two rows have load.
  runs = {run(1, "load, RT", "udp", {true, true}, 200), run(2, "load", "udp", {true}, 50),
          run(3, "idle, RT", "udp", {false, true})};
  EXPECT_THAT(answer_of(runs, kept).sentence, AllOf(StartsWith("Under load with real-time settings 10 %"),
                                                    HasSubstr("; without real-time settings 2.5 %")));
}

TEST(Answer, ContrastLacksWhichSettingsOtherRowsHave) {
  std::vector runs{run(1, "a", "udp", {true}, 200), run(2, "b", "udp", {true}, 50)};
  amend(runs[0].run.asked, "/kernel", json{{"irq-threads", "90"}});
  EXPECT_THAT(answer_of(runs, kept).sentence, AllOf(StartsWith("Under load with kernel settings 10 %"),
                                                    HasSubstr("; without kernel settings 2.5 %")));
  runs.push_back(run(3, "c", "udp", {true, true}, 100));
  EXPECT_THAT(answer_of(runs, kept).sentence,
              HasSubstr("; without kernel settings or real-time settings 2.5 %"));
}

TEST(Answer, LoadOfAnotherComponentAtTheSameTimeIsLoad) {
  std::vector runs{run(1, "a", "udp", {true}, 200), run(2, "a", "udp", {})};
  for (auto& one : runs) amend(one.run.asked, "/component", one.run.number == 1 ? "base" : "arm");
  runs[1].run.key = "another";
  amend(runs[0].run.asked, "/others/arm/load", {{"component", {{"cpu", 0}}}});
  amend(runs[1].run.asked, "/others/base/load", {{"component", {{"cpu", 4}}}});
  const auto answer = answer_of(runs, kept);
  EXPECT_THAT(answer.sentence,
              AllOf(StartsWith("Under load 10 %"), HasSubstr("; under load of another component 0 %")));
  EXPECT_EQ(answer.rows[1].conditions, "load beside it");
  EXPECT_THAT(answer.rows[1].name, StartsWith("udp component arm"));
}

TEST(Answer, NoRunsGiveASentenceAlone) {
  const auto answer = answer_of({}, kept);
  EXPECT_THAT(answer.rows, IsEmpty());
  EXPECT_EQ(text_of(answer, 80), "There are no runs.\n");
}

TEST(Answer, JsonHasWhatIsPrinted) {
  const auto document = parsed_json(render(demo(), Format::json, kept)).at("answer");
  const auto answer = answer_of(demo(), kept);
  EXPECT_EQ(document.at("sentence"), answer.sentence);
  ASSERT_EQ(document.at("rows").size(), 12u);
  const auto& row = document.at("rows").at(3);
  EXPECT_EQ(row.at("state"), "LATE");
  EXPECT_EQ(row.at("cycles"), 2000);
  EXPECT_EQ(row.at("not_in_time"), 480);
  EXPECT_EQ(row.at("p99_ms").at("median"), 1.98);
  EXPECT_EQ(row.at("runs"), json({4}));
  EXPECT_EQ(document.at("next").size(), answer.next.size());
}

TEST(Answer, SurvivesRecordsOfAnyKind) {
  for (const json& odd : {json(), json(5), json("text"), json::array({1}), json{{"controller", 5}}})
    for (const auto* key :
         {"load", "deadline_us", "command_line", "scenario_file", "id", "explain", "duration_s"}) {
      auto one = run(1, "a", "udp", {true, true}, 5);
      amend(one.run.asked, std::string("/") + key, odd);
      auto other = one;
      other.run.outcome = odd;
      EXPECT_NO_THROW(text_of(answer_of({one, other}, {"", false}), 80)) << key;
    }
}

}  // namespace
}  // namespace ontime::report
