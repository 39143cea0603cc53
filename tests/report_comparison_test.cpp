// SPDX-License-Identifier: Apache-2.0

#include "report_comparison.hpp"

#include "conditions/conditions.hpp"
#include "json.hpp"
#include "report/comparison.hpp"

namespace ontime::report {
namespace {

using record::amend;
using ::testing::HasSubstr;
using ::testing::Not;

json figure_of(const json& pair, const std::string& name) {
  for (const auto& figure : pair.at("metrics"))
    if (figure.at("metric") == name) return figure;
  return nullptr;
}

TEST(Compare, RunsOfTheSameKeyAreOnePairAndTheOthersAreNamed) {
  const std::vector a{run("x", "k1", 1), run("y", "k2", 1), run("gone", "k3", 1)};
  const std::vector b{run("new", "k4", 1), run("y", "k2", 1), run("x", "k1", 2), run("x", "k1", 2.1)};
  const auto comparison = compare(a, b);
  ASSERT_EQ(comparison.pairs.size(), 2U);
  EXPECT_EQ(comparison.pairs[0].from.size(), 1U);
  EXPECT_EQ(comparison.pairs[0].to.size(), 2U) << "repetitions";
  const auto text = render(comparison, {}, Format::table);
  EXPECT_THAT(text, HasSubstr("Only in A: gone udp (1 run)"));
  EXPECT_THAT(text, HasSubstr("Only in B: new udp (1 run)"));
  const auto document = parsed_json(render(comparison, {}, Format::json));
  EXPECT_EQ(document.at("only_from").at(0).at("id"), "gone");
  EXPECT_EQ(document.at("only_to").at(0).at("key"), "k4");
}

TEST(Compare, ConditionThatKeepsRunsApartIsNamed) {
  std::vector a{run("x", "k1", 1)}, b{run("x", "k2", 1), run("x", "k3", 1)};
  amend(b[0].run.asked, {{"deadline_us", 5000}, {"payload_bytes", 1234}});
  amend(b[1].run.asked, {{"deadline_us", 5000}});
  const auto text = render(compare(a, b), {}, Format::table);
  EXPECT_THAT(text, HasSubstr("No run of A has the same conditions"));
  EXPECT_THAT(text, HasSubstr("deadline: 10 ms → 5 ms"));
  EXPECT_THAT(text, Not(HasSubstr("payload"))) << "the nearest alone";
}

TEST(Compare, RunsOfOneSideWithTheSameNameAreToldApart) {
  std::vector a{run("x", "k1", 1), run("x", "k2", 1)}, b{run("x", "k3", 1), run("z", "k4", 1)};
  amend(a[0].run.asked, {{"options", {{"executor", "single"}, {"rmw", "a"}}}});
  amend(a[1].run.asked, {{"options", {{"executor", "multi"}, {"rmw", "a"}}}});
  amend(b[0].run.asked, {{"options", {{"executor", "multi"}, {"rmw", "b"}}}});
  const auto text = render(compare(a, b), {}, Format::table);
  EXPECT_THAT(text, HasSubstr("Only in A: x udp executor single (1 run); x udp executor multi (1 run)"));
  EXPECT_THAT(text, HasSubstr("Only in B: x udp (1 run); z udp (1 run)"));
}

TEST(Compare, OtherProcessesOfATopicAreNamedAsTheDifference) {
  std::vector a{run("/tf age", "k1", 1)}, b{run("/tf age", "k2", 1)};
  amend(a[0].run.asked,
        {{"measures", "age"}, {"variant", "pub [1] → sub [2]"}, {"flow", "pub [1] → sub [2]"}});
  amend(b[0].run.asked,
        {{"measures", "age"}, {"variant", "pub [3] → sub [4]"}, {"flow", "pub [3] → sub [4]"}});
  const auto text = render(compare(a, b), {}, Format::table);
  EXPECT_THAT(text, HasSubstr("Different: flow."));
}

TEST(Compare, WithoutAPairTheAnswerStandsBeforeTheLists) {
  std::vector a{run("x", "k1", 1)}, b{run("y", "k2", 1, 2)};
  amend(b[0].run.asked, {{"deadline_us", 5000}});
  auto comparison = compare(a, b);
  comparison.from_name = "old.ontime";
  comparison.to_name = "new.ontime";
  const auto text = render_answer(comparison, {}, Format::table, "", 1000);
  EXPECT_TRUE(text.starts_with("No run of old.ontime")) << text;
  EXPECT_LT(text.find("--from 1 --to 2"), text.find("Only in old.ontime: x udp"));
  EXPECT_LT(text.find("Only in old.ontime: x udp"), text.find("Only in new.ontime: y udp"));
}

TEST(Compare, PeriodAndAgeHaveNoNearest) {
  std::vector a{run("x", "k1", 1)}, b{run("y", "k2", 1, 2)};
  amend(a[0].run.asked, {{"measures", "period"}});
  amend(b[0].run.asked, {{"measures", "age"}, {"deadline_us", 5000}});
  EXPECT_EQ(why_never(compare_chosen(a, b)), "a period and an age cannot be compared");
  EXPECT_THAT(render(compare(a, b), {}, Format::table), Not(HasSubstr("--from")));
  amend(a[0].run.asked, {{"measures", "age"}});
  EXPECT_EQ(why_never(compare_chosen(a, b)), "");
  EXPECT_EQ(why_never(compare(a, b)), "") << "other conditions are no reason";
}

TEST(Compare, ImportedWakeUpLatencyIsNoRoundTrip) {
  std::vector a{run("x", "k1", 1)}, b{run("y", "k2", 1, 2)};
  const auto import = [](Summary& run) {
    amend(run.run.asked,
          {{"measures", "wake-up"}, {"imported", {{"from", "cyclictest-json"}, {"file", "c.json"}}}});
    run.imported.emplace();
    run.wake_up = std::exchange(run.round_trip, {});
  };
  import(a[0]);
  EXPECT_EQ(why_never(compare_chosen(a, b)),
            "an imported wake-up latency and a round trip cannot be compared");
  EXPECT_THAT(render(compare(a, b), {}, Format::table),
              AllOf(Not(HasSubstr("--from")), HasSubstr("cannot be compared")));
  import(b[0]);
  const auto both = compare_chosen(a, b);
  EXPECT_EQ(why_never(both), "");
  const auto text = render_answer(both, {}, Format::table, "", 80);
  EXPECT_THAT(text, HasSubstr("Wake-up (µs)"));
  EXPECT_THAT(text, Not(HasSubstr("98 %"))) << "it has no interval";
  const auto figures = parsed_json(render(both, {}, Format::json)).at("pairs").at(0).at("metrics");
  const auto max = figures.back();
  EXPECT_EQ(max.at("metric"), "wake_up_us.max");
  EXPECT_DOUBLE_EQ(max.at("to").get<double>(), static_cast<double>(b[0].wake_up.max) / 1e3);
  EXPECT_EQ(max.at("verdict"), "cannot tell");
  EXPECT_TRUE(max.at("ratio_low").is_null());
}

TEST(Compare, ImportedRepetitionsCountTogether) {
  const auto imported = [](std::int64_t p50_ns, std::int64_t max_ns, std::int64_t number) {
    auto one = run("x", "k", 1, number);
    amend(one.run.asked,
          {{"measures", "wake-up"}, {"imported", {{"from", "cyclictest-json"}, {"file", "c.json"}}}});
    one.imported.emplace();
    one.wake_up = std::exchange(one.round_trip, {});
    one.response = {};
    one.wake_up.count = 50;
    one.wake_up[statistics::Figure::p50] = p50_ns;
    one.wake_up.max = max_ns;
    return one;
  };
  const std::vector a{imported(1000, 9000, 1)};
  std::vector b{imported(2000, 7000, 1), imported(4000, 8000, 2)};
  const auto comparison = compare(a, b);
  EXPECT_THAT(render(comparison, {}, Format::table),
              AllOf(::testing::ContainsRegex("p50 +1.0 +3.0"), ::testing::ContainsRegex("p99 +- +-"),
                    ::testing::ContainsRegex("max +9.0 +8.0"),
                    HasSubstr("A: 1 run; B: 2 runs; each value is their mean, max the greatest")));
  const auto figures = parsed_json(render(comparison, {}, Format::json)).at("pairs").at(0).at("metrics");
  ASSERT_EQ(figures.size(), 3U) << figures;
  EXPECT_DOUBLE_EQ(figures.at(0).at("to").get<double>(), 3);
  EXPECT_DOUBLE_EQ(figures.at(2).at("to").get<double>(), 8);
  EXPECT_TRUE(figures.at(2).at("ratio").is_null()) << "twice as many values have a greater maximum";
  b[1].imported->beyond = 40;
  EXPECT_THAT(render(comparison, {}, Format::table), ::testing::ContainsRegex("p50 +1.0 +≥3.0"));
}

TEST(Compare, NearestNamesNoKeyThatIsTheSame) {
  std::vector a{run("x", "k1", 1)}, b{run("x", "k2", 1)};
  amend(a[0].run.asked, {{"period_us", 10'000}, {"deadline_us", 10'000}});
  amend(b[0].run.asked, {{"period_us", 20'000}, {"deadline_us", 10'000}});
  auto text = render(compare(a, b), {}, Format::table);
  EXPECT_THAT(text, HasSubstr("Different: period: 10 ms → 20 ms. "));
  amend(b[0].run.asked, {{"period_us", 10'000.0001}, {"deadline_us", 10'000}});
  text = render(compare(a, b), {}, Format::table);
  EXPECT_THAT(text, HasSubstr("period: 10000 → 10000.0001"));
}

TEST(Compare, NearestNamesNothingThatKeepsNoRunsApart) {
  std::vector a{run("x", "k1", 1)}, b{run("x", "k2", 1), run("x", "k3", 1)};
  amend(b[0].run.asked, {{"deadline_us", 5000}, {"title", "Another"}, {"require", {"late <= 0"}}});
  amend(b[1].run.asked, {{"deadline_us", 5000}, {"payload_bytes", 1234}});
  const auto text = render(compare(a, b), {}, Format::table);
  EXPECT_THAT(text, HasSubstr("Different: deadline: 10 ms → 5 ms. To"));
}

TEST(Compare, NearestNamesNoKeyThatARecordOnlyLeavesOut) {
  std::vector a{run("x", "k1", 1)}, b{run("x", "k2", 1)};
  amend(a[0].run.asked, {{"link", {{"loss", 0}}}, {"deadline_us", 5'000}});
  const auto text = render(compare(a, b), {}, Format::table);
  EXPECT_THAT(text, HasSubstr("deadline: 5 ms"));
  EXPECT_THAT(text, Not(HasSubstr("link.loss")));
}

TEST(Compare, NameOfAnyLengthLeavesTheLineReadable) {
  const std::string endless(100'000, 'x');
  const auto text = render(compare({run(endless, "k1", 1)}, {run(endless, "k2", 1)}), {}, Format::table);
  EXPECT_LT(text.size(), 10'000U);
}

TEST(Compare, SaysBetterWorseOrCannotTell) {
  const auto verdict = [](double from, double to) {
    const std::vector a{run("x", "k", from), run("x", "k", from, 2)},
        b{run("x", "k", to), run("x", "k", to, 2)};
    const auto document = parsed_json(render(compare(a, b), {}, Format::json));
    return figure_of(document.at("pairs").at(0), "round_trip_us.p99").at("verdict");
  };
  EXPECT_EQ(verdict(1, 2), "worse");
  EXPECT_EQ(verdict(2, 1), "better");
  EXPECT_EQ(verdict(1, 1.05), "cannot tell");
}

TEST(Compare, SingleRunsGetNoVerdict) {
  const std::vector a{run("x", "k", 1)}, b{run("x", "k", 2)};
  const auto text = render(compare(a, b), {}, Format::table);
  EXPECT_EQ(row_of(text, "p99 ").back(), "higher");
  EXPECT_THAT(text, HasSubstr("five runs a side"));
  const auto pair = parsed_json(render(compare(a, b), {}, Format::json)).at("pairs").at(0);
  EXPECT_EQ(pair.at("repeated"), false);
  EXPECT_EQ(figure_of(pair, "round_trip_us.p99").at("verdict"), "cannot tell");
}

TEST(Compare, SaysThatAnOlderOntimeMeasured) {
  std::vector a{run("x", "k", 1)};
  const std::vector b{run("x", "k", 1)};
  EXPECT_THAT(render(compare(a, b), {}, Format::table), Not(HasSubstr("recomputed")));
  amend(a[0].run.asked, "/ontime", "0.1.0");
  EXPECT_THAT(render(compare(a, b), {}, Format::table), HasSubstr("A was measured by ontime 0.1.0"));
}

TEST(Compare, GivesTheOneIntervalThatDecides) {
  const std::vector a{run("x", "k", 1)}, b{run("x", "k", 2)};
  const auto comparison = compare(a, b);
  const auto p99 =
      figure_of(parsed_json(render(comparison, {}, Format::json)).at("pairs").at(0), "round_trip_us.p99");
  EXPECT_DOUBLE_EQ(p99.at("from").get<double>(), 1000);
  EXPECT_DOUBLE_EQ(p99.at("difference").get<double>(), 1000);
  EXPECT_DOUBLE_EQ(p99.at("ratio").get<double>(), 2);
  EXPECT_LT(p99.at("ratio_low"), 2);
  EXPECT_GT(p99.at("ratio_high"), 2);
  EXPECT_TRUE(p99.at("difference_low").is_null() && p99.at("difference_high").is_null());
  const auto row = row_of(render(comparison, {}, Format::table), "p99 ");
  EXPECT_EQ(row.at(1), "1000");
  EXPECT_EQ(row.at(2), "2000");
  EXPECT_EQ(row.at(3), "+100");
  EXPECT_EQ(row.back(), "higher");
  EXPECT_EQ(row_by_name(render(comparison, {}, Format::csv), 3).at("verdict"), "cannot tell");
}

TEST(Compare, TooWideIntervalIsNotShown) {
  const std::vector a{run("x", "k", 1)}, b{run("x", "k", 2)};  // which have an interval of p99 alone
  const auto text = render(compare(a, b), {}, Format::table);
  EXPECT_THAT(text, ::testing::ContainsRegex("p99.99 .* too few messages\n"));
}

TEST(Compare, PercentileBeyondTheMessagesHasNoValueAndMaximumNoVerdict) {
  std::vector a{run("x", "k", 1), run("x", "k", 1, 2)}, b{run("x", "k", 2), run("x", "k", 2, 2)};
  b[1].round_trip.max = 9'000'000;
  const auto text = render(compare(a, b), {}, Format::table);
  EXPECT_THAT(text, ::testing::ContainsRegex("\np99.99 +- +- +- +- +too few messages\n"));
  EXPECT_THAT(text, ::testing::ContainsRegex("\nmax +2000 +9000 +[^ ]+ % +- +cannot tell\n"));
  const auto pair = parsed_json(render(compare(a, b), {}, Format::json)).at("pairs").at(0);
  EXPECT_TRUE(figure_of(pair, "round_trip_us.p99.99").is_null());
  EXPECT_EQ(figure_of(pair, "round_trip_us.max").at("to"), 9000);
  EXPECT_EQ(figure_of(pair, "round_trip_us.max").at("verdict"), "cannot tell");
}

TEST(Compare, TwoShortRunsGetNoVerdict) {
  std::vector a{run("x", "k", 1)}, b{run("x", "k", 2)};
  const auto shown = [&] { return render(compare(a, b), {}, Format::table); };
  const auto lost = [](Summary& one, double most) {
    one.lost_probability.messages = 5;
    one.lost_probability.sure = one.lost_probability.surer = {0.0, most};
  };
  // Of five messages up to 60 % may be lost, though none was: that is no comparison.
  lost(a[0], 0.6);
  lost(b[0], 0.6);
  EXPECT_THAT(shown(), ::testing::ContainsRegex("lost % +0 +0 +- +- +too few messages\n"));
  // Fewer than a tenth more or less is something.
  lost(b[0], 0.05);
  EXPECT_THAT(shown(), ::testing::ContainsRegex("lost % +0 +0 +- +-60 … \\+5 points +cannot tell\n"));
  a[0].lost = 1;
  a[0].lost_probability.value = 0.2;
  EXPECT_THAT(shown(), ::testing::ContainsRegex("lost % +20 +0 +-20 +-60 … [^ ]+ points +[a-z ]+\n"));
  a[0].lost = 0;
  a[0].lost_probability.value = 0;
  // Between half and twice, too.
  const auto p99 = [](Summary& one, double low, double high) {
    one.round_trip_certainty[statistics::Figure::p99].surer = {low * 1e6, high * 1e6};
  };
  p99(a[0], 0.3, 3);
  p99(b[0], 0.6, 6);
  EXPECT_THAT(shown(), ::testing::ContainsRegex("p99 +1000 +2000 +- +- +too few messages\n"));
  const auto change = [&](statistics::Figure figure) {
    return *statistics::change({&a[0]}, {&b[0]}, statistics::Times::round_trip, figure);
  };
  EXPECT_TRUE(tells_nothing(statistics::Figure::p99, change(statistics::Figure::p99)));
  EXPECT_FALSE(tells_nothing(statistics::Figure::lost, change(statistics::Figure::lost)));
  EXPECT_FALSE(tells_nothing(statistics::Figure::max, change(statistics::Figure::max)));
  b.push_back(b[0]);
  EXPECT_THAT(shown(), ::testing::ContainsRegex("p99 +1000 +2000 +- +- +too little data\n"));
}

TEST(Compare, MaximaOfUnequalNumbersOfMessagesAreShownButNotCompared) {
  const std::vector a{run("x", "k", 1)};
  std::vector b{run("x", "k", 1)};
  b[0].round_trip.max = 9'000'000;
  const auto row = [&] { return row_of(render(compare(a, b), {}, Format::table), "max "); };
  const auto max = [&] {
    return figure_of(parsed_json(render(compare(a, b), {}, Format::json)).at("pairs").at(0),
                     "round_trip_us.max");
  };
  EXPECT_EQ(row().at(3), "+350");
  EXPECT_EQ(max().at("ratio"), 4.5);
  EXPECT_THAT(render_answer(compare(a, b), {}, Format::table, "", 80), Not(HasSubstr("†")));
  b[0].round_trip.count *= 3;
  EXPECT_THAT(row(), ::testing::ElementsAre("max", "2000", "9000", "-", "-", "not", "compared"));
  EXPECT_THAT(render(compare(a, b), {}, Format::table), HasSubstr("A: 2,000 answers, B: 6,000"));
  EXPECT_TRUE(max().at("ratio").is_null());
  EXPECT_TRUE(max().at("difference").is_null());
  EXPECT_EQ(max().at("to"), 9000);
  EXPECT_THAT(render_answer(compare(a, b), {}, Format::table, "", 80),
              AllOf(HasSubstr("2.0 → 9.0 †"), HasSubstr("\n† not comparable")));
}

TEST(Compare, ShareWithARatioIsJudgedByItsInterval) {
  std::vector a{run("x", "k", 1)}, b{run("x", "k", 1)};
  const auto lost = [](Summary& one, double share, double low, double high) {
    one.lost_probability.value = share;
    one.lost_probability.messages = 60'000;
    one.lost_probability.sure = one.lost_probability.surer = {low, high};
  };
  const auto shown = [&] { return render(compare(a, b), {}, Format::table); };
  // Within a tenth of all messages, yet from a third to three times as many.
  lost(a[0], 0.001, 0.0005, 0.002);
  lost(b[0], 0.001, 0.0004, 0.003);
  EXPECT_THAT(shown(), ::testing::ContainsRegex("lost % +0\\.1 +0\\.1 +- +- +too few messages\n"));
  lost(a[0], 0.5, 0.40, 0.6);
  lost(b[0], 0.5, 0.35, 0.65);
  EXPECT_THAT(shown(), ::testing::ContainsRegex("lost % +50 +50 +\\+0.0 % +-[0-9]+ % … \\+[0-9]+ % +cannot"));
}

TEST(Compare, NearlyAllIsNotAllAndASmallChangeIsNotNone) {
  std::vector a{run("x", "k", 1)}, b{run("x", "k", 1)};
  const auto lost = [](Summary& one, double share) {
    one.lost_probability.messages = 100'000;
    one.lost_probability.value = share;
    one.lost_probability.surer = {share - 1e-6, share + 1e-6};
  };
  lost(a[0], 0.99998);
  lost(b[0], 0.9999);
  EXPECT_THAT(render(compare(a, b), {}, Format::table),
              ::testing::ContainsRegex("lost % +99.998 +99.99 +-0.008 % +-0.008 % … -0.008 % +lower\n"));
  lost(a[0], 0);
  EXPECT_THAT(render(compare(a, b), {}, Format::table),
              ::testing::ContainsRegex("lost % +0 +99.99 +\\+99.99 +\\+99.99 … \\+99.99 points +higher\n"));
  lost(a[0], 0.02);
  lost(b[0], 0.0001);  // 1 of 10,000 after 200: 0.5 % of them
  EXPECT_THAT(render(compare(a, b), {}, Format::table),
              ::testing::ContainsRegex("lost % +2 +0.01 +-99.5 % +-99.5 % … -99 % +lower\n"));
}

TEST(Compare, ARunWhoseSamplesAreMissingIsLeftOut) {
  const std::vector a{run("x", "k", 1)};
  std::vector b{run("x", "k", 1), run("x", "k", 9, 7)};
  amend(b[1].run.outcome, "/dropped_records", 4000);
  const auto text = render(compare(a, b), {}, Format::table);
  EXPECT_THAT(text, HasSubstr("left out: x udp (run 7) of B: 4,000 "));
  EXPECT_THAT(text, HasSubstr("A: 1 run; B: 1 of 2 runs\n")) << "no mean of two";
  EXPECT_EQ(row_of(text, "p99 ").at(2), "1000");
  const auto to = parsed_json(render(compare(a, b), {}, Format::json)).at("pairs").at(0).at("to");
  EXPECT_EQ(to.at("runs").size(), 1u);
  EXPECT_EQ(to.at("left_out").at(0).at("run"), 7);
  EXPECT_EQ(to.at("left_out").at(0).at("why"), "4,000 of its samples were not recorded");
}

TEST(Compare, ASenderThatStoodStillIsSeen) {
  std::vector a{run("x", "k", 1)}, b{run("x", "k", 1)};
  for (auto* runs : {&a, &b}) {
    runs->front().late_by_response_probability.messages = 60'000;
    runs->front().late_by_response = 0;
  }
  b[0].late_by_response = 30;
  b[0].late_by_response_probability.events = 30;
  b[0].late_by_response_probability.value = 30.0 / 60'030;
  EXPECT_EQ(row_of(render(compare(a, b), {}, Format::table), "response late % ").at(4), "0.04998");
}

TEST(Compare, ARunThatWasCutOffIsLeftOutAndNamed) {
  const std::vector a{run("x", "k", 1)};
  std::vector b{run("x", "k", 1), run("x", "k", 9, 7)};
  b[1].run.outcome = {};
  const auto text = render(compare(a, b), {}, Format::table);
  EXPECT_THAT(text, HasSubstr("left out: x udp (run 7) of B"));
  EXPECT_EQ(row_of(text, "p99 ").at(2), "1000");
  b.erase(b.begin());
  EXPECT_THAT(render(compare(a, b), {}, Format::table), HasSubstr("nothing to compare"));
}

TEST(Compare, FailedRunThatWasMeasuredAgainIsLeftOutUnnamed) {
  std::vector runs{run("x", "k", 9), run("x", "k", 1, 2), run("x", "l", 1, 3)};
  amend(runs[0].run.outcome, {{"error", "the pong died"}});
  amend(runs[2].run.asked, "/transport", "fastdds");
  const std::vector a{run("x", "k", 1)}, chosen{runs[0], runs[1]};
  for (const auto& comparison :
       {compare(a, runs), compare_chosen(a, chosen), compare_by(runs, "transport", "fastdds", "udp")}) {
    ASSERT_EQ(comparison.pairs.size(), 1U);
    ASSERT_EQ(comparison.pairs[0].to.size(), 1U);
    EXPECT_EQ(comparison.pairs[0].to[0]->run.number, 2);
  }
}

TEST(Compare, ARunThatAnsweredNothingIsNamed) {
  const std::vector a{run("x", "k", 1)};
  std::vector b{run("x", "k", 1), run("x", "k", 9, 7)};
  b[1].round_trip = {};
  const auto text = render(compare(a, b), {}, Format::table);
  EXPECT_THAT(text, HasSubstr("left out of round trips: x udp (run 7) of B"));
  EXPECT_EQ(row_of(text, "p99 ").at(2), "1000");
}

TEST(Compare, ARemarkOfSeveralRunsStandsOnceAfterTheirNames) {
  std::vector a{run("x", "k", 1), run("x", "k", 1, 2)}, b{run("x", "k", 1, 3), run("x", "k", 1, 4)};
  for (auto* one : {&a[0], &a[1], &b[0]}) one->run.outcome.conditions["controller"].cpu_stolen = 0.02;
  a[1].run.outcome.conditions["controller"].cpu_stolen = 0.04;
  const auto text = render(compare(a, b), {}, Format::markdown);
  EXPECT_EQ(text.find("the hypervisor took"), text.rfind("the hypervisor took")) << text;
  EXPECT_THAT(text, HasSubstr("x udp (run 1) of A, x udp (run 2) of A, x udp (run 3) of B: the hypervisor "
                              "took 2 % to 4 %"));
}

TEST(CompareChosen, RunsOfOtherIdsByTheirTransportsOrTheOneThatThereIs) {
  std::vector a{run("idle", "k1", 1), run("idle", "k2", 1)},
      b{run("loaded", "k3", 1), run("loaded", "k4", 1)};
  for (auto* asked : {&a[1].run.asked, &b[0].run.asked}) amend(*asked, "/transport", "fastdds");
  const auto comparison = compare_chosen(a, b);
  ASSERT_EQ(comparison.pairs.size(), 2U);
  EXPECT_EQ(comparison.pairs[0].to[0]->run.key, "k4");
  EXPECT_EQ(comparison.pairs[1].to[0]->run.key, "k3");
  const std::vector one{a[0]}, other{b[0]};
  EXPECT_EQ(compare_chosen(one, other).pairs.size(), 1U);
  EXPECT_THAT(render(compare_chosen(one, other), {}, Format::table), HasSubstr("transport: udp → fastdds"));
}

TEST(CompareChosen, RunOnBothSidesIsFoundThoughTheSidesDiffer) {
  const std::vector udp{run("a", "k1", 1), run("a", "k1", 1, 2)};
  auto other = run("a", "k2", 1, 3);
  amend(other.run.asked, "/transport", "fastdds");
  const std::vector all{udp[0], udp[1], other}, first{udp[0]}, second{udp[1]};
  const auto comparison = compare_chosen(udp, all);
  ASSERT_EQ(comparison.pairs.size(), 1U);
  EXPECT_TRUE(has_run_on_both_sides(comparison.pairs[0]));
  EXPECT_FALSE(has_run_on_both_sides(compare_chosen(first, second).pairs.at(0)));
}

TEST(CompareChosen, RunsBesideTheSameOfOthers) {
  std::vector a{run("idle", "k1", 1), run("idle", "k2", 1)},
      b{run("loaded", "k3", 1), run("loaded", "k4", 1)};
  for (auto* asked : {&a[0].run.asked, &b[1].run.asked}) amend(*asked, "/beside", "arm.period 1 ms");
  for (auto* asked : {&a[1].run.asked, &b[0].run.asked}) amend(*asked, "/beside", "arm.period 2 ms");
  const auto comparison = compare_chosen(a, b);
  ASSERT_EQ(comparison.pairs.size(), 2U);
  EXPECT_EQ(comparison.pairs[0].to[0]->run.key, "k4");
  EXPECT_THAT(gate::name_of(comparison.pairs[0].from), HasSubstr("beside arm.period 1 ms"));
}

TEST(Compare, NoRunsAreRenderedInEveryFormat) {
  const std::vector<Summary> none;
  for (const auto format : all_formats) EXPECT_NO_THROW(render(compare(none, none), {}, format));
  EXPECT_THAT(render(compare(none, none), {}, Format::table), HasSubstr("No run of A"));
}

TEST(Compare, EveryFormatSurvivesWhatOthersWrote) {
  std::vector a{run("x", "k", 1)}, b{run("x", "k", 1)};
  for (const json& replacement : {json(), json(7), json("text"), json::array({1}), json::object()}) {
    b[0].run.asked = replacement;
    amend(a[0].run.outcome, "/hosts", replacement);
    for (const auto format : all_formats) {
      EXPECT_NO_THROW(render(compare(a, b), {}, format));
      EXPECT_NO_THROW(render(compare_chosen(a, b), {}, format));
    }
  }
}

}  // namespace
}  // namespace ontime::report
