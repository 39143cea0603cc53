// SPDX-License-Identifier: Apache-2.0
#include "report/report.hpp"

#include <algorithm>
#include <numeric>
#include <random>
#include <set>
#include <sstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace ontime::report {
namespace {

using nlohmann::json;
using statistics::Summary;
using ::testing::AllOf;
using ::testing::Each;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

constexpr Format all_formats[] = {Format::table, Format::json, Format::csv, Format::markdown, Format::latex};

json asked(const std::string& id, const std::string& transport, int repetition = 1) {
  return {
      {"id", id},
      {"title", "System under load"},
      {"repetition", repetition},
      {"transport", transport},
      {"payload_bytes", 500},
      {"period_us", 10000},
      {"deadline_us", 10000},
      {"timeout_us", 500000},
      {"duration_s", 20},
      {"schedule", "next-free"},
      {"receive", "listener"},
      {"warm_up", 10},
      {"realtime", false},
      {"realtime_settings", {{"on", false}}},
      {"qos",
       {{"reliability", "best-effort"}, {"history", "keep-last"}, {"depth", 1}, {"durability", "volatile"}}},
      {"load",
       {{"controller", {{"cpu", 8}, {"vm", 8}, {"io", 8}, {"hdd", 8}}},
        {"component", {{"cpu", 2}, {"vm", 2}, {"io", 2}, {"hdd", 2}}}}},
      {"command_line", {"ontime", "run", "scenarios/demo.yaml"}},
      {"ontime", "0.1.0"},
      {"scenario", "runs:\n- id: x\n"}};
}

json thread(const std::string& role) {
  return {{"role", role},
          {"name", "ontime-" + role},
          {"tid", 12},
          {"policy", "fifo"},
          {"priority", 80},
          {"cpus", "0-1"},
          {"minor_faults", 0},
          {"major_faults", 1},
          {"voluntary_switches", 2000},
          {"involuntary_switches", 3},
          {"cpu_time_us", 1234}};
}

json outcome() {
  const json host = {
      {"machine", {{"kernel", "6.1"}}},
      {"transport", {{"name", "udp"}, {"version", "0.1.0"}, {"facts", {{"interface", "link0"}}}}},
      {"threads", {thread("send"), thread("receive")}},
      {"refusals", json::array()},
      {"load_running", true}};
  return {{"duplicates", 0},
          {"strays", 0},
          {"reordered", 0},
          {"dropped_records", 0},
          {"refused_sends", 0},
          {"interrupted", false},
          {"conditions", {{"controller", {{"cpu_busy", 0.99}}}, {"component", {{"cpu_busy", 0.5}}}}},
          {"hosts", {{"controller", host}, {"component", host}}}};
}

// `answers` round trips of 1, 2, 3 … µs.
Summary summary(const json& asked, const json& outcome, std::size_t answers = 2000) {
  Summary summary{};
  summary.run = {1, asked, outcome, {}};
  summary.sent = answers;
  summary.on_time = answers;
  std::vector<std::int64_t> values(answers);
  for (std::size_t i = 0; i < answers; ++i) values[i] = static_cast<std::int64_t>(i + 1) * 1000;
  summary.round_trip = summary.response = summary.wake_up = statistics::distribution(values);
  return summary;
}

std::vector<std::string> lines_of(const std::string& text) {
  std::vector<std::string> lines;
  std::istringstream stream(text);
  for (std::string line; std::getline(stream, line);) lines.push_back(line);
  return lines;
}

// The first line that begins so, as words.
std::vector<std::string> row_of(const std::string& text, const std::string& beginning) {
  for (const auto& line : lines_of(text)) {
    if (!line.starts_with(beginning)) continue;
    std::istringstream stream(line);
    return {std::istream_iterator<std::string>(stream), {}};
  }
  return {};
}

// RFC 4180, as it is written there.
std::vector<std::vector<std::string>> parse_csv(const std::string& text) {
  std::vector<std::vector<std::string>> records(1, {""});
  bool quoted = false;
  for (std::size_t i = 0; i < text.size(); ++i) {
    auto& field = records.back().back();
    if (text[i] == '"' && quoted && i + 1 < text.size() && text[i + 1] == '"')
      field += text[++i];
    else if (text[i] == '"')
      quoted = !quoted;
    else if (text[i] == ',' && !quoted)
      records.back().emplace_back();
    else if (text[i] == '\n' && !quoted)
      records.push_back({""});
    else
      field += text[i];
  }
  records.pop_back();  // what follows the last line's end
  return records;
}

std::size_t width_of(const std::string& line) {
  return static_cast<std::size_t>(std::count_if(
      line.begin(), line.end(), [](char c) { return (static_cast<unsigned char>(c) & 0xc0) != 0x80; }));
}

TEST(FormatOf, KnowsItsWords) {
  EXPECT_EQ(format_of("table"), Format::table);
  EXPECT_EQ(format_of("json"), Format::json);
  EXPECT_EQ(format_of("csv"), Format::csv);
  EXPECT_EQ(format_of("markdown"), Format::markdown);
  EXPECT_EQ(format_of("latex"), Format::latex);
  EXPECT_EQ(format_of("html"), std::nullopt);
  EXPECT_EQ(format_of(""), std::nullopt);
}

TEST(Json, HasEveryKeyThatIsPromised) {
  auto one = summary(asked("Test1.B", "cyclonedds"), outcome());
  one.server = statistics::Distribution{};
  const auto document = json::parse(render({one}, Format::json));
  EXPECT_TRUE(document.at("ontime").is_string());
  const auto& run = document.at("runs").at(0);
  for (const auto* key : {"id", "transport", "schedule"}) EXPECT_TRUE(run.at(key).is_string()) << key;
  for (const auto* key : {"payload_bytes", "period_us", "deadline_us", "timeout_us", "sent", "on_time",
                          "late", "lost", "duplicates", "strays", "skipped_cycles", "dropped_records"})
    EXPECT_TRUE(run.at(key).is_number()) << key;
  EXPECT_EQ(run.at("realtime"), false);
  EXPECT_EQ(run.at("complete"), true);
  for (const auto* distribution : {"round_trip_us", "response_us", "wake_up_us"})
    for (const auto* value : {"min", "mean", "p50", "p90", "p99", "p99.9", "p99.99", "max"})
      EXPECT_TRUE(run.at(distribution).at(value).is_number()) << distribution << value;
  EXPECT_EQ(run.at("server_us"), nullptr) << "the server did not say";
  EXPECT_EQ(run.at("conditions").at("qos"), asked("", "").at("qos"));
  EXPECT_EQ(run.at("conditions").at("receive"), "listener");
  EXPECT_EQ(run.at("conditions").at("realtime_settings").at("on"), false);
  EXPECT_EQ(run.at("conditions").at("load").at("asked"), asked("", "").at("load"));
  EXPECT_EQ(run.at("conditions").at("load").at("achieved"), outcome().at("conditions"));
  EXPECT_EQ(run.at("hosts"), outcome().at("hosts"));
  EXPECT_EQ(run.at("provenance").at("scenario"), "runs:\n- id: x\n");
}

TEST(Json, GivesMicrosecondsToTheNanosecond) {
  Summary one{};
  std::vector<std::int64_t> values = {1'234'567, 9'007'199'254'741};
  one.round_trip = statistics::distribution(values);
  const auto run = json::parse(render({one}, Format::json)).at("runs").at(0);
  EXPECT_EQ(run.at("round_trip_us").at("min").dump(), "1234.567");
  EXPECT_EQ(run.at("round_trip_us").at("max").dump(), "9007199254.741");
  EXPECT_EQ(run.at("response_us"), nullptr) << "there are no values";
}

TEST(Json, SaysWhichRunsDidNotEndAsAsked) {
  auto interrupted = outcome();
  interrupted["interrupted"] = true;
  const auto document =
      json::parse(render({summary(asked("a", "udp"), nullptr), summary(asked("b", "udp"), interrupted),
                          summary(asked("c", "udp"), {{"error", "no peer"}})},
                         Format::json));
  for (const auto& run : document.at("runs")) EXPECT_EQ(run.at("complete"), false);
  const auto& cut_off = document.at("runs").at(0);
  for (const auto* key : {"duplicates", "strays", "reordered", "refused_sends", "dropped_records", "hosts"})
    EXPECT_EQ(cut_off.at(key), nullptr) << key << " is not known";
  EXPECT_EQ(cut_off.at("sent"), 2000);
  EXPECT_EQ(document.at("runs").at(1).at("interrupted"), true);
  EXPECT_EQ(document.at("runs").at(2).at("error"), "no peer");
}

TEST(AllFormats, SurviveEveryKindOfValueInEveryPlace) {
  const json replacements[] = {nullptr,
                               7,
                               -1,
                               1e300,
                               "text",
                               "",
                               true,
                               json::array({1, nullptr}),
                               json::object(),
                               {{"controller", 5}}};
  const auto places = [](const json& value) {
    std::set<std::string> paths;
    const auto leaves = value.flatten();
    for (const auto& [path, leaf] : leaves.items())
      for (json::json_pointer pointer(path); !pointer.empty(); pointer = pointer.parent_pointer())
        paths.insert(pointer.to_string());
    return paths;
  };
  const auto render_all = [](const Summary& one) {
    for (const auto format : all_formats) {
      EXPECT_NO_THROW(render({one}, format));
      EXPECT_NO_THROW(render_threads({one}, format));
    }
  };
  const auto whole_asked = asked("Test1.B", "udp");
  const auto whole_outcome = outcome();
  for (const auto& replacement : replacements) {
    for (const auto& place : places(whole_asked)) {
      auto changed = whole_asked;
      changed[json::json_pointer(place)] = replacement;
      render_all(summary(changed, whole_outcome, 3));
    }
    for (const auto& place : places(whole_outcome)) {
      auto changed = whole_outcome;
      changed[json::json_pointer(place)] = replacement;
      render_all(summary(whole_asked, changed, 3));
    }
  }
  render_all(summary(nullptr, nullptr));
  render_all(summary("text", 5));
}

TEST(AllFormats, HaveSomethingToSayOfNoRuns) {
  EXPECT_EQ(json::parse(render({}, Format::json)).at("runs"), json::array());
  EXPECT_EQ(json::parse(render_threads({}, Format::json)), json::array());
  EXPECT_EQ(parse_csv(render({}, Format::csv)).size(), 1u);
  EXPECT_THAT(render({}, Format::table), HasSubstr("no runs"));
  EXPECT_THAT(render_threads({}, Format::table), HasSubstr("No threads"));
}

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
  EXPECT_THAT(beginnings, ElementsAre("Test1.A  S", "udp #1    ", "udp #2    ", "fastdds #1", "fastdds #2",
                                      "Test1.B  S", "udp #1    ", "udp #2    ", "fastdds #1", "fastdds #2"));
}

