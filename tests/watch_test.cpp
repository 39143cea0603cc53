// SPDX-License-Identifier: Apache-2.0
#include "watch/watch.hpp"

#include "json.hpp"
#include "statistics/statistics.hpp"
#include "watch_fixture.hpp"

namespace ontime::watch {
namespace {

using nlohmann::json;
using record::usual;
using roundtrip::Fate;
using ::testing::HasSubstr;
using ::testing::Not;
using State = Progress::State;

TEST(Buckets, ValueAtTheLimitIsInTheBucket) {
  Buckets buckets;
  for (const auto ns : {1, 1000, 1001, 2000, 5'000'000}) buckets.add(ns);
  buckets.add(std::int64_t{1} << 60);
  EXPECT_EQ(buckets.counts()[0], 2U);
  EXPECT_EQ(buckets.counts()[1], 2U);
  EXPECT_EQ(buckets.counts().back(), 1U);
  EXPECT_EQ(buckets.count(), 6U);
  EXPECT_EQ(buckets.min_ns(), 1);
  EXPECT_EQ(buckets.max_ns(), std::int64_t{1} << 60);
}

TEST_F(Following, EachLookAddsOnlyNewSamples) {
  record::Writer writer(path_);
  Follower follower(path_);
  EXPECT_EQ(follower.look().run.number, 0);
  const auto run = writer.begin_run(asked());
  auto samples = usual(0, 1000);
  samples[7].fate = Fate::late;
  samples[7].received_ns += 20'000'000;
  samples[8].fate = Fate::lost;
  samples[8].received_ns = 0;
  writer.append(run, samples);
  writer.flush();
  const auto& progress = follower.look();
  EXPECT_EQ(progress.sent, 1000U);
  EXPECT_EQ(progress.on_time, 998U);
  EXPECT_EQ(progress.late, 1U);
  EXPECT_EQ(progress.lost, 1U);
  EXPECT_EQ(progress.round_trip.count(), 999U);
  ASSERT_EQ(progress.worst.size(), 3U);
  EXPECT_EQ(progress.worst[0].message, 7U);
  EXPECT_EQ(progress.worst[0].round_trip_ns, 20'987'654);
  EXPECT_DOUBLE_EQ(progress.elapsed_s.value(), 9.99);

  writer.append(run, usual(1000, 500));
  writer.flush();
  EXPECT_EQ(follower.look().sent, 1500U);
  EXPECT_EQ(follower.look().sent, 1500U) << "nothing is counted twice";
  EXPECT_EQ(follower.look().round_trip.count(), 1499U);
}

TEST_F(Following, TimesCountFromTheFirstMessageWithItsSampleOrWithout) {
  {
    record::Writer writer(path_);
    const auto run = writer.begin_run(asked());
    auto samples = usual(0, 20);
    samples[15].received_ns += 20'000'000;
    writer.append(run, samples);
  }
  record::query(path_, "DELETE FROM sample WHERE message < 10");
  Follower follower(path_);
  const auto progress = follower.look();
  EXPECT_NEAR(progress.elapsed_s.value_or(0), 0.19, 1e-6);
  ASSERT_FALSE(progress.worst.empty());
  EXPECT_EQ(progress.worst[0].message, 15U);
  EXPECT_NEAR(progress.worst[0].at_s, 0.15, 1e-6);
}

TEST_F(Following, LostMessageThatProvesAnsweredIsCountedOnTime) {
  record::Writer writer(path_);
  Follower follower(path_);
  const auto run = writer.begin_run(asked());
  auto samples = usual(0, 500);
  samples[480].fate = Fate::lost;
  samples[480].received_ns = 0;
  writer.append(run, samples);
  writer.flush();
  EXPECT_EQ(follower.look().lost, 1U);
  writer.append(run, usual(480, 1));
  writer.append(run, usual(500, 10));
  writer.flush();
  EXPECT_EQ(follower.look().lost, 0U);
  EXPECT_EQ(follower.look().on_time, 510U);
}

// Of cycles of 10 ms, and time-outs of 500 ms.
json asked_with_cycles(json asked) {
  asked["period_us"] = 10'000;
  asked["timeout_us"] = 500'000;
  return asked;
}

TEST_F(Following, EndedRunHasTheCountsAndTheLongestWaitOfItsReport) {
  const auto due_ns = [](std::uint64_t cycle) { return usual(cycle).due_ns; };
  const json trailing = {{"sent", 500},
                         {"skipped_cycles", 500},
                         {"trailing_cycles", 500},
                         {"trailing_due_ns", due_ns(500)},
                         {"trailing_until_ns", due_ns(1000)}};
  auto stood_still = usual(0, 500);  // the answers to these stay out, and so do the cycles before them
  for (const auto i : {100, 499}) {
    auto& lost = stood_still[static_cast<std::size_t>(i)];
    lost.fate = Fate::lost;
    lost.received_ns = 0;
    lost.skipped_cycles = 3;
    lost.intended_ns -= 30'000'000;
  }
  auto missing = stood_still;
  missing.erase(missing.begin() + 101, missing.begin() + 300);
  const auto number = std::numeric_limits<std::int64_t>::max();
  const json damaged = {{"trailing_cycles", 7}, {"trailing_due_ns", -number}, {"trailing_until_ns", number}};
  record::Writer writer(path_);
  Follower follower(path_);
  for (const auto& [samples, outcome] : {std::pair{usual(0, 500), trailing},
                                         {stood_still, json{{"sent", 500}}},
                                         {stood_still, trailing},
                                         {missing, json{{"sent", 500}}},
                                         {missing, json{{"sent", 600}, {"trailing_until_ns", due_ns(600)}}},
                                         {usual(0, 5), damaged},
                                         {{}, trailing},
                                         {{}, json{{"sent", 0}}}}) {
    const auto run = writer.begin_run(asked_with_cycles(asked()));
    writer.append(run, samples);
    writer.flush();
    EXPECT_EQ(follower.look().sent, samples.size());
    writer.end_run(run, outcome);
    const auto& progress = follower.look();
    const auto reader = writer.reader();
    const auto report = statistics::summarise(reader, reader.runs().back());
    EXPECT_EQ(progress.skipped_cycles, report.skipped_cycles) << outcome;
    EXPECT_EQ(progress.response_max_ns.value_or(0), report.response.max) << outcome;
    EXPECT_EQ(progress.lost, report.lost) << outcome;
    const auto ended_ns = std::max(report.response.max, report.lost_wait_ns);
    const bool is_open = report.open_wait_ns >= ended_ns && report.open_wait_ns > 0;
    EXPECT_EQ(is_open, !progress.worst.empty() && !progress.worst[0].message) << outcome;
    if (!progress.worst.empty()) {
      EXPECT_EQ(progress.worst[0].response_ns, std::max(report.open_wait_ns, ended_ns)) << outcome;
    }
  }
}

TEST_F(Following, LostMessageIsAmongTheWorstAsLongAsItsTimeOut) {
  auto samples = usual(0, 500);
  samples[7].fate = Fate::lost;
  samples[7].received_ns = 0;
  record::Writer writer(path_);
  writer.append(writer.begin_run(asked_with_cycles(asked())), samples);
  writer.flush();
  Follower follower(path_);
  EXPECT_THAT(text_of(follower.look()), HasSubstr("worst: response ≥ 500.1 ms (no answer) at 0.07 s\n"));
  EXPECT_THAT(text_of(follower.look()), HasSubstr("worst: response 1.059 ms (round trip 987.7 µs)"));
  EXPECT_THAT(metrics_of(follower.look()), ::testing::ContainsRegex("response_max_seconds[^\n]* 0\\.50007"));
  // The next answer comes after it was given up: until then its cycle waited.
  for (std::size_t i = 8; i < samples.size(); ++i)
    for (auto* const ns : {&samples[i].intended_ns, &samples[i].due_ns, &samples[i].woke_ns,
                           &samples[i].sent_ns, &samples[i].received_ns})
      *ns += 700'000'000;
  writer.append(writer.begin_run(asked_with_cycles(asked())), samples);
  writer.flush();
  EXPECT_THAT(text_of(follower.look()), HasSubstr("worst: response 711.1 ms"));
  EXPECT_THAT(text_of(follower.look()), HasSubstr("at 0.07 s, message 8\n"));
  EXPECT_LT(follower.look().response_max_ns, 2'000'000) << "a lost message has no response time";

  auto listened = asked();
  listened["measures"] = "age";
  writer.append(writer.begin_run(listened), samples);
  writer.flush();
  EXPECT_THAT(text_of(follower.look()), Not(HasSubstr("no answer"))) << "it has no time-out";
}

TEST_F(Following, WaitOfALostMessageEndsWhereSamplesAreMissing) {
  auto samples = usual(0, 500);
  for (const auto i : {7U, 350U}) {  // at the first look one may still prove answered
    samples[i].fate = Fate::lost;
    samples[i].received_ns = 0;
  }
  samples.erase(samples.begin() + 351, samples.begin() + 450);
  samples.erase(samples.begin() + 8, samples.begin() + 100);
  record::Writer writer(path_);
  const auto run = writer.begin_run(asked_with_cycles(asked()));
  writer.append(run, samples);
  writer.flush();
  Follower follower(path_);
  for (const auto more : {0U, 0U, 300U}) {
    writer.append(run, usual(500, more));
    writer.flush();
    const auto& worst = follower.look().worst;
    ASSERT_EQ(worst.size(), 3U);
    for (const auto i : {0U, 1U}) {
      EXPECT_EQ(worst[i].message, std::nullopt) << "a missing message may have been answered before";
      EXPECT_EQ(worst[i].response_ns, 500'071'110);
    }
  }
}

TEST_F(Following, ResponseTimeIsUnknownWithoutAnAnswer) {
  record::Writer writer(path_);
  const auto run = writer.begin_run(asked_with_cycles(asked()));
  Follower follower(path_);
  EXPECT_TRUE(parsed_json(json_of(follower.look())).at("response_max_us").is_null());
  EXPECT_THAT(metrics_of(follower.look()), Not(HasSubstr("_max_seconds")));
  auto samples = usual(0, 3);
  for (auto& sample : samples) {
    sample.fate = Fate::lost;
    sample.received_ns = 0;
  }
  writer.append(run, samples);
  writer.end_run(run, {{"sent", 3}});
  EXPECT_TRUE(parsed_json(json_of(follower.look())).at("response_max_us").is_null());
  const auto metrics = metrics_of(follower.look());
  EXPECT_THAT(metrics, Not(HasSubstr("round_trip_max_seconds")));
  EXPECT_THAT(metrics, ::testing::ContainsRegex("response_max_seconds[^\n]* 0\\.52007"))
      << "it waited so long";
}

TEST_F(Following, CyclesAfterTheLastMessageAreCountedOnceTheRunHasEnded) {
  record::Writer writer(path_);
  Follower follower(path_);
  const auto run = writer.begin_run(asked_with_cycles(asked()));
  writer.append(run, usual(0, 500));
  writer.flush();
  EXPECT_EQ(follower.look().skipped_cycles, 0U);
  writer.end_run(run, {{"sent", 500},
                       {"skipped_cycles", 500},
                       {"trailing_cycles", 500},
                       {"trailing_due_ns", usual(500).due_ns},
                       {"trailing_until_ns", usual(1000).due_ns}});
  for (int look = 0; look < 2; ++look) {
    const auto& progress = follower.look();
    EXPECT_THAT(text_of(progress), HasSubstr("skipped cycles 500\n"));
    EXPECT_THAT(text_of(progress), HasSubstr("worst: response ≥ 5 s (no answer) at 5.00 s\n"));
    const auto object = parsed_json(json_of(progress));
    EXPECT_EQ(object.at("skipped_cycles"), 500);
    EXPECT_EQ(object.at("response_max_us"), 5e6);
    EXPECT_EQ(object.at("worst")[0],
              (json{{"message", nullptr}, {"at_s", 5.0}, {"round_trip_us", nullptr}, {"response_us", 5e6}}));
    EXPECT_THAT(metrics_of(progress), ::testing::ContainsRegex("skipped_cycles_total[^\n]* 500\n"));
    EXPECT_THAT(metrics_of(progress), ::testing::ContainsRegex("response_max_seconds[^\n]* 5\n"));
  }
}

TEST_F(Following, MissingSamplesAreCountedOnceTheRunHasEnded) {
  record::Writer writer(path_);
  Follower follower(path_);
  const auto run = writer.begin_run(asked());
  writer.append(run, usual(0, 500));
  writer.flush();
  EXPECT_EQ(follower.look().unrecorded, 0U);
  writer.end_run(run, {{"sent", 700},
                       {"on_time", 695},
                       {"late", 3},
                       {"lost", 2},
                       {"skipped_cycles", 50},
                       {"dropped_records", 200}});
  const auto& progress = follower.look();
  const auto text = text_of(progress);
  EXPECT_THAT(text, HasSubstr("sent 700  on time 695  late 3  lost 2  skipped cycles 50\n"));
  EXPECT_THAT(text, HasSubstr("samples not recorded (missing below): 200\n"));
  const auto object = parsed_json(json_of(progress));
  EXPECT_EQ(object.at("sent"), 700);
  EXPECT_EQ(object.at("on_time"), 695);
  EXPECT_EQ(object.at("lost"), 2);
  EXPECT_EQ(object.at("dropped_records"), 200);
  const auto metrics = metrics_of(progress);
  for (const auto* fate : {"on_time\"} 695", "late\"} 3", "lost\"} 2"})
    EXPECT_THAT(metrics, HasSubstr(std::string("fate=\"") + fate + "\n"));
}

TEST_F(Following, SamplesThatComeAtTheEndAreReported) {
  const auto child = measuring({[](record::Writer& writer) {
    writer.note(writer.begin_run(asked()), {"samples-wait", "they wait", {}, {}});
  }});
  Follower follower(path_);
  EXPECT_EQ(follower.look().state, State::measuring);
  const auto text = text_of(follower.look());
  EXPECT_THAT(text, HasSubstr("(measuring; samples"));
  EXPECT_THAT(text, Not(HasSubstr("left"))) << "it is unknown since when";
  EXPECT_TRUE(parsed_json(json_of(follower.look())).at("elapsed_s").is_null());
  EXPECT_THAT(metrics_of(follower.look()), HasSubstr("ontime_measuring 1\n"));
  kill(child);
  EXPECT_EQ(follower.look().state, State::ended);
}

TEST_F(Following, EachRunIsSeenToItsEnd) {
  const auto whole = [](record::Writer& writer, std::uint64_t messages) {
    const auto run = writer.begin_run(asked());
    writer.append(run, usual(0, messages));
    writer.end_run(run, {{"interrupted", false}});
  };
  const auto child = measuring({[](auto& writer) { writer.append(writer.begin_run(asked()), usual(0, 500)); },
                                [&](auto& writer) {
                                  writer.append(1, usual(500, 7));
                                  writer.end_run(1, {{"interrupted", false}});
                                  whole(writer, 2);
                                  writer.append(writer.begin_run(asked()), usual(0, 3));
                                }});
  Follower follower(path_);
  EXPECT_EQ(follower.look().sent, 500U);
  EXPECT_FALSE(follower.has_next());
  next_step();
  EXPECT_EQ(follower.look().sent, 507U) << "its end came between two looks";
  EXPECT_TRUE(follower.has_next());
  EXPECT_EQ(follower.look().sent, 2U) << "it both began and ended between them";
  EXPECT_EQ(follower.look().state, State::measuring);
  EXPECT_EQ(follower.look().run.number, 3);
  EXPECT_EQ(follower.look().sent, 3U);
  EXPECT_FALSE(follower.has_next());
  ASSERT_EQ(follower.before().size(), 2U);
  EXPECT_EQ(follower.before()[0].sent, 507U);
  const auto metrics = metrics_of(follower.look(), follower.before());
  for (const auto* count :
       {"[{]run=\"1\"[^\n]*fate=\"lost\"[}] 0\n", "[{]run=\"3\"[^\n]*fate=\"lost\"[}] 0\n"})
    EXPECT_THAT(metrics, ::testing::ContainsRegex(std::string("ontime_messages_total") + count));
  EXPECT_THAT(metrics, ::testing::ContainsRegex("seconds_count[{]run=\"1\"[^\n]* 507\n"));
  EXPECT_THAT(metrics, ::testing::ContainsRegex("seconds_count[{]run=\"3\"[^\n]* 3\n"));
  kill(child);
  EXPECT_EQ(follower.look().state, State::ended);
}

// Components are measured together; what was cut off has no end.
TEST_F(Following, RunThatALaterOneOutlivedGivesWay) {
  const auto child = measuring({[](auto& writer) { writer.append(writer.begin_run(asked()), usual(0, 5)); },
                                [](auto& writer) { writer.append(writer.begin_run(asked()), usual(0, 6)); },
                                [](auto& writer) {
                                  writer.end_run(2, {{"interrupted", false}});
                                }});
  Follower follower(path_);
  EXPECT_EQ(follower.look().run.number, 1);
  next_step();
  EXPECT_EQ(follower.look().run.number, 1);
  next_step();
  EXPECT_EQ(follower.look().run.number, 2);
  EXPECT_THAT(follower.before(), ::testing::IsEmpty());
  kill(child);
}

TEST_F(Following, NewestRunOfARecordingIsSeen) {
  const auto begin = [](record::Writer& writer) {
    auto of = asked();
    of["measures"] = "age";
    writer.begin_run(of);
  };
  const auto child = measuring({begin, begin});
  Follower follower(path_);
  EXPECT_EQ(follower.look().run.number, 1);
  next_step();
  EXPECT_EQ(follower.look().run.number, 2);
  EXPECT_THAT(follower.before(), ::testing::IsEmpty()) << "it goes on";
  kill(child);
}

TEST_F(Following, ForgottenRunGivesWayToTheRunBeforeIt) {
  record::Writer writer(path_);
  Follower follower(path_);
  const auto first = writer.begin_run(asked());
  writer.append(first, usual(0, 500));
  writer.end_run(first, {{"interrupted", false}});
  const auto begin = [&](int duration_s) {
    auto other = asked();
    other["duration_s"] = duration_s;
    return writer.begin_run(other);
  };
  const auto second = begin(10);
  EXPECT_EQ(follower.look().run.number, second);
  EXPECT_EQ(follower.look().sent, 0U);
  writer.forget_run(second);
  EXPECT_EQ(follower.look().run.number, first) << "what is there is the run before it";
  EXPECT_EQ(follower.look().sent, 500U);
  EXPECT_EQ(follower.look().duration_s, 60);

  EXPECT_EQ(begin(10), second);
  EXPECT_EQ(follower.look().duration_s, 10);
  writer.forget_run(second);
  ASSERT_EQ(begin(20), second) << "its number is the next one's";
  EXPECT_EQ(follower.look().duration_s, 20);
}

TEST_F(Following, ForgottenOnlyRunLeavesNoRun) {
  record::Writer writer(path_);
  Follower follower(path_);
  const auto run = writer.begin_run(asked());
  EXPECT_EQ(follower.look().run.number, run);
  writer.forget_run(run);
  EXPECT_EQ(follower.look().run.number, 0);
}

TEST_F(Following, DeletedFileEndsTheMeasurement) {
  const auto child =
      measuring({[](record::Writer& writer) { writer.append(writer.begin_run(asked()), usual(0, 100)); }});
  Follower follower(path_);
  EXPECT_EQ(follower.look().state, State::measuring);
  kill(child);
  for (const auto& name : files()) std::filesystem::remove(folder_ / name);
  EXPECT_EQ(follower.look().state, State::ended);
  EXPECT_EQ(follower.look().sent, 100U) << "as it was seen last";
}

TEST_F(Following, KilledOrClosedWriterEndsTheMeasurement) {
  const auto child =
      measuring({[](record::Writer& writer) { writer.append(writer.begin_run(asked()), usual(0, 100)); }});
  Follower follower(path_);
  EXPECT_EQ(follower.look().state, State::measuring);
  EXPECT_THAT(text_of(follower.look()), HasSubstr("left"));
  kill(child);
  EXPECT_EQ(follower.look().state, State::ended);
  EXPECT_THAT(text_of(follower.look()), HasSubstr("cut off"));
  { record::Writer again(path_); }
  EXPECT_EQ(files().size(), 1U) << "the follower keeps nothing open";
  EXPECT_EQ(follower.look().state, State::ended);
  EXPECT_EQ(follower.look().sent, 100U);
}

TEST_F(Following, MissingFileIsWrongFile) {
  Follower follower(path_);
  EXPECT_THROW(follower.look(), record::WrongFile);
}

}  // namespace
}  // namespace ontime::watch
