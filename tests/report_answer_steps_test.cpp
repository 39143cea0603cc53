// SPDX-License-Identifier: Apache-2.0
// The first screen's next commands.
#include "report_answers.hpp"

namespace ontime::report {
namespace {

using ::testing::AllOf;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::Field;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

TEST(AnswerSteps, CommandThatFitsOneLineIsOnOne) {
  const std::string fits(65, 'x'), wide(70, 'x');
  EXPECT_EQ(steps_text({{"Prove < 1 in", fits}, {"Compare", wide}}, 80),
            "Prove < 1 in:  " + fits + "\n" + "Compare: " + wide + "\n");
}

TEST(AnswerSteps, WordsToFillInAreBelow) {
  EXPECT_EQ(
      steps_text({{"Why", "ontime ping --peer HOST", {"HOST"}}, {"All", "x", {"HOST", "SCENARIO"}}}, 80),
      "Why:  ontime ping --peer HOST\nAll:  x\nFill in: HOST, SCENARIO\n");
}

TEST(Answer, NextCommandsTakeAFileNamedLikeAnOption) {
  EXPECT_THAT(commands_of(answer_of(demo(), {.file = "-x.ontime"})),
              Contains("ontime report ./-x.ontime --full"));
}

TEST(Answer, NothingLateSaysHowLongToMeasure) {
  const auto answer = answer_of({run_without_a_late_message()}, kept);
  EXPECT_EQ(answer.sentence, "All 2,000 cycles had an answer within 10 ms.");
  // 3 / 1e-4 messages of 10 ms.
  EXPECT_THAT(
      answer.next,
      Contains(AllOf(Field(&Answer::Step::why, "Prove < 1 miss in 10,000"),
                     Field(&Answer::Step::command, "ontime run scenarios/demo.yaml --duration 5min"))));
}

TEST(Answer, TheNextCommandKeepsWhatTheRunsWereChosenBy) {
  auto one = run_without_a_late_message();
  amend(one.run.asked, "/command_line",
        {"ontime", "run", "--duration=5s", "scenarios/demo.yaml", "--only", "a,b", "--explain", "folder",
         "--fail-if", "late > 0", "--results", "old.ontime", "third.yaml"});
  // Those of --only may be in any of the scenarios.
  EXPECT_THAT(commands_of(answer_of({one}, kept)),
              Contains("ontime run scenarios/demo.yaml folder third.yaml --only a,b --duration 5min"));
  amend(one.run.outcome, "/interrupted", true);
  EXPECT_THAT(commands_of(answer_of({one}, kept)),
              Contains("ontime run scenarios/demo.yaml folder third.yaml --duration=5s --only a,b --explain "
                       "--resume --results demo.ontime"));
  const Origin foreign{.file = "r.ontime", .is_root = true, .trusts = [](const std::string& name) {
                         return name == "folder";
                       }};
  EXPECT_THAT(commands_of(answer_of({one}, foreign)),
              Contains(testing::StartsWith("ontime run SCENARIO folder SCENARIO ")));
  auto late = run(1, "a", "udp", {}, 5);
  amend(late.run.asked, "/command_line",
        {"ontime", "run", "demo.yaml", "--transports", "udp", "--only", "a,b", "--duration", "5s"});
  EXPECT_EQ(commands_of(answer_of({late}, kept)).front(),
            "ontime run demo.yaml --transports udp --duration 5s --only a --explain");
}

// Its duration is for the runs of all scenarios that it names.
TEST(Answer, TheNextCommandOfSeveralScenariosTakesAsLongAsTheSlowestNeeds) {
  std::vector runs{run_without_a_late_message(), run_without_a_late_message()};
  runs[1].run.number = 2;
  runs[1].message_every_ns = 100 * ms;
  runs[0].missed_probability.bound = 1.6e-3;
  amend(runs[1].run.asked, {{"id", "b"}, {"scenario_file", "b.yaml"}});
  for (auto& one : runs)
    amend(one.run.asked, "/command_line", {"ontime", "run", "scenarios/demo.yaml", "b.yaml"});
  EXPECT_THAT(commands_of(answer_of(runs, kept)),
              Contains("ontime run scenarios/demo.yaml b.yaml --duration 50min"));
}

TEST(Answer, TheNextCommandOfTheLabKeepsItsMachine) {
  auto one = run_without_a_late_message();
  amend(one.run.outcome, "/hosts/controller/machine/simulated", "QEMU, igb");
  amend(one.run.asked, "/command_line",
        {"ontime", "lab", "run", "scenarios/demo.yaml", "--nic", "igb", "--live", "--duration", "5s",
         "--full"});
  EXPECT_THAT(commands_of(answer_of({one}, kept)),
              Contains("ontime lab run scenarios/demo.yaml --nic igb --live --duration 5min"));
  // As the lab recorded it before: what ran within the machine.
  amend(one.run.asked, "/command_line",
        {"ontime", "run", "/scenarios/1/demo.yaml", "--send-to", "/dev/x", "--cable", "eth1,eth2"});
  EXPECT_THAT(commands_of(answer_of({one}, kept)), Contains(HasSubstr("ontime lab run ")));
  EXPECT_THAT(commands_of(answer_of({one}, kept)), Not(Contains(HasSubstr("--cable"))));
}

TEST(Answer, TheNextCommandNamesAScenarioOfAFolderAsTheUserDid) {
  auto one = run_without_a_late_message();
  amend(one.run.asked, "/scenario_file", "/usr/share/ontime/scenarios/lab/round-trips.yaml");
  amend(one.run.asked, "/command_line", {"ontime", "lab", "run", "lab/round-trips", "--duration", "1s"});
  amend(one.run.outcome, "/hosts/controller/machine/simulated", "QEMU");
  EXPECT_THAT(commands_of(answer_of({one}, kept)),
              Contains("ontime lab run lab/round-trips --duration 5min"));
  amend(one.run.asked, "/scenario_file", "/home/me/run.yaml");
  amend(one.run.asked, "/command_line", {"ontime", "lab", "run", "here/run.yaml"});
  EXPECT_THAT(commands_of(answer_of({one}, kept)), Contains("ontime lab run here/run.yaml --duration 5min"));
}

TEST(Answer, TheNextCommandNamesNoOptionTwice) {
  auto one = run_without_a_late_message();
  amend(one.run.asked, "/scenario_file", "");
  amend(one.run.asked, "/command_line",
        {"ontime", "ping", "--loopback", "--explain", "on", "--duration=1s", "--results=old.ontime"});
  EXPECT_THAT(commands_of(answer_of({one}, kept)), Contains("ontime ping --loopback --duration 5min"));
}

TEST(Answer, WithoutResultsTheNextCommandMeasuresAgainAsBefore) {
  auto one = run(1, "ping", "udp", {}, 5);
  amend(one.run.asked, "/scenario_file", "");
  amend(one.run.asked, "/command_line",
        {"ontime", "ping", "--loopback", "--duration", "1s", "--explain", "--payload", "1kB", "--format",
         "table"});
  EXPECT_THAT(commands_of(answer_of({one}, {"", true})),
              ElementsAre("ontime ping --loopback --duration 1s --payload 1kB --explain --results why.ontime",
                          "ontime ping --loopback --duration 1s --explain --payload 1kB --full"));
}

TEST(Answer, FailedPingIsNotSuggestedAgain) {
  auto one = run(1, "ping", "udp", {});
  amend(one.run.asked, "/scenario_file", "");
  amend(one.run.asked, "/command_line", {"ontime", "ping", "--loopback"});
  EXPECT_THAT(commands_of(answer_of({one}, {"", true})), Contains("ontime ping --loopback --full"));
  const auto failed = summary(one.run.asked.document, {{"error", "not permitted"}}, 0);
  EXPECT_THAT(commands_of(answer_of({failed}, {"", true})), IsEmpty());
}

TEST(Answer, CommandsThatNeedRootAreNotSaidWhereThereIsNone) {
  auto one = run(1, "a", "udp", {true, false}, 9);
  amend(one.run.outcome, "/hosts/controller/refusals",
        {{{"asked", "SCHED_FIFO 80 for thread send"}, {"found", "no"}, {"remedy", "docker run"}}});
  const Origin usual{.file = "r.ontime", .is_own = true};
  Origin in_container = usual;
  in_container.has_no_root = true;
  EXPECT_THAT(commands_of(answer_of({one}, usual)),
              AllOf(Contains(HasSubstr("--explain")), Contains("sudo ontime run scenarios/demo.yaml")));
  for (const bool is_root : {false, true}) {
    in_container.is_root = is_root;
    EXPECT_THAT(commands_of(answer_of({one}, in_container)), ElementsAre("ontime report r.ontime --full"));
  }
  amend(one.run.asked, "/explain", true);
  EXPECT_THAT(commands_of(answer_of({one}, in_container)), Contains("ontime explain r.ontime"));
}

TEST(Answer, ComparisonWithoutAPairIsNotSuggested) {
  std::vector<Summary> runs = {run(1, "quiet", "udp", {}), run(2, "quiet", "udp", {}),
                               run(3, "loud", "udp", {true, false}, 300)};
  EXPECT_THAT(commands_of(answer_of({runs[0], runs[2]}, kept)),
              Contains("ontime compare demo.ontime --from loud --to quiet"));
  for (const auto& [place, variant] : {std::pair<std::size_t, const char*>{0, "100 B"}, {1, "2000 B"}}) {
    amend(runs[place].run.asked, "/variant", variant);
    runs[place].run.key += variant;
  }
  EXPECT_THAT(commands_of(answer_of(runs, kept)), Not(Contains(HasSubstr("ontime compare "))));
}

TEST(Answer, HostileTextsOfAFileAreQuotedInCommands) {
  auto one = run(1, "a'; rm -rf $HOME; '", "udp", {true, false}, 9);
  amend(one.run.asked, "/scenario_file", "/tmp/$(reboot).yaml");
  amend(one.run.asked, "/command_line", json::array());
  auto commands =
      commands_of(answer_of({one}, {.file = "my results.ontime", .is_root = true, .is_own = true}));
  EXPECT_THAT(commands,
              Contains("ontime run '/tmp/$(reboot).yaml' --only 'a'\\''; rm -rf $HOME; '\\''' --explain"));
  EXPECT_THAT(commands, Contains("ontime report 'my results.ontime' --full"));
  amend(one.run.asked, "/scenario_file", "/tmp/\x1b]0;x\x07.yaml");
  commands = commands_of(answer_of({one}, {.file = "r", .is_root = true, .is_own = true}));
  EXPECT_THAT(commands, ElementsAre("ontime report r --full"));
}

TEST(Answer, StepsAreAboutTheRunsThatTheyName) {
  std::vector runs{run(1, "a", "udp", {}), run(2, "b", "cyclonedds", {}, 5)};
  for (auto& one : runs) {
    amend(one.run.asked, "/scenario_file", nullptr);
    amend(one.run.asked, "/command_line", {"ontime", "ping", "--transport", one.run.asked.task.transport});
  }
  EXPECT_THAT(commands_of(answer_of(runs, kept)).front(), HasSubstr("ping --transport cyclonedds --explain"));
  runs[1] = runs[0];
  runs[1].run.number = 2;
  amend(runs[1].run.asked, {{"id", "b"}, {"command_line", {"ontime", "ping", "--period", "1ms"}}});
  for (auto& one : runs) one.missed_probability.messages = 2000;
  runs[0].missed_probability.bound = 1e-5;
  runs[0].message_every_ns = 1000 * ms;
  runs[1].missed_probability.bound = 1.5e-3;
  runs[1].message_every_ns = ms;
  EXPECT_THAT(commands_of(answer_of(runs, kept)).front(),
              testing::MatchesRegex("ontime ping --period 1ms --duration 3[0-9]s"));
}

TEST(Answer, WordOfAForeignFileIsNoOptionOfACommand) {
  auto one = run(1, "--help", "udp", {}, 5);
  amend(one.run.asked, {{"command_line", {"ontime", "run", "demo"}}, {"scenario_file", "--junit=/tmp/made"}});
  for (const auto& command : commands_of(answer_of({one}, kept)))
    EXPECT_THAT(command, AllOf(::testing::Not(HasSubstr("junit")), ::testing::Not(HasSubstr("--only"))));
}

// Of a file that a stranger made: what it names would run as root.
TEST(Answer, NextCommandOfAForeignFileNamesOnlyATrustedScenario) {
  auto one = run(1, "a", "udp", {}, 5);
  Origin foreign{.file = "r.ontime", .is_root = true};
  const auto late_of = [&](const std::vector<std::string>& words, const std::string& file) {
    amend(one.run.asked, {{"command_line", words}, {"scenario_file", file}});
    return commands_of(answer_of({one}, foreign)).front();
  };
  const std::string unknown = "ontime run SCENARIO --only a --explain";
  EXPECT_EQ(late_of({"ontime", "run", "demo"}, "/x/demo.yaml"), unknown) << "nothing is trusted";
  foreign.trusts = [](const std::string& name) {
    return name == "demo" || name == "lab/tsn" || name == "own.yaml";
  };
  EXPECT_EQ(late_of({"ontime", "run", "demo"}, "/x/demo.yaml"), "ontime run demo --only a --explain");
  EXPECT_EQ(late_of({"ontime", "run", "lab/tsn"}, "/x/tsn.yaml"), "ontime run lab/tsn --only a --explain");
  EXPECT_EQ(late_of({"ontime", "run", "x.yaml"}, "x.yaml"), unknown);
  EXPECT_EQ(late_of({"ontime", "run", "paper/../../x/evil.yaml"}, "/x/evil.yaml"), unknown);
  EXPECT_EQ(late_of({"ontime", "run", "other/own.yaml", "own.yaml"}, "own.yaml"),
            "ontime run own.yaml --only a --explain")
      << "this one, not one of the same name";
  EXPECT_EQ(late_of({"ontime", "run", "--only", "demo", "./demo"}, "/x/demo.yaml"), unknown)
      << "the value of an option is no scenario";
  EXPECT_EQ(late_of({"ontime", "run", "--cable", "eth8,eth9", "demo", "--deploy"}, "/x/demo.yaml"),
            "ontime run demo --deploy --only a --explain");
}

TEST(Answer, NextCommandOfAForeignFileHasNoFileHostOrInterfaceOfIt) {
  auto one = run(1, "ping", "udp", {}, 5);
  const Origin foreign{.file = "r.ontime", .is_root = true};
  const auto late_of = [&](const std::vector<std::string>& words, const Origin& origin) {
    amend(one.run.asked, {{"scenario_file", nullptr}, {"command_line", words}});
    return commands_of(answer_of({one}, origin)).front();
  };
  const std::vector<std::string> evil = {
      "ontime",   "ping",      "--peer",      "evil", "worse",  "--option", "config=/tmp/evil.xml",
      "--period", "1ms",       "--interface", "eth7", "--keep", "1GB",      "--log=/etc/passwd",
      "more",     "--loopback"};
  EXPECT_EQ(
      late_of(evil, foreign),
      "ontime ping --peer HOST --option NAME=VALUE --period 1ms --loopback --explain --results why.ontime");
  EXPECT_THAT(answer_of({one}, foreign).next.front().fill_in, ElementsAre("HOST", "NAME=VALUE"));
  EXPECT_EQ(
      late_of({"ontime", "ping", "--interface", "lo", "--option", "rmw=rmw_fastrtps_cpp", "--option",
               "executor=multi", "--option", "config=evil", "--option", "port=/dev/x"},
              foreign),
      "ontime ping --interface lo --option rmw=rmw_fastrtps_cpp --option executor=multi --option NAME=VALUE "
      "--option NAME=VALUE --explain --results why.ontime");
  EXPECT_THAT(late_of(evil, kept), HasSubstr("--peer evil worse --option config=/tmp/evil.xml --period 1ms "
                                             "--interface eth7 --log=/etc/passwd more"));
  amend(one.run.asked, "/command_line",
        {"ontime", "listen", "--metrics", "0.0.0.0:9100", "/scan", "--for", "5s", "/odom"});
  EXPECT_THAT(commands_of(answer_of({one}, foreign)), testing::Each(testing::Not(HasSubstr("0.0.0.0"))));
  amend(one.run.asked, "/command_line", {"ontime", "listen", "--pcap=x.pcap", "/scan"});
  EXPECT_THAT(commands_of(answer_of({one}, kept)), testing::Each(testing::Not(HasSubstr("listen"))));
}

TEST(Answer, FinishesAsTheCallerSays) {
  auto one = run(1, "a", "udp", {});
  amend(one.run.outcome, "/interrupted", true);
  auto origin = kept;
  origin.finish = "ontime run one.yaml two.yaml --resume";
  const auto commands = commands_of(answer_of({one}, origin));
  EXPECT_EQ(commands.front(), origin.finish);
  EXPECT_THAT(commands, testing::Not(testing::Contains(HasSubstr("--resume --results"))));
}

TEST(Answer, NextCommandOfASearchRunsItsScenario) {
  auto one = run_without_a_late_message();
  amend(one.run.asked,
        {{"command_line", {"ontime", "tune", "search", "demo", "--goal", "late = 0", "--only", "a"}},
         {"scenario_file", "/x/demo.yaml"}});
  EXPECT_THAT(commands_of(answer_of({one}, kept)),
              Contains(testing::StartsWith("ontime run demo --only a --duration")));
}

// Without root on loopback, then by root in namespaces: --resume would find all complete.
TEST(Answer, FinishLeavesOutWhatWasMeasuredOnOtherHosts) {
  auto failed = summary(asked("a", "udp", 1), {{"error", "not permitted"}}, 0),
       again = run(2, "a", "udp", {});
  amend(failed.run.asked, {{"scenario_file", "demo.yaml"}, {"hosts", "loopback"}});
  again.run.asked = failed.run.asked;
  amend(again.run.asked, "/hosts", "namespaces");
  EXPECT_THAT(commands_of(answer_of({failed}, kept)), Contains(HasSubstr("--resume")));
  EXPECT_THAT(commands_of(answer_of({failed, again}, kept)), Not(Contains(HasSubstr("--resume"))));
  amend(again.run.asked, "/scenario", "of another robot");
  EXPECT_THAT(commands_of(answer_of({failed, again}, kept)), Contains(HasSubstr("--resume")));
  again.run.asked = failed.run.asked;
  amend(again.run.asked, {{"hosts", "namespaces"}, {"payload_bytes", 1}});
  EXPECT_THAT(commands_of(answer_of({failed, again}, kept)), Contains(HasSubstr("--resume")));
}

TEST(Answer, RunThatIsBeingMeasuredIsToBeWatched) {
  const auto left = summary(asked("a", "udp", 1), nullptr);  // by a killed process
  auto now = summary(asked("b", "udp", 1), nullptr);
  now.run.number = left.run.number + 1;
  now.run.key = "another";
  auto origin = kept;
  origin.running_from = now.run.number;
  const auto answer = answer_of({left, now}, origin);
  EXPECT_EQ(answer.rows.front().state, Answer::State::cut_off);
  EXPECT_EQ(answer.rows.back().state, Answer::State::running);
  EXPECT_THAT(answer.sentence, HasSubstr("Run 2 is being measured."));
  EXPECT_EQ(commands_of(answer).front(), "ontime watch demo.ontime");
  EXPECT_THAT(commands_of(answer), Not(Contains(HasSubstr("--resume"))));
  EXPECT_THAT(commands_of(answer_of({run_without_a_late_message()}, origin)),
              Not(Contains(HasSubstr("--duration"))))
      << "of some of its repetitions";
  EXPECT_EQ(answer_of({left, now}, kept).rows.back().state, Answer::State::cut_off);
}

TEST(Answer, RowOfRepetitionsIsAboutThoseThatHaveEnded) {
  const auto first = run(1, "a", "udp", {}, 5, 1);
  auto second = run(2, "a", "udp", {}, 5, 2), now = run(3, "a", "udp", {}, 0, 3);
  amend(second.run.outcome, "/hosts/controller/load_running", false);
  now.run.outcome = summary(asked("a", "udp", 3), nullptr).run.outcome;
  auto origin = kept;
  origin.running_from = now.run.number;
  const auto of_one = answer_of({first, now}, origin);
  EXPECT_EQ(of_one.rows.front().state, Answer::State::late);
  EXPECT_THAT(of_one.sentence, AllOf(HasSubstr("of the cycles"), HasSubstr(" is being measured.")));
  const auto of_two = answer_of({first, second, now}, origin);
  ASSERT_EQ(of_two.rows.size(), 1);
  EXPECT_EQ(of_two.rows.front().state, Answer::State::not_applied);
  EXPECT_EQ(of_two.rows.front().runs.size(), 2);
}

}  // namespace
}  // namespace ontime::report
