// SPDX-License-Identifier: Apache-2.0
// The flight recorder of `ontime listen`: what a results file keeps of weeks, at an accelerated rate.
#include <numeric>
#include <random>
#include <set>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "explain/explain.hpp"
#include "listen_words.hpp"
#include "recorder_fixture.hpp"
#include "statistics/statistics.hpp"

namespace ontime::app {
namespace {

using listen::Row;
using record::Sample;

// 20 messages a second, and every 40 s one that is late: 1,728,000 and 2,160, of which 4 MB keep the worst.
TEST_F(Recorder, ADayIsCountedAndItsWorstMessagesAreKept) {
  constexpr std::uint64_t bound = 4'000'000;
  constexpr std::int64_t each = 800, misses = 2'160;
  std::vector<std::int64_t> planted(misses);
  std::iota(planted.begin(), planted.end(), 61);
  std::shuffle(planted.begin(), planted.end(), std::mt19937_64(20261125));
  std::uint64_t most = 0;
  {
    record::Writer writer(path_);
    writer.keep_worst(bound);
    ListenResults results(writer, limits_, nlohmann::json::object(), true, true);
    for (const auto late_ms : planted) {
      period(results, 1, late_ms * ms);
      const auto late = miss(1, late_ms * ms);
      for (int i = 1; i < each; ++i) {
        period(results, 1, 50 * ms);
        if (i == 2) results.note(late);
        if (i % 200 == 0) results.write({flow(1)});
      }
      most =
          std::max<std::uint64_t>(most, record::fs::file_size(path_) + record::fs::file_size(path_ + "-wal"));
    }
    listen::Findings findings;
    findings.flows = {flow(1)};
    results.end(findings, false);
    EXPECT_EQ(results.failure(), "");
    EXPECT_EQ(results.runs(), 1u);
  }
  EXPECT_LE(most, bound);
  const record::Reader reader(path_);
  const auto day = statistics::summarise(reader).at(0);
  EXPECT_EQ(day.sent, static_cast<std::uint64_t>(each * misses));
  EXPECT_EQ(day.late, static_cast<std::uint64_t>(misses));
  EXPECT_EQ(day.round_trip.max, (60 + misses) * ms);
  EXPECT_NEAR(static_cast<double>(day.round_trip[statistics::Figure::p50]), 50e6, 0.016 * 50e6);
  EXPECT_NEAR(static_cast<double>(day.round_trip[statistics::Figure::p99]), 50e6, 0.016 * 50e6);

  std::map<std::uint64_t, Sample> samples;
  reader.each_sample(1, [&](const Sample& sample) { samples[sample.index] = sample; });
  std::set<std::int64_t> kept, expected;
  reader.each_trace(1, [&](const record::Trace& trace) {
    EXPECT_EQ(trace.window.events.size(), 200u);
    const auto& late = samples.at(trace.window.span.message);
    kept.insert((late.received_ns - late.sent_ns) / ms);
  });
  ASSERT_GT(kept.size(), 50u);
  for (std::size_t i = 0; i < kept.size(); ++i) expected.insert(60 + misses - static_cast<std::int64_t>(i));
  EXPECT_EQ(kept, expected);
  EXPECT_TRUE(day.has_worst_only);
  EXPECT_EQ(day.notes.size(), kept.size());
  EXPECT_LE(samples.size(), 33 * kept.size()) << "those around them alone";
  EXPECT_GT(samples.size(), 2 * kept.size());
}

TEST_F(Recorder, MessageThatWasOvertakenWasNeverLost) {
  {
    record::Writer writer(path_);
    ListenResults results(writer, limits_, nlohmann::json::object(), true, false);
    for (const std::uint64_t index : {0U, 2U, 1U, 3U})
      results.keep({.flow = 1,
                    .quantity = Row::Quantity::age,
                    .index = index,
                    .from_ns = now_ns_ += ms,
                    .to_ns = now_ns_ + ms});
    listen::Findings findings;
    findings.flows = {flow(1)};
    findings.flows[0].lost = 1;  // of which no row tells
    results.end(findings, false);
  }
  const record::Reader reader(path_);
  EXPECT_EQ(statistics::unrecorded(reader.runs().at(0)), 1u);
}

// Else a recording, which is read faster than a disk writes, fills the memory.
TEST_F(Recorder, RecordingIsWrittenBeforeMoreOfItIsRead) {
  record::Writer writer(path_);
  ListenResults results(writer, limits_, nlohmann::json::object(), true);
  for (int i = 0; i < 100; ++i) period(results, 1, 50 * ms);
  results.write({flow(1)});
  EXPECT_EQ(statistics::summarise(record::Reader(path_)).at(0).sent, 100u);
}

TEST_F(Recorder, FlowsOfTheSameNamesHaveTheNumbersOfTheirProcesses) {
  record::Writer writer(path_);
  ListenResults results(writer, limits_, nlohmann::json::object(), true);
  auto unknown = flow(2, 3);
  unknown.writer = {};  // its writer is not recognized yet
  for (std::uint64_t id : {1U, 2U}) period(results, id, 50 * ms);
  results.write({flow(1), unknown});
  listen::Findings findings;
  findings.flows = {flow(1), flow(2, 3)};
  results.end(findings, false);
  std::vector<std::string> names;
  for (const auto& run : record::Reader(path_).runs()) names.push_back(run.asked.variant);
  EXPECT_THAT(names, testing::UnorderedElementsAre("controller [1] → base [2]", "controller [1] → base [3]"));
}

TEST_F(Recorder, PausesAreToldOfEachRun) {
  record::Writer writer(path_);
  ListenResults results(writer, limits_, nlohmann::json::object(), true, true);
  for (int i = 0; i < 100; ++i) period(results, 1, 50 * ms);
  listen::Findings findings;
  findings.flows = {flow(1)};
  results.end(findings, false, "listened 40 % of the time");
  const auto notes = statistics::summarise(record::Reader(path_)).at(0).notes;
  ASSERT_EQ(notes.size(), 1u);
  EXPECT_EQ(notes[0].text, "listened 40 % of the time");
}

TEST_F(Recorder, WhatOntimeDidNotSeeIsToldInWordsOfTheRobot) {
  record::Writer writer(path_);
  ListenResults results(writer, limits_, nlohmann::json::object(), true);
  period(results, 1, 50 * ms);
  listen::Findings findings;
  findings.flows = {flow(1)};
  findings.sensor_lost = 1500;
  results.end(findings, false);
  const auto notes = statistics::summarise(record::Reader(path_)).at(0).notes;
  ASSERT_EQ(notes.size(), 1u);
  EXPECT_EQ(notes[0].text, unseen_of(1500));
  EXPECT_THAT(notes[0].text, testing::StartsWith("1,500 publishes, takes or packets were not seen: "));
  EXPECT_THAT(notes[0].text, testing::HasSubstr("Fix for a full buffer: "));
}

TEST_F(Recorder, IncompleteSourceIsToldOfEachRun) {
  record::Writer writer(path_);
  ListenResults results(writer, limits_, nlohmann::json::object(), true);
  for (std::uint64_t id : {1U, 2U}) period(results, id, 50 * ms);
  listen::Findings findings;
  findings.flows = {flow(1), flow(2, 3)};
  findings.add_incomplete("the bag ends at byte 7");
  results.end(findings, false);
  for (const auto& run : statistics::summarise(record::Reader(path_))) {
    ASSERT_EQ(run.notes.size(), 1u);
    EXPECT_EQ(run.notes[0].kind, "incomplete");
    EXPECT_EQ(run.notes[0].text, "the bag ends at byte 7");
  }
}

// `ages` of ten messages have an age. What the results tell of it, as "kind: text" of a run.
std::string open_age(const std::string& path, std::uint64_t ages,
                     std::optional<std::chrono::nanoseconds> limit) {
  {
    record::Writer writer(path);
    ListenResults results(writer, {.deadline = {}, .period = {}, .age = limit}, nlohmann::json::object(),
                          true);
    listen::Flow flow;
    flow.id = 1;
    flow.topic = "/scan";
    flow.writer = {0, "publishers"};
    flow.reader = {0, "recorder"};
    flow.messages = 10;
    flow.age_unknown = 10 - ages;
    if (ages > 0) flow.age.emplace();
    for (std::uint64_t i = 0; i < ages; ++i) {
      flow.age->add(ms);
      results.keep({.flow = 1, .index = i, .from_ns = 1000 * ms, .to_ns = 1001 * ms});
    }
    results.keep({.flow = 1, .quantity = Row::Quantity::period, .from_ns = 1000 * ms, .to_ns = 1001 * ms});
    listen::Findings findings;
    findings.flows = {flow};
    results.end(findings, false);
  }
  std::string told;
  for (const auto& run : statistics::summarise(record::Reader(path)))
    for (const auto& note : run.notes) told += run.run.asked.id + ": " + note.kind + ": " + note.text;
  record::fs::remove(path);
  return told;
}

TEST_F(Recorder, MessagesWithoutAKnownAgeAreToldOfTheirRun) {
  using namespace std::chrono_literals;
  EXPECT_EQ(open_age(path_, 10, 2ms), "");
  EXPECT_EQ(open_age(path_, 1, 2ms),
            "/scan age: gate-not-judged: open: --age: the age of 9 of 10 messages of /scan is unknown");
  EXPECT_EQ(open_age(path_, 1, {}),
            "/scan age: age-unknown: the age of 9 of 10 messages of /scan is unknown");
  EXPECT_EQ(open_age(path_, 0, 2ms),
            "/scan period: gate-not-judged: open: --age: the age of /scan is unknown");
  EXPECT_EQ(open_age(path_, 0, {}), "") << "most types have no stamp";
}

TEST_F(Recorder, WorstOfOneDelayStandsForAll) {
  record::Writer writer(path_);
  ListenResults results(writer, limits_, nlohmann::json::object(), true, true);
  for (int i = 0; i < 100; ++i) period(results, 1, 50 * ms);
  for (const auto ns : {70 * ms, 90 * ms, 80 * ms}) {
    period(results, 1, ns);
    results.note(miss(1, ns));
  }
  listen::Findings findings;
  findings.flows = {flow(1)};
  results.end(findings, false);
  std::vector<std::uint64_t> kept;
  const record::Reader reader(path_);
  reader.each_trace(1, [&](const record::Trace& trace) { kept.push_back(trace.window.span.message); });
  EXPECT_THAT(kept, testing::ElementsAre(101u));
  EXPECT_EQ(statistics::summarise(reader).at(0).late, 3u);
}

TEST_F(Recorder, OfManyDelaysAtOnceTheWorstAreKept) {
  record::Writer writer(path_);
  ListenResults results(writer, limits_, nlohmann::json::object(), true, true);
  for (int i = 0; i < 100; ++i) period(results, 1, 50 * ms);
  for (const auto late_ms : {70, 200, 90, 150, 80, 120}) {
    period(results, 1, late_ms * ms);
    results.note(miss(1, late_ms * ms));
    for (int i = 0; i < 5; ++i) period(results, 1, 50 * ms);
  }
  listen::Findings findings;
  findings.flows = {flow(1)};
  results.end(findings, false);
  std::vector<std::int64_t> kept;
  const record::Reader reader(path_);
  reader.each_trace(1, [&](const record::Trace& trace) {
    kept.push_back((trace.window.span.to_ns - trace.window.span.from_ns) / ms - 100);
  });
  EXPECT_THAT(kept, testing::UnorderedElementsAre(200, 90, 150, 120));
}

TEST_F(Recorder, MissWithoutItsRowOrWindowIsCounted) {
  record::Writer writer(path_);
  ListenResults results(writer, limits_, nlohmann::json::object(), true, true);
  for (int i = 0; i < 100; ++i) period(results, 1, 50 * ms);
  period(results, 1, 70 * ms);
  auto bare = miss(1, 70 * ms);
  bare.surroundings.reset();
  results.note(bare);
  results.note(miss(1, 99 * ms));
  results.write({flow(1)});
  listen::Findings findings;
  findings.flows = {flow(1)};
  results.end(findings, false);
  const record::Reader reader(path_);
  const auto runs = statistics::summarise(reader);
  ASSERT_EQ(runs.size(), 1u);
  EXPECT_EQ(runs[0].sent, 101u);
  EXPECT_EQ(runs[0].late, 1u);
  std::size_t traces = 0;
  reader.each_trace(1, [&](const record::Trace& trace) {
    EXPECT_EQ(trace.window.span.message, 100u);
    EXPECT_FALSE(trace.window.whole);
    ++traces;
  });
  EXPECT_EQ(traces, 1u);
}

// Of two equal periods each cause names its own. A row that was written before its miss is found by its time.
TEST_F(Recorder, CauseNamesItsMessage) {
  for (const bool is_written : {false, true}) {
    index_ = 0;
    const auto path = path_ + (is_written ? "written" : "waiting");
    record::Writer writer(path);
    ListenResults results(writer, limits_, nlohmann::json::object(), true);
    std::vector<listen::Miss> misses;
    for (const auto ns : {50 * ms, 70 * ms, 50 * ms, 70 * ms}) {
      period(results, 1, ns);
      if (ns == 70 * ms) misses.push_back(miss(1, ns));
    }
    if (is_written) results.write({flow(1)});
    for (const auto& one : misses) results.note(one);
    period(results, 1, 50 * ms);
    listen::Findings findings;
    findings.flows = {flow(1)};
    results.end(findings, false);
    const record::Reader reader(path);
    const auto notes = notes_of(reader, reader.runs().at(0));
    ASSERT_EQ(notes.size(), 2u);
    EXPECT_EQ(notes[0].message, 1u) << is_written;
    EXPECT_EQ(notes[1].message, 3u) << is_written;
    ASSERT_TRUE(notes[0].cause);
    EXPECT_EQ(notes[0].cause->ns, 4 * ms);
    EXPECT_EQ(notes[0].text, "70.0 ms after the previous message (limit 60 ms): the reader waited: 4.0 ms");
  }
}

// As ontime wrote them before causes were data.
TEST_F(Recorder, NoteOfAnOlderFileIsOfTheLateMessageThatCameThen) {
  record::Writer writer(path_);
  ListenResults results(writer, limits_, nlohmann::json::object(), true);
  for (const auto ns : {50 * ms, 70 * ms, 50 * ms}) period(results, 1, ns);
  listen::Findings findings;
  findings.flows = {flow(1)};
  results.end(findings, false);
  writer.note(1, {record::cause_of_late, "70.0 ms old", 1120 * ms, std::nullopt});
  writer.note(1, {record::cause_of_late, "50.0 ms old", 1050 * ms, std::nullopt});
  writer.note(1, {"pauses", "listened 40 % of the time", 1120 * ms, std::nullopt});
  const auto reader = writer.reader();
  const auto notes = notes_of(reader, reader.runs().at(0));
  ASSERT_EQ(notes.size(), 3u);
  EXPECT_EQ(notes[0].message, 1u);
  EXPECT_FALSE(notes[1].message) << "it was not late";
  EXPECT_FALSE(notes[2].message);
}

// Misses of packets have no course.
TEST_F(Recorder, WorstMessagesOfPacketsAreKept) {
  record::Writer writer(path_);
  ListenResults results(writer, limits_, nlohmann::json::object(), true, true);
  period(results, 1, 70 * ms);
  auto bare = miss(1, 70 * ms);
  bare.course = {};
  bare.surroundings.reset();
  bare.why.reset();
  results.note(bare);
  listen::Findings findings;
  findings.flows = {flow(1)};
  results.end(findings, false);
  std::size_t traces = 0;
  writer.reader().each_trace(1, [&](const auto&) { ++traces; });
  EXPECT_EQ(traces, 1u);
}

TEST_F(Recorder, ExaminedMessagesAreCountedByWhetherTheirCauseWasSeen) {
  for (const bool keeps_worst : {false, true}) {
    const auto path = path_ + (keeps_worst ? "worst" : "all");
    record::Writer writer(path);
    ListenResults results(writer, limits_, nlohmann::json::object(), true, keeps_worst);
    auto unseen = miss(1, 70 * ms), not_examined = unseen;
    unseen.why->is_seen = false;
    not_examined.why.reset();
    for (const auto& late : {miss(1, 70 * ms), miss(1, 70 * ms), unseen, not_examined}) {
      period(results, 1, 70 * ms);
      results.note(late);
    }
    listen::Findings findings;
    findings.flows = {flow(1)};
    results.end(findings, false);
    const auto causes = record::Reader(path).runs().at(0).outcome.causes;
    ASSERT_TRUE(causes);
    EXPECT_EQ(causes->seen, 2u);
    EXPECT_EQ(causes->not_seen, 1u);
  }
}

// Nodes that start again and again: no entry stays, and each has the counts of its own time.
TEST_F(Recorder, FlowThatIsGoneEndsItsRunAndLeavesItsName) {
  record::Writer writer(path_);
  ListenResults results(writer, limits_, nlohmann::json::object(), true, true);
  for (std::uint64_t id = 1; id <= 3; ++id) {
    index_ = 0;
    for (std::uint64_t i = 0; i < 10 * id; ++i) period(results, id, 50 * ms);
    results.write({flow(id, 100 + static_cast<std::uint32_t>(id))});
  }
  results.end({}, false);
  writer.flush();
  const auto runs = statistics::summarise(record::Reader(path_));
  ASSERT_EQ(runs.size(), 3u);
  for (std::size_t i = 0; i < runs.size(); ++i) {
    EXPECT_EQ(runs[i].run.asked.variant, "controller → base") << "so they are repetitions";
    EXPECT_EQ(runs[i].sent, 10 * (i + 1));
    EXPECT_TRUE(statistics::is_complete(runs[i].run));
  }
}

// Counts are written each minute, late messages each second.
TEST_F(Recorder, LateMessagesThatAreNewerThanTheCountsAreCounted) {
  record::Writer writer(path_);
  ListenResults results(writer, limits_, nlohmann::json::object(), true, true);
  for (int i = 0; i < 100; ++i) period(results, 1, 50 * ms);
  results.write({flow(1)});
  for (int late = 0; late < 3; ++late) {
    period(results, 1, 70 * ms);
    results.note(miss(1, 70 * ms));
    for (int i = 0; i < 5; ++i) period(results, 1, 50 * ms);
  }
  results.write({flow(1)});
  const auto reader = writer.reader();
  const auto run = reader.runs().at(0);
  EXPECT_EQ(run.outcome.counters.late, 3u);
  EXPECT_EQ(explain::account_of(reader, run).late, 3u);
}

// Each number is of one moment: the worst messages alone are late far more often than all.
TEST_F(Recorder, CountsOfARunThatIsRecordedAreThoseOfAllMessages) {
  record::Writer writer(path_);
  ListenResults results(writer, limits_, nlohmann::json::object(), true, true);
  for (int late = 0; late < 5; ++late) {
    for (int i = 0; i < 999; ++i) period(results, 1, 50 * ms);
    period(results, 1, (70 + late) * ms);
    results.note(miss(1, (70 + late) * ms));
    results.write({flow(1)});
  }
  const auto reader = writer.reader();
  const auto run = statistics::summarise(reader).at(0);
  EXPECT_EQ(run.sent, 5000u);
  EXPECT_EQ(run.late, 5u);
  EXPECT_EQ(run.round_trip.max, 74 * ms);
  ASSERT_FALSE(run.shape.worst.empty());
  EXPECT_LE(run.shape.worst[0].took_ns, run.round_trip.max);
  EXPECT_FALSE(run.run.outcome.has_ended());
  EXPECT_FALSE(statistics::is_complete(run.run));
  EXPECT_TRUE(run.run.outcome.counted_until_s);
  record::Writer copy(path_ + "copy");
  record::copy_run(reader, run.run, copy);
  EXPECT_EQ(copy.reader().runs().at(0).outcome.document, run.run.outcome.document);
}

// Other topics took the space of its late messages.
TEST_F(Recorder, LateMessagesWithoutSpaceAreCountedWhileItIsRecorded) {
  record::Writer writer(path_);
  ListenResults results(writer, limits_, nlohmann::json::object(), true, true);
  for (int i = 0; i < 100; ++i) period(results, 1, i % 10 == 0 ? 70 * ms : 50 * ms);
  results.write({flow(1)});
  const auto run = statistics::summarise(writer.reader()).at(0);
  EXPECT_EQ(run.sent, 100u);
  EXPECT_EQ(run.late, 10u);
}

TEST_F(Recorder, KilledOneLeavesWhatItCounted) {
  record::kill_9([&](const auto& is_far_enough) {
    record::Writer writer(path_);
    writer.keep_worst(4'000'000);
    ListenResults results(writer, limits_, nlohmann::json::object(), true, true);
    for (int i = 0; i < 100; ++i) period(results, 1, 50 * ms);
    results.write({flow(1)});
    writer.flush();
    is_far_enough();
  });
  const auto runs = statistics::summarise(record::Reader(path_));
  ASSERT_EQ(runs.size(), 1u);
  EXPECT_EQ(runs[0].sent, 100u);
  EXPECT_EQ(runs[0].round_trip.max, 50 * ms);
}

}  // namespace
}  // namespace ontime::app
