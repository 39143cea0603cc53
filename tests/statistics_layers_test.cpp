// SPDX-License-Identifier: Apache-2.0
#include <set>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "amend.hpp"
#include "campaign/campaign.hpp"
#include "statistics/statistics.hpp"

namespace ontime::statistics {
namespace {

using ::testing::HasSubstr;

Summary layer_run(const std::string& id, const std::string& adds_to, int repetition, std::int64_t p50_ns,
                  const nlohmann::json& thread = {},
                  const nlohmann::json& further = nlohmann::json::object()) {
  Summary summary;
  nlohmann::json conditions = {{"id", id}, {"transport", "t"}, {"payload_bytes", 500}};
  conditions.update(further);
  summary.run.key = conditions.dump();
  summary.run.asked = conditions;
  amend(summary.run.asked, {{"adds_to", adds_to}, {"repetition", repetition}});
  summary.run.outcome = nlohmann::json{{"hosts", {{"controller", {{"threads", {thread, thread}}}}}}};
  summary.sent = 10;
  summary.round_trip.count = 10;
  summary.round_trip[Figure::p50] = p50_ns;
  return summary;
}

std::string id_of(const Summary* summary) { return summary == nullptr ? "" : summary->run.asked.id; }

TEST(Layers, AreComparedRepetitionByRepetition) {
  std::vector<Summary> runs;
  for (int repetition = 1; repetition <= 3; ++repetition) {
    // The machine drifts by more than the layer costs; what the layer adds does not.
    runs.push_back(
        layer_run("below", "", repetition, 1000 * repetition, {{"cpu_time_us", 1}, {"instructions", 50}}));
    runs.push_back(layer_run("above", "below", repetition, 1000 * repetition + 10,
                             {{"cpu_time_us", 3}, {"instructions", nullptr}}));
    runs.push_back(layer_run("apart", "", repetition, 5));
  }
  const auto found = layers(runs).measured;
  ASSERT_EQ(found.size(), 2U);
  EXPECT_EQ(id_of(found[0].run), "below");
  EXPECT_FALSE(found[0].round_trip_ns.added);
  EXPECT_EQ(found[0].instructions.total->median, 10) << "both threads, a message";
  EXPECT_EQ(id_of(found[1].base), "below");
  EXPECT_EQ(found[1].round_trip_ns.total->median, 2010);
  EXPECT_EQ(found[1].round_trip_ns.added->median, 10);
  EXPECT_EQ(found[1].round_trip_ns.added->high, 10);
  EXPECT_EQ(found[1].cpu_ns.added->median, 400);
  EXPECT_FALSE(found[1].instructions.total) << "not counted is not zero";
}

TEST(Layers, OneIdGivesALayerForEachCondition) {
  std::vector<Summary> runs;
  for (int repetition = 1; repetition <= 3; ++repetition)
    for (const int payload : {500, 32768}) {
      runs.push_back(layer_run("below", "", repetition, payload, {}, {{"payload_bytes", payload}}));
      for (const auto* transport : {"a", "b"})
        runs.push_back(layer_run("above", "below", repetition, payload + (*transport == 'a' ? 10 : 20), {},
                                 {{"payload_bytes", payload}, {"transport", transport}}));
    }
  const auto found = layers(runs).measured;
  ASSERT_EQ(found.size(), 6u);
  for (const auto& layer : found) {
    ASSERT_EQ(layer.round_trip_ns.total->count, 3u);
    if (layer.adds_to.empty()) continue;
    EXPECT_EQ(layer.base->run.asked.task.client.payload_bytes,
              layer.run->run.asked.task.client.payload_bytes);
    EXPECT_EQ(layer.round_trip_ns.added->median, layer.run->run.asked.task.transport == "a" ? 10 : 20);
  }
}

TEST(Layers, AddToTheRunThatIsMostLikeThem) {
  std::vector<Summary> runs;
  for (const auto* rmw : {"one", "other"}) {
    runs.push_back(layer_run("below", "", 1, 100, {}, {{"options", {{"rmw", rmw}, {"executor", "wait"}}}}));
    runs.push_back(
        layer_run("above", "below", 1, 110, {}, {{"options", {{"rmw", rmw}, {"executor", "multi"}}}}));
  }
  for (const auto& layer : layers(runs).measured)
    if (layer.base != nullptr) {
      EXPECT_EQ(layer.base->run.asked.stated("options.rmw"), layer.run->run.asked.stated("options.rmw"));
    }

  // As like one as the other: nothing is guessed.
  runs.push_back(layer_run("third", "below", 1, 110, {}, {{"options", {{"executor", "multi"}}}}));
  const auto found = layers(runs).measured.back();
  EXPECT_EQ(found.base, nullptr);
  EXPECT_FALSE(found.round_trip_ns.added);
  EXPECT_THAT(found.no_base, HasSubstr("2 runs of 'below'"));
}

TEST(Layers, AreNotComparedWithOtherConditions) {
  const auto found = layers({layer_run("below", "", 1, 100, {}, {{"payload_bytes", 32768}}),
                             layer_run("above", "below", 1, 110)})
                         .measured;
  ASSERT_EQ(found.size(), 2u);
  EXPECT_FALSE(found[1].round_trip_ns.added);
  EXPECT_EQ(found[1].no_base, "no run of 'below' has the same payload");
}

TEST(Layers, DifferencesAreNamedAsInAScenario) {
  const auto found = layers({layer_run("below", "", 1, 100, {},
                                       {{"payload_bytes", 32768},
                                        {"ping_topic", "/x"},
                                        {"qos", {{"depth", 9}}},
                                        {"others", {{"lidar", {{"payload_bytes", 1}}}}}}),
                             layer_run("above", "below", 1, 110)})
                         .measured;
  ASSERT_EQ(found.size(), 2u);
  EXPECT_EQ(found[1].no_base, "no run of 'below' has the same components, payload, qos, topics.ping");
}

TEST(Layers, AreTheSameWhateverIsRequiredOfThem) {
  const auto found = layers({layer_run("below", "", 1, 100, {}, {{"require", {"late <= 0"}}, {"title", "x"}}),
                             layer_run("above", "below", 1, 110)})
                         .measured;
  ASSERT_EQ(found.size(), 2u);
  EXPECT_EQ(found[1].round_trip_ns.added->median, 10) << found[1].no_base;
}

TEST(Layers, CountTheRepetitionsOfEverySession) {
  std::vector<Summary> runs;
  for (int session = 0; session < 3; ++session)
    for (int repetition = 1; repetition <= 2; ++repetition) {
      runs.push_back(layer_run("below", "", repetition, 1000 * session + 100 * repetition));
      runs.push_back(layer_run("above", "below", repetition, 1000 * session + 100 * repetition + 10));
    }
  auto found = layers(runs).measured;
  EXPECT_EQ(found.at(0).round_trip_ns.total->count, 6u);
  EXPECT_EQ(found.at(1).round_trip_ns.added->count, 6u);
  EXPECT_EQ(found.at(1).round_trip_ns.added->low, 10);
  EXPECT_EQ(found.at(1).round_trip_ns.added->high, 10);

  // A session that measured one of the two alone, called otherwise, is compared with nothing.
  runs.insert(runs.begin(), layer_run("below", "", 1, 5000));
  amend(runs.front().run.asked, "/command_line", {"ontime", "run", "--only", "below"});
  found = layers(runs).measured;
  EXPECT_EQ(found.at(0).round_trip_ns.total->count, 7u);
  EXPECT_EQ(found.at(1).round_trip_ns.added->count, 6u);
  EXPECT_EQ(found.at(1).round_trip_ns.added->high, 10);
}

TEST(Layers, DoNotCountWhatWasNotMeasuredToItsEnd) {
  const std::vector<nlohmann::json> bad = {
      nullptr, {{"error", "no peer"}}, {{"interrupted", true}, {"hosts", nlohmann::json::object()}}};
  std::vector<Summary> runs = {layer_run("below", "", 1, 100), layer_run("above", "below", 1, 110)};
  for (const auto& outcome : bad) {
    runs.push_back(layer_run("below", "", 1, 999));
    runs.back().run.outcome = outcome;
    runs.push_back(layer_run("above", "below", 1, 1));
    runs.back().run.outcome = outcome;
  }
  const auto found = layers(runs).measured;
  ASSERT_EQ(found.size(), 2u);
  EXPECT_EQ(found[0].round_trip_ns.total->count, 1u);
  EXPECT_EQ(found[1].round_trip_ns.total->high, 110);
  EXPECT_EQ(found[1].round_trip_ns.added->median, 10);
  EXPECT_TRUE(layers(runs).missing.empty()) << "each was measured once";
}

TEST(Layers, MissingLayersAreNamedOnce) {
  std::vector<Summary> runs;
  for (int repetition = 1; repetition <= 3; ++repetition) {
    runs.push_back(layer_run("above", "below", repetition, 110));
    runs.push_back(layer_run("further", "above", repetition, 0));
    runs.back().run.outcome = nlohmann::json{{"error", "there is no transport 'ros2'"}};
    runs.push_back(layer_run("apart", "", repetition, 0));
    runs.back().run.outcome = nlohmann::json{{"error", "no peer"}};
  }
  const auto found = layers(runs);
  ASSERT_EQ(found.measured.size(), 1u);
  EXPECT_EQ(found.measured[0].no_base, "'below' was not measured");
  ASSERT_EQ(found.missing.size(), 2u);
  EXPECT_EQ(found.missing[0].id, "further");
  EXPECT_EQ(found.missing[0].reason, "there is no transport 'ros2'");
  EXPECT_EQ(found.missing[1].id, "below");
  EXPECT_EQ(found.missing[1].reason, "");
}

TEST(Layers, TakeAnyRecord) {
  for (const nlohmann::json& odd :
       {nlohmann::json(), nlohmann::json(7), nlohmann::json::array({1}),
        nlohmann::json({{"id", 7}, {"adds_to", 7}, {"repetition", "x"}, {"hosts", 7}, {"options", {1}}})}) {
    Summary summary;
    summary.run.asked = odd;
    summary.run.outcome = odd;
    auto below = summary;
    below.run.asked = nlohmann::json{{"id", "b"}, {"options", odd}, {"transport", odd}};
    EXPECT_NO_THROW(layers({summary, summary, below, layer_run("a", "b", 1, 1, odd)})) << odd;
  }
}

// "transport" (which brings its own options), "receive", "executor" …: in what a layer differs from its base.
std::set<std::string> differences(const nlohmann::json& layer, const nlohmann::json& base) {
  std::set<std::string> found;
  for (const auto& [key, value] : layer.items())
    if (base.at(key) != value) found.insert(key);
  for (const auto* varies : {"id", "title", "adds_to", "variant"}) found.erase(varies);
  if (found.contains("transport"))
    for (const auto* comes_with_it : {"options", "component_transport", "component_options"})
      found.erase(comes_with_it);
  if (found.erase("options") != 0) {
    EXPECT_EQ(layer.at("options"), layer.at("component_options")) << "both ends alike";
    found.erase("component_options");
    for (const auto& [option, value] : layer.at("options").items())
      if (base.at("options").at(option) != value) found.insert(option);
  }
  // rclcpp's executors wait by themselves, and are waited for by a listener; without one we wait.
  if (found.contains("executor")) found.erase("receive");
  return found;
}

class LayersScenario : public testing::TestWithParam<std::string> {};
INSTANTIATE_TEST_SUITE_P(, LayersScenario, testing::Values("layers", "security"),
                         [](const auto& one) { return one.param; });

TEST_P(LayersScenario, HasForEachLayerABaseThatDiffersInThatLayerAlone) {
  const auto scenario = campaign::read_scenario(ONTIME_SCENARIOS "/" + GetParam() + ".yaml", {});
  std::vector<Summary> runs;
  for (const auto& run : scenario.runs) {
    Summary summary;
    summary.run.asked = campaign::asked(run, {});
    summary.run.outcome = nlohmann::json::object();
    auto conditions = summary.run.asked.document;
    conditions.erase("repetition");
    summary.run.key = conditions.dump();
    runs.push_back(summary);
  }
  const auto found = layers(runs);
  EXPECT_TRUE(found.missing.empty());
  ASSERT_GT(found.measured.size(), 7u);
  for (const auto& layer : found.measured) {
    const auto& asked = layer.run->run.asked.document;
    if (asked.at("transport") == "ros2") {
      EXPECT_EQ(asked.at("options").at("statistics"), "off");
    }
    if (layer.adds_to.empty()) continue;
    ASSERT_NE(layer.base, nullptr) << asked.at("id") << layer.no_base;
    EXPECT_EQ(differences(asked, layer.base->run.asked.document).size(), 1u)
        << asked.at("id") << " against " << layer.adds_to << ": "
        << ::testing::PrintToString(differences(asked, layer.base->run.asked.document));
  }
}

}  // namespace
}  // namespace ontime::statistics
