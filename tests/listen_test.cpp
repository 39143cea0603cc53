// SPDX-License-Identifier: Apache-2.0
#include "listen/listen.hpp"

#include <algorithm>
#include <fstream>
#include <functional>
#include <map>

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/mman.h>
#include <unistd.h>

#include "listen/library.hpp"
#include "listen/messages.hpp"
#include "listen/processes.hpp"
#include "listen/sequence.hpp"

namespace ontime::listen {
namespace {

using namespace std::chrono_literals;

TEST(Distribution, QuantilesAreWithinTheirBounds) {
  Distribution values;
  for (std::int64_t i = 1; i <= 100'000; ++i) values.add(i * 1000);
  EXPECT_EQ(values.count(), 100'000U);
  EXPECT_EQ(values.max_ns(), 100'000'000);
  EXPECT_NEAR(static_cast<double>(values.quantile_ns(0.5)), 50e6, 50e6 * 0.016);
  EXPECT_NEAR(static_cast<double>(values.quantile_ns(0.99)), 99e6, 99e6 * 0.016);
  EXPECT_EQ(values.quantile_ns(1), 100'000'000);
}

TEST(Distribution, QuantileOfAPeriodicTopicIsItsPeriod) {
  for (const auto ms : {1, 2, 5, 10, 20, 50, 100}) {
    Distribution values;
    for (int i = 0; i < 100; ++i) values.add(ms * 1'000'000LL + (i % 2 == 0 ? 500 : -500));
    values.add(1'000'000'000);
    EXPECT_NEAR(static_cast<double>(values.quantile_ns(0.5)), ms * 1e6, 500);
    EXPECT_NEAR(static_cast<double>(values.values().front().first), ms * 1e6, 500);
  }
}

// A topic's period is usually a round time, with half of its values above it.
TEST(Distribution, CountsUpToRoundTimesAreExact) {
  Distribution values;
  for (const auto time : round_times_ns)
    for (const int off : {-1, 0, 1}) values.add(time + off);
  std::uint64_t before = 0;
  for (const auto time : round_times_ns) EXPECT_EQ(values.count_up_to(time), (before += 3) - 1);
  std::uint64_t up_to = 0;  // as a results file keeps them
  for (const auto& [ns, count] : values.values()) up_to += ns <= round_times_ns[11] ? count : 0;
  EXPECT_EQ(up_to, 35U);
}

TEST(Distribution, CountsOfMonthsAreHeld) {
  Distribution values;
  values.add(1000);
  values.add(2000);
  for (int i = 0; i < 33; ++i) values.add(Distribution(values));  // twice as many each time
  EXPECT_EQ(values.count(), std::uint64_t{1} << 34);
  EXPECT_EQ(values.count_up_to(1500), std::uint64_t{1} << 33);
}

TEST(Distribution, ExtremeValuesAreKept) {
  Distribution values;
  EXPECT_EQ(values.quantile_ns(0.5), 0);
  values.add(-5);
  EXPECT_EQ(values.max_ns(), 0);
  values.add(INT64_MAX);
  EXPECT_EQ(values.max_ns(), INT64_MAX);
  EXPECT_EQ(values.quantile_ns(0.5), 0);
}

TEST(Sequence, GapIsLostUntilItIsFilled) {
  Sequence sequence;
  EXPECT_EQ(sequence.see(10), Sequence::Fate::in_order);
  EXPECT_EQ(sequence.see(13), Sequence::Fate::in_order);
  EXPECT_EQ(sequence.lost(), 2U);
  EXPECT_EQ(sequence.see(11), Sequence::Fate::overtaken);
  EXPECT_EQ(sequence.see(11), Sequence::Fate::again);
  EXPECT_EQ(sequence.see(9), Sequence::Fate::too_old);
  EXPECT_EQ(sequence.lost(), 1U);
}

TEST(Sequence, LossLongerThanTheWindowIsCountedWhole) {
  Sequence sequence;
  sequence.see(1);
  sequence.see(3);
  sequence.see(20'003);
  EXPECT_EQ(sequence.lost(), 1U + 19'999U);
  EXPECT_EQ(sequence.see(20'002), Sequence::Fate::overtaken);
  EXPECT_EQ(sequence.lost(), 19'999U);
  EXPECT_EQ(sequence.see(3), Sequence::Fate::too_old);
}

TEST(Sequence, AnnouncedNumbersAreMissingUntilSeen) {
  Sequence sequence;
  sequence.announce(5);  // before the first: of what was there before nothing is known
  sequence.see(6);
  sequence.announce(8);
  EXPECT_EQ(sequence.lost(), 2U);
  EXPECT_EQ(sequence.see(7), Sequence::Fate::overtaken);
  sequence.announce(8);
  EXPECT_EQ(sequence.lost(), 1U);
}

TEST(Sequence, NumbersPassedOverAreNotLost) {
  Sequence sequence;
  sequence.see(1);
  sequence.see(4);
  sequence.pass_over(2, 2);
  EXPECT_EQ(sequence.lost(), 1U);
  sequence.pass_over(5, 9'999);
  EXPECT_EQ(sequence.see(10'000), Sequence::Fate::in_order);
  EXPECT_EQ(sequence.see(9'000), Sequence::Fate::overtaken) << "it may come";
  EXPECT_EQ(sequence.see(9'000), Sequence::Fate::again);
  EXPECT_EQ(sequence.lost(), 1U);
  sequence.pass_over(10'003, 10'003);
  EXPECT_EQ(sequence.lost(), 3U);
}

TEST(Sequence, RestartKeepsWhatIsLost) {
  Sequence sequence;
  sequence.see(1);
  sequence.see(3);
  sequence.restart();
  EXPECT_EQ(sequence.see(100), Sequence::Fate::in_order);
  EXPECT_EQ(sequence.lost(), 1U);
}

// Of one writer and one reader on one topic, every 10 ms, each of which is taken 1 ms later but for these.
std::vector<Row> rows_of(int messages,
                         const std::function<std::vector<std::pair<int, std::int64_t>>(int)>& takes) {
  Messages judge({.deadline = 15ms, .period = {}, .age = 2ms});
  std::vector<Row> rows;
  judge.keep_rows([&](const Row& row) { rows.push_back(row); });
  judge.name_topic(1, 10, "/scan");
  judge.name_topic(2, 20, "/scan");
  const auto published_ns = [](int number) { return 1'000'000'000 + number * std::int64_t{10'000'000}; };
  for (int number = 0; number < messages; ++number) {
    judge.add(
        {.kind = Observation::Kind::published, .at_ns = published_ns(number), .endpoint = 10, .process = 1});
    for (const auto& [of, after_ns] : takes(number))
      judge.add({.kind = Observation::Kind::taken,
                 .at_ns = published_ns(number) + after_ns,
                 .stamp_ns = published_ns(of) + 1000,
                 .endpoint = 20,
                 .process = 2,
                 .writer = {7}});
  }
  return rows;
}

std::vector<Row> ages_of(const std::vector<Row>& rows) {
  std::vector<Row> ages;
  std::copy_if(rows.begin(), rows.end(), std::back_inserter(ages),
               [](const Row& row) { return row.quantity == Row::Quantity::age; });
  return ages;
}

TEST(Rows, RowsOfEveryMessageAreNumberedWithoutHoles) {
  const auto rows = rows_of(400, [](int number) {
    return std::vector{std::pair{number, std::int64_t{1'000'000}}};
  });
  std::map<std::uint64_t, std::vector<Row>> periods;  // of the publisher, and of the reader
  for (const auto& row : rows)
    if (row.quantity == Row::Quantity::period) periods[row.flow].push_back(row);
  ASSERT_EQ(periods.size(), 2U);
  for (const auto& [flow, of] : periods) {
    ASSERT_EQ(of.size(), 399U);
    for (std::size_t i = 0; i < of.size(); ++i) {
      EXPECT_EQ(of[i].index, i);
      EXPECT_EQ(of[i].to_ns - of[i].from_ns, 10'000'000);
      EXPECT_FALSE(of[i].is_late);
    }
  }
  const auto ages = ages_of(rows);
  ASSERT_GT(ages.size(), 200U);
  for (std::size_t i = 0; i < ages.size(); ++i) {
    EXPECT_EQ(ages[i].index, i);
    EXPECT_EQ(ages[i].to_ns - ages[i].from_ns, 999'000);
  }
}

TEST(Rows, LossKeepsItsPlaceUntilItsMessageArrives) {
  const auto rows = ages_of(rows_of(400, [](int number) -> std::vector<std::pair<int, std::int64_t>> {
    if (number == 300 || number == 350) return {};
    if (number == 352) return {{352, 1'000'000}, {350, 3'000'000}};  // 350 was overtaken
    return {{number, 1'000'000}};
  }));
  std::map<std::uint64_t, Row> last;  // what a results file keeps
  for (const auto& row : rows) last[row.index] = row;
  std::vector<std::int64_t> lost, late;
  for (const auto& [index, row] : last) {
    const auto number = (row.from_ns - 1'000'000'000) / 10'000'000;
    EXPECT_EQ(number - static_cast<std::int64_t>(index), (rows.front().from_ns - 1'000'000'000) / 10'000'000);
    if (row.to_ns == 0) lost.push_back(number);
    if (row.is_late) late.push_back(number);
  }
  EXPECT_THAT(lost, ::testing::ElementsAre(300));
  EXPECT_THAT(late, ::testing::ElementsAre(350));
}

TEST(Rows, LossesBeyondTheWindowHaveNoRows) {
  Rows rows;
  std::vector<Row> kept;
  const KeepRow keep = [&](const Row& row) { kept.push_back(row); };
  const auto lost_at = [](std::uint64_t) { return std::int64_t{5}; };
  rows.age(keep, {.flow = 1, .from_ns = 1, .to_ns = 2}, 7, lost_at);
  rows.age(keep, {.flow = 1, .from_ns = 3, .to_ns = 4}, 7'000'007, lost_at);
  ASSERT_EQ(kept.size(), Sequence::window + 2);
  EXPECT_EQ(kept[1].to_ns, 0);
  EXPECT_EQ(kept.back().index, 7'000'000U);
  EXPECT_EQ(kept.back().to_ns, 4);
}

TEST(Silence, SilenceOfADeadWriterExceedsItsLimit) {
  std::vector<Flow> flows(2);
  flows[0].last_ns = 1'000'000'000;
  flows[1].last_ns = 5'990'000'000;
  judge_silence(flows, Limits{.deadline = 15ms, .period = {}, .age = {}}, 6'000'000'000);
  EXPECT_EQ(flows[0].silent_ns, 5'000'000'000);
  EXPECT_EQ(flows[1].silent_ns, 0);
  flows[0].silent_ns = 0;
  judge_silence(flows, Limits{}, 6'000'000'000);
  EXPECT_EQ(flows[0].silent_ns, 0) << "no limit was stated";
  EXPECT_EQ(flows[0].idle_ns, 5'000'000'000);
  judge_silence(flows, Limits{.deadline = 15ms, .period = {}, .age = {}}, 6'000'000'000, 5'900'000'000);
  EXPECT_EQ(flows[0].silent_ns, 100'000'000) << "before that, nothing listened";
  EXPECT_EQ(flows[0].idle_ns, 100'000'000);
}

// A node that starts again is another process.
TEST(Silence, SilenceEndsWhereAFlowOfTheSameNamesBegins) {
  std::vector<Flow> flows(3);
  for (auto& flow : flows) {
    flow.topic = "/cmd_vel";
    flow.writer = {1, "controller"};
    flow.reader = {2, "base"};
    flow.has_ended = true;
  }
  const auto judged = [&](std::int64_t first_ns) {
    flows[0].first_ns = 0;
    flows[0].last_ns = 1'000'000'000;
    flows[1].writer.process = 7;
    flows[1].first_ns = first_ns;
    flows[1].last_ns = 60'000'000'000;
    flows[2].topic = "/scan";
    flows[2].first_ns = 1'001'000'000;
    flows[2].last_ns = 60'000'000'000;
    auto all = flows;
    judge_silence(all, Limits{.deadline = 15ms, .period = {}, .age = {}}, 60'000'000'000);
    return all[0];
  };
  EXPECT_EQ(judged(3'000'000'000).silent_ns, 2'000'000'000);
  EXPECT_TRUE(judged(3'000'000'000).was_replaced);
  EXPECT_EQ(judged(1'010'000'000).silent_ns, 0) << "in time";
  EXPECT_EQ(judged(500'000'000).silent_ns, 59'000'000'000) << "it was there before";
  flows[0].has_ended = false;
  EXPECT_EQ(judged(3'000'000'000).silent_ns, 59'000'000'000) << "it hangs, and another has its name";
  flows[0].writer.process = 7;
  EXPECT_EQ(judged(3'000'000'000).silent_ns, 2'000'000'000)
      << "its process ended a publisher and began another";
  for (auto& flow : flows) flow.writer = {};
  const auto unknown = [&] {
    auto all = flows;
    judge_silence(all, Limits{.deadline = 15ms, .period = {}, .age = {}}, 60'000'000'000);
    return all[0].silent_ns;
  };
  EXPECT_EQ(unknown(), 2'000'000'000) << "of a remote writer the reader alone is known";
}

TEST(Period, OneAndAHalfPeriodsAreNoGap) {
  const Limits limits{.deadline = {}, .period = 10ms, .age = {}};
  EXPECT_FALSE(limits.is_gap(15'000'000));
  EXPECT_TRUE(limits.is_gap(15'000'001));
}

TEST(Mapping, CodeOfAMiddlewareIsFound) {
  const auto found = mapping_of(
      "7f0010002000-7f0010082000 r-xp 00002000 fd:01 1234                       "
      "/opt/ros/humble/lib/librmw_cyclonedds_cpp.so",
      42);
  ASSERT_TRUE(found);
  EXPECT_EQ(found->middleware, Middleware::rmw);
  EXPECT_EQ(found->name, "librmw_cyclonedds_cpp.so");
  EXPECT_EQ(found->path, "/proc/42/map_files/7f0010002000-7f0010082000");
  EXPECT_EQ(found->file.second, 1234U);
}

// Another user's process decides what it maps, and when.
TEST(Mapping, FileStaysTheOneThatWasFound) {
  if (access("/proc/self/map_files", X_OK) != 0 || getuid() != 0)
    GTEST_SKIP() << "only root may open what others map";
  const std::string path = testing::TempDir() + "/libddsc.so", other = testing::TempDir() + "/other";
  std::ofstream(path) << "the first";
  std::ofstream(other) << "another";
  const auto map = [](const std::string& name, void* at) {
    const int fd = open(name.c_str(), O_RDONLY | O_CLOEXEC);
    auto* const mapped =
        mmap(at, 4096, PROT_READ | PROT_EXEC, MAP_PRIVATE | (at != nullptr ? MAP_FIXED : 0), fd, 0);
    close(fd);
    return mapped;
  };
  auto* const mapped = map(path, nullptr);
  ASSERT_NE(mapped, MAP_FAILED);
  const auto change = Processes().look();
  const auto self = std::ranges::find(change.came, static_cast<std::uint32_t>(getpid()), &Process::id);
  ASSERT_NE(self, change.came.end());
  const auto library = std::ranges::find(self->libraries, "libddsc.so", &Mapping::name);
  ASSERT_NE(library, self->libraries.end());
  EXPECT_EQ(map(other, mapped), mapped);
  std::string text;
  std::getline(std::ifstream(library->path), text);
  EXPECT_EQ(text, "the first");
  munmap(mapped, 4096);
}

TEST(Mapping, RemovedFileIsFoundToo) {
  const auto found = mapping_of("7f00-7f10 r-xp 00002000 08:01 9 /usr/lib/libddsc.so.0.10.2 (deleted)", 1);
  ASSERT_TRUE(found);
  EXPECT_EQ(found->middleware, Middleware::cyclonedds);
  EXPECT_EQ(found->name, "libddsc.so.0.10.2");
}

TEST(Mapping, OtherLinesAreNoMapping) {
  EXPECT_FALSE(mapping_of("7f00-7f10 r--p 00002000 08:01 9 /usr/lib/libddsc.so.0.10.2", 1));  // no code
  EXPECT_FALSE(mapping_of("7f00-7f10 r-xp 00002000 08:01 9 /usr/lib/librmw_implementation.so", 1));
  EXPECT_FALSE(mapping_of("7f00-7f10 r-xp 00000000 00:00 0", 1));
  EXPECT_FALSE(mapping_of("7f00-7f10 r-xp 00000000 00:00 0 [vdso]", 1));
  EXPECT_FALSE(mapping_of("", 1));
}

TEST(RosName, OnlyTheTopicPrefixIsRemoved) {
  EXPECT_EQ(ros_name("rt/cmd_vel"), "/cmd_vel");
  EXPECT_EQ(ros_name("cmd_vel"), "cmd_vel");
  EXPECT_EQ(ros_name("rq/service"), "rq/service");
}

TEST(LibraryFile, FileOfAnotherKindIsRefused) {
  EXPECT_THROW(Library("/proc/self/maps", {}), Error);
  EXPECT_THROW(Library("/nonexistent", {}), Error);
}

// Such as one of a process that has ended: its architecture is unknown then.
TEST(LibraryFile, UnreadableFileIsRefusedWithTheReason) {
  try {
    Library("/nonexistent", {});
    FAIL();
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), ::testing::HasSubstr("No such file"));
  }
}

TEST(LibraryFile, MissingFunctionHasNoPlace) {
  EXPECT_FALSE(Library("/proc/self/exe", {"rmw_publish"}).exit("rmw_publish"));
}

}  // namespace
}  // namespace ontime::listen
