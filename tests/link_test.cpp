// SPDX-License-Identifier: Apache-2.0
#include "campaign/link.hpp"

#include <chrono>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "campaign/pair.hpp"

namespace ontime::campaign {
namespace {

using nlohmann::json;
using testing::AllOf;
using testing::HasSubstr;

json host(std::uint64_t sent_bytes, std::uint64_t received_bytes, std::vector<std::string> segments = {},
          const std::string& boot = "one") {
  return {{"machine", {{"boot_id", boot}}},
          {"shared_memory", segments},
          {"link", {{"interface", "eth1"}, {"sent_bytes", sent_bytes}, {"received_bytes", received_bytes}}}};
}

// A hundred messages, of which one was lost.
json outcome(json controller, json component = nullptr) {
  json outcome{{"sent", 100}, {"on_time", 90}, {"late", 9}, {"lost", 1}, {"hosts", json::object()}};
  outcome["hosts"]["controller"] = std::move(controller);
  if (!component.is_null()) outcome["hosts"]["component"] = std::move(component);
  return outcome;
}

std::string found(const json& outcome) { return went_elsewhere(outcome, 500).value_or("nothing"); }

TEST(Link, AddressOfAnotherComponentIsRefusedUnlessItMayLeadToThisOne) {
  const Claim arm{"arm", "c1", "10.10.0.2", {"127.0.0.1", "10.10.0.2"}},
      base{"base", "c2", "10.10.0.3", {"127.0.0.1", "10.10.0.3"}};
  const auto with = [](Claim claim, const std::string& address) {
    claim.stated = address;
    return claim;
  };
  EXPECT_FALSE(at_another({arm, base}));
  EXPECT_THAT(at_another({with(arm, "10.10.0.3"), with(base, "10.10.0.2")}).value_or(""),
              AllOf(HasSubstr("10.10.0.3 is not an address of c1, but of base"), HasSubstr("10.10.0.2"),
                    testing::Not(HasSubstr("127."))));
  EXPECT_FALSE(at_another({with(arm, "192.168.1.9"), base})) << "a router's, which leads to it";
  EXPECT_FALSE(at_another({with(arm, "10.10.0.3:7950"), base})) << "a port that base leads to it";
  EXPECT_FALSE(at_another({with(arm, "127.0.0.1"), base})) << "each has one";
}

TEST(Link, LinkThatCarriedAllMessagesPasses) {
  EXPECT_EQ(found(outcome(host(60'000, 60'000), host(60'000, 60'000))), "nothing");
  EXPECT_EQ(found(outcome(host(60'000, 60'000))), "nothing");
  constexpr auto least = 99 * (500 + 30);
  EXPECT_EQ(found(outcome(host(least, least), host(least, least))), "nothing")
      << "what was lost need not have come, nor have left: a link that is down takes nothing";
}

TEST(Link, LinkThatCarriedTooLittleIsNamed) {
  EXPECT_THAT(found(outcome(host(52'469, 60'000))),
              AllOf(HasSubstr("did not go over eth1"), HasSubstr("99 messages of 500 bytes were answered"),
                    HasSubstr("52469 bytes sent there by the controller")));
  EXPECT_THAT(found(outcome(host(60'000, 0))), HasSubstr("received there by the controller"));
  EXPECT_THAT(found(outcome(host(60'000, 60'000), host(0, 60'000))),
              HasSubstr("sent there by the component"));
  EXPECT_THAT(found(outcome(host(0, 0, {"fastrtps_port7411"}))),
              HasSubstr("shared memory (fastrtps_port7411)"));
}

TEST(Link, LinkWithoutMessagesIsNamedEvenWithoutPayload) {
  const auto without_payload = [](const json& of) { return went_elsewhere(of, 0).value_or("nothing"); };
  EXPECT_THAT(without_payload(outcome(host(0, 0))), HasSubstr("did not go over eth1"));
  EXPECT_EQ(without_payload(outcome(host(99 * 30, 99 * 30))), "nothing");
}

TEST(Link, NotesOfACutSayNothingOfATimeAfterTheRun) {
  using namespace std::chrono_literals;
  conditions::Run run;
  run.task.client.duration = 2s;
  const auto notes = [&](std::chrono::nanoseconds at, std::chrono::milliseconds length) {
    run.cut = {at, length};
    std::vector<std::pair<std::string, std::int64_t>> found;
    for (const auto& note : notes_of_cut(run, 5'000'000)) found.emplace_back(note.text, *note.at_ns);
    return found;
  };
  using testing::ElementsAre, testing::Pair;
  EXPECT_THAT(notes(1ms, 500ms),
              ElementsAre(Pair("link cut for 500 ms", 5'000'000), Pair("link restored", 505'000'000)));
  const auto to_the_end = ElementsAre(Pair("link cut until the end of the run", 5'000'000));
  EXPECT_THAT(notes(1ms, 10s), to_the_end);
  EXPECT_THAT(notes(1500ms, 500ms), to_the_end);
}

TEST(Link, BackgroundTopicsCountTowardsTheLink) {
  auto controller = host(63'000, 63'000), component = host(63'000, 63'000);
  controller["neighbours"] = {{"received", 10}, {"payload_bytes", 1000}};
  component["neighbours"] = {{"received", 10}, {"payload_bytes", 1000}};
  EXPECT_EQ(found(outcome(controller, component)), "nothing");
  component["neighbours"]["received"] = 11;
  EXPECT_THAT(found(outcome(controller, component)),
              AllOf(HasSubstr("11330 bytes of background topics"), HasSubstr("by the component")));
}

TEST(Link, RestartedEndCountsItsOwnAnswers) {
  auto again = host(40 * 530, 40 * 530);
  again["started_again"] = true;
  again["answered"] = 40;
  EXPECT_EQ(found(outcome(host(60'000, 60'000), again)), "nothing");
  again["answered"] = 41;
  EXPECT_THAT(found(outcome(host(60'000, 60'000), again)),
              HasSubstr("41 messages of 500 bytes were answered"));
  again["answered"] = 200;
  EXPECT_THAT(found(outcome(host(60'000, 60'000), again)),
              HasSubstr("99 messages of 500 bytes were answered"));
}

TEST(Link, LaunchTimesThatWereNotAppliedFailTheRun) {
  auto controller = host(60'000, 60'000), component = host(60'000, 60'000);
  component["answered"] = 90;
  controller["link"]["etf"] = {{"launched_frames", 95}, {"dropped_frames", 5000}};
  component["link"]["etf"] = {{"launched_frames", 500}, {"dropped_frames", 0}};
  const auto found = [&] {
    auto one = outcome(controller, component);
    one["refused_sends"] = 4;
    return went_past_etf(one).value_or("nothing");
  };
  EXPECT_EQ(found(), "nothing");
  controller["link"]["etf"]["launched_frames"] = 94;
  EXPECT_EQ(found(), "nothing") << "one is lost, and the last may not be counted yet";
  controller["link"]["etf"]["launched_frames"] = 93;
  EXPECT_THAT(found(), AllOf(HasSubstr("the controller sent 96"), HasSubstr("93 frames"),
                             HasSubstr("link.message-priority")));
  controller["link"]["gone"] = "another process removed it";
  component["link"]["etf"]["launched_frames"] = 0;
  EXPECT_THAT(found(), HasSubstr("the component sent 90"));
}

TEST(Link, AnswersOfAnotherProgramFailTheRun) {
  auto component = host(60'000, 60'000);
  const auto with = [&](std::uint64_t answered) {
    component["answered"] = answered;
    return found(outcome(host(60'000, 60'000), component));
  };
  EXPECT_EQ(with(120), "nothing") << "others may ask it as well";
  EXPECT_EQ(with(98), "nothing") << "the last may not be counted yet";
  EXPECT_THAT(with(97),
              AllOf(HasSubstr("answered 97"), HasSubstr("99 answers"), HasSubstr("another program")));
  EXPECT_THAT(with(0), HasSubstr("another program"));
}

// Other traffic on the link may make up for what is missing.
TEST(Link, SharedMemoryAtBothEndsOfOneMachineFailsTheRun) {
  const std::vector<std::string> segments{"fastrtps_port7411"};
  const auto busy = host(9'000'000, 9'000'000, segments);
  EXPECT_THAT(found(outcome(busy, busy)),
              AllOf(HasSubstr("both ends"), HasSubstr("shared memory (fastrtps_port7411)")));
  EXPECT_EQ(found(outcome(busy, host(9'000'000, 9'000'000))), "nothing");
  EXPECT_EQ(found(outcome(busy, host(9'000'000, 9'000'000, segments, "another"))), "nothing");
}

TEST(Link, TrafficIsLeftOutOfTheCheck) {
  auto busy = host(9'000'000, 9'000'000);
  auto with = outcome(busy, busy);
  const std::set<std::string> both{"controller", "component"};
  EXPECT_THAT(unproved(with, both).value_or(""), HasSubstr("not verified that the messages used eth1"));
  for (auto& end : with["hosts"])
    end["link"]["beside_traffic"] = {{"sent_bytes", 60'000}, {"received_bytes", 60'000}};
  EXPECT_FALSE(unproved(with, both));
  EXPECT_EQ(found(with), "nothing");
  with["hosts"]["component"]["link"]["beside_traffic"]["received_bytes"] = 0;
  EXPECT_THAT(found(with), HasSubstr("received there by the component"))
      << "it was the traffic that was counted";
  EXPECT_FALSE(unproved(outcome(busy, busy), {}));
}

TEST(Link, TrafficOfAnotherComponentThatIsCountedVerifiesNothing) {
  auto counted = host(9'000'000, 9'000'000), not_counted = counted;
  counted["link"]["beside_traffic"] = {{"sent_bytes", 60'000}, {"received_bytes", 60'000}};
  EXPECT_FALSE(unproved(outcome(counted, not_counted), {"controller"})) << "the component's has none";
  EXPECT_THAT(unproved(outcome(counted, not_counted), {"controller", "component"}).value_or(""),
              HasSubstr("the component cannot count them"));
}

TEST(Link, LostCountersVerifyNothing) {
  auto gone = host(60'000, 60'000);
  gone["link"]["gone"] = "another process removed the rules";
  EXPECT_THAT(unproved(outcome(gone, gone), {}).value_or(""),
              AllOf(HasSubstr("eth1"), HasSubstr("another process removed the rules")));
  gone["link"] = {{"interface", "eth1"}, {"gone", "the interface is not there any more"}};
  EXPECT_TRUE(unproved(outcome(gone, host(60'000, 60'000)), {}));
  EXPECT_EQ(found(outcome(gone, host(60'000, 60'000))), "nothing");
}

TEST(Link, WithoutInterfaceVerifiesNothing) {
  auto any = host(0, 0, {"fastrtps_port7411"});
  any["link"] = nullptr;
  EXPECT_EQ(found(outcome(any, any)), "nothing");
}

}  // namespace
}  // namespace ontime::campaign
