// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>

#include "statistics_samples.hpp"

namespace ontime::statistics {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

TEST(Parts, NeedOneClock) {
  auto sample = answered(0, 1000 * ms, 0, 30 * us);
  sample.server_received_ns = sample.sent_ns + 12 * us;
  sample.server_sent_ns = sample.server_received_ns + 5 * us;
  const auto with = [&](const nlohmann::json& one, const nlohmann::json& other) {
    return summary_of({sample}, asked_next_free,
                      {{"hosts", {{"controller", {{"machine", one}}}, {"component", {{"machine", other}}}}}});
  };
  const auto same = with({{"boot_id", "a"}}, {{"boot_id", "a"}});
  ASSERT_TRUE(same.parts);
  EXPECT_TRUE(same.parts->one_clock);
  EXPECT_EQ(same.parts->there[Figure::p50], 12 * us);
  EXPECT_EQ(same.server[Figure::p50], 5 * us);
  EXPECT_EQ(same.parts->back[Figure::p50], 13 * us);
  EXPECT_EQ(same.parts->error_ns, 0);
  EXPECT_FALSE(with({{"boot_id", "a"}}, {{"boot_id", "b"}}).parts);
  for (const nlohmann::json& unknown :
       {nlohmann::json({{"boot_id", ""}}), nlohmann::json({{"boot_id", nullptr}}),
        nlohmann::json({{"boot_id", 7}}), nlohmann::json()}) {
    EXPECT_FALSE(with(unknown, unknown).parts) << unknown;
    EXPECT_EQ(with(unknown, unknown).no_parts, "") << unknown;
  }
}

TEST(Parts, SynchronisedClocksAddTheirErrors) {
  const auto clock = [](bool synchronised, const nlohmann::json& error_ns, std::int64_t offset_ns) {
    return nlohmann::json{{"clock",
                           {{"synchronised", synchronised},
                            {"source", "chrony"},
                            {"error_ns", error_ns},
                            {"realtime_offset_ns", offset_ns}}}};
  };
  const auto with = [&](std::int64_t there_ns, const nlohmann::json& one, const nlohmann::json& other) {
    auto sample = answered(0, 1000 * ms, 0, 30 * us);
    // The same moment is 7 s less on the server's clock.
    sample.server_received_ns = sample.sent_ns + there_ns - 7'000'000'000;
    sample.server_sent_ns = sample.server_received_ns + 5 * us;
    return summary_of({sample}, asked_next_free,
                      {{"hosts", {{"controller", {{"machine", one}}}, {"component", {{"machine", other}}}}}});
  };
  const auto client = clock(true, 2000, 1'000'000'000), server = clock(true, 3000, 8'000'000'000);
  const auto found = with(12 * us, client, server);
  ASSERT_TRUE(found.parts);
  EXPECT_FALSE(found.parts->one_clock);
  EXPECT_EQ(found.parts->error_ns, 5000);
  EXPECT_EQ(found.parts->there[Figure::p50], 12 * us);
  EXPECT_EQ(found.parts->back[Figure::p50], 13 * us);
  EXPECT_TRUE(with(-5 * us, client, server).parts) << "within what they say they may be off";
  const auto contradicted = with(-6 * us, client, server);
  EXPECT_FALSE(contradicted.parts);
  EXPECT_THAT(contradicted.no_parts, AllOf(HasSubstr("±5.0 µs"), HasSubstr("-6.0")));
  auto set = server;
  set["clock"]["moved_ns"] = -3000;
  EXPECT_TRUE(with(12 * us, client, set).parts) << "within what it says it may be off";
  set["clock"]["moved_ns"] = -3001;
  EXPECT_FALSE(with(12 * us, client, set).parts);
  EXPECT_THAT(with(12 * us, client, set).no_parts, HasSubstr("was set by -3.0 µs"));
  // By PTP each is off its grandmaster by so much: it must be the same one.
  const auto by_ptp = [](nlohmann::json machine, const nlohmann::json& grandmaster) {
    machine["clock"].update({{"source", "ptp"}, {"reference", grandmaster}});
    return machine;
  };
  EXPECT_TRUE(with(12 * us, by_ptp(client, "a"), by_ptp(server, "a")).parts);
  EXPECT_FALSE(with(12 * us, by_ptp(client, "a"), by_ptp(server, "b")).parts);
  EXPECT_FALSE(with(12 * us, by_ptp(client, nullptr), by_ptp(server, nullptr)).parts);
  EXPECT_FALSE(with(12 * us, by_ptp(client, "a"), server).parts);
  EXPECT_FALSE(with(12 * us, clock(false, 2000, 0), server).parts);
  EXPECT_FALSE(with(12 * us, client, clock(true, nullptr, 0)).parts);
  EXPECT_FALSE(with(12 * us, client, clock(true, -1, 0)).parts);
  EXPECT_FALSE(with(12 * us, client, nlohmann::json()).parts);
}

}  // namespace
}  // namespace ontime::statistics
