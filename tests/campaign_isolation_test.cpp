// SPDX-License-Identifier: Apache-2.0
#include "campaign_scenario.hpp"

namespace ontime::campaign {
namespace {

using testing::HasSubstr;

class IsolationKeys : public ScenarioFile {
 protected:
  std::string refused(const std::string& keys) {
    return error("runs: [{id: a, transport: udp, " + keys + "}]");
  }
};

TEST_F(IsolationKeys, AreReadAndRecorded) {
  const auto scenario = read(
      "runs:\n"
      "  - {id: a, transport: udp, isolation: {cpus: [none, '1-2'], interrupts: off}}\n"
      "  - {id: b, transport: udp, isolation: {cpus: 2, interrupts: on, load-quota: 150 %, load-weight: "
      "10}}\n");
  ASSERT_EQ(scenario.runs.size(), 3U);
  EXPECT_FALSE(scenario.runs[0].isolation.any());
  EXPECT_TRUE(asked(scenario.runs[0], scenario.hosts).at("isolation").is_null());
  EXPECT_EQ(scenario.runs[1].isolation.cpus, "1-2");
  const auto& all = scenario.runs[2].isolation;
  EXPECT_EQ(all, (Isolation{"2", true, 1.5, 10}));
  EXPECT_EQ(asked(scenario.runs[2], scenario.hosts).at("isolation").at("load_quota"), 1.5);
}

TEST_F(IsolationKeys, InvalidValuesAndConflictsAreRefused) {
  EXPECT_THAT(refused("isolation: {cpus: x}"), HasSubstr("CPU list"));
  EXPECT_THAT(refused("isolation: {cpus: ' '}"), HasSubstr("CPU list"));
  EXPECT_THAT(refused("isolation: {interrupts: on}"), HasSubstr("needs isolation.cpus"));
  EXPECT_THAT(refused("isolation: {load-quota: 50}"), HasSubstr("such as '50 %'"));
  EXPECT_THAT(refused("isolation: {load-quota: 0 %}"), HasSubstr("from 1 to"));
  EXPECT_THAT(refused("isolation: {load-weight: 0}"), HasSubstr("from 1 to 10000"));
  EXPECT_THAT(refused("isolation: {cpus: 1, interrupts: on}, kernel: {irq-cpus: 0}"),
              HasSubstr("leave out one"));
  EXPECT_THAT(refused("isolation: {load-weight: 5}, traffic: {rate: 1 Mbit/s, priority: 5}"),
              HasSubstr("do not affect a real-time priority"));
  EXPECT_THAT(refused("isolation: {cpus: 1}, realtime: {cpus: 0-1}"), HasSubstr("cannot run on CPU 0"));
}

}  // namespace
}  // namespace ontime::campaign
