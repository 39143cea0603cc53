// SPDX-License-Identifier: Apache-2.0
// The figure of what changed between two runs, as commands for gnuplot.
#include <random>
#include <sstream>

#include "plot/plot.hpp"
#include "record/record.hpp"
#include "report/comparison.hpp"
#include "report/runs.hpp"
#include "report_fixture.hpp"

namespace ontime::report {
namespace {

using plot::gnuplot_of;
using roundtrip::Sample;
using ::testing::HasSubstr;
using ::testing::Not;

// Round trips from that on, spread over 100 µs.
Summary measured(const json& asked, std::int64_t base_ns) {
  std::mt19937_64 random(static_cast<std::uint64_t>(base_ns));
  record::Writer writer("");
  std::vector<Sample> samples;
  for (std::uint64_t i = 0; i < 2000; ++i)
    samples.push_back(sample(i, base_ns + static_cast<std::int64_t>(random() % 100'000)));
  const auto run = writer.begin_run(asked);
  writer.append(run, samples);
  writer.end_run(run, outcome());
  const auto reader = writer.reader();
  return statistics::summarise(reader, reader.runs().front());
}
Summary measured(const char* id, std::int64_t base_ns) { return measured(asked(id, "udp"), base_ns); }

TEST(Gnuplot, ChangeHasARowForEachMetricAndSaysWhatItIsOf) {
  const Summaries from{measured("before", 400'000)}, to{measured("after", 800'000)};
  const auto commands = gnuplot_of(compare_chosen(from, to), {});
  for (const auto* text :
       {"A: before udp (1 run)", "B: after udp (1 run)", "p50", "p90", "Round trip, B / A"})
    EXPECT_THAT(commands, HasSubstr(std::string("set label '") + text + "'"));
  const auto p50 = found_in(commands, "\\$change0_1 << END\n([0-9.]+) ");
  ASSERT_EQ(p50.size(), 1u);
  EXPECT_NEAR(std::stod(p50[0]), 850.0 / 450, 0.1);
  EXPECT_THAT(commands, HasSubstr("B is slower"));
  EXPECT_THAT(commands, AllOf(HasSubstr("'p99'"), HasSubstr("no bar: too few runs or messages")));
  const auto p99 = found_in(commands, "\\$change0_3 << END\n([^\n]*)\n");
  ASSERT_EQ(p99.size(), 1u);
  double ratio = 0, y = 0, low = 0, high = 0;
  std::istringstream(p99[0]) >> ratio >> y >> low >> high;
  EXPECT_NEAR(ratio, 900.0 / 500, 0.1);
  EXPECT_TRUE(low == ratio && high == ratio) << "its interval tells nothing: a point without a bar";
  EXPECT_EQ(gnuplot_of(Comparison{}, {}), "") << "nothing to draw";
}

TEST(Gnuplot, ChangeHasTheVerdictOfTheTable) {
  // The mean is less, yet runs differ so much that the bar reaches across × 1.
  Summaries from, to;
  for (int i = 1; i <= 5; ++i) {
    from.push_back(measured(asked("before", "udp", i), 700'000 + i * 1000));
    to.push_back(measured(asked("after", "udp", i), i == 1 ? 1'000 : 300'000 + i * 1000));
  }
  const auto comparison = compare_chosen(from, to);
  ASSERT_EQ(comparison.pairs.size(), 1u);
  const auto change =
      change_of(comparison.pairs[0], statistics::Times::round_trip, statistics::Figure::mean).value();
  ASSERT_LT(change.difference_lies.high.value_or(1), 0);
  ASSERT_GT(change.ratio_lies.high.value_or(2), 1);
  ASSERT_EQ(change.verdict(), statistics::Verdict::cannot_tell);
  EXPECT_THAT(gnuplot_of(comparison, {}),
              Not(::testing::ContainsRegex("change0_0 using [^\n]*linecolor rgb '#0072b2'")));
}

TEST(Gnuplot, ChangeIsOfWhatWasMeasured) {
  Summaries from{measured("before", 400'000)}, to{measured("after", 800'000)};
  for (auto* runs : {&from, &to}) amend(runs->front().run.asked, "/measures", "age");
  EXPECT_THAT(gnuplot_of(compare_chosen(from, to), {}), HasSubstr("set label 'Age, B / A'"));
}

TEST(Gnuplot, ChangeOfAThousandTimesIsWithinTheAxis) {
  const Summaries from{measured("before", 400'000)}, to{measured("after", 400'000'000)};
  const auto commands = gnuplot_of(compare_chosen(from, to), {});
  const auto p50 = found_in(commands, "\\$change0_1 << END\n([0-9.]+) ");
  const auto edge = found_in(commands, "set xrange \\[[^:]*:([0-9.]+)\\]");
  ASSERT_EQ(p50.size(), 1u);
  ASSERT_EQ(edge.size(), 1u);
  EXPECT_NEAR(std::stod(p50[0]), 400'050.0 / 450, 20);
  EXPECT_GT(std::stod(edge[0]), std::stod(p50[0]));
  EXPECT_THAT(commands, HasSubstr("set xtics ('× 1' 1, '× 10' 10, '× 100' 100"));
}

TEST(Gnuplot, NamesOfVeryGreatRatiosDoNotOverlap) {
  const Summaries from{measured("before", 400'000)}, to{measured("after", 200'000'000'000'000'000)};
  const auto commands = gnuplot_of(compare_chosen(from, to), {});
  EXPECT_THAT(commands, HasSubstr("set xtics ('× 1' 1, '× 10,000' 10000, '× 10⁸' 1e+08)"));
}

TEST(Gnuplot, NamesOfCloseRatiosDoNotOverlap) {
  Summaries from, to;
  for (int i = 1; i <= 5; ++i) {
    from.push_back(measured(asked("before", "udp", i), 400'000 + i * 100));
    to.push_back(measured(asked("after", "udp", i), 800'000 + i * 100));
  }
  EXPECT_THAT(gnuplot_of(compare_chosen(from, to), {}),
              HasSubstr("set xtics ('× 1' 1, '× 1.4' 1.4, '× 2' 2)"));
}

TEST(Gnuplot, ChangeOfASharesRatioHasItsInterval) {
  Summaries from{measured("before", 400'000)}, to{measured("after", 400'000)};
  const auto lost = [](Summary& run, double share, double low, double high) {
    auto& of = run.lost_probability;
    of.value = share;
    of.sure = of.surer = {low, high};
  };
  lost(from[0], 0.1, 0.09, 0.11);
  lost(to[0], 0.2, 0.18, 0.22);
  const auto shown = [&] { return gnuplot_of(compare_chosen(from, to), {}); };
  EXPECT_THAT(shown(),
              ::testing::ContainsRegex("lost: 10 % → 20 %, × 2 \\[1\\.[67][0-9]*, 2\\.[23][0-9]*\\]'"));
  lost(to[0], 0.99998, 0.99997, 0.99999);
  EXPECT_THAT(shown(), HasSubstr("lost: 10 % → 99.998 %,"));
  lost(from[0], 0.00001, 0.000009, 0.000011);
  lost(to[0], 0.3, 0.29, 0.31);
  EXPECT_THAT(shown(), ::testing::ContainsRegex("× 30,000 \\[2[0-9],[0-9]00, 3[0-9],[0-9]00\\]'"));
  lost(from[0], 0, 0, 0.01);
  EXPECT_THAT(shown(), HasSubstr("points")) << "without a ratio the difference";
}

TEST(Gnuplot, ChangeOfRunsOfOneNameNamesTheirFiles) {
  const Summaries runs{measured("same", 400'000)};
  auto comparison = compare_chosen(runs, runs);
  comparison.from_name = "old.ontime";
  comparison.to_name = "new.ontime";
  for (const auto* text : {"'A: old.ontime, same udp (1 run)'", "'B: new.ontime, same udp (1 run)'"})
    EXPECT_THAT(gnuplot_of(comparison, {}), HasSubstr(text));
}

TEST(Gnuplot, ChangeOfTimesFarApartHasTheUnitOfEach) {
  const Summaries from{measured("before", 50'000)}, to{measured("after", 1'500'000'000)};
  const auto commands = gnuplot_of(compare_chosen(from, to), {});
  EXPECT_FALSE(found_in(commands, "set label '([0-9.]+ µs → 1.5 s)'").empty()) << commands;
  EXPECT_TRUE(found_in(commands, "set label '([^']*e-[^']*→[^']*)'").empty());
}

TEST(Gnuplot, ChangeOfTimesThatRoundToTheNextUnitIsInIt) {
  Summaries from{measured("before", 400'000)}, to{measured("after", 400'000)};
  from.front().round_trip_certainty[statistics::Figure::p50].value = 500'000;
  to.front().round_trip_certainty[statistics::Figure::p50].value = 999'600;
  EXPECT_THAT(gnuplot_of(compare_chosen(from, to), {}), HasSubstr("'0.5 → 1 ms'"));
}

}  // namespace
}  // namespace ontime::report
