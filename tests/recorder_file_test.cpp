// SPDX-License-Identifier: Apache-2.0
// A flight recorder whose file is renamed, removed, or on a disk that is full for a while.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "recorder_fixture.hpp"
#include "statistics/statistics.hpp"

namespace ontime::app {
namespace {

TEST_F(Recorder, FileThatIsRenamedOrRemovedIsEndedAndANewOneBegun) {
  const auto old = path_ + ".1";
  {
    record::Writer writer(path_);
    writer.keep_worst(4'000'000);
    ListenResults results(writer, limits_, nlohmann::json::object(), false, true);
    results.owns_file = true;
    results.look_at_file_every = {};
    auto seen = flow(1);
    seen.duplicated = 4;
    const auto look = [&](std::uint64_t messages) {
      for (std::uint64_t i = 0; i < messages; ++i) {
        results.keep({.flow = 1, .index = index_++, .from_ns = now_ns_, .to_ns = now_ns_ + ms});
        now_ns_ += 50 * ms;
      }
      results.write({seen});
    };
    look(100);
    EXPECT_EQ(results.take_news(), "");
    record::fs::rename(path_, old);
    look(50);
    EXPECT_THAT(results.take_news(), testing::HasSubstr("renamed or removed"));
    seen.duplicated = 5;
    look(30);
    EXPECT_EQ(results.take_news(), "");
    EXPECT_EQ(statistics::summarise(writer.reader()).at(0).sent, 30u);
    record::fs::remove(path_);
    look(1);
    EXPECT_THAT(results.take_news(), testing::HasSubstr("renamed or removed"));
    look(20);
    seen.duplicated = 7;
    listen::Findings findings;
    findings.flows = {seen};
    results.end(findings, false);
    EXPECT_EQ(results.failure(), "");
  }
  EXPECT_THAT(files(), testing::ElementsAre("results.db", "results.db.1"));
  const auto before = statistics::summarise(record::Reader(old)),
             now = statistics::summarise(record::Reader(path_));
  ASSERT_EQ(before.size(), 1u);
  EXPECT_EQ(before[0].sent, 150u);
  EXPECT_TRUE(statistics::is_complete(before[0].run));
  EXPECT_EQ(before[0].run.outcome.counters.duplicates, 4u);
  ASSERT_EQ(now.size(), 1u);
  EXPECT_EQ(now[0].sent, 20u);
  EXPECT_TRUE(statistics::is_complete(now[0].run));
  EXPECT_EQ(now[0].run.outcome.counters.duplicates, 2u);
}

TEST_F(Recorder, FolderOfTheFileThatIsGoneIsTriedAgain) {
  const auto folder = folder_ / "robot";
  record::fs::create_directory(folder);
  const auto path = (folder / "r.ontime").string();
  record::Writer writer(path);
  ListenResults results(writer, limits_, nlohmann::json::object(), false, true);
  results.owns_file = true;
  results.look_at_file_every = results.try_again_after = {};
  period(results, 1, 50 * ms);
  results.write({flow(1)});
  record::fs::remove_all(folder);
  for (int i = 0; i < 3; ++i) {
    period(results, 1, 50 * ms);
    results.write({flow(1)});
    EXPECT_NE(results.failure(), "");
  }
  record::fs::create_directory(folder);
  results.write({flow(1)});
  EXPECT_EQ(results.failure(), "");
  period(results, 1, 50 * ms);
  results.write({flow(1)});
  listen::Findings findings;
  findings.flows = {flow(1)};
  results.end(findings, false);
  EXPECT_EQ(statistics::summarise(writer.reader()).at(0).sent, 3u);
}

TEST_F(Recorder, FullDiskIsToldAndRecordingGoesOnOnceItHasSpace) {
  if (!mount_disk("size=4m")) GTEST_SKIP() << "mounting a tmpfs needs root";
  const auto filler = folder_ / "filler";
  for (const bool keeps_worst : {false, true}) {
    const auto path = path_ + (keeps_worst ? "worst" : "all");
    index_ = 0;
    {
      record::Writer writer(path);
      if (keeps_worst) writer.keep_worst(2'000'000);
      ListenResults results(writer, limits_, nlohmann::json::object(), false, keeps_worst);
      results.try_again_after = {};
      const auto look = [&] {
        for (int i = 0; i < 200; ++i) period(results, 1, 50 * ms);
        period(results, 1, 70 * ms);
        results.note(miss(1, 70 * ms, 2000));
        results.write({flow(1)});
      };
      look();
      writer.flush();
      EXPECT_EQ(results.take_news(), "");
      record::write_bytes(filler.string(), std::string(4 << 20, 'x'));
      for (int tries = 0; tries < 3000 && results.failure().empty(); ++tries) {
        look();
        std::this_thread::sleep_for(std::chrono::milliseconds(20));
      }
      EXPECT_THAT(results.failure(), testing::ContainsRegex("disk is full|No space"));
      EXPECT_THAT(results.take_news(), testing::HasSubstr("stopped, and is tried again: " + path));
      EXPECT_EQ(results.take_news(), "");
      for (int i = 0; i < 10; ++i) period(results, 1, 50 * ms);
      record::fs::remove(filler);
      look();
      EXPECT_EQ(results.failure(), "");
      EXPECT_THAT(results.take_news(), testing::HasSubstr("goes on; not recorded from 20"));
      look();
      listen::Findings findings;
      findings.flows = {flow(1)};
      results.end(findings, false);
      EXPECT_EQ(results.failure(), "");
    }
    const record::Reader reader(path);
    const auto run = statistics::summarise(reader).at(0);
    EXPECT_EQ(run.run.outcome.counters.sent, index_) << "all are counted";
    std::vector<std::string> told;
    for (const auto& note : run.notes)
      if (note.kind == "not-recorded") told.push_back(note.text);
    ASSERT_EQ(told.size(), 1u);
    EXPECT_THAT(told[0],
                testing::ContainsRegex("^not recorded from 20.* to 20.*: [^.]*(full|No space)[^.]*$"));
    if (keeps_worst) continue;
    const auto samples = record::samples_of(reader, 1).size();
    EXPECT_LT(samples, index_);
    EXPECT_EQ(statistics::unrecorded(run.run), index_ - samples);
  }
}

}  // namespace
}  // namespace ontime::app
