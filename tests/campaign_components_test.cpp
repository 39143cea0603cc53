// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include "campaign_scenario.hpp"

namespace ontime::campaign {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;

using Components = ScenarioFile;

const std::string runs = "\nruns: [{id: a, transport: udp}]\n";

std::vector<std::string> names(const Hosts& hosts) {
  std::vector<std::string> names;
  for (const auto& component : hosts.components) names.push_back(component.name);
  return names;
}

TEST_F(Components, IsOneWithoutAName) {
  EXPECT_THAT(names(read(runs).hosts), ElementsAre("component"));
  const auto run = with_component(read(runs).runs[0], "component");
  EXPECT_FALSE(is_named(run));
  EXPECT_EQ(run.variant, "");
  EXPECT_EQ(run.task.config.ping_topic, "/ping");
}

TEST_F(Components, OfNamespacesAreAListOfNames) {
  const auto hosts = read("components: [left_arm, base2]\nhosts: namespaces" + runs).hosts;
  EXPECT_EQ(hosts.kind, Hosts::Kind::namespaces);
  EXPECT_THAT(names(hosts), ElementsAre("left_arm", "base2"));
}

TEST_F(Components, OfHostsThatAreStatedAreAMap) {
  const auto hosts = read(
                         "hosts: {controller: {interface: eth1}}\n"
                         "components: {wheel: {ssh: w, address: 10.0.0.3}, arm: {address: 10.0.0.2}}" +
                         runs)
                         .hosts;
  EXPECT_THAT(names(hosts), ElementsAre("wheel", "arm")) << "as they were written";
  EXPECT_EQ(hosts.at("controller").interface, "eth1");
  EXPECT_EQ(hosts.at("wheel").ssh, "w");
  EXPECT_EQ(hosts.at("arm").address, "10.0.0.2");
}

TEST_F(Components, HaveTopicsAndAKeyOfTheirOwn) {
  const auto scenario = read(
      "components: [arm, base]\nruns: [{id: a, transport: fastdds, namespace: /robot, payload: [1 B, 2 "
      "B]}]\n");
  ASSERT_EQ(scenario.size(), 2u) << "all components are measured at one time";
  const auto arm = with_component(scenario.at(1), "arm"), base = with_component(scenario.at(1), "base");
  EXPECT_EQ(arm.task.config.ping_topic, "/robot/arm/ping");
  EXPECT_EQ(base.task.config.pong_topic, "/robot/base/pong");
  EXPECT_EQ(arm.variant, "payload 2 B, component arm");
  const auto key = [&](const campaign::Run& run) { return record::key_of(asked(run, scenario.hosts)); };
  EXPECT_NE(key(arm), key(base));
  EXPECT_EQ(asked(arm, scenario.hosts).at("component"), "arm");
  const auto by_address = with_component(read("components: [arm, base]" + runs).runs[0], "arm");
  EXPECT_EQ(by_address.task.config.ping_topic, "/ping") << "udp has no topics";
}

TEST_F(Components, AreRefusedInWords) {
  const auto of = [this](const std::string& components) { return error("components: " + components + runs); };
  EXPECT_THAT(of("arm"), AllOf(HasSubstr(":1:13: components: a list of names"), HasSubstr("[arm, base]")));
  EXPECT_THAT(of("[]"), HasSubstr("0 are named; there may be 1 to 32"));
  for (const auto* odd : {"Arm", "1st", "left-arm", "_a", "abcdefghijklm", "a/b"})
    EXPECT_THAT(of(std::string("[arm, ") + odd + "]"), AllOf(HasSubstr(":1:19: "), HasSubstr("is no name")))
        << odd;
  for (const auto* taken : {"controller", "component", "components"})
    EXPECT_THAT(of(std::string("[") + taken + "]"), HasSubstr("has a meaning already"));
  EXPECT_THAT(of("[arm, arm]"), HasSubstr("'arm' is there twice"));
  EXPECT_THAT(of("{arm: {address: 1.2.3.4}}"), HasSubstr("a list of names is needed"));
  EXPECT_THAT(error("hosts: loopback\ncomponents: [arm]" + runs),
              HasSubstr(":2:13: components: on loopback"));
  const std::string stated = "hosts: {controller: {}}\ncomponents: ";
  EXPECT_THAT(error(stated + "[arm]" + runs), HasSubstr("a map of names and hosts"));
  EXPECT_THAT(error(stated + "{arm: {interface: eth1}}" + runs), HasSubstr(":2:14: components: arm.address"));
  EXPECT_THAT(error(stated + "{arm: {wat: x}}" + runs), HasSubstr("a host has ssh"));
  EXPECT_THAT(error("hosts: {component: {address: 1.2.3.4}}\ncomponents: {arm: {address: 1.2.3.5}}" + runs),
              HasSubstr(":1:9: hosts: a component is stated here"));
}

TEST_F(Components, TakeNothingThatIsSaidOfALinkBetweenTwo) {
  const auto with = [this](const std::string& keys) {
    return error("components: [arm, base]\nruns:\n  - {id: a, transport: udp, " + keys + "}\n");
  };
  for (const auto* keys : {"traffic: {rate: 1 Mbit/s}", "link: {loss: 1 %}", "link: {cut: 1 s for 1 s}"})
    EXPECT_THAT(with(keys),
                AllOf(HasSubstr(":3:"), HasSubstr("cannot be said of components that have names")))
        << keys;
  EXPECT_THAT(with("explain: on"), HasSubstr(":3:38: explain: this cannot be said"));
  Selection selection;
  selection.explain = true;
  EXPECT_THAT(error("components: [arm]" + runs, selection), HasSubstr(":2:8: explain: this cannot be said"));
  EXPECT_EQ(with("load: {component: {cpu: 1}}, realtime: on, component: {restart: on}"), "no error");
}

TEST_F(Components, BehindABridgeTakeNothingThatIsOfItsPorts) {
  const std::string stated =
      "hosts: {controller: {}}\ncomponents: {a: {address: 10.0.0.1}, b: {address: 10.0.0.2}}";
  for (const auto* kernel : {"gro: on", "threaded-napi: on", "napi-threads: 50", "napi-cpus: 0"}) {
    const auto of = [&](const std::string& hosts) {
      return error(fmt::format("{}\nruns: [{{id: a, transport: udp, kernel: {{{}}}}}]\n", hosts, kernel));
    };
    EXPECT_THAT(of("components: [arm, base]"), HasSubstr("joined by a bridge")) << kernel;
    EXPECT_EQ(of("components: [arm]"), "no error");
    EXPECT_EQ(of(stated), "no error");
  }
}

TEST_F(Components, OverUdpHaveAddressesOfTheirOwn) {
  const auto of = [this](const std::string& transport) {
    return error("hosts: {controller: {}}\ncomponents: {arm: {address: robot}, base: {address: robot}}\n" +
                 ("runs: [{id: a, transport: " + transport + "}]\n"));
  };
  EXPECT_THAT(of("udp"), AllOf(HasSubstr(":3:8: run 'a'"), HasSubstr("arm and base have the same: robot")));
  EXPECT_EQ(of("cyclonedds"), "no error") << "it has topics";
}

TEST_F(Components, WithoutThatNameAreNowhere) {
  const auto hosts = read("components: [arm, base]" + runs).hosts;
  EXPECT_THROW(hosts.at("component"), std::out_of_range);
}

// What explain would make of threads that are gone.
TEST_F(Components, ThatAreStartedAgainAreNotExplained) {
  const std::string run = "runs: [{id: a, transport: udp, component: {restart: on}";
  EXPECT_THAT(error(run + ", explain: on}]\n"),
              AllOf(HasSubstr(":1:8: run 'a'"), HasSubstr("explain knows")));
  Selection selection;
  selection.explain = true;
  EXPECT_THAT(error(run + "}]\n", selection), HasSubstr("leave out explain, or component.restart"));
  EXPECT_TRUE(read("runs: [{id: a, transport: udp, explain: off}]\n", selection).runs[0].explain);
}

}  // namespace
}  // namespace ontime::campaign
