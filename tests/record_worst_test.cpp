// SPDX-License-Identifier: Apache-2.0
// A file that keeps the worst of a robot's messages within a bound.
#include <numeric>
#include <random>
#include <set>

#include "record_fixture.hpp"

namespace ontime::record {
namespace {

constexpr std::int64_t ms = 1'000'000;
// Sanitizers make JSON slow: there the files and all numbers of messages are a quarter.
#ifdef ONTIME_TEST_SANITIZED
constexpr std::uint64_t part = 4;
#else
constexpr std::uint64_t part = 1;
#endif
constexpr std::uint64_t bound = 4'000'000 / part;

class Bounded : public RecordTest {
 protected:
  static nlohmann::json asked(double deadline_us = 10'000) {
    return {{"id", "/cmd_vel age"}, {"measures", "age"}, {"kept", "worst"}, {"deadline_us", deadline_us}};
  }
  // The middle one of three is so late, with a window of some 20 kB.
  static void add(Writer& writer, std::int64_t run, std::uint64_t message, std::int64_t took_ns) {
    std::vector<Sample> samples;
    for (const auto index : {message - 1, message, message + 1}) {
      const auto sent_ns = static_cast<std::int64_t>(index) * 100 * ms;
      Sample sample{};
      sample.index = index;
      sample.intended_ns = sample.due_ns = sample.woke_ns = sample.sent_ns = sent_ns;
      sample.received_ns = sent_ns + (index == message ? took_ns : ms);
      sample.fate = index == message ? Fate::late : Fate::on_time;
      samples.push_back(sample);
    }
    writer.append(run, samples);
    writer.note(run, {cause_of_late, "why", samples[1].received_ns, message});
    Trace trace{"controller", {{message, samples[1].sent_ns, samples[1].received_ns}, true, {}}};
    for (int i = 0; i < 200; ++i)
      trace.window.events.push_back({.at_ns = samples[1].sent_ns + i * 1000,
                                     .kind = trace::Kind::switched,
                                     .thread = {i, "a thread", 120},
                                     .other = {i + 1, "another", 120},
                                     .what = "S"});
    writer.trace(run, trace);
  }
  // By the length of what took so long, those that are kept.
  std::multiset<std::int64_t> kept(std::int64_t run) const {
    std::map<std::uint64_t, Sample> samples;
    const Reader reader(path_);
    reader.each_sample(run, [&](const Sample& sample) { samples[sample.index] = sample; });
    std::multiset<std::int64_t> took;
    reader.each_trace(run, [&](const Trace& trace) {
      const auto message = trace.window.span.message;
      EXPECT_TRUE(samples.contains(message - 1) && samples.contains(message + 1)) << message;
      took.insert(samples.at(message).received_ns - samples.at(message).sent_ns);
    });
    EXPECT_EQ(samples.size(), 3 * took.size()) << "and no others";
    EXPECT_EQ(reader.notes(run).size(), took.size());
    return took;
  }
  std::uint64_t bytes() const {
    std::uint64_t bytes = 0;
    for (const auto* suffix : {"", "-wal", "-shm"})
      if (const auto file = path_ + suffix; fs::exists(file)) bytes += fs::file_size(file);
    return bytes;
  }
};

// 2,160 windows of some 20 kB: 45 MB into 4 MB.
TEST_F(Bounded, WorstAreKeptAndTheFileStaysSmall) {
  constexpr std::size_t count = 2'160 / part;
  std::mt19937_64 random(20261125);
  std::vector<std::int64_t> planted(count);
  std::iota(planted.begin(), planted.end(), 11);
  std::shuffle(planted.begin(), planted.end(), random);
  Writer writer(path_);
  writer.keep_worst(bound);
  const auto run = writer.begin_run(asked());
  std::uint64_t most = 0;
  for (std::size_t i = 0; i < count; ++i) {
    add(writer, run, 100 * (i + 1), planted[i] * ms);
    if (i % 10 == 0) {
      writer.flush();
      most = std::max(most, bytes());
    }
  }
  writer.flush();
  EXPECT_LE(most, bound);
  const auto worst = kept(run);
  ASSERT_GT(worst.size(), 50 / part);
  std::multiset<std::int64_t> expected;
  for (std::size_t i = 0; i < worst.size(); ++i)
    expected.insert(static_cast<std::int64_t>(count + 10 - i) * ms);
  EXPECT_EQ(worst, expected) << "of so many the worst";
}

// Messages are written before there is room for them: however fast they come, only some wait for that.
TEST_F(Bounded, ABurstDoesNotExceedIt) {
  Writer writer(path_);
  writer.keep_worst(bound);
  const auto run = writer.begin_run(asked());
  std::uint64_t most = 0;
  for (std::uint64_t miss = 1; miss <= 4'000 / part; ++miss) {
    std::vector<Sample> around;
    for (auto index = 100 * miss - samples_around; index <= 100 * miss + samples_around; ++index) {
      Sample& sample = around.emplace_back();
      sample.index = index;
      sample.intended_ns = sample.due_ns = sample.woke_ns = sample.sent_ns =
          static_cast<std::int64_t>(index) * ms;
      sample.received_ns =
          sample.sent_ns + static_cast<std::int64_t>(index == 100 * miss ? miss + 20 : 1) * ms;
    }
    writer.append(run, around);
    writer.note(run, {cause_of_late, std::string(300, 'x'), around[samples_around].received_ns, 100 * miss});
    writer.trace(
        run, {"controller",
              {{100 * miss, around[samples_around].sent_ns, around[samples_around].received_ns}, true, {}}});
    most = std::max(most, bytes());
  }
  writer.flush();
  EXPECT_LE(std::max(most, bytes()), bound);
}

TEST_F(Bounded, AnotherTopicsMessagesAreComparedByTheirLimits) {
  Writer writer(path_);
  writer.keep_worst(bound);
  const auto slow = writer.begin_run(asked(1'000'000)), fast = writer.begin_run(asked(1'000));
  for (std::uint64_t i = 1; i <= 200 / part; ++i) add(writer, slow, 100 * i, 1'500 * ms);
  for (std::uint64_t i = 1; i <= 200 / part; ++i) add(writer, fast, 100 * i, 20 * ms);
  writer.flush();
  EXPECT_EQ(kept(slow).size(), 0u) << "1.5 times the limit";
  EXPECT_GT(kept(fast).size(), 50 / part) << "20 times the limit";
}

TEST_F(Bounded, NextWriterGoesOnWithTheSameBound) {
  {
    Writer writer(path_);
    writer.keep_worst(bound);
    const auto run = writer.begin_run(asked());
    for (std::uint64_t i = 1; i <= 300 / part; ++i) add(writer, run, 100 * i, 20 * ms);
    writer.note_outcome(run, {{"late", 300}});
  }
  const auto before = kept(1).size();
  Writer writer(path_);
  writer.keep_worst(bound);
  const auto run = writer.begin_run(asked());
  for (std::uint64_t i = 1; i <= 20; ++i) add(writer, run, 100 * i, 30 * ms);
  writer.flush();
  EXPECT_EQ(kept(run).size(), 20u);
  EXPECT_LT(kept(1).size(), before);
  EXPECT_GE(kept(1).size() + 21, before);
  EXPECT_EQ(Reader(path_).runs().front().outcome.counters.late, 300u) << "of a run that was cut off";
  EXPECT_LE(bytes(), bound);
}

TEST_F(Bounded, SmallerBoundMakesTheFileFitOrIsRefused) {
  {
    Writer writer(path_);
    const auto run = writer.begin_run(asked());
    for (std::uint64_t i = 1; i <= 100; ++i) add(writer, run, 100 * i, (10 + static_cast<int>(i)) * ms);
    writer.end_run(run, nlohmann::json::object());
  }
  {
    Writer writer(path_);
    EXPECT_GT(bytes(), 2'000'000U);
    writer.keep_worst(1'000'000);
    EXPECT_LE(bytes(), 1'000'000U) << "at once";
  }
  EXPECT_LT(kept(1).size(), 50u);
  EXPECT_EQ(*kept(1).rbegin(), 110 * ms);
  {
    Writer writer(path_);
    const auto run = writer.begin_run({{"id", "all is kept"}});
    writer.append(run, usual(0, 30'000));
    writer.end_run(run, nlohmann::json::object());
  }
  Writer writer(path_);
  EXPECT_THAT(error_of([&] { writer.keep_worst(1'000'000); }), HasSubstr("Choose another file"));
}

// Each message that goes takes its notes with it, which are found without a look at all others; also in a
// file that was begun without a bound.
TEST_F(Bounded, ManyNotesDoNotStopIt) {
  constexpr std::uint64_t large = 36'000'000, misses = 300;
  {
    Writer writer(path_);
    for (const auto* id : {"before", "many notes"})
      writer.end_run(writer.begin_run({{"id", id}}), nlohmann::json::object());
  }
  query(path_,
        "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n WHERE i < 550000) "
        "INSERT INTO note (run, number, message, kind, text) SELECT 2, i, i, 'note', '' FROM n");
  Writer writer(path_);
  writer.keep_worst(large);
  const auto run = writer.begin_run(asked());
  for (std::uint64_t i = 1; i <= misses; ++i) add(writer, run, 1'000'000 + 100 * i, 20 * ms);
  EXPECT_EQ(error_of([&] { writer.flush(); }), "");
  EXPECT_LE(bytes(), large);
  EXPECT_LT(kept(run).size(), misses) << "some went";
  EXPECT_EQ(error_of([&] { writer.forget_run(2); }), "");
}

TEST_F(Bounded, OldestRunsGoWhereThereAreTooMany) {
  Writer writer(path_);
  writer.keep_worst(bound);
  writer.end_run(writer.begin_run({{"id", "another's"}}), nlohmann::json::object());
  for (int i = 0; i < 100; ++i) writer.end_run(writer.begin_run(asked()), nlohmann::json::object());
  writer.flush();
  const auto runs = Reader(path_).runs();
  EXPECT_LT(runs.size(), 60u);
  EXPECT_EQ(runs.front().asked.id, "another's");
  EXPECT_EQ(runs.back().number, 101);
}

}  // namespace
}  // namespace ontime::record
