// SPDX-License-Identifier: Apache-2.0
// Keys by their earlier names.
#include "campaign_scenario.hpp"

namespace ontime::campaign {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

using EarlierNames = ScenarioFile;

TEST_F(EarlierNames, AreReadAsTheCurrentOnesWithOneNoticeEach) {
  const auto scenario = read(
      "hosts: {component: {reach: [sudo], place: [env], address: 192.0.2.1}}\n"
      "defaults: {transport: cyclonedds, neighbours: {topics: 2}}\n"
      "runs:\n"
      "- {id: a, search: neighbours.rate, neighbours.rate: [1 Hz, 2 Hz]}\n"
      "- {id: b, adds-to: a}\n");
  EXPECT_THAT(scenario.hosts.at("component").host_prefix, ElementsAre("sudo"));
  EXPECT_THAT(scenario.hosts.at("component").command_prefix, ElementsAre("env"));
  ASSERT_EQ(scenario.runs.size(), 3U);
  EXPECT_EQ(scenario.runs[0].step.key, "background.rate");
  EXPECT_THAT(scenario.runs[0].varied, ElementsAre(testing::Pair("background.rate", "1 Hz")));
  EXPECT_EQ(scenario.runs[2].task.background.topics, 2);
  EXPECT_EQ(scenario.runs[2].adds_to, "a");
  ASSERT_EQ(scenario.notices.size(), 4U) << "one for each name, however often it is used";
  EXPECT_THAT(scenario.notices.at("neighbours"),
              testing::AllOf(HasSubstr(":2:"), HasSubstr("'neighbours'"), HasSubstr("'background'")));
  EXPECT_THAT(scenario.notices.at("adds-to"), testing::AllOf(HasSubstr(":5:"), HasSubstr("'baseline'")));
}

TEST_F(EarlierNames, AreReadBelowAComponentsName) {
  const auto scenario = read(
      "components: [arm, base]\n"
      "runs: [{id: a, transport: cyclonedds, arm: {neighbours: {topics: 3}}, base: {neighbours: {topics: "
      "1}}}]\n");
  const auto all = scenario::together(scenario.runs.at(0), scenario.hosts);
  ASSERT_EQ(all.size(), 2U);
  EXPECT_EQ(all[0].task.background.topics, 3);
  EXPECT_EQ(all[1].task.background.topics, 1);
  ASSERT_EQ(scenario.notices.size(), 1U) << "one for a name, of however many components";
  EXPECT_THAT(scenario.notices.at("neighbours"), HasSubstr("'background'"));
}

TEST_F(EarlierNames, OfAHostAreNoKeysOfARun) {
  EXPECT_THAT(error("runs: [{id: a, transport: udp, reach: b}]\n"), HasSubstr("unknown key 'reach'"));
  EXPECT_THAT(
      error("hosts: {component: {address: 192.0.2.1, neighbours: [a]}}\nruns: [{id: a, transport: udp}]\n"),
      HasSubstr("unknown key 'neighbours'"));
}

TEST_F(EarlierNames, TwoNamesOfOneKeyAreRefused) {
  EXPECT_THAT(
      error("runs: [{id: a, transport: cyclonedds, background: {topics: 1}, neighbours: {topics: 2}}]\n"),
      HasSubstr("'background.topics' occurs twice"));
  EXPECT_THAT(error("hosts: {component: {address: 192.0.2.1, place: [a], command-prefix: [b]}}\n"
                    "runs: [{id: a, transport: udp}]\n"),
              HasSubstr("'command-prefix' occurs twice"));
}

TEST_F(EarlierNames, AKeyInTwoPlacesIsRefused) {
  EXPECT_THAT(error("runs: [{id: a, transport: udp, qos: {depth: 1}, qos.depth: 2}]\n"),
              HasSubstr("'qos.depth' occurs twice"));
}

TEST_F(EarlierNames, CurrentNamesHaveNoNotice) {
  EXPECT_THAT(read("runs: [{id: a, transport: cyclonedds, background: {topics: 1}}]\n").notices, IsEmpty());
}

TEST(EarlierRecords, HaveKeysByTheirCurrentNames) {
  const auto run =
      conditions::run_of_record({{"search", {{"key", "neighbours.rate"}, {"value", "1 Hz"}}},
                                 {"varied", nlohmann::json::array({{"neighbours.where", "same-node"}})},
                                 {"neighbours", {{"topics", 4}}}});
  EXPECT_EQ(run.step.key, "background.rate");
  EXPECT_THAT(run.varied, ElementsAre(testing::Pair("background.where", "same-node")));
  EXPECT_EQ(run.task.background.topics, 4);
}

}  // namespace
}  // namespace ontime::campaign
