// SPDX-License-Identifier: Apache-2.0
#include "gate/gate.hpp"
#include "json.hpp"
#include "plot/plot.hpp"
#include "report/answer.hpp"
#include "report_fixture.hpp"

namespace ontime::report {
namespace {

using ::testing::AllOf;
using ::testing::AnyOf;
using ::testing::HasSubstr;
using ::testing::Not;

TEST(TableFormat, GroupsByIdAndBringsRepetitionsTogether) {
  std::vector<Summary> runs;
  for (const int repetition : {1, 2})
    for (const auto* id : {"Test1.A", "Test1.B"})
      for (const auto* transport : {"udp", "fastdds"})
        runs.push_back(summary(asked(id, transport, repetition), outcome()));
  std::vector<std::string> beginnings;
  for (const auto& line : lines_of(render(runs, Format::table)))
    if (line.starts_with("Test") || line.starts_with("udp") || line.starts_with("fastdds"))
      beginnings.push_back(line.substr(0, 10));
  std::vector<std::string> expected;
  for (const std::string id : {"Test1.A  ", "Test1.B  "}) {  // times, over repetitions, stages
    const std::vector<std::string> each = {"udp #1    ", "udp #2    ", "fastdds #1", "fastdds #2"};
    expected.push_back(id + "S");
    expected.insert(expected.end(), each.begin(), each.end());
    expected.insert(expected.end(), {id + "o", "udp       ", "fastdds   "});
    expected.push_back(id + "s");
    expected.insert(expected.end(), each.begin(), each.end());
  }
  EXPECT_EQ(beginnings, expected);
}

TEST(TableFormat, RepetitionOfWhichAllWasLostCounts) {
  std::vector<Summary> runs;
  for (const int repetition : {1, 2, 3}) runs.push_back(summary(asked("a", "udp", repetition), outcome()));
  auto& gone = runs.back();
  gone.lost = gone.sent;
  gone.on_time = 0;
  gone.round_trip = gone.response = {};
  const auto cells = [&] {
    const auto text = render(runs, Format::markdown);
    const auto at = text.find("over repetitions");
    return row_of(text.substr(at), "| udp");
  };
  using ::testing::ElementsAre;
  EXPECT_THAT(cells(), ElementsAre("|", "udp", "|", "3", "|", "-", "|", "-", "|", "-", "|", "-", "|", "0",
                                   "\\[0,", "100\\]", "|"));
  runs.front().late = runs.front().sent;
  runs.front().on_time = 0;
  EXPECT_EQ(cells().at(13), "100");
}

TEST(TableFormat, RunsOfOtherConditionsAreNoRepetitions) {
  using Names = std::vector<std::string>;
  for (const auto& [condition, names] :
       {std::pair(json{{"explain", true}}, Names{"udp", "udp explain on"}),
        {json{{"count_instructions", true}}, Names{"udp", "udp count-instructions on"}},
        {json{{"warm_up", 500}}, Names{"udp warm-up 10", "udp warm-up 500"}},
        {json{{"component_interface", "eth0"}}, Names{"udp", "udp over eth0"}},
        {json{{"of_a_newer_ontime", 5}}, Names{"udp run 1", "udp run 3"}}}) {
    std::vector<Summary> runs;
    for (const int number : {1, 2, 3, 4}) {
      auto conditions = asked("a", "udp", (number - 1) % 2 + 1);
      if (number > 2) conditions.update(condition);
      runs.push_back(summary(conditions, outcome()));
      runs.back().run.number = number;
      runs.back().run.key = number > 2 ? "with" : "without";
    }
    const auto text = render(runs, Format::markdown);
    const auto answer = answer_of(runs, {});
    ASSERT_EQ(answer.rows.size(), 2U);
    for (std::size_t i = 0; i < names.size(); ++i) {
      EXPECT_EQ(answer.rows[i].name, names[i] + " ×2");
      EXPECT_THAT(text.substr(text.find("over repetitions")), HasSubstr("\n| " + names[i] + " | 2 |"));
    }
    EXPECT_THAT(plot::gnuplot_of(runs, {plot::Plot::Figure::ccdf}),
                AllOf(HasSubstr("2 runs"), Not(HasSubstr("4 runs"))));
  }
}

TEST(TableFormat, TellsRunsOfOneIdApart) {
  auto small = asked("Payload", "udp"), large = asked("Payload", "udp");
  large["payload_bytes"] = 32768;
  const auto by_payload = render({summary(small, outcome()), summary(large, outcome())}, Format::table);
  EXPECT_THAT(by_payload, AllOf(HasSubstr("\nudp 500 B "), HasSubstr("\nudp 32 KiB ")));
  EXPECT_THAT(lines_of(by_payload).at(1), Not(HasSubstr("500 B"))) << "it does not hold for all";

  small["variant"] = "payload 500 B";
  large["variant"] = "payload 32 KiB";
  EXPECT_EQ(render({summary(small, outcome()), summary(large, outcome())}, Format::table), by_payload)
      << "it is told already";
  small["variant"] = "payload 500 B, realtime.priority 20";
  large["variant"] = "payload 32 KiB, realtime.priority 50";
  EXPECT_THAT(render({summary(small, outcome()), summary(large, outcome())}, Format::markdown),
              AllOf(HasSubstr("\n| udp 500 B realtime.priority 20 |"),
                    HasSubstr("\n| udp 32 KiB realtime.priority 50 |")));

  auto again = summary(small, outcome());
  again.run.number = 2;
  EXPECT_THAT(render({summary(small, outcome()), again}, Format::markdown),
              AllOf(HasSubstr("\n| udp realtime.priority 20 run 1 |"),
                    HasSubstr("\n| udp realtime.priority 20 run 2 |")));
}

Summary ros2(const std::string& executor, int number, const json& further = json::object()) {
  auto conditions = asked("ros", "ros2");
  conditions["options"] = {{"rmw", "rmw_cyclonedds_cpp"}, {"executor", executor}};
  conditions["component_options"] = conditions["options"];
  conditions["component_transport"] = "ros2";
  conditions.update(further);
  auto one = summary(conditions, outcome());
  one.run.number = number;
  return one;
}

TEST(TableFormat, NamesTheOptionsThatDiffer) {
  const std::vector<Summary> runs = {ros2("single", 1), ros2("multi", 2)};
  for (const auto format : {Format::table, Format::markdown, Format::latex}) {
    const auto text = render(runs, format);
    EXPECT_THAT(text, AllOf(HasSubstr("ros2 executor single"), HasSubstr("ros2 executor multi")));
    EXPECT_THAT(text, AnyOf(HasSubstr("listener, rmw_cyclonedds_cpp,"),
                            HasSubstr("listener, rmw\\_cyclonedds\\_cpp, ")));
  }
  EXPECT_THAT(render_threads(runs, Format::table),
              AllOf(HasSubstr("Run 1: ros  ros2 executor single, threads on the controller"),
                    HasSubstr("Run 2: ros  ros2 executor multi, threads on the component")));
  for (const auto& entry : parsed_json(render_threads(runs, Format::json)))
    EXPECT_EQ(entry.at("options").at("executor"), entry.at("run") == 1 ? "single" : "multi");

  const auto again = render({ros2("multi", 1), ros2("multi", 2)}, Format::markdown);
  EXPECT_THAT(again, AllOf(HasSubstr("executor multi, "), HasSubstr("\n| ros2 run 1 |"),
                           HasSubstr("\n| ros2 run 2 |")));
}

TEST(TableFormat, NamesWhatTheEndsTookWhereNothingWasAsked) {
  auto taken = outcome();
  for (const auto* host : {"controller", "component"})
    taken["hosts"][host]["transport"]["facts"] = {
        {"rmw", "rmw_fastrtps_cpp"}, {"executor", "single"}, {"node", "/n"}};
  const auto one = summary(asked("ros", "ros2"), taken);
  const auto text = render({one}, Format::table);
  EXPECT_THAT(text, HasSubstr("rmw_fastrtps_cpp"));
  EXPECT_THAT(text, HasSubstr("executor single"));
  EXPECT_THAT(text, Not(HasSubstr("component rmw")));
  EXPECT_EQ(row_by_name(render({one}, Format::csv), 0).at("option.rmw"), "rmw_fastrtps_cpp");
  // One that failed before it could say is not another for that.
  auto failed = summary(asked("ros", "ros2"), {{"error", "no peer"}});
  failed.run.number = 2;
  EXPECT_THAT(render({one, failed}, Format::table),
              AllOf(HasSubstr("\nros2 run 1 "), HasSubstr("\nros2 run 2 ")));
}

TEST(TableFormat, NamesTheOtherEndWhereItIsAnother) {
  std::vector<Summary> runs;
  for (const auto* component : {"cyclonedds", "fastdds"})
    for (const auto* rmw : {"rmw_a", "rmw_b"})
      runs.push_back(summary(asked("pair", "cyclonedds"), outcome())),
          amend(runs.back().run.asked, {{"component_transport", component},
                                        {"options", json::object()},
                                        {"component_options", {{"rmw", rmw}}}});
  const auto text = render(runs, Format::markdown);
  for (const auto* name :
       {"| cyclonedds component rmw\\_a |", "| cyclonedds component fastdds component rmw\\_b |"})
    EXPECT_THAT(text, HasSubstr(name));
}

TEST(TableFormat, SaysTheOtherEndsTransportOnce) {
  std::vector<Summary> runs;
  for (const auto* component : {"cyclonedds", "fastdds"}) {
    runs.push_back(summary(asked("pair", "cyclonedds"), outcome()));
    amend(runs.back().run.asked, "/component_transport", component);
    amend(runs.back().run.asked, "/variant", std::string("component.transport ") + component);
  }
  EXPECT_THAT(render(runs, Format::markdown),
              AllOf(HasSubstr("\n| cyclonedds |"), HasSubstr("\n| cyclonedds component fastdds |")));
}

TEST(TableFormat, AnOptionOfBothEndsIsShownOnce) {
  std::vector<Summary> runs;
  for (const auto* rmw : {"rmw_a", "rmw_b"}) {
    runs.push_back(summary(asked("pair", "ros2"), outcome()));
    amend(runs.back().run.asked, {{"options", {{"rmw", "rmw_a"}}},
                                  {"component_options", {{"rmw", rmw}}},
                                  {"variant", std::string("component.options.rmw ") + rmw}});
  }
  EXPECT_THAT(render(runs, Format::markdown),
              AllOf(HasSubstr("\n| ros2 |"), HasSubstr("\n| ros2 component rmw\\_b |")));
}

TEST(TableFormat, ShortensAnOverlongIdAndKeepsItApart) {
  const std::string beginning(59, 'a');
  const std::vector runs = {summary(asked(beginning + "long", "udp"), outcome()),
                            summary(asked(beginning + "longer", "udp"), outcome())};
  for (const auto format : {Format::table, Format::markdown, Format::latex, Format::html}) {
    const auto text = render(runs, format);
    EXPECT_THAT(text, Not(HasSubstr(beginning + "l")));
    const auto shortened = beginning + (format == Format::latex ? "\\ldots{}" : "…");
    const auto first = text.find(shortened);
    EXPECT_NE(first, text.npos);
    EXPECT_NE(text.find(shortened, first + 1), text.npos) << "they are two";
  }
  EXPECT_THAT(gate::name_of(runs.back()), beginning + "… udp (run 1)");
  EXPECT_THAT(render(runs, Format::json), HasSubstr(beginning + "longer"));
  EXPECT_THAT(render_threads(runs, Format::table), Not(HasSubstr(beginning + "l")));
}

TEST(TableFormat, NamesDomainAndTopicsWhereTheyAreNotTheUsualOnes) {
  const auto shown = [](const json& domain, const char* ping, const char* pong) {
    auto conditions = asked("a", "udp");
    conditions.update({{"domain", domain}, {"ping_topic", ping}, {"pong_topic", pong}});
    return render({summary(conditions, outcome())}, Format::markdown);
  };
  EXPECT_THAT(shown(0, "/ping", "/pong"), AllOf(Not(HasSubstr("domain")), Not(HasSubstr("topics"))));
  EXPECT_THAT(shown(42, "/robot/ping", "/robot/pong"),
              AllOf(HasSubstr("domain 42"), HasSubstr("topics /robot/ping and /robot/pong")));
}

TEST(TableFormat, NamesTheWayOfXdpOnce) {
  auto native = summary(asked("a", "xdp"), outcome()), generic = native;
  for (const auto* host : {"controller", "component"}) {
    amend(native.run.outcome, std::string("/hosts/") + host + "/transport/facts/xdp", "native copy");
    amend(generic.run.outcome, std::string("/hosts/") + host + "/transport/facts/xdp", "generic copy");
  }
  EXPECT_THAT(render({native, generic}, Format::table),
              AllOf(HasSubstr("\nxdp native copy "), HasSubstr("\nxdp generic copy ")));
}

TEST(TableFormat, NamesTheLinkWhereItWasAskedFor) {
  auto wired = asked("a", "udp"), wireless = wired;
  EXPECT_THAT(render({summary(wired, outcome())}, Format::table), Not(HasSubstr("over")));
  wired["interface"] = "eth1";
  wireless["interface"] = "wlan0";
  wireless["component_interface"] = "wlp2s0";
  EXPECT_THAT(render({summary(wired, outcome()), summary(wireless, outcome())}, Format::table),
              AllOf(HasSubstr("\nudp over eth1 "), HasSubstr("\nudp over wlan0 and wlp2s0 ")));
}

TEST(TableFormat, NamesTheSizeOfALoadsWorkers) {
  auto small = asked("a", "udp"), large = small;
  small["load"] = {{"controller", {{"vm", 2}, {"vm_bytes", 1 << 20}}}};
  large["load"] = {{"controller", {{"vm", 2}, {"vm_bytes", 1 << 30}}}};
  small["variant"] = "load.controller.vm-bytes 1 MiB";
  large["variant"] = "load.controller.vm-bytes 1 GiB";
  EXPECT_THAT(render({summary(small, outcome()), summary(large, outcome())}, Format::table),
              AllOf(HasSubstr("\nudp load: 2 vm of 1 MiB on the controller (NOT APPLIED)\n"),
                    HasSubstr("\nudp load: 2 vm of 1024 MiB on the controller (NOT APPLIED)\n")));
  large["load"]["controller"]["cpu"] = 8;
  EXPECT_THAT(render({summary(large, outcome())}, Format::markdown),
              HasSubstr("load: 8 cpu, 2 vm of 1024 MiB on the controller"));
}

TEST(TableFormat, AValueWithACommaIsOneValue) {
  auto one = asked("a", "udp"), other = one;
  one["variant"] = "title one, two, adds-to 3";
  other["variant"] = "title three, adds-to 3";
  const auto labels =
      AllOf(HasSubstr("\n| udp title one, two baseline 3 |"), HasSubstr("\n| udp title three baseline 3 |"));
  EXPECT_THAT(render({summary(one, outcome()), summary(other, outcome())}, Format::markdown), labels)
      << "of words alone";
  const auto pair = [](const char* key, const char* value) { return nlohmann::json::array({key, value}); };
  one["varied"] = nlohmann::json::array({pair("title", "one, two"), pair("baseline", "3")});
  other["varied"] = nlohmann::json::array({pair("title", "three"), pair("baseline", "3")});
  one["variant"] = other["variant"] = "anything, at all";
  EXPECT_THAT(render({summary(one, outcome()), summary(other, outcome())}, Format::markdown), labels);
  one["varied"] = nlohmann::json::array({pair("title", "baseline 7, period 3")});
  EXPECT_THAT(render({summary(one, outcome()), summary(other, outcome())}, Format::markdown),
              HasSubstr("\n| udp title baseline 7, period 3 |"));
}

TEST(TableFormat, PutsALongNameAboveItsNumbers) {
  std::vector<Summary> runs = {ros2("single", 1), ros2("multi", 2)};
  amend(runs[1].run.asked, "/options/rmw", "rmw_fastrtps_cpp");
  amend(runs[1].run.asked, "/options/config", std::string(500, 'x'));
  for (auto& run : runs) run.lost = 12345, run.sent = 123456;
  const auto text = render(runs, Format::table);
  for (const auto& line : lines_of(text)) EXPECT_LE(width_of(line), 100u) << line;
  EXPECT_THAT(text, HasSubstr("\nros2 rmw_cyclonedds_cpp executor single\n      "));
  EXPECT_THAT(text, HasSubstr("12345/123456"));
}

}  // namespace
}  // namespace ontime::report
