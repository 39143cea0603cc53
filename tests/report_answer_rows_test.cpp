// SPDX-License-Identifier: Apache-2.0
// The first screen's rows, where runs are of several kinds.
#include "gate/gate.hpp"
#include "report/words.hpp"
#include "report_answers.hpp"

namespace ontime::report {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;
using State = Answer::State;

TEST(Answer, AWorseRowIsNotLeftOutForAnImportedOne) {
  std::vector<Summary> runs;
  for (int i = 0; i < 30; ++i) {
    auto& one = runs.emplace_back(run(i + 1, "a" + std::to_string(i), "udp", {}));
    if (i == 15) one.late = *one.late_by_response = 3;
    if (i == 16) amend(one.run.outcome, "/hosts/controller/load_running", false);
    if (i > 16) one.imported.emplace();
  }
  const auto text = text_of(answer_of(runs, kept), 80);
  EXPECT_THAT(text, HasSubstr("none worse"));
  EXPECT_THAT(text, HasSubstr("LATE"));
  EXPECT_THAT(text, HasSubstr("NOT APPLIED"));
}

TEST(Answer, LateRowIsNotLeftOutForOnesThatWereCutOffAndMissedNothing) {
  std::vector<Summary> runs;
  for (int i = 0; i < 60; ++i) {
    auto& one = runs.emplace_back(run(i + 1, fmt::format("row{}.", i), "udp", {}));
    const bool is_late = i == 40 || i == 41, is_failing = i == 42;
    if (is_late) one.late = *one.late_by_response = 3;
    if (is_failing) one.notes.push_back({gate::missed_note, "FAIL: p99 <= 1 ms", {}, {}});
    if (i == 43) amend(one.run.outcome, "/error", "no peer found");
    if (i == 44) amend(one.run.outcome, "/hosts/controller/load_running", false);
    if ((!is_late && !is_failing && i < 43) || i == 41) amend(one.run.outcome, "/interrupted", true);
  }
  const auto answer = answer_of(runs, kept);
  EXPECT_EQ(answer.rows[41].state, State::cut_off);
  const auto text = text_of(answer, 80);
  for (const auto* row : {"\nrow40. ", "\nrow41. ", "\nrow42. ", "\nrow43. "})
    EXPECT_THAT(text, HasSubstr(row));
  EXPECT_THAT(text, AllOf(HasSubstr("CUT OFF"), ::testing::Not(HasSubstr("NOT APPLIED")),
                          ::testing::ContainsRegex("… and [0-9]+ more rows, none worse, but [0-9]+ not ok")));
}

TEST(Answer, AScenarioIsRepeatedForAsLongAsItsSlowestRunTakes) {
  auto one = run_without_a_late_message(), slow = run_without_a_late_message();
  slow.run.number = 2;
  slow.message_every_ns = 100 * ms;
  slow.missed_probability.bound = 1.4e-3;
  EXPECT_THAT(commands_of(answer_of({one, slow}, kept)).front(), HasSubstr("--duration 50min"));
}

TEST(Answer, RowWithTheGreatestShareAndTheLongestWaitAreTold) {
  std::vector<Summary> runs;
  for (int i = 0; i < 30; ++i) {
    auto& one = runs.emplace_back(run(i + 1, "a" + std::to_string(i), "udp", {}, 2));
    one.notes.push_back({gate::missed_note, "FAIL: late <= 0", {}, {}});
  }
  runs.push_back(run(31, "none-required", "udp", {}, 1800));
  runs.push_back(run(32, "waited", "udp", {}, 1));
  runs.back().response.max = 7000 * ms;
  const auto text = text_of(answer_of(runs, kept), 80);
  EXPECT_THAT(text, AllOf(HasSubstr("1,800 (90 %)"), HasSubstr("more rows, none worse, but "),
                          HasSubstr(" not ok, one waited 7000 ms\n")));
}

TEST(Answer, WhatHasNoLimitIsNeitherOnTimeNorLate) {
  auto one = run(1, "/scan period", "", {});
  amend(one.run.asked, {{"measures", "period"}, {"deadline_us", nullptr}});
  amend(one.run.outcome, "/loss_unknown", true);
  auto answer = answer_of({one}, kept);
  EXPECT_EQ(answer.rows.front().state, State::no_limit);
  EXPECT_THAT(answer.sentence, AllOf(HasSubstr("No limit is set"), HasSubstr("Lost messages are unknown")));
  EXPECT_THAT(text_of(answer, 80), HasSubstr("no limit"));
  EXPECT_TRUE(json_of(answer).at("rows").at(0).at("not_in_time").is_null());
  auto interrupted = one;
  amend(interrupted.run.outcome, "/interrupted", true);
  answer = answer_of({interrupted}, kept);
  EXPECT_THAT(answer.sentence, HasSubstr("No limit is set"));
  EXPECT_TRUE(json_of(answer).at("rows").at(0).at("not_in_time").is_null());
  EXPECT_THAT(text_of(answer, 80), testing::ContainsRegex("idle +- "));
  auto late = one;
  late.run.number = 2;
  amend(late.run.asked, {{"id", "/scan age"}, {"measures", "age"}, {"deadline_us", 5000}});
  late.late = *late.late_by_response = late.sent;
  EXPECT_THAT(answer_of({one, late}, kept).sentence, StartsWith("100 % of the messages were late"));
}

TEST(Answer, ALongerAnsweredWaitIsNoOpenOne) {
  std::vector runs{run(1, "a", "udp", {}, 1, 1), run(2, "a", "udp", {}, 0, 2)};
  runs[0].lost = 1;
  amend(runs[0].run.asked, "/timeout_us", 500'000);
  runs[1].response.max = 2000 * ms;
  const auto row = answer_of(runs, kept).rows.at(0);
  EXPECT_EQ(row.worst_wait_ns, 2e9);
  EXPECT_FALSE(row.is_open);
}

TEST(Answer, AWaitOfAMessageWithoutASampleIsKnownAtLeast) {
  auto one = run(1, "a", "udp", {});
  amend(one.run.asked, "/timeout_us", 500'000);
  amend(one.run.outcome, {{"late", 2}, {"lost", 1}, {"dropped_records", 9}});
  EXPECT_EQ(answer_of({one}, kept).rows.at(0).worst_wait_ns, 500e6);
  amend(one.run.outcome, "/lost", 0);
  EXPECT_EQ(answer_of({one}, kept).rows.at(0).worst_wait_ns, 10e6) << "its deadline";
  EXPECT_TRUE(answer_of({one}, kept).rows.at(0).is_open);
}

TEST(Answer, CyclesThatOnlyTheClientCountedAreCounted) {
  auto one = run(1, "a", "udp", {});
  amend(one.run.outcome, {{"sent", 2200}, {"skipped_cycles", 90}, {"dropped_records", 200}});
  EXPECT_EQ(answer_of({one}, kept).rows.at(0).cycles, 2290U);
  EXPECT_THAT(answer_of({one}, kept).sentence, HasSubstr("90 of 2,290 cycles had no message"));
}

TEST(Answer, LateAndLostMessagesThatAreKnownApartAreSaidSo) {
  auto period = run(1, "/scan period", "", {}), age = run(2, "/odom age", "", {});
  amend(period.run.asked, {{"measures", "period"}, {"deadline_us", 5000}});
  amend(period.run.outcome, "/loss_unknown", true);
  amend(age.run.asked, {{"measures", "age"}, {"deadline_us", nullptr}});
  EXPECT_THAT(answer_of({period, age}, kept).sentence, HasSubstr("as far as is known"));
  amend(age.run.asked, "/deadline_us", 5000);
  EXPECT_THAT(answer_of({period, age}, kept).sentence, StartsWith("No message was late or lost."));
}

TEST(Answer, RobotsOwnMessagesAreNotCalledCycles) {
  auto scan = run(1, "/scan period", "", {}), odom = run(2, "/odom period", "", {}, 3);
  for (auto* one : {&scan, &odom}) amend(one->run.asked, {{"measures", "age"}, {"deadline_us", 5000}});
  amend(odom.run.outcome, "/interrupted", true);
  EXPECT_EQ(answer_of({scan, odom}, kept).sentence,
            "No message was late or lost. 1 of 2 rows was not measured as requested: 3 of its 2,000 messages "
            "were late or lost.");
  auto ping = run(3, "a", "udp", {}, 40);
  amend(ping.run.outcome, "/interrupted", true);
  EXPECT_THAT(
      answer_of({scan, odom, ping}, kept).sentence,
      HasSubstr("2 of 3 rows were not measured as requested: 40 of their 2,000 cycles had no answer in "
                "time, 3 of their 2,000 messages were late or lost."));
  auto without_samples = summary(scan.run.asked.document, outcome(), 0);
  amend(without_samples.run.outcome, "/dropped_records", 2000);
  EXPECT_EQ(answer_of({without_samples}, kept).sentence, "No sample was recorded of 2,000 messages.");
}

TEST(Answer, OpenLimitOfWhatHasNoneIsOpen) {
  auto one = run(1, "/scan period", "", {});
  amend(one.run.asked, {{"measures", "period"}, {"deadline_us", nullptr}});
  amend(one.run.outcome, "/loss_unknown", true);
  one.notes.push_back({gate::open_note, "open: --age: the age of /scan is unknown", {}, {}});
  const auto answer = answer_of({one}, kept);
  EXPECT_THAT(answer.sentence,
              AllOf(HasSubstr("A requirement is open"), ::testing::Not(HasSubstr("No limit"))));
  EXPECT_THAT(text_of(answer, 80), HasSubstr("  open\n"));
}

TEST(Answer, StepsOfASearchStandInTheirOrder) {
  std::vector<Summary> steps;
  for (const char* transport : {"udp", "cyclonedds"})
    for (const int number : {2, 0, 1}) {
      auto& one = steps.emplace_back(run(static_cast<int>(steps.size()) + 1, "a", transport, {}));
      const auto value = std::to_string(1 << number) + " kHz";
      amend(one.run.asked,
            {{"search", {{"key", "background.rate"}, {"value", value}, {"step", number}, {"steps", 3}}},
             {"variant", "background.rate " + value}});
    }
  std::vector<std::string> names;
  for (const auto& row : answer_of(steps, kept).rows) names.push_back(row.name);
  EXPECT_THAT(names,
              ::testing::ElementsAre("udp background.rate 1 kHz", "udp background.rate 2 kHz",
                                     "udp background.rate 4 kHz", HasSubstr("cyclonedds background.rate 1"),
                                     HasSubstr("cyclonedds background.rate 2"),
                                     HasSubstr("cyclonedds background.rate 4")));
}

TEST(Answer, RowDoesNotRepeatItsId) {
  const auto text_for = [](const char* id, bool is_loaded) {
    auto one = run(1, id, "udp", {});
    amend(one.run.asked, {{"scenario_file", "robot.yaml"}});
    if (is_loaded) amend(one.run.asked, {{"realtime", true}, {"load", {{"controller", {{"cpu", 2}}}}}});
    return text_of(answer_of({one}, kept), 80);
  };
  EXPECT_THAT(text_for("idle", false), HasSubstr("\nidle  udp "));
  EXPECT_THAT(text_for("at rest", false), HasSubstr("\nat rest idle  udp "));
  EXPECT_THAT(text_for("loaded", true), HasSubstr("\nloaded load, RT  udp "));
  EXPECT_THAT(text_for("load", true), HasSubstr("\nload RT  udp "));
}

TEST(Answer, RepetitionsOfSeveralMachinesOrVersionsAreACaution) {
  std::vector runs{run(1, "a", "udp", {}, 0, 1), run(2, "a", "udp", {}, 0, 2), run(3, "b", "udp", {})};
  const auto set = [&](std::size_t run, const char* host, const char* fact, const char* value) {
    amend(runs[run].run.outcome, fmt::format("/hosts/{}/{}", host, fact), value);
  };
  const auto mixture = [&] {
    std::string found;
    for (const auto& caution : answer_of(runs, kept).cautions)
      if (caution.find("repetitions") != caution.npos) found += caution;
    EXPECT_EQ(json_of(answer_of(runs, kept)).dump().find("repetitions") != std::string::npos, !found.empty());
    return found;
  };
  for (std::size_t i = 0; i < runs.size(); ++i)
    for (const auto* host : {"controller", "component"})
      set(i, host, "machine/kernel_release", i == 2 ? "4.19" : "6.1");
  EXPECT_EQ(mixture(), "") << "another id may be measured elsewhere";
  for (const auto* host : {"controller", "component"}) set(1, host, "machine/kernel_release", "5.10");
  EXPECT_EQ(mixture(), "a udp ×2: repetitions come from 2 kernels: 5.10 and 6.1");
  EXPECT_THAT(render(runs, Format::markdown, kept), HasSubstr("repetitions come from 2 kernels"));
  for (std::size_t i = 0; i < 2; ++i) {
    set(i, "component", "settings/gro", i == 0 ? "on" : "off");
    set(i, "component", "settings/irq-cpus", i == 0 ? "0" : "1");
  }
  EXPECT_THAT(mixture(), AllOf(HasSubstr("2 values of kernel.gro of the component: off and on"),
                               Not(HasSubstr("irq-cpus"))));
  set(1, "component", "transport/version", "0.1.1");
  amend(runs[1].run.asked, "/ontime", "0.3.0");
  EXPECT_THAT(mixture(), AllOf(HasSubstr("2 kernels: "), HasSubstr("2 transport versions of the component: "),
                               HasSubstr("2 versions of ontime: ")));
}

TEST(Words, LargeNumbersHaveNoExponent) {
  EXPECT_EQ(megabits(38.24e6), "38.24");
  EXPECT_EQ(megabits(9999.4e6), "9999");
  EXPECT_EQ(megabits(10e9), "10000");
  EXPECT_EQ(megabits(25e9), "25000");
  EXPECT_EQ(statistics::time_of(9999.4e9), "9999 s");
  EXPECT_EQ(statistics::time_of(12345.6e9), "12346 s");
  EXPECT_EQ(statistics::time_of(999.7e6, 3), "999.7 ms");
  EXPECT_EQ(statistics::time_of(1234.5e9, 3), "1234 s");
}

TEST(Words, PercentIsNeitherAllNorNoneUnlessExact) {
  const auto percent = [](double share) { return table::percent(share, 4); };
  EXPECT_EQ(percent(0.1234), "12.34");
  EXPECT_EQ(percent(0.99994), "99.99");
  EXPECT_EQ(percent(0.99998), "99.998");
  EXPECT_EQ(percent(1), "100");
  double sum = 0;
  for (int i = 0; i < 7; ++i) sum += 1.0 / 7;
  ASSERT_LT(sum, 1);
  EXPECT_EQ(percent(sum), "100");
  EXPECT_EQ(percent(3.3333e-8), "0.000003333");
  EXPECT_EQ(percent(1e-30), "1e-28") << "an interval's end, not a count";
  EXPECT_EQ(percent(0), "0");
}

TEST(Words, LimitOfAnIntervalIsNeverRoundedInwards) {
  const auto low = [](double share) { return table::percent(share, 2, table::Limit::low); };
  const auto high = [](double share) { return table::percent(share, 2, table::Limit::high); };
  EXPECT_EQ(low(0.1061) + " " + high(0.1099), "10 11");
  EXPECT_EQ(low(0.99125) + " " + high(0.99275), "99.1 99.3");
  EXPECT_EQ(low(0.999996) + " " + high(0.999996), "99.9996 99.9996");
  EXPECT_EQ(low(0.9999958) + " " + high(0.9999962), "99.9995 99.9997");
  EXPECT_EQ(low(0.98999) + " " + high(0.98999), "98 99");
  EXPECT_EQ(low(0.0999) + " " + high(0.0999), "9.9 10");
  EXPECT_EQ(low(0.07) + " " + high(0.07), "7 7");
  EXPECT_EQ(low(1.239e-7) + " " + high(1.239e-7), "0.000012 0.000013");
  EXPECT_EQ(low(0) + " " + high(0), "0 0");
  EXPECT_EQ(low(1e-30) + " " + high(3e-9), "0 0.0000003");
  EXPECT_EQ(low(1) + " " + high(1), "100 100");
  for (double share = 1e-6; share < 1; share += 0.000'137) {
    EXPECT_LE(std::stod(low(share)), share * 100 + 1e-9);
    EXPECT_GE(std::stod(high(share)), share * 100 - 1e-9);
  }
}

TEST(Words, HoursAreNoLongNumberOfSeconds) {
  using namespace std::chrono_literals;
  EXPECT_EQ(duration(1ns), "1 ns");
  EXPECT_EQ(duration(600s), "600 s");
  EXPECT_EQ(duration(3601s), "3601 s");
  EXPECT_EQ(duration(1h), "1 h");
  EXPECT_EQ(duration(90min), "1.5 h");
  EXPECT_EQ(duration(24h), "24 h");
  EXPECT_EQ(duration(24h * 365), "8760 h");
  EXPECT_EQ(duration(1'000'001s), "1000001 s");
}

TEST(Answer, LongWordsThatAreCutStayApart) {
  std::vector<std::vector<std::string>> rows = {{"robot-front-left-camera-pipeline-cold udp"},
                                                {"robot-front-left-camera-pipeline-warm udp"},
                                                {"ロボットロボットロボットロボットa"},
                                                {"ロボットロボットロボットロボットb"}};
  shorten_names(rows, 0, 24);
  for (const auto& row : rows) {
    EXPECT_LE(width_of(row[0]), 24U) << row[0];
    EXPECT_EQ(table::printable(row[0]), row[0]) << "no letter is cut";
  }
  EXPECT_NE(rows[0], rows[1]);
  EXPECT_NE(rows[2], rows[3]);
}

// The component's name was cut, because another condition has the same component with traffic.
TEST(Answer, NamesOfTwoConditionsMayBeCutAlike) {
  const std::string base = "cyclonedds component base 500 B every 10 ms best-effort keep-last 1";
  std::vector<std::vector<std::string>> rows = {
      {"quiet", base}, {"", "udp"}, {"busy", base + " traffic: 40 Mbit/s"}, {"", "udp"}};
  shorten_names(rows, 1, 30);
  EXPECT_EQ(rows[0][1], "cyclonedds component base 500…");
  EXPECT_EQ(rows[2][1], rows[0][1]);
  rows = {{"quiet", base}, {"", base + " traffic: 40 Mbit/s"}};
  shorten_names(rows, 1, 30);
  EXPECT_NE(rows[0][1], rows[1][1]);
}

TEST(Answer, LongTopicKeepsItsQuantity) {
  record::Asked asked;
  asked.measures = "period";
  asked.id = "/" + std::string(80, 'x') + " period";
  EXPECT_EQ(id_of(asked), "/" + std::string(51, 'x') + "… period");
  asked.id = "/scan period";
  EXPECT_EQ(id_of(asked), "/scan period");
}

TEST(Answer, IdsThatAreCutStayApart) {
  const std::string common = "cell-7-in-hall-2-left-arm-controller-";
  const std::vector runs{run(1, common + "shoulder", "udp", {}), run(2, common + "elbow", "udp", {}, 1)};
  const auto text = text_of(answer_of(runs, kept), 80);
  EXPECT_THAT(text, testing::ContainsRegex("-shou[^\n]* udp [^\n]* ok\n"));
  EXPECT_THAT(text, testing::ContainsRegex("-elbo[^\n]* udp [^\n]* LATE\n"));
}

TEST(Answer, NamesThatAreCutStayApart) {
  std::vector runs{run(1, "a", "udp", {}), run(2, "a", "udp", {}), run(3, "a", "udp", {})};
  for (std::size_t i = 1; i < 3; ++i) {
    amend(runs[i].run.asked, "/variant", std::string(70, 'x'));
    runs[i].run.key += std::to_string(i);
  }
  const auto text = text_of(answer_of(runs, kept), 80);
  EXPECT_THAT(text, AllOf(HasSubstr("… run 2 "), HasSubstr("… run 3 ")));
}

}  // namespace
}  // namespace ontime::report
