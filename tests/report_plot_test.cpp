// SPDX-License-Identifier: Apache-2.0
// Figures for papers, as commands for gnuplot.
#include <fmt/format.h>

#include "plot/plot.hpp"
#include "plot/sheet.hpp"
#include "report/runs.hpp"
#include "report_fixture.hpp"

namespace ontime::report {
namespace {

using plot::gnuplot_of, plot::Plot;
using ::testing::HasSubstr;
using ::testing::Not;

TEST(Gnuplot, is_given_texts_that_end_nowhere_and_no_extreme_is_missing) {
  auto run = summary(asked("it's\n`touch x` \"", "u'dp\nset output 'x'"), outcome());
  run.shape.slice_ns = 10 * ms;
  run.shape.slices = {{.sent = 3, .late = 1, .min_ns = 100'000, .p50_ns = 200'000, .max_ns = 27'654'321},
                      {.sent = 1, .lost = 1}};
  run.shape.round_trip = {{100'000, 106'250, 2}, {27'262'976, 28'311'552, 1}};
  for (const auto figure :
       {Plot::Figure::time, Plot::Figure::ccdf, Plot::Figure::conditions, Plot::Figure::payload}) {
    const auto commands = gnuplot_of({run}, {figure, Plot::Form::svg, false});
    EXPECT_THAT(commands, Not(HasSubstr("\nset output")));
    for (const auto& line : lines_of(commands))
      EXPECT_EQ(std::count(line.begin(), line.end(), '\'') % 2, 0) << line;
  }
  EXPECT_THAT(gnuplot_of({run}, {}), HasSubstr("0.005 27.6543\n"));
}

Summary plotted(const std::string& id, const std::string& transport, std::uint64_t repetition = 1) {
  auto request = asked(id, transport);
  request["repetition"] = repetition;
  auto run = summary(request, outcome(), 2000);
  run.shape.slice_ns = 10 * ms;
  run.shape.slices = {{.sent = 2000, .min_ns = 100'000, .p50_ns = 200'000, .max_ns = 9 * ms}};
  run.shape.round_trip = {{100'000, 104'427, 1990}, {8'000'000, 8'354'210, 10}};
  run.round_trip = statistics::distribution({100'000, 8 * ms});
  return run;
}

// gnuplot reads `''` at the beginning of a string as an empty one.
TEST(Gnuplot, ATextIsOneStringWhereverItHasItsQuotes) {
  auto run = plotted("'quoted' id''", "udp");
  amend(run.run.asked, "/title", "'' '@macro `touch x` \"$(touch x)\" \\");
  for (const auto figure :
       {Plot::Figure::time, Plot::Figure::ccdf, Plot::Figure::conditions, Plot::Figure::payload}) {
    std::string texts;
    for (const auto& line : lines_of(gnuplot_of({run}, {figure, Plot::Form::svg, false}))) {
      if (!line.starts_with("set label ")) continue;
      EXPECT_THAT(
          line, ::testing::MatchesRegex("set label '[^']*'([.]\"[\\]047\"[.]'[^']*')* at screen [^\"`@\\]*"));
      texts += table::replace_all(line, "'.\"\\047\".'", "’");
    }
    EXPECT_THAT(texts, HasSubstr("set label '’quoted’ id’’ udp"));
    if (figure != Plot::Figure::payload) {
      EXPECT_THAT(texts, HasSubstr("’’ ’@macro `touch x`"));
    }
  }
}

TEST(Gnuplot, draws_how_long_cycles_waited_that_passed_without_a_message) {
  auto run = summary(asked("a", "udp"), outcome());
  run.skipped_cycles = 300;
  run.response.max = 3'000 * ms;
  run.shape.slice_ns = 10 * ms;
  run.shape.slices = {{.sent = 1, .min_ns = 100'000, .p50_ns = 100'000, .max_ns = 100'000},
                      {.skipped_cycles = 300, .skipped_wait_max_ns = 3'000 * ms}};
  const auto commands = gnuplot_of({run}, {});
  EXPECT_THAT(commands, HasSubstr("300 cycles without a message"));
  EXPECT_THAT(commands, HasSubstr("$passed0 << END\n0.015 3000\n"));
}

TEST(Gnuplot, keeps_long_counts_within_the_figure) {
  Summaries runs;
  for (const int repetition : {1, 2, 3}) {
    auto& run = runs.emplace_back(summary(asked("a", "udp", repetition), outcome()));
    run.sent = 1'234'567;
    run.late = run.lost = 123'456;
    run.skipped_cycles = 123'456;
    run.late_by_response = 345'678;
  }
  for (const auto figure : {Plot::Figure::time, Plot::Figure::conditions}) {
    const auto commands = gnuplot_of(runs, {figure, Plot::Form::svg, false});
    EXPECT_THAT(commands, HasSubstr("cycles not in time"));
    for (const auto& label : found_in(commands, "set label '([^']*)'"))
      EXPECT_LE(plot::text_width_cm(label), plot::Sheet::width_cm({})) << label;
  }
}

TEST(Gnuplot, draws_no_more_than_can_be_seen_and_no_extreme_is_missing) {
  auto run = summary(asked("a", "udp"), outcome());
  run.shape.slice_ns = 10 * ms;
  for (std::int64_t i = 0; i < 2000; ++i)
    run.shape.slices.push_back(
        {.sent = 12, .late = 1, .lost = 1, .min_ns = 100'000, .p50_ns = 200'000, .max_ns = (i + 1) * ms});
  run.shape.slices[1203].max_ns = 7'777 * ms;
  run.shape.slices[1204].min_ns = 1'234;
  run.sent = 24'000;
  const auto commands = gnuplot_of({run}, {});
  EXPECT_THAT(commands, HasSubstr(" 7777\n"));
  EXPECT_THAT(commands, HasSubstr(" 0.001234\n"));
  EXPECT_LT(commands.size(), 80'000u);
}

TEST(Gnuplot, draws_a_run_of_which_nothing_came_back) {
  auto lost = summary(asked("a", "udp"), outcome(), 0), other = summary(asked("a", "fastdds"), outcome());
  lost.sent = lost.lost = 100;
  other.shape.round_trip = {{100'000, 106'250, 2000}};
  const auto commands = gnuplot_of({other, lost}, {Plot::Figure::ccdf, Plot::Form::svg, false});
  EXPECT_EQ(found_in(commands, "\\$run1 << END\n([0-9.e-]+ 1\n[0-9.e-]+ 1\n)END").size(), 1u) << commands;
}

TEST(Gnuplot, LostMessagesStandAboveAllThatWasAnswered) {
  auto run = plotted("a", "udp");
  run.lost = run.shape.slices.front().lost = 3;
  const auto commands = gnuplot_of({run}, {});
  EXPECT_THAT(commands, HasSubstr("$lost0 << END\n0.005 0.95\n"));
  EXPECT_THAT(commands, HasSubstr("$lost0 axes x1y2 with points"));
  const auto greatest = found_in(commands, "set yrange \\[[^:]*:([0-9.]+)\\]");
  ASSERT_EQ(greatest.size(), 1u);
  EXPECT_GT(std::stod(greatest[0]), 10 * 1.6) << "room above the deadline of 10 ms";
}

// Ages by a simulated clock, say. A logarithmic axis has no 0: gnuplot leaves out what stands there.
TEST(Gnuplot, TimesOfNothingStandAtTheLowerEndOfTheAxis) {
  auto run = plotted("a", "udp");
  run.shape.slices.front().min_ns = run.shape.slices.front().p50_ns = 0;
  run.shape.round_trip = {{0, 2, 1000}, {100'000, 104'427, 990}, {8'000'000, 8'354'210, 10}};
  run.round_trip.min = 0;
  run.round_trip.count = 2000;
  run.round_trip[statistics::Figure::p50] = 0;
  run.round_trip_certainty[statistics::Figure::p50].sure = {0, 100'000};
  const auto lower_end = fmt::format("{:.6g}", 0.1 / 1.4);
  const auto of = [&](Plot::Figure figure) { return gnuplot_of({run}, {figure, Plot::Form::svg, false}); };
  EXPECT_THAT(of(Plot::Figure::time), HasSubstr("$extents0 << END\n0.005 " + lower_end + "\n0.005 9\n"));
  EXPECT_THAT(of(Plot::Figure::time), HasSubstr("$medians0 << END\n0.005 " + lower_end + "\n"));
  EXPECT_THAT(of(Plot::Figure::ccdf), HasSubstr("$run0 << END\n" + lower_end + " 1\n"));
  EXPECT_THAT(of(Plot::Figure::conditions), HasSubstr("$points0 << END\n" + lower_end + " "));
  EXPECT_THAT(of(Plot::Figure::conditions), HasSubstr("$extents << END\n" + lower_end + " "));
  EXPECT_THAT(of(Plot::Figure::payload), HasSubstr("$run0 << END\n500 " + lower_end + " "));
  for (const auto figure :
       {Plot::Figure::time, Plot::Figure::ccdf, Plot::Figure::conditions, Plot::Figure::payload})
    EXPECT_THAT(of(figure), HasSubstr("range [0.0714")) << "from the least time above 0";
}

TEST(Gnuplot, KeyOverTimeSaysWhyALateMessageIsBelowTheDeadline) {
  auto run = plotted("a", "udp");
  run.late = run.shape.slices.front().late = 1;
  EXPECT_THAT(gnuplot_of({run}, {}), HasSubstr("set label 'late'"));
  amend(run.run.asked, "/schedule", "fixed");
  EXPECT_THAT(gnuplot_of({run}, {}), HasSubstr("set label 'late (fixed schedule: from when due,"));
  run.shape.slices.front().max_ns = 11 * ms;
  EXPECT_THAT(gnuplot_of({run}, {}), HasSubstr("set label 'late'")) << "where it is above, it needs no words";
}

TEST(Gnuplot, EveryPanelHasItsWholeNameInLinesThatFit) {
  Summaries runs;
  for (const auto* id : {"A", "B", "C"})
    for (const auto* transport : {"udp", "cyclonedds", "fastdds", "opendds"}) {
      auto run = plotted(id, transport);
      amend(run.run.asked, "/title",
            "A system under a load that takes a good many words to describe in full");
      runs.push_back(run);
    }
  const auto commands = gnuplot_of(runs, {Plot::Figure::time, Plot::Form::pdf, true});
  for (const auto& run : runs)
    EXPECT_THAT(commands,
                HasSubstr("'" + run.run.asked.id + " " + run.run.asked.task.transport + ": A system under"));
  EXPECT_EQ(found_in(commands, "('[^']*…')").size(), runs.size()) << "all of the 60 letters that a title has";
  for (const auto& label : found_in(commands, "set label '([^']*)'"))
    EXPECT_LE(plot::text_width_cm(label), 18.2 / 2) << label;
  for (const auto* key : {"from the fastest to the slowest", "median", "deadline 10 ms"})
    EXPECT_THAT(commands, HasSubstr(std::string("set label '") + key));
}

// Widths of the letters in DejaVu Sans.
TEST(Gnuplot, LinesOfWideLettersEndWithinTheFigure) {
  constexpr double em_cm = 7 / 72.0 * 2.54;
  for (const auto& [word, ems] :
       {std::pair{"WWWW MMMM", 7.73}, {"@@@@ %%%%", 8.12}, {"时间 测量 日本語", 7.64}, {"ÄÖ ÆŒ →…", 5.99}}) {
    std::string text = word;
    for (int i = 0; i < 6; ++i) text += std::string(" ") + word;
    const auto lines = plot::wrapped(text, 8);
    EXPECT_GT(lines.size(), 1u) << text;
    for (const auto& line : lines)
      EXPECT_LE(
          static_cast<double>(line.size()) / static_cast<double>(std::string(word).size()) * ems * em_cm, 8.4)
          << line;
  }
  EXPECT_EQ(plot::wrapped("iiiiiiiiii iiiiiiiiii iiiiiiiiii iiiiiiiiii iiiiiiiiii iiiiiiiiii", 8).size(), 1u);
}

TEST(Gnuplot, ANumberAndItsUnitStayOnOneLine) {
  for (int letters = 10; letters < 60; ++letters) {
    const auto lines = plot::wrapped(
        std::string(static_cast<std::size_t>(letters), 'x') + " timeout 300 ms, 2 cpu (2 runs)", 8);
    for (const auto& line : lines) EXPECT_FALSE(line.ends_with("300") || line.ends_with("2")) << line;
  }
}

TEST(Gnuplot, LegendNamesALineOnlyWhereTheFigureHasOne) {
  auto run = plotted("a", "udp");
  run.shape.slices = {{.sent = 1, .min_ns = 100'000, .p50_ns = 100'000, .max_ns = 100'000},
                      {.sent = 1, .lost = 1}};
  EXPECT_THAT(gnuplot_of({run}, {}), Not(HasSubstr("from the fastest to the slowest")));
  EXPECT_THAT(gnuplot_of({run}, {}), HasSubstr("set label 'messages'"));
  EXPECT_THAT(gnuplot_of({run, plotted("b", "udp")}, {}), HasSubstr("from the fastest to the slowest"));
}

TEST(Gnuplot, LegendNamesABandAndAPercentileOnlyWhereTheyAreDrawn) {
  auto run = plotted("a", "udp");
  const auto ccdf = [&] { return gnuplot_of({run}, {Plot::Figure::ccdf, Plot::Form::svg, false}); };
  const auto payload = [&] { return gnuplot_of({run}, {Plot::Figure::payload, Plot::Form::svg, false}); };
  run.round_trip_certainty[statistics::Figure::p50].sure = {100'000, 110'000};
  EXPECT_THAT(ccdf(), Not(HasSubstr("95 % confidence interval"))) << "of p50 alone it has no height";
  run.round_trip_certainty[statistics::Figure::p90].sure = {110'000, 120'000};
  EXPECT_THAT(ccdf(), HasSubstr("95 % confidence interval"));
  EXPECT_THAT(payload(), AllOf(HasSubstr("set label 'p50'"), Not(HasSubstr("set label 'p99'"))));
  run.round_trip.count = 2000;
  EXPECT_THAT(payload(), HasSubstr("set label 'p99'"));
}

TEST(Gnuplot, QuantityBesideAPanelIsClearOfTheNamesOfItsTicks) {
  auto period = plotted("/scan period", "udp"), age = plotted("/scan age", "udp");
  amend(period.run.asked, "/measures", "period");
  amend(age.run.asked, "/measures", "age");
  const auto commands = gnuplot_of({period, age}, {});
  const auto at = found_in(commands, "set label 'Period' at screen ([0-9.]+)"),
             axes = found_in(commands, "set lmargin at screen ([0-9.]+)");
  ASSERT_FALSE(at.empty() || axes.empty());
  constexpr double hundred_ms_cm = 0.93, tick_cm = 0.22;
  EXPECT_GT((std::stod(axes[0]) - std::stod(at[0])) * 8.8 - hundred_ms_cm - tick_cm, plot::line_cm / 2);
}

TEST(Gnuplot, ConditionsInANameHaveCommasBetweenThem) {
  auto one = plotted("a", "udp"), other = plotted("b", "udp");
  for (auto* run : {&one, &other}) amend(run->run.asked, "/title", "");
  amend(other.run.asked, {{"payload_bytes", 1000}, {"receive", "waitset"}});
  for (const auto figure : {Plot::Figure::time, Plot::Figure::ccdf})
    EXPECT_THAT(gnuplot_of({one, other}, {figure, Plot::Form::svg, false}),
                HasSubstr("'b udp 1000 B, waitset'"));
}

TEST(Gnuplot, FigureOverTimeSaysWhyARunOfTheFlightRecorderIsEmpty) {
  auto run = plotted("a", "udp");
  EXPECT_THAT(gnuplot_of({run}, {}), Not(HasSubstr("Not drawn")));
  run.has_worst_only = true;
  run.shape.slices.clear();
  EXPECT_THAT(gnuplot_of({run}, {}), HasSubstr("Not drawn: only the worst messages were kept."));
}

TEST(Gnuplot, CcdfDrawsTheDeadlineOfEachRun) {
  auto one = plotted("a", "udp"), other = plotted("b", "udp");
  amend(other.run.asked, "/deadline_us", 20'000);
  const auto commands = gnuplot_of({one, other}, {Plot::Figure::ccdf, Plot::Form::svg, false});
  EXPECT_THAT(commands, HasSubstr("set arrow from 10, graph 0 to 10, graph 1"));
  EXPECT_THAT(commands, HasSubstr("set arrow from 20, graph 0 to 20, graph 1"));
  EXPECT_THAT(commands, HasSubstr("deadlines 10 ms, 20 ms"));
}

TEST(Gnuplot, CcdfFallsWhereTheMessagesAreAndNotWhereTheNextOneIs) {
  auto run = plotted("a", "udp");
  run.shape.round_trip = {{10'000'000, 10'442'738, 99}, {9'800'000'000, 10'233'883'000, 1}};
  run.round_trip.count = 100;
  run.round_trip.max = 10'000'000'000;
  run.lost = 0;
  const auto commands = gnuplot_of({run}, {Plot::Figure::ccdf, Plot::Form::svg, false});
  EXPECT_THAT(commands, HasSubstr("$run0 << END\n10 1\n10.4427 0.01\n9800 0.01\n10000 "));
}

TEST(Gnuplot, AxesHaveNumbersThatCanBeRead) {
  auto run = plotted("a", "udp");
  EXPECT_THAT(gnuplot_of({run}, {Plot::Figure::payload, Plot::Form::svg, false}),
              HasSubstr("set xtics ('500' 500)"));
  run.shape.round_trip = {{100, 104, 990}, {100'000'000'000, 104'427'000'000, 10}};
  run.round_trip.min = 100;
  run.round_trip.max = 100'000'000'000;
  const auto wide = gnuplot_of({run}, {Plot::Figure::ccdf, Plot::Form::svg, false});
  EXPECT_THAT(wide, HasSubstr("'1 ms' 1,"));
  EXPECT_THAT(wide, HasSubstr("'' 10 1,"));
}

TEST(Gnuplot, AxisWithOnePowerOfTenHasOtherNumbers) {
  EXPECT_EQ(plot::time_tics("y", 0.03, 0.95),
            "set ytics ('50 µs' 0.05, '100 µs' 0.1, '200 µs' 0.2, '500 µs' 0.5)");
  EXPECT_THAT(plot::time_tics("y", 0.03, 1.1),
              AllOf(HasSubstr("'' 0.05 1, '100 µs' 0.1"), HasSubstr("'1 ms' 1")));
}

TEST(Gnuplot, LossThatIsNotKnownIsNotNone) {
  auto run = plotted("a", "udp");
  EXPECT_THAT(gnuplot_of({run}, {}), HasSubstr(" lost of "));
  run.run.outcome.loss_unknown = true;
  for (const auto figure : {Plot::Figure::time, Plot::Figure::conditions})
    EXPECT_THAT(gnuplot_of({run}, {figure, Plot::Form::svg, false}), HasSubstr("; lost unknown"));
}

TEST(Gnuplot, CcdfDrawsRepetitionsAsOneLineWithTheirSpread) {
  const Summaries runs{plotted("a", "udp", 1), plotted("a", "udp", 2), plotted("a", "fastdds")};
  const auto commands = gnuplot_of(runs, {Plot::Figure::ccdf, Plot::Form::svg, false});
  EXPECT_EQ(found_in(commands, "(with steps)").size(), 2u);
  EXPECT_THAT(commands, HasSubstr("'a udp: System under load (2 runs)'"));
  EXPECT_THAT(commands, HasSubstr("$band0 using 1:2:3 with filledcurves"));
  EXPECT_THAT(commands, HasSubstr("best to worst of the repetitions"));
}

// Their round trips alone would show a stall as a single slow message.
TEST(Gnuplot, CcdfIsOfResponseTimesWhereCyclesWereSkipped) {
  auto stalled = plotted("a", "udp"), other = plotted("b", "udp");
  const Plot plot{Plot::Figure::ccdf, Plot::Form::svg, false};
  EXPECT_THAT(
      gnuplot_of({stalled, other}, plot),
      AllOf(HasSubstr("'Share of messages slower'"), HasSubstr("'Round trip'"), Not(HasSubstr("in time"))));
  stalled.lost = 3;
  stalled.skipped_cycles = 500;
  stalled.late_by_response = 503;
  stalled.response.count = 2497;
  stalled.response.max = 5'000 * ms;
  stalled.shape.response = {{200'000, 210'000, 1997}, {4'000 * ms, 4'200 * ms, 500}};
  other.late_by_response = 0;
  other.response.count = 2000;
  other.response.max = 310'000;
  other.shape.response = {{300'000, 320'000, 2000}};
  const auto commands = gnuplot_of({stalled, other}, plot);
  EXPECT_THAT(commands, HasSubstr("'Share of cycles slower'"));
  EXPECT_THAT(commands, HasSubstr("set label 'Response time"));
  EXPECT_THAT(
      commands,
      HasSubstr("$run0 << END\n0.2 1\n0.21 0.2012\n4000 0.2012\n4200 0.0012\n5000 0.0012\n8000 0.0012\nEND"));
  EXPECT_THAT(commands, HasSubstr("$run1 << END\n0.3 1\n0.31 ")) << "both of the same quantity";
  EXPECT_THAT(commands, HasSubstr("'503 of 2,500 cycles not in time'"));
  EXPECT_THAT(commands, HasSubstr("'0 of 2,000 cycles not in time'"));
}

TEST(Gnuplot, CcdfIsOfResponseTimesWhereLatenessIs) {
  auto run = plotted("a", "udp");
  run.late = 4;
  run.late_by_response = 4;
  run.response = run.round_trip;
  run.shape.response = run.shape.round_trip;
  const Plot plot{Plot::Figure::ccdf, Plot::Form::svg, false};
  EXPECT_THAT(gnuplot_of({run}, plot), HasSubstr("'Round trip'"));
  amend(run.run.asked, "/schedule", "fixed");
  EXPECT_THAT(gnuplot_of({run}, plot), HasSubstr("'4 of 2,000 cycles not in time'"));
}

TEST(Gnuplot, ConditionsHasOneRowForEachWithTheSpreadOfItsRepetitions) {
  auto first = plotted("a", "udp", 1), second = plotted("a", "udp", 2);
  second.round_trip[statistics::Figure::p50] = 300'000;
  second.late = 7;
  const auto commands = gnuplot_of({first, second, plotted("a", "fastdds")},
                                   {Plot::Figure::conditions, Plot::Form::svg, false});
  EXPECT_EQ(found_in(commands, "\\$points0 << END\n([^\n]*\n[^\n]*\n)END").size(), 1u) << "two rows";
  EXPECT_THAT(commands, HasSubstr("7 late, 0 lost of 4,000 in 2 runs"));
  EXPECT_THAT(commands, HasSubstr("$bars0 << END\n0.1 "));
  EXPECT_THAT(commands, HasSubstr("\n0.3 "));
  for (const auto* name : {"p50", "max"})
    EXPECT_THAT(commands, HasSubstr(std::string("set label '") + name + "'"));
  EXPECT_THAT(commands, Not(HasSubstr("set label 'p99"))) << "too few messages: it is not drawn";
}

TEST(Gnuplot, LegendOfConditionsNamesTheThinLineAndSaysWhyAMetricIsMissing) {
  auto few = plotted("a", "udp"), enough = plotted("a", "fastdds");
  enough.round_trip = statistics::distribution(std::vector<std::int64_t>(200, ms));
  const auto of = [](const Summaries& runs) {
    return gnuplot_of(runs, {Plot::Figure::conditions, Plot::Form::svg, false});
  };
  EXPECT_THAT(of({few, enough}), HasSubstr("set label 'from the fastest to the slowest'"));
  EXPECT_THAT(of({few, enough}), HasSubstr("set label 'no p99, p99.9: too few answers in a run'"));
  EXPECT_THAT(of({enough}), HasSubstr("set label 'no p99.9: too few answers in a run'"));
  auto many = enough, gone = plotted("b", "udp");
  many.round_trip = statistics::distribution(std::vector<std::int64_t>(2000, ms));
  gone.round_trip = {};
  EXPECT_THAT(of({many, gone}), Not(HasSubstr("too few"))) << "nothing was answered, which the row says";
  EXPECT_THAT(of({gone}), Not(HasSubstr("fastest")));
}

TEST(Gnuplot, ConditionsDrawsNoBarWhereARunHasNoInterval) {
  auto run = plotted("a", "udp");
  const auto of_run = [&] { return gnuplot_of({run}, {Plot::Figure::conditions, Plot::Form::svg, false}); };
  EXPECT_THAT(of_run(), HasSubstr("$points0 << END\n"));
  EXPECT_THAT(of_run(), Not(HasSubstr("$bars"))) << "a bar to the edge would claim a lower limit";
  auto& sure = run.round_trip_certainty[statistics::Figure::p50].sure;
  sure.low = 90'000;
  EXPECT_THAT(of_run(), HasSubstr("$bars0 << END\n0.09 ")) << "no upper limit: to the edge at 16 ms";
  EXPECT_THAT(of_run(), HasSubstr("\n16 "));
  sure.high = 7'000'000;
  EXPECT_THAT(of_run(), HasSubstr("\n7 "));
}

TEST(Gnuplot, RunThatWasNotAsAskedSaysSoAndIsNotPooledWithOthers) {
  auto good = plotted("a", "udp", 1), cut = plotted("a", "udp", 2), failed = plotted("a", "fastdds");
  amend(cut.run.outcome, "/interrupted", true);
  amend(failed.run.outcome, "/error", "no answer");
  const auto over_time = gnuplot_of({good, cut, failed}, {});
  EXPECT_THAT(over_time, HasSubstr("'a udp #1: System under load'"));
  EXPECT_THAT(over_time, HasSubstr("'a udp #2: System under load (CUT OFF)'"));
  EXPECT_THAT(over_time, HasSubstr("'a fastdds #1: System under load (FAILED)'"));
  for (const auto figure : {Plot::Figure::ccdf, Plot::Figure::conditions}) {
    const auto commands = gnuplot_of({good, cut, failed}, {figure, Plot::Form::svg, false});
    EXPECT_THAT(commands, HasSubstr("'a udp: System under load'"));
    EXPECT_THAT(commands, HasSubstr("'a fastdds: System under load (FAILED)'")) << "it is all there is of it";
    EXPECT_THAT(commands, Not(HasSubstr("runs")));
  }
}

TEST(Gnuplot, MessageDueLongAfterTheOthersIsCountedBesideTheFigure) {
  auto run = plotted("a", "udp");
  EXPECT_THAT(gnuplot_of({run}, {}), Not(HasSubstr("Not drawn")));
  run.start_ns = 1000 * ms;
  run.shape.beyond = {sample(0, ms), sample(1, ms)};
  run.shape.beyond[0].due_ns = run.start_ns + std::int64_t{150 * 60} * 1000 * ms;
  run.shape.beyond[1].due_ns = run.shape.beyond[0].due_ns + 1000 * ms;
  EXPECT_THAT(gnuplot_of({run}, {}), HasSubstr("Not drawn: 2 messages due after 150 min"));
  run.shape.beyond[0].due_ns = run.start_ns + std::int64_t{4 * 3600} * 1000 * ms;
  run.shape.beyond[1].due_ns = run.start_ns + std::int64_t{5 * 3600} * 1000 * ms;
  const auto commands = gnuplot_of({run}, {});
  EXPECT_THAT(commands, HasSubstr("'Not drawn: 2 messages due after 4 h'"));
  EXPECT_THAT(commands, HasSubstr("set xrange [0:0.01005]"));
}

TEST(Gnuplot, CutOffRepetitionIsNotPooledAgainstThePayload) {
  auto good = plotted("a", "udp", 1), cut = plotted("a", "udp", 2), failed = plotted("a", "udp", 3);
  for (auto* run : {&cut, &failed}) run->round_trip = statistics::distribution({5 * ms, 5 * ms});
  amend(cut.run.outcome, "/interrupted", true);
  amend(failed.run.outcome, "/error", "no answer");
  const Plot plot{Plot::Figure::payload, Plot::Form::svg, false};
  auto commands = gnuplot_of({good, cut}, plot);
  EXPECT_THAT(commands, HasSubstr("$run0 << END\n500 0.1 0.1 0.1\n"));
  EXPECT_THAT(commands, Not(HasSubstr("$missed")));
  EXPECT_EQ(plot::left_out({good, cut, failed}, plot).size(), 1u);
  commands = gnuplot_of({good, failed}, plot);
  EXPECT_THAT(commands, HasSubstr("$run0 << END\n500 0.1 0.1 0.1\n"));
  EXPECT_THAT(commands, HasSubstr("$missed0 << END\n500 0.1 0.1 0.1\n")) << "but it is marked";
  EXPECT_THAT(gnuplot_of({cut}, plot), HasSubstr("$missed0 << END\n500 5 5 5\n")) << "it is all there is";
}

// Each with so many messages/s of background topics; 0: without them.
Summary beside(double rate_hz) {
  auto run = plotted("a", "udp");
  if (rate_hz > 0)
    amend(run.run.asked, {{"neighbours",
                           {{"topics", 3},
                            {"rate_hz", rate_hz},
                            {"payload_bytes", 500},
                            {"there", true},
                            {"back", true},
                            {"where", "other-process"}}}});
  return run;
}

TEST(Gnuplot, RunWithoutBackgroundTopicsIsDrawnAtTheLeftEdge) {
  const Plot plot{Plot::Figure::background, Plot::Form::svg, false};
  const auto commands = gnuplot_of({beside(0), beside(100), beside(1000)}, plot);
  const auto at = found_in(commands, "\\$run0 << END\n([0-9.]+) [^\n]*\n\n100 [^\n]*\n1000 [^\n]*\nEND");
  ASSERT_EQ(at.size(), 1u) << "and no line leads from 'none' to a rate: " << commands;
  EXPECT_THAT(commands, HasSubstr("set xtics ('none' " + at[0] + ", '100' 100, '1,000' 1000)"));
  EXPECT_LT(std::stod(at[0]), 100);
  EXPECT_THAT(gnuplot_of({beside(100), beside(1000)}, plot), Not(HasSubstr("none' ")));

  Summaries many;
  for (const auto rate_hz : {0, 20, 50, 100, 200, 500, 1000}) many.push_back(beside(rate_hz));
  EXPECT_THAT(
      gnuplot_of(many, plot),
      ::testing::ContainsRegex(
          "set xtics \\('none' [0-9.]+, '' 20 1, '' 50 1, '100' 100, '' 200 1, '' 500 1, '1,000' 1000\\)"))
      << "no power of ten between 'none' and 20";
}

// Neither of them was measured at the median of both.
TEST(Gnuplot, AgainstThePayloadEachConditionHasItsOwnLine) {
  Summaries runs;
  for (const auto payload : {64, 1024})
    for (const bool realtime : {false, true}) {
      auto& run = runs.emplace_back(plotted("size", "udp"));
      amend(run.run.asked, {{"payload_bytes", payload}, {"realtime", realtime}});
      run.run.key = fmt::format("{} {}", payload, realtime);
      run.round_trip = statistics::distribution(std::vector<std::int64_t>(2, realtime ? ms : 2 * ms));
    }
  const auto commands = gnuplot_of(runs, {Plot::Figure::payload, Plot::Form::svg, false});
  EXPECT_THAT(commands, HasSubstr("'size udp SCHED_OTHER'"));
  EXPECT_THAT(commands, HasSubstr("$run0 << END\n64 2 2 2\n1024 2 2 2\nEND"));
  EXPECT_THAT(commands, HasSubstr("'size udp real-time settings'"));
  EXPECT_THAT(commands, HasSubstr("$run1 << END\n64 1 1 1\n1024 1 1 1\nEND"));
  EXPECT_THAT(commands, Not(HasSubstr("repetition")));
}

TEST(Gnuplot, AgainstTheRateBackgroundTopicsThatDifferAreNotOneLine) {
  Summaries runs{beside(0), beside(100), beside(1000), beside(100), beside(1000)};
  for (auto* run : {&runs[3], &runs[4]}) amend(run->run.asked, "/neighbours/topics", 10);
  const auto commands = gnuplot_of(runs, {Plot::Figure::background, Plot::Form::svg, false});
  for (const auto* name : {"'a udp'", "'a udp 3 background topics", "'a udp 10 background topics"})
    EXPECT_THAT(commands, HasSubstr(name));
  EXPECT_THAT(commands, Not(HasSubstr("Hz"))) << "that is where it stands";
}

TEST(Gnuplot, PayloadsHaveNoExponentsAndThoseWithoutRoomForANumberHaveATick) {
  const auto tics = [](const std::vector<int>& payloads) {
    Summaries runs;
    for (const auto payload : payloads)
      amend(runs.emplace_back(plotted("a", "udp")).run.asked, "/payload_bytes", payload);
    return found_in(gnuplot_of(runs, {Plot::Figure::payload, Plot::Form::svg, false}),
                    "set xtics \\(([^)]*)\\)")
        .at(0);
  };
  EXPECT_EQ(tics({100, 4'000'000}), "'100' 100, '4,000,000' 4e+06");
  EXPECT_EQ(tics({100, 3'900'000, 4'000'000}), "'100' 100, '3,900,000' 3.9e+06, '' 4e+06 1");
  EXPECT_EQ(tics({1'000, 2'000, 4'000, 8'000, 500'000, 1'000'000}),
            "'1,000' 1000, '' 2000 1, '' 4000 1, '' 8000 1, '10,000' 10000, '100,000' 100000, '' 500000 1, "
            "'1,000,000' 1e+06");
}

TEST(Gnuplot, PayloadOf0BytesIsNotNamed1) {
  auto empty = plotted("a", "udp"), other = plotted("a", "udp");
  amend(empty.run.asked, "/payload_bytes", 0);
  const auto commands = gnuplot_of({empty, other}, {Plot::Figure::payload, Plot::Form::svg, false});
  EXPECT_EQ(found_in(commands, "set xtics \\(('0' [0-9.]+, '500' 500)\\)").size(), 1u) << commands;
}

TEST(Gnuplot, RunOfUnknownPayloadIsLeftOutAndCounted) {
  auto listened = plotted("/scan", "udp");
  auto request = listened.run.asked.document;
  request.erase("payload_bytes");
  request["measures"] = "age";
  listened.run.asked = request;
  const Plot plot{Plot::Figure::payload, Plot::Form::svg, false};
  const auto commands = gnuplot_of({listened, plotted("a", "udp")}, plot);
  EXPECT_THAT(commands, HasSubstr("'not drawn: 1 run of unknown payload'"));
  EXPECT_THAT(commands, Not(HasSubstr("/scan")));
  EXPECT_THAT(commands, HasSubstr("set label 'Round trip'")) << "of what is drawn";
  EXPECT_THAT(gnuplot_of({plotted("a", "udp")}, plot), Not(HasSubstr("not drawn")));
}

// Of a flight recorder without a histogram: its counts are known, its times are not.
TEST(Gnuplot, CcdfDrawsNoLineOfARunWhoseTimesAreUnknown) {
  auto unknown = summary(asked("a", "udp"), outcome(), 0);
  unknown.sent = 100'000;
  unknown.late = 5;
  unknown.lost = 3;
  const Plot plot{Plot::Figure::ccdf, Plot::Form::svg, false};
  const auto commands = gnuplot_of({unknown, plotted("b", "udp")}, plot);
  EXPECT_THAT(commands, HasSubstr("'a udp: System under load (times unknown)'"));
  EXPECT_THAT(commands, Not(HasSubstr("$run0"))) << "as if all had been lost";
  EXPECT_THAT(commands, HasSubstr("$run1 using"));
  EXPECT_THAT(gnuplot_of({unknown, plotted("a", "udp", 2)}, plot), HasSubstr("$run0 << END\n0.1 1\n"));
}

TEST(Gnuplot, CountsAreOfAllMessagesWhereSamplesAreMissing) {
  auto run = plotted("a", "udp");
  run.sent = run.on_time = 500;
  amend(run.run.outcome, {{"sent", 700}, {"late", 3}, {"lost", 2}, {"dropped_records", 200}});
  for (const auto figure : {Plot::Figure::time, Plot::Figure::conditions})
    EXPECT_THAT(gnuplot_of({run}, {figure, Plot::Form::svg, false}),
                HasSubstr("'3 late, 2 lost of 700; 200 samples not recorded'"));
}

TEST(Gnuplot, WithoutALimitNoMessageIsSaidToBeInTime) {
  auto run = plotted("/scan", "udp");
  amend(run.run.asked, {{"measures", "age"}, {"deadline_us", 0}});
  run.sent = 500;
  EXPECT_THAT(gnuplot_of({run}, {}), HasSubstr("'0 lost of 500; no limit'"));
  run.run.outcome.loss_unknown = true;
  EXPECT_THAT(gnuplot_of({run}, {}), HasSubstr("'500 messages; no limit; lost unknown'"));
}

TEST(Gnuplot, LegendOverTimeNamesOnlyWhatIsDrawn) {
  auto run = plotted("a", "udp");
  run.has_worst_only = true;
  run.late = 5;
  run.lost = 3;
  run.shape.slices.clear();
  const auto commands = gnuplot_of({run}, {});
  for (const auto* name : {"messages", "median", "late", "lost (at the top)"})
    EXPECT_THAT(commands, Not(HasSubstr(fmt::format("set label '{}'", name))));
  EXPECT_THAT(commands, HasSubstr("set xrange [0:1.005]")) << "no axis of a microsecond";
}

}  // namespace
}  // namespace ontime::report
