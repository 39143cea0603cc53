// SPDX-License-Identifier: Apache-2.0
// A flight recorder's file, followed: it counts all messages and keeps the worst.
#include "json.hpp"
#include "statistics/statistics.hpp"
#include "watch/watch.hpp"
#include "watch_fixture.hpp"

namespace ontime::watch {
namespace {

using nlohmann::json;
using record::usual;
using roundtrip::Fate;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;
using State = Progress::State;

// Of a period of 10 ms: 9 of 3,600 were late.
json recorded() {
  return {{"sent", 3600},
          {"late", 9},
          {"counted_until_s", 1'796'000'000},
          {"loss_unknown", true},
          {"histogram",
           {{"values", {{10'000'000, 3591}, {28'000'000, 8}, {108'000'000, 1}}},
            {"beyond", 0},
            {"beyond_from_ns", 0},
            {"max_ns", 108'000'000},
            {"mean_ns", 10'067'222.0}}}};
}

TEST_F(Following, FlightRecordersFileShowsWhatItCountedAndItsWorst) {
  const auto child = measuring({[](record::Writer& writer) {
    const auto run = writer.begin_run(
        {{"id", "/cmd_vel period"}, {"measures", "period"}, {"kept", "worst"}, {"deadline_us", 15'000}});
    for (const std::uint64_t worst : {2000, 1000, 3000}) {  // one was examined later
      auto around = usual(worst - 1, 3);
      around[1].fate = Fate::late;
      around[1].received_ns = around[1].sent_ns + (worst == 1000 ? 108'000'000 : 28'000'000);
      writer.append(run, around);
      writer.flush();
    }
    writer.note_outcome(run, recorded());
  }});
  Follower follower(path_);
  EXPECT_EQ(follower.look().state, State::measuring);
  const auto text = text_of(follower.look());
  EXPECT_THAT(text,
              StartsWith("run 1  /cmd_vel period  0:36  (flight recorder: counts are up to a minute old)\n"));
  EXPECT_THAT(text, HasSubstr("sent 3,600  on time unknown  late 9  lost unknown"));
  EXPECT_THAT(text, HasSubstr("period: min 10 ms  mean 10.07 ms  max 108 ms"));
  EXPECT_THAT(text, HasSubstr("≤ 10 ms      3,591  "));
  EXPECT_THAT(text, HasSubstr("worst: period 108 ms, message 1000\nworst: period 28 ms, message 2000\n"));
  const auto object = parsed_json(json_of(follower.look()));
  EXPECT_NEAR(object.at("elapsed_s"), 36.242, 1e-3);
  EXPECT_TRUE(object.at("worst")[0].at("at_s").is_null());
  EXPECT_EQ(object.at("dropped_records"), 0);
  kill(child);
  EXPECT_THAT(text_of(follower.look()),
              StartsWith("run 1  /cmd_vel period  0:36  (cut off: no process writes into the file)\n"));
}

TEST_F(Following, FlightRecordersAgesDoNotTellHowLongTheyTook) {
  const auto child = measuring({[](record::Writer& writer) {
    const auto run = writer.begin_run({{"id", "/cmd_vel age"}, {"measures", "age"}, {"kept", "worst"}});
    writer.append(run, usual(0, 3));
    writer.note_outcome(run, recorded());
  }});
  EXPECT_THAT(text_of(Follower(path_).look()), StartsWith("run 1  /cmd_vel age  (flight recorder"));
  EXPECT_TRUE(parsed_json(json_of(Follower(path_).look())).at("elapsed_s").is_null());
  kill(child);
}

// Values of 10.0 to 10.1 ms are recorded as one, by the greatest of these.
TEST_F(Following, FlightRecordersMeanAndMaximumAreThoseOfItsRecord) {
  auto outcome = recorded();
  outcome["histogram"]["values"] = json::array({json::array({10'100'000, 3600})});
  outcome["histogram"]["max_ns"] = 10'100'000;
  outcome["histogram"]["mean_ns"] = 10e6;
  record::Writer writer(path_);
  const auto shown = [&] {
    writer.end_run(writer.begin_run({{"measures", "period"}, {"kept", "worst"}}), outcome);
    return Follower(path_).look();
  };
  const auto exact = shown();
  EXPECT_THAT(text_of(exact), HasSubstr("period: min 10 ms  mean 10 ms  max 10.1 ms"));
  EXPECT_EQ(exact.elapsed_s, 36.0);
  EXPECT_THAT(metrics_of(exact), ::testing::ContainsRegex("round_trip_seconds_sum[^\n]* 36\n"));
  for (const json& damaged : {json(), json("x"), json(-1), json(1e300)}) {
    outcome["histogram"]["mean_ns"] = damaged;
    EXPECT_THAT(text_of(shown()), HasSubstr("mean 10.1 ms  max 10.1 ms")) << damaged;
  }
}

TEST_F(Following, DamagedHistogramOfAFlightRecorderIsLeftOut) {
  record::Writer writer(path_);
  for (const json& values : {json("x"), json{{"a", 1}}, json{{1, -1}}, json{{-1, 1}}, json{1, 2}, json{{1}},
                             json{{1, 0}}, json{{UINT64_MAX, 1}}, json{{1, UINT64_MAX}}}) {
    auto outcome = recorded();
    outcome["histogram"]["values"] = values;
    writer.end_run(writer.begin_run({{"measures", "age"}, {"kept", "worst"}}), outcome);
    EXPECT_THAT(text_of(Follower(path_).look()), Not(HasSubstr("mean"))) << values;
  }
}

}  // namespace
}  // namespace ontime::watch
