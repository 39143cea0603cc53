// SPDX-License-Identifier: Apache-2.0
// Of two machines, the second of which was kept by its pong.
#include "explain/drift.hpp"
#include "explain_fixture.hpp"

namespace ontime::explain {
namespace {

// A run by hand, and what its pong kept: by a clock that shows 7 s more.
class ByHand : public Explained {
 protected:
  static constexpr std::int64_t ahead = 7'000 * ms;

  ByHand() : ping_(""), kept_("") {
    for (auto& sample : samples_) by_its_own_clock(sample);
    window_.span = {50, due - ms + ahead, due + 21 * ms + ahead};
    event(sent + ahead + 10 * us, 0, Kind::waking, answers, 0, "1");
    switched(sent + ahead + 20 * ms, 1, hog, "R", answers);
    run_ = ping_.begin_run({{"id", "ping"}, {"payload_bytes", 500}});
  }
  static void by_its_own_clock(Sample& sample) {
    sample.server_received_ns += ahead;
    sample.server_sent_ns += ahead;
  }
  void keep() { keep({{"component", window_}}); }
  void keep(const std::vector<record::Trace>& windows) {
    const auto run = kept_.begin_run({{"id", "pong"}});
    for (const auto& window : windows) kept_.trace(run, window);
    kept_.end_run(run, {{"trace", {{"component", json::object()}}},
                        {"hosts", {{"component", {{"threads", threads({{answers, "receive"}})}}}}}});
  }
  Account account_with(Sample sample) {
    samples_.insert(samples_.begin() + 50, sample);
    ping_.append(run_, samples_);
    ping_.end_run(run_, {{"hosts", {{"controller", {{"threads", threads({{asks, "send"}})}}}}}});
    const auto reader = ping_.reader();
    const auto run = reader.runs().at(0);
    const Pong pong(kept_.reader(), reader, run);
    return account_of(reader, run, &pong);
  }
  record::Writer ping_, kept_;
  std::int64_t run_ = 0;
};

TEST_P(ByHand, PongsTraceExplainsItsPart) {
  keep();
  auto sample = late(0, 20 * ms, 0);
  by_its_own_clock(sample);
  const auto account = account_with(sample);
  ASSERT_THAT(account.messages, SizeIs(1));
  const auto part = first(account.messages[0]);
  EXPECT_EQ(part.cause, Cause::cpu);
  EXPECT_EQ(part.culprit, "hog");
  EXPECT_EQ(part.end, "component");
  EXPECT_THAT(account.limits, testing::UnorderedElementsAre(HasSubstr("no trace from the controller"),
                                                            HasSubstr("±46.0 µs")));
}

TEST_P(ByHand, MessagesLostInAnOutageAreLimitedWithPongToo) {
  window_.span.to_ns = due + 400 * ms + ahead;
  keep();
  samples_.resize(50 + 49);
  for (std::size_t i = 51; i < samples_.size(); ++i) {  // 50 goes before them
    samples_[i].received_ns = samples_[i].server_received_ns = samples_[i].server_sent_ns = 0;
    samples_[i].fate = Fate::lost;
  }
  auto sample = late(0, 20 * ms, 0);
  by_its_own_clock(sample);
  const auto account = account_with(sample);
  EXPECT_THAT(account.messages, SizeIs(1 + 16));
  EXPECT_EQ(account.lost, 48U);
  EXPECT_THAT(account.limits, testing::Contains(HasSubstr("the first 16 of 48 lost")));
}

TEST_P(ByHand, TraceOfAnotherPongIsRefused) {
  window_.span.from_ns += 60'000 * ms;
  window_.span.to_ns += 60'000 * ms;
  window_.events.clear();
  keep();
  auto sample = late(0, 20 * ms, 0);
  by_its_own_clock(sample);
  EXPECT_THROW(account_with(sample), record::WrongFile);
}

// One of two days may have been another's.
TEST_P(ByHand, TraceWithOneContradictionIsRefused) {
  auto later = window_;
  later.span.message = 70;
  keep({{"component", window_}, {"component", later}});
  auto sample = late(0, 20 * ms, 0);
  by_its_own_clock(sample);
  EXPECT_THROW(account_with(sample), record::WrongFile);
}

TEST_P(ByHand, AWindowThatIsCutOffContradictsNothing) {
  auto cut_off = window_;
  cut_off.whole = false;
  cut_off.span = {70, due + 195 * ms + ahead, due + 196 * ms + ahead};
  cut_off.events.clear();
  keep({{"component", window_}, {"component", cut_off}});
  auto sample = late(0, 20 * ms, 0);
  by_its_own_clock(sample);
  EXPECT_NO_THROW(account_with(sample));
}

TEST_P(ByHand, CoordinatorsTraceIsNotTakenForPongs) {
  keep({{"controller", window_}});
  auto sample = late(0, 20 * ms, 0);
  by_its_own_clock(sample);
  EXPECT_THROW(account_with(sample), record::WrongFile);
}

TEST_P(ByHand, MissingTraceOfMessagesOnTimeIsNoLimit) {
  auto of_next = window_;
  of_next.span.message = 51;
  keep({{"component", window_}, {"component", of_next}});
  ping_.trace(run_, {"controller", {{50, due - ms, due + 21 * ms}, true, {}}});
  auto sample = late(0, 20 * ms, 0);
  by_its_own_clock(sample);
  EXPECT_THAT(account_with(sample).limits, testing::Each(testing::Not(HasSubstr("no trace from"))));
}

TEST_P(ByHand, MessageThatPongDidNotKeepSuggestsNoRepetition) {
  window_.span.message = 51;
  keep();
  ping_.trace(run_, {"controller", {{50, due - ms, due + 21 * ms}, true, {}}});
  auto sample = late(0, 20 * ms, 0);
  by_its_own_clock(sample);
  const auto limits = account_with(sample).limits;
  EXPECT_THAT(limits, testing::Contains(testing::AllOf(HasSubstr("component"), HasSubstr("1 of 1 late"),
                                                       testing::Not(HasSubstr("ontime pong")))));
}

// Both ends on one machine, and nothing was kept by pong.
class OverLoopback : public Explained {
 protected:
  void packet(std::int64_t at, int cpu, std::int32_t thread, std::int32_t number) {
    for (const auto& [after, kind] :
         {std::pair{std::int64_t{0}, Kind::queued}, {us, Kind::sent}, {2 * us, Kind::received}})
      event(at + after, cpu, kind, thread, 0, "lo", number);
  }
  Account account_of_ping(const std::vector<trace::Window>& windows) {
    record::Writer ping("");
    const auto run = ping.begin_run({{"id", "ping"}, {"payload_bytes", 500}, {"timeout_us", 50'000}});
    samples_.insert(samples_.begin() + 50, lost());
    ping.append(run, samples_);
    for (const auto& window : windows) ping.trace(run, {"controller", window});
    ping.end_run(run,
                 {{"trace", {{"controller", json::object()}}},
                  {"hosts", {{"controller", {{"threads", threads({{asks, "send"}, {hears, "receive"}})}}}}}});
    const auto reader = ping.reader();
    return account_of(reader, reader.runs().at(0));
  }
};

TEST_P(OverLoopback, AStoppedPongIsSeenByPingAlone) {
  event(due - 800 * us, 1, Kind::signal, answers, hog, "19");
  switched(due - 700 * us, 1, answers, "T", hog);
  sender_wakes();
  packet(sent + 5 * us, 0, asks, 1);
  auto quick = window_;
  const auto at = due - 100 * ms;  // of message 40
  quick.span = {40, at - ms, at + 20 * ms};
  quick.events.clear();
  std::swap(quick, window_);
  packet(at + 17 * us, 0, asks, 1);
  packet(at + 66 * us, 1, answers, 2);
  std::swap(quick, window_);
  const auto account = account_of_ping({quick, window_});
  ASSERT_THAT(account.messages, SizeIs(2));
  const auto part = first(account.messages[0]);
  EXPECT_EQ(part.cause, Cause::stopped);
  EXPECT_EQ(part.end, "component");
  EXPECT_EQ(part.culprit, "hog");
  EXPECT_THAT(account.limits, testing::Each(testing::Not(HasSubstr("no trace from the component"))));
}

INSTANTIATE_TEST_SUITE_P(Kernel, OverLoopback, testing::Values(true, false), name_of_kernel);

// The second half of the run is an hour later, and the server's clock went 20 ppm faster.
class Drifting : public ByHand {
 protected:
  static constexpr std::int64_t hour = 3'600'000 * ms, drift = 72 * ms;
  Drifting() {
    for (auto& sample : samples_)
      if (sample.index >= 40) an_hour_later(sample);
    window_.span.from_ns += hour + drift;
    window_.span.to_ns += hour + drift;
    for (auto& event : window_.events) event.at_ns += hour + drift;
  }
  static void an_hour_later(Sample& sample) {
    for (auto* at : {&sample.intended_ns, &sample.due_ns, &sample.woke_ns, &sample.sent_ns}) *at += hour;
    for (auto* at : {&sample.received_ns, &sample.server_received_ns, &sample.server_sent_ns})
      if (*at != 0) *at += hour;
    for (auto* at : {&sample.server_received_ns, &sample.server_sent_ns})
      if (*at != 0) *at += drift;
  }
};

TEST_P(Drifting, AMessageIsRelatedByTheAnswersAroundIt) {
  keep();
  auto sample = late(0, 20 * ms, 0);
  by_its_own_clock(sample);
  an_hour_later(sample);
  const auto account = account_with(sample);
  ASSERT_THAT(account.messages, SizeIs(1));
  const auto part = first(account.messages[0]);
  EXPECT_EQ(part.cause, Cause::cpu);
  EXPECT_NEAR(static_cast<double>(part.ns), 20e6, 0.2e6);
  EXPECT_NEAR(static_cast<double>(account.messages[0].delay_ns), 20e6, 0.2e6);
  EXPECT_THAT(account.limits, testing::Contains(HasSubstr("±46.0 µs")));
}

TEST_P(Drifting, LostMessageIsRelatedByTheAnswersAroundIt) {
  window_.span.message = 51;
  keep();
  auto sample = lost();
  an_hour_later(sample);
  const auto account = account_with(sample);
  EXPECT_THAT(account.messages, SizeIs(2)) << "the lost one, and the one of that window";
}

// Where nothing was answered for an hour, the clocks are known as well as they may have drifted since.
TEST_P(Drifting, UncertaintyGrowsAwayFromAnswers) {
  std::erase_if(samples_, [](const Sample& sample) { return sample.index > 51; });
  std::erase_if(samples_, [](const Sample& sample) { return sample.index >= 40 && sample.index < 50; });
  record::Writer writer("");
  const auto run = writer.begin_run({{"id", "x"}});
  writer.append(run, samples_);
  writer.end_run(run, json::object());
  const Drift drifts(writer.reader(), run);
  EXPECT_EQ(drifts.at(samples_.front().sent_ns).uncertainty_ns, 45 * us);
  EXPECT_EQ(drifts.at(0).difference_ns, ahead + 5 * us);
  const auto between = drifts.at(hour / 2);
  EXPECT_GT(between.uncertainty_ns, 170 * ms);
  EXPECT_GE(between.uncertainty_ns, std::abs(between.difference_ns - ahead - drift / 2));
  EXPECT_EQ(drifts.at(samples_.back().sent_ns).difference_ns, ahead + drift + 5 * us);
}

INSTANTIATE_TEST_SUITE_P(Kernel, Drifting, testing::Values(true, false), name_of_kernel);

INSTANTIATE_TEST_SUITE_P(Kernel, ByHand, testing::Values(true, false), name_of_kernel);

}  // namespace
}  // namespace ontime::explain
