// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <limits>
#include <random>

#include <gmock/gmock.h>

#include "statistics_samples.hpp"

namespace ontime::statistics {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

Sample random_sample(std::uint64_t index, std::mt19937_64& random) {
  const auto some_ns = [&](std::uint64_t below) { return static_cast<std::int64_t>(random() % below); };
  Sample sample{};
  sample.index = index;
  sample.fate = static_cast<Fate>(random() % 3);
  sample.skipped_cycles = static_cast<std::uint32_t>(random() % 4 == 0 ? random() % 10 : 0);
  sample.intended_ns = 1'000'000'000 + static_cast<std::int64_t>(index) * 10'000'000;
  sample.due_ns = sample.intended_ns + std::int64_t{sample.skipped_cycles} * 10'000'000;
  sample.woke_ns = sample.due_ns + some_ns(500'000);
  sample.sent_ns = sample.woke_ns + some_ns(50'000);
  if (sample.fate == Fate::lost) return sample;
  sample.received_ns = sample.sent_ns + 1 + some_ns(30'000'000);
  if (random() % 2 != 0) return sample;
  sample.server_received_ns = 5'000'000'000 + some_ns(1'000'000'000);
  const auto longest_ns = std::min<std::int64_t>(sample.received_ns - sample.sent_ns, 100'000);
  sample.server_sent_ns = sample.server_received_ns + some_ns(static_cast<std::uint64_t>(longest_ns));
  return sample;
}

// The definition, word by word: how long each cycle waited.
std::vector<std::int64_t> responses_by_definition(const std::vector<Sample>& samples) {
  std::vector<std::int64_t> responses, waiting;
  for (const auto& sample : samples) {
    for (auto due_ns = sample.intended_ns; due_ns < sample.due_ns; due_ns += 10 * ms)
      waiting.push_back(due_ns);
    if (sample.fate == Fate::lost) continue;
    waiting.push_back(sample.due_ns);
    for (const auto due_ns : waiting) responses.push_back(sample.received_ns - due_ns);
    waiting.clear();
  }
  // No answer came any more: they waited at least until the last message was given up.
  for (const auto due_ns : waiting) responses.push_back(samples.back().sent_ns + 500 * ms - due_ns);
  return responses;
}

TEST(Summary, KnowsSinceWhenNothingWasAnswered) {
  std::mt19937_64 random(5);
  std::vector<Sample> samples;
  for (std::uint64_t i = 0; i < 20; ++i) {
    samples.push_back(random_sample(i, random));
    samples.back().fate = i == 3 || i >= 15 ? Fate::lost : Fate::on_time;
    samples.back().received_ns = samples.back().fate == Fate::lost ? 0 : samples.back().sent_ns + 1;
  }
  const auto summary = summary_of(samples, asked_next_free);
  EXPECT_EQ(summary.unanswered_at_end, 5u);
  EXPECT_EQ(summary.unanswered_from_ns, samples[15].due_ns);
}

// An older file lacks the count by which a search ends.
TEST(Summary, CountsWhatIsLateByResponseTimeAlone) {
  std::vector<Sample> samples;
  for (std::uint64_t i = 0; i < 4; ++i)
    samples.push_back(answered(i, 1'000 * ms + static_cast<std::int64_t>(i) * 30 * ms, 0, 9 * ms));
  samples[1].sent_ns += 5 * ms;  // its round trip is in time
  samples[1].received_ns += 5 * ms;
  samples[2] = answered(2, samples[2].due_ns, 0, 12 * ms);
  EXPECT_EQ(summary_of(samples, asked_next_free, {{"sent", 4}}).run.outcome.late_by_response_only, 1U);
  const nlohmann::json worst_only{{"sent", 4}, {"late_by_response_only", 3}};
  EXPECT_EQ(summary_of(samples, asked_next_free, worst_only).run.outcome.late_by_response_only, 3U);
  EXPECT_EQ(summary_of(samples, {{"schedule", "fixed"}}, {{"sent", 4}}).run.outcome.late_by_response_only, 0U)
      << "without a deadline";
}

TEST(Summary, TellsWhenTheLevelChangedAlsoWhereTheRateDid) {
  std::mt19937_64 random(6);
  std::vector<Sample> samples;
  std::int64_t now = 1'000'000'000;
  for (std::uint64_t i = 0; i < 12'000; ++i) {  // back-to-back: 1 ms for 10 s, then 5 ms for 10 s
    Sample sample{};
    sample.index = i;
    sample.fate = Fate::on_time;
    sample.intended_ns = sample.due_ns = sample.woke_ns = sample.sent_ns = now;
    now += i < 10'000 ? ms : 5 * ms;
    sample.received_ns = now - static_cast<std::int64_t>(random() % 20'000);
    samples.push_back(sample);
  }
  const auto summary = summary_of(samples, {{"schedule", "back-to-back"}, {"duration_s", 20.0}});
  const auto& shift = summary.round_trip_certainty.shift;
  ASSERT_TRUE(shift);
  EXPECT_NEAR(*shift->from_ns, 10e9, 0.1e9);
}

TEST(Summary, PercentileHasItsEndFromExactlyThirtySlowerMessagesOn) {
  std::mt19937_64 random(7);
  for (const std::uint64_t messages : {299u, 300u}) {
    std::vector<Sample> samples;
    for (std::uint64_t i = 0; i < messages; ++i) {
      Sample sample{};
      sample.index = i;
      sample.fate = Fate::on_time;
      sample.intended_ns = sample.due_ns = sample.woke_ns = sample.sent_ns =
          1'000'000'000 + static_cast<std::int64_t>(i) * 10 * ms;
      sample.received_ns = sample.sent_ns + 100'000 + static_cast<std::int64_t>(random() % 100'000);
      samples.push_back(sample);
    }
    const auto p90 = summary_of(samples, asked_next_free).round_trip_certainty[Figure::p90];
    EXPECT_EQ(p90.sure.high.has_value(), messages == 300) << messages << p90.open;
  }
}

TEST(Summary, AddsUp) {
  std::mt19937_64 random(3);
  for (int i = 0; i < 50; ++i) {
    std::vector<Sample> samples;
    std::uint64_t skipped = 0, said = 0;
    for (std::size_t n = random() % 500; n > 0; --n) {
      samples.push_back(random_sample(samples.size(), random));
      skipped += samples.back().skipped_cycles;
      if (samples.back().server_sent_ns != 0) ++said;
    }
    const auto of = [&](Fate fate) {
      return static_cast<std::uint64_t>(
          std::count_if(samples.begin(), samples.end(), [&](const Sample& s) { return s.fate == fate; }));
    };
    const auto summary = summary_of(samples, asked_next_free);
    ASSERT_EQ(summary.sent, samples.size());
    ASSERT_EQ(summary.on_time, of(Fate::on_time));
    ASSERT_EQ(summary.late, of(Fate::late));
    ASSERT_EQ(summary.lost, of(Fate::lost));
    ASSERT_EQ(summary.sent, summary.on_time + summary.late + summary.lost);
    ASSERT_EQ(summary.skipped_cycles, skipped);
    ASSERT_EQ(summary.round_trip.count, summary.on_time + summary.late);
    ASSERT_EQ(summary.wake_up.count, summary.sent);
    ASSERT_EQ(summary.server.count, said);
    ASSERT_EQ(summary.response.count, summary.on_time + summary.late + summary.skipped_cycles);
    const auto responses = responses_by_definition(samples);
    const auto expected = distribution(responses);
    ASSERT_EQ(summary.response.min, expected.min);
    ASSERT_EQ(summary.response[Figure::p50], expected[Figure::p50]);
    ASSERT_EQ(summary.response[Figure::p99], expected[Figure::p99]);
    ASSERT_EQ(summary.response.max, expected.max);
    ASSERT_NEAR(summary.response.mean, expected.mean, 1e-9 * expected.mean);
    ASSERT_EQ(summary.late_by_response,
              summary.lost +
                  static_cast<std::uint64_t>(std::count_if(
                      responses.begin(), responses.end(), [](auto response) { return response > 10 * ms; })));
    ASSERT_EQ(summary.late_by_response_probability.messages, summary.sent + summary.skipped_cycles);
  }
}

TEST(Summary, IsNotSureOfWhatWasNotRecorded) {
  std::mt19937_64 random(7);
  std::vector<Sample> samples;
  for (std::uint64_t i = 0; i < 5000; ++i) samples.push_back(random_sample(i, random));
  for (auto& sample : samples) {
    if (sample.fate == Fate::lost) sample.received_ns = sample.sent_ns + 1 * ms;
    sample.fate = Fate::on_time;
  }
  const auto whole = summary_of(samples, asked_next_free, {{"dropped_records", 0}});
  EXPECT_TRUE(whole.round_trip_certainty[Figure::p50].sure.high);
  EXPECT_EQ(whole.missed_probability.messages, 5000U);
  const auto missing = summary_of(samples, asked_next_free, {{"dropped_records", 1500}});
  EXPECT_EQ(missing.sent, 5000U);
  EXPECT_EQ(missing.round_trip_certainty[Figure::p50].value, whole.round_trip_certainty[Figure::p50].value);
  EXPECT_FALSE(missing.round_trip_certainty[Figure::p50].sure.high);
  EXPECT_EQ(missing.missed_probability.messages, 0U);
  EXPECT_FALSE(missing.extremes.maxima || missing.extremes.peaks);
  EXPECT_EQ(missing.extremes.refused, "1500 samples were not recorded");
  EXPECT_EQ(summary_of(samples, asked_next_free, {{"dropped_records", 1}}).extremes.refused,
            "1 sample was not recorded");
}

TEST(Summary, ListenedRunHasNoProbabilityForUnknownFates) {
  std::vector<Sample> samples(50);
  for (std::size_t i = 0; i < samples.size(); ++i) {
    samples[i].index = i;
    samples[i].received_ns = 2;
  }
  const auto listened = [&](double deadline_us, bool loss_unknown) {
    return summary_of(samples, {{"measures", "age"}, {"deadline_us", deadline_us}},
                      {{"loss_unknown", loss_unknown}, {"sent", 50}});
  };
  const auto limit_alone = listened(5, true), loss_alone = listened(0, false), neither = listened(0, true);
  EXPECT_EQ(limit_alone.late_probability.messages, 50U);
  EXPECT_EQ(limit_alone.lost_probability.messages, 0U);
  EXPECT_EQ(limit_alone.missed_probability.messages, 50U);
  EXPECT_EQ(loss_alone.late_probability.messages, 0U);
  EXPECT_EQ(loss_alone.lost_probability.messages, 50U);
  EXPECT_EQ(neither.missed_probability.messages, 0U);
  EXPECT_FALSE(statistics::measured(neither, Times::round_trip, Figure::lost));
  // No period tells what was lost, and a run that was cut off has no outcome that says so.
  const auto cut_off = summary_of(samples, {{"measures", "period"}, {"deadline_us", 5}});
  EXPECT_EQ(cut_off.late_probability.messages, 50U);
  EXPECT_EQ(cut_off.lost_probability.messages, 0U);
}

TEST(Summary, SamplesThatWereRemovedLaterAreNotRecorded) {
  std::vector<Sample> samples(50);
  for (std::size_t i = 0; i < samples.size(); ++i) {
    samples[i].index = i;
    samples[i].received_ns = 2;
  }
  const auto summary = summary_of(samples, asked_next_free, {{"sent", 60}, {"dropped_records", 3}});
  EXPECT_EQ(unrecorded(summary.run), 10U);
  EXPECT_EQ(summary.missed_probability.messages, 0U);
  EXPECT_EQ(unrecorded(summary_of(samples, asked_next_free, {{"sent", 50}}).run), 0U);
}

TEST(Summary, WorstMessagesAloneGiveNoMetric) {
  std::vector<Sample> worst;
  for (std::uint64_t i = 0; i < 20; ++i) {
    Sample sample{};
    sample.index = 1000 * i;
    sample.intended_ns = static_cast<std::int64_t>(i) * 100 * ms;
    sample.due_ns = sample.woke_ns = sample.sent_ns = sample.intended_ns;
    sample.received_ns = sample.sent_ns + 50 * ms;
    sample.fate = Fate::late;
    worst.push_back(sample);
  }
  const nlohmann::json asked{{"measures", "age"}, {"kept", "worst"}, {"deadline_us", 10'000.0}};
  const nlohmann::json outcome{{"sent", 20'007},
                               {"late", 100},
                               {"lost", 7},
                               {"histogram",
                                {{"values", {{2 * ms, 19'900}, {50 * ms, 100}}},
                                 {"beyond", 0},
                                 {"beyond_from_ns", 0},
                                 {"max_ns", 50 * ms},
                                 {"mean_ns", 2.24e6}}}};
  const auto all = summary_of(worst, asked, outcome);
  EXPECT_EQ(all.sent, 20'007u);
  EXPECT_EQ(all.late, 100u);
  EXPECT_EQ(all.lost, 7u);
  EXPECT_EQ(all.on_time, 19'900u);
  EXPECT_TRUE(all.has_worst_only);
  EXPECT_EQ(all.round_trip[Figure::p50], 2 * ms);
  EXPECT_EQ(all.round_trip[Figure::p99], 2 * ms);
  EXPECT_EQ(all.round_trip.max, 50 * ms);
  EXPECT_EQ(all.round_trip.mean, 2.24e6);
  EXPECT_EQ(unrecorded(all.run), 19'987u);
  const auto p99 = measured(all, Times::round_trip, Figure::p99);
  ASSERT_TRUE(p99);
  EXPECT_EQ(p99->value, 2e6);
  EXPECT_FALSE(p99->sure.low || p99->sure.high) << "how they depend on one another is not known";
  EXPECT_EQ(all.shape.worst.front().took_ns, 50 * ms);

  const auto cut_off = summary_of(worst, asked);
  EXPECT_EQ(cut_off.round_trip.count, 0u) << "nothing tells of the others";
  EXPECT_EQ(cut_off.late, 20u);
  auto damaged = outcome;
  damaged["histogram"]["values"][0][1] = -1;
  EXPECT_THROW(summary_of(worst, asked, damaged), record::WrongFile);
}

TEST(Summary, CountsWhatIsLateOrLostInARow) {
  std::vector<Sample> samples;
  for (const auto took_ns : {1 * ms, 12 * ms, 1 * ms, 12 * ms, 13 * ms, 0 * ms, 1 * ms, 11 * ms, 11 * ms}) {
    const auto due_ns = static_cast<std::int64_t>(1000 + 20 * samples.size()) * ms;
    samples.push_back(answered(samples.size(), due_ns, 0, took_ns));
    if (took_ns > 0) continue;
    samples.back().received_ns = 0;
    samples.back().fate = Fate::lost;
  }
  const auto summary = summary_of(samples, asked_next_free);
  EXPECT_EQ(summary.late_probability.events, 5u);
  EXPECT_EQ(summary.lost_probability.events, 1u);
  EXPECT_EQ(summary.missed_probability.events, 6u);
  EXPECT_EQ(summary.bursts.count, 2u);
  EXPECT_EQ(summary.bursts.longest, 3u);
  EXPECT_EQ(summary.bursts.longest_ns, 2 * 20 * ms) << "the time-out of the lost one is no part of it";
  EXPECT_EQ(summary.message_every_ns, 20 * ms);
  EXPECT_THAT(summary.extremes.refused, AllOf(HasSubstr("needed 1000"), HasSubstr("found 8")));
}

TEST(Summary, LongestBurstIsOneBurst) {
  std::vector<Sample> samples;
  const auto add = [&](int count, std::int64_t every_ns, std::int64_t took_ns) {
    for (int i = 0; i < count; ++i) {
      const auto due_ns = (samples.empty() ? 1000 * ms : samples.back().due_ns) + every_ns;
      samples.push_back(answered(samples.size(), due_ns, 0, took_ns));
    }
  };
  for (const auto& [count, every_ns] : {std::pair{4, 20 * ms}, {2, 1000 * ms}}) {
    add(1, 20 * ms, ms);
    add(count, every_ns, 12 * ms);
  }
  add(1, 20 * ms, ms);
  const auto summary = summary_of(samples, asked_next_free);
  EXPECT_EQ(summary.bursts.longest, 4u);
  EXPECT_EQ(summary.bursts.longest_ns, 3 * 20 * ms);
}

TEST(Summary, IsTheSameOfSamplesReadInSeveralBlocks) {
  std::vector<Sample> samples;
  for (std::int64_t i = 0; i < 40'000; ++i)
    samples.push_back(answered(samples.size(), (1000 + 10 * i) * ms, 0, us + i * 7919 % 40'000));
  const auto summary = summary_of(samples, asked_next_free);
  EXPECT_EQ(summary.sent, samples.size());
  EXPECT_EQ(summary.round_trip[Figure::p50], us + 19'999);
}

TEST(Summary, EveryCycleThatPassedCountsAsAResponse) {
  // The sender stands still for 3 s: 300 cycles, in two messages.
  const auto summary = summary_of(
      {answered(0, 1000 * ms, 0, 100 * us), answered(1, 1010 * ms, 300, 100 * us)}, asked_next_free);
  EXPECT_EQ(summary.late, 0u);
  EXPECT_EQ(summary.response.count, 302u);
  EXPECT_EQ(summary.response.max, 3000 * ms + 151 * us);
  EXPECT_EQ(summary.response[Figure::p50], 1490 * ms + 151 * us);
  EXPECT_EQ(summary.late_by_response, 300u);
}

TEST(Summary, CyclesBeforeALostMessageWaitForTheNextAnswer) {
  const auto summary = summary_of(
      {answered(0, 0 * ms, 0, us), lost(1, 10 * ms, 2), answered(2, 40 * ms, 50, us)}, asked_next_free);
  EXPECT_EQ(summary.response.count, 1u + 2 + 50 + 1);
  EXPECT_EQ(summary.response.max, 540 * ms + 52 * us - 10 * ms) << "the first that waited was due at 10 ms";
  EXPECT_EQ(summary.open_wait_ns, 0) << "an answer ended it";
  EXPECT_EQ(summary.lost_wait_ns, 540 * ms + 52 * us - 30 * ms) << "the lost message's own cycle";
}

TEST(Summary, CycleOfALostMessageWaitsForTheNextAnswerAndLongerThanItsTimeOut) {
  // Lost messages are given up 500 ms after they were sent.
  const auto next = summary_of(
      {answered(0, 0 * ms, 0, us), lost(1, 10 * ms, 0), answered(2, 1010 * ms, 0, us)}, asked_next_free);
  EXPECT_EQ(next.lost_wait_ns, 1000 * ms + 52 * us);
  EXPECT_EQ(next.open_wait_ns, 0);
  EXPECT_LT(next.response.max, ms) << "it has no response time";

  const auto meanwhile = summary_of({lost(0, 0 * ms, 0), lost(1, 10 * ms, 0), answered(2, 20 * ms, 0, us)},
                                    {{"schedule", "fixed"}, {"timeout_us", 500000}});
  EXPECT_EQ(meanwhile.lost_wait_ns, 0);
  EXPECT_EQ(meanwhile.open_wait_ns, 500 * ms + 51 * us) << "the next answer was not for it";

  const auto none =
      summary_of({answered(0, 0 * ms, 0, us), lost(1, 10 * ms, 0), lost(2, 510 * ms, 0)}, asked_next_free);
  EXPECT_EQ(none.open_wait_ns, 1000 * ms + 51 * us);
}

TEST(Summary, LongestOpenWaitIsKeptWhereAShorterOneFollows) {
  const auto summary =
      summary_of({lost(0, 0, 0), answered(1, 10 * ms, 0, us), answered(2, 600 * ms, 0, us)},
                 {{"schedule", "fixed"}, {"timeout_us", 500000}},
                 {{"trailing_cycles", 40}, {"trailing_due_ns", 610 * ms}, {"trailing_until_ns", 1015 * ms}});
  EXPECT_EQ(summary.response.max, 405 * ms);
  EXPECT_EQ(summary.open_wait_ns, 500 * ms + 51 * us) << "of the lost message";
}

TEST(Summary, WaitAcrossMissingSamplesIsKnownOnlyUntilThese) {
  const auto meanwhile = summary_of(
      {answered(0, 0 * ms, 0, us), lost(1, 10 * ms, 2), answered(99, 1010 * ms, 0, us)}, asked_next_free);
  EXPECT_EQ(meanwhile.lost_wait_ns, 0) << "a missing message may have been answered before";
  EXPECT_EQ(meanwhile.open_wait_ns, 500 * ms + 51 * us);
  EXPECT_EQ(meanwhile.response.max, 20 * ms + 51 * us) << "skipped cycles waited until the message was sent";

  const auto at_end = summary_of({answered(0, 0 * ms, 0, us), lost(1, 10 * ms, 0)}, asked_next_free,
                                 {{"sent", 100}, {"trailing_until_ns", 5000 * ms}});
  EXPECT_EQ(at_end.open_wait_ns, 500 * ms + 51 * us);
}

TEST(Summary, NoBurstReachesAcrossMissingSamples) {
  const auto summary =
      summary_of({lost(0, 0, 0), lost(1, 10 * ms, 0), lost(9, 90 * ms, 0)}, asked_next_free, {{"sent", 20}});
  EXPECT_EQ(summary.bursts.longest, 2U);
  EXPECT_EQ(summary.bursts.longest_ns, 10 * ms);
  EXPECT_EQ(summary.unanswered_at_end, 0U) << "samples are missing at the end, too";
}

TEST(Summary, CyclesAfterTheLastMessageCountToo) {
  const nlohmann::json outcome = {
      {"trailing_cycles", 40}, {"trailing_due_ns", 20 * ms}, {"trailing_until_ns", 425 * ms}};
  const auto summary =
      summary_of({answered(0, 0, 0, us), answered(1, 10 * ms, 0, us)}, asked_next_free, outcome);
  EXPECT_EQ(summary.skipped_cycles, 40u);
  EXPECT_EQ(summary.response.count, 42u);
  EXPECT_EQ(summary.response.max, 405 * ms);
  EXPECT_EQ(summary.open_wait_ns, 405 * ms);
  EXPECT_EQ(summary.late_by_response, 40u) << "the last was due at 410 ms, 15 ms before";

  const auto nothing_sent = summary_of({}, asked_next_free, outcome);
  EXPECT_EQ(nothing_sent.sent, 0u);
  EXPECT_EQ(nothing_sent.skipped_cycles, 40u);
  EXPECT_EQ(nothing_sent.response.count, 40u);
  EXPECT_EQ(nothing_sent.start_ns, 20 * ms) << "when the first of them was due";
  EXPECT_EQ(nothing_sent.shape.slices.size(), 4u);

  const auto then_lost = summary_of({answered(0, 0, 0, us), lost(1, 10 * ms, 5)}, asked_next_free);
  EXPECT_EQ(then_lost.response.max, 550 * ms + 51 * us) << "until the message was given up";
  EXPECT_EQ(then_lost.open_wait_ns, then_lost.response.max);
}

// The first samples may be missing: dropped, or removed from a file of bounded size.
TEST(Summary, TimesCountFromWhenTheFirstMessageWasDueWithItsSampleOrWithout) {
  record::Writer writer("");
  const auto run = writer.begin_run(asked_next_free);
  writer.append(run, std::vector{answered(9, 5000 * ms, 0, ms), answered(10, 5010 * ms, 0, 20 * ms)});
  writer.flush();
  const auto reader = writer.reader();
  auto of = reader.runs().at(0);
  EXPECT_EQ(of.start_ns, 5000 * ms);
  of.start_ns = 4000 * ms;
  const auto summary = summarise(reader, of);
  EXPECT_EQ(summary.start_ns, 4000 * ms);
  ASSERT_EQ(summary.shape.slices.size(), 11U);
  EXPECT_EQ(summary.shape.slices.at(10).sent, 2U);
}

TEST(Summary, SaysFromWhereToWhere) {
  Sample sample{};
  sample.intended_ns = 100;
  sample.due_ns = 200;
  sample.skipped_cycles = 1;
  sample.woke_ns = 230;
  sample.passed_wake_ns = 70;
  sample.sent_ns = 234;
  sample.received_ns = 1234;
  sample.server_received_ns = 5000;
  sample.server_sent_ns = 5007;
  const auto summary = summary_of({sample}, {{"schedule", "fixed"}});
  EXPECT_EQ(summary.start_ns, 100);
  EXPECT_EQ(summary.round_trip.max, 1000);
  EXPECT_EQ(summary.response.max, 1134);
  EXPECT_EQ(summary.response.min, 1034);
  EXPECT_EQ(summary.wake_up.min, 30);
  EXPECT_EQ(summary.server.max, 7);
  EXPECT_EQ(summary.late_by_response, std::nullopt) << "no deadline was stated";
}

TEST(Summary, BackToBackHasNoWakeUp) {
  std::mt19937_64 random(4);
  const std::vector<Sample> samples = {random_sample(0, random), random_sample(1, random)};
  EXPECT_EQ(summary_of(samples, {{"schedule", "back-to-back"}}).wake_up.count, 0u);
  for (const nlohmann::json& asked :
       {nlohmann::json({{"schedule", 7}}), nlohmann::json({{"period_us", "x"}})})
    EXPECT_EQ(summary_of(samples, asked).wake_up.count, 2u) << asked;
}

// As a damaged file may have them.
TEST(Summary, TakesAnyOutcome) {
  const std::vector<Sample> samples = {answered(0, 0, 0, us), lost(1, 10 * ms, 5)};
  for (const nlohmann::json& number : {nlohmann::json(-1), nlohmann::json(1e300), nlohmann::json("x"),
                                       nlohmann::json(std::numeric_limits<std::int64_t>::max()),
                                       nlohmann::json(std::numeric_limits<std::uint64_t>::max())}) {
    const nlohmann::json outcome = {{"trailing_cycles", number},
                                    {"trailing_due_ns", number},
                                    {"trailing_until_ns", number},
                                    {"hosts", {{"controller", number}}}};
    auto asked = asked_next_free;
    for (const auto* key : {"period_us", "deadline_us", "timeout_us", "duration_s"}) asked[key] = number;
    EXPECT_NO_THROW(summary_of(samples, asked, outcome)) << number;
    EXPECT_NO_THROW(summary_of(samples, asked_next_free, outcome)) << number;
  }
}

}  // namespace
}  // namespace ontime::statistics
