// SPDX-License-Identifier: Apache-2.0
// Links that were down, and packets without a route.
#include "explain_fixture.hpp"

namespace ontime::explain {
namespace {

class Links : public Explained {
 protected:
  void down(const char* end, std::int64_t from, std::int64_t to, bool taken) {
    down_[end].push_back({{"from_ns", from}, {"to_ns", to}, {"taken", taken}});
  }
  void dropped(const char* reason) {
    event(sent + 5 * us, 0, Kind::queued, asks, 0, "veth", 1);
    event(sent + 6 * us, 0, Kind::sent, asks, 0, "veth", 1);
    event(sent + 7 * us, 0, Kind::dropped, asks, 0, reason, 1);
  }
};

TEST_P(Links, MessageLostWhileALinkIsTakenDownIsLinkDown) {
  down("controller", due - 50 * ms, due + 50 * ms, false);
  down("component", due - 49 * ms, due + 50 * ms, true);
  const auto part = first(message(lost()));
  EXPECT_EQ(part.cause, Cause::link_down);
  EXPECT_EQ(part.end, "component") << "the controller lost its carrier because of it";
  EXPECT_EQ(sentence_of(part), "the link was down at pong's side: to-controller was taken down");
}

TEST_P(Links, OneThatHasNoCarrierAtBothEndsIsNamedAtOne) {
  for (const auto* end : {"controller", "component"}) down(end, due - 50 * ms, due + 50 * ms, false);
  EXPECT_EQ(sentence_of(first(message(lost()))),
            "the link was down at ping's side: to-component had no carrier");
}

TEST_P(Links, LostCarrierIsReportedLate) {
  down("controller", due + 700 * ms, due + 900 * ms, false);
  EXPECT_EQ(first(message(lost())).cause, Cause::link_down);
}

TEST_P(Links, OneThatIsDownStill) {
  down_["component"].push_back({{"from_ns", due - ms}, {"to_ns", nullptr}, {"taken", true}});
  EXPECT_EQ(first(message(lost())).cause, Cause::link_down);
}

TEST_P(Links, OneThatWasDownBeforeOrWentDownLaterIsNotAccused) {
  down("component", due - 50 * ms, due - ms, true);
  down("component", due + 50 * ms, due + 90 * ms, true);
  EXPECT_EQ(first(message(lost())).cause, Cause::unknown);
}

TEST_P(Links, APacketThatIsDroppedWhereOneIsDown) {
  down("component", due - ms, due + ms, true);
  dropped("__dev_forward_skb2");
  const auto part = first(message(lost()));
  EXPECT_EQ(part.cause, Cause::link_down);
  EXPECT_EQ(part.stage, Stage::travelled);
}

TEST_P(Links, APacketThatARuleDroppedIsNotTheLinks) {
  down("component", due - ms, due + ms, true);
  dropped("NETFILTER_DROP");
  EXPECT_EQ(first(message(lost())).cause, Cause::dropped);
}

TEST_P(Links, NoNeighbourSoonAfterALinkDownIsLinkDown) {
  sender_wakes();
  event(sent + 5 * us, 0, Kind::no_neighbour, asks);
  EXPECT_EQ(first(message(lost())).cause, Cause::unreachable);
  down("component", due - 450 * ms, due - 300 * ms, true);
  samples_.erase(samples_.begin() + 50);
  EXPECT_EQ(first(message(lost())).cause, Cause::link_down);
}

TEST_P(Links, NoNeighbourLongAfterALinkDownHasAnotherCause) {
  sender_wakes();
  event(sent + 5 * us, 0, Kind::no_neighbour, asks);
  down("component", due - 6000 * ms, due - 5000 * ms, true);
  EXPECT_EQ(first(message(lost())).cause, Cause::unreachable);
}

TEST_P(Links, MessageResentAfterALinkDownIsLateForLinkDown) {
  down("component", due - ms, due + 15 * ms, true);
  const auto part = first(message(late(0, 16 * ms, 0)));
  EXPECT_EQ(part.cause, Cause::link_down);
  EXPECT_EQ(part.ns, 15 * ms - 12 * us) << "as long as it was down since then, and no longer";
}

TEST_P(Links, APacketThatAQueueHadNoRoomForIsNotTheLinks) {
  down("controller", due + 700 * ms, due + 900 * ms, false);
  dropped("QDISC_OVERLIMIT");
  EXPECT_EQ(first(message(lost())).cause, Cause::dropped);
}

TEST_P(Links, LegOfNegativeLengthIsNotLinkDown) {
  down("component", due - ms, due + 400 * ms, true);
  auto sample = late(0, 0, 16 * ms);
  sample.server_received_ns = sample.server_sent_ns = sample.sent_ns - ms;
  EXPECT_NO_THROW(message(sample));
}

TEST_P(Links, APacketOfTheLoopbackDoesNotHideAWire) {
  switched(due - ms / 2, 1, hog, "S", 0);
  sender_wakes_and_queues();
  for (const auto kind : {Kind::queued, Kind::sent, Kind::received})
    event(sent + 7 * us, 0, kind, hog, 0, "lo", 3);
  constexpr std::int32_t napi = 7;
  event(sent + 9 * us, 1, Kind::waking, napi, 0, "1");
  window_.events.back().thread.name = "napi/eth1-1";
  switched(sent + 15 * ms, 1, hog, "R", napi);
  event(sent + 15 * ms + us, 1, Kind::received, napi, 0, "to-controller", 2);
  window_.events.back().thread.name = "napi/eth1-1";
  event(sent + 15 * ms + 2 * us, 1, Kind::waking, answers, napi, "1");
  const auto part = first(message(late(0, 15 * ms, 0)));
  EXPECT_EQ(part.stage, Stage::travelled);
  EXPECT_EQ(part.thread, "napi/eth1-1");
}

TEST_P(Links, ImpossibleLinkTimesInAFileAreIgnored) {
  down_["component"] = {{{"from_ns", "x"}, {"to_ns", nullptr}, {"taken", true}},
                        {{"from_ns", -1.5}, {"to_ns", due + ms}, {"taken", true}},
                        {{"from_ns", 0}, {"to_ns", std::int64_t{1} << 62}, {"taken", true}},
                        7};
  EXPECT_EQ(first(message(lost())).cause, Cause::unknown);
  down_["component"] = "down";
  samples_.erase(samples_.begin() + 50);
  EXPECT_EQ(first(message(lost())).cause, Cause::unknown);
}

TEST_P(Links, AMessageForWhichThereWasNoRoute) {
  sender_wakes();
  event(sent + 5 * us, 0, Kind::no_route, asks);
  const auto part = first(message(lost()));
  EXPECT_EQ(part.cause, Cause::unreachable);
  EXPECT_EQ(part.end, "controller");
  EXPECT_EQ(sentence_of(part), "the packet could not be sent at ping's side: no route");
}

TEST_P(Links, AnswerWithoutABackgroundIsUnreachable) {
  sender_wakes_and_sends();
  event(sent + 20 * us, 1, Kind::no_neighbour, answers);
  const auto part = first(message(lost()));
  EXPECT_EQ(part.cause, Cause::unreachable);
  EXPECT_EQ(part.end, "component");
  EXPECT_EQ(part.culprit, "no neighbour");
}

TEST_P(Links, SentMessageIgnoresForeignMissingRoute) {
  sender_wakes_and_sends();
  event(sent + 10 * us, 0, Kind::no_route, asks);
  EXPECT_NE(first(message(lost())).cause, Cause::unreachable);
}

TEST_P(Links, AMessageWhoseBackgroundAnsweredIsNotUnreachable) {
  event(sent + 5 * us, 0, Kind::no_neighbour, asks);
  event(sent + 300 * us, 0, Kind::queued, hog, 0, "veth",
        1);  // it ran when the background topic's answer came
  EXPECT_NE(first(message(lost())).cause, Cause::unreachable);
}

TEST_P(Links, NoRouteOfAnotherPingThreadIsIgnored) {
  event(sent + 5 * us, 0, Kind::no_route, hears);
  EXPECT_NE(first(message(lost())).cause, Cause::unreachable);
}

TEST_P(Links, AnswerWithoutARouteAfterADelayIsUnreachable) {
  sender_wakes_and_sends();
  event(sent + 10 * us, 0, Kind::waking, answers, asks, "1");
  switched(sent + 5 * ms, 1, hog, "R", answers);
  event(sent + 5 * ms + 20 * us, 1, Kind::no_route, answers);
  const auto part = first(message(lost()));
  EXPECT_EQ(part.cause, Cause::unreachable);
  EXPECT_EQ(part.end, "component");
}

INSTANTIATE_TEST_SUITE_P(Kernel, Links, testing::Values(true, false), name_of_kernel);

}  // namespace
}  // namespace ontime::explain
