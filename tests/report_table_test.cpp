// SPDX-License-Identifier: Apache-2.0
#include "json.hpp"
#include "plot/plot.hpp"
#include "report/answer.hpp"
#include "report/comparison.hpp"
#include "report/paper.hpp"
#include "report/runs.hpp"
#include "report_fixture.hpp"

namespace ontime::report {
namespace {

using ::testing::AllOf;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

TEST(TableFormat, IsThePapersWithPercentiles) {
  auto one = summary(asked("Test1.B", "cyclonedds"), outcome(), 20'000);
  one.on_time = 19'000;
  one.late = 900;
  one.lost = 100;
  const auto text = render({one}, Format::table);
  EXPECT_THAT(row_of(text, "cyclonedds"), ElementsAre("cyclonedds", "1.0", "10000", "10000", "18000", "19800",
                                                      "19980", "~19998", "20000", "900/20000", "100/20000"));
  EXPECT_THAT(text, StartsWith("Test1.B  System under load\nSCHED_OTHER, 500 B, every 10 ms, next-free"));
  EXPECT_THAT(text, HasSubstr("later than 10 ms"));
  EXPECT_THAT(text, HasSubstr("within 500 ms"));
}

TEST(TableFormat, FailedRunThatWasMeasuredAgainIsNoRepetition) {
  std::vector<Summary> runs;
  for (const auto repetition : {1, 2, 2}) {
    runs.push_back(summary(asked("x", "udp", repetition), outcome()));
    runs.back().run.number = static_cast<std::int64_t>(runs.size());
  }
  amend(runs[1].run.outcome, {{"error", "the pong died"}});
  const auto text = render(runs, Format::table);
  EXPECT_EQ(row_of(text.substr(text.find("over repetitions")), "udp ").at(1), "2");
  EXPECT_THAT(verdict_of(runs).further, Not(HasSubstr("run to the end")));
  EXPECT_THAT(plot::gnuplot_of(runs, {plot::Plot::Figure::ccdf}), HasSubstr("(2 runs)"));
}

TEST(TableFormat, ShowsAPercentileOnlyIfThereAreAnswersToTellIt) {
  const auto cells = [](std::size_t answers) {
    return row_of(render({summary(asked("a", "udp"), outcome(), answers)}, Format::table), "udp");
  };
  EXPECT_THAT(cells(0),
              ElementsAre("udp", "(NOT", "APPLIED)", "-", "-", "-", "-", "-", "-", "-", "-", "0/0", "0/0"));
  EXPECT_EQ(cells(1).at(3), "-");
  EXPECT_EQ(cells(2).at(3), "~1.0");
  EXPECT_EQ(cells(19).at(3), "~10.0");
  EXPECT_EQ(cells(20).at(3), "10.0");
  EXPECT_EQ(cells(9).at(4), "-");
  EXPECT_EQ(cells(10).at(4), "~9.0");
  EXPECT_EQ(cells(999).at(6), "-");
  EXPECT_EQ(cells(1000).at(6), "~999");
  EXPECT_EQ(cells(10'000).at(6), "9990");
  EXPECT_EQ(cells(9'999).at(7), "-");
  EXPECT_EQ(cells(10'000).at(7), "~9999");
  EXPECT_EQ(cells(100'000).at(7), "99990");
  EXPECT_THAT(render({summary(asked("a", "udp"), outcome(), 100'000)}, Format::table), Not(HasSubstr("~")));
}

Summary with_certainty() {
  auto one = summary(asked("a", "udp"), outcome(), 100'000);
  one.round_trip_certainty[statistics::Figure::p50] = {50e6, {49e6, 51e6}, {}};
  one.round_trip_certainty[statistics::Figure::p99] = {99e6, {98.5e6, 99.5e6}, {}};
  one.round_trip_certainty[statistics::Figure::p99_9] = {99.9e6, {99.8e6, {}}, {}};
  one.missed_probability.messages = 100'000;
  one.missed_probability.bound = 3e-5;
  one.message_every_ns = 1e7;
  return one;
}

TEST(TableFormat, ShowsConfidenceIntervalsAndMissBound) {
  auto one = with_certainty();
  auto text = render({one}, Format::table);
  EXPECT_THAT(text, HasSubstr("[49000, 51000]  [98500, 99500]  ≥ 99800"));
  EXPECT_THAT(text, HasSubstr("≤ 0.003"));
  EXPECT_THAT(text, HasSubstr("none late or lost; messages needed to claim < 10⁻⁶: 3.0 million, 8.3 h"));
  EXPECT_THAT(text, HasSubstr("≥: lower"));
  // A bound that is wide says why.
  one.missed_probability.effect = 40;
  text = render({one}, Format::table);
  EXPECT_THAT(text, HasSubstr("100,000 messages, effective sample size 2500"));
  one.missed_probability.events = 200;
  one.missed_probability.sure = {0.001, 0.003};
  one.bursts = {2, 7, 70'000'000};
  text = render({one}, Format::table);
  EXPECT_THAT(text, HasSubstr("[0.1, 0.3]"));
  EXPECT_THAT(text, AllOf(HasSubstr("2 bursts"), HasSubstr("longest: 7 messages, due within 70 ms")));
  one.bursts.longest_ns = 999'600'000;
  EXPECT_THAT(render({one}, Format::table), HasSubstr("longest: 7 messages, due within 1 s"));
  // One of 100,000: its lower limit is far below.
  one.missed_probability.events = 1;
  one.missed_probability.sure = {1.2e-7, 6.44e-5};
  EXPECT_THAT(render({one}, Format::table), HasSubstr("[0.000012, 0.0065]"));
  one.missed_probability.sure = {0.99125, 0.99275};
  EXPECT_THAT(render({one}, Format::table), HasSubstr("[99.1, 99.3]"));
  one.missed_probability.events = 0;
  one.missed_probability.bound = 3e-8;
  EXPECT_THAT(render({one}, Format::table), HasSubstr("≤ 0.000003"));
}

// A limit in the estimate's place is another number: p99 of 197 µs where JSON has 5218.
TEST(AllForms, ShowTheEstimateAlsoWhereNothingBoundsIt) {
  const auto one = with_certainty();
  EXPECT_EQ(row_of(render({one}, Format::table), "udp").at(6), "99900");
  EXPECT_THAT(render({one}, Format::markdown), HasSubstr("| 99000 | 99900 |"));
  EXPECT_THAT(render({one}, Format::latex), HasSubstr("& 99000 & 99900 &"));
  EXPECT_EQ(row_by_name(render({one}, Format::csv), 0).at("round_trip_us_p99.9"), "99900.0");
  const auto run = parsed_json(render({one}, Format::json)).at("runs").at(0);
  EXPECT_EQ(run.at("round_trip_us").at("p99.9"), 99900.0);
  const std::vector<Summary> runs = {one};
  EXPECT_EQ(row_of(render(compare(runs, runs), {}, Format::table), "p99.9 ").at(1), "99900");
}

TEST(TableFormat, OneMessageHasNoTimeToClaim) {
  auto one = summary(asked("a", "udp"), outcome(), 1);
  one.missed_probability.messages = 1;
  EXPECT_THAT(render({one}, Format::table), Not(HasSubstr(" 0 ms")));
}

TEST(TableFormat, ShowsAWorstCaseOrWhyItIsRefused) {
  auto one = with_certainty();
  statistics::Bound bound;
  bound.level = 5e6;
  bound.level_lies = {4e6, 7e6};
  bound.fit_p = 0.3;
  one.extremes.maxima = one.extremes.peaks = bound;
  one.extremes.exceedance = 1.0 / 400;
  one.extremes.answers_for_a_million = 4.4e6;
  EXPECT_THAT(render({one}, Format::table),
              HasSubstr("400  5000 [4000, 7000]  0.3  5000 [4000, 7000]  0.3      1"));
  EXPECT_THAT(render({one}, Format::table), HasSubstr("4.4 million answers"));
  one.extremes.answers_for_a_million = 4'037'926;
  EXPECT_THAT(render({one}, Format::table), HasSubstr("4.1 million answers")) << "4.0 would not suffice";
  auto wide = one;
  wide.extremes.maxima->level_lies = wide.extremes.peaks->level_lies = {4e9, 1e11};
  for (const auto& line : lines_of(render({wide}, Format::table, {}, 80)))
    EXPECT_LE(width_of(line), 80u) << line;
  one.extremes.peaks->refused = "it drifts";
  const auto text = render({one}, Format::table);
  EXPECT_THAT(text, HasSubstr("udp: no extrapolated worst case: it drifts"));
  EXPECT_THAT(text, Not(HasSubstr("5000 [4000")));
  EXPECT_THAT(text, Not(HasSubstr("Slowest (µs)"))) << "a table of nothing";
  auto other = one;
  amend(other.run.asked, "/transport", "fastdds");
  const auto both = render({one, other}, Format::table);
  EXPECT_THAT(both, HasSubstr("all runs: no extrapolated worst case"));
  EXPECT_EQ(both.find("it drifts"), both.rfind("it drifts")) << "once";
  one.extremes.maxima->refused = "it fits badly (Anderson-Darling, p = 0.01)";
  one.extremes.peaks->refused = "it fits badly (Anderson-Darling, p = 0.0025)";
  const auto alike = render({one}, Format::table);
  EXPECT_THAT(alike, HasSubstr("it fits badly"));
  EXPECT_EQ(alike.find("it fits badly"), alike.rfind("it fits badly")) << "once";
}

TEST(Json, RefusesBothWorstCasesWhereTheTextDoes) {
  auto one = with_certainty();
  one.extremes.maxima.emplace();
  one.extremes.peaks.emplace().refused = "it drifts";
  one.extremes.exceedance = 1.0 / 400;
  const auto extremes = parsed_json(render({one}, Format::json)).at("runs").at(0).at("extremes");
  EXPECT_EQ(extremes.at("refused"), "it drifts");
  for (const auto* method : {"block_maxima", "peaks_over_threshold"}) {
    EXPECT_EQ(extremes.at(method).at("allowed"), false) << method;
    EXPECT_EQ(extremes.at(method).at("refused"), "it drifts") << method;
  }
  const auto row = row_by_name(render({one}, Format::csv), 0);
  EXPECT_EQ(row.at("block_maxima_allowed"), "false");
  EXPECT_EQ(row.at("extremes_exceedance"), "0.0025");
  one.extremes.peaks->refused = "";
  EXPECT_EQ(row_by_name(render({one}, Format::csv), 0).at("block_maxima_allowed"), "true");
}

TEST(TableFormat, ShowsEachStageOfAResponse) {
  auto one = summary(asked("a", "udp"), outcome(), 10'000);
  one.server = one.round_trip;
  one.wake_up[statistics::Figure::p99_9] = 77'000;
  const auto lines = lines_of(render({one}, Format::table));
  const auto header = std::find_if(lines.begin(), lines.end(),
                                   [](const std::string& line) { return line.starts_with("p99.9 (µs)"); });
  ASSERT_NE(header, lines.end());
  EXPECT_THAT(row_of(*std::next(header), "udp"),
              ElementsAre("udp", "77.0", "-", "9990", "-", "9990", "9990"));
}

TEST(TableFormat, MarksAStageThatTheSampleDoesNotSupport) {
  auto one = summary(asked("a", "udp"), outcome(), 5000);
  one.response_certainty[statistics::Figure::p99_9] = {4.99e6, {4.9e6, {}}, {}};
  const auto lines = lines_of(render({one}, Format::table));
  const auto header = std::find_if(lines.begin(), lines.end(),
                                   [](const std::string& line) { return line.starts_with("p99.9 (µs)"); });
  ASSERT_NE(header, lines.end());
  EXPECT_THAT(*std::next(header), AllOf(HasSubstr("~4995"), Not(HasSubstr(" 4995")), Not(HasSubstr("4900"))));
}

TEST(TableFormat, GivesWholeMicrosecondsFromAHundredOn) {
  const auto shown = [](std::int64_t ns) {
    auto one = summary(asked("a", "udp"), outcome());
    std::vector<std::int64_t> values = {ns};
    one.round_trip = statistics::distribution(values);
    return row_of(render({one}, Format::table), "udp").at(1);
  };
  EXPECT_EQ(shown(40), "0.0");
  EXPECT_EQ(shown(98'760), "98.8");
  EXPECT_EQ(shown(99'949), "99.9");
  EXPECT_EQ(shown(99'950), "100");
  EXPECT_EQ(shown(1'234'567), "1235");
}

TEST(TableFormat, FitsAHundredColumns) {
  std::vector<Summary> runs;
  for (const auto* id : {"Test1.A", "Test1.B"}) {
    for (const auto* transport : {"udp", "cyclonedds", "fastdds"}) {
      runs.push_back(summary(asked(id, transport), outcome(), 60'001));
      runs.back().lost = 1230;
      runs.back().skipped_cycles = 30'000;
      const auto sure = with_certainty();
      runs.back().round_trip_certainty = sure.round_trip_certainty;
      runs.back().missed_probability = sure.missed_probability;
    }
  }
  for (const auto& line : lines_of(render(runs, Format::table))) EXPECT_LE(width_of(line), 100u) << line;
  for (const auto& line : lines_of(render_threads(runs, Format::table)))
    EXPECT_LE(width_of(line), 100u) << line;
}

TEST(TableFormat, RepetitionsFitEightyColumns) {
  std::vector<Summary> runs;
  for (const auto repetition : {1, 2}) {
    runs.push_back(summary(asked("x", "cyclonedds", repetition), outcome(), repetition == 1 ? 2000 : 9000));
    const auto sure = with_certainty();
    runs.back().round_trip_certainty = sure.round_trip_certainty;
    runs.back().missed_probability = sure.missed_probability;
  }
  const auto text = render(runs, Format::table, {}, 80);
  ASSERT_THAT(text, HasSubstr("over repetitions"));
  for (const auto& line : lines_of(text)) EXPECT_LE(width_of(line), 80u) << line;
  const auto row = row_of(text.substr(text.find("over repetitions")), "cyclonedds");
  EXPECT_THAT(row, ::testing::ElementsAre("cyclonedds", ::testing::_, "[1000,", ::testing::_, ::testing::_,
                                          ::testing::_, ::testing::_, ::testing::_, "[2000,", "9000]",
                                          ::testing::_, ::testing::_, ::testing::_))
      << "p50, p99, max and misses remain";
}

// Late by response time alone: late in the answer's row and verdict.
TEST(TableFormat, MissedSharesCountWhatTheVerdictCounts) {
  std::vector<Summary> runs;
  for (const auto repetition : {1, 2}) {
    auto& one = runs.emplace_back(summary(asked("x", "udp", repetition), outcome()));
    one.late_by_response = 100;
    auto& late = one.late_by_response_probability;
    late.events = 100;
    late.messages = one.missed_probability.messages = 2000;
    late.sure = {0.04, 0.06};
    one.missed_probability.bound = 0.01;
  }
  EXPECT_EQ(answer_of(runs, {}).rows.at(0).missed, 200U);
  const auto text = render(runs, Format::markdown);
  const auto spread = text.substr(text.find("over repetitions"));
  EXPECT_THAT(spread, HasSubstr("| 5 \\[5, 5\\] |"));
  EXPECT_THAT(spread.substr(spread.find("95 %")), HasSubstr("| \\[4, 6\\] |"));
}

TEST(TableFormat, ALateMessageThatHeldUpCyclesIsNoLoneMiss) {
  auto one = summary(asked("x", "udp"), outcome());
  one.late = 1;
  one.late_by_response = 1;
  one.missed_probability.events = 1;
  one.missed_probability.messages = 2000;
  EXPECT_THAT(render({one}, Format::markdown), HasSubstr("never two late or lost in a row"));
  one.late_by_response = 50;
  one.late_by_response_probability = one.missed_probability;
  EXPECT_THAT(render({one}, Format::markdown), Not(HasSubstr("in a row")));
}

TEST(Paper, AllItsRowsAreThere) {
  ASSERT_EQ(paper().size(), 45U);
  const auto& odd = paper().at(36);  // its title has a comma
  EXPECT_EQ(odd.test, "Test3.C");
  EXPECT_EQ(odd.dds, "DDS 1");
  EXPECT_EQ(odd.max_us, 179909);
  EXPECT_EQ(odd.lost, 75U);
  EXPECT_EQ(odd.messages, 30000U);
}

TEST(Paper, FiguresStandBesideOursWhereTheConditionsAreIts) {
  const auto text = render({summary(asked("Test1.B", "udp"), outcome())}, Format::table);
  EXPECT_THAT(text, HasSubstr("paper's DDS 1"));
  EXPECT_THAT(text, HasSubstr("The paper's load: 8 workers")) << "it is not of this run";
  EXPECT_EQ(row_of(text, "paper's DDS 2"), (std::vector<std::string>{"paper's", "DDS", "2", "1082", "2150",
                                                                     "26764", "236/58905", "0/58905"}));
  EXPECT_THAT(text, HasSubstr("2018"));
  const auto run =
      parsed_json(render({summary(asked("Test1.B", "udp"), outcome())}, Format::json)).at("runs").at(0);
  EXPECT_EQ(run.at("paper").at(2).at("avg_us"), 2750);
  const json others = {{"id", "Test9.A"},
                       {"period_us", 5000},
                       {"payload_bytes", 501},
                       {"schedule", "fixed"},
                       {"realtime", true},
                       {"load", nullptr},
                       {"traffic", {{"bit_s", 40'000'000}}},
                       {"link", {{"loss", 0.1}}},
                       {"kernel", {{"rt-throttling", "off"}}}};
  for (const auto& [key, value] : others.items()) {
    auto other = asked("Test1.B", "udp");
    other[key] = value;
    EXPECT_THAT(render({summary(other, outcome())}, Format::table), Not(HasSubstr("paper"))) << key;
  }
}

TEST(Paper, EachTestHasTheConditionsOfItsCaption) {
  auto busy = asked("Test2.F", "udp");
  busy["realtime"] = true;
  busy["traffic"] = {{"bit_s", 80'000'000}};
  EXPECT_EQ(paper_rows(busy).size(), 3U);
  busy["id"] = "Test2.E";  // which has no load
  EXPECT_TRUE(paper_rows(busy).empty());
  busy["id"] = "Test4.A";
  EXPECT_TRUE(paper_rows(busy).empty());
  busy["kernel"] = {{"ksoftirqd", 60}};
  EXPECT_EQ(paper_rows(busy).size(), 3U);
  auto large = asked("Test3.B", "udp");
  large["realtime"] = true;
  large["payload_bytes"] = 32768;
  EXPECT_EQ(paper_rows(large).size(), 3U) << "its caption has a comma";
}

TEST(TableFormat, ShowsWhereJudgingByResponseDiffers) {
  auto one = summary(asked("a", "udp"), outcome());
  one.late = 3;
  one.skipped_cycles = 57;
  one.late_by_response = 3;
  auto text = render({one}, Format::table);
  EXPECT_THAT(text, AllOf(HasSubstr("3/2000"), Not(HasSubstr("by response time:"))));
  auto other = one;
  amend(other.run.asked, "/transport", "fastdds");
  other.late_by_response = 41;
  text = render({one, other}, Format::table);
  EXPECT_EQ(row_of(text, "udp").at(9), "3/2000");
  EXPECT_EQ(row_of(text, "udp").at(10), "3/2057");
  EXPECT_EQ(row_of(text, "fastdds").at(9), "3/2000");
  EXPECT_EQ(row_of(text, "fastdds").at(10), "41/2057");
  EXPECT_THAT(text, AllOf(HasSubstr("by response time: cycles"), HasSubstr("skipped cycles: 57")));
  EXPECT_EQ(parsed_json(render({other}, Format::json)).at("runs").at(0).at("late_by_response"), 41);
}

TEST(TableFormat, ShowsTheThreeParts) {
  const auto with = [](std::int64_t there_us, bool one_clock, int repetition) {
    auto one = summary(asked("a", "udp", repetition), outcome());
    one.parts = statistics::Parts{statistics::distribution({there_us * 1000}),
                                  statistics::distribution({11'000}), one_clock ? 0 : 7000, one_clock};
    one.server = statistics::distribution({5000});
    return one;
  };
  EXPECT_THAT(lines_of(render({with(12, true, 1)}, Format::table)),
              Contains("  udp: medians: request leg 12.0 µs, server 5.0 µs, reply leg 11.0 µs (one clock)"));
  EXPECT_THAT(lines_of(render({with(12, false, 1), with(14, false, 2)}, Format::table)),
              Contains(StartsWith(
                  "  udp: medians of 2 runs: request leg 13.0 µs, server 5.0 µs, reply leg 11.0 µs")));
  EXPECT_THAT(render({with(12, false, 1)}, Format::table), HasSubstr("±7.0"));
  const auto run = parsed_json(render({with(12, false, 1)}, Format::json)).at("runs").at(0);
  EXPECT_EQ(run.at("request_leg_us").at("p50"), 12.0);
  EXPECT_EQ(run.at("there_us"), run.at("request_leg_us")) << "its earlier name";
  EXPECT_EQ(run.at("reply_leg_us").at("p50"), 11.0);
  EXPECT_EQ(run.at("parts"), json({{"clocks", "synchronised"}, {"error_us", 7.0}, {"left_out", nullptr}}));

  auto without = summary(asked("a", "udp"), outcome());
  EXPECT_EQ(parsed_json(render({without}, Format::json)).at("runs").at(0).at("parts"), nullptr);
  without.no_parts = "the clocks disagree";
  EXPECT_THAT(render({without}, Format::table), HasSubstr("udp: the clocks disagree"));
}

TEST(Wrapped, NumberAndUnitStayTogether) {
  EXPECT_EQ(table::wrapped("a run of 2 s, no load", 10), "a run of\n  2 s, no\n  load\n");
  EXPECT_EQ(table::wrapped("98 % to 99 % late", 11), "98 % to\n  99 % late\n");
  EXPECT_EQ(table::wrapped("traffic: 60 Mbit/s", 13), "traffic:\n  60 Mbit/s\n");
  EXPECT_EQ(table::wrapped("[0 %, 0.806 %]; few", 14), "[0 %,\n  0.806 %];\n  few\n");
  EXPECT_EQ(table::wrapped("at 18:03:20  6.8 ms old", 12), "at 18:03:20\n  6.8 ms old\n");
}

TEST(Wrapped, ValuesStayWholeAndApart) {
  EXPECT_EQ(table::wrapped("late 0 of 9  lost unknown  out of order 1", 26),
            "late 0 of 9  lost unknown\n  out of order 1\n");
  EXPECT_EQ(table::wrapped("late 0 of 9  out of order 1", 13), "late 0 of 9\n  out of\n  order 1\n")
      << "it is longer than a line";
  EXPECT_EQ(table::wrapped("  a  b", 80, "    "), "    a  b\n");
  EXPECT_EQ(table::wrapped("late 0 of 9  ", 12), "late 0 of 9\n");
}

}  // namespace
}  // namespace ontime::report
