// SPDX-License-Identifier: Apache-2.0
#include <boost/property_tree/ptree.hpp>
#include <boost/property_tree/xml_parser.hpp>

#include "report/comparison.hpp"
#include "report/export.hpp"
#include "report_fixture.hpp"

namespace ontime::report {
namespace {

using gate::Judgement;
using record::amend;
using statistics::Measured;
using ::testing::HasSubstr;
using ::testing::Not;

// A run with this key whose p99 is so many ms, surely within a tenth of it.
Summary run(const std::string& id, const std::string& key, double p99_ms, std::int64_t number = 1) {
  auto one = summary(asked(id, "udp"), outcome());
  one.run.key = key;
  one.run.number = number;
  Measured p99;
  p99.value = p99_ms * 1e6;
  p99.sure = p99.surer = {p99.value * 0.9, p99.value * 1.1};
  one.round_trip_certainty[statistics::Figure::p99] = p99;
  return one;
}

json figure_of(const json& pair, const std::string& name) {
  for (const auto& figure : pair.at("figures"))
    if (figure.at("figure") == name) return figure;
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
  const auto document = json::parse(render(comparison, {}, Format::json));
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

TEST(Compare, NameOfAnyLengthLeavesTheLineReadable) {
  const std::string endless(100'000, 'x');
  const auto text = render(compare({run(endless, "k1", 1)}, {run(endless, "k2", 1)}), {}, Format::table);
  EXPECT_LT(text.size(), 10'000U);
}

TEST(Compare, SaysBetterWorseOrCannotTell) {
  const auto verdict = [](double from, double to) {
    const std::vector a{run("x", "k", from), run("x", "k", from, 2)},
        b{run("x", "k", to), run("x", "k", to, 2)};
    const auto document = json::parse(render(compare(a, b), {}, Format::json));
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
  EXPECT_THAT(text, HasSubstr("repeat: 5"));
  const auto pair = json::parse(render(compare(a, b), {}, Format::json)).at("pairs").at(0);
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

TEST(Compare, KeyPairsRunsThatAreOtherwiseEqual) {
  std::vector<Summary> runs;
  for (const auto* transport : {"udp", "fastdds"})
    for (const auto* value : {"on", "off"})
      for (const int repetition : {1, 2}) {
        auto one = run(value, std::string(transport) + value, repetition);
        amend(one.run.asked, "/transport", transport);
        amend(one.run.asked, "/kernel", {{"threaded-napi", value}});
        runs.push_back(one);
      }
  EXPECT_EQ(values_of(runs, "kernel.threaded-napi"), (std::vector<std::string>{"on", "off"}));
  EXPECT_EQ(values_of(runs, "kernel.irq-threads"), (std::vector<std::string>{unset}));
  EXPECT_EQ(values_of(runs, "period"), values_of(runs, "period_us")) << "a record's own names serve, too";
  EXPECT_EQ(values_of(runs, "period"), (std::vector<std::string>{"10000"}));
  const auto comparison = compare_by(runs, "kernel.threaded-napi", "off", "on");
  ASSERT_EQ(comparison.pairs.size(), 2U);
  EXPECT_EQ(comparison.pairs[0].from.size(), 2U);
  EXPECT_EQ(comparison.pairs[0].from[0]->run.asked.kernel.at("threaded-napi"), "off");
  EXPECT_EQ(comparison.pairs[1].to[1]->run.asked.task.transport, "fastdds");
  EXPECT_TRUE(comparison.only_from.empty() && comparison.only_to.empty());
}

// A run for each of these runs, as an ontime records them.
std::vector<Summary> recorded(const std::vector<conditions::Run>& asked) {
  std::vector<Summary> runs;
  for (const auto& one : asked) {
    runs.push_back(run("x", std::to_string(runs.size()), 1));
    amend(runs.back().run.asked, conditions::to_json(one));
  }
  return runs;
}

conditions::Run said(std::initializer_list<std::pair<std::string, std::string>> words) {
  conditions::Run one;
  for (const auto& [path, value] : words)
    std::ranges::find(conditions::keys(), path, &conditions::Key::path)->set(one, value);
  return one;
}

TEST(Compare, KeyIgnoresSettingsThatFollowFromIt) {
  auto multi = said({{"transport", "ros2"}}), single = multi;
  multi.task.config.options["executor"] = "multi";
  single.task.config.options["executor"] = "single";
  struct Case {
    std::string key;
    conditions::Run from, to;
  };
  for (const auto& [key, from, to] :
       {Case{"transport", said({{"transport", "udp"}}), said({{"transport", "fastdds"}})},
        Case{"options.executor", multi, single}, Case{"realtime", {}, said({{"realtime", "on"}})},
        Case{"realtime.priority", said({{"realtime", "on"}}), said({{"realtime.priority", "90"}})},
        Case{"realtime.lock-memory", said({{"realtime", "on"}}), said({{"realtime.lock-memory", "off"}})},
        Case{"traffic.rate", {}, said({{"traffic.rate", "1 Mbit/s"}})},
        Case{"link.duplicate", {}, said({{"link.duplicate", "1 %"}})},
        Case{"background.rate", said({{"background.topics", "2"}}),
             said({{"background.topics", "2"}, {"background.rate", "50 Hz"}})},
        Case{"background.direction", said({{"background.topics", "2"}}),
             said({{"background.topics", "2"}, {"background.direction", "to-component"}})},
        Case{"launch-time", {}, said({{"launch-time", "1 ms"}})}}) {
    const auto runs = recorded({from, to});
    const auto values = values_of(runs, key);
    ASSERT_EQ(values.size(), 2U) << key;
    EXPECT_EQ(compare_by(runs, key, values[0], values[1]).pairs.size(), 1U) << key;
  }
}

TEST(Compare, KeyLeavesOutRunsThatDifferInMore) {
  const auto runs = recorded({{}, said({{"realtime", "on"}}), said({{"realtime.priority", "90"}})});
  const auto comparison = compare_by(runs, "realtime", "false", "true");
  ASSERT_EQ(comparison.pairs.size(), 1U);
  EXPECT_EQ(comparison.pairs[0].to.size(), 1U);
  EXPECT_EQ(comparison.only_to.size(), 1U);
}

TEST(Compare, KeyComparesTheOtherKeysOfItsGroup) {
  std::vector<conditions::Run> all;
  for (const auto* rate : {"1 Mbit/s", "2 Mbit/s"})
    for (const auto* size : {"1470 B", "100 B"})
      all.push_back(said({{"traffic.rate", rate}, {"traffic.datagram", size}}));
  const auto runs = recorded(all);
  const auto values = values_of(runs, "traffic.rate");
  ASSERT_EQ(values.size(), 2U);
  EXPECT_EQ(compare_by(runs, "traffic.rate", values[0], values[1]).pairs.size(), 2U);
}

TEST(Compare, GivesDifferenceAndRatioWithTheirIntervals) {
  const std::vector a{run("x", "k", 1)}, b{run("x", "k", 2)};
  const auto comparison = compare(a, b);
  const auto p99 =
      figure_of(json::parse(render(comparison, {}, Format::json)).at("pairs").at(0), "round_trip_us.p99");
  EXPECT_DOUBLE_EQ(p99.at("from").get<double>(), 1000);
  EXPECT_DOUBLE_EQ(p99.at("difference").get<double>(), 1000);
  EXPECT_LT(p99.at("difference_low"), p99.at("difference"));
  EXPECT_GT(p99.at("difference_high"), p99.at("difference"));
  EXPECT_DOUBLE_EQ(p99.at("ratio").get<double>(), 2);
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
  const auto pair = json::parse(render(compare(a, b), {}, Format::json)).at("pairs").at(0);
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
  EXPECT_THAT(shown(), ::testing::ContainsRegex("lost % +0 +0 +- +-60 … \\+5 +cannot tell\n"));
  // Between half and twice, too.
  const auto p99 = [](Summary& one, double low, double high) {
    one.round_trip_certainty[statistics::Figure::p99].surer = {low * 1e6, high * 1e6};
  };
  p99(a[0], 0.3, 3);
  p99(b[0], 0.6, 6);
  EXPECT_THAT(shown(), ::testing::ContainsRegex("p99 +1000 +2000 +- +- +too few messages\n"));
  b.push_back(b[0]);
  EXPECT_THAT(shown(), ::testing::ContainsRegex("p99 +1000 +2000 +- +- +too few runs or messages\n"));
}

TEST(Compare, ShowsWhatElseDiffers) {
  const std::vector a{run("x", "k", 1)};
  std::vector b{run("x", "k", 1)};
  amend(b[0].run.outcome, "/hosts/controller/machine/kernel", "6.6\x1b[31m");
  amend(b[0].run.outcome, "/hosts/controller/machine/boot_id", "another each time");
  amend(b[0].run.outcome, "/hosts/component/transport/version", "0.2.0");
  const auto found =
      json::parse(render(compare(a, b), {}, Format::json)).at("pairs").at(0).at("not_the_same");
  const auto difference = [](const char* what, const char* from, const char* to) {
    return json{{"what", what}, {"from", from}, {"to", to}};
  };
  EXPECT_EQ(found, (json{difference("component transport version", "0.1.0", "0.2.0"),
                         difference("controller kernel", "6.1", "6.6?[31m")}));
  EXPECT_THAT(render(compare(a, b), {}, Format::table), HasSubstr("also different (A → B)"));
  EXPECT_THAT(render(compare(a, a), {}, Format::table), Not(HasSubstr("also different")));
}

TEST(Compare, RequestedAndAchievedDifferencesAreListed) {
  const std::vector a{run("x", "k", 1)};
  std::vector b{run("x", "k", 1, 7)};
  amend(b[0].run.asked, {{"traffic", {{"bit_s", 80'000'000}}},
                         {"link", {{"loss", 0.1}}},
                         {"kernel", {{"irq-threads", 90}}},
                         {"repetition", 3},
                         {"payload_bytes", 500.0}});
  auto& outcome = b[0].run.outcome;
  amend(outcome, "/traffic/to_component/short", true);
  amend(outcome, "/link_unproved", "it is not proved");
  amend(outcome, "/hosts/controller/load_running", false);
  amend(outcome, "/hosts/component/refusals", {{{"asked", "fifo 80"}, {"found", "EPERM"}, {"remedy", "y"}}});
  std::vector<std::string> found;
  const auto document = json::parse(render(compare(a, b), {}, Format::json));
  for (const auto& one : document.at("pairs").at(0).at("not_the_same"))
    found.push_back(one.at("what").get<std::string>() + ": " + one.at("from").get<std::string>() + ", " +
                    one.at("to").get<std::string>());
  EXPECT_THAT(found,
              ::testing::ElementsAre("component refused fifo 80: -, EPERM",
                                     "controller load_running: true, false", "kernel irq-threads: -, 90",
                                     "link loss: -, 0.1", "link_unproved: -, it is not proved",
                                     "traffic bit_s: -, 80000000", "traffic to_component short: -, true"));
  EXPECT_THAT(render(compare(a, b), {}, Format::table),
              AllOf(HasSubstr("x udp #3 (run 7) of B: "), HasSubstr("load on the controller")));
}

TEST(Compare, ARunWhoseSamplesAreMissingIsLeftOut) {
  const std::vector a{run("x", "k", 1)};
  std::vector b{run("x", "k", 1), run("x", "k", 9, 7)};
  amend(b[1].run.outcome, "/dropped_records", 4000);
  const auto text = render(compare(a, b), {}, Format::table);
  EXPECT_THAT(text, HasSubstr("left out: x udp (run 7) of B: 4000 "));
  EXPECT_EQ(row_of(text, "p99 ").at(2), "1000");
  const auto to = json::parse(render(compare(a, b), {}, Format::json)).at("pairs").at(0).at("to");
  EXPECT_EQ(to.at("runs").size(), 1u);
  EXPECT_EQ(to.at("left_out").at(0).at("run"), 7);
  EXPECT_EQ(to.at("left_out").at(0).at("why"), "4000 of its samples were not recorded");
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
  EXPECT_THAT(text, HasSubstr("left out except for late and lost: x udp (run 7) of B"));
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

// --- the answer first ---

// One run of a condition: so many of 60,000 cycles without an answer in time.
Summary with_misses(const std::string& id, const std::string& key, std::uint64_t events,
                    const char* transport = "udp") {
  auto one = run(id, key, 1);
  amend(one.run.asked, "/transport", transport);
  const double share = static_cast<double>(events) / 60'000;
  one.late_by_response = events;
  one.late_by_response_probability.messages = 60'000;
  one.late_by_response_probability.events = events;
  one.late_by_response_probability.value = share;
  one.late_by_response_probability.sure = one.late_by_response_probability.surer = {share * 0.9, share * 1.1};
  return one;
}

std::string answer_of(const Comparison& comparison) {
  return render_answer(comparison, {}, Format::table, "ontime compare a b --full", 80);
}

TEST(CompareAnswer, SaysFewerAndMoreEachWithItsPairs) {
  const std::vector a{with_misses("x", "k1", 900), with_misses("x", "k2", 10, "fastdds"),
                      with_misses("x", "k3", 0, "cyclonedds")};
  const std::vector b{with_misses("x", "k1", 30), with_misses("x", "k2", 700, "fastdds"),
                      with_misses("x", "k3", 0, "cyclonedds")};
  const auto text = answer_of(compare(a, b));
  EXPECT_TRUE(
      text.starts_with("B has fewer cycles without an answer in time (udp) and more (fastdds) than A."))
      << text;
  EXPECT_THAT(text, ::testing::ContainsRegex("udp +1\\.5 % → 0\\.05 % \\*"));
  EXPECT_THAT(text, ::testing::ContainsRegex("cyclonedds +0  "));
  EXPECT_THAT(text, AllOf(HasSubstr("Caution: one run per side"), HasSubstr("repeat: 5")));
  EXPECT_THAT(text, HasSubstr("All metrics:  ontime compare a b --full"));
}

TEST(CompareAnswer, ChangeWithinChanceIsNotProven) {
  const std::vector a{with_misses("x", "k1", 100)}, b{with_misses("x", "k1", 101)};
  EXPECT_TRUE(answer_of(compare(a, b)).starts_with("No difference in "));
}

TEST(CompareAnswer, RunThatIsLeftOutIsNoDifference) {
  const std::vector a{with_misses("x", "k1", 100)};
  std::vector b{with_misses("x", "k1", 100)};
  b.front().run.outcome = json{{"interrupted", true}};
  const auto text = answer_of(compare(a, b));
  EXPECT_THAT(text, HasSubstr("left out"));
  EXPECT_THAT(text, Not(HasSubstr("Also different")));
  EXPECT_TRUE(text.starts_with("Nothing to compare"));
}

TEST(CompareAnswer, ManySettingsOfOneKindAreCounted) {
  const std::vector a{with_misses("x", "k1", 100)};
  std::vector b{with_misses("x", "k1", 30)};
  amend(b[0].run.asked, {{"kernel", {{"irq-threads", 90}, {"threaded-napi", "on"}}}, {"repetition", 3}});
  amend(b[0].run.outcome, "/hosts/component/transport/version", "0.2.0");
  EXPECT_THAT(answer_of(compare(a, b)),
              HasSubstr("Also different: component transport version: 0.1.0 → 0.2.0; kernel (2 values)"));
}

TEST(CompareAnswer, RowNamesBothTransports) {
  const std::vector a{with_misses("x", "k1", 100)}, b{with_misses("x", "k2", 100, "fastdds")};
  EXPECT_THAT(answer_of(compare_chosen(a, b)), ::testing::ContainsRegex("\nudp → fastdds +0\\.17 %"));
  EXPECT_THAT(answer_of(compare_chosen(a, a)), ::testing::ContainsRegex("\nudp +0\\.17 %"));
}

TEST(CompareAnswer, CautionNamesItsSideAndThatOfBComesFirst) {
  std::vector a{with_misses("x", "k1", 100)}, b{with_misses("x", "k1", 100)};
  a[0].run.outcome.conditions["controller"].clock_moved_s = 1;
  b[0].run.outcome.conditions["controller"].clock_moved_s = 2;
  auto comparison = compare(a, b);
  comparison.from_name = "old.ontime";
  comparison.to_name = "new.ontime";
  const auto text = answer_of(comparison);
  const auto of_b = text.find("Caution: x udp (run 1) of new.ontime: ");
  ASSERT_NE(of_b, text.npos) << text;
  const auto of_a = text.find("Caution: x udp (run 1) of old.ontime: ");
  EXPECT_LT(of_b, of_a) << text;
  comparison.one_file = true;
  EXPECT_THAT(answer_of(comparison), Not(HasSubstr(") of ")));
}

TEST(CompareAnswer, RepetitionsSayWhatIsShown) {
  const std::vector one{with_misses("x", "k1", 100)},
      two{with_misses("x", "k1", 100), with_misses("x", "k1", 100)};
  EXPECT_THAT(answer_of(compare(two, two)), HasSubstr("mean"));
  EXPECT_THAT(answer_of(compare(one, one)), Not(HasSubstr("mean")));
}

TEST(CompareAnswer, FitsAScreenWhateverOthersWrote) {
  std::vector<Summary> a, b;
  for (int i = 0; i < 40; ++i) {
    const auto key = "k" + std::to_string(i);
    a.push_back(with_misses("x" + key, key, 900));
    b.push_back(with_misses("x" + key, key, 30));
    amend(b.back().run.asked, {{"kernel", {{"name" + std::string(400, 'x') + key, "\x1b[31m"}}}});
  }
  const auto text = answer_of(compare(a, b));
  EXPECT_LE(std::count(text.begin(), text.end(), '\n'), 24) << text;
  EXPECT_THAT(text, Not(HasSubstr("\x1b")));
  EXPECT_THAT(text, HasSubstr("… and 31 more"));
}

// --- JUnit ---

boost::property_tree::ptree parsed(const std::string& xml) {
  std::istringstream in(xml);
  boost::property_tree::ptree tree;
  read_xml(in, tree);
  return tree;
}

TEST(JUnit, CountsFailuresAndErrorsApart) {
  const auto tree =
      parsed(junit({{Judgement::Result::held, "x udp", "p99 > 2 ms", "p99 is 1 ms"},
                    {Judgement::Result::missed, "x udp", "late > 0", "3 of 100 messages"},
                    {Judgement::Result::cannot_judge, "y udp", "late > 0", "it failed: no pong"}}));
  const auto& suite = tree.get_child("testsuites.testsuite");
  EXPECT_EQ(suite.get<int>("<xmlattr>.tests"), 3);
  EXPECT_EQ(suite.get<int>("<xmlattr>.failures"), 1);
  EXPECT_EQ(suite.get<int>("<xmlattr>.errors"), 1);
  std::vector<std::string> failures;
  for (const auto& [name, test] : suite)
    if (name == "testcase" && test.get_child_optional("failure"))
      failures.push_back(test.get<std::string>("<xmlattr>.name") + ": " +
                         test.get<std::string>("failure.<xmlattr>.message"));
  EXPECT_THAT(failures, ::testing::ElementsAre("late > 0: 3 of 100 messages"));
}

TEST(JUnit, TextStaysText) {
  const auto xml = junit({{Judgement::Result::missed, "<script>\"'&]]>\x01\x1b\xff", "a<b", "\n</failure>"}});
  const auto tree = parsed(xml);
  EXPECT_EQ(tree.get<std::string>("testsuites.testsuite.testcase.<xmlattr>.classname"), "<script>\"'&]]>???");
  EXPECT_EQ(tree.get<std::string>("testsuites.testsuite.testcase.failure.<xmlattr>.message"), " </failure>");
  EXPECT_EQ(xml.find('\x01'), xml.npos);
}

}  // namespace
}  // namespace ontime::report
