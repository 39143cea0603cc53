// SPDX-License-Identifier: Apache-2.0
// What `ontime explain` prints.
#include <algorithm>
#include <regex>

#include <fmt/format.h>

#include "json.hpp"
#include "report/explained.hpp"
#include "report/runs.hpp"
#include "report_fixture.hpp"
#include "table/table.hpp"

namespace ontime::report {
namespace {

using roundtrip::Fate;
using roundtrip::Sample;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

TEST(OwnMessages, OnTimeMessagesNeedNoCause) {
  for (const bool is_late : {false, true}) {
    record::Writer writer("");
    const auto number = writer.begin_run({{"id", "/scan age"}, {"measures", "age"}, {"deadline_us", 5000}});
    Sample sample{};
    sample.received_ns = ms;
    sample.fate = is_late ? Fate::late : Fate::on_time;
    writer.append(number, {&sample, 1});
    writer.end_run(number, {{"loss_unknown", true}});
    const auto reader = writer.reader();
    const auto run = reader.runs().at(0);
    const auto text = render_explained({{run, explain::account_of(reader, run), {}}}, Format::table);
    EXPECT_THAT(text, HasSubstr(is_late ? "causes unknown" : "no message was late"));
  }
}

TEST(RenderExplained, RunsWithoutExplainAreCountedInOneLine) {
  std::vector<Explained> all(12);
  const auto none = render_explained(all, Format::table);
  EXPECT_THAT(none, AllOf(HasSubstr("12 runs"), HasSubstr("explain: on")));
  EXPECT_EQ(std::ranges::count(none, '\n'), 1);
  all.front().account.traced = true;
  EXPECT_THAT(render_explained(all, Format::table),
              AllOf(HasSubstr("nothing was late or lost"), HasSubstr("11 of the 12 runs")));
  EXPECT_THAT(render_explained({all.back()}, Format::table), HasSubstr("run 0"));
}

TEST(RenderExplained, SkippedCyclesAreCounted) {
  Explained one;
  one.account.traced = true;
  one.account.late = 8;
  one.run.outcome.counters.skipped_cycles = 35;
  EXPECT_THAT(render_explained({one}, Format::table), HasSubstr("35 cycles were skipped"));
  EXPECT_EQ(nlohmann::json::parse(render_explained({one}, Format::json)).at(0).at("skipped_cycles"), 35);
  one.run.outcome.counters.skipped_cycles = 0;
  EXPECT_THAT(render_explained({one}, Format::table), Not(HasSubstr("skipped")));
}

TEST(RenderExplained, RunThatFailedSaysSo) {
  Explained one;
  one.run.asked = nlohmann::json{{"id", "a"}, {"explain", true}};
  one.run.outcome = nlohmann::json{{"error", "no permission"}};
  EXPECT_THAT(render_explained({one, one}, Format::table), HasSubstr("failed: no permission"));
}

TEST(RenderExplained, AMessageSaysForHowLongItWasDelayed) {
  explain::Message message{.sample = {}, .delay_ns = 30 * ms};
  message.sample.index = 20;
  message.sample.fate = Fate::lost;
  EXPECT_THAT(render_explained(Explained(), message, Format::table),
              HasSubstr("message 20 (lost): delayed by 30.0 ms\n"));
}

TEST(RenderExplained, LongLinesGoOnBelowTheirText) {
  Explained one;
  one.account.traced = true;
  one.account.late = 1;
  explain::Group group;
  group.messages = 23;
  group.culprit.cause = explain::Cause::idle_cpu;
  group.culprit.end = "controller";
  group.culprit.thread = "send";
  group.remedy = {{{"realtime.cpu-latency", "0 us"}}, std::string(60, 'x')};
  one.account.groups = {group};
  const auto text = render_explained({one}, Format::table);
  std::size_t more = 0;
  for (const auto& line : table::split(text, '\n')) {
    EXPECT_LE(table::width_of(line), 80) << line;
    more += line.starts_with(std::string(10, ' ')) ? 1 : 0;
  }
  EXPECT_THAT(text,
              AllOf(HasSubstr("\n    23  ping's send thread"), HasSubstr("\n       → realtime.cpu-latency")));
  EXPECT_GE(more, 2U);
  const auto markdown = render_explained({one}, Format::markdown);
  EXPECT_THAT(markdown, HasSubstr("or a hypervisor paused it"));

  one.account.limits = {"x: " + std::string(100, ' ')};
  EXPECT_NO_THROW(render_explained({one}, Format::table)) << "blanks alone are left";
}

explain::Group group_of(std::size_t messages, std::string culprit, std::string advice,
                        std::int64_t most_ns = 0) {
  explain::Group group;
  group.messages = messages;
  group.least_ns = std::min(most_ns, 1 * ms);
  group.most_ns = most_ns;
  group.culprit.cause = explain::Cause::cpu;
  group.culprit.culprit = std::move(culprit);
  group.remedy.advice = std::move(advice);
  return group;
}
Explained explained_by(std::vector<explain::Group> groups) {
  Explained one;
  one.account.traced = true;
  for (const auto& group : groups) one.account.late += group.messages;
  one.account.groups = std::move(groups);
  return one;
}
std::size_t times_in(const std::string& text, const std::string& words) {
  std::size_t found = 0;
  for (auto at = text.find(words); at != text.npos; at = text.find(words, at + 1)) ++found;
  return found;
}

TEST(RenderExplained, CauseOfSeveralRunsComesFirstWithItsRemedyOnce) {
  const auto run = [](std::string culprit, std::size_t messages, std::int64_t most_ns, std::string advice) {
    return explained_by({group_of(messages, std::move(culprit), std::move(advice), most_ns)});
  };
  const auto text =
      render_explained({run("hog", 3, 2 * ms, "stop it"), run("backup", 4, 9 * ms, "move it"),
                        run("hog", 2, 7 * ms, "stop it"), run("backup", 1, 3 * ms, "another priority")},
                       Format::table, 200);
  EXPECT_THAT(text,
              ::testing::MatchesRegex("Causes of late or lost messages in 4 runs:\n"
                                      " +5 [^\n]*hog[^\n]*: 1.0 ms to 7.0 ms \\(2 runs\\)\n +→ stop it\n"
                                      " +5 [^\n]*backup[^\n]*: 1.0 ms to 9.0 ms \\(2 runs\\)\n\nrun .*"));
  EXPECT_EQ(times_in(text, "→ stop it"), 1U);
  EXPECT_EQ(times_in(text, "→ move it"), 1U) << "it differs between runs: each run has its own";
  EXPECT_EQ(times_in(text, "→ another priority"), 1U);
  EXPECT_THAT(render_explained({run("hog", 3, 2 * ms, "stop it"), Explained()}, Format::table),
              ::testing::Not(HasSubstr("Causes of")));
}

TEST(RenderExplained, RemedyOfAnotherCauseAboveIsNotThatOfACauseWithout) {
  const auto text =
      render_explained({explained_by({group_of(3, "hog", "stop it"), group_of(2, "cron", "stop it")}),
                        explained_by({group_of(3, "hog", "stop it"), group_of(2, "cron", "move it")})},
                       Format::table, 200);
  EXPECT_EQ(times_in(text, "stop it"), 2U) << "above for hog, and in the first run for cron:\n" << text;
  EXPECT_EQ(times_in(text, "→ move it"), 1U);
}

TEST(RenderExplained, RunsWhoseCausesAreUnknownAreNotAmongThoseWithCauses) {
  Explained unknown;
  unknown.account.late = 5;
  const auto text = render_explained(
      {explained_by({group_of(3, "hog", "")}), unknown, explained_by({group_of(3, "hog", "")})},
      Format::table, 200);
  EXPECT_THAT(text, ::testing::StartsWith("Causes of late or lost messages in 2 runs:\n"))
      << "3 runs had some";
}

TEST(RenderExplained, CausesBeyondTheFirstTenAreCounted) {
  for (const std::size_t causes : {11U, 12U}) {
    std::vector<explain::Group> groups;
    for (std::size_t i = 0; i < causes; ++i) groups.push_back(group_of(1, fmt::format("hog{}", i), ""));
    EXPECT_THAT(render_explained({explained_by(groups), explained_by(groups)}, Format::table, 200),
                HasSubstr(causes == 11 ? "… and 1 more cause, see each run\n"
                                       : "… and 2 more causes, see each run\n"));
  }
}

TEST(RenderExplained, CausesWithTheSameRemedyStandTogetherAboveIt) {
  const auto one = explained_by(
      {group_of(5, "backup", "move it"), group_of(4, "hog", "stop it"), group_of(3, "cron", "stop it")});
  EXPECT_THAT(render_explained({one}, Format::table, 200),
              ::testing::MatchesRegex(
                  "run [^\n]*\n +4 [^\n]*hog[^\n]*\n +3 [^\n]*cron[^\n]*\n +→ for these 2 causes: stop it\n"
                  " +5 [^\n]*backup[^\n]*\n +→ move it\n"));
}

TEST(RenderExplained, JsonSendsATerminalNoControlCharacter) {
  Explained one;
  one.run.asked = nlohmann::json{{"id", "a"}, {"component", "arm\u009b"}};
  EXPECT_THAT(render_explained({one}, Format::json),
              AllOf(HasSubstr("\\u009b"), ::testing::Not(HasSubstr("\u009b"))));
}

TEST(OwnMessages, LateMessagesWithoutASeenCauseAreCounted) {
  Explained one;
  one.run.asked = nlohmann::json{{"id", "/scan age"}, {"measures", "age"}, {"deadline_us", 5000}};
  one.account.late = 8;
  one.notes.assign(5, {record::cause_of_late, "6 ms old", {}, {}});
  const auto counts = [&] {
    return parsed_json(render_explained({one}, Format::json)).at(0).at("without_cause");
  };
  EXPECT_EQ(counts().at("unknown"), 3) << "the file does not tell";
  one.run.outcome = nlohmann::json{{"causes", {{"seen", 6}, {"not_seen", 1}}}};
  const auto text = render_explained({one}, Format::table);
  EXPECT_THAT(text, HasSubstr("5 of 8 late messages"));
  EXPECT_THAT(text,
              AllOf(HasSubstr("cause not seen: 1"), HasSubstr("in the file"), HasSubstr("not examined")));
  EXPECT_EQ(counts(),
            nlohmann::json({{"not_seen", 1}, {"no_space", 1}, {"not_examined", 1}, {"unknown", 0}}));
  one.notes.clear();
  EXPECT_EQ(counts().at("no_space"), 6);
  EXPECT_THAT(render_explained({one}, Format::table),
              AllOf(Not(HasSubstr("only as root")), HasSubstr(": 8 late messages; cause not seen: 1")));
  one.notes.assign(5, {record::cause_of_late, "6 ms old", {}, {}});
  one.account.late = 5;
  EXPECT_THAT(render_explained({one}, Format::table), HasSubstr("5 of 5 late messages\n"));
}

TEST(OwnMessages, MessagesThatAreNewerThanTheCountsHaveACauseOrNone) {
  Explained one;
  one.run.asked = nlohmann::json{{"id", "/scan age"}, {"measures", "age"}, {"kept", "worst"}};
  one.run.outcome = nlohmann::json{{"sent", 90}, {"late", 0}, {"lost", 0}};
  one.account.late = 2;
  EXPECT_THAT(render_explained({one}, Format::table),
              AllOf(Not(HasSubstr("only as root")), HasSubstr(": 2 late messages; cause not seen or not")));
  one.notes.assign(1, {record::cause_of_late, "6 ms old", {}, {}});
  EXPECT_THAT(render_explained({one}, Format::table), HasSubstr("causes of 1 of 2 late messages"))
      << "the worst of all may be the other one";
}

record::Note late_by(const record::LateCause& cause, std::optional<std::uint64_t> message = {}) {
  return {record::cause_of_late, text_of(cause), static_cast<std::int64_t>(message.value_or(0)), message,
          cause};
}

TEST(OwnMessages, MessagesOfTheSameCauseAreOneLineWithTheirRange) {
  Explained one;
  one.run.asked = nlohmann::json{{"id", "/scan age"}, {"measures", "age"}, {"deadline_us", 5000}};
  one.account.late = 4;
  const auto add = [&](double took_ms, const std::string& hog, const std::string& number, double waited_ms,
                       int cpu, std::uint64_t message) {
    const auto waits = [](const std::string& other) {
      return fmt::format("node [7] (thread recv), SCHED_OTHER, waited for a CPU while {} ran", other);
    };
    const auto fix = [](const std::string& other) {
      return fmt::format("SCHED_FIFO for node [7] (chrt -a -f -p 50 7), or other CPUs for {} (taskset)",
                         other);
    };
    one.notes.push_back(late_by({.measures = "age",
                                 .value_ns = static_cast<std::int64_t>(took_ms * 1e6),
                                 .limit_ns = 5'000'000,
                                 .sentence = waits(hog + number),
                                 .fix = fix(hog + number),
                                 .alike = waits(hog),
                                 .alike_fix = fix(hog),
                                 .ns = static_cast<std::int64_t>(waited_ms * 1e6),
                                 .cpu = cpu},
                                message));
  };
  add(16.1, "idler", " [9]", 15.0, 1, 4);
  add(34.4, "hog", " [21]", 17.1, 1, 12);
  add(6.1, "hog", " [22]", 4.0, 0, 8);
  add(20.0, "hog", "", 15.9, 1, 30);  // it ended before its process was found
  const auto text = render_explained({one}, Format::table);
  for (const auto& line : table::split(text, '\n')) EXPECT_LE(table::width_of(line), 80) << line;
  const auto one_line = std::regex_replace(text, std::regex("\\s+"), " ");
  EXPECT_THAT(one_line, HasSubstr(" 3 6.1 to 34.4 ms old (limit 5 ms): node [7] (thread recv)"));
  EXPECT_THAT(one_line, HasSubstr("while hog ran: 4.0 to 17.1 ms; first: message 8 →"));
  EXPECT_THAT(one_line, HasSubstr(" 1 16.1 ms old"));
  EXPECT_THAT(one_line, HasSubstr("while idler [9] ran: 15.0 ms, CPU 1; message 4 →"));
  EXPECT_THAT(text, HasSubstr("(chrt -a -f -p 50 7)")) << "a command stays on one line";
  EXPECT_LT(text.find("6.1 to"), text.find("16.1 ms")) << "most messages first";
  EXPECT_EQ(parsed_json(render_explained({one}, Format::json)).at(0).at("notes").size(), 4U);
}

TEST(OwnMessages, TextOfANoteIsNoAdviceAndNoOtherNotesCause) {
  Explained one;
  one.run.asked = nlohmann::json{{"id", "/scan age"}, {"measures", "age"}, {"deadline_us", 5000}};
  one.account.late = 3;
  const std::string text = "6.0 ms old: a was frozen; fix: thaw it";
  one.notes.assign(2, {record::cause_of_late, text, {}, {}});  // of an older ontime, or of another program
  one.notes.push_back(late_by({.measures = "period",
                               .value_ns = 40'000,
                               .limit_ns = 30'000,
                               .sentence = "x; fix: y",
                               .alike = "x; fix: y"}));
  const auto told = render_explained({one}, Format::table);
  EXPECT_THAT(told, HasSubstr("   2  " + text + "\n"));
  EXPECT_THAT(told, HasSubstr("   1  0.040 ms after the previous message (limit 0.03 ms): x; fix: y\n"));
}

// As ontime wrote them before causes were data.
TEST(OwnMessages, NotesOfAnOlderFileAreToldApartByTheirTextWithoutNumbers) {
  Explained one;
  one.run.asked = nlohmann::json{{"id", "/scan age"}, {"measures", "age"}, {"deadline_us", 5000}};
  one.account.late = 5;
  const auto add = [&](const std::string& before, const std::string& culprit, std::uint64_t message) {
    one.notes.push_back(
        {record::cause_of_late,
         fmt::format("{} ms old (limit 5 ms): {} ran: 4.0 ms; fix: stop {}", before, culprit, culprit),
         static_cast<std::int64_t>(message), message});
  };
  add("25.0", "hog [1000]", 9);
  add("6.1", "hog [21]", 4);
  add("6.1", "hog [21]", 12);
  add("7.0", "camera1 [5]", 6);
  add("7.0", "camera2 [6]", 7);
  const auto text = render_explained({one}, Format::table, 200);
  EXPECT_THAT(text,
              HasSubstr("   3  such as 6.1 ms old (limit 5 ms): hog [21] ran: 4.0 ms; fix: stop hog [21]; "
                        "first: message 4\n"));
  EXPECT_THAT(text, HasSubstr("   1  7.0 ms old (limit 5 ms): camera1 [5] ran"));
  EXPECT_THAT(text, HasSubstr("   1  7.0 ms old (limit 5 ms): camera2 [6] ran"));
  EXPECT_THAT(text, Not(HasSubstr("→")));
}

TEST(OwnMessages, ProcessThatIsTheSameForAllMessagesKeepsItsNumber) {
  Explained one;
  one.run.asked = nlohmann::json{{"id", "/scan age"}, {"measures", "age"}, {"deadline_us", 5000}};
  one.account.late = 2;
  for (const auto* const second : {"01", "02"})
    one.notes.push_back(late_by({.measures = "age",
                                 .date = std::string("2026-11-27 14:00:") + second,
                                 .value_ns = 6'000'000,
                                 .limit_ns = 5'000'000,
                                 .sentence = "a [7] was frozen, and b [8] thawed it",
                                 .alike = "a [7] was frozen, and b thawed it"}));
  EXPECT_THAT(one.notes[0].text, testing::StartsWith("2026-11-27 14:00:01  6.0 ms old"));
  const auto one_line = std::regex_replace(render_explained({one}, Format::table), std::regex("\\s+"), " ");
  EXPECT_THAT(one_line, HasSubstr(" 2 6.0 ms old (limit 5 ms): a [7] was frozen, and b [8] thawed it; "
                                  "2026-11-27 14:00:01 "));
}

}  // namespace
}  // namespace ontime::report
