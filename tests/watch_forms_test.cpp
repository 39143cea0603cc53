// SPDX-License-Identifier: Apache-2.0
#include "json.hpp"
#include "statistics/statistics.hpp"
#include "watch/watch.hpp"
#include "watch_fixture.hpp"

namespace ontime::watch {
namespace {

using nlohmann::json;
using record::usual;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;
using State = Progress::State;

class Forms : public Following {
 protected:
  Progress progress() {
    Progress progress;
    progress.state = State::measuring;
    progress.run = {5, asked(), {}, ""};
    progress.duration_s = 60;
    progress.elapsed_s = 12;
    progress.sent = 7;
    progress.on_time = 2;
    progress.late = 1;
    progress.lost = 4;
    progress.lost_for_good = 3;
    for (const auto ns : {40'000, 60'000, 12'000'000}) progress.round_trip.add(ns);
    progress.response_max_ns = 13'000'000;
    progress.worst = {{2, 11.5, 12'000'000, 13'000'000}};
    return progress;
  }
};

TEST_F(Forms, TextHasNoTerminalEscapes) {
  const auto text = text_of(progress());
  EXPECT_THAT(text, Not(HasSubstr("\x1b")));
  EXPECT_THAT(text, HasSubstr("0:12 of 1:00, 0:48 left"));
  EXPECT_THAT(text, HasSubstr("sent 7  on time 2  late 1  lost 4"));
  EXPECT_THAT(text, HasSubstr("response 13 ms (round trip 12 ms) at 11.50 s, message 2"));
  EXPECT_THAT(text_of({}), HasSubstr("no run yet"));
}

TEST_F(Forms, CompleteRunShowsHowLongItWasMeasured) {
  auto request = asked();
  request["period_us"] = 10'000;
  const auto shown = [&](const std::vector<roundtrip::Sample>& samples, json outcome) {
    record::Writer writer(path_);
    const auto run = writer.begin_run(request);
    writer.append(run, samples);
    outcome["interrupted"] = false;
    writer.end_run(run, outcome);
    writer.flush();
    return text_of(Follower(path_).look());
  };
  const auto end_ns = usual(0, 1).front().intended_ns + 60'000'000'000;
  EXPECT_THAT(shown(usual(0, 6000), {}), HasSubstr("1:00 of 1:00  (ended)"));
  EXPECT_THAT(shown(usual(0, 1000), {{"sent", 1000}, {"trailing_until_ns", end_ns}}),
              HasSubstr("1:00 of 1:00  (ended)"))
      << "the sender stood still to the end";
  for (const auto& outcome : {json::object(), json{{"sent", 6000}, {"trailing_until_ns", end_ns}}})
    EXPECT_THAT(shown(usual(0, 1000), outcome), HasSubstr("0:10 of 1:00  (ended)"));
}

TEST_F(Forms, RunThatDidNotReachItsEndSaysWhy) {
  auto one = progress();
  one.state = State::ended;
  for (const auto& [outcome, word] : {std::pair{json{{"interrupted", true}}, "(interrupted)"},
                                      {json{{"error", "no answer"}}, "(failed)"}}) {
    one.run.outcome = outcome;
    EXPECT_THAT(text_of(one), HasSubstr(std::string("0:12 of 1:00  ") + word));
  }
}

TEST_F(Forms, WorstOfOwnMessagesIsNamedByItsQuantity) {
  auto one = progress();
  auto request = asked();
  request["measures"] = "period";
  one.run.asked = request;
  EXPECT_THAT(text_of(one), HasSubstr("worst: period 12 ms at 11.50 s, message 2"));
  EXPECT_THAT(text_of(one), Not(HasSubstr("round trip")));
}

TEST_F(Forms, MetricsHaveOnlyKnownFatesOfOwnMessages) {
  auto one = progress();
  auto request = asked();
  request.update({{"measures", "period"}, {"deadline_us", 15'000}});
  one.run.asked = request;
  EXPECT_THAT(metrics_of(one), HasSubstr("fate=\"late\"} 1\n"));
  for (const std::string unknown : {"on_time", "lost"})
    EXPECT_THAT(metrics_of(one), Not(HasSubstr("fate=\"" + unknown)));
  request["deadline_us"] = nullptr;
  one.run.asked = request;
  EXPECT_THAT(metrics_of(one), Not(HasSubstr("fate=")));
}

TEST_F(Forms, JsonIsOneLine) {
  const auto line = json_of(progress());
  EXPECT_EQ(line.find('\n'), line.size() - 1);
  const auto object = parsed_json(line);
  EXPECT_EQ(object.at("id"), asked().at("id"));
  EXPECT_EQ(object.at("state"), "measuring");
  EXPECT_EQ(object.at("left_s"), 48);
  EXPECT_EQ(object.at("round_trip_us").at("max"), 12000);
  std::uint64_t sum = 0;
  for (const auto& bucket : object.at("histogram")) sum += bucket.at("count").get<std::uint64_t>();
  EXPECT_EQ(sum, 3U);
  EXPECT_EQ(parsed_json(json_of({})).at("run"), nullptr);
}

TEST_F(Forms, MetricsUsePrometheusFormat) {
  const auto text = metrics_of(progress());
  EXPECT_THAT(text, HasSubstr(R"(id="Test1.B\"\\ ?[31m")")) << "quotes and backslashes are escaped";
  EXPECT_THAT(text, HasSubstr("le=\"5e-05\"} 1\n"));
  EXPECT_THAT(text, HasSubstr("le=\"0.0001\"} 2\n")) << "buckets add up";
  EXPECT_THAT(text, HasSubstr("le=\"+Inf\"} 3\n"));
  EXPECT_THAT(text, HasSubstr("ontime_measuring 1\n"));
  EXPECT_THAT(text, HasSubstr("fate=\"late\"} 1\n"));
  EXPECT_THAT(text, HasSubstr("fate=\"lost\"} 3\n"))
      << "a counter never falls: the fourth may prove answered";
  EXPECT_THAT(metrics_of({}), HasSubstr("ontime_measuring 0\n"));
}

}  // namespace
}  // namespace ontime::watch
