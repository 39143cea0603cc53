// SPDX-License-Identifier: Apache-2.0
// Runs compared by the values of a key.
#include "report/comparison.hpp"
#include "report_comparison.hpp"

namespace ontime::report {
namespace {

using record::amend;
using ::testing::HasSubstr;
using ::testing::Not;

TEST(Compare, KeyPairsRunsThatAreOtherwiseEqual) {
  std::vector<Summary> runs;
  for (const auto* transport : {"udp", "fastdds"})
    for (const auto* value : {"on", "off"})
      for (const int repetition : {1, 2}) {
        auto one = run(value, std::string(transport) + value, repetition);
        amend(one.run.asked, "/transport", transport);
        amend(one.run.asked, "/kernel", {{"threaded-napi", value}});
        runs.push_back(one);
      }
  EXPECT_EQ(values_of(runs, "kernel.threaded-napi"), (std::vector<std::string>{"on", "off"}));
  EXPECT_EQ(values_of(runs, "kernel.irq-threads"), (std::vector<std::string>{unset}));
  EXPECT_EQ(values_of(runs, "period"), values_of(runs, "period_us")) << "a record's own names serve, too";
  EXPECT_EQ(values_of(runs, "period"), (std::vector<std::string>{"10000"}));
  const auto comparison = compare_by(runs, "kernel.threaded-napi", "off", "on");
  ASSERT_EQ(comparison.pairs.size(), 2U);
  EXPECT_EQ(comparison.pairs[0].from.size(), 2U);
  EXPECT_EQ(comparison.pairs[0].from[0]->run.asked.kernel.at("threaded-napi"), "off");
  EXPECT_EQ(comparison.pairs[1].to[1]->run.asked.task.transport, "fastdds");
  EXPECT_TRUE(comparison.only_from.empty() && comparison.only_to.empty());
}

TEST(Compare, ValueOfAKeyHasTheWordsOfScenarioAndOfRecord) {
  for (const auto& [key, value, words] :
       {std::tuple("payload", "10000", "10000 B"),
        {"security", unset, "off"},
        {"kernel.gro", unset, "as-is"},
        {"payload", unset, unset},
        {"payload", "10 kB", "10000 B"},
        {"payload", "1 KiB", "1 KiB"},
        {"payload", "1024", "1 KiB"},
        {"period", "10000", "10 ms"},
        {"period", "10ms", "10 ms"},
        {"duration", "2.0", "2 s"},
        {"link.loss", "0.01", "1 %"},
        {"link.loss", "1 %", "1 %"},
        {"link.loss", "0.999999", "99.9999 %"},
        {"link.loss", "0.333333", "33.3333 %"},
        {"isolation.load-quota", "1024", "102400 %"},
        {"domain", "07", "7"},
        {"topics.ping", "a", "a"},
        {"link.cut", "1 s for 20 ms", R"({"at_s":1.0,"for_ms":20})"},
        {"realtime", "true", "on"},
        {"realtime", "on", "on"},
        {"transport", "udp", "udp"},
        {"period", unset, unset},
        {"period", "nonsense", "nonsense"},
        {"kernel.threaded-napi", "on", "on"},
        {"options.rmw", "x", "x"},
        {"load", R"({"controller":{"cpu":2,"vm":1,"vm_bytes":65536}})",
         "2 cpu, 1 vm of 64 KiB on the controller"},
        {"load", R"({"controller":{"cpu":0},"component":{}})", "none"},
        {"load", "{}", "none"},
        {"kernel", R"({"irq-threads":"90","ksoftirqd":"60"})", "irq-threads 90, ksoftirqd 60"},
        {"traffic", R"({"bit_s":1000000,"datagram_bytes":1470})", "1 Mbit/s each way in datagrams of 1470 B"},
        {"options", R"({"executor":"multi"})", "executor multi"},
        {"require", R"(["late <= 0"])", R"(["late <= 0"])"}})
    EXPECT_EQ(words_of_value(key, value), words) << key << " " << value;
}

TEST(Compare, ValuesThatReadTheSameAreToldApart) {
  EXPECT_EQ(words_of_values("link.loss", {"0.01", "0.0100000001", "0.02"}),
            (std::vector<std::string>{"0.01", "0.0100000001", "2 %"}));
}

// A run for each of these runs, as an ontime records them.
std::vector<Summary> recorded(const std::vector<conditions::Run>& asked) {
  std::vector<Summary> runs;
  for (const auto& one : asked) {
    runs.push_back(run("x", std::to_string(runs.size()), 1));
    amend(runs.back().run.asked, conditions::to_json(one));
  }
  return runs;
}

conditions::Run said(std::initializer_list<std::pair<std::string, std::string>> words) {
  conditions::Run one;
  for (const auto& [path, value] : words)
    std::ranges::find(conditions::keys(), path, &conditions::Key::path)->set(one, value);
  return one;
}

TEST(Compare, KeyIgnoresSettingsThatFollowFromIt) {
  auto multi = said({{"transport", "ros2"}}), single = multi;
  multi.task.config.options["executor"] = "multi";
  single.task.config.options["executor"] = "single";
  struct Case {
    std::string key;
    conditions::Run from, to;
  };
  for (const auto& [key, from, to] :
       {Case{"transport", said({{"transport", "udp"}}), said({{"transport", "fastdds"}})},
        Case{"options.executor", multi, single}, Case{"realtime", {}, said({{"realtime", "on"}})},
        Case{"realtime.priority", said({{"realtime", "on"}}), said({{"realtime.priority", "90"}})},
        Case{"realtime.lock-memory", said({{"realtime", "on"}}), said({{"realtime.lock-memory", "off"}})},
        Case{"traffic.rate", {}, said({{"traffic.rate", "1 Mbit/s"}})},
        Case{"link.duplicate", {}, said({{"link.duplicate", "1 %"}})},
        Case{"background", {}, said({{"background.topics", "2"}, {"background.rate", "50 Hz"}})},
        Case{"background.rate", said({{"background.topics", "2"}}),
             said({{"background.topics", "2"}, {"background.rate", "50 Hz"}})},
        Case{"background.direction", said({{"background.topics", "2"}}),
             said({{"background.topics", "2"}, {"background.direction", "to-component"}})},
        Case{"launch-time", {}, said({{"launch-time", "1 ms"}})}}) {
    const auto runs = recorded({from, to});
    const auto values = values_of(runs, key);
    ASSERT_EQ(values.size(), 2U) << key;
    EXPECT_EQ(compare_by(runs, key, values[0], values[1]).pairs.size(), 1U) << key;
  }
}

TEST(Compare, TransportOfAComponentIsComparedWithOneThatHasNoTopics) {
  std::vector runs{run("a", "udp", 1), run("a", "cyclonedds", 1)};
  for (auto& one : runs) {
    const bool has_topics = one.run.key == "cyclonedds";
    amend(one.run.asked, {{"transport", one.run.key},
                          {"component", "arm"},
                          {"ping_topic", has_topics ? "/robot/arm/ping" : "/robot/ping"},
                          {"others", {{"base", {{"component", "base"}}}}}});
    if (has_topics) amend(one.run.asked, "/others/base/ping_topic", "/robot/base/ping");
  }
  EXPECT_EQ(compare_by(runs, "transport", "udp", "cyclonedds").pairs.size(), 1U);
}

TEST(Compare, KeyLeavesOutRunsThatDifferInMore) {
  const auto runs = recorded({{}, said({{"realtime", "on"}}), said({{"realtime.priority", "90"}})});
  const auto comparison = compare_by(runs, "realtime", "false", "true");
  ASSERT_EQ(comparison.pairs.size(), 1U);
  EXPECT_EQ(comparison.pairs[0].to.size(), 1U);
  EXPECT_EQ(comparison.only_to.size(), 1U);
}

TEST(Compare, BackgroundTopicsAreOneGroup) {
  const auto with = said({{"background.topics", "3"}, {"background.rate", "50 Hz"}});
  const auto values = values_of(recorded({{}, with}), "background");
  EXPECT_EQ(values.at(0), unset);
  EXPECT_THAT(words_of_value("background", values.at(1)),
              ::testing::AllOf(::testing::HasSubstr("3"), ::testing::Not(::testing::HasSubstr("{"))));
}

TEST(Compare, KeyComparesTheOtherKeysOfItsGroup) {
  std::vector<conditions::Run> all;
  for (const auto* rate : {"1 Mbit/s", "2 Mbit/s"})
    for (const auto* size : {"1470 B", "100 B"})
      all.push_back(said({{"traffic.rate", rate}, {"traffic.datagram", size}}));
  const auto runs = recorded(all);
  const auto values = values_of(runs, "traffic.rate");
  ASSERT_EQ(values.size(), 2U);
  EXPECT_EQ(compare_by(runs, "traffic.rate", values[0], values[1]).pairs.size(), 2U);
}

}  // namespace
}  // namespace ontime::report
