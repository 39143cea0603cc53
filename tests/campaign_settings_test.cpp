// SPDX-License-Identifier: Apache-2.0
#include "campaign_scenario.hpp"

namespace ontime::campaign {
namespace {

using testing::HasSubstr;

// --- settings of the kernel ---

TEST_F(ScenarioFile, KernelPresetIsRefinedAndAsIsRemovesASetting) {
  const auto scenario = read(
      "defaults: {transport: udp, kernel: {preset: paper}}\nruns:\n  - id: a\n  - {id: b, kernel: "
      "{ksoftirqd: 50, "
      "rmem-max: 8 MiB}}\n  - {id: c, kernel: {preset: none}}\n  - {id: d, kernel: {irq-threads: [as-is, "
      "95]}}\n");
  ASSERT_EQ(scenario.size(), 5U);
  EXPECT_EQ(scenario.runs[0].kernel, (settings::Wishes{{"irq-threads", "90"}, {"ksoftirqd", "60"}}));
  EXPECT_EQ(scenario.runs[1].kernel,
            (settings::Wishes{{"irq-threads", "90"}, {"ksoftirqd", "50"}, {"rmem-max", "8388608"}}));
  EXPECT_TRUE(scenario.runs[2].kernel.empty());
  EXPECT_EQ(scenario.runs[3].kernel, (settings::Wishes{{"ksoftirqd", "60"}}));
  EXPECT_EQ(scenario.runs[4].kernel.at("irq-threads"), "95");
  EXPECT_EQ(asked(scenario.runs[0], scenario.hosts).at("kernel").at("ksoftirqd"), "60");
  EXPECT_TRUE(asked(scenario.runs[2], scenario.hosts).at("kernel").is_null())
      << "as a version that knew of none";
}

TEST_F(ScenarioFile, TimeOfAKernelSettingMayHaveItsUnit) {
  const auto scenario = read(
      "runs: [{id: a, transport: udp, kernel: {busy-poll: 50, busy-read: 50 us}}, {id: b, transport: udp, "
      "kernel: {busy-poll: 1 ms}}]\n");
  EXPECT_EQ(scenario.runs[0].kernel, (settings::Wishes{{"busy-poll", "50"}, {"busy-read", "50"}}));
  EXPECT_EQ(scenario.runs[1].kernel, (settings::Wishes{{"busy-poll", "1000"}}));
}

TEST_F(ScenarioFile, InvalidKernelSettingsAreRefused) {
  for (const auto& [kernel, expected] :
       std::map<std::string, std::string>{{"preset: mine", "paper, none"},
                                          {"ksoftirqd: 100", "kernel.ksoftirqd: '100'"},
                                          {"busy-poll: 1 ns", "not a whole number of microseconds"},
                                          {"busy-poll: 2 s", "'2000000' is not a whole number from 0"},
                                          {"gro: maybe", "not on or off"},
                                          {"rmem-max: much", "kernel.rmem-max"},
                                          {"irq-thread: 9", "irq-threads"}})
    EXPECT_THAT(error("runs: [{id: a, transport: udp, kernel: {" + kernel + "}}]\n"), HasSubstr(expected))
        << kernel;
}

// --- isolation ---

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
  EXPECT_THAT(refused("isolation: {load-quota: 0 %}"), HasSubstr("from 1 % to"));
  EXPECT_THAT(refused("isolation: {load-weight: 0}"), HasSubstr("from 1 to 10000"));
  EXPECT_THAT(refused("isolation: {cpus: 1, interrupts: on}, kernel: {irq-cpus: 0}"),
              HasSubstr("leave out one"));
  EXPECT_THAT(refused("isolation: {load-weight: 5}, traffic: {rate: 1 Mbit/s, priority: 5}"),
              HasSubstr("do not affect a real-time priority"));
  EXPECT_THAT(refused("isolation: {cpus: 1}, realtime: {cpus: 0-1}"), HasSubstr("cannot run on CPU 0"));
}

}  // namespace
}  // namespace ontime::campaign
