// SPDX-License-Identifier: Apache-2.0
// A comparison's first screen, and its gates as JUnit XML.
#include <boost/property_tree/ptree.hpp>
#include <boost/property_tree/xml_parser.hpp>

#include "report/report.hpp"
#include "report_comparison.hpp"

namespace ontime::report {
namespace {

using gate::Judgement;
using record::amend;
using ::testing::HasSubstr;
using ::testing::Not;

// One run of a condition: so many of 60,000 cycles without an answer in time.
Summary with_misses(const std::string& id, const std::string& key, std::uint64_t events,
                    const char* transport = "udp") {
  auto one = run(id, key, 1);
  amend(one.run.asked, "/transport", transport);
  const double share = static_cast<double>(events) / 60'000;
  one.late_by_response = events;
  one.late_by_response_probability.messages = 60'000;
  one.late_by_response_probability.events = events;
  one.late_by_response_probability.value = share;
  one.late_by_response_probability.sure = one.late_by_response_probability.surer = {share * 0.9, share * 1.1};
  return one;
}

// With a second repetition of each.
std::vector<Summary> twice(std::vector<Summary> runs) {
  const auto once = runs;
  runs.insert(runs.end(), once.begin(), once.end());
  return runs;
}

std::string answer_of(const Comparison& comparison) {
  return render_answer(comparison, {}, Format::table, "ontime compare a b --full", 80);
}

TEST(CompareAnswer, SaysFewerAndMoreEachWithItsPairs) {
  const std::vector a{with_misses("x", "k1", 900), with_misses("x", "k2", 10, "fastdds"),
                      with_misses("x", "k3", 0, "cyclonedds")};
  const std::vector b{with_misses("x", "k1", 30), with_misses("x", "k2", 700, "fastdds"),
                      with_misses("x", "k3", 0, "cyclonedds")};
  const auto runs_a = twice(a), runs_b = twice(b);
  const auto text = answer_of(compare(runs_a, runs_b));
  EXPECT_TRUE(
      text.starts_with("B has fewer cycles without an answer in time (udp) and more (fastdds) than A."))
      << text;
  EXPECT_THAT(text, ::testing::ContainsRegex("udp +1\\.5 % → 0\\.05 % \\*"));
  EXPECT_THAT(text, ::testing::ContainsRegex("cyclonedds +0  "));
  EXPECT_THAT(text, Not(HasSubstr("repeat: 5")));
  EXPECT_THAT(text, HasSubstr("All metrics:  ontime compare a b --full"));
}

TEST(CompareAnswer, OwnMessagesAreLateOrLostWhereBothAreKnown) {
  std::vector a{with_misses("x", "k1", 900)}, b{with_misses("x", "k1", 30)};
  for (auto* side : {&a, &b}) {
    amend(side->front().run.asked, {{"measures", "age"}, {"deadline_us", 5000}});
    side->front().late_probability = side->front().late_by_response_probability;
  }
  EXPECT_THAT(answer_of(compare(a, b)),
              AllOf(HasSubstr("fewer late or lost messages"), Not(HasSubstr("cycles"))));
  amend(b.front().run.outcome, "/loss_unknown", true);
  EXPECT_THAT(answer_of(compare(a, b)), AllOf(HasSubstr("fewer late messages"), Not(HasSubstr("lost"))));
}

TEST(CompareAnswer, SingleRunsProveNothing) {
  const std::vector a{with_misses("x", "k1", 900)}, b{with_misses("x", "k1", 30)};
  const auto text = answer_of(compare(a, b));
  EXPECT_TRUE(text.starts_with("In these runs B had fewer cycles without an answer in time than A.")) << text;
  EXPECT_THAT(text, AllOf(HasSubstr("Not proven:"), HasSubstr("repeat: 5")));
  EXPECT_THAT(text, Not(HasSubstr("*"))) << "the next start may reverse it";
  EXPECT_THAT(text, Not(HasSubstr("Caution: one run")));
  EXPECT_THAT(answer_of(compare(a, a)),
              AllOf(::testing::StartsWith("No difference in cycles"), HasSubstr("repeat: 5")));
}

TEST(CompareAnswer, ClaimsOnlyWhatRepetitionsShow) {
  const std::vector a{with_misses("x", "k1", 900), with_misses("x", "k1", 900), with_misses("y", "k2", 900)},
      b{with_misses("x", "k1", 30), with_misses("x", "k1", 30), with_misses("y", "k2", 30)};
  const auto text = answer_of(compare(a, b));
  EXPECT_TRUE(text.starts_with("B has fewer cycles without an answer in time (x udp) than A.")) << text;
  EXPECT_THAT(text, HasSubstr("Caution: y udp: single runs"));
}

TEST(CompareAnswer, ShowsWhatChangedFirst) {
  std::vector<Summary> a, b;
  for (int i = 0; i < 12; ++i) {
    const auto id = "x" + std::to_string(i);
    a.push_back(with_misses(id, id, 900));
    b.push_back(with_misses(id, id, i == 11 ? 30 : 900));
  }
  const auto runs_a = twice(a), runs_b = twice(b);
  const auto text = answer_of(compare(runs_a, runs_b));
  EXPECT_THAT(text, ::testing::ContainsRegex("x11 udp +1\\.5 % → 0\\.05 % \\*"));
  EXPECT_THAT(text, HasSubstr("… and 3 more"));
}

TEST(CompareAnswer, RunsPerRowAreCountedByRow) {
  std::vector a{with_misses("x", "k1", 900), with_misses("y", "k2", 900)}, b = a;
  for (const int repetition : {2, 3}) {
    a.push_back(with_misses("x", "k1", 900));
    amend(a.back().run.asked, "/repetition", repetition);
  }
  a.back().run.outcome = json{{"interrupted", true}};
  EXPECT_THAT(answer_of(compare(a, b)), HasSubstr("runs per row: 1 to 2 and 1"));
}

TEST(CompareAnswer, ChangeWithinChanceIsNotProven) {
  const auto a = twice({with_misses("x", "k1", 100)}), b = twice({with_misses("x", "k1", 101)});
  EXPECT_TRUE(answer_of(compare(a, b)).starts_with("No difference in "));
}

TEST(CompareAnswer, RunThatIsLeftOutIsNoDifference) {
  const std::vector a{with_misses("x", "k1", 100)};
  std::vector b{with_misses("x", "k1", 100)};
  b.front().run.outcome = json{{"interrupted", true}};
  const auto text = answer_of(compare(a, b));
  EXPECT_THAT(text, HasSubstr("left out"));
  EXPECT_THAT(text, Not(HasSubstr("Also different")));
  EXPECT_TRUE(text.starts_with("Nothing to compare"));
  for (const auto& [missed, says] : {std::pair(100, "; 100\\s+cycles\\s"), {1, "; 1\\s+cycle\\s"}}) {
    b.front() = with_misses("x", "k1", missed);
    b.front().run.outcome = json{{"interrupted", true}};
    EXPECT_THAT(answer_of(compare(a, b)), ::testing::ContainsRegex(says));
  }
}

TEST(CompareAnswer, ManySettingsOfOneKindAreCounted) {
  const std::vector a{with_misses("x", "k1", 100)};
  std::vector b{with_misses("x", "k1", 30)};
  amend(b[0].run.asked, {{"kernel", {{"irq-threads", 90}, {"threaded-napi", "on"}}}, {"repetition", 3}});
  amend(b[0].run.outcome, "/hosts/component/transport/version", "0.2.0");
  EXPECT_THAT(answer_of(compare(a, b)),
              HasSubstr("Also different: kernel (2 values); component udp version: 0.1.0 → 0.2.0"));
}

TEST(CompareAnswer, LongNamesOfTheSidesAreBriefInTheSentence) {
  std::vector<Summary> a{with_misses("x", "k1", 900)}, b{with_misses("x", "k1", 10)};
  auto comparison = compare(a, b);
  const std::string load =
      "load 8 cpu, 8 vm of 64 MiB, 8 io, 8 hdd of 64 MiB on the controller and 2 cpu, 2 vm of 64 MiB, 2 io, "
      "2 hdd ";
  comparison.from_name = load + "of 64 MiB on the component";
  comparison.to_name = load + "of 1 MiB on the component";
  const auto lines = [&] { return lines_of(render_answer(comparison, {}, Format::table, "", 1000)); };
  EXPECT_LE(width_of(lines()[0]), 3 * 80U) << lines()[0];
  EXPECT_THAT(lines()[0], AllOf(HasSubstr("of 64 MiB on the"), HasSubstr("of 1 MiB on the")));
  EXPECT_TRUE(lines()[1].starts_with(comparison.from_name + " → " + comparison.to_name + "; ")) << lines()[1];
  comparison.to_name = "load none";
  EXPECT_THAT(lines()[0], AllOf(HasSubstr("load none"), HasSubstr("load 8 cpu, 8 vm of 64 MiB,")));
}

TEST(CompareAnswer, RowNamesBothTransports) {
  const std::vector a{with_misses("x", "k1", 100)}, b{with_misses("x", "k2", 100, "fastdds")};
  EXPECT_THAT(answer_of(compare_chosen(a, b)), ::testing::ContainsRegex("\nudp → fastdds +0\\.17 %"));
  EXPECT_THAT(answer_of(compare_chosen(a, a)), ::testing::ContainsRegex("\nudp +0\\.17 %"));
}

TEST(CompareAnswer, RowNamesBothIds) {
  std::vector<Summary> runs;
  for (const auto* id : {"idle", "loaded"})
    for (const bool realtime : {false, true}) {
      const auto name = std::string(id) + (realtime ? "-rt" : "");
      runs.push_back(with_misses(name, name, 100));
      amend(runs.back().run.asked, {{"realtime", realtime}});
      if (id == std::string("idle")) amend(runs.back().run.asked, {{"load", nullptr}});
    }
  const auto text = answer_of(compare_by(runs, "realtime", "false", "true"));
  EXPECT_THAT(text, AllOf(HasSubstr("\nidle → idle-rt udp "), HasSubstr("\nloaded → loaded-rt udp ")));
}

TEST(CompareAnswer, RowIsNamedByIdAndTransportAndMoreOnlyToTellItApart) {
  std::vector<Summary> runs;
  for (const auto* id : {"idle", "loaded"})
    for (const bool realtime : {false, true})
      for (const auto* transport : {"udp", "cyclonedds"}) {
        runs.push_back(
            with_misses(id, std::string(id) + transport + (realtime ? "on" : "off"), 100, transport));
        amend(runs.back().run.asked, {{"realtime", realtime}});
        if (id == std::string("idle")) amend(runs.back().run.asked, {{"load", nullptr}});
      }
  auto text = answer_of(compare_by(runs, "realtime", "false", "true"));
  EXPECT_THAT(text,
              AllOf(HasSubstr("\nidle udp "), HasSubstr("\nloaded cyclonedds "), Not(HasSubstr("hdd"))));
  EXPECT_THAT(text, Not(HasSubstr("Also different"))) << "the key alone differs";
  text = answer_of(compare_by(runs, "transport", "udp", "cyclonedds"));
  EXPECT_THAT(text, ::testing::ContainsRegex("\nidle [^\n]*real-time settings *\n? .*\nloaded"));
  EXPECT_THAT(text, Not(HasSubstr("transport: udp")));
  std::erase_if(runs, [](const Summary& one) { return one.run.asked.task.realtime.on; });
  text = answer_of(compare_by(runs, "transport", "udp", "cyclonedds"));
  EXPECT_THAT(text, AllOf(HasSubstr("\nidle    "), HasSubstr("\nloaded  "), Not(HasSubstr("udp →"))));
}

TEST(CompareAnswer, LongNamesUseTheLineAndStayApart) {
  std::vector<Summary> runs;
  for (const auto* last : {"first", "second"})
    runs.push_back(with_misses("a-rather-long-name-of-a-condition-" + std::string(last), last, 100));
  const auto text = render_answer(compare(runs, runs), {}, Format::table, "", 120);
  EXPECT_THAT(text, AllOf(HasSubstr("a-rather-long-name-of-a-condition-first udp"),
                          HasSubstr("condition-second udp")));
  EXPECT_THAT(answer_of(compare(runs, runs)), AllOf(HasSubstr("first udp"), HasSubstr("second udp")));
}

TEST(CompareAnswer, CautionNamesItsSideAndThatOfBComesFirst) {
  std::vector a{with_misses("x", "k1", 100)}, b{with_misses("x", "k1", 100)};
  a[0].run.outcome.conditions["controller"].clock_moved_s = 1;
  b[0].run.outcome.conditions["controller"].clock_moved_s = 2;
  auto comparison = compare(a, b);
  comparison.from_name = "old.ontime";
  comparison.to_name = "new.ontime";
  const auto text = answer_of(comparison);
  const auto of_b = text.find("Caution: x udp (run 1) of new.ontime: ");
  ASSERT_NE(of_b, text.npos) << text;
  const auto of_a = text.find("Caution: x udp (run 1) of old.ontime: ");
  EXPECT_LT(of_b, of_a) << text;
  comparison.one_file = true;
  EXPECT_THAT(answer_of(comparison), Not(HasSubstr(") of ")));
}

TEST(CompareAnswer, CautionLosesNamesBeforeItsValue) {
  std::vector<Summary> runs;
  for (int i = 0; i < 4; ++i) {
    const auto id = "a-name-of-many-characters-" + std::to_string(i);
    runs.push_back(with_misses(id, id, 100));
    runs.back().run.outcome.conditions["controller"].cpu_stolen = 0.0123;
  }
  runs.push_back(with_misses("calm", "calm", 100));
  EXPECT_THAT(answer_of(compare(runs, runs)),
              HasSubstr("Caution: 8 of 10 runs (a-name-of-many-characters-0 udp (run 1) of B, …): the\n"
                        "  hypervisor took 1.2 % of the controller's CPU time (steal)\n"));
}

TEST(CompareAnswer, RepetitionsSayWhatIsShown) {
  const std::vector one{with_misses("x", "k1", 100)},
      two{with_misses("x", "k1", 100), with_misses("x", "k1", 100)};
  EXPECT_THAT(answer_of(compare(two, two)), HasSubstr("mean"));
  EXPECT_THAT(answer_of(compare(one, one)), Not(HasSubstr("mean")));
}

TEST(CompareAnswer, RunThatWasMeasuredAsRequestedHasNoLine) {
  const std::vector a{with_misses("x", "k1", 100)};
  const std::vector judgements{gate::judge_as_asked(a[0]),
                               Judgement{Judgement::Result::held, "x udp", "lost <= 0", "0 of 100 messages"}};
  const auto comparison = compare(a, a);
  for (const auto& text : {render_answer(comparison, judgements, Format::table, "", 80),
                           render(comparison, judgements, Format::table)}) {
    EXPECT_THAT(text, Not(HasSubstr(gate::as_asked)));
    EXPECT_THAT(text, HasSubstr("ok: lost <= 0 (x udp)"));
  }
}

TEST(CompareAnswer, FitsAScreenWhateverOthersWrote) {
  std::vector<Summary> a, b;
  for (int i = 0; i < 40; ++i) {
    const auto key = "k" + std::to_string(i);
    a.push_back(with_misses("x" + key, key, 900));
    b.push_back(with_misses("x" + key, key, 30));
    amend(b.back().run.asked, {{"kernel", {{"name" + std::string(400, 'x') + key, "\x1b[31m"}}}});
  }
  const auto text = answer_of(compare(a, b));
  EXPECT_LE(std::count(text.begin(), text.end(), '\n'), 24) << text;
  EXPECT_THAT(text, Not(HasSubstr("\x1b")));
  EXPECT_THAT(text, HasSubstr("… and 31 more"));
}

// --- JUnit ---

boost::property_tree::ptree parsed(const std::string& xml) {
  std::istringstream in(xml);
  boost::property_tree::ptree tree;
  read_xml(in, tree);
  return tree;
}

TEST(JUnit, CountsFailuresAndErrorsApart) {
  const auto tree =
      parsed(junit({{Judgement::Result::held, "x udp", "p99 > 2 ms", "p99 is 1 ms"},
                    {Judgement::Result::missed, "x udp", "late > 0", "3 of 100 messages"},
                    {Judgement::Result::cannot_judge, "y udp", "late > 0", "it failed: no pong"}}));
  const auto& suite = tree.get_child("testsuites.testsuite");
  EXPECT_EQ(suite.get<int>("<xmlattr>.tests"), 3);
  EXPECT_EQ(suite.get<int>("<xmlattr>.failures"), 1);
  EXPECT_EQ(suite.get<int>("<xmlattr>.errors"), 1);
  std::vector<std::string> failures;
  for (const auto& [name, test] : suite)
    if (name == "testcase" && test.get_child_optional("failure"))
      failures.push_back(test.get<std::string>("<xmlattr>.name") + ": " +
                         test.get<std::string>("failure.<xmlattr>.message"));
  EXPECT_THAT(failures, ::testing::ElementsAre("late > 0: 3 of 100 messages"));
}

TEST(JUnit, TextStaysText) {
  const auto xml = junit({{Judgement::Result::missed, "<script>\"'&]]>\x01\x1b\xff", "a<b", "\n</failure>"}});
  const auto tree = parsed(xml);
  EXPECT_EQ(tree.get<std::string>("testsuites.testsuite.testcase.<xmlattr>.classname"), "<script>\"'&]]>???");
  EXPECT_EQ(tree.get<std::string>("testsuites.testsuite.testcase.failure.<xmlattr>.message"), " </failure>");
  EXPECT_EQ(xml.find('\x01'), xml.npos);
}

}  // namespace
}  // namespace ontime::report
