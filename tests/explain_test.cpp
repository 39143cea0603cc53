// SPDX-License-Identifier: Apache-2.0
#include "explain_fixture.hpp"

namespace ontime::explain {
namespace {

TEST_P(Explained, ThreadBehindAnotherWaitsForACpu) {
  sender_wakes_and_sends();
  event(sent + 10 * us, 0, Kind::waking, answers, asks, "1");
  switched(sent + 20 * ms, 1, hog, "R", answers);
  switched(sent + 30 * ms, 1, answers, "S", hog);
  const auto message = this->message(late(0, 20 * ms, 0));
  const auto part = first(message);
  EXPECT_EQ(part.cause, Cause::cpu);
  EXPECT_EQ(part.culprit, "hog");
  EXPECT_THAT(part.culprit_threads, testing::ElementsAre(hog));
  EXPECT_EQ(part.stage, Stage::delivered);
  EXPECT_EQ(part.end, "component");
  EXPECT_EQ(part.thread, "receive");
  EXPECT_EQ(part.ns, 20 * ms - 10 * us);
  EXPECT_EQ(sentence_of(part), "pong's receive thread waited for a CPU while hog ran");
  EXPECT_THAT(advice(part), HasSubstr("realtime: on"));
}

TEST_P(Explained, AnsweringOneOfTwoReceiversIsFollowed) {
  constexpr std::int32_t other = 21;
  component_threads_ = threads({{other, "receive"}, {answers, "receive"}});
  switched(due - ms / 2, 2, hog, "S", other);
  sender_wakes_and_sends();
  event(sent + 10 * us, 0, Kind::waking, answers, asks, "1");
  switched(sent + 20 * ms, 1, hog, "R", answers);
  event(sent + 20 * ms + 52 * us, 1, Kind::queued, answers, 0, "to-controller", 2);
  switched(sent + 30 * ms, 1, answers, "S", hog);
  switched(sent + 31 * ms, 2, other, "S", 0);
  const auto part = first(message(late(0, 20 * ms, 0)));
  EXPECT_EQ(part.cause, Cause::cpu);
  EXPECT_EQ(part.culprit, "hog");
  EXPECT_EQ(part.stage, Stage::delivered);
}

TEST_P(Explained, OfTwoAnswerReceiversTheLastToBeginIsFollowed) {
  constexpr std::int32_t other = 12, another = 98;
  controller_threads_ = threads({{asks, "send"}, {other, "receive"}, {hears, "receive"}});
  switched(due - ms / 2, 3, another, "S", other);
  switched(due - ms / 2, 2, another, "S", hog);
  has_the_message();
  event(sent + 52 * us, 1, Kind::queued, answers, 0, "to-controller", 2);
  event(sent + 53 * us, 1, Kind::sent, answers, 0, "to-controller", 2);
  event(sent + 56 * us, 1, Kind::received, answers, 0, "to-component", 2);
  event(sent + 57 * us, 1, Kind::waking, hears, answers, "2");
  switched(sent + 20 * ms, 2, hog, "R", hears);
  switched(sent + 30 * ms, 2, hears, "S", hog);
  switched(sent + 31 * ms, 3, other, "S", 0);
  const auto part = first(message(late(0, 0, 20 * ms)));
  EXPECT_EQ(part.cause, Cause::cpu);
  EXPECT_EQ(part.culprit, "hog");
  EXPECT_EQ(part.end, "controller");
}

TEST_P(Explained, StoppedThreadIsStopped) {
  event(due - 800 * us, 1, Kind::signal, answers, hog, "19");
  switched(due - 700 * us, 1, answers, "T", 0);
  switched(due - 600 * us, 1, hog, "S", 0);
  sender_wakes_and_sends();
  hog_lets_it_go_on(sent + 30 * ms);
  const auto part = first(message(late(0, 30 * ms, 0)));
  EXPECT_EQ(part.cause, Cause::stopped);
  EXPECT_EQ(part.end, "component");
  EXPECT_EQ(part.culprit, "hog");
}

TEST_P(Explained, OnlyTheSignalThatStoppedTheThreadNamesItsSender) {
  constexpr std::int32_t bash = 66, vim = 67;
  const auto culprit = [&](std::initializer_list<std::pair<std::int64_t, std::int32_t>> signals) {
    window_.events.clear();
    switched(due - 700 * us, 1, answers, "T", 0);
    for (const auto& [at, to] : signals)
      event(at, 2, Kind::signal, to, to == vim ? bash : hog, to == vim ? "20" : "19");
    switched(due - 600 * us, 1, hog, "S", 0);
    sender_wakes_and_sends();
    hog_lets_it_go_on(sent + 30 * ms);
    in_order();
    const auto part = first(message(late(0, 30 * ms, 0)));
    samples_.erase(samples_.begin() + 50);
    EXPECT_EQ(part.cause, Cause::stopped);
    return part.culprit;
  };
  EXPECT_EQ(culprit({{due - 800 * us, answers}}), "hog");
  EXPECT_EQ(culprit({{due - 800 * us, answers}, {sent + ms, vim}}), "hog");
  EXPECT_EQ(culprit({{due - 800 * us, answers}, {due - 750 * us, vim}}), "hog");
  EXPECT_EQ(culprit({{due - 900 * us, vim}, {due - 800 * us, answers}}), "hog");
  EXPECT_EQ(culprit({{sent + ms, vim}}), "");
  EXPECT_EQ(culprit({{due - 800 * us, vim}}), "");
  EXPECT_EQ(culprit({{sent + ms, answers}}), "") << "after it had stopped";
}

TEST_P(Explained, SignalToItsProcessStopsTheThread) {
  constexpr std::int32_t main = 68;
  event(due - 900 * us, 1, Kind::signal, main, hog, "19");
  event(due - 850 * us, 2, Kind::waking, answers, main, "1");
  switched(due - 840 * us, 1, 0, "R", answers);
  switched(due - 700 * us, 1, answers, "T", 0);
  sender_wakes_and_sends();
  hog_lets_it_go_on(sent + 30 * ms);
  const auto part = first(message(late(0, 30 * ms, 0)));
  EXPECT_EQ(part.cause, Cause::stopped);
  EXPECT_EQ(part.culprit, "hog");
}

TEST_P(Explained, AThreadThatIsBusyWithBackgroundIsToldApartFromOneThatIsNot) {
  has_the_message();
  switched(sent + 16 * ms, 1, answers, "S", 0);
  const auto remedy = [&](const char* transport, const char* where, const char* executor,
                          bool is_there = true) {
    asked_ = {
        {"transport", "udp"},
        {"component_transport", transport},
        {"receive", "listener"},
        {"component_options", {{"executor", executor}}},
        {"neighbours", {{"where", where}, {"callback_us", 4500}, {"there", is_there}, {"back", !is_there}}}};
    const auto groups = account(late(0, 15 * ms, 0)).groups;
    samples_.erase(samples_.begin() + 50);
    EXPECT_THAT(groups, SizeIs(1));
    EXPECT_EQ(groups.at(0).culprit.cause, Cause::busy);
    return text_of(groups.at(0).remedy);
  };
  const auto is_told = HasSubstr("callbacks of the background topics, 4.5 ms each");
  EXPECT_THAT(remedy("ros2", "same-callback-group", "multi"), is_told);
  EXPECT_THAT(remedy("ros2", "same-node", "single"), is_told);
  EXPECT_THAT(remedy("cyclonedds", "same-process", ""), is_told);
  EXPECT_THAT(remedy("fastdds", "same-participant", ""), is_told);
  for (const auto& [transport, where] : {std::pair("ros2", "own-executor"),
                                         {"ros2", "same-participant"},
                                         {"fastdds", "same-process"},
                                         {"cyclonedds", "other-process"}})
    EXPECT_EQ(remedy(transport, where, "single"), "") << transport << " " << where;
  EXPECT_EQ(remedy("ros2", "same-node", "multi"), "");
  EXPECT_EQ(remedy("ros2", "same-node", "single", false), "") << "none come to that end";
  component_transport_ = {{"nodes", false}, {"shares_threads", true}};  // which counts, whatever its name
  EXPECT_THAT(remedy("foreign", "same-process", ""), is_told);
  component_transport_ = {{"nodes", true}, {"shares_threads", false}};
  EXPECT_EQ(remedy("foreign", "same-participant", ""), "");
  EXPECT_EQ(remedy("cyclonedds", "same-process", ""), "");
}

TEST_P(Explained, AThreadThatRunsOnAnIdleCpuIsBusyFromWhenItIsSeen) {
  switched(sent - ms / 2, 1, hog, "S", 0);
  sender_wakes_and_sends();
  event(sent + 10 * us, 0, Kind::waking, answers, asks, "1");
  switched(sent + 13 * us, 1, 0, "R", answers);
  event(sent + 2 * ms, 1, Kind::timer, answers);
  event(sent + 2 * ms + us, 1, Kind::timer_end, answers);
  switched(sent + 16 * ms, 1, answers, "S", 0);
  const auto part = first(message(late(0, 15 * ms, 0)));
  EXPECT_EQ(part.cause, Cause::busy);
  EXPECT_EQ(part.stage, Stage::delivered);
  EXPECT_GT(part.ns, leaving_idle_is_told() ? 14 * ms : 12 * ms);
}

TEST_P(Explained, SenderIsBusyFromTheTimeThatItNotedItself) {
  sender_wakes();
  event(sent + 4 * ms, 0, Kind::timer, asks);
  event(sent + 4 * ms + us, 0, Kind::timer_end, asks);
  event(sent + 15 * ms, 0, Kind::queued, asks, 0, "to-component", 1);
  event(sent + 15 * ms + us, 0, Kind::sent, asks, 0, "to-component", 1);
  event(sent + 15 * ms + 4 * us, 0, Kind::received, asks, 0, "to-controller", 1);
  const auto part = first(message(late(0, 15 * ms, 0)));
  EXPECT_EQ(part.cause, Cause::busy);
  EXPECT_EQ(part.stage, Stage::left);
  EXPECT_GT(part.ns, 14 * ms);
}

TEST_P(Explained, ATimerThatCameLate) {
  switched(due - ms / 2, 0, asks, "S", 0);
  sender_wakes_and_sends(3 * ms);
  const auto part = first(message(late(3 * ms, 0, 0)));
  EXPECT_EQ(part.cause, Cause::timer);
  EXPECT_EQ(part.stage, Stage::woke);
  EXPECT_EQ(part.ns, 3 * ms - (leaving_idle_is_told() ? 3 * us : 0))
      << "and for so long it waited for its idle CPU";
}

TEST_P(Explained, APacketThatIsHeldInAQueue) {
  sender_wakes();
  event(sent + 5 * us, 0, Kind::queued, asks, 0, "veth", 1);
  event(sent + 15 * ms, 0, Kind::sent, 0, 0, "veth", 1);
  event(sent + 15 * ms + us, 0, Kind::received, 0, 0, "veth", 1);
  const auto part = first(message(late(0, 15 * ms, 0)));
  EXPECT_EQ(part.cause, Cause::queue);
  EXPECT_EQ(part.end, "controller");
  EXPECT_EQ(part.culprit, "veth");
  EXPECT_THAT(advice(part), HasSubstr("tc -s qdisc show dev veth"));
}

TEST_P(Explained, APacketThatIsDropped) {
  sender_wakes_and_sends();
  event(sent + 10 * us, 0, Kind::dropped, asks, 0, "SOCKET_RCVBUFF", 1);
  const auto message = this->message(lost());
  EXPECT_EQ(first(message).cause, Cause::dropped);
  EXPECT_EQ(first(message).end, "component");
  EXPECT_EQ(first(message).culprit, "SOCKET_RCVBUFF");
  EXPECT_THAT(advice(first(message)), HasSubstr("kernel.rmem-max"));
}

TEST_P(Explained, DelayUntilTheTimeOutLosesTheMessage) {
  event(due - 800 * us, 1, Kind::signal, answers, hog, "19");
  switched(due - 700 * us, 1, answers, "T", 0);
  sender_wakes_and_sends();
  event(sent + 60 * ms, 1, Kind::waking, answers, hog, "1");
  switched(sent + 60 * ms + 5 * us, 1, 0, "R", answers);
  timeout_us_ = 50'000;
  const auto part = first(message(lost()));
  EXPECT_EQ(part.cause, Cause::stopped);
  EXPECT_EQ(part.end, "component");
}

TEST_P(Explained, ForeignPacketDroppedAccusesNoThread) {
  sender_wakes_and_sends();
  event(sent + 10 * us, 0, Kind::dropped, hog, 0, "SOCKET_RCVBUFF", 2);
  EXPECT_EQ(first(message(lost())).cause, Cause::unknown);
}

TEST_P(Explained, ThreadOnTheCpuBeforeItWasNeededIsNotAccused) {
  switched(due - ms / 2, 1, hog, "S", 0);
  sender_wakes_and_sends();
  event(sent + 10 * us, 0, Kind::waking, answers, asks, "1");
  switched(sent + 15 * us, 1, 0, "R", answers);
  switched(sent + 25 * us, 1, answers, "S", 0);
  const auto part = first(message(late(0, 0, 20 * ms)));
  EXPECT_EQ(part.cause, Cause::unknown);
  EXPECT_EQ(part.ns, 20 * ms);
}

TEST_P(Explained, MessageAsLongAsUsualAccusesNoThread) {
  sender_wakes_and_sends();
  const auto message = this->message(usual(50));
  EXPECT_LT(message.delay_ns, 20 * us);
}

TEST_P(Explained, WhereMostAreLateTheDelayIsAboveTheMessagesOnTime) {
  for (std::size_t i = 0; i < 80; ++i) {
    auto& slow = samples_[i];
    slow.server_received_ns += 15 * ms;
    slow.server_sent_ns += 15 * ms;
    slow.received_ns += 15 * ms;
    slow.fate = Fate::late;
  }
  has_the_message();
  switched(sent + 16 * ms, 1, answers, "S", 0);
  const auto part = first(message(late(0, 15 * ms, 0)));
  EXPECT_EQ(part.cause, Cause::busy);
  EXPECT_GT(part.ns, 14 * ms);
}

TEST_P(Explained, LateWithoutServerTimesIsUnknown) {
  auto sample = late(0, 20 * ms, 0);
  sample.server_received_ns = sample.server_sent_ns = 0;
  const auto account = this->account(sample);
  ASSERT_THAT(account.messages, SizeIs(1));
  const auto part = first(account.messages[0]);
  EXPECT_EQ(part.cause, Cause::unknown);
  EXPECT_EQ(part.ns, 20 * ms);
  EXPECT_THAT(account.groups, SizeIs(1));
  EXPECT_THAT(account.limits, testing::ElementsAre(HasSubstr("1 message without the server's times")));
}

TEST_P(Explained, WithoutServerTimesTheSenderIsStillExplained) {
  for (auto& one : samples_) one.server_received_ns = one.server_sent_ns = 0;
  switched(due - ms / 2, 0, asks, "S", 0);
  sender_wakes_and_sends(3 * ms);
  auto sample = late(3 * ms, 0, 0);
  sample.server_received_ns = sample.server_sent_ns = 0;
  const auto part = first(message(sample));
  EXPECT_EQ(part.cause, Cause::timer);
  EXPECT_EQ(part.stage, Stage::woke);
}

TEST_P(Explained, TheSameCulpritsAreOneGroup) {
  sender_wakes_and_sends();
  event(sent + 10 * us, 0, Kind::waking, answers, asks, "1");
  switched(sent + 20 * ms, 1, hog, "R", answers);
  const auto account = this->account(late(0, 20 * ms, 0));
  EXPECT_EQ(account.late, 1u);
  ASSERT_THAT(account.groups, SizeIs(1));
  EXPECT_EQ(account.groups[0].messages, 1u);
  EXPECT_EQ(account.groups[0].threads, 1u);
  EXPECT_THAT(account.limits, IsEmpty());
}

TEST_P(Explained, MissingEventsAndIncompleteTraceAreLimits) {
  window_.whole = false;
  const auto limits = account(late(0, 20 * ms, 0), {{"controller", {{"missing", {"skb:kfree_skb (that …)"}}}},
                                                    {"component", {{"error", "no root"}}}})
                          .limits;
  EXPECT_THAT(limits, testing::UnorderedElementsAre(HasSubstr("skb:kfree_skb"), HasSubstr("no root"),
                                                    HasSubstr("incomplete trace of 1 message")));
}

TEST_P(Explained, StopsByACpuQuotaAreALimit) {
  for (auto& thread : component_threads_) thread["policy"] = "other";
  component_quota_ = {{"cpus", 0.12}, {"throttled_periods", 54}, {"throttled_ns", 2'700'000'000}};
  EXPECT_THAT(
      account(late(0, 20 * ms, 0)).limits,
      testing::Contains(testing::AllOf(HasSubstr("0.12 CPUs stopped the component's"), HasSubstr("54 of"))));
}

TEST(Explain, FileWithTooManyThreadsIsRefused) {
  record::Writer writer("");
  const auto run = writer.begin_run({{"id", "x"}});
  const json thread{{"tid", 1}, {"role", "receive"}};
  writer.trace(run, {"controller", {{0, 0, 1}, true, {}}});
  writer.end_run(run, {{"trace", {{"controller", json::object()}}},
                       {"hosts", {{"component", {{"threads", json(1001, thread)}}}}}});
  const auto reader = writer.reader();
  try {
    account_of(reader, reader.runs().at(0));
    FAIL();
  } catch (const record::WrongFile& error) {
    EXPECT_THAT(error.what(), HasSubstr("run 1 has 1001 threads at its component"));
  }
}

TEST_P(Explained, ARunWithoutTracesIsNotExplained) {
  record::Writer writer("");
  writer.begin_run({});
  const auto reader = writer.reader();
  EXPECT_FALSE(account_of(reader, reader.runs().at(0)).traced);
}

TEST_P(Explained, APartSaysWhenItWas) {
  sender_wakes_and_sends();
  event(sent + 10 * us, 0, Kind::waking, answers, asks, "1");
  switched(sent + 20 * ms, 1, hog, "R", answers);
  const auto part = first(message(late(0, 20 * ms, 0)));
  ASSERT_THAT(part.when, SizeIs(1));
  EXPECT_EQ(part.when[0].from_ns, sent + 10 * us);
  EXPECT_EQ(part.when[0].to_ns, sent + 20 * ms);
  EXPECT_EQ(part.when[0].cpu, 1);
  EXPECT_EQ(part.thread_id, answers);
}

TEST_P(Explained, ThreadThatCameFirstIsNotDelayedByTheEarlierOne) {
  sender_wakes_and_sends();
  event(sent + 10 * us, 0, Kind::waking, answers, asks, "1");
  switched(sent + 14 * ms, 1, hog, "S", 0);  // and it comes at once
  switched(sent + 14 * ms + 10 * us, 1, 0, "R", answers);
  switched(sent + 14 * ms + 60 * us, 1, answers, "S", 0);
  EXPECT_EQ(first(message(late(0, 14 * ms, 0))).cause, Cause::cpu);
}

INSTANTIATE_TEST_SUITE_P(Kernel, Explained, testing::Values(true, false), name_of_kernel);

}  // namespace
}  // namespace ontime::explain
