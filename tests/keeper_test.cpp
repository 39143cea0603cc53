// SPDX-License-Identifier: Apache-2.0
#include "keeper/keeper.hpp"

#include <filesystem>
#include <string_view>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include "machine/machine.hpp"
#include "orders/orders.hpp"
#include "own_run.hpp"

namespace ontime::keeper {
namespace {

using namespace std::chrono_literals;
using nlohmann::json;
using orders::Coordinator;
using testing::HasSubstr;

// Nobody else's folders are in it.
class OwnTemporary {
 public:
  OwnTemporary() {
    EXPECT_NE(mkdtemp(path_.data()), nullptr);
    test::set("TMPDIR", path_);
  }
  ~OwnTemporary() { std::filesystem::remove_all(path_); }
  OwnTemporary(const OwnTemporary&) = delete;
  OwnTemporary& operator=(const OwnTemporary&) = delete;
  const std::string& path() const { return path_; }

 private:
  std::string path_ = "/tmp/ontime-keeper-test-XXXXXX";
};

class Keeper : public testing::Test {
 protected:
  json ask(const std::string& order, const std::string& answer, json body = json::object()) {
    keeper_.order(order, std::move(body));
    return coordinator_.await(keeper_, answer, 60s);
  }
  int folders_of_stress() const {
    int folders = 0;
    for (const auto& entry : std::filesystem::directory_iterator(temporary_.path()))
      folders += entry.path().filename().string().starts_with("ontime-stress-") ? 1 : 0;
    return folders;
  }
  const OwnTemporary temporary_;
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
  EXPECT_EQ(folders_of_stress(), 2);
  EXPECT_TRUE(ask("unload", "unloaded").at("notes").empty());
  EXPECT_TRUE(ask("end", "ended").at("load_running").empty());
  EXPECT_EQ(folders_of_stress(), 0) << "however many runs a suite has, its journal holds what there is";
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
  testing::AddGlobalTestEnvironment(new ontime::test::OwnRun);
  return RUN_ALL_TESTS();
}
