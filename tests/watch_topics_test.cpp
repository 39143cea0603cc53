// SPDX-License-Identifier: Apache-2.0
#include <sstream>

#include <fmt/format.h>
#include <gmock/gmock.h>

#include "watch/watch.hpp"

namespace ontime::watch {
namespace {

using listen::Findings;
using listen::Flow;
using listen::Miss;
using listen::Why;
using namespace std::chrono_literals;
using ::testing::HasSubstr;
using ::testing::Not;

listen::Distribution times(int count) {
  listen::Distribution values;
  for (int i = 0; i < count; ++i) values.add(3'000'000);
  return values;
}

Flow flow(std::uint64_t messages, const char* writer = "controller") {
  Flow flow;
  flow.id = 1;
  flow.topic = "/cmd_vel";
  flow.writer.name = writer;
  flow.reader.name = "base";
  flow.messages = messages;
  flow.period = times(static_cast<int>(messages));
  if (*writer != '\0') {
    flow.age = times(static_cast<int>(messages));
    flow.lost = 0;
  }
  return flow;
}

struct Counters : testing::Test {
  void look(std::vector<Flow> flows, std::chrono::seconds listened = 0s) {
    Findings findings;
    findings.flows = std::move(flows);
    counters.add(findings, listened);
  }
  // The value of a series, as Prometheus reads it.
  std::string value(const std::string& name, const std::string& writer = "controller",
                    const std::string& reader = "base") const {
    const auto series =
        fmt::format("\n{}{{topic=\"/cmd_vel\",writer=\"{}\",reader=\"{}\"}} ", name, writer, reader);
    const auto text = counters.metrics();
    const auto at = text.find(series);
    if (at == text.npos) return "none";
    const auto begin = at + series.size();
    return text.substr(begin, text.find('\n', begin) - begin);
  }
  TopicCounters counters;
};

TEST_F(Counters, SeriesKeepsItsCountsWhenItsFlowIsGone) {
  look({flow(100)});
  look({});
  EXPECT_EQ(value("ontime_topic_messages_total"), "100");
  EXPECT_EQ(value("ontime_topic_age_seconds_count"), "100");
}

TEST_F(Counters, RestartedNodeContinuesItsSeries) {
  look({flow(100)});
  auto again = flow(5);
  again.id = 2;
  again.writer.process = 70;
  look({again});
  EXPECT_EQ(value("ontime_topic_messages_total"), "105");
}

TEST_F(Counters, EndpointsOfTheSameNamesAddUp) {
  auto other = flow(30);
  other.id = 2;
  look({flow(100), other});
  look({flow(101), other});
  EXPECT_EQ(value("ontime_topic_messages_total"), "131");
  EXPECT_EQ(value("ontime_topic_period_seconds_count"), "131");
}

TEST_F(Counters, MessagesOfAFlowWhoseWriterIsRecognizedAreCountedOnce) {
  look({flow(100, "")});
  look({flow(150)});
  EXPECT_EQ(value("ontime_topic_messages_total", ""), "100");
  EXPECT_EQ(value("ontime_topic_messages_total"), "50");
}

TEST_F(Counters, UnrecognizedWriterLowersNoCounter) {
  look({flow(100)});
  look({flow(110, "")});
  EXPECT_EQ(value("ontime_topic_messages_total"), "100");
  EXPECT_EQ(value("ontime_topic_age_seconds_count"), "100");
  EXPECT_EQ(value("ontime_topic_lost_total"), "0");
  auto again = flow(120);
  again.age = times(4);
  look({again});
  EXPECT_EQ(value("ontime_topic_messages_total"), "110");
  EXPECT_EQ(value("ontime_topic_age_seconds_count"), "104");
}

TEST_F(Counters, RestartedAgesAndLossesAreAdded) {
  auto one = flow(100);
  one.lost = 5;
  look({one});
  one.age = times(3);
  one.lost = 2;
  look({one});
  EXPECT_EQ(value("ontime_topic_age_seconds_count"), "103");
  EXPECT_EQ(value("ontime_topic_lost_total"), "7");
}

TEST_F(Counters, LossThatProvesToBeLateIsCountedOnce) {
  auto one = flow(100);
  for (const std::uint64_t lost : {5, 4, 5, 6}) {
    one.lost = lost;
    look({one});
  }
  EXPECT_EQ(value("ontime_topic_lost_total"), "6");
}

TEST_F(Counters, LossThatOntimeMayHaveCausedIsCountedOnceToo) {
  auto one = flow(100);
  for (const std::uint64_t lost : {2, 1, 2}) {
    one.lost_not_judged = lost;
    look({one});
  }
  EXPECT_EQ(value("ontime_topic_lost_not_judged_total"), "2");
  EXPECT_EQ(value("ontime_topic_not_judged_total"), "0");
}

TEST_F(Counters, ReturningFlowAddsOnlyItsIncrease) {
  look({flow(100)});
  look({});
  look({flow(110)});
  EXPECT_EQ(value("ontime_topic_messages_total"), "110");
}

TEST_F(Counters, TopicIsSilentOnlyWhileAllOfItsFlowsAre) {
  counters = TopicCounters({.deadline = 15ms, .period = {}, .age = {}});
  auto ended = flow(100), active = flow(1);
  ended.idle_ns = 7'500'000'000;
  active.id = 2;
  active.idle_ns = 14'000'000;
  look({ended});
  EXPECT_EQ(value("ontime_topic_silent_seconds"), "7.5");
  look({ended, active});
  EXPECT_EQ(value("ontime_topic_silent_seconds"), "0");
  look({});
  EXPECT_EQ(value("ontime_topic_silent_seconds"), "none");
  active.idle_ns = 60'000'000'000;
  ended.idle_ns = 200'000'000'000;
  look({ended, active});
  EXPECT_EQ(value("ontime_topic_silent_seconds"), "60") << "the node that ended began again, and now hangs";
}

TEST_F(Counters, WithoutALimitOnlyStatedTopicsAreSilent) {
  auto one = flow(100);
  one.idle_ns = 7'000'000'000;
  look({one});
  EXPECT_EQ(value("ontime_topic_silent_seconds"), "none") << "it may be one that seldom comes";
  EXPECT_EQ(value("ontime_topic_silent_seconds_total"), "none");
  counters = TopicCounters({.deadline = {}, .period = {}, .age = 5ms}, {"/cmd_vel"});
  look({one});
  EXPECT_EQ(value("ontime_topic_silent_seconds"), "7");
  one.idle_ns = 4'900'000'000;
  look({one});
  EXPECT_EQ(value("ontime_topic_silent_seconds"), "0");
}

TEST_F(Counters, SilencesBetweenTwoScrapesAddUp) {
  counters = TopicCounters({.deadline = 100ms, .period = {}, .age = {}});
  auto one = flow(100);
  const auto idle = [&](std::int64_t ms) {
    one.idle_ns = ms * 1'000'000;
    look({one});
    return value("ontime_topic_silent_seconds_total");
  };
  EXPECT_EQ(idle(10), "0");
  EXPECT_EQ(idle(1010), "1.01");
  EXPECT_EQ(idle(2010), "2.01");
  EXPECT_EQ(idle(2010), "2.01") << "paused by --budget";
  EXPECT_EQ(idle(30), "2.01");
  EXPECT_EQ(idle(500), "2.51");
  EXPECT_EQ(idle(200), "2.71") << "another silence";
  look({});
  EXPECT_EQ(value("ontime_topic_silent_seconds_total"), "2.71");
}

TEST_F(Counters, StatedTopicHasSeriesBeforeItComesAndAfterItsFlowsAreForgotten) {
  counters = TopicCounters({}, {"/cmd_vel"});
  const auto unseen = [&](std::vector<Flow> flows, std::chrono::seconds listened) {
    look(std::move(flows), listened);
    return value("ontime_topic_silent_seconds", "", "");
  };
  EXPECT_EQ(unseen({}, 1s), "0");
  EXPECT_EQ(value("ontime_topic_late_total", "", ""), "0");
  EXPECT_EQ(unseen({}, 8s), "8");
  EXPECT_EQ(unseen({flow(100)}, 9s), "none") << "its flow has it now";
  auto ended = flow(100);
  ended.idle_ns = 6'000'000'000;
  EXPECT_EQ(unseen({ended}, 20s), "none");
  EXPECT_EQ(unseen({}, 21s), "7") << "since its last message";
  EXPECT_EQ(value("ontime_topic_silent_seconds_total", "", ""), "15");
}

TEST_F(Counters, UnknownLossHasNoSeries) {
  look({flow(100, "")});
  EXPECT_EQ(value("ontime_topic_lost_total", ""), "none");
  EXPECT_EQ(value("ontime_topic_age_seconds_count", ""), "none");
  EXPECT_EQ(value("ontime_topic_late_total", ""), "0");
}

TEST_F(Counters, HistogramAddsUpToItsCount) {
  look({flow(100)});
  const auto text = counters.metrics();
  EXPECT_THAT(text, HasSubstr(R"(reader="base",le="0.002"} 0)"));
  EXPECT_THAT(text, HasSubstr(R"(reader="base",le="0.005"} 100)"));
  EXPECT_THAT(text, HasSubstr(R"(reader="base",le="+Inf"} 100)"));
  EXPECT_EQ(value("ontime_topic_age_seconds_sum"), "0.3");
}

// histogram_quantile(0.99) of Prometheus: linear between the limits of a bucket.
TEST_F(Counters, QuantileOfPeriodsAtAUsualRateIsNearItsPeriod) {
  for (const double ms : {1., 2., 5., 10., 20., 1000. / 30, 50., 100., 200., 1000.}) {
    counters = TopicCounters();
    auto one = flow(1);
    one.period = {};
    for (int i = 0; i < 1000; ++i)
      one.period.add(static_cast<std::int64_t>(ms * (i % 2 == 0 ? 1.02e6 : 0.98e6)));
    look({one});
    double limit = 0, below = 0, p99 = 0;
    std::istringstream lines(counters.metrics());
    for (std::string line; p99 == 0 && std::getline(lines, line);) {
      if (!line.starts_with("ontime_topic_period_seconds_bucket")) continue;
      const auto before = limit, count_before = below;
      limit = std::stod(line.substr(line.find("le=") + 4));
      below = std::stod(line.substr(line.rfind(' ')));
      if (below >= 990) p99 = before + (limit - before) * (990 - count_before) / (below - count_before);
    }
    EXPECT_NEAR(p99 * 1e3, ms, ms / 4);
  }
}

TEST_F(Counters, SeriesWithoutWriterEndsSomeTimeAfterBothAreKnown) {
  look({flow(100, "")});
  for (std::uint64_t i = 0; i < TopicCounters::partial_kept; ++i) look({flow(150)});
  EXPECT_EQ(value("ontime_topic_messages_total", ""), "100") << "its last counts can be fetched";
  look({flow(150)});
  EXPECT_EQ(value("ontime_topic_messages_total", ""), "none");
  for (std::uint64_t i = 0; i <= TopicCounters::partial_kept; ++i) look({});
  EXPECT_EQ(value("ontime_topic_messages_total"), "50");
}

TEST_F(Counters, MessagesOfTooManyFlowsAreCounted) {
  Findings findings;
  findings.not_counted = 12;
  counters.add(findings, 1s);
  EXPECT_THAT(counters.metrics(), HasSubstr("\nontime_not_counted_total 12\n"));
}

TEST_F(Counters, EachCauseBeginsAtZero) {
  for (const auto* cause : {"cpu", "unknown", "not looked for"})
    EXPECT_THAT(counters.metrics(), HasSubstr(fmt::format("{{cause=\"{}\"}} 0\n", cause)));
}

TEST_F(Counters, CausesAddUpToAllMisses) {
  Miss explained;
  explained.why = Why{.is_seen = true, .cause = "cpu"};
  counters.add({explained, Miss{}, explained});
  Findings findings;
  findings.misses_left_out = {{"/cmd_vel", 40}, {"/scan", 2}};
  counters.add(findings, 1s);
  counters.add(findings, 1s);
  EXPECT_THAT(counters.metrics(), HasSubstr("{cause=\"cpu\"} 2\n"));
  EXPECT_THAT(counters.metrics(), HasSubstr("{cause=\"not looked for\"} 43\n"));
}

TEST_F(Counters, ForeignNamesAreEscaped) {
  auto strange = flow(1, "a\"b\\c\nd");
  look({strange});
  EXPECT_THAT(counters.metrics(), HasSubstr(R"(writer="a\"b\\c)"));
  EXPECT_THAT(counters.metrics(), Not(HasSubstr("c\nd")));
}

TEST_F(Counters, MemoryIsBounded) {
  for (std::uint64_t id = 1; id <= TopicCounters::most_kept + 100; ++id) {
    auto one = flow(1);
    one.id = id;
    one.topic = fmt::format("/{}", id);
    look({one});
  }
  const auto text = counters.metrics();
  EXPECT_THAT(text, Not(HasSubstr("{topic=\"/100\"")));
  EXPECT_THAT(text, HasSubstr("{topic=\"/101\""));
}

TEST_F(Counters, ChainHasAHistogramForEachWayAndWhereMessagesEnded) {
  listen::Findings findings;
  auto& chain = findings.chains.emplace_back();
  chain.wish.steps = {{"/scan"}, {"/cmd_vel"}};
  chain.ended = {1, 20, 3};
  auto& path = chain.paths.emplace_back();
  path.id = 7;
  path.parties = {{1, "lidar"}, {2, "nav"}, {3, "base"}};
  path.age.add(5'000'000);
  path.late = 1;
  counters.add(findings, 1s);
  const auto first = counters.metrics();
  const std::string labels = "chain=\"/scan → /cmd_vel\",nodes=\"lidar → nav → base\"";
  EXPECT_THAT(first, HasSubstr("ontime_chain_age_seconds_count{" + labels + "} 1\n"));
  EXPECT_THAT(first, HasSubstr("ontime_chain_late_total{" + labels + "} 1\n"));
  const std::string ended =
      "ontime_chain_ended_total{chain=\"/scan → /cmd_vel\",topic=\"/scan\",end=\"not published on\"}";
  EXPECT_THAT(first, HasSubstr(ended + " 20\n"));
  // Another process of these names goes on in the series; what came out after all makes no counter fall.
  path.id = 8;
  chain.ended = {1, 19, 3};
  counters.add(findings, 1s);
  EXPECT_THAT(counters.metrics(), HasSubstr("ontime_chain_age_seconds_count{" + labels + "} 2\n"));
  EXPECT_THAT(counters.metrics(), HasSubstr(ended + " 20\n"));
}

TEST_F(Counters, WithoutChainsThereIsNoMetricOfThem) {
  look({flow(100)});
  EXPECT_THAT(counters.metrics(), Not(HasSubstr("ontime_chain")));
}

}  // namespace
}  // namespace ontime::watch
