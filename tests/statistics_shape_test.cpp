// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <numeric>
#include <random>

#include "statistics_samples.hpp"

namespace ontime::statistics {
namespace {

TEST(Shape, HidesNoExtreme) {
  std::mt19937_64 random(9);
  std::vector<Sample> samples;
  std::int64_t due_ns = 1000 * ms;
  for (std::uint64_t index = 0; index < 20'000; ++index) {
    const auto skipped = static_cast<std::int64_t>(random() % 500 == 0 ? random() % 400 : 0);
    const auto took_ns =
        static_cast<std::int64_t>(50 * us + (random() % 300 == 0 ? random() % (40 * ms) : 0));
    samples.push_back(random() % 400 == 0 ? lost(index, due_ns, skipped)
                                          : answered(index, due_ns, skipped, took_ns));
    due_ns = samples.back().due_ns + 10 * ms;
  }
  const auto summary = summary_of(samples, asked_next_free);  // it says 100 s, which is less than half of it
  const auto& shape = summary.shape;
  ASSERT_LE(shape.slices.size(), 2000u);
  EXPECT_EQ(shape.slice_ns, 200 * ms);
  Slice all;
  for (const auto& slice : shape.slices) {
    all.sent += slice.sent;
    all.late += slice.late;
    all.lost += slice.lost;
    all.skipped_cycles += slice.skipped_cycles;
    all.max_ns = std::max(all.max_ns, slice.max_ns);
    all.skipped_wait_max_ns = std::max(all.skipped_wait_max_ns, slice.skipped_wait_max_ns);
    EXPECT_LE(slice.min_ns, slice.p50_ns);
    EXPECT_LE(slice.p50_ns, slice.max_ns);
  }
  EXPECT_EQ(all.sent, summary.sent);
  EXPECT_EQ(all.late, summary.late);
  EXPECT_EQ(all.lost, summary.lost);
  EXPECT_EQ(all.skipped_cycles, summary.skipped_cycles);
  EXPECT_EQ(all.max_ns, summary.round_trip.max);
  EXPECT_EQ(all.skipped_wait_max_ns, summary.response.max);
  const auto count = [](const Histogram& bins) {
    return std::accumulate(bins.begin(), bins.end(), std::uint64_t{0},
                           [](auto sum, const Bin& bin) { return sum + bin.count; });
  };
  EXPECT_EQ(count(shape.round_trip), summary.round_trip.count);
  EXPECT_EQ(count(shape.response), summary.response.count);
}

// A robot's own messages are listened to without a stated duration: 3 h, two messages a second.
TEST(Shape, LongRunWithoutADurationReachesToItsEnd) {
  auto asked = asked_next_free;
  asked.erase("duration_s");
  constexpr std::int64_t hours_s = 3 * 3600;
  std::vector<Sample> samples;
  for (std::int64_t i = 0; i < 2 * hours_s; ++i)
    samples.push_back(answered(static_cast<std::uint64_t>(i), 1000 * ms + i * 500 * ms, 0, (i % 9 + 1) * us));
  const auto worst = static_cast<std::size_t>(2 * 2 * 3600);  // after two hours
  samples[worst] = answered(worst, samples[worst].due_ns, 0, 70 * ms);
  samples[worst + 1] = lost(worst + 1, samples[worst + 1].due_ns, 0);
  const auto shape = summary_of(samples, asked).shape;
  EXPECT_LE(shape.slices.size(), 2000u);
  EXPECT_EQ(static_cast<std::int64_t>(shape.slices.size()) * shape.slice_ns, hours_s * 1000 * ms);
  const auto place = static_cast<std::size_t>(2 * 3600 * 1000 * ms / shape.slice_ns);
  for (std::size_t i = 0; i < shape.slices.size(); ++i) {
    const auto& slice = shape.slices[i];
    EXPECT_EQ(slice.sent, 2u * static_cast<std::uint64_t>(shape.slice_ns / (1000 * ms)));
    EXPECT_EQ(slice.lost, i == place ? 1u : 0u);
    EXPECT_EQ(slice.max_ns == 70 * ms, i == place) << i;
    EXPECT_LE(slice.min_ns, slice.p50_ns);
    EXPECT_LE(slice.p50_ns, 9 * us) << "as most of its messages, not as the worst";
  }
}

TEST(Shape, ShortRunWithoutADurationHasASliceForEachMessage) {
  auto asked = asked_next_free;
  asked.erase("duration_s");
  std::vector<Sample> samples;  // 6 s, as many as a plot shows
  for (std::int64_t i = 0; i < 200; ++i)
    samples.push_back(answered(static_cast<std::uint64_t>(i), 1000 * ms + i * 30 * ms, 0, us));
  const auto shape = summary_of(samples, asked).shape;
  ASSERT_LE(shape.slices.size(), 2000u);
  EXPECT_TRUE(std::ranges::all_of(shape.slices, [](const Slice& slice) { return slice.sent <= 1; }));
}

TEST(Shape, StallOfHoursIsInEachOfItsSlices) {
  auto asked = asked_next_free;
  asked["duration_s"] = 1.0;
  const auto summary = summary_of(
      {answered(0, 1000 * ms, 0, us), answered(1, 1010 * ms, 0, us), answered(2, 1020 * ms, 360'000, us)},
      asked);
  const auto& slices = summary.shape.slices;
  ASSERT_LE(slices.size(), 2000u);
  std::uint64_t skipped = 0;
  for (const auto& slice : slices) {
    skipped += slice.skipped_cycles;
    EXPECT_GT(slice.skipped_cycles, 0u);
  }
  EXPECT_EQ(skipped, 360'000u);
  EXPECT_EQ(slices.front().sent, 2u);
  EXPECT_GT(slices.front().p50_ns, 0);
  EXPECT_EQ(slices.back().sent, 1u);
}

// 400 messages in one bin of the histogram.
TEST(SlowerThan, CountsMessagesAndNotBins) {
  std::vector<Sample> samples;
  for (std::int64_t i = 0; i < 400; ++i)
    samples.push_back(answered(static_cast<std::uint64_t>(i), i * 10'000'000, 0, 330'000 + 10 * i));
  const auto summary = summary_of(samples, {});
  const auto events = [&](double limit_ns) {
    const auto slower = slower_than(summary, Times::round_trip, limit_ns);
    return std::pair(slower.at_least.events, slower.at_most.events);
  };
  EXPECT_EQ(events(333'359), std::pair(64UL, 64UL));
  EXPECT_EQ(events(333'360), std::pair(63UL, 63UL));
  EXPECT_EQ(events(333'990), std::pair(0UL, 0UL));
  EXPECT_EQ(events(329'999), std::pair(400UL, 400UL));
  for (std::uint64_t slower = 0; slower < 400; ++slower) {
    const auto [least, most] = events(333'990 - 10 * static_cast<double>(slower));
    EXPECT_LE(least, slower);
    EXPECT_GE(most, slower);
    EXPECT_LE(static_cast<double>(most - least), static_cast<double>(slower) * 0.022 + 1) << slower;
  }
}

// Whether it was slower than a limit above its time-out of 500 ms is unknown.
TEST(SlowerThan, MessageWithoutAnAnswerWaitedForItsTimeout) {
  std::vector<Sample> samples;
  for (std::int64_t i = 0; i < 100; ++i)
    samples.push_back(answered(static_cast<std::uint64_t>(i), i * 10'000'000, 0, 330'000));
  for (auto& sample : std::span(samples).last(3)) {
    sample.fate = Fate::lost;
    sample.received_ns = 0;
  }
  const auto summary = summary_of(samples, {{"timeout_us", 500'000}});
  const auto at_the_timeout = slower_than(summary, Times::round_trip, 500e6);
  EXPECT_EQ(at_the_timeout.at_least.events, 3U);
  EXPECT_EQ(at_the_timeout.at_least.messages, 100U);
  EXPECT_EQ(at_the_timeout.unanswered, 3U);
  const auto above = slower_than(summary, Times::round_trip, 501e6);
  EXPECT_EQ(above.at_least.events, 0U);
  EXPECT_EQ(above.at_most.events, 3U);
  EXPECT_EQ(slower_than(summary, Times::response, 500e6).at_least.events, 3U);
}

TEST(Shape, ShowsAStallWhereItWas) {
  const auto summary = summary_of(
      {answered(0, 1000 * ms, 0, us), answered(1, 1010 * ms, 300, us), answered(2, 4020 * ms, 0, us)},
      asked_next_free);
  const auto& slices = summary.shape.slices;  // of 100 ms
  ASSERT_EQ(slices.size(), 31u);
  EXPECT_EQ(slices[0].sent, 1u);
  EXPECT_EQ(slices[0].skipped_cycles, 9u);
  EXPECT_EQ(slices[15].sent, 0u);
  EXPECT_EQ(slices[15].skipped_cycles, 10u);
  EXPECT_EQ(slices[15].skipped_wait_max_ns, 1510 * ms + 52 * us)
      << "from 1.5 s after the start to the answer";
  EXPECT_EQ(slices[30].sent, 2u);
}

TEST(Shape, WaitOfSkippedCyclesIsNotThatOfALateMessageBesideThem) {
  const auto summary =
      summary_of({answered(0, 1000 * ms, 0, 70 * ms), answered(1, 1010 * ms, 2, us)}, asked_next_free);
  const auto& slice = summary.shape.slices.at(0);  // of 100 ms
  EXPECT_EQ(slice.skipped_cycles, 2u);
  EXPECT_EQ(summary.response.max, 70 * ms + 51 * us);
  EXPECT_EQ(slice.skipped_wait_max_ns, 20 * ms + 52 * us);
}

TEST(Shape, KeepsTheWorstWithTheirBackground) {
  std::vector<Sample> samples;
  for (std::uint64_t index = 0; index < 100; ++index)
    samples.push_back(answered(index, static_cast<std::int64_t>(index) * 10 * ms, 0,
                               static_cast<std::int64_t>(index % 37 + 1) * 10 * us));
  const auto worst = summary_of(samples, asked_next_free).shape.worst;
  ASSERT_EQ(worst.size(), 10u);
  EXPECT_EQ(worst[0].took_ns, 370 * us + 51 * us);
  for (std::size_t i = 0; i < worst.size(); ++i) {
    const auto index = worst[i].message.index;
    if (i > 0) {
      EXPECT_LE(worst[i].took_ns, worst[i - 1].took_ns);
    }
    if (index > 0) {
      EXPECT_EQ(worst[i].before.value().index, index - 1);
    }
    if (index < 99) {
      EXPECT_EQ(worst[i].after.value().index, index + 1);
    }
  }
}

TEST(Shape, BlamesAWaitOnWhoCausedIt) {
  // The first answer comes after 35 ms; the next three cycles waited for it, not for the message after it.
  const auto late =
      summary_of({answered(0, 0, 0, 35 * ms), answered(1, 10 * ms, 3, 100 * us)}, asked_next_free);
  EXPECT_EQ(late.shape.worst.at(0).message.index, 0u);
  EXPECT_LT(late.shape.worst.at(1).took_ns, 10 * ms);
  // A sender that slept through as many cycles has only itself to blame.
  const auto slept =
      summary_of({answered(0, 0, 0, 100 * us), answered(1, 10 * ms, 3, 100 * us)}, asked_next_free);
  EXPECT_EQ(slept.shape.worst.at(0).message.index, 1u);
  EXPECT_EQ(slept.shape.worst.at(0).took_ns, 30 * ms + 151 * us);
}

TEST(Shape, FewMessagesDueLongAfterAllOthersAreInNoSlice) {
  std::vector<Sample> samples;
  const auto add = [&](std::int64_t due_ns) { samples.push_back(answered(samples.size(), due_ns, 0, us)); };
  for (std::int64_t i = 0; i < 1000; ++i) {
    add(i * 10 * ms);
    if (i == 500) add(1'000'000'000'000 * ms);  // a wrong time, while the others go on
  }
  constexpr std::int64_t end_ns = 1000 * 10 * ms, hour_ns = 3600 * 1000 * ms;
  add(hour_ns);
  for (const auto stated : {true, false}) {
    auto asked = asked_next_free;
    asked["duration_s"] = 10.0;
    if (!stated) asked.erase("duration_s");
    const auto shape = summary_of(samples, asked).shape;
    const auto reached_ns = static_cast<std::int64_t>(shape.slices.size()) * shape.slice_ns;
    EXPECT_LE(reached_ns, end_ns) << stated;
    EXPECT_GT(reached_ns, end_ns - 10 * ms) << stated;
    for (const auto& slice : shape.slices) EXPECT_LE(slice.sent, 1u);
    ASSERT_EQ(shape.beyond.size(), 2u);
    EXPECT_EQ(shape.beyond[1].due_ns, hour_ns);
  }
  // Where messages go on after a long time, they are no exception.
  for (std::int64_t i = 1; i < 50; ++i) add(hour_ns + i * 10 * ms);
  const auto shape = summary_of(samples, asked_next_free).shape;
  EXPECT_EQ(shape.beyond.size(), 1u);
  EXPECT_GT(static_cast<std::int64_t>(shape.slices.size()) * shape.slice_ns, hour_ns);
  // Nor where there are hardly any others.
  const auto two = summary_of({answered(0, 0, 0, us), answered(1, hour_ns, 0, us)}, asked_next_free);
  EXPECT_TRUE(two.shape.beyond.empty());
  EXPECT_EQ(two.shape.slices.back().sent, 1u);
}

}  // namespace
}  // namespace ontime::statistics
