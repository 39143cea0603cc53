// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "campaign/traffic.hpp"

namespace ontime::campaign {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

const Hosts two{Hosts::Kind::stated,
                {"", {}, {"left"}, "", "eth0", "10.0.0.1"},
                {"", {}, {"right"}, "", "eth1", "10.0.0.2:99"},
                {}};

TEST(Streams, TheComponentServesBothWays) {
  const Traffic traffic{.bits_per_s = 1000, .datagram_bytes = 100, .priority = 3};
  EXPECT_THAT(ways_of(traffic), ElementsAre("to_component", "to_controller"));
  EXPECT_TRUE(ways_of({}).empty());
  const auto serves = stream_of(traffic, "to_component", "component", two);
  EXPECT_TRUE(serves.serves);
  EXPECT_THAT(serves.place, ElementsAre("right"));
  EXPECT_EQ(serves.address, "10.0.0.2") << "the port is a transport's";
  const auto back = stream_of(traffic, "to_controller", "controller", two);
  EXPECT_FALSE(back.serves);
  EXPECT_TRUE(back.receives);
  EXPECT_THAT(back.place, ElementsAre("left"));
  EXPECT_NE(back.port, serves.port);
}

nlohmann::json both(double sent, nlohmann::json received, bool running = true) {
  return {{"controller", {{"to_component", {{"bit_s", sent}, {"running", running}}}}},
          {"component", {{"to_component", {{"bit_s", std::move(received)}, {"running", true}}}}}};
}

TEST(Achieved, IsWhatArrived) {
  const Traffic traffic{Traffic::Direction::to_component, 80'000'000};
  const auto enough = achieved(traffic, both(80e6, 76e6));
  EXPECT_EQ(enough.at("to_component").at("received_bit_s"), 76e6);
  EXPECT_TRUE(shortfalls(enough).empty());
  EXPECT_THAT(shortfalls(achieved(traffic, both(80e6, 75.9e6))),
              ElementsAre(HasSubstr("of 80 Mbit/s 80 were sent, and 75.9 arrived at the component")));
  EXPECT_THAT(shortfalls(achieved(traffic, both(80e6, nullptr))), ElementsAre(HasSubstr("unknown")))
      << "what nobody knows is not taken for achieved";
  EXPECT_THAT(shortfalls(achieved(traffic, both(80e6, 1e6, false))), ElementsAre(HasSubstr("died")));
  EXPECT_THAT(shortfalls(achieved(traffic, nlohmann::json::object())), ElementsAre(HasSubstr("NOT")));
  EXPECT_TRUE(achieved({}, both(1, 1)).empty());
}

}  // namespace
}  // namespace ontime::campaign
