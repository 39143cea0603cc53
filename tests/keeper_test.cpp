// SPDX-License-Identifier: Apache-2.0
#include "keeper/keeper.hpp"

#include <filesystem>
#include <string_view>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include "machine/machine.hpp"
#include "orders/orders.hpp"

namespace ontime::keeper {
namespace {

using namespace std::chrono_literals;
using nlohmann::json;
using orders::Coordinator;
using testing::HasSubstr;

class Keeper : public testing::Test {
 protected:
  json ask(const std::string& order, const std::string& answer, json body = json::object()) {
    keeper_.order(order, std::move(body));
    return coordinator_.await(keeper_, answer, 60s);
  }
  orders::Interrupts interrupts_{0};
  Coordinator coordinator_{interrupts_};
  Coordinator::Hand keeper_{coordinator_, "the keeper", {orders::this_program(), "keeper"}, ""};
};

TEST_F(Keeper, TellsWhatTheMachineIsAndHowBusyItWas) {
  EXPECT_FALSE(ask("open", "opened").at("machine").at("boot_id").get<std::string>().empty());
  ask("begin", "begun");
  const auto ended = ask("end", "ended");
  EXPECT_TRUE(ended.at("conditions").contains("cpu_busy"));
  EXPECT_TRUE(ended.at("load_running").empty());
  EXPECT_TRUE(ask("close", "closed").at("notes").empty());
}

TEST_F(Keeper, LoadsForEachHostByItself) {
  ask("open", "opened");
  ask("load", "loaded", {{"host", "controller"}, {"load", to_json({.cpu = 1})}});
  ask("load", "loaded", {{"host", "component"}, {"load", to_json({.cpu = 1})}});
  ask("begin", "begun");
  EXPECT_EQ(ask("end", "ended").at("load_running"), json({{"controller", true}, {"component", true}}));
  ask("unload", "unloaded");
  EXPECT_TRUE(ask("end", "ended").at("load_running").empty());
}

TEST_F(Keeper, SaysWhatItCannot) {
  keeper_.order("load", {{"host", "controller"}, {"load", to_json({})}});
  EXPECT_THROW(coordinator_.until([] { return false; }), orders::Error);
}

TEST_F(Keeper, GivesNamespacesBackWhenThePipeBreaks) {
  if (!machine::may_join_namespaces()) GTEST_SKIP() << "network namespaces need root";
  {
    Coordinator::Hand other(coordinator_, "the other", {orders::this_program(), "keeper"}, "");
    other.order("join");
    const auto joined = coordinator_.await(other, "joined", 60s);
    EXPECT_EQ(joined.at("controller").at("place").at(3), "ontime-controller");
    EXPECT_TRUE(std::filesystem::exists("/run/netns/ontime-controller"));
  }
  EXPECT_FALSE(std::filesystem::exists("/run/netns/ontime-controller"));
}

TEST(Words, SurviveTheirJourney) {
  const background::Workers workers{1, 2, 3, 4, 5, 6};
  EXPECT_EQ(to_json(workers_of(to_json(workers))), to_json(workers));
  EXPECT_EQ(to_json(workers).at("hdd_bytes"), 6);
}

}  // namespace
}  // namespace ontime::keeper

// The keepers of these tests are this program.
int main(int argc, char** argv) {
  if (argc > 1 && std::string_view(argv[1]) == "keeper") return ontime::keeper::serve();
  ontime::orders::on_termination([](int) { _exit(130); });
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