TEST(TableFormat, TellsRunsOfOneIdApart) {
  auto small = asked("Payload", "udp"), large = asked("Payload", "udp");
  large["payload_bytes"] = 32768;
  const auto by_payload = render({summary(small, outcome()), summary(large, outcome())}, Format::table);
  EXPECT_THAT(by_payload, AllOf(HasSubstr("\nudp 500 B "), HasSubstr("\nudp 32 KiB ")));
  EXPECT_THAT(lines_of(by_payload).at(1), Not(HasSubstr("500 B"))) << "it does not hold for all";

  small["variant"] = "payload 500 B";
  large["variant"] = "payload 32 KiB";
  const auto by_variant = render({summary(small, outcome()), summary(large, outcome())}, Format::table);
  EXPECT_THAT(by_variant, AllOf(HasSubstr("\nudp payload 500 B "), HasSubstr("\nudp payload 32 KiB ")));

  auto again = summary(small, outcome());
  again.run.number = 2;
  EXPECT_THAT(render({summary(small, outcome()), again}, Format::table),
              AllOf(HasSubstr(" run 1 "), HasSubstr(" run 2 ")));
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

TEST(TableFormat, LetsNothingSteerTheTerminal) {
  auto evil = asked("a\x1b[2J", "udp\r\n");
  evil["title"] =
      "t\x07\xc2\x9b"
      "31m\ttitle";
  for (const auto format : {Format::table, Format::markdown, Format::latex}) {
    const auto text = render({summary(evil, outcome())}, format);
    EXPECT_EQ(std::count_if(text.begin(), text.end(),
                            [](unsigned char c) { return (c < 0x20 && c != '\n') || c == 0x7f; }),
              0);
    EXPECT_THAT(text, Not(HasSubstr("\xc2\x9b")));
  }
}

TEST(Csv, HasAStableHeader) {
  const auto header = lines_of(render({}, Format::csv)).at(0);
  EXPECT_EQ(
      header,
      "run,id,title,variant,repetition,transport,payload_bytes,period_us,deadline_us,timeout_us,schedule,"
      "realtime,complete,interrupted,sent,on_time,late,lost,skipped_cycles,duplicates,strays,reordered,"
      "refused_sends,dropped_records,"
      "round_trip_us_min,round_trip_us_mean,round_trip_us_p50,round_trip_us_p90,round_trip_us_p99,"
      "round_trip_us_p99.9,round_trip_us_p99.99,round_trip_us_max,"
      "response_us_min,response_us_mean,response_us_p50,response_us_p90,response_us_p99,"
      "response_us_p99.9,response_us_p99.99,response_us_max,"
      "wake_up_us_min,wake_up_us_mean,wake_up_us_p50,wake_up_us_p90,wake_up_us_p99,"
      "wake_up_us_p99.9,wake_up_us_p99.99,wake_up_us_max,"
      "server_us_min,server_us_mean,server_us_p50,server_us_p90,server_us_p99,"
      "server_us_p99.9,server_us_p99.99,server_us_max");
}

TEST(Csv, SaysWhatTheJsonSays) {
  const std::vector<Summary> runs = {summary(asked("a", "udp"), outcome()),
                                     summary(asked("b", "udp"), nullptr)};
  const auto records = parse_csv(render(runs, Format::csv));
  const auto document = json::parse(render(runs, Format::json));
  ASSERT_EQ(records.size(), 3u);
  for (std::size_t i = 0; i < runs.size(); ++i) {
    const auto& run = document.at("runs").at(i);
    for (std::size_t k = 0; k < records[0].size(); ++k) {
      const auto& name = records[0][k];
      const auto us = name.find("_us_");
      const json& value = us == std::string::npos ? run.at(name)
                          : run.at(name.substr(0, us + 3)).is_null()
                              ? run.at(name.substr(0, us + 3))
                              : run.at(name.substr(0, us + 3)).at(name.substr(us + 4));
      const auto expected = value.is_null()     ? ""
                            : value.is_string() ? value.get<std::string>()
                                                : value.dump();
      EXPECT_EQ(records[i + 1].at(k), expected) << name;
    }
  }
}

TEST(Csv, KeepsEveryText) {
  std::mt19937 random(5);
  static constexpr std::string_view letters = "a,\"\n\r ;'";
  for (int i = 0; i < 200; ++i) {
    std::string title;
    for (auto n = random() % 10; n > 0; --n) title += letters[random() % letters.size()];
    auto strange = asked("a", "udp");
    strange["title"] = title;
    const auto records = parse_csv(render({summary(strange, outcome())}, Format::csv));
    ASSERT_EQ(records.size(), 2u);
    ASSERT_EQ(records[1].size(), records[0].size());
    ASSERT_EQ(records[1][2], title);
  }
}

TEST(Markdown, KeepsItsCells) {
  auto strange = asked("a|b", "u|d_p*");
  strange["title"] = "<b>`x`</b>";
  const auto lines = lines_of(render({summary(strange, outcome())}, Format::markdown));
  EXPECT_EQ(lines.at(0), "### a\\|b  \\<b\\>\\`x\\`\\</b\\>");
  std::size_t rows = 0;
  for (const auto& line : lines) {
    if (!line.starts_with("|")) continue;
    ++rows;
    std::size_t bars = 0;
    for (std::size_t i = 0; i < line.size(); ++i)
      if (line[i] == '|' && (i == 0 || line[i - 1] != '\\')) ++bars;
    EXPECT_EQ(bars, 12u) << line;
  }
  EXPECT_EQ(rows, 3u);
}

TEST(Latex, EscapesWhatItWouldObey) {
  auto strange = asked("50%_#1", "a&b$");
  strange["title"] = "{\\x^~}";
  const auto text = render({summary(strange, outcome())}, Format::latex);
  EXPECT_THAT(
      text,
      HasSubstr("\\caption{50\\%\\_\\#1  \\{\\textbackslash{}x\\textasciicircum{}\\textasciitilde{}\\}}"));
  EXPECT_THAT(text, HasSubstr("\na\\&b\\$ & 1.0 & "));
  EXPECT_THAT(text, HasSubstr("Round trip ($\\mu$s) & Min & Avg & p50"));
}

TEST(Latex, MakesOneTableAnId) {
  const auto text = render({summary(asked("a", "udp"), outcome()), summary(asked("b", "udp"), outcome()),
                            summary(asked("a", "fastdds"), outcome())},
                           Format::latex);
  const auto lines = lines_of(text);
  EXPECT_EQ(std::count(lines.begin(), lines.end(), "\\begin{tabular}{|l|r|r|r|r|r|r|r|r|r|r|}"), 2);
  EXPECT_EQ(std::count(lines.begin(), lines.end(), "\\end{tabular}"), 2);
}

TEST(Threads, AreShownAsTheKernelSaidTheyWere) {
  const std::vector<Summary> runs = {summary(asked("Test1.B", "udp", 2), outcome())};
  const auto text = render_threads(runs, Format::table);
  EXPECT_THAT(text, HasSubstr("Test1.B  udp #2, threads on the controller"));
  EXPECT_THAT(row_of(text, "send"),
              ElementsAre("send", "ontime-send", "12", "fifo", "80", "0-1", "0/1", "2000/3", "1.2"));
  const auto document = json::parse(render_threads(runs, Format::json));
  ASSERT_EQ(document.size(), 2u);
  for (const auto& entry : document) {
    EXPECT_EQ(entry.at("id"), "Test1.B");
    EXPECT_EQ(entry.at("transport"), "udp");
    EXPECT_EQ(entry.at("repetition"), 2);
    EXPECT_EQ(entry.at("threads"), json::array({thread("send"), thread("receive")}));
  }
  const auto records = parse_csv(render_threads(runs, Format::csv));
  ASSERT_EQ(records.size(), 5u);
  EXPECT_THAT(records[0], ElementsAre("run", "id", "transport", "repetition", "host", "role", "name", "tid",
                                      "policy", "priority", "cpus", "minor_faults", "major_faults",
                                      "voluntary_switches", "involuntary_switches", "cpu_time_us"));
  EXPECT_THAT(records[1], ElementsAre("1", "Test1.B", "udp", "2", "component", "send", "ontime-send", "12",
                                      "fifo", "80", "0-1", "0", "1", "2000", "3", "1234"));
}

}  // namespace
}  // namespace ontime::report
