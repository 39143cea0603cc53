// SPDX-License-Identifier: Apache-2.0
// Of packets, and of the queues that they are handed on to.
#include <optional>

#include "explain_fixture.hpp"

namespace ontime::explain {
namespace {

class Packets : public Explained {
 protected:
  // As long as it is not called again.
  std::vector<Packet> of_asks(bool one_machine = true, std::int64_t until_ns = due + ms) {
    timeline_.emplace(window_, 0);
    return packets_of(
        *timeline_, [](std::int32_t thread) { return thread == asks; }, one_machine, due, until_ns);
  }

 private:
  std::optional<Timeline> timeline_;
};

TEST_P(Packets, ANumberOfAPacketIsGivenToTheNext) {
  sender_wakes_and_sends();
  event(sent + 20 * us, 0, Kind::queued, asks, 0, "veth", 1);
  event(sent + 21 * us, 0, Kind::dropped, asks, 0, "QDISC_DROP", 1);
  event(sent + 30 * us, 0, Kind::queued, hog, 0, "veth", 1);
  event(sent + 31 * us, 0, Kind::sent, hog, 0, "veth", 1);
  const auto packets = of_asks();
  ASSERT_THAT(packets, SizeIs(2));
  EXPECT_EQ(packets[0].received->at_ns, sent + 9 * us);
  EXPECT_EQ(packets[0].dropped, nullptr);
  EXPECT_EQ(packets[1].dropped->what, "QDISC_DROP");
  EXPECT_EQ(packets[1].sent, nullptr);
}

TEST_P(Packets, OverLoopbackThePacketOfAnotherIsNotTheMessages) {
  interface_of_controller_ = interface_of_component_ = "lo";
  switched(due - ms / 2, 1, answers, "S", hog);
  sender_wakes_and_sends();
  event(sent + 10 * us, 0, Kind::waking, answers, asks, "1");
  for (const auto kind : {Kind::queued, Kind::sent, Kind::received})
    event(sent + 19 * ms, 1, kind, hog, 0, "lo", 2);
  switched(sent + 20 * ms, 1, hog, "R", answers);
  const auto part = first(message(late(0, 20 * ms, 0)));
  EXPECT_EQ(part.cause, Cause::cpu);
  EXPECT_GT(part.ns, 19 * ms);
}

TEST_P(Packets, APacketThatABridgeHandsOnIsOne) {
  event(sent + 5 * us, 0, Kind::queued, asks, 0, "to-components", 1);
  event(sent + 6 * us, 0, Kind::sent, asks, 0, "to-components", 1);
  event(sent + 7 * us, 0, Kind::queued, asks, 0, "to-arm", 1);
  event(sent + 8 * us, 0, Kind::sent, asks, 0, "to-arm", 1);
  event(sent + 9 * us, 0, Kind::dropped, asks, 0, "NETFILTER_DROP", 1);
  const auto packets = of_asks();
  ASSERT_THAT(packets, SizeIs(1));
  EXPECT_EQ(packets[0].sent->at_ns, sent + 8 * us);
  ASSERT_NE(packets[0].dropped, nullptr);
  EXPECT_EQ(packets[0].dropped->what, "NETFILTER_DROP");
}

// Of a link whose delay is on the bridge's port, or below a VLAN: who lets the packet go is not who queued
// it.
TEST_P(Packets, APacketThatIsHeldBehindABridgeIsHeldByThatQueue) {
  event(sent + 5 * us, 0, Kind::queued, asks, 0, "to-components", 1);
  event(sent + 6 * us, 0, Kind::sent, asks, 0, "to-components", 1);
  event(sent + 7 * us, 0, Kind::queued, asks, 0, "to-arm", 1);
  event(sent + 15 * ms, 1, Kind::sent, hog, 0, "to-arm", 1);
  event(sent + 15 * ms + 2 * us, 1, Kind::received, hog, 0, "to-component", 1);
  const auto part = first(message(late(0, 15 * ms, 0)));
  EXPECT_EQ(part.cause, Cause::queue);
  EXPECT_EQ(part.stage, Stage::queued);
  EXPECT_EQ(part.end, "controller");
  EXPECT_EQ(part.culprit, "to-arm");
  EXPECT_EQ(part.ns, 15 * ms - 7 * us);
}

TEST_P(Packets, APacketThatTwoQueuesHoldIsHeldByBoth) {
  event(sent + 5 * us, 0, Kind::queued, asks, 0, "to-components", 1);
  event(sent + 5 * ms, 1, Kind::sent, hog, 0, "to-components", 1);
  event(sent + 5 * ms + us, 1, Kind::queued, hog, 0, "to-arm", 1);
  event(sent + 15 * ms, 0, Kind::sent, hears, 0, "to-arm", 1);
  event(sent + 15 * ms + us, 0, Kind::received, hears, 0, "to-component", 1);
  const auto parts = message(late(0, 15 * ms, 0)).parts;
  ASSERT_GE(parts.size(), 2U);
  EXPECT_EQ(parts[0].cause, Cause::queue);
  EXPECT_EQ(parts[0].culprit, "to-arm");
  EXPECT_EQ(parts[0].ns, 10 * ms - us);
  EXPECT_EQ(parts[1].cause, Cause::queue);
  EXPECT_EQ(parts[1].culprit, "to-components");
  EXPECT_EQ(parts[1].ns, 5 * ms - 5 * us);
}

TEST_P(Packets, APacketThatNeverLeavesTheQueueBehindABridgeIsHeldThere) {
  event(sent + 5 * us, 0, Kind::queued, asks, 0, "to-components", 1);
  event(sent + 6 * us, 0, Kind::sent, asks, 0, "to-components", 1);
  event(sent + 7 * us, 0, Kind::queued, asks, 0, "to-arm", 1);
  const auto part = first(message(lost()));
  EXPECT_EQ(part.cause, Cause::queue);
  EXPECT_EQ(part.culprit, "to-arm");
}

TEST_P(Packets, ANumberThatAnotherThreadHasOnAnotherInterfaceIsAnotherPacket) {
  event(sent + 5 * us, 0, Kind::queued, asks, 0, "to-component", 1);
  event(sent + 6 * us, 0, Kind::sent, asks, 0, "to-component", 1);
  event(sent + 50 * us, 1, Kind::queued, hog, 0, "eth0", 1);
  event(sent + 15 * ms, 1, Kind::sent, hog, 0, "eth0", 1);
  const auto packets = of_asks(false, due + 20 * ms);
  ASSERT_THAT(packets, SizeIs(1));
  EXPECT_EQ(packets[0].sent->at_ns, sent + 6 * us);
}

// Of a packet that another program gets while the sending thread is interrupted.
TEST_P(Packets, AForeignPacketThatASoftirqDropsIsNotTheMessages) {
  event(sent + us, 0, Kind::soft_interrupt, asks, 0, "NET_RX");
  event(sent + 2 * us, 0, Kind::dropped, asks, 0, "NO_SOCKET", 9);
  event(sent + 3 * us, 0, Kind::soft_interrupt_end, asks, 0, "NET_RX");
  sender_wakes_and_sends();
  event(sent + 10 * us, 0, Kind::dropped, asks, 0, "NETFILTER_DROP", 1);
  in_order();
  const auto part = first(message(lost()));
  EXPECT_EQ(part.cause, Cause::dropped);
  EXPECT_EQ(part.culprit, "NETFILTER_DROP");
}

TEST_P(Packets, AForeignPacketThatIsDroppedHidesNoQueue) {
  event(sent + us, 0, Kind::received, asks, 0, "eth0", 9);
  event(sent + 2 * us, 0, Kind::dropped, asks, 0, "NO_SOCKET", 9);
  event(sent + 5 * us, 0, Kind::queued, asks, 0, "to-component", 1);
  event(sent + 15 * ms, 0, Kind::sent, 0, 0, "to-component", 1);
  event(sent + 15 * ms + us, 0, Kind::received, 0, 0, "to-controller", 1);
  EXPECT_EQ(first(message(late(0, 15 * ms, 0))).cause, Cause::queue);
}

TEST_P(Packets, APacketThatIsDroppedBeforeItIsQueuedLostTheMessage) {
  event(sent + us, 0, Kind::dropped, asks, 0, "NETFILTER_DROP", 1);
  const auto part = first(message(lost()));
  EXPECT_EQ(part.cause, Cause::dropped);
  EXPECT_EQ(part.stage, Stage::queued);
}

// Of a link that delays every request by 50 ms.
class SlowLink : public Packets {
 protected:
  static constexpr std::int64_t delay = 50 * ms;
  SlowLink() {
    for (auto& sample : samples_) comes_later(sample);
    switched(due - ms / 2, 1, 0, "R", hog);
    sender_wakes();
  }
  static void comes_later(Sample& sample) {
    for (auto* at : {&sample.server_received_ns, &sample.server_sent_ns, &sample.received_ns}) *at += delay;
  }
  void request_comes(std::int64_t after) {
    event(sent + 5 * us, 0, Kind::queued, asks, 0, "to-component", 1);
    event(sent + after + 6 * us, 0, Kind::sent, 0, 0, "to-component", 1);
    event(sent + after + 9 * us, 0, Kind::received, 0, 0, "to-controller", 1);
    event(sent + after + 10 * us, 0, Kind::waking, answers, 0, "1");
  }
  Sample later(std::int64_t ns) {
    auto sample = late(0, ns, 0);
    comes_later(sample);
    return sample;
  }
};

TEST_P(SlowLink, AQueueThatHoldsEveryMessageIsNoDelay) {
  request_comes(delay);
  switched(sent + delay + 30 * ms, 1, hog, "S", answers);
  const auto message = this->message(later(30 * ms));
  const auto part = first(message);
  EXPECT_EQ(part.cause, Cause::cpu);
  EXPECT_EQ(part.culprit, "hog");
  EXPECT_NEAR(static_cast<double>(message.delay_ns), 30e6, 10e3);
}

TEST_P(SlowLink, OnlyTheTimeAboveTheUsualIsOfTheQueue) {
  request_comes(delay + 30 * ms);
  switched(sent + delay + 30 * ms + 12 * us, 1, hog, "S", answers);
  const auto message = this->message(later(30 * ms));
  const auto part = first(message);
  EXPECT_EQ(part.cause, Cause::queue);
  EXPECT_NEAR(static_cast<double>(message.delay_ns), 30e6, 10e3);
}

TEST_P(SlowLink, WhereNoMessageIsOnTimeTheQueueIsTheDelay) {
  for (auto& sample : samples_) sample.fate = Fate::late;
  request_comes(delay);
  switched(sent + delay + 12 * us, 1, hog, "S", answers);
  const auto part = first(message(later(0)));
  EXPECT_EQ(part.cause, Cause::queue);
  EXPECT_EQ(part.ns, delay + us);
}

INSTANTIATE_TEST_SUITE_P(Kernel, SlowLink, testing::Values(true, false), name_of_kernel);

// Of a message that is lost because it was on its way for too long.
class Held : public Packets {
 protected:
  Held() {
    timeout_us_ = 100'000;
    switched(due - ms / 2, 1, hog, "S", 0);
    sender_wakes();
  }
  void request_comes(std::int64_t after) {
    event(sent + 5 * us, 0, Kind::queued, asks, 0, "to-component", 1);
    event(sent + after + 6 * us, 0, Kind::sent, 0, 0, "to-component", 1);
    event(sent + after + 9 * us, 0, Kind::received, 0, 0, "to-controller", 1);
    event(sent + after + 10 * us, 0, Kind::waking, answers, 0, "1");
    switched(sent + after + 12 * us, 1, 0, "R", answers);
    event(sent + after + 50 * us, 1, Kind::queued, answers, 0, "to-controller", 2);
    switched(sent + after + 60 * us, 1, answers, "S", 0);
  }
};

TEST_P(Held, AnAnswerThatNeverLeftItsQueueIsHeldThere) {
  request_comes(60 * ms);
  const auto parts = message(lost()).parts;
  ASSERT_THAT(parts, SizeIs(2));
  EXPECT_EQ(parts[0].cause, Cause::queue);
  EXPECT_EQ(parts[0].end, "controller");
  EXPECT_EQ(parts[0].ns, 60 * ms + us);
  EXPECT_EQ(parts[1].cause, Cause::queue);
  EXPECT_EQ(parts[1].end, "component");
  EXPECT_EQ(parts[1].culprit, "to-controller");
  EXPECT_EQ(parts[1].ns, 40 * ms - 50 * us);
}

TEST_P(Held, AQueueBeforeAnAnswerThatVanishedDidNotLoseIt) {
  request_comes(60 * ms);
  event(sent + 60 * ms + 55 * us, 1, Kind::sent, answers, 0, "to-controller", 2);
  in_order();
  EXPECT_EQ(first(message(lost())).cause, Cause::unknown);
}

TEST_P(Held, AQueueBeforeAReaderThatStillWaitsForACpuCounts) {
  window_.events.clear();
  switched(due - ms / 2, 1, 0, "R", hog);
  sender_wakes();
  event(sent + 5 * us, 0, Kind::queued, asks, 0, "to-component", 1);
  event(sent + 60 * ms, 0, Kind::sent, 0, 0, "to-component", 1);
  event(sent + 60 * ms + us, 0, Kind::received, 0, 0, "to-controller", 1);
  event(sent + 60 * ms + 2 * us, 0, Kind::waking, answers, 0, "1");
  for (auto at = 62 * ms; at < 150 * ms; at += 4 * ms) {
    event(sent + at, 1, Kind::timer, hog);
    event(sent + at + us, 1, Kind::timer_end, hog);
  }
  switched(sent + 150 * ms, 1, hog, "S", answers);
  const auto part = first(message(lost()));
  EXPECT_EQ(part.cause, Cause::queue);
  EXPECT_EQ(part.culprit, "to-component");
}

INSTANTIATE_TEST_SUITE_P(Kernel, Held, testing::Values(true, false), name_of_kernel);

// Of a middleware that sends a message again if it was lost.
class Resent : public Packets {
 protected:
  static constexpr std::int32_t resends = 12;
  Resent() {
    controller_threads_.push_back({{"tid", resends}, {"role", "timer"}});
    sender_wakes_and_sends();
  }
  void again(std::int64_t at, std::int32_t thread, std::int32_t packet) {
    event(at, 0, Kind::queued, thread, 0, "to-component", packet);
    event(at + us, 0, Kind::sent, thread, 0, "to-component", packet);
    event(at + 2 * us, 0, Kind::received, thread, 0, "to-controller", packet);
  }
};

TEST_P(Resent, ADroppedPacketThatIsResentIsDropped) {
  event(sent + 12 * us, 0, Kind::dropped, asks, 0, "NETFILTER_DROP", 1);
  again(sent + 10 * ms, asks, 2);  // the next message
  again(sent + 100 * ms, resends, 3);
  const auto account = this->account(late(0, 100 * ms, 0));
  const auto part = first(account.messages.at(0));
  EXPECT_EQ(part.cause, Cause::dropped);
  EXPECT_EQ(part.end, "component");
  EXPECT_EQ(part.culprit, "NETFILTER_DROP");
  EXPECT_EQ(part.ns, 100 * ms - 12 * us);
  EXPECT_THAT(account.groups.at(0).remedy.advice, HasSubstr("nft"));
}

TEST_P(Resent, DelayAfterTheResendIsNotOfTheDrop) {
  event(sent + 12 * us, 0, Kind::dropped, asks, 0, "NETFILTER_DROP", 1);
  again(sent + 40 * ms, resends, 3);
  event(sent + 40 * ms + 3 * us, 0, Kind::waking, answers, resends, "1");
  switched(sent + 100 * ms, 1, hog, "R", answers);
  const auto parts = message(late(0, 100 * ms, 0)).parts;
  ASSERT_GE(parts.size(), 2U);
  EXPECT_EQ(parts[0].cause, Cause::cpu);
  EXPECT_EQ(parts[0].culprit, "hog");
  EXPECT_EQ(parts[1].cause, Cause::dropped);
  EXPECT_EQ(parts[1].ns, 40 * ms - 12 * us);
}

TEST_P(Resent, ADropWithoutAResendIsUnknown) {
  event(sent + 12 * us, 0, Kind::dropped, asks, 0, "NETFILTER_DROP", 1);
  again(sent + 10 * ms, asks, 2);  // the next message
  EXPECT_EQ(first(message(late(0, 100 * ms, 0))).cause, Cause::unknown);
}

INSTANTIATE_TEST_SUITE_P(Kernel, Resent, testing::Values(true, false), name_of_kernel);

// Of messages that take several packets, on a link of a small MTU.
class Fragments : public Packets {
 protected:
  Fragments() { asked_ = {{"payload_bytes", 1000}}; }
  void fragment(std::int64_t at, std::int32_t packet, std::int32_t bytes, bool arrives = true) {
    for (const auto kind : {Kind::queued, Kind::sent, Kind::received}) {
      if (kind == Kind::received && !arrives) continue;
      event(at + (kind == Kind::queued ? 0
                  : kind == Kind::sent ? us
                                       : 3 * us),
            0, kind, asks, 0, kind == Kind::received ? "to-controller" : "to-component", packet);
      window_.events.back().bytes = bytes;
    }
  }
};

TEST_P(Fragments, ALaterFragmentThatIsDroppedLostTheMessage) {
  sender_wakes();
  fragment(sent + 5 * us, 1, 586);
  fragment(sent + 10 * us, 2, 490, false);
  event(sent + 12 * us, 0, Kind::dropped, asks, 0, "QDISC_DROP", 2);
  const auto part = first(message(lost()));
  EXPECT_EQ(part.cause, Cause::dropped);
  EXPECT_EQ(part.culprit, "QDISC_DROP");
}

TEST_P(Fragments, TheLastFragmentCompletesTheMessage) {
  sender_wakes();
  fragment(sent + 5 * us, 1, 586);
  event(sent + 10 * us, 0, Kind::queued, asks, 0, "to-component", 2);
  window_.events.back().bytes = 490;
  event(sent + 15 * ms, 0, Kind::sent, 0, 0, "to-component", 2);
  event(sent + 15 * ms + us, 0, Kind::received, 0, 0, "to-controller", 2);
  const auto part = first(message(late(0, 15 * ms, 0)));
  EXPECT_EQ(part.cause, Cause::queue);
  EXPECT_EQ(part.culprit, "to-component");
}

TEST_P(Fragments, TheNextMessageIsNotAFragmentOfThisOne) {
  asked_ = {{"payload_bytes", 500}};
  sender_wakes();
  fragment(sent + 5 * us, 1, 542);
  event(sent + 10 * ms, 0, Kind::queued, asks, 0, "to-component", 2);
  event(sent + 10 * ms + us, 0, Kind::dropped, asks, 0, "QDISC_DROP", 2);
  EXPECT_EQ(first(message(lost())).cause, Cause::unknown);
}

INSTANTIATE_TEST_SUITE_P(Kernel, Fragments, testing::Values(true, false), name_of_kernel);

// Of threaded NAPI.
class Napi : public Packets {
 protected:
  static constexpr std::int32_t napi = 7;
  void leaves_and_wakes_napi() {
    sender_wakes_and_queues();
    by_napi({.at_ns = sent + 7 * us, .cpu = 0, .kind = Kind::waking, .thread = {}, .other = named(asks)});
    window_.events.back().what = "1";
  }
  void by_napi(Event event) {
    event.thread = {napi, "napi/to-control", ordinary};
    window_.events.push_back(std::move(event));
  }
};

TEST_P(Napi, AStarvedThreadThatTakesPacketsInLostTheMessage) {
  timeout_us_ = 50'000;
  leaves_and_wakes_napi();
  event(sent + 60 * ms, 1, Kind::switched, hog, napi, "R");
  window_.events.back().other.name = "napi/to-control";
  const auto part = first(message(lost()));
  EXPECT_EQ(part.cause, Cause::cpu);
  EXPECT_EQ(part.culprit, "hog");
  EXPECT_EQ(part.stage, Stage::travelled);
  EXPECT_EQ(part.end, "component");
}

TEST_P(Napi, APacketThatTheKernelJoinedToAnotherIsReceivedWithIt) {
  for (const auto kind : {Kind::queued, Kind::sent, Kind::received})  // the same packet at both ends
    event(due - 100 * us, 0, kind, asks, 0, kind == Kind::received ? "to-controller" : "to-component", 3);
  leaves_and_wakes_napi();
  event(sent + 15 * ms - us, 1, Kind::switched, hog, napi, "R");
  by_napi({.at_ns = sent + 15 * ms,
           .cpu = 1,
           .kind = Kind::received,
           .thread = {},
           .other = {},
           .what = "to-controller",
           .packet = 9,
           .bytes = 1600});
  by_napi({.at_ns = sent + 15 * ms + us,
           .cpu = 1,
           .kind = Kind::dropped,
           .thread = {},
           .other = {},
           .what = "skb_release_data",
           .packet = 1});
  event(sent + 15 * ms + 2 * us, 1, Kind::waking, answers, napi, "1");
  const auto part = first(message(late(0, 15 * ms, 0)));
  EXPECT_EQ(part.cause, Cause::cpu);
  EXPECT_EQ(part.culprit, "hog");
  EXPECT_EQ(part.stage, Stage::travelled);
}

// Between two network cards a packet that arrives is not the one that was sent.
class Wire : public Packets {
 protected:
  void leaves() {
    sender_wakes_and_queues();
    comes(sent + 30 * us, 2);
  }
  void comes(std::int64_t at, std::int32_t packet) {
    event(at, 0, Kind::received, hog, 0, "to-controller", packet);
    window_.events.back().bytes = 536;  // without the header of the link
  }
};

TEST_P(Wire, APacketThatIsDroppedWhereItArrivesLostTheMessage) {
  leaves();
  event(sent + 35 * us, 0, Kind::dropped, hog, 0, "SOCKET_RCVBUFF", 2);
  comes(sent + 10 * ms, 3);  // the next message
  const auto part = first(message(lost()));
  EXPECT_EQ(part.cause, Cause::dropped);
  EXPECT_EQ(part.culprit, "SOCKET_RCVBUFF");
  EXPECT_EQ(part.end, "component");
}

TEST_P(Wire, APacketThatIsDroppedLaterByItsNumberIsAnother) {
  leaves();
  event(sent + 40 * us, 0, Kind::queued, hog, 0, "veth", 2);
  event(sent + 41 * us, 0, Kind::dropped, hog, 0, "SOCKET_RCVBUFF", 2);
  EXPECT_EQ(first(message(lost())).cause, Cause::unknown);
}

INSTANTIATE_TEST_SUITE_P(Kernel, Wire, testing::Values(true, false), name_of_kernel);

INSTANTIATE_TEST_SUITE_P(Kernel, Napi, testing::Values(true, false), name_of_kernel);

INSTANTIATE_TEST_SUITE_P(Kernel, Packets, testing::Values(true, false), name_of_kernel);

}  // namespace
}  // namespace ontime::explain
