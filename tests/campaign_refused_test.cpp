// SPDX-License-Identifier: Apache-2.0
// What is wrong with a scenario is named with its place.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "campaign/campaign.hpp"
#include "campaign_scenario.hpp"
#include "record/record.hpp"

namespace ontime::campaign {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

TEST_F(ScenarioFile, MistypedKeysAreAnsweredWithTheNearestOne) {
  const auto answered = [](const char* key, const char* meant) {
    return AllOf(HasSubstr(fmt::format("unknown key '{}' (did you mean '{}'?)", key, meant)),
                 Not(HasSubstr("allowed")));
  };
  const std::string runs = "\nruns: [{id: a, transport: udp}]\n";
  EXPECT_THAT(error("runs: [{id: a, transprot: udp}]\n"), answered("transprot", "transport"));
  EXPECT_THAT(error("runs: [{id: a, kernel: {governer: performance}}]\n"),
              answered("kernel.governer", "governor"));
  EXPECT_THAT(error("runs: [{id: a, kernal: {governor: performance}}]\n"),
              answered("kernal.governor", "kernel"));
  EXPECT_THAT(error("defualts: {}" + runs), answered("defualts", "defaults"));
  EXPECT_THAT(error("wire: {vlna: 5}" + runs), answered("wire.vlna", "vlan"));
  EXPECT_THAT(error("hosts: {component: {adress: 1.2.3.4}}" + runs), answered("adress", "address"));
  EXPECT_THAT(error("hosts: {componnet: {address: 1.2.3.4}}" + runs), HasSubstr("did you mean 'component'?"));
}

TEST_F(ScenarioFile, OptionThatItsTransportLacksIsRefusedWithTheNearest) {
  EXPECT_THAT(error("runs:\n  - {id: a, transport: udp}\n  - {id: b, transport: udp, options: {prot: 1}}\n"),
              AllOf(HasSubstr(":3:5: run 'b': transport udp has no option 'prot' (did you mean 'port'?)"),
                    HasSubstr("port (UDP port")));
  EXPECT_THAT(
      error("runs: [{id: a, transport: fastdds, options: {profiles: p}, component: {transport: cyclonedds, "
            "options: {profiles: p}}}]\n"),
      HasSubstr("transport cyclonedds has no option 'profiles'"));
}

TEST_F(ScenarioFile, MistypedKeyWithoutKeysBelowItIsRefusedAtItsPlace) {
  EXPECT_THAT(error("runs: [{id: a, transport: udp, loda: {}}]\n"),
              HasSubstr(":1:32: unknown key 'loda' (did you mean 'load'?)"));
  EXPECT_THAT(error("runs: [{id: a, transport: udp, load: {contrller: {}}}]\n"),
              HasSubstr(":1:39: unknown key 'load.contrller' (did you mean 'controller'?)"));
  EXPECT_THAT(error("runs: [{id: a, transport: udp, period: {}}]\n"),
              HasSubstr(":1:40: period: a value is needed here"));
  EXPECT_EQ(error("components: [arm]\nruns: [{id: a, transport: udp, load: {component: {}}, options: {}, "
                  "component: {options: {}}, arm: {}}]\n"),
            "no error");
}

TEST_F(ScenarioFile, MistakesOfYamlAreNamedInPlainWords) {
  for (const auto* text : {"title: a: b\n", "runs:\n- {id: a: b}\n", "runs:\n- [a: b: c]\n"})
    EXPECT_THAT(error(text), HasSubstr("a text with ': ' needs quotes")) << text;
  EXPECT_THAT(error("runs: [{id: a\n"),
              HasSubstr(":1:8: this { is not closed: a } or a comma is missing before line 2, column 1"));
  EXPECT_THAT(error("runs:\n- {id: a, require: [late > 0\n- {id: b}\n"),
              HasSubstr(":2:20: this [ is not closed: a ] or a comma"));
  EXPECT_THAT(error("runs:\n- id: a\n    transport: udp\n"),
              HasSubstr(":3:14: this line is read as part of the text above it"));
  const auto merged = testing::AllOf(HasSubstr("merge keys (<<) are not supported"), HasSubstr("`defaults`"));
  EXPECT_THAT(error("runs:\n- &b {id: a, transport: udp}\n- <<: *b\n  id: c\n"), merged);
  EXPECT_THAT(error("<<: {title: a}\nruns: [{id: a, transport: udp}]\n"), merged);
}

TEST_F(ScenarioFile, QuoteThatIsNotClosedIsRefusedWhereItOpens) {
  const std::string runs = "runs:\n- id: a\n  transport: udp\n";
  for (const std::string end : {"", "\n", "  \r\n\n"}) {
    EXPECT_THAT(error(runs + "  title: \"drive\n  require: [max <= 1 us]" + end),
                HasSubstr(":4:10: this \" is not closed"));
    EXPECT_THAT(error(runs + "  title: 'drive  # it''s \"new\"\n  period: 1 s" + end),
                HasSubstr(":4:10: this ' is not closed"));
    EXPECT_THAT(error("title: 'drive\n" + runs + end), HasSubstr(":1:8: this ' is not closed"));
    EXPECT_THAT(error("runs: [{id: \"a}]" + end), HasSubstr(":1:13: this \" is not closed"));
    EXPECT_THAT(error(runs + "  title: \"a \\\"b\\\"\n" + end), HasSubstr(":4:10: this \" is not closed"));
  }
  std::string far = runs + "  title: \"drive\n";
  for (int i = 0; i < 99; ++i) far += "it's\n";
  EXPECT_THAT(error(far), HasSubstr("a quote above is not closed"));
  EXPECT_EQ(read("title: |\n  it's \"a\n\n" + runs + "  title: it's").title, "it's \"a\n");
  EXPECT_EQ(error(runs + "  title: >\n    \"a\n\n"), "no error");
}

TEST_F(ScenarioFile, WrongIndentationIsNamedInPlainWords) {
  for (const auto* third : {"    period: 1 s\n   domain: 1\n", "   period: 1 s\n", " period: 1 s\n",
                            "- id: b\n", "   - id: b\n", " - id: b\n"})
    EXPECT_THAT(error(std::string("runs:\n  - id: a\n") + third),
                HasSubstr(" is no part of the block above it. Fix: "))
        << third;
  EXPECT_THAT(error("runs:\n  - id: a\n  -id: b\n"), HasSubstr(":3:3: a space is needed after '-'"));
  EXPECT_THAT(error("runs:\n  - id: a\n  transport: udp\n"), HasSubstr(":3:3: this line is no part of"));
  EXPECT_THAT(error("title: a\n- id: b\n"), HasSubstr(":2:1: this list item is no part of"));
  EXPECT_THAT(error("runs: [{id: a}]]\n"), HasSubstr(":1:16: this ] closes nothing"));
  EXPECT_THAT(error("runs: [{id: a}}]\n"), HasSubstr(":1:15: this } closes nothing"));
  EXPECT_THAT(error("title: \"x\nruns: \"y\"\n"), HasSubstr(":2:8: this text follows a closing \". Fix: "));
  EXPECT_THAT(error("payload: [1 B] 2 B\n"), HasSubstr(":1:16: this text follows a closing ]"));
}

TEST_F(ScenarioFile, SizeOfWorkersThatARunHasNoneOfIsRefused) {
  const auto with = [&](const std::string& load, const std::string& defaults = "", Selection selection = {}) {
    return error("components: [arm]\ndefaults: {" + defaults + "}\nruns: [{id: a, transport: udp, " + load +
                     "}, {id: b, transport: udp, load: {controller: {cpu: 1}}}]\n",
                 selection);
  };
  EXPECT_THAT(with("load: {component: {vm-bytes: 1 GiB}}"),
              HasSubstr(":3:61: load.component.vm-bytes: no effect without load.component.vm"));
  EXPECT_THAT(with("arm: {load: {component: {hdd-bytes: 1 GiB}}}"),
              HasSubstr("no effect without load.component.hdd"));
  EXPECT_THAT(with("load: {controller: {vm-bytes: 1 GiB}}", "load: {component: {vm: 1}}"),
              HasSubstr("no effect without load.controller.vm"));
  for (const auto* load : {"load: {controller: {vm: [0, 1], vm-bytes: 1 GiB}}", "period: 1 s"})
    EXPECT_EQ(with(load, "load: {controller: {hdd-bytes: 1 GiB, vm-bytes: 1 MiB}}"), "no error") << load;
  EXPECT_EQ(with("load: {controller: {vm-bytes: 1 GiB}}", "load: {controller: {vm: 1}}"), "no error");
  EXPECT_EQ(with("load: {component: {vm: 1}}, arm: {load: {component: {vm-bytes: 1 GiB}}}"), "no error");
  Selection selection;
  selection.set = {{"load.component.vm", "1"}};
  EXPECT_EQ(with("load: {component: {vm-bytes: 1 GiB}}", "", selection), "no error");
}

TEST_F(ScenarioFile, WhatWasMeantIsNamed) {
  const auto with = [&](const std::string& key) {
    return error("runs: [{id: a, transport: udp, " + key + "}]\n");
  };
  EXPECT_THAT(with("require: {p99: 5 ms}"),
              HasSubstr(":1:41: require: a list of limits is needed, such as [p99"));
  EXPECT_THAT(with("search: payloads, payload: [1 B, 2 B]"),
              HasSubstr("search: unknown key 'payloads' (did you mean 'payload'?)"));
  EXPECT_THAT(with("search: period"), HasSubstr("search: 'period' has no list of values"));
  for (const auto* key : {"period: '0,01 s'", "payload: '1,5 KiB'", "traffic: {rate: '1,5 Mbit/s'}"})
    EXPECT_THAT(with(key), HasSubstr("the decimal sign is a point")) << key;
  EXPECT_THAT(with("load: {robot: {cpu: 1}}"),
              HasSubstr(":1:39: unknown key 'load.robot.cpu'; allowed keys: "));
  EXPECT_THAT(with("lod: {robot: {cpu: 1}}"), HasSubstr(":1:32: unknown key 'lod.robot.cpu'"));
  EXPECT_THAT(with("isolation: {cpus: 1, load-quota: 0.5 %}"),
              HasSubstr("'0.5 %' is not a whole number from 1 % to 102400 %"));
  EXPECT_THAT(error("runs:\n- id: \"a\\nb\"\n  transport: udp\n"), HasSubstr(":2:7: id: "));
}

TEST_F(ScenarioFile, IdThatIsAWholeNumberIsRefusedBecauseRunsHaveNumbers) {
  for (const auto* id : {"3", "'007'"})
    EXPECT_THAT(error(fmt::format("runs: [{{id: {}, transport: udp}}]\n", id)),
                AllOf(HasSubstr(":1:13: id: '"), HasSubstr("--only"), HasSubstr("such as run-")));
  EXPECT_EQ(error("runs: [{id: 3a, transport: udp}, {id: 1.5, transport: udp}]\n"), "no error");
}

TEST_F(ScenarioFile, SwitchIsReadAsYamlSpellsIt) {
  for (const auto* on : {"on", "On", "ON", "yes", "Yes", "TRUE"})
    EXPECT_FALSE(
        read(fmt::format("runs: [{{id: a, transport: udp, realtime: {}}}]\n", on)).runs[0].realtime_refused);
  for (const auto* off : {"Off", "NO", "False"})
    EXPECT_TRUE(
        read(fmt::format("runs: [{{id: a, transport: udp, realtime: {}}}]\n", off)).runs[0].realtime_refused);
  EXPECT_THAT(error("runs: [{id: a, transport: udp, realtime: onn}]\n"), HasSubstr("neither on nor off"));
}

TEST_F(ScenarioFile, ErrorsNameLineAndColumn) {
  EXPECT_THAT(error("runs:\n  - id: a\n    transport: udp\n    perid: 10 ms\n"),
              testing::AllOf(HasSubstr(":4:5: unknown key 'perid'"), HasSubstr("period")));
  EXPECT_THAT(error("runs:\n  - {id: a, transport: udp, period: 10}\n"),
              HasSubstr(":2:37: period: '10' has no unit"));
  EXPECT_THAT(error("runs:\n  - {id: a, transport: udp, period: 100 Hz}\n"),
              HasSubstr(":2:37: period: '100 Hz' is a rate; a time is needed, such as '10 ms'"));
  EXPECT_THAT(error("runs:\n  - {id: a, transport: udp, kernel: {rmem-max: 1 B}}\n"),
              HasSubstr("kernel.rmem-max: 1 B is not a size from 4608 B to 2147483647 B"));
  EXPECT_THAT(error("runs:\n  - {id: a, transport: udp, period: 0 ms}\n"), HasSubstr("period: '0 ms'"));
  EXPECT_THAT(error("runs:\n  - {id: a, transport: udp, period: -5 ms}\n"), HasSubstr("period: '-5 ms'"));
  EXPECT_THAT(error("runs:\n  - {id: a, transport: udp, qos: {depth: 0}}\n"), HasSubstr("qos.depth: '0'"));
  EXPECT_THAT(error("runs:\n  - {id: a, transport: udp, payload: [1 B, 2 Q]}\n"),
              HasSubstr(":2:44: payload: '2 Q'"));
  EXPECT_THAT(error("runs:\n  - {id: a, transport: udp}\n  - {id: a, transport: udp}\n"),
              HasSubstr("another run with id 'a'"));
  EXPECT_THAT(error("runs:\n  - {id: 'a,b', transport: udp}\n"), HasSubstr(":2:10: id: 'a,b': "));
  EXPECT_THAT(error("runs:\n  - {id: -x, transport: udp}\n"), HasSubstr(":2:10: id: '-x'"));
  EXPECT_THAT(error("runs:\n  - {id: a, transport: udp, transport: fastdds}\n"),
              HasSubstr("'transport' occurs twice"));
  EXPECT_THAT(error("runs: [\n"), HasSubstr(":1:7: this [ is not closed"));
  EXPECT_THAT(error("runs: [{id: a}\ntitle: b\n"), HasSubstr(":1:7: this [ is not closed"));
  EXPECT_THAT(error("runs: []\n"), HasSubstr("a list of runs is needed"));
  EXPECT_THAT(error("title: x\n"), HasSubstr("a list of runs is needed"));
  EXPECT_THAT(error("- a\n"), HasSubstr("not a scenario"));
  EXPECT_THAT(error(""), HasSubstr("not a scenario"));
  EXPECT_THAT(error("wat: 1\nruns: [{id: a, transport: udp}]\n"), HasSubstr(":1:1: unknown key 'wat'"));
  // A key in the wrong place is told where it belongs.
  for (const auto* key : {"transport", "load", "neighbours", "require"})
    EXPECT_THAT(error(fmt::format("runs: [{{id: a, transport: udp}}]\n{}: 1\n", key)),
                HasSubstr(fmt::format(":2:1: unknown key '{}': it is a key of runs", key)));
  EXPECT_THAT(error("id: a\nruns: [{transport: udp}]\n"),
              HasSubstr(":1:1: unknown key 'id': it is a key of runs. Write it in a run"));
  EXPECT_THAT(error("runs: [{id: a, transport: udp, repeat: 2}]\n"),
              HasSubstr(":1:32: unknown key 'repeat': it is a key of the file"));
  EXPECT_THAT(error("runs: [{transport: udp}]\n"), HasSubstr("a run needs an id"));
  EXPECT_THAT(error("runs: [{id: a}]\n"), HasSubstr("no transport is set. Fix: transport: udp"));
  EXPECT_THAT(error("repeat: 0\nruns: [{id: a, transport: udp}]\n"), HasSubstr(":1:9: repeat"));
  EXPECT_THAT(error("order: random\nruns: [{id: a, transport: udp}]\n"), HasSubstr(":1:8: order"));
  EXPECT_THAT(error("hosts: mars\nruns: [{id: a, transport: udp}]\n"), HasSubstr(":1:8: hosts"));
  EXPECT_THAT(error("runs: [{id: a, transport: udp, deadline: 1 s}]\n"), HasSubstr("deadline"));
  EXPECT_THAT(error("runs: [{id: a, transport: udp, realtime: {policy: other, priority: 5}}]\n"),
              HasSubstr("priority needs policy"));
  EXPECT_THAT(error("runs: [{id: a, transport: udp, period: {a: 1}}]\n"),
              HasSubstr("unknown key 'period.a'"));
  EXPECT_THAT(error("runs: [{id: a, transport: udp, period: }]\n"), HasSubstr("a value is needed"));
  EXPECT_THROW(read_scenario("/no/such/file.yaml", {}), scenario::Error);
  EXPECT_THROW(read_scenario("/", {}), scenario::Error);
}

TEST_F(ScenarioFile, MeaninglessQuantitiesAreRefused) {
  const auto with = [](const std::string& key) { return "runs: [{id: a, transport: udp, " + key + "}]\n"; };
  for (const auto* key : {"duration: 0 s",
                          "duration: -1 s",
                          "duration: 1001 h",
                          "duration: 99999999999 h",
                          "period: 2 h",
                          "timeout: 61 min",
                          "deadline: -1 ms",
                          "payload: 2 GiB",
                          "payload: -1 B",
                          "payload: 99999999 GiB",
                          "warm-up: 0",
                          "warm-up: -1",
                          "warm-up: 1.5",
                          "domain: 233",
                          "domain: -1",
                          "domain: 0x1",
                          "qos: {depth: 99999999999999999999}",
                          "realtime: {cpu-latency: -5 us}",
                          "realtime: {cpu-latency: 1500 ns}",
                          "realtime: {cpu-latency: 1 h}",
                          "realtime: {cpus: 0-99999999999}",
                          "realtime: {priority: 100}",
                          "load: {controller: {cpu: -1}}",
                          "load: {controller: {cpu: nan}}",
                          "load: {controller: {vm-bytes: 0 B}}",
                          "load: {component: {hdd-bytes: -1 B}}",
                          "traffic: {rate: 80}",
                          "traffic: {rate: 0 Mbit/s}",
                          "traffic: {rate: 80 Mbps}",
                          "traffic: {rate: 1 Mbit/s, datagram: 15 B}",
                          "traffic: {rate: 1 Mbit/s, datagram: 64 KiB}",
                          "traffic: {rate: 1 Mbit/s, direction: up}",
                          "traffic: {rate: 1 Mbit/s, priority: 0}",
                          "traffic: {direction: to-component}",
                          "link: {loss: 101 %}",
                          "link: {loss: 0 %}",
                          "link: {loss: 0.00015 %}",
                          "link: {loss: 0.1}",
                          "link: {jitter: 1 ms}",
                          "link: {reorder: 5 %}",
                          "link: {delay: 1 ms, jitter: 2 ms}",
                          "link: {delay: 100 ns}",
                          "link: {cut: 5 s}",
                          "link: {cut: 5 s for 0 s}",
                          "link: {cut: 5 s for 1 us}",
                          "link: {cut: 10 s for 1 s}",
                          "period: 10001 ms"})
    EXPECT_THAT(error(with(key)), testing::StartsWith(":1:")) << key;
  for (const auto* key : {"duration: 1000 h", "period: 10 s", "payload: 65475 B", "payload: 0 B",
                          "domain: 232", "realtime: {cpu-latency: any}", "realtime: {cpu-latency: 2 ms}"})
    EXPECT_EQ(error(with(key)), "no error") << key;
}

TEST_F(ScenarioFile, UnknownTransportOfThisMachineIsRefused) {
  EXPECT_THAT(error("hosts: loopback\nruns:\n  - {id: a, transport: tcp}\n"),
              testing::AllOf(testing::StartsWith(":3:"), HasSubstr("transport 'tcp'")));
  EXPECT_THAT(error("runs: [{id: a, transport: [udp, upd]}]\n"), HasSubstr("did you mean 'udp'"));
  EXPECT_THAT(error("runs: [{id: a, transport: udp, component: {transport: tcp}}]\n"),
              HasSubstr("transport 'tcp'"));
  EXPECT_EQ(error("runs: [{id: a, transport: [xdp, opendds]}]\n"), "no error") << "known, installed or not";
}

TEST_F(ScenarioFile, UnknownTransportOfOtherMachinesIsAccepted) {
  EXPECT_EQ(error("hosts: {component: {ssh: robot, address: 10.0.0.2}}\nruns: [{id: a, transport: mine}]\n"),
            "no error");
}

TEST_F(ScenarioFile, TransportsThatCannotReachEachOtherAreRefused) {
  const auto pair = [&](const std::string& controller, const std::string& component) {
    return error(fmt::format("runs:\n- {{id: a, transport: {}, component: {{transport: {}}}}}\n", controller,
                             component));
  };
  EXPECT_THAT(pair("udp", "cyclonedds"),
              AllOf(HasSubstr(":2:3: run 'a': udp cannot reach cyclonedds on the component"),
                    HasSubstr("udp has no topics"),
                    HasSubstr("Fix: leave out component.transport, or use one of: udp")));
  EXPECT_THAT(pair("fastdds", "udp"), AllOf(HasSubstr("udp has no topics"),
                                            HasSubstr("use one of: cyclonedds, fastdds, opendds, ros2")));
  EXPECT_THAT(pair("udp", "xdp"), HasSubstr("xdp has no IP header"));
  EXPECT_THAT(pair("ethernet", "ros2"), HasSubstr("ethernet has no IP header"));
  for (const auto* reaches : {"ethernet", "xdp"}) EXPECT_EQ(pair("ethernet", reaches), "no error");
  for (const auto* reaches : {"cyclonedds", "fastdds", "opendds", "ros2"})
    EXPECT_EQ(pair("ros2", reaches), "no error");
}

TEST_F(ScenarioFile, QosIsVariedOnlyOverATransportThatHasIt) {
  EXPECT_THAT(
      error("runs: [{id: a, transport: udp, qos: {reliability: [best-effort, reliable]}}]\n"),
      AllOf(HasSubstr(":1:52: qos.reliability: udp has no QoS"), HasSubstr("Fix: state one value, or"),
            HasSubstr("(cyclonedds, fastdds, opendds, ros2)")));
  EXPECT_THAT(error("defaults: {transport: [cyclonedds, ethernet], qos: {depth: [1, 2]}}\nruns: [{id: a}]\n"),
              HasSubstr(":1:61: qos.depth: ethernet has no QoS"));
  Selection selection;
  selection.transports = {"udp"};
  EXPECT_THAT(error("runs: [{id: a, transport: fastdds, qos: {depth: [1, 2]}}]\n", selection),
              HasSubstr("qos.depth: udp has no QoS"));
  EXPECT_EQ(error("components: [arm, base]\n"
                  "runs: [{id: a, transport: udp, arm: {transport: fastdds, qos: {depth: [1, 2]}}}]\n"),
            "no error");
}

TEST_F(ScenarioFile, QosIsNoConditionOfATransportWithoutIt) {
  const auto scenario = read(
      "defaults: {qos: {reliability: reliable, depth: 7}}\n"
      "runs: [{id: a, transport: [udp, cyclonedds]}]\n");
  const auto plain = read("runs: [{id: a, transport: udp}]\n");
  EXPECT_EQ(record::key_of(conditions::asked(scenario.runs.at(0), {})),
            record::key_of(conditions::asked(plain.runs.at(0), {})));
  EXPECT_EQ(scenario.runs.at(1).task.config.qos.depth, 7);
}

TEST_F(ScenarioFile, PayloadBeyondATransportIsRefused) {
  EXPECT_THAT(error("runs:\n  - {id: a, transport: udp, payload: 70 kB}\n"),
              testing::AllOf(testing::StartsWith(":2:"), HasSubstr("65475"), HasSubstr("70000")));
  EXPECT_THAT(error("runs: [{id: a, transport: cyclonedds, component: {transport: ros2}, payload: 2 MiB}]\n"),
              HasSubstr("transport ros2"));
  EXPECT_EQ(error("runs: [{id: a, transport: cyclonedds, payload: 16 MiB}]\n"), "no error");
}

}  // namespace
}  // namespace ontime::campaign
