// SPDX-License-Identifier: Apache-2.0
#include <set>

#include <fmt/format.h>

#include "campaign_scenario.hpp"
#include "record/record.hpp"

namespace ontime::campaign {
namespace {

using namespace std::chrono_literals;
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

TEST_F(Components, DefaultIsOneUnnamedComponent) {
  EXPECT_THAT(names(read(runs).hosts), ElementsAre("component"));
  const auto run = with_component(read(runs).runs[0], "component");
  EXPECT_FALSE(is_named(run));
  EXPECT_EQ(run.variant, "");
  EXPECT_EQ(run.task.config.ping_topic, "/ping");
}

TEST_F(Components, NamespacesTakeAListOfNames) {
  const auto hosts = read("components: [left_arm, base2]\nhosts: namespaces" + runs).hosts;
  EXPECT_EQ(hosts.kind, Hosts::Kind::namespaces);
  EXPECT_THAT(names(hosts), ElementsAre("left_arm", "base2"));
}

TEST_F(Components, StatedHostsTakeAMapInFileOrder) {
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

TEST_F(Components, EachHasItsOwnTopicsAndKey) {
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

TEST_F(Components, InvalidNamesAndFormsAreRefusedWithTheirPlace) {
  const auto of = [this](const std::string& components) { return error("components: " + components + runs); };
  EXPECT_THAT(of("arm"), AllOf(HasSubstr(":1:13: components: a list of names"), HasSubstr("[arm, base]")));
  EXPECT_THAT(of("[]"), HasSubstr("1 to 32"));
  for (const auto* odd : {"Arm", "1st", "left-arm", "_a", "abcdefghijklm", "a/b"})
    EXPECT_THAT(of(std::string("[arm, ") + odd + "]"),
                AllOf(HasSubstr(":1:19: "), HasSubstr("is not a name")))
        << odd;
  for (const auto* taken : {"controller", "component", "components", "link", "traffic", "qos", "period",
                            "options", "require", "id", "kernel", "controller_2"})
    EXPECT_THAT(of(std::string("[") + taken + "]"), HasSubstr("is already the name of a key"));
  EXPECT_THAT(of("[arm, arm]"), HasSubstr("'arm' occurs twice"));
  EXPECT_THAT(of("{arm: {address: 1.2.3.4}}"), HasSubstr("a list of names is needed"));
  EXPECT_THAT(error("hosts: loopback\ncomponents: [arm]" + runs), HasSubstr(":2:13: components: loopback"));
  const std::string stated = "hosts: {controller: {}}\ncomponents: ";
  EXPECT_THAT(error(stated + "[arm]" + runs), HasSubstr("a map of names and hosts"));
  EXPECT_THAT(error(stated + "{arm: {interface: eth1}}" + runs), HasSubstr(":2:14: components: arm.address"));
  EXPECT_THAT(error(stated + "{arm: {wat: x}}" + runs), HasSubstr("allowed keys: ssh"));
  EXPECT_THAT(error("hosts: {component: {address: 1.2.3.4}}\ncomponents: {arm: {address: 1.2.3.5}}" + runs),
              HasSubstr(":1:9: hosts: component"));
}

TEST_F(Components, RunKeysApplyToAllComponents) {
  const auto with = [this](const std::string& keys) {
    return error("components: [arm, base]\nruns:\n  - {id: a, transport: udp, " + keys + "}\n");
  };
  for (const auto* keys :
       {"traffic: {rate: 1 Mbit/s}", "link: {loss: 1 %}", "link: {cut: 1 s for 1 s}", "explain: on",
        "load: {component: {cpu: 1}}, realtime: on, component: {restart: on}"})
    EXPECT_EQ(with(keys), "no error") << keys;
}

// --- conditions of their own ---

TEST_F(Components, OwnKeysOverrideRunAndDefaults) {
  const auto scenario = read(
      "defaults:\n"
      "  transport: udp\n"
      "  arm: {period: 1 ms, deadline: 1 ms, qos: {reliability: reliable}, traffic: {rate: 1 Mbit/s}}\n"
      "components: [arm, base]\n"
      "runs:\n"
      "  - {id: a, period: 20 ms, realtime: on, base: {payload: 1 B}, arm: {transport: fastdds, realtime: "
      "off}}\n"
      "  - {id: b, arm: {period: 2 ms}}\n");
  ASSERT_EQ(scenario.size(), 2u);
  const auto a = together(scenario.at(0), scenario.hosts), b = together(scenario.at(1), scenario.hosts);
  ASSERT_EQ(a.size(), 2u);
  const auto& arm = a[0];
  EXPECT_EQ(arm.component, "arm");
  EXPECT_EQ(arm.task.transport, "fastdds");
  EXPECT_EQ(arm.task.config.ping_topic, "/arm/ping");
  EXPECT_EQ(arm.task.client.period, 1ms);
  EXPECT_EQ(arm.task.client.deadline, 1ms);
  EXPECT_EQ(arm.task.config.qos.reliability, transport::Reliability::reliable);
  EXPECT_EQ(arm.traffic.bits_per_s, 1'000'000u);
  EXPECT_FALSE(arm.task.realtime.on);
  EXPECT_EQ(arm.variant, "component arm");
  const auto& base = a[1];
  EXPECT_EQ(base.task.transport, "udp");
  EXPECT_EQ(base.task.client.period, 20ms);
  EXPECT_EQ(base.task.client.payload_bytes, 1u);
  EXPECT_EQ(base.task.config.qos.reliability, transport::Reliability::best_effort);
  EXPECT_EQ(base.traffic.bits_per_s, 0u);
  EXPECT_TRUE(base.task.realtime.on);
  EXPECT_EQ(b[0].task.client.period, 2ms) << "what the run says of it, before what holds for all runs";
  EXPECT_EQ(b[1].task.client.period, 10ms);
}

TEST_F(Components, OwnRealtimeAppliesWhereTheRunHasNone) {
  const auto scenario = read(
      "components: [arm, base]\n"
      "runs: [{id: a, transport: udp, realtime: off, arm: {realtime: {priority: 50}}}]\n");
  const auto all = together(scenario.at(0), scenario.hosts);
  EXPECT_EQ(all[0].task.realtime.threads.at("send").priority, 50);
  EXPECT_FALSE(all[1].task.realtime.on);
}

TEST_F(Components, VariantNamesOwnListsAndBesideTheOthers) {
  const auto scenario = read(
      "components: [arm, base]\n"
      "runs: [{id: a, transport: [udp, cyclonedds], payload: [1 B, 2 B], arm: {transport: udp, payload: 3 "
      "B}, "
      "base: {period: [1 ms, 2 ms]}}]\n");
  ASSERT_EQ(scenario.size(), 8u);
  std::set<std::string> keys;
  for (std::size_t i = 0; i < scenario.size(); ++i)
    for (const auto& run : together(scenario.at(i), scenario.hosts))
      keys.insert(record::key_of(asked(run, scenario.hosts)));
  EXPECT_EQ(keys.size(), 16u) << "none is taken for another when a suite is resumed";
  const auto last = together(scenario.at(7), scenario.hosts);
  EXPECT_EQ(last[0].variant, "component arm");
  EXPECT_EQ(last[0].beside, "transport cyclonedds, payload 2 B, base.period 2 ms");
  EXPECT_EQ(last[1].variant, "payload 2 B, period 2 ms, component base");
  EXPECT_EQ(last[1].beside, "");
  EXPECT_EQ(scenario.at(7).variant, "payload 2 B, base.period 2 ms");
}

std::set<std::string> keys_of(const Scenario& scenario) {
  std::set<std::string> keys;
  for (std::size_t i = 0; i < scenario.size(); ++i)
    for (const auto& record : asked(together(scenario.at(i), scenario.hosts), scenario.hosts))
      keys.insert(record::key_of(record));
  return keys;
}

TEST_F(Components, ComponentWithoutOwnKeysHasOneKeyPerValueOfOthers) {
  const auto scenario =
      read("components: [arm, base]\nruns: [{id: a, transport: udp, arm: {period: [1 ms, 2 ms]}}]\n");
  const auto last = together(scenario.at(1), scenario.hosts);
  EXPECT_EQ(last[1].variant, "component base");
  EXPECT_EQ(last[1].beside, "arm.period 2 ms");
  std::set<std::string> keys;
  for (const std::size_t number : {0U, 1U})
    keys.insert(record::key_of(asked(together(scenario.at(number), scenario.hosts)[1], scenario.hosts)));
  EXPECT_EQ(keys.size(), 2u) << "by its words alone";
  EXPECT_EQ(keys_of(scenario).size(), 4u);
}

TEST_F(Components, ConditionsOfOthersArePartOfTheKey) {
  const auto of = [this](const std::string& base, const std::string& components = "[arm, base]") {
    const auto scenario =
        read("components: " + components + "\nruns: [{id: a, transport: udp, " + base + "}]\n");
    return asked(together(scenario.at(0), scenario.hosts), scenario.hosts).at(0);
  };
  const auto alone = of("base: {traffic: {rate: 40 Mbit/s}}");
  EXPECT_EQ(alone["component"], "arm");
  EXPECT_EQ(alone["others"]["base"]["traffic"]["bit_s"], 40'000'000);
  EXPECT_FALSE(alone["others"]["base"].contains("period_us")) << "which is the arm's as well";
  const auto both = of("traffic: {rate: 40 Mbit/s}");
  EXPECT_EQ(of("traffic: {rate: 40 Mbit/s}, base: {traffic: {priority: 5}}")["others"]["base"]["traffic"]
                                                                            ["priority"],
            5);
  const std::set<std::string> keys{
      record::key_of(alone), record::key_of(both), record::key_of(of("base: {traffic: {rate: 20 Mbit/s}}")),
      record::key_of(of("period: 10 ms")), record::key_of(of("period: 10 ms", "[arm, base, hand]"))};
  EXPECT_EQ(keys.size(), 5u);
  EXPECT_EQ(record::key_of(alone), record::key_of(of("base: {traffic: {rate: 40000 kbit/s}}")));
  EXPECT_TRUE(of("period: 10 ms", "[arm]")["others"].is_null());
  const auto without = of("component: {restart: off}, arm: {component: {restart: on}}");
  EXPECT_EQ(without["others"]["base"]["component_restart"], "none") << "what it alone has";
}

TEST_F(Components, OwnSettingOverridesDetailedSettingOfAll) {
  const auto scenario = read(
      "components: [arm, base]\n"
      "runs: [{id: a, transport: udp, realtime: {send: {priority: 70}}, arm: {realtime: {priority: 50}}}]\n");
  const auto all = together(scenario.at(0), scenario.hosts);
  EXPECT_EQ(all[0].task.realtime.threads.at("send").priority, 50);
  EXPECT_EQ(all[1].task.realtime.threads.at("send").priority, 70);
}

TEST_F(Components, MistypedNameIsRecognized) {
  EXPECT_THAT(error("components: [arm, base]\nruns: [{id: a, transport: udp, arn: {period: 2 ms}}]\n"),
              HasSubstr("unknown key 'arn.period' (did you mean 'arm'?)"));
}

TEST_F(Components, SearchOfOwnTransportIsRefused) {
  EXPECT_THAT(
      error("components: [arm, base]\n"
            "runs: [{id: a, transport: udp, search: arm.transport, arm: {transport: [udp, fastdds]}}]\n"),
      HasSubstr("search: transports have no order"));
}

TEST_F(Components, OwnGatesReplaceThoseOfTheRun) {
  const auto scenario = read(
      "components: [arm, base]\n"
      "runs: [{id: a, transport: udp, require: late <= 5, arm: {require: [late <= 0, lost <= 0]}}]\n");
  const auto all = together(scenario.at(0), scenario.hosts);
  EXPECT_THAT(all[0].require, ElementsAre("late <= 0", "lost <= 0"));
  EXPECT_THAT(all[1].require, ElementsAre("late <= 5"));
}

TEST_F(Components, RepetitionAndSearchStepAreTheSameForAll) {
  const auto scenario = read(
      "components: [arm, base]\nrepeat: 2\n"
      "runs: [{id: a, transport: udp, search: arm.period, arm: {period: [9 ms, 8 ms, 7 ms]}}]\n");
  const auto all = together(scenario.at(5), scenario.hosts);
  for (const auto& run : all) {
    EXPECT_EQ(run.repetition, 2);
    EXPECT_EQ(run.step.key, "arm.period");
    EXPECT_EQ(run.step.number, 2);
  }
  EXPECT_EQ(all[0].task.client.period, 7ms);
  EXPECT_EQ(all[1].task.client.period, 10ms);
}

TEST_F(Components, SelectedTransportReplacesOwnTransports) {
  Selection selection;
  selection.transports = {"cyclonedds"};
  const auto scenario = read(
      "components: [arm, base]\nruns: [{id: a, transport: udp, arm: {transport: fastdds}}]\n", selection);
  for (const auto& run : together(scenario.at(0), scenario.hosts))
    EXPECT_EQ(run.task.transport, "cyclonedds");
}

TEST_F(Components, OwnKeyThatIsCommonToAllIsRefusedByName) {
  const auto with = [this](const std::string& keys, const std::string& components = "[arm, base]") {
    return error("components: " + components + "\nruns:\n  - {id: a, transport: udp, arm: {" + keys + "}}\n");
  };
  EXPECT_THAT(with("duration: 1 s"),
              AllOf(HasSubstr(":3:35: arm.duration: "), HasSubstr("at the same time")));
  EXPECT_THAT(with("explain: on"), HasSubstr("arm.explain: cannot"));
  EXPECT_THAT(with("kernel: {gro: on}"), HasSubstr("arm.kernel.gro: cannot"));
  EXPECT_THAT(with("isolation: {cpus: 0}"), HasSubstr("arm.isolation.cpus: cannot"));
  EXPECT_THAT(with("load: {controller: {cpu: 1}}"),
              AllOf(HasSubstr("arm.load.controller.cpu: "), HasSubstr("share the controller")));
  EXPECT_THAT(with("id: b"), HasSubstr("arm.id: cannot"));
  EXPECT_THAT(with("search: period"), HasSubstr("search: NAME.KEY"));
  EXPECT_THAT(with("link: {message-priority: 1}"), HasSubstr("arm.link.message-priority: cannot"));
  EXPECT_EQ(with("link: {message-priority: 1}", "[arm]"), "no error");
  EXPECT_EQ(with("link: {loss: 1 %}"), "no error");
  EXPECT_EQ(with("load: {component: {cpu: 1}}, background: {topics: 1}, transport: cyclonedds"), "no error");
  EXPECT_THAT(with("perod: 1 ms"), AllOf(HasSubstr("unknown key 'arm.perod'"), HasSubstr("period")));
  EXPECT_THAT(with("period: 1 ms, deadline: 2 s"), HasSubstr("run 'a', arm: deadline (2 s)"));
  EXPECT_THAT(error("components: [arm]\nruns: [{id: a, transport: udp, arm: 5}]\n"),
              HasSubstr("arm: {period"));
  EXPECT_THAT(error("components: [arm]\nruns: [{id: a, transport: udp, leg: {period: 1 ms}}]\n"),
              HasSubstr("unknown key 'leg.period'"));
  EXPECT_THAT(error("runs: [{id: a, transport: udp, arm: {period: 1 ms}}]\n"), HasSubstr("unknown key"));
  const std::string stated =
      "hosts: {controller: {}}\ncomponents: {arm: {address: 10.0.0.1}, base: {address: 10.0.0.2}}\n";
  EXPECT_THAT(error(stated + "runs: [{id: a, transport: udp, arm: {link: {loss: 1 %}}}]\n"),
              HasSubstr("arm.link.loss: cannot"));
  EXPECT_EQ(error(stated + "runs: [{id: a, transport: udp, link: {loss: 1 %}}]\n"), "no error");
}

TEST_F(Components, SameAddressWithTrafficIsRefused) {
  const auto of = [this](const std::string& keys) {
    return error("hosts: {controller: {}}\ncomponents: {arm: {address: robot}, base: {address: robot}}\n" +
                 ("runs: [{id: a, transport: cyclonedds, " + keys + "}]\n"));
  };
  EXPECT_THAT(of("traffic: {rate: 1 Mbit/s}"),
              AllOf(HasSubstr("arm and base have the same address"), HasSubstr("with traffic")));
  EXPECT_EQ(of("arm: {traffic: {rate: 1 Mbit/s}}"), "no error");
  EXPECT_THAT(of("arm: {transport: udp}, base: {transport: udp}"), HasSubstr("over udp"));
  EXPECT_EQ(of("arm: {transport: udp}"), "no error");
}

TEST_F(Components, OwnKeysCountTowardsTheLimitOfRuns) {
  std::string list = "1 B";
  for (int i = 2; i <= 5000; ++i) list += fmt::format(", {} B", i);
  const auto of = [&](const std::string& own) {
    return error("components: [arm, base]\nruns: [{id: a, transport: udp, payload: [" + list + "]" + own +
                 "}]\n");
  };
  EXPECT_EQ(of(""), "no error");
  EXPECT_THAT(of(", arm: {period: 1 ms}"), HasSubstr("more than 10000 different runs"));
}

TEST_F(Components, PortSettingsBehindABridgeAreRefused) {
  const std::string stated =
      "hosts: {controller: {}}\ncomponents: {a: {address: 10.0.0.1}, b: {address: 10.0.0.2}}";
  for (const auto* kernel : {"gro: on", "threaded-napi: on", "napi-threads: 50", "napi-cpus: 0"}) {
    const auto of = [&](const std::string& hosts) {
      return error(fmt::format("{}\nruns: [{{id: a, transport: udp, kernel: {{{}}}}}]\n", hosts, kernel));
    };
    EXPECT_THAT(of("components: [arm, base]"), HasSubstr("bridge")) << kernel;
    EXPECT_EQ(of("components: [arm]"), "no error");
    EXPECT_EQ(of(stated), "no error");
  }
}

TEST_F(Components, SameAddressOverUdpIsRefused) {
  const auto of = [this](const std::string& transport) {
    return error("hosts: {controller: {}}\ncomponents: {arm: {address: robot}, base: {address: robot}}\n" +
                 ("runs: [{id: a, transport: " + transport + "}]\n"));
  };
  EXPECT_THAT(of("udp"),
              AllOf(HasSubstr(":3:8: run 'a'"), HasSubstr("arm and base have the same address, robot")));
  EXPECT_EQ(of("cyclonedds"), "no error") << "it has topics";
}

TEST_F(Components, TwoOverXdpOnOneQueueAreRefused) {
  const auto of = [this](const std::string& components, const std::string& keys) {
    return error("components: " + components + "\nruns: [{id: a, " + keys + "}]\n");
  };
  EXPECT_THAT(of("[arm, base]", "transport: xdp"),
              AllOf(HasSubstr(":2:8: run 'a'"), HasSubstr("over xdp, arm and base"), HasSubstr("ethernet")));
  EXPECT_THAT(of("[arm, base, leg]", "transport: xdp, base: {transport: udp}"),
              HasSubstr("over xdp, arm and leg"));
  EXPECT_EQ(of("[arm]", "transport: xdp"), "no error");
  EXPECT_EQ(of("[arm, base]", "transport: xdp, base: {transport: ethernet}"), "no error");
  EXPECT_EQ(of("[arm, base]", "transport: ethernet, component: {transport: xdp}"), "no error")
      << "on a link each";
}

TEST_F(Components, UnknownNameThrows) {
  const auto hosts = read("components: [arm, base]" + runs).hosts;
  EXPECT_THROW(hosts.at("component"), std::out_of_range);
}

// What explain would make of threads that are gone.
TEST_F(Components, ExplainWithRestartIsRefused) {
  const std::string run = "runs: [{id: a, transport: udp, component: {restart: on}";
  EXPECT_THAT(error(run + ", explain: on}]\n"),
              AllOf(HasSubstr(":1:8: run 'a'"), HasSubstr("component.restart")));
  Selection selection;
  selection.explain = true;
  EXPECT_THAT(error(run + "}]\n", selection), HasSubstr("leave out explain or component.restart"));
  EXPECT_TRUE(read("runs: [{id: a, transport: udp, explain: off}]\n", selection).runs[0].explain);
}

TEST_F(Components, WireTakesRateAndVlan) {
  EXPECT_FALSE(read("hosts: namespaces" + runs).hosts.wire.any());
  const auto hosts = read("wire: {rate: 10 Mbit/s, vlan: 5}" + runs).hosts;
  EXPECT_EQ(hosts.wire.bits_per_s, 10'000'000u);
  EXPECT_EQ(hosts.wire.vlan, 5);
  const auto run = read("wire: {vlan: 5}" + runs);
  EXPECT_EQ(asked(run.runs[0], run.hosts)["wire"], nlohmann::json({{"bits_per_s", 0}, {"vlan", 5}}));

  const auto of = [this](const std::string& wire) { return error(wire + runs); };
  EXPECT_THAT(of("wire: on"), HasSubstr(":1:7: wire: "));
  EXPECT_THAT(of("wire: {}"), HasSubstr("rate: 10 Mbit/s, vlan: 5"));
  EXPECT_THAT(of("wire: {length: 5}"), HasSubstr(":1:8: unknown key 'wire.length'"));
  EXPECT_THAT(of("wire: {vlan: 4095}"), HasSubstr(":1:14: wire.vlan: '4095'"));
  EXPECT_THAT(of("wire: {vlan: 0}"), HasSubstr("wire.vlan: '0'"));
  EXPECT_THAT(of("wire: {rate: fast}"), HasSubstr(":1:14: wire.rate: 'fast'"));
  EXPECT_THAT(of("wire: {vlan: 5, vlan: 6}"), HasSubstr("vlan"));
  EXPECT_THAT(of("hosts: loopback\nwire: {vlan: 5}"), HasSubstr(":2:7: wire: "));
  EXPECT_THAT(of("components: [arm, base]\nwire: {vlan: 5}"), HasSubstr("hosts: namespaces"));
}

TEST_F(Components, WireRateWithLinkDelayIsRefused) {
  const std::string run = "\nruns: [{id: a, transport: udp, link: {delay: 1 ms}}]";
  EXPECT_THAT(error("wire: {rate: 10 Mbit/s}" + run), HasSubstr("a: wire.rate and link.delay"));
  EXPECT_EQ(read("wire: {rate: 10 Mbit/s, vlan: 5}" + run).runs.size(), 1u);
  const std::string own = "\ncomponents: [arm]\nruns: [{id: a, transport: udp, arm: {link: {delay: 1 ms}}}]";
  EXPECT_THAT(error("wire: {rate: 10 Mbit/s}" + own), HasSubstr("a: wire.rate and link.delay"));
  EXPECT_EQ(error("wire: {vlan: 5}" + own), "no error");
}

TEST_F(Components, XdpWithWireRateIsRefused) {
  const auto of = [this](const std::string& wire, const std::string& keys) {
    return error("wire: {" + wire + "}\ncomponents: [arm]\nruns: [{id: a, " + keys + "}]");
  };
  for (const auto* keys : {"transport: xdp", "transport: udp, arm: {transport: xdp}",
                           "transport: ethernet, component: {transport: xdp}"}) {
    EXPECT_THAT(of("rate: 10 Mbit/s", keys), HasSubstr("a: xdp bypasses")) << keys;
    EXPECT_EQ(of("vlan: 5", keys), "no error");
    EXPECT_EQ(of("rate: 10 Mbit/s, vlan: 5", keys), "no error");
  }
  EXPECT_EQ(of("rate: 10 Mbit/s", "transport: xdp, arm: {transport: ethernet}"), "no error");
}

TEST_F(Components, InterfaceSettingsOverAVlanAreRefused) {
  const auto of = [this](const std::string& wire, const std::string& keys) {
    return error("wire: {" + wire + "}\nruns: [{id: a, transport: udp, " + keys + "}]");
  };
  const std::string isolated = "isolation: {cpus: 1, interrupts: on}";
  for (const auto& [keys, name] : {std::pair<std::string, std::string>{"kernel: {gro: off}", "kernel.gro"},
                                   {"kernel: {rps: 0}", "kernel.rps"},
                                   {"kernel: {threaded-napi: [as-is, on]}", "kernel.threaded-napi"},
                                   {"kernel: {preset: paper}", "kernel.irq-threads"},
                                   {isolated, "isolation.interrupts"}}) {
    EXPECT_THAT(of("vlan: 5", keys), AllOf(HasSubstr("a: " + name + " "), HasSubstr("or wire.vlan")));
    EXPECT_EQ(of("rate: 10 Mbit/s", keys), "no error");
  }
  EXPECT_EQ(of("vlan: 5", "kernel: {ksoftirqd: 50}, isolation: {cpus: 1}"), "no error");
  EXPECT_EQ(of("vlan: 5", "kernel: {preset: paper, irq-threads: as-is}"), "no error");
}

}  // namespace
}  // namespace ontime::campaign
