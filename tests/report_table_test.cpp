// SPDX-License-Identifier: Apache-2.0
#include "report/paper.hpp"
#include "report_fixture.hpp"

namespace ontime::report {
namespace {

using ::testing::AllOf;
using ::testing::AnyOf;
using ::testing::Contains;
using ::testing::Each;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

TEST(TableFormat, IsThePapersWithPercentiles) {
  auto one = summary(asked("Test1.B", "cyclonedds"), outcome(), 20'000);
  one.on_time = 19'000;
  one.late = 900;
  one.lost = 100;
  const auto text = render({one}, Format::table);
  EXPECT_THAT(row_of(text, "cyclonedds"), ElementsAre("cyclonedds", "1.0", "10000", "10000", "18000", "19800",
                                                      "19980", "~19998", "20000", "900/20000", "100/20000"));
  EXPECT_THAT(text, StartsWith("Test1.B  System under load\nSCHED_OTHER, 500 B, every 10 ms, next-free"));
  EXPECT_THAT(text, HasSubstr("later than 10 ms"));
  EXPECT_THAT(text, HasSubstr("within 500 ms"));
}

TEST(TableFormat, ShowsAPercentileOnlyIfThereAreAnswersToTellIt) {
  const auto cells = [](std::size_t answers) {
    return row_of(render({summary(asked("a", "udp"), outcome(), answers)}, Format::table), "udp");
  };
  EXPECT_THAT(cells(0), ElementsAre("udp", "-", "-", "-", "-", "-", "-", "-", "-", "0/0", "0/0"));
  EXPECT_EQ(cells(1).at(3), "-");
  EXPECT_EQ(cells(2).at(3), "~1.0");
  EXPECT_EQ(cells(19).at(3), "~10.0");
  EXPECT_EQ(cells(20).at(3), "10.0");
  EXPECT_EQ(cells(9).at(4), "-");
  EXPECT_EQ(cells(10).at(4), "~9.0");
  EXPECT_EQ(cells(999).at(6), "-");
  EXPECT_EQ(cells(1000).at(6), "~999");
  EXPECT_EQ(cells(10'000).at(6), "9990");
  EXPECT_EQ(cells(9'999).at(7), "-");
  EXPECT_EQ(cells(10'000).at(7), "~9999");
  EXPECT_EQ(cells(100'000).at(7), "99990");
  EXPECT_THAT(render({summary(asked("a", "udp"), outcome(), 100'000)}, Format::table), Not(HasSubstr("~")));
}

Summary with_certainty() {
  auto one = summary(asked("a", "udp"), outcome(), 100'000);
  one.round_trip_certainty.p50 = {50e6, {49e6, 51e6}, {}};
  one.round_trip_certainty.p99 = {99e6, {98.5e6, 99.5e6}, {}};
  one.round_trip_certainty.p99_9 = {99.9e6, {99.8e6, {}}, {}};
  one.missed_probability.messages = 100'000;
  one.missed_probability.bound = 3e-5;
  one.message_every_ns = 1e7;
  return one;
}

TEST(TableFormat, SaysHowSureItIs) {
  auto one = with_certainty();
  auto text = render({one}, Format::table);
  // What nothing bounds from above is not printed as if it were known.
  EXPECT_EQ(row_of(text, "udp").at(6), ">");
  EXPECT_THAT(text, HasSubstr("[49000, 51000]  [98500, 99500]  > 99800"));
  EXPECT_THAT(text, HasSubstr("< 0.003"));
  EXPECT_THAT(text, HasSubstr("none late or lost; to claim less than 1 in a million: 3.0 million so, 8.3 h"));
  EXPECT_THAT(text, HasSubstr(">: too few"));
  one.missed_probability.events = 200;
  one.missed_probability.sure = {0.001, 0.003};
  one.bursts = {2, 7, 70'000'000};
  text = render({one}, Format::table);
  EXPECT_THAT(text, HasSubstr("[0.1, 0.3]"));
  EXPECT_THAT(text,
              HasSubstr("2 bursts of late or lost messages in a row, the longest of 7 messages, 70 ms"));
}

TEST(TableFormat, GivesABoundOrSaysWhyThereIsNone) {
  auto one = with_certainty();
  statistics::Bound bound;
  bound.level = 5e6;
  bound.level_lies = {4e6, 7e6};
  bound.fit_p = 0.3;
  one.extremes.maxima = one.extremes.peaks = bound;
  EXPECT_THAT(render({one}, Format::table),
              HasSubstr("5000 [4000, 7000]  0.3  5000 [4000, 7000]  0.3      1"));
  one.extremes.peaks->refused = "it drifts";
  const auto text = render({one}, Format::table);
  EXPECT_THAT(text, HasSubstr("this data does not allow a bound on the slowest, because it drifts"));
  EXPECT_THAT(text, Not(HasSubstr("5000 [4000")));
}

TEST(TableFormat, ShowsEachStageOfAResponse) {
  auto one = summary(asked("a", "udp"), outcome(), 10'000);
  one.server = one.round_trip;
  one.wake_up.p99_9 = 77'000;
  const auto lines = lines_of(render({one}, Format::table));
  const auto header = std::find_if(lines.begin(), lines.end(),
                                   [](const std::string& line) { return line.starts_with("p99.9 (µs)"); });
  ASSERT_NE(header, lines.end());
  EXPECT_THAT(row_of(*std::next(header), "udp"),
              ElementsAre("udp", "77.0", "-", "9990", "-", "9990", "9990"));
}

TEST(TableFormat, GivesWholeMicrosecondsFromAHundredOn) {
  const auto shown = [](std::int64_t ns) {
    Summary one{};
    one.run.asked = asked("a", "udp");
    std::vector<std::int64_t> values = {ns};
    one.round_trip = statistics::distribution(values);
    return row_of(render({one}, Format::table), "udp").at(1);
  };
  EXPECT_EQ(shown(40), "0.0");
  EXPECT_EQ(shown(98'760), "98.8");
  EXPECT_EQ(shown(99'949), "99.9");
  EXPECT_EQ(shown(99'950), "100");
  EXPECT_EQ(shown(1'234'567), "1235");
}

TEST(TableFormat, FitsAHundredColumns) {
  std::vector<Summary> runs;
  for (const auto* id : {"Test1.A", "Test1.B"}) {
    for (const auto* transport : {"udp", "cyclonedds", "fastdds"}) {
      runs.push_back(summary(asked(id, transport), outcome(), 60'001));
      runs.back().lost = 1230;
      runs.back().skipped_cycles = 30'000;
      const auto sure = with_certainty();
      runs.back().round_trip_certainty = sure.round_trip_certainty;
      runs.back().missed_probability = sure.missed_probability;
    }
  }
  for (const auto& line : lines_of(render(runs, Format::table))) EXPECT_LE(width_of(line), 100u) << line;
  for (const auto& line : lines_of(render_threads(runs, Format::table)))
    EXPECT_LE(width_of(line), 100u) << line;
}

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
  for (const auto* head : {"Test1.A  S", "Test1.A  s", "Test1.B  S", "Test1.B  s"})  // times, then stages
    expected.insert(expected.end(), {head, "udp #1    ", "udp #2    ", "fastdds #1", "fastdds #2"});
  EXPECT_EQ(beginnings, expected);
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

TEST(TableFormat, HasNoNotesWhenThereIsNothingToSay) {
  const auto lines = lines_of(render({summary(asked("a", "udp"), outcome(), 100'000)}, Format::table));
  EXPECT_EQ(
      std::count_if(lines.begin(), lines.end(), [](const auto& line) { return line.starts_with("  udp"); }),
      0);
  EXPECT_THAT(lines, Each(Not(HasSubstr("not given"))));
}

TEST(TableFormat, NotesWhatWentWrong) {
  auto bad = outcome();
  bad["duplicates"] = 2;
  bad["strays"] = 1;
  bad["reordered"] = 3;
  bad["refused_sends"] = 4;
  bad["dropped_records"] = 5;
  bad["interrupted"] = true;
  bad["hosts"]["controller"]["load_running"] = false;
  auto one = summary(asked("a", "udp"), bad);
  one.skipped_cycles = 6;
  auto text = render({one}, Format::markdown);
  for (const auto* part :
       {"udp: interrupted", "load on the controller had died", "6 skipped cycles", "2000 µs", "2 duplicates",
        "1 stray answer;", "3 answers out of order", "4 messages refused", "5 samples not recorded"})
    EXPECT_THAT(text, HasSubstr(part));
  EXPECT_THAT(text, Not(HasSubstr("load on the component had died")));
  EXPECT_THAT(render({summary(asked("a", "udp"), nullptr)}, Format::table), HasSubstr("udp: not ended"));
  EXPECT_THAT(render({summary(asked("a", "udp"), {{"error", "no peer found"}})}, Format::table),
              HasSubstr("udp: failed: no peer found"));
}

TEST(TableFormat, TellsTheTrafficAndLoudlyWhereItWasNotThere) {
  auto with = asked("a", "udp");
  with["traffic"] = {{"bit_s", 80'000'000}, {"datagram_bytes", 1470}, {"direction", "both"}, {"priority", 0}};
  auto came = outcome();
  came["traffic"] = {
      {"to_component",
       {{"asked_bit_s", 80e6}, {"sent_bit_s", 80e6}, {"received_bit_s", 79.96e6}, {"short", false}}},
      {"to_controller",
       {{"asked_bit_s", 80e6}, {"sent_bit_s", 80e6}, {"received_bit_s", 80e6}, {"short", false}}}};
  auto text = render({summary(with, came)}, Format::markdown);
  EXPECT_THAT(text, HasSubstr("traffic: 80 Mbit/s each way in datagrams of 1470 B"));
  EXPECT_THAT(
      text, HasSubstr("udp: traffic: 79.96 Mbit/s of 80 arrived at the component, 80 Mbit/s of 80 arrived"));
  came["traffic"]["to_controller"] = {
      {"asked_bit_s", 80e6}, {"sent_bit_s", 38.2e6}, {"received_bit_s", nullptr}, {"short", true}};
  text = render({summary(with, came)}, Format::markdown);
  EXPECT_THAT(text,
              HasSubstr("NOT THE TRAFFIC THAT WAS ASKED FOR: 79.96 Mbit/s of 80 arrived at the component, "
                        "- Mbit/s of 80 arrived at the controller (38.2 sent)"));
  came["hosts"]["controller"]["link"] = {
      {"interface", "eth1"}, {"sent_bytes", 200'000'000}, {"received_bytes", 95'500'000}};
  EXPECT_THAT(render({summary(with, came)}, Format::markdown), Not(HasSubstr("other traffic")))
      << "it is ours";
}

TEST(Paper, AllItsRowsAreThere) {
  ASSERT_EQ(paper().size(), 45U);
  const auto& odd = paper().at(36);  // its title has a comma
  EXPECT_EQ(odd.test, "Test3.C");
  EXPECT_EQ(odd.dds, "DDS 1");
  EXPECT_EQ(odd.max_us, 179909);
  EXPECT_EQ(odd.lost, 75U);
  EXPECT_EQ(odd.messages, 30000U);
}

TEST(Paper, FiguresStandBesideOursWhereTheConditionsAreIts) {
  const auto text = render({summary(asked("Test1.B", "udp"), outcome())}, Format::table);
  EXPECT_THAT(text, HasSubstr("paper's DDS 1"));
  EXPECT_EQ(row_of(text, "paper's DDS 2"), (std::vector<std::string>{"paper's", "DDS", "2", "1082", "2150",
                                                                     "26764", "236/58905", "0/58905"}));
  EXPECT_THAT(text, HasSubstr("2018"));
  const auto run =
      json::parse(render({summary(asked("Test1.B", "udp"), outcome())}, Format::json)).at("runs").at(0);
  EXPECT_EQ(run.at("paper").at(2).at("avg_us"), 2750);
  const json others = {{"id", "Test9.A"}, {"period_us", 5000}, {"payload_bytes", 501}, {"schedule", "fixed"}};
  for (const auto& [key, value] : others.items()) {
    auto other = asked("Test1.B", "udp");
    other[key] = value;
    EXPECT_THAT(render({summary(other, outcome())}, Format::table), Not(HasSubstr("paper"))) << key;
  }
}

TEST(TableFormat, TellsWhatTheKernelDroppedAndWhatWasOurs) {
  auto came = outcome();
  came["hosts"]["component"]["drops"] = {{"own_sockets", 12}, {"udp_receive", 12}, {"backlog", 3}};
  came["hosts"]["controller"]["link"]["faults"] = {{"lost_frames", 7}, {"cut_off_frames", 1}};
  const auto text = render({summary(asked("a", "udp"), came)}, Format::markdown);
  EXPECT_THAT(
      text,
      HasSubstr("dropped by the kernel: 12 for want of room in the sockets of the component's middleware, "
                "3 in the queues of the component's CPUs"));
  EXPECT_THAT(
      text,
      HasSubstr("lost by link.loss 7 frames that came to the controller, cut off by link.cut 1 frame that"));
}

TEST(TableFormat, NotesEachRefusalOnce) {
  auto refused = outcome();
  const auto refusal = [](const char* what) {
    return json{{"asked", what}, {"found", "Operation not permitted"}, {"remedy", "run as root"}};
  };
  for (const auto* host : {"controller", "component"})
    refused["hosts"][host]["refusals"] = {refusal("SCHED_FIFO 80 for thread send"), refusal("locked memory")};
  const auto text =
      render({summary(asked("a", "udp"), refused), summary(asked("a", "fastdds"), refused)}, Format::table);
  EXPECT_THAT(text, HasSubstr("Asked but not given: SCHED_FIFO 80 for thread send, locked memory;\n"
                              "  found: Operation not permitted;\n"
                              "  to permit it: run as root\n"));
  EXPECT_EQ(text.find("run as root"), text.rfind("run as root"));
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
  for (const auto& entry : json::parse(render_threads(runs, Format::json)))
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
          runs.back().run.asked.update({{"component_transport", component},
                                        {"options", json::object()},
                                        {"component_options", {{"rmw", rmw}}}});
  const auto text = render(runs, Format::markdown);
  for (const auto* name :
       {"| cyclonedds component rmw\\_a |", "| cyclonedds component fastdds component rmw\\_b |"})
    EXPECT_THAT(text, HasSubstr(name));
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
              AllOf(HasSubstr("\nudp load: 2 vm of 1 MiB on the controller\n"),
                    HasSubstr("\nudp load: 2 vm of 1024 MiB on the controller\n")));
}

TEST(TableFormat, PutsALongNameAboveItsNumbers) {
  std::vector<Summary> runs = {ros2("single", 1), ros2("multi", 2)};
  runs[1].run.asked["options"]["rmw"] = "rmw_fastrtps_cpp";
  runs[1].run.asked["options"]["config"] = std::string(500, 'x');
  for (auto& run : runs) run.lost = 12345, run.sent = 123456;
  const auto text = render(runs, Format::table);
  for (const auto& line : lines_of(text)) EXPECT_LE(width_of(line), 100u) << line;
  EXPECT_THAT(text, HasSubstr("\nros2 rmw_cyclonedds_cpp executor single\n      "));
  EXPECT_THAT(text, HasSubstr("12345/123456"));
}

TEST(TableFormat, ShowsWhereJudgingByResponseDiffers) {
  auto one = summary(asked("a", "udp"), outcome());
  one.late = 3;
  one.skipped_cycles = 57;
  one.late_by_response = 3;
  auto text = render({one}, Format::table);
  EXPECT_THAT(text, AllOf(HasSubstr("3/2000"), Not(HasSubstr("response:"))));
  auto other = one;
  other.run.asked["transport"] = "fastdds";
  other.late_by_response = 41;
  text = render({one, other}, Format::table);
  EXPECT_EQ(row_of(text, "udp").at(9), "3/2000");
  EXPECT_EQ(row_of(text, "udp").at(10), "3/2057");
  EXPECT_EQ(row_of(text, "fastdds").at(9), "3/2000");
  EXPECT_EQ(row_of(text, "fastdds").at(10), "41/2057");
  EXPECT_THAT(text, AllOf(HasSubstr("by response: so late"), HasSubstr("57 skipped cycles")));
  EXPECT_EQ(json::parse(render({other}, Format::json)).at("runs").at(0).at("late_by_response"), 41);
}

TEST(TableFormat, ShowsTheThreeParts) {
  const auto with = [](std::int64_t there_us, bool one_clock, int repetition) {
    auto one = summary(asked("a", "udp", repetition), outcome());
    one.parts = statistics::Parts{statistics::distribution({there_us * 1000}),
                                  statistics::distribution({11'000}), one_clock ? 0 : 7000, one_clock};
    one.server = statistics::distribution({5000});
    return one;
  };
  EXPECT_THAT(lines_of(render({with(12, true, 1)}, Format::table)),
              Contains("  udp: there 12.0 µs, at the component 5.0, back 11.0 (medians; one clock)"));
  EXPECT_THAT(
      lines_of(render({with(12, false, 1), with(14, false, 2)}, Format::table)),
      Contains(StartsWith("  udp: there 13.0 µs, at the component 5.0, back 11.0 (medians of 2 runs; ")));
  EXPECT_THAT(render({with(12, false, 1)}, Format::table), HasSubstr("synchronised to ±7.0 µs"));
  const auto run = json::parse(render({with(12, false, 1)}, Format::json)).at("runs").at(0);
  EXPECT_EQ(run.at("there_us").at("p50"), 12.0);
  EXPECT_EQ(run.at("back_us").at("p50"), 11.0);
  EXPECT_EQ(run.at("parts"), json({{"clocks", "synchronised"}, {"error_us", 7.0}, {"left_out", nullptr}}));

  auto without = summary(asked("a", "udp"), outcome());
  EXPECT_EQ(json::parse(render({without}, Format::json)).at("runs").at(0).at("parts"), nullptr);
  without.no_parts = "not shown in parts: the clocks disagree";
  EXPECT_THAT(render({without}, Format::table), HasSubstr("udp: not shown in parts: the clocks disagree"));
}

}  // namespace
}  // namespace ontime::report
