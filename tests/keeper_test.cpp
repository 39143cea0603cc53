// SPDX-License-Identifier: Apache-2.0
#include "keeper/keeper.hpp"

#include <array>
#include <cstdlib>
#include <filesystem>
#include <string_view>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include "isolation/isolation.hpp"
#include "journal/journal.hpp"
#include "journal_fixture.hpp"
#include "keeper/flows.hpp"
#include "keeper/links.hpp"
#include "machine/machine.hpp"
#include "orders/frames.hpp"
#include "orders/orders.hpp"
#include "own_run.hpp"
#include "process/process.hpp"

namespace ontime::keeper {
namespace {

using namespace std::chrono_literals;
using nlohmann::json;
using orders::Coordinator;
using testing::HasSubstr;

// No other test's folders are in it.
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
  json end() { return ask("end", "ended", {{"links", json::object()}}); }
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

TEST(Links, ResetCountersAreAnError) {
  const background::Link::Counts before{.lost = 3, .sent_bytes = 5000};
  auto now = before;
  now.sent_bytes = 7000;
  EXPECT_EQ(account_of(before, now).beside_traffic->sent_bytes, 2000u);
  now.lost = 0;
  EXPECT_THROW(account_of(before, now), background::Error);
}

TEST_F(Keeper, ReportsMachineAndActivity) {
  EXPECT_FALSE(ask("open", "opened").at("machine").at("boot_id").get<std::string>().empty());
  ask("begin", "begun");
  const auto ended = end();
  EXPECT_TRUE(ended.at("conditions").contains("cpu_busy"));
  EXPECT_FALSE(ended.at("machine").at("boot_id").get<std::string>().empty());
  EXPECT_LT(std::abs(ended.at("machine").at("clock").at("moved_ns").get<std::int64_t>()), 1'000'000'000);
  EXPECT_TRUE(ended.at("hosts").empty());
  EXPECT_TRUE(ask("close", "closed").at("notes").empty());
}

TEST_F(Keeper, NamesTheCommandThatItHoldsTheMachineFor) {
  ask("open", "opened", {{"holder", {{"command", "anna@laptop: ontime run demo"}}}});
  ask("load", "loaded", {{"host", "controller"}, {"load", to_json(background::Workers{.cpu = 1})}});
  journal::Journal other;
  try {
    other.hold();
    ADD_FAILURE() << "the keeper holds the machine";
  } catch (const journal::Error& error) {
    EXPECT_THAT(error.what(), HasSubstr("(\"anna@laptop: ontime run demo\")"));
  }
}

TEST_F(Keeper, NamesAnOtherOntimeThatChangedTheMachineDuringTheRun) {
  const auto others = [this](const std::function<void()>& meanwhile) {
    ask("begin", "begun");
    meanwhile();
    return end().at("others");
  };
  ask("open", "opened", {{"holder", {{"pid", getpid()}, {"command", "ontime run one.yaml"}}}});
  ask("load", "loaded", {{"host", "controller"}, {"load", to_json(background::Workers{.cpu = 1})}});
  EXPECT_TRUE(others([] {}).empty()) << "its own journal is no other's";
  ask("unload", "unloaded");
  ask("close", "closed");
  journal::Journal other;
  other.held_for({getpid() + 1, "ontime run two.yaml"});
  EXPECT_EQ(others([&] { other.hold(); }), json({"\"ontime run two.yaml\""}));
  EXPECT_EQ(others([&] { other.revert(); }), json({"\"ontime run two.yaml\""}));
  EXPECT_TRUE(others([] {}).empty());
  other.held_for({getpid(), "ontime run one.yaml"});
  EXPECT_TRUE(others([&] { other.hold(); }).empty()) << "a keeper of the same run";
}

// The connection breaks while all is given back.
TEST(KeeperAtItsEnd, LineThatNothingReadIsToldAtTheNextStart) {
  std::array<int, 2> there{}, back{};
  ASSERT_EQ(pipe2(there.data(), O_CLOEXEC), 0);
  ASSERT_EQ(pipe2(back.data(), O_CLOEXEC), 0);
  const auto started = process::start({orders::this_program(), "keeper"}, {there[0], back[1], STDERR_FILENO});
  ASSERT_EQ(started.error, 0);
  ::close(there[0]);
  ::close(back[1]);
  orders::Frames frames(back[0], there[1]);
  frames.send({{"order", "open"}});
  const auto has_opened = [&] {
    while (const auto frame = frames.take())
      if (frame->message.value("event", "") == "opened") return true;
    return false;
  };
  while (!has_opened())
    if (!frames.fill()) std::this_thread::sleep_for(10ms);
  const auto path = journal::plant("of a later version\n");
  ::close(back[0]);
  frames.send({{"order", "close"}});
  EXPECT_EQ(test::status_of(started.pid), 0);
  ::close(there[1]);
  EXPECT_THAT(journal::revert_abandoned(kinds()), testing::ElementsAre(HasSubstr(path.string())));
  journal::unplant(path);
}

TEST_F(Keeper, LoadsForEachHostByItself) {
  ask("open", "opened");
  ask("load", "loaded", {{"host", "controller"}, {"load", to_json(background::Workers{.cpu = 1})}});
  ask("load", "loaded", {{"host", "component"}, {"load", to_json(background::Workers{.cpu = 1})}});
  ask("begin", "begun");
  const auto hosts = end().at("hosts");
  for (const auto* host : {"controller", "component"}) EXPECT_EQ(hosts.at(host).at("load_running"), true);
  EXPECT_EQ(folders_of_stress(), 2);
  EXPECT_TRUE(ask("unload", "unloaded").at("notes").empty());
  EXPECT_TRUE(end().at("hosts").empty());
  EXPECT_EQ(folders_of_stress(), 0) << "however many runs a suite has, its journal holds what there is";
}

TEST_F(Keeper, LargestFileOfHddWorkersIsToldAtTheEnd) {
  constexpr std::uint64_t bytes = 4 << 20;
  ask("open", "opened");
  ask("load", "loaded",
      {{"host", "controller"}, {"load", to_json(background::Workers{.hdd = 1, .hdd_bytes = bytes})}});
  // On a busy machine the worker needs a while until its first file is whole.
  auto seen = json::object();
  for (int i = 0; i < 300 && seen.value("hdd_file_bytes", json()) != bytes; ++i) {
    ask("begin", "begun");
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
    seen = end().at("hosts").at("controller").at("load");
  }
  EXPECT_EQ(seen, json({{"hdd_bytes", bytes}, {"hdd_file_bytes", bytes}}));
  EXPECT_TRUE(ask("unload", "unloaded").at("notes").empty());
}

TEST_F(Keeper, GoesOnAfterARefusedLoad) {
  ask("open", "opened");
  const auto load = [&](int workers) {
    return ask("load", "loaded",
               {{"host", "controller"}, {"load", to_json(background::Workers{.cpu = workers})}});
  };
  EXPECT_THAT(load(-1).value("error", ""), HasSubstr("-1 cpu"));
  EXPECT_TRUE(ask("unload", "unloaded").at("notes").empty());
  EXPECT_EQ(folders_of_stress(), 0);
  EXPECT_FALSE(load(1).contains("error"));
}

TEST_F(Keeper, RefusesASettingByItsNameAndGoesOn) {
  ask("open", "opened");
  const json link = {{"interface", ""}, {"network_namespace", ""}, {"peer", ""}, {"address", "127.0.0.1"}};
  const auto tune = [&](const json& wishes) {
    return ask("tune", "tuned", {{"host", "controller"}, {"link", link}, {"wishes", wishes}})
        .value("error", "");
  };
  EXPECT_THAT(tune({{"irq-cpus", "0"}}), HasSubstr("kernel.irq-cpus: "));
  EXPECT_THAT(tune({{"ksoftirqd", "100"}}), HasSubstr("kernel.ksoftirqd: "));
  EXPECT_TRUE(end().at("hosts").empty()) << "nothing was set";
  EXPECT_TRUE(ask("restore", "restored").at("notes").empty());
}

TEST_F(Keeper, NewIsolationReplacesOneThatWasNotRestored) {
  if (geteuid() != 0) GTEST_SKIP() << "groups are made by root alone";
  const auto isolate = [&](const std::string& host, int weight) {
    const auto wish = to_json(isolation::Wish{.cpus = "", .load_weight = weight});
    return ask("isolate", "isolated", {{"host", host}, {"link", nullptr}, {"wish", wish}}).value("error", "");
  };
  if (const auto why = isolate("controller", 10); !why.empty()) GTEST_SKIP() << why;
  EXPECT_EQ(isolate("component", 10), "") << "the same of each host of a machine";
  ask("begin", "begun");
  const auto before = end().at("hosts");
  EXPECT_EQ(before.at("controller"), before.at("component"));
  EXPECT_EQ(isolate("component", 20), "");
  ask("begin", "begun");
  const auto hosts = end().at("hosts");
  EXPECT_FALSE(hosts.contains("controller"));
  const auto& now = hosts.at("component").at("isolation")[0];
  EXPECT_NE(now.at("now"), before.at("component").at("isolation")[0].at("now"));
  EXPECT_EQ(now.at("now"), now.at("after"));
  EXPECT_TRUE(ask("restore", "restored").at("notes").empty());
}

TEST_F(Keeper, GoesOnWithoutAMissingLink) {
  const auto answer = ask("link", "linked",
                          {{"host", "controller"},
                           {"network_namespace", ""},
                           {"interface", "no-such-link"},
                           {"faults", to_json(background::Faults{})},
                           {"traffic_ports", {5201}},
                           {"by_ip", true}});
  EXPECT_THAT(answer.value("error", ""), HasSubstr("no-such-link"));
  ask("begin", "begun");
  EXPECT_TRUE(end().at("links").empty());
}

TEST_F(Keeper, SaysThatAnotherProgramChangedALink) {
  if (!machine::may_join_namespaces()) GTEST_SKIP() << "needs root";
  ask("open", "opened");
  const auto joined =
      ask("join", "joined", {{"components", {"component"}}, {"cable", nullptr}, {"wire", nullptr}});
  const auto& end = joined.at("hosts").at("controller");
  const auto linked = ask("link", "linked",
                          {{"host", "controller"},
                           {"network_namespace", "ontime-controller"},
                           {"interface", end.at("interface")},
                           {"faults", to_json(conditions::Faults{.loss = 0.01})},
                           {"traffic_ports", json::array()},
                           {"by_ip", true}});
  ASSERT_FALSE(linked.contains("error")) << linked;
  ASSERT_EQ(std::system("ip netns exec ontime-controller nft "
                        "'delete table netdev ontime-controller; add table netdev ontime-controller'"),
            0);
  const auto notes = ask("unload", "unloaded").at("notes");
  EXPECT_THAT(notes.dump(), HasSubstr("another program has changed it"));
}

TEST_F(Keeper, FailsWithoutALoadWorker) {
  keeper_.order("load", {{"host", "controller"}, {"load", to_json(background::Workers{.cpu = 1})}});
  EXPECT_THROW(coordinator_.until([] { return false; }), orders::Error);
}

TEST_F(Keeper, GivesNamespacesBackWhenThePipeBreaks) {
  if (!machine::may_join_namespaces()) GTEST_SKIP() << "network namespaces need root";
  {
    Coordinator::Hand other(coordinator_, "the other", {orders::this_program(), "keeper"}, "");
    other.order("join", {{"components", {"component"}}, {"cable", nullptr}, {"wire", nullptr}});
    const auto joined = coordinator_.await(other, "joined", 60s);
    EXPECT_EQ(joined.at("hosts").at("controller").at("place").at(3), "ontime-controller");
    EXPECT_TRUE(std::filesystem::exists("/run/netns/ontime-controller"));
  }
  EXPECT_FALSE(std::filesystem::exists("/run/netns/ontime-controller"));
}

// --- what was achieved ---

TEST(BitsPerSecond, AreAveragedOverTheReportedTime) {
  EXPECT_DOUBLE_EQ(*bits_per_second({1, 1e6}, {11, 801e6}, 10.1s, true), 80e6);
  EXPECT_DOUBLE_EQ(*bits_per_second({1, 1e6}, {1, 1e6}, 60s, true), 0) << "nothing moved any more";
  EXPECT_DOUBLE_EQ(*bits_per_second({0, 0}, {3, 240e6}, 4s, true), 80e6) << "its report is late";
  EXPECT_DOUBLE_EQ(*bits_per_second({0, 0}, {3, 240e6}, 4s, false), 60e6) << "it died";
}

TEST(BitsPerSecond, SilentTimeCountsAsWithoutTraffic) {
  EXPECT_DOUBLE_EQ(*bits_per_second({0, 0}, {10, 800e6}, 21s, true), 40e6);
}

TEST(BitsPerSecond, AreUnknownBeforeTheFirstReport) {
  EXPECT_FALSE(bits_per_second({1, 1e6}, {1, 1e6}, 100ms, true));
}

TEST_F(Keeper, ReportsTrafficOfBothEnds) {
  if (!std::filesystem::exists("/usr/bin/iperf3")) GTEST_SKIP() << "iperf3 is not installed";
  ask("open", "opened");
  background::Stream stream{.serves = true, .address = "127.0.0.1", .port = 7811};
  ask("traffic", "flowing", {{"host", "component"}, {"way", "to_component"}, {"stream", stream}});
  stream.serves = false;
  stream.bits_per_s = 4'000'000;
  stream.datagram_bytes = 1000;
  ask("traffic", "flowing", {{"host", "controller"}, {"way", "to_component"}, {"stream", stream}});
  ask("begin", "begun");
  json account;
  const auto flows = [&](const char* host) {
    const auto& rate = account[host]["to_component"]["bit_s"];
    return rate.is_number() && rate > 0;
  };
  for (int look = 0; look < 600 && !(flows("component") && flows("controller")); ++look) {
    std::this_thread::sleep_for(50ms);
    account = end().at("traffic");
  }
  for (const auto* host : {"controller", "component"}) {
    EXPECT_GT(account.at(host).at("to_component").at("bit_s"), 0);
    EXPECT_TRUE(account.at(host).at("to_component").at("running"));
  }
  ask("unload", "unloaded");
  EXPECT_TRUE(end().at("traffic").empty());
}

TEST(Words, AreUnchangedAfterJson) {
  const background::Workers workers{1, 2, 3, 4, 5, 6};
  EXPECT_EQ(to_json(workers_of(to_json(workers))), to_json(workers));
  EXPECT_EQ(to_json(workers).at("hdd_bytes"), 6);
  const background::Stream stream{{"ip", "netns"}, true, true, "10.0.0.1", "eth0", 1, 2, 3, 4};
  const nlohmann::json json = stream;
  EXPECT_EQ(nlohmann::json(json.get<background::Stream>()), json);
  EXPECT_EQ(json.at("priority"), 4);
  const background::Faults faults{0.1, 0.2, 3us, 4us, 0.5, true};
  EXPECT_EQ(faults_of(to_json(faults)), faults);
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
