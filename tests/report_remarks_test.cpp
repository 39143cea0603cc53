// SPDX-License-Identifier: Apache-2.0
#include "json.hpp"
#include "report/runs.hpp"
#include "report_fixture.hpp"

namespace ontime::report {
namespace {

using ::testing::AllOf;
using ::testing::Each;
using ::testing::HasSubstr;
using ::testing::Not;

TEST(TableFormat, HasNoNotesWhenThereIsNothingToSay) {
  const auto lines = lines_of(render({summary(asked("a", "udp"), outcome(), 100'000)}, Format::table));
  EXPECT_EQ(
      std::count_if(lines.begin(), lines.end(), [](const auto& line) { return line.starts_with("  udp"); }),
      0);
  EXPECT_THAT(lines, Each(Not(HasSubstr("denied"))));
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
       {"udp: interrupted", "load on the controller", "skipped cycles: 6", "duplicates: 2",
        "stray answers: 1;", "answers out of order: 3", "refused by the transport: 4", "(missing above): 5"})
    EXPECT_THAT(text, HasSubstr(part));
  EXPECT_THAT(text, Not(HasSubstr("load on the component")));
  EXPECT_THAT(render({summary(asked("a", "udp"), nullptr)}, Format::table), HasSubstr("udp: not ended"));
  EXPECT_THAT(render({summary(asked("a", "udp"), {{"error", "no peer found"}})}, Format::table),
              HasSubstr("udp: failed: no peer found"));
}

TEST(Remarks, LoadThatAnOlderOntimeDividedAmongItsWorkersIsMarked) {
  auto of_two = asked("a", "udp");
  of_two["load"] = {{"controller", {{"vm", 2}, {"vm_bytes", 64 << 20}}}};
  auto of_run = outcome();
  of_run["hosts"]["controller"]["load_running"] = true;
  of_run["hosts"]["controller"].erase("load");
  EXPECT_THAT(render({summary(of_two, of_run)}, Format::markdown),
              HasSubstr("divided 64 MiB among 2 vm workers"));
  of_run["hosts"]["controller"]["load"] = {{"vm_bytes", 64 << 20}};
  EXPECT_THAT(render({summary(of_two, of_run)}, Format::markdown), Not(HasSubstr("divided")));
}

TEST(Remarks, HddFilesThatNeverHadHalfTheirSizeAreMarked) {
  auto of_run = outcome();
  auto& load = of_run["hosts"]["controller"]["load"];
  const auto text = [&](std::uint64_t seen) {
    load = {{"hdd_bytes", 1 << 30}, {"hdd_file_bytes", seen}};
    return render({summary(asked("a", "udp"), of_run)}, Format::markdown);
  };
  EXPECT_THAT(text(300 << 20), AllOf(HasSubstr("HDD LOAD SHORTFALL"), HasSubstr("300 MiB")));
  EXPECT_THAT(text(0), HasSubstr("HDD LOAD SHORTFALL"));
  EXPECT_THAT(text(600 << 20), Not(HasSubstr("HDD LOAD")));
  load = {{"hdd_bytes", 1 << 30}};  // of an older ontime, which did not look
  EXPECT_THAT(render({summary(asked("a", "udp"), of_run)}, Format::markdown), Not(HasSubstr("HDD LOAD")));
}

TEST(Remarks, CpusThatOtherProgramsKeepBusyAreToldWhereNoLoadWasRequested) {
  auto of_run = outcome();
  for (const auto* host : {"controller", "component"}) of_run["conditions"][host]["cpu_busy"] = 0.97;
  auto quiet = asked("a", "udp");
  quiet.erase("load");
  const auto text = [&](const nlohmann::json& requested) {
    return render({summary(requested, of_run)}, Format::markdown);
  };
  EXPECT_THAT(text(quiet), HasSubstr("CPUs were 97 % busy"));
  for (const auto* host : {"controller", "component"}) of_run["conditions"][host]["cpu_stolen"] = 0.9;
  EXPECT_THAT(text(quiet), Not(HasSubstr("% busy"))) << "the hypervisor was, which is told apart";
  for (const auto* host : {"controller", "component"}) of_run["conditions"][host]["cpu_stolen"] = 0.01;
  EXPECT_THAT(text(quiet), HasSubstr("CPUs were 96 % busy"));
  EXPECT_THAT(text(asked("a", "udp")), Not(HasSubstr("% busy")));
  auto polling = quiet;
  polling["options"]["busy-poll"] = "on";
  EXPECT_THAT(text(polling), Not(HasSubstr("% busy")));
  of_run["conditions"]["controller"]["cpu_busy"] = of_run["conditions"]["component"]["cpu_busy"] = 0.5;
  EXPECT_THAT(text(quiet), Not(HasSubstr("% busy")));
}

TEST(TableFormat, TellsTheTrafficAndLoudlyWhereItWasNotThere) {
  auto with = asked("a", "udp");
  with["traffic"] = {{"bit_s", 80'000'000}, {"datagram_bytes", 1470}, {"direction", "both"}, {"priority", 0}};
  auto came = outcome();
  came["traffic"] = {
      {"to_component",
       {{"asked_bit_s", 80'000'000}, {"sent_bit_s", 80e6}, {"received_bit_s", 79.96e6}, {"short", false}}},
      {"to_controller",
       {{"asked_bit_s", 80'000'000}, {"sent_bit_s", 80e6}, {"received_bit_s", 80e6}, {"short", false}}}};
  auto text = render({summary(with, came)}, Format::markdown);
  EXPECT_THAT(text, HasSubstr("traffic: 80 Mbit/s each way in datagrams of 1470 B"));
  EXPECT_THAT(
      text, HasSubstr("udp: traffic: 79.96 Mbit/s of 80 arrived at the component, 80 Mbit/s of 80 arrived"));
  came["traffic"]["to_controller"] = {
      {"asked_bit_s", 80'000'000}, {"sent_bit_s", 38.2e6}, {"received_bit_s", nullptr}, {"short", true}};
  text = render({summary(with, came)}, Format::markdown);
  EXPECT_THAT(text, HasSubstr("TRAFFIC SHORTFALL: 79.96 Mbit/s of 80 arrived at the component, "
                              "- Mbit/s of 80 arrived at the controller (38.2 sent)"));
  came["hosts"]["controller"]["link"] = {
      {"interface", "eth1"}, {"sent_bytes", 200'000'000}, {"received_bytes", 95'500'000}};
  EXPECT_THAT(render({summary(with, came)}, Format::markdown), Not(HasSubstr("other traffic")))
      << "it is ours";
}

TEST(TableFormat, TellsWhatTheKernelDroppedAndWhatWasOurs) {
  auto came = outcome();
  came["hosts"]["component"]["drops"] = {{"own_sockets", 12}, {"udp_receive", 12}, {"backlog", 3}};
  came["hosts"]["controller"]["drops"] = {{"own_sockets", 0}, {"udp_receive", 5}};
  came["hosts"]["controller"]["link"]["faults"] = {{"lost_frames", 7}, {"cut_off_frames", 1}};
  const auto text = render({summary(asked("a", "udp"), came)}, Format::markdown);
  EXPECT_THAT(
      text,
      HasSubstr(
          "dropped by the kernel: 5 because a UDP socket buffer on the controller was full (any process), "
          "12 because a socket buffer of the component's middleware was full, 3 in the component's"));
  EXPECT_THAT(
      text,
      HasSubstr("link.loss dropped 7 frames to the controller, link.cut dropped 1 frame to the controller"));
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
  EXPECT_THAT(text, HasSubstr("Requested, denied: SCHED_FIFO 80 for thread send, locked memory;\n"
                              "  found: Operation not permitted;\n"
                              "  fix: run as root\n"));
  EXPECT_EQ(text.find("run as root"), text.rfind("run as root"));
}

TEST(Remarks, TellThatAMachineSleptOrItsClockWasMoved) {
  auto facts = outcome();
  facts["conditions"]["controller"] = {{"suspended_s", 61.26}, {"clock_moved_s", 0.002}};
  facts["conditions"]["component"] = {{"suspended_s", 0}, {"clock_moved_s", -3600.0}};
  const auto text = render({summary(asked("a", "udp"), facts)}, Format::markdown);
  EXPECT_THAT(text, HasSubstr("the controller's machine was suspended for 61.3 s"));
  EXPECT_THAT(text, HasSubstr("the system clock of the component's machine was moved by -3600.0 s"));
  EXPECT_THAT(text, Not(HasSubstr("the system clock of the controller's")));
}

TEST(Remarks, WakeUpAfterSkippedCyclesCountsFromTheFirstOfThem) {
  auto one = summary(asked("a", "udp"), outcome());
  statistics::Worst worst;
  worst.took_ns = 31'349'000;
  worst.message.intended_ns = 10'000'000;
  worst.message.due_ns = 30'000'000;
  worst.message.woke_ns = 39'550'000;
  worst.message.passed_wake_ns = 29'550'000;
  worst.message.skipped_cycles = 2;
  one.shape.worst = {worst};
  EXPECT_THAT(render({one}, Format::markdown), HasSubstr("wake-up latency was 94 %"));
}

TEST(Remarks, ClockThatWasSlewedIsNamedFrom500PpmOn) {
  auto facts = outcome();
  facts["conditions"]["controller"] = {{"clock_slew_ppm", 90'000.4}};
  facts["conditions"]["component"] = {{"clock_slew_ppm", -499.0}};
  const auto text = render({summary(asked("a", "udp"), facts)}, Format::markdown);
  EXPECT_THAT(text, HasSubstr("the controller's machine was slewed by +90000 ppm"));
  EXPECT_THAT(text, Not(HasSubstr("the component's machine was slewed")));
}

TEST(Remarks, TellOfOneMachineOnce) {
  auto facts = outcome();
  for (const auto* host : {"controller", "component"}) {
    facts["conditions"][host] = {{"suspended_s", 61.26}, {"clock_moved_s", 0}};
    facts["hosts"][host]["machine"]["boot_id"] = "b";
  }
  const auto text = render({summary(asked("a", "udp"), facts)}, Format::markdown);
  EXPECT_THAT(text, HasSubstr("the machine was suspended for 61.3 s"));
  EXPECT_EQ(text.find("suspended"), text.rfind("suspended"));
}

TEST(Remarks, CpuQuotaThatStoppedTheGroupIsOneCautionOfAllRows) {
  auto facts = outcome();
  facts["hosts"]["component"]["threads"][1]["policy"] = "other";
  std::vector<Summary> runs;
  for (const std::int64_t ns : {2'700'000'000L, 120'000'000L}) {
    facts["hosts"]["component"]["cpu_quota"] = {
        {"cpus", 0.12}, {"throttled_periods", 54}, {"throttled_ns", ns}};
    runs.push_back(summary(asked("a", "udp", static_cast<int>(runs.size())), facts));
  }
  EXPECT_THAT(render(runs, Format::markdown),
              AllOf(HasSubstr("quota of 0.12 CPUs stopped the component's control group for 120 ms to 2.7 s"),
                    Not(HasSubstr("the controller's control group"))));
  facts["hosts"]["component"]["threads"][1]["policy"] = "fifo";
  EXPECT_THAT(render({summary(asked("a", "udp"), facts)}, Format::markdown), Not(HasSubstr("quota")));
}

TEST(Remarks, NameStolenTimeAndSuspectedThrottling) {
  auto facts = outcome();
  facts["conditions"]["component"]["cpu_stolen"] = 0.0213;
  facts["conditions"]["controller"]["cpu_stolen"] = 0.0001;
  facts["hosts"]["controller"]["machine"]["rt_runtime_us"] = 950'000;
  facts["hosts"]["controller"]["machine"]["rt_period_us"] = 1'000'000;
  auto as_asked = asked("a", "udp");
  as_asked["realtime"] = true;
  auto one = summary(as_asked, facts);
  one.wake_up.max = 50'500'000;
  statistics::Worst worst;
  worst.took_ns = 60'000'000;
  worst.message.due_ns = 1'000'000'000;
  worst.message.woke_ns = 1'050'500'000;
  one.shape.worst = {worst};
  auto text = render({one}, Format::markdown);
  EXPECT_THAT(text, HasSubstr("the hypervisor took 2.1 % of the component's CPU time"));
  EXPECT_THAT(text, Not(HasSubstr("of the controller's CPU time")));
  EXPECT_THAT(text, HasSubstr("wake-up latency was 84 % of the longest answered wait"));
  EXPECT_THAT(text, HasSubstr("sender woke 50.5 ms late; likely cause: RT throttling (kernel."));
  const auto document = parsed_json(render({one}, Format::json));
  EXPECT_THAT(document.at("runs").at(0).at("remarks").get<std::string>(), HasSubstr("RT throttling"));
  for (const auto* host : {"controller", "component"}) {
    facts["conditions"][host]["cpu_stolen"] = 0.0213;
    facts["hosts"][host]["machine"]["boot_id"] = "one";
  }
  text = render({summary(as_asked, facts)}, Format::markdown);
  EXPECT_THAT(text, HasSubstr("the hypervisor took 2.1 % of CPU time (steal)"));
  EXPECT_THAT(text, Not(HasSubstr("of the component's CPU time")));
  one.lost_wait_ns = 510'000'000;
  EXPECT_THAT(render({one}, Format::markdown), Not(HasSubstr("wake-up latency was")))
      << "a lost message's cycle waited longer";
  one.lost_wait_ns = 0;
  one.response.max = 61'000'000;
  EXPECT_THAT(render({one}, Format::markdown), Not(HasSubstr("wake-up latency was"))) << "a skipped cycle";
  one.response.max = one.open_wait_ns = 2'000'000'000;
  EXPECT_THAT(render({one}, Format::markdown), HasSubstr("wake-up latency was 84 %")) << "that had no answer";
  one.shape.worst[0].message.woke_ns = 1'020'000'000;
  one.wake_up.max = 20'000'000;
  text = render({one}, Format::markdown);
  EXPECT_THAT(text, Not(HasSubstr("wake-up latency was")));
  EXPECT_THAT(text, Not(HasSubstr("throttling")));
}

TEST(Remarks, ACompleteRunThatSentNothingSaysWhyItIsNotApplied) {
  auto one = summary(asked("a", "udp"), outcome());
  one.sent = 0;
  EXPECT_THAT(remarks(one), HasSubstr("no message was sent"));
  one.sent = 1;
  EXPECT_THAT(remarks(one), Not(HasSubstr("no message was sent")));
}

TEST(Remarks, NotesOfASearchForSettingsAreNone) {
  auto one = summary(asked("a", "udp"), outcome());
  const auto none = remarks(one);
  for (const auto* kind : {"search", "search-goal", "search-run", "search-settings"})
    for (int i = 0; i < 3; ++i) one.notes.push_back({kind, "realtime: on", {}, {}});
  EXPECT_EQ(remarks(one), none);
  one.notes.push_back({"peer-left", "the pong left", {}, {}});
  EXPECT_THAT(remarks(one), HasSubstr("the pong left"));
}

TEST(Remarks, ACountThatOnlyADamagedFileHasIsShown) {
  auto one = summary(asked("a", "udp"), outcome());
  one.skipped_cycles = UINT64_MAX;
  EXPECT_THAT(remarks(one), HasSubstr("skipped cycles: 9,223,372,036,854,775,808"));
}

TEST(Remarks, SuspectThrottlingAtTheComponentToo) {
  auto facts = outcome();
  facts["hosts"]["component"]["machine"].update({{"rt_runtime_us", 950'000}, {"rt_period_us", 1'000'000}});
  auto as_asked = asked("a", "udp");
  as_asked["realtime"] = true;
  const auto said = [&](std::int64_t answered_ns, std::int64_t there_ns) {
    auto one = summary(as_asked, facts);
    one.server.max = answered_ns;
    one.parts.emplace();
    one.parts->there[statistics::Figure::p50] = 40'000;
    one.parts->there.max = there_ns;
    return remarks(one);
  };
  EXPECT_THAT(said(51'000'000, 0), AllOf(HasSubstr("answered 51 ms late"), HasSubstr("RT throttling")));
  EXPECT_THAT(said(0, 52'040'000), AllOf(HasSubstr("received 52 ms late"), HasSubstr("RT throttling")));
  EXPECT_THAT(said(20'000'000, 20'000'000), Not(HasSubstr("throttling")));
  as_asked["link"] = {{"delay_us", 60'000}};
  EXPECT_THAT(said(0, 52'040'000), Not(HasSubstr("throttling"))) << "the link was asked to be slow";
  facts["hosts"]["component"]["machine"]["rt_runtime_us"] = -1;
  EXPECT_THAT(said(51'000'000, 0), Not(HasSubstr("throttling"))) << "it is off";
}

// The kernel's word counts, not what was requested: ordinary threads are never throttled.
TEST(Remarks, BlameThrottlingOnlyWhereTheKernelHadRealTimeThreads) {
  auto facts = outcome();
  facts["hosts"]["controller"]["machine"] = {{"rt_runtime_us", 950'000}, {"rt_period_us", 1'000'000}};
  auto as_asked = asked("a", "udp");
  as_asked["realtime"] = true;
  const auto said = [&] {
    auto one = summary(as_asked, facts);
    one.wake_up.max = 54'500'000;
    return remarks(one);
  };
  EXPECT_THAT(said(), AllOf(HasSubstr("RT throttling"), Not(HasSubstr("fair server"))));
  for (const auto* policy : {"rr", "deadline"}) {
    facts["hosts"]["controller"]["threads"][0]["policy"] = policy;
    EXPECT_THAT(said(), HasSubstr("RT throttling")) << policy;
  }
  facts["hosts"]["controller"]["threads"][0]["policy"] = "other";
  EXPECT_THAT(said(), Not(HasSubstr("throttling")));
}

TEST(Remarks, NameTheOneMechanismOfTheKernel) {
  auto facts = outcome();
  int runtime_us = 950'000;
  const auto said = [&](const char* release) {
    facts["hosts"]["controller"]["machine"] = {
        {"kernel_release", release}, {"rt_runtime_us", runtime_us}, {"rt_period_us", 1'000'000}};
    auto one = summary(asked("a", "udp"), facts);
    one.wake_up.max = 54'500'000;
    return remarks(one);
  };
  for (const auto* release : {"6.1.0-56-rt-amd64", "5.10.0-32-rt", "6.11.9"})
    EXPECT_THAT(said(release), AllOf(HasSubstr("RT throttling"), Not(HasSubstr("fair server")))) << release;
  for (const auto* release : {"6.12.0", "6.18.44-fc", "7.0"})
    EXPECT_THAT(said(release), HasSubstr("fair server or RT throttling")) << release;
  runtime_us = -1;
  EXPECT_THAT(said("6.12.0"), AllOf(HasSubstr("fair server"), Not(HasSubstr("RT throttling"))))
      << "it is off";
}

TEST(Remarks, AreSaidOnceForAllRunsThatHaveThem) {
  std::vector<Summary> runs;
  double stolen = 0.01;
  for (const auto* id : {"a", "b"})
    for (const auto* transport : {"udp", "fastdds"}) {
      auto facts = outcome();
      facts["conditions"]["controller"]["cpu_stolen"] = stolen;
      stolen += 0.02;
      if (runs.empty()) facts["duplicates"] = 2;
      runs.push_back(summary(asked(id, transport), facts));
    }
  const auto text = render(runs, Format::markdown);
  EXPECT_THAT(text, HasSubstr("all runs: the hypervisor took 1 % to 7 % of the controller's CPU time"));
  EXPECT_EQ(text.find("hypervisor"), text.rfind("hypervisor"));
  EXPECT_THAT(text, HasSubstr("a udp: duplicates: 2"));
  amend(runs[0].run.outcome, "/conditions/controller/cpu_stolen", 0.997);
  EXPECT_THAT(render(runs, Format::markdown), HasSubstr("the hypervisor took 3 % to 99.7 %"));
}

TEST(Remarks, TellThatNothingWasAnsweredAnyMore) {
  auto one = summary(asked("a", "udp"), outcome());
  one.sent = 500;
  one.start_ns = 1'000'000'000;
  one.unanswered_from_ns = 4'200'000'000;
  one.unanswered_at_end = 180;
  EXPECT_THAT(remarks(one), HasSubstr("no answers from 3.2 s to the end: 180 messages"));
  one.unanswered_at_end = 9;
  EXPECT_THAT(remarks(one), HasSubstr("no answers from")) << "it waited for each";
  one.unanswered_from_ns = 20'200'000'000;  // 0.8 s before the end
  EXPECT_THAT(remarks(one), Not(HasSubstr("no answers from"))) << "they may as well be lost";
}

TEST(Remarks, RecordingHasNoController) {
  auto of = asked("/scan", "cyclonedds");
  of["measures"] = "period";
  auto facts = outcome();
  facts["conditions"]["controller"]["cpu_stolen"] = 0.02;
  facts["hosts"].erase("component");
  EXPECT_THAT(remarks(summary(of, facts)), HasSubstr("the hypervisor took 2 % of CPU time (steal)"));
}

TEST(Remarks, SayThatAMachineIsSimulated) {
  auto facts = outcome();
  facts["hosts"]["controller"]["machine"]["simulated"] = nullptr;
  EXPECT_THAT(render({summary(asked("a", "udp"), facts)}, Format::table), Not(HasSubstr("SIMULATED")));
  facts["hosts"]["controller"]["machine"]["simulated"] = "QEMU 7.2.22\033, e1000e";
  auto text = render({summary(asked("a", "udp"), facts)}, Format::markdown);
  EXPECT_THAT(text, HasSubstr("SIMULATED by QEMU 7.2.22"));
  EXPECT_THAT(text, HasSubstr("predicts no real machine's times"));
  EXPECT_THAT(text, Not(HasSubstr("\033")));
}

TEST(Remarks, TellLossesApart) {
  auto lossy = outcome();
  lossy["hosts"]["controller"]["losses"] = {{"on_the_way", 9}, {"overwritten", 0}};
  lossy["hosts"]["component"]["losses"] = {{"on_the_way", nullptr}, {"overwritten", 12}};
  const auto text = render({summary(asked("a", "udp"), lossy)}, Format::markdown);
  EXPECT_THAT(text, AllOf(HasSubstr("overwritten before they were read: 12 at the component;"),
                          HasSubstr("lost on the way: 9 to the controller")));
  EXPECT_EQ(row_by_name(render({summary(asked("a", "udp"), lossy)}, Format::csv), 0)
                .at("component_lost_overwritten"),
            "12");
}

TEST(Remarks, TellOfLaunchTimesThatWereMissed) {
  auto facts = outcome();
  facts["hosts"]["controller"]["link"]["etf"] = {{"launched_frames", 90}, {"dropped_frames", 0}};
  facts["hosts"]["component"]["link"]["etf"] = {{"launched_frames", 90}, {"dropped_frames", 3}};
  auto conditions = asked("a", "udp");
  conditions["launch_us"] = 300;
  const auto text = render({summary(conditions, facts)}, Format::markdown);
  EXPECT_THAT(text, HasSubstr("etf dropped 3 frames of the component"));
  EXPECT_THAT(text, HasSubstr("launched 300 µs after it was due"));
}

TEST(Remarks, TellOfOtherTrafficOnTheLink) {
  auto requested = asked("a", "udp");
  const auto with = [&](const char* interface, std::uint64_t bytes) {
    auto linked = outcome();
    for (auto& host : linked["hosts"]) {
      host["machine"]["boot_id"] = "b";
      host["link"] = {{"interface", interface}, {"sent_bytes", bytes}, {"received_bytes", bytes}};
    }
    linked["hosts"]["component"]["link"]["interface"] = "lo";
    return render({summary(requested, linked)}, Format::markdown);
  };
  EXPECT_THAT(with("lo", 1'300'000), Not(HasSubstr("other traffic")));
  const auto text = with("lo", 80'000'000);
  EXPECT_THAT(text, HasSubstr("other traffic on lo of the controller: 160 MB in total"));
  EXPECT_THAT(text, Not(HasSubstr("of the component"))) << "it is the same";
  EXPECT_THAT(with("eth1", 80'000'000),
              AllOf(HasSubstr("eth1 of the controller"), HasSubstr("lo of the component")));
  requested["others"]["base"]["payload_bytes"] = 20'000;
  EXPECT_THAT(with("eth1", 80'000'000), Not(HasSubstr("other traffic"))) << "nothing tells how many";
  requested["others"]["base"] = {{"traffic", {{"bit_s", 20'000'000}}}};
  EXPECT_THAT(with("eth1", 80'000'000), Not(HasSubstr("other traffic"))) << "another component's";
}

TEST(Remarks, TellNotesWithTheirMoment) {
  auto one = summary(asked("a", "udp"), outcome());
  one.start_ns = 1'000'000'000;
  one.notes = {{"peer-left", "the pong left", 4'200'000'000, {}},
               {"second-pong", "two pongs answer", {}, 17}};
  EXPECT_THAT(render({one}, Format::markdown),
              HasSubstr("udp: at 3.2 s: the pong left; two pongs answer (message 17)"));
  const auto notes = parsed_json(render({one}, Format::json)).at("runs").at(0).at("notes");
  EXPECT_EQ(notes.at(0),
            json({{"kind", "peer-left"}, {"text", "the pong left"}, {"at_s", 3.2}, {"message", nullptr}}));
  EXPECT_EQ(notes.at(1).at("message"), 17);
  EXPECT_EQ(notes.at(1).at("at_s"), nullptr);
  one.notes.assign(30, {"peer-left", "gone", {}, {}});
  EXPECT_THAT(render({one}, Format::markdown), HasSubstr("gone; 25 more notes"));
  one.notes = {{"cause", "late", {}, 17}, {"pauses", "listened 40 % of the time", {}, {}}};
  EXPECT_THAT(render({one}, Format::markdown), HasSubstr("listened 40 % of the time; late (message 17)"));
}

TEST(Remarks, TellACauseOnceForAllItsMessages) {
  auto one = summary(asked("a", "udp"), outcome());
  for (const std::int64_t took_us : {6000, 31'500, 9100})
    one.notes.push_back({record::cause_of_late,
                         "late",
                         {},
                         3,
                         record::LateCause{.measures = "age",
                                           .value_ns = 1000 * took_us,
                                           .limit_ns = 5'000'000,
                                           .sentence = "a [7] was frozen",
                                           .fix = "thaw it"}});
  EXPECT_THAT(remarks(one),
              HasSubstr("3 messages: 6.0 to 31.5 ms old (limit 5 ms): a [7] was frozen; fix: thaw it"));
}

// `text` and `cause` of a foreign file may differ.
TEST(Remarks, TellACauseAsExplainDoes) {
  auto one = summary(asked("a", "udp"), outcome());
  one.notes.push_back(
      {record::cause_of_late,
       "another text",
       {},
       3,
       record::LateCause{
           .measures = "age", .value_ns = 6'000'000, .limit_ns = 5'000'000, .sentence = "a [7] was frozen"}});
  EXPECT_THAT(remarks(one), AllOf(HasSubstr("6.0 ms old (limit 5 ms): a [7] was frozen (message 3)"),
                                  Not(HasSubstr("another"))));
}

TEST(Remarks, RateIsNotReachedFromFivePercentOfSkippedCyclesOn) {
  auto run = summary(asked("x", "udp"), outcome(), 9500);
  const auto is_caution = [&] {
    const auto all = remarks_of(run);
    const auto found = std::ranges::find_if(
        all, [](const Remark& one) { return one.text.find("skipped") != std::string::npos; });
    return found != all.end() && found->weight == Remark::Weight::caution;
  };
  run.skipped_cycles = 500;
  EXPECT_FALSE(is_caution());
  EXPECT_THAT(remarks(run), HasSubstr("skipped cycles: 500"));
  run.skipped_cycles = 1000;
  EXPECT_TRUE(is_caution());
  run.lost = 5000;
  EXPECT_TRUE(is_caution()) << "whatever became of the messages that were sent";
}

}  // namespace
}  // namespace ontime::report
