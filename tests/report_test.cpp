// SPDX-License-Identifier: Apache-2.0
#include <random>
#include <set>

#include "json.hpp"
#include "report_fixture.hpp"

namespace ontime::report {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

TEST(Json, HasEveryKeyThatIsPromised) {
  auto one = summary(asked("Test1.B", "cyclonedds"), outcome());
  one.server = statistics::Distribution{};
  const auto document = parsed_json(render({one}, Format::json));
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
  for (const auto* key : {"launch_us", "listen"})
    EXPECT_EQ(run.at("conditions").at(key), nullptr) << "not requested, and not unknown: " << key;
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
  const auto run = parsed_json(render({one}, Format::json)).at("runs").at(0);
  EXPECT_EQ(run.at("round_trip_us").at("min").dump(), "1234.567");
  EXPECT_EQ(run.at("round_trip_us").at("max").dump(), "9007199254.741");
  EXPECT_EQ(run.at("response_us"), nullptr) << "there are no values";
}

TEST(Json, CountsSamplesThatTheFileLostLater) {
  auto one = summary(asked("a", "udp"), outcome());
  one.run.outcome.counters.dropped_records = 7;
  const auto run = parsed_json(render({one}, Format::json)).at("runs").at(0);
  EXPECT_EQ(run.at("dropped_records"), 7);
  EXPECT_THAT(run.at("remarks").get<std::string>(), HasSubstr("samples not recorded (missing above): 7"));
}

TEST(Json, SaysWhichRunsDidNotEndAsAsked) {
  auto interrupted = outcome();
  interrupted["interrupted"] = true;
  const auto document =
      parsed_json(render({summary(asked("a", "udp"), nullptr), summary(asked("b", "udp"), interrupted),
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
  EXPECT_EQ(parsed_json(render({}, Format::json)).at("runs"), json::array());
  EXPECT_EQ(parsed_json(render_threads({}, Format::json)), json::array());
  EXPECT_EQ(parse_csv(render({}, Format::csv)).size(), 1u);
  EXPECT_THAT(render({}, Format::table), HasSubstr("no runs"));
  EXPECT_THAT(render_threads({}, Format::table), HasSubstr("No threads"));
}

TEST(Csv, HasAStableHeader) {
  const auto header = lines_of(render({}, Format::csv)).at(0);
  EXPECT_THAT(
      header,
      StartsWith(
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
          "server_us_p99.9,server_us_p99.99,server_us_max,"
          "key,late_by_response,trailing_cycles,there_us_min,"));
  EXPECT_TRUE(header.ends_with(
      ",back_us_max,parts_error_us,controller_lost_on_the_way,controller_lost_overwritten,"
      "component_lost_on_the_way,component_lost_overwritten,component_transport,receive,domain,ping_topic,"
      "pong_topic,qos_reliability,qos_history,qos_depth,qos_durability,interface,component_interface,"
      "round_trip_95_us_mean_low,"
      "round_trip_95_us_mean_high,round_trip_95_us_p50_low,round_trip_95_us_p50_high,"
      "round_trip_95_us_p90_low,round_trip_95_us_p90_high,round_trip_95_us_p99_low,round_trip_95_us_p99_high,"
      "round_trip_95_us_p99.9_low,round_trip_95_us_p99.9_high,round_trip_95_us_p99.99_low,"
      "round_trip_95_us_p99.99_high,response_95_us_mean_low,response_95_us_mean_high,"
      "response_95_us_p50_low,response_95_us_p50_high,response_95_us_p90_low,response_95_us_p90_high,"
      "response_95_us_p99_low,response_95_us_p99_high,response_95_us_p99.9_low,response_95_us_p99.9_high,"
      "response_95_us_p99.99_low,response_95_us_p99.99_high,probability_late_value,probability_late_low,"
      "probability_late_high,probability_late_bound,probability_lost_value,probability_lost_low,"
      "probability_lost_high,probability_lost_bound,probability_missed_value,probability_missed_low,"
      "probability_missed_high,probability_missed_bound,bursts_count,bursts_longest,bursts_longest_ms,"
      "block_maxima_allowed,block_maxima_level_us,block_maxima_level_low_us,block_maxima_level_high_us,"
      "block_maxima_fit_p,peaks_over_threshold_allowed,peaks_over_threshold_level_us,"
      "peaks_over_threshold_level_low_us,peaks_over_threshold_level_high_us,peaks_over_threshold_fit_p,"
      "wrong_size,wrong_server_times,request_leg_us_min,request_leg_us_mean,request_leg_us_p50,"
      "request_leg_us_p90,request_leg_us_p99,request_leg_us_p99.9,request_leg_us_p99.99,request_leg_us_max,"
      "reply_leg_us_min,reply_leg_us_mean,reply_leg_us_p50,reply_leg_us_p90,reply_leg_us_p99,"
      "reply_leg_us_p99.9,reply_leg_us_p99.99,reply_leg_us_max,extremes_exceedance,"
      "state,started_at,measures,conditions_text,component,duration_s,controller_hostname,"
      "controller_kernel_release,controller_transport_version,component_hostname,component_kernel_release,"
      "component_transport_version,ontime,probability_late_by_response_value,probability_late_by_response_"
      "low,"
      "probability_late_by_response_high,probability_late_by_response_bound"));
}

TEST(Json, BurstsAreUnknownWhereOnlyTheWorstMessagesAreKept) {
  auto worst = summary(asked("a", "udp"), outcome());
  worst.has_worst_only = true;
  worst.late = 12;
  EXPECT_EQ(parsed_json(render({worst}, Format::json)).at("runs").at(0).at("bursts"), nullptr);
  EXPECT_EQ(row_by_name(render({worst}, Format::csv), 0).at("bursts_longest"), "");
}

TEST(Csv, SaysWhatTheJsonSays) {
  auto whole = summary(asked("a", "udp"), outcome());
  whole.late_by_response = 7;
  whole.parts = statistics::Parts{whole.round_trip, whole.round_trip, 5000, false};
  whole.round_trip_certainty[statistics::Figure::p99] = {1e6, {0.9e6, 1.2e6}, {}};
  whole.late_probability.messages = 2000;
  whole.late_probability.sure = {0.01, 0.02};
  whole.bursts = {3, 4, 5'000'000};
  whole.extremes.maxima.emplace().level_lies = {4e6, 7e6};
  const std::vector<Summary> runs = {whole, summary(asked("b", "udp"), nullptr)};
  const auto csv = render(runs, Format::csv);
  const auto document = parsed_json(render(runs, Format::json));
  for (std::size_t i = 0; i < runs.size(); ++i) {
    const auto& run = document.at("runs").at(i);
    std::map<std::string, json> expected;
    for (const auto& [key, value] : run.items()) {
      if (!value.is_structured()) expected[key] = value;
      if (!key.ends_with("_us") || value.is_null()) continue;
      if (!value.is_object()) continue;
      for (const auto& [name, number] : value.items()) {
        expected[key + "_" + name] = number;
        if (!number.is_object()) continue;
        for (const auto* end : {"low", "high"}) expected[key + "_" + name + "_" + end] = number.at(end);
      }
    }
    for (const auto& [what, probability] : run.at("probability").items())
      for (const auto& [name, number] : probability.items())
        expected["probability_" + what + "_" + name] = number;
    for (const auto& [name, number] : run.at("bursts").items()) expected["bursts_" + name] = number;
    if (i == 0)
      for (const auto& [name, number] : run.at("extremes").at("block_maxima").items())
        expected["block_maxima_" + name] = number;
    expected["extremes_exceedance"] = run.at("extremes").at("exceedance");
    for (const auto& [key, value] : run.at("conditions").items())
      if (!value.is_structured()) expected[key] = value;
    for (const auto& [key, value] : run.at("conditions").at("qos").items()) expected["qos_" + key] = value;
    if (i == 0) expected["parts_error_us"] = run.at("parts").at("error_us");
    expected["ontime"] = run.at("provenance").at("ontime");
    if (i == 0)
      for (const auto* host : {"controller", "component"})
        expected[host + std::string("_transport_version")] =
            run.at("hosts").at(host).at("transport").at("version");
    const auto row = row_by_name(csv, i);
    std::size_t found = 0;
    for (const auto& [name, field] : row) {
      const auto& value = expected[name];
      found += value.is_null() ? 0 : 1;
      EXPECT_EQ(field, value.is_null()     ? ""
                       : value.is_string() ? value.get<std::string>()
                                           : value.dump())
          << name;
    }
    EXPECT_GT(found, 30u);
  }
}

TEST(Csv, TellsFitRunsFromOthersAndWhenTheyBegan) {
  std::vector runs{summary(asked("a", "udp"), outcome()), summary(asked("a", "udp", 2), outcome()),
                   summary(asked("a", "udp", 3), nullptr)};
  for (auto& run : runs) run.late_by_response = 0;
  amend(runs[1].run.outcome, "/hosts/controller/load_running", false);
  runs[0].run.started_at = "2026-11-30T17:20:05.123Z";
  runs[1].run.started_at = "2026-11-30T17:31:00.000Z";
  runs[2].run.number = 3;
  const auto csv = render(runs, Format::csv, {.file = "x", .running_from = 3});
  std::vector<std::string> states;
  for (std::size_t i = 0; i < runs.size(); ++i) states.push_back(row_by_name(csv, i).at("state"));
  EXPECT_THAT(states, ElementsAre("ok", "NOT APPLIED", "running"));
  EXPECT_EQ(row_by_name(csv, 0).at("started_at"), "2026-11-30T17:20:05.123Z");
  EXPECT_THAT(row_by_name(csv, 0).at("conditions_text"), HasSubstr("500 B, every 10 ms"));
  EXPECT_THAT(render(runs, Format::markdown), HasSubstr("2026-11-30 17:20 to 17:31 UTC"));
  runs[1].run.started_at = "yesterday";
  EXPECT_THAT(render(runs, Format::markdown), HasSubstr("start of the run: 2026-11-30 17:20 UTC"));
}

TEST(Csv, HasAColumnForEachOption) {
  auto one = asked("a", "ros2"), other = asked("a", "ros2"), third = asked("a", "cyclonedds");
  one["options"] = one["component_options"] = {{"executor", "multi"}, {"rmw", "rmw_cyclonedds_cpp"}};
  other["component_transport"] = "fastdds";
  other["component_options"] = {{"config", "x,y"}};
  third["component_transport"] = "cyclonedds";
  const auto csv =
      render({summary(one, outcome()), summary(other, outcome()), summary(third, outcome())}, Format::csv);
  EXPECT_TRUE(lines_of(csv).at(0).ends_with(",option.executor,option.rmw,component_option.config"));
  EXPECT_EQ(row_by_name(csv, 0).at("option.executor"), "multi");
  EXPECT_EQ(row_by_name(csv, 0).at("component_option.config"), "");
  EXPECT_EQ(row_by_name(csv, 1).at("component_option.config"), "x,y");
  EXPECT_EQ(row_by_name(csv, 1).at("component_transport"), "fastdds");
  EXPECT_EQ(row_by_name(csv, 2).at("option.rmw"), "");
  const auto threads = render_threads({summary(one, outcome()), summary(other, outcome())}, Format::csv);
  EXPECT_EQ(row_by_name(threads, 0).at("option.executor"), "multi");
}

TEST(Csv, IsNoProgramForASpreadsheet) {
  for (const auto* formula : {"=1+1", "+1+1", "-1+1", "@SUM(A1)", " =1", "\t=1", "=cmd|' /C calc'!A0"}) {
    auto strange = asked("a", "udp");
    strange["title"] = formula;
    strange["options"] = {{formula, formula}};
    const auto records = parse_csv(render({summary(strange, outcome())}, Format::csv));
    for (const auto& record : records)
      for (const auto& field : record)
        EXPECT_TRUE(field.empty() ||
                    std::string("=+-@").find(field.at(field.find_first_not_of(' '))) == std::string::npos)
            << field;
  }
  auto below = summary(asked("a", "udp"), outcome());
  below.parts =
      statistics::Parts{statistics::distribution({-4000}), statistics::distribution({1}), 5000, false};
  EXPECT_EQ(row_by_name(render({below}, Format::csv), 0).at("there_us_min"), "-4.0")
      << "a number is a number";
}

TEST(Csv, KeepsEveryText) {
  std::mt19937 random(5);
  static constexpr std::string_view letters = "a,\" ;'|=";
  for (int i = 0; i < 200; ++i) {
    std::string title;
    title = "t";
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
    EXPECT_EQ(bars, rows <= 3 ? 12u : 8u) << line;
  }
  EXPECT_EQ(rows, 6u) << "of the paper's table, and of the stages";
}

TEST(Latex, EscapesWhatItWouldObey) {
  auto strange = asked("50%_#1", "a&b$");
  strange["title"] = "{\\x^~}";
  const auto text = render({summary(strange, outcome())}, Format::latex);
  EXPECT_THAT(
      text,
      HasSubstr("\\caption{50\\%\\_\\#1  \\{\\textbackslash{}x\\textasciicircum{}\\textasciitilde{}\\}}"));
  EXPECT_THAT(text, HasSubstr("\na\\&b\\$ & 1.0 & "));
  strange["title"] = "≤ ≥ → ×";
  EXPECT_THAT(render({summary(strange, outcome())}, Format::latex),
              HasSubstr("$\\leq$ $\\geq$ $\\rightarrow$ $\\times$"));
  EXPECT_THAT(text, HasSubstr("Round trip ($\\mu$s) & Min & Avg & p50"));
}

TEST(Latex, HasNoLetterThatPdflatexDoesNotKnow) {
  auto strange = asked("λ Ω 10⁻⁶ −5 ü’ 中 ŧ 😀", "udp");
  EXPECT_THAT(render({summary(strange, outcome())}, Format::latex),
              HasSubstr("\\caption{$\\lambda$ $\\Omega$ 10$^{-}$$^{6}$ $-$5 ü’ \\texttt{U+4E2D} "
                        "\\texttt{U+0167} \\texttt{U+1F600}"));
}

TEST(Latex, RowSaysThatItsRunWasNotAsRequested) {
  std::vector runs{summary(asked("a", "udp"), outcome()), summary(asked("a", "fastdds"), outcome()),
                   summary(asked("a", "cyclonedds"), outcome())};
  amend(runs[1].run.outcome, "/hosts/controller/load_running", false);
  const auto complete = render(runs, Format::latex);
  EXPECT_THAT(complete, AllOf(HasSubstr("\nudp & 1.0 &"), HasSubstr("\nfastdds (NOT APPLIED) & 1.0 &"),
                              Not(HasSubstr("20 s requested"))));
  amend(runs[2].run.outcome, "/interrupted", true);
  EXPECT_THAT(render(runs, Format::markdown),
              AllOf(HasSubstr("| fastdds (NOT APPLIED) | 1.0 |"), HasSubstr("| cyclonedds (CUT OFF) | 1.0 |"),
                    HasSubstr(", 20 s requested")))
      << "not all of them took so long";
}

TEST(Latex, ConditionsAndSignsArePrintedBelowTheTable) {
  const auto text = render({summary(asked("a", "udp"), outcome(), 500)}, Format::latex);
  const auto from = text.find("\\end{tabular}");
  const auto below = text.substr(from, text.find("\\end{table*}") - from);
  EXPECT_THAT(below, AllOf(HasSubstr("500 B, every 10 ms"), HasSubstr("\nMissed deadlines: "),
                           HasSubstr("\\textasciitilde{}: fewer than 10"), Not(HasSubstr("\n%"))));
}

TEST(Latex, ColumnsWithoutAValueAreLeftOut) {
  const auto few = summary(asked("a", "udp"), outcome(), 500);
  const auto text = render({few}, Format::latex);
  EXPECT_THAT(text, AllOf(HasSubstr(" & p99 & Max & "), Not(HasSubstr("too few messages, or unknown"))));
  EXPECT_THAT(render({few, summary(asked("a", "fastdds"), outcome(), 2000)}, Format::latex),
              AllOf(HasSubstr(" & p99 & p99.9 & Max & "), HasSubstr("too few messages, or unknown")));
}

TEST(Latex, LeavesNoMoreTablesWithoutAPlaceThanItMay) {
  std::vector<Summary> ids;
  for (int i = 0; i < 40; ++i) ids.push_back(summary(asked("id" + std::to_string(i), "udp"), outcome()));
  std::size_t unplaced = 0;
  for (const auto& line : lines_of(render(ids, Format::latex))) {
    if (line == "\\clearpage") unplaced = 0;
    unplaced += line.starts_with("\\begin{table") ? 1 : 0;
    ASSERT_LE(unplaced, 12u);
  }
  EXPECT_GT(unplaced, 0u);
}

TEST(Latex, MakesOneTableAnId) {
  const auto text = render({summary(asked("a", "udp"), outcome()), summary(asked("b", "udp"), outcome()),
                            summary(asked("a", "fastdds"), outcome())},
                           Format::latex);
  const auto lines = lines_of(text);
  EXPECT_EQ(std::count(lines.begin(), lines.end(), "\\begin{tabular}{|l|r|r|r|r|r|r|r|r|r|}"), 2)
      << "of p99.99 are too few";
  EXPECT_EQ(std::count(lines.begin(), lines.end(), "\\end{tabular}"), 4) << "and one of the stages";
}

TEST(Threads, AreShownAsTheKernelSaidTheyWere) {
  const std::vector<Summary> runs = {summary(asked("Test1.B", "udp", 2), outcome())};
  const auto text = render_threads(runs, Format::table);
  EXPECT_THAT(text, HasSubstr("Run 1: Test1.B  udp #2, threads on the controller"));
  EXPECT_THAT(row_of(text, "send"),
              ElementsAre("send", "ontime-send", "12", "fifo", "80", "0-1", "0/1", "2000/3", "1.2"));
  const auto document = parsed_json(render_threads(runs, Format::json));
  ASSERT_EQ(document.size(), 2u);
  for (const auto& entry : document) {
    EXPECT_EQ(entry.at("id"), "Test1.B");
    EXPECT_EQ(entry.at("transport"), "udp");
    EXPECT_EQ(entry.at("repetition"), 2);
    EXPECT_EQ(entry.at("threads"), json::array({thread("send"), thread("receive")}));
  }
  const auto records = parse_csv(render_threads(runs, Format::csv));
  ASSERT_EQ(records.size(), 5u);
  EXPECT_THAT(records[0],
              ElementsAre("run", "id", "transport", "repetition", "host", "role", "name", "tid", "policy",
                          "priority", "cpus", "minor_faults", "major_faults", "voluntary_switches",
                          "involuntary_switches", "cpu_time_us", "component_transport", "receive"));
  EXPECT_THAT(records[1], ElementsAre("1", "Test1.B", "udp", "2", "component", "send", "ontime-send", "12",
                                      "fifo", "80", "0-1", "0", "1", "2000", "3", "1234", "", "listener"));
}

// What would steer a terminal, or show a text otherwise than it is.
const std::vector<std::string> hostile = {"\x1b[2J",           // erases the screen
                                          "\x1b]0;title\x07",  // renames the window
                                          "a\rb\nc\td",
                                          std::string("a\0b", 3),
                                          "\x7f",
                                          "\xc2\x9b"
                                          "31m",  // C1, in UTF-8
                                          "\x9b"
                                          "31m",  // and as one byte
                                          "\xe2\x80\xae"
                                          "evil",  // right to left from here on
                                          "\xe2\x81\xa6"
                                          "evil",  // an isolate
                                          "\xd8\x9c",
                                          "\xe2\x80\xa8line",
                                          "\xef\xbb\xbf",
                                          "\xf3\xa0\x80\x81",  // a tag
                                          "\xc0\x9b",          // not the shortest form
                                          "\xed\xa0\x80",      // half of a pair
                                          "\xf4\x90\x80\x80",  // beyond the last
                                          "\xe2\x80",          // cut off
                                          "\x80\xff"};

bool steers(const std::string& text, bool with_lines) {
  for (std::size_t i = 0; i < text.size(); ++i) {
    const auto c = static_cast<unsigned char>(text[i]);
    if ((c < 0x20 && !(with_lines && c == '\n')) || c == 0x7f) return true;
    for (const std::string_view one :
         {"\xe2\x80\xae", "\xe2\x81\xa6", "\xd8\x9c", "\xe2\x80\xa8", "\xef\xbb\xbf", "\xf3\xa0\x80\x81",
          "\xed\xa0\x80", "\xf4\x90\x80\x80"})
      if (std::string_view(text).substr(i).starts_with(one)) return true;
    // A byte that follows no beginning, or one of C1.
    if (c < 0x80) continue;
    const std::size_t length = c >= 0xf0 ? 4 : c >= 0xe0 ? 3 : 2;
    if (c < 0xc2 || i + length > text.size()) return true;
    for (std::size_t k = 1; k < length; ++k)
      if ((static_cast<unsigned char>(text[i + k]) & 0xc0) != 0x80) return true;
    if (c == 0xc2 && static_cast<unsigned char>(text[i + 1]) < 0xa0) return true;
    i += length - 1;
  }
  return false;
}

TEST(Printable, LetsNothingSteer) {
  for (const auto& text : hostile)
    EXPECT_FALSE(steers(table::printable(text), false)) << table::printable(text);
  EXPECT_EQ(table::printable("a\x1b[2Jb"), "a?[2Jb");
  EXPECT_EQ(table::printable("a\r\nb\tc"), "a  b c");
  for (const auto* none : {"\xef\xbf\xbf", "\xef\xbf\xbe", "\xf0\x9f\xbf\xbe"})
    EXPECT_EQ(table::printable(none), "?") << "no character: XML, such as --junit, cannot have it";
  for (const auto* plain : {"", "a b", "Größe 5 µs ± 1 … → 日本 🤖", "\xc2\xa0"})
    EXPECT_EQ(table::printable(plain), plain);
}

TEST(Width, IsThatOfTheTerminal) {
  for (const auto& [text, width] : {std::pair("abc", 3U),
                                    {"e\u0301t\u0301", 2U},  // combining accents
                                    {"日本", 4U},            // wide
                                    {"คู่มือ", 3U},             // marks above and below
                                    {"👩\u200d", 2U}})        // a joiner
    EXPECT_EQ(width_of(text), width) << text;
  EXPECT_EQ(table::shortened("e\u0301e\u0301e\u0301", 2), "e\u0301…");
  const auto text = table::as_text({.tables = {{.columns = {{"", table::Column::Align::left}, {"n"}},
                                                .rows = {{"日本", "1"}, {"e\u0301", "2"}}}}},
                                   80);
  EXPECT_THAT(text, HasSubstr("\n日本  1\ne\u0301     2\n"));
}

TEST(AllFormats, LetNothingSteerTheTerminal) {
  const auto hostile_in_all_texts = [](json value, const std::string& text) {
    const auto leaves = value.flatten();
    for (const auto& [path, leaf] : leaves.items())
      if (leaf.is_string()) value[json::json_pointer(path)] = leaf.get<std::string>() + text;
    return value;
  };
  for (const auto& text : hostile) {
    auto evil_asked = hostile_in_all_texts(asked("a", "udp"), text);
    evil_asked.update({{"adds_to", text},
                       {"variant", "realtime." + text},
                       {"options", {{"config" + text, text}, {text, 1}}},
                       {"component_transport", text},
                       {"component_options", {{text, text}}},
                       {"ping_topic", text},
                       {"pong_topic", text},
                       {"domain", text}});
    auto whole = outcome();
    whole["hosts"]["controller"]["refusals"] = {{{"asked", "a"}, {"found", "f"}, {"remedy", "one\ntwo"}}};
    whole["hosts"]["controller"]["link"] = {{"interface", "eth0"}, {"sent_packets", 1}};
    whole["hosts"]["component"]["transport"]["facts"] = {{"rmw", "rmw_x"}, {"executor", "single"}};
    whole = hostile_in_all_texts(whole, text);
    whole["hosts"]["host" + text] = whole["hosts"]["controller"];
    whole["hosts"]["host" + text]["load_running"] = false;
    auto one = summary(evil_asked, whole), other = summary(asked("b", "udp"), {{"error", "failed" + text}});
    one.notes = {{"kind" + text, "left" + text, 5, {}}, {"kind" + text, "", {}, 3}};
    one.no_parts = text;
    one.run.key = text;
    amend(other.run.asked, "/id", text);
    for (const auto format : all_formats)
      for (const auto& rendered : {render({one, other}, format), render_threads({one, other}, format),
                                   render_layers({one, other}, format)}) {
        EXPECT_FALSE(steers(rendered, true)) << rendered;
        EXPECT_TRUE(format != Format::json || json::accept(rendered));
      }
  }
}

TEST(Json, KeepsEveryValue) {
  for (const auto& text : hostile) {
    auto strange = asked("a", "udp");
    strange["title"] = text;
    const auto title =
        parsed_json(render({summary(strange, outcome())}, Format::json)).at("runs").at(0).at("title");
    const auto expected = parsed_json(json(text).dump(-1, ' ', true, json::error_handler_t::replace));
    EXPECT_EQ(title, expected);
  }
}

}  // namespace
}  // namespace ontime::report
