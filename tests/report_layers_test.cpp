// SPDX-License-Identifier: Apache-2.0
#include "json.hpp"
#include "report_fixture.hpp"

namespace ontime::report {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

Summary layer(const std::string& id, const std::string& adds_to, int repetition, std::int64_t p50_ns,
              const json& further = json::object()) {
  auto conditions = asked(id, "udp", repetition);
  conditions["adds_to"] = adds_to;
  conditions.update(further);
  auto one = summary(conditions, outcome());
  one.run.key = id + further.dump();
  one.round_trip[statistics::Figure::p50] = p50_ns;
  return one;
}

std::vector<Summary> two_layers(int repetitions) {
  std::vector<Summary> runs;
  for (int repetition = 1; repetition <= repetitions; ++repetition) {
    runs.push_back(layer("udp", "", repetition, 20'000 + repetition * 1000));
    runs.push_back(layer("dds", "udp", repetition, 30'000 + repetition * 1000));
  }
  return runs;
}

TEST(LayersPage, ShowsConfidenceIntervals) {
  auto text = render_layers(two_layers(9), Format::table);
  EXPECT_THAT(text, AllOf(HasSubstr("+10.0 [10.0, 10.0]"), HasSubstr("96.1 %"), HasSubstr("9 repetitions"),
                          Not(HasSubstr("[10.0, 10.0] 9"))));
  EXPECT_THAT(text, HasSubstr("median of the differences"));
  EXPECT_THAT(render_layers(two_layers(1), Format::table),
              AllOf(HasSubstr("+10.0 "), HasSubstr("intervals: no run was repeated"), Not(HasSubstr("["))));
  auto runs = two_layers(9);
  for (int repetition = 1; repetition <= 5; ++repetition)
    runs.push_back(layer("ros2", "dds", repetition, 50'000 + repetition * 1000));
  text = render_layers(runs, Format::table);
  EXPECT_THAT(text, AllOf(HasSubstr("+10.0 [10.0, 10.0] 96.1 %"), HasSubstr("+20.0 [20.0, 20.0] 93.8 %"),
                          HasSubstr("C %: C %")));
}

TEST(LayersPage, NarrowTableOmitsBarsThenAddedCpuTime) {
  auto runs = two_layers(9);
  for (int repetition = 1; repetition <= 9; ++repetition)
    runs.push_back(layer("authenticated-and-encrypted", "dds", repetition, 50'000 + repetition * 1000));
  const auto in = [&](std::size_t width) { return render_layers(runs, Format::table, width); };
  EXPECT_THAT(in(120), AllOf(HasSubstr("█"), HasSubstr("CPU\n")));
  EXPECT_THAT(in(80), AllOf(Not(HasSubstr("█")), HasSubstr("CPU\n"), HasSubstr("+20.0 [20.0, 20.0]")));
  const auto narrow = in(60);
  EXPECT_THAT(narrow, AllOf(Not(HasSubstr("+0.0 [")), HasSubstr("+20.0 [20.0, 20.0]")));
  EXPECT_THAT(in(80), Not(HasSubstr("Omitted"))) << "the bars have no name";
  EXPECT_THAT(table::replace_all(narrow, "\n  ", " "), HasSubstr("tables: CPU added (µs)."));
  for (const auto& line : table::split(narrow, '\n')) EXPECT_LE(table::width_of(line), 60u) << line;
}

TEST(LayersPage, NamesWhatTellsLayersOfOneIdApart) {
  std::vector<Summary> runs;
  for (const int payload : {500, 32768}) {
    runs.push_back(layer("udp", "", 1, 20'000, {{"payload_bytes", payload}}));
    runs.push_back(layer("dds", "udp", 1, 30'000, {{"payload_bytes", payload}}));
  }
  const auto text = render_layers(runs, Format::markdown);
  EXPECT_THAT(text, AllOf(HasSubstr("| dds: udp 500 B | udp: udp 500 B |"),
                          HasSubstr("| dds: udp 32 KiB | udp: udp 32 KiB |")));
  EXPECT_THAT(text, Not(HasSubstr("█")));
  const auto document = parsed_json(render_layers(runs, Format::json));
  ASSERT_EQ(document.size(), 4u);
  EXPECT_EQ(document.at(1).at("base_key"), document.at(0).at("key"));
  EXPECT_EQ(document.at(3).at("payload_bytes"), 32768);
}

TEST(LayersPage, SaysOnceWhatIsMissing) {
  auto runs = two_layers(3);
  for (int repetition = 1; repetition <= 3; ++repetition)
    for (const auto* id : {"ros2-a", "ros2-b"}) {
      runs.push_back(layer(id, "dds", repetition, 0));
      runs.back().run.outcome = json{{"error", "there is no transport 'ros2' here"}};
    }
  const auto text = render_layers(runs, Format::table);
  EXPECT_THAT(text, HasSubstr("Not measured: ros2-a, ros2-b: there is no transport 'ros2' here"));
  EXPECT_EQ(text.find("ros2-a"), text.rfind("ros2-a"));
  EXPECT_THAT(render_layers({}, Format::table), HasSubstr("baseline"));
  EXPECT_THAT(render_layers({runs.back()}, Format::table),
              AllOf(HasSubstr("Not measured: ros2-b"), HasSubstr("Not measured: dds")));
}

TEST(LayersPage, SaysWhyNoInstructionsWereCounted) {
  const auto page = [](const json& asked) {
    auto runs = two_layers(1);
    for (auto& run : runs) amend(run.run.asked, "/count_instructions", asked);
    return render_layers(runs, Format::markdown);
  };
  EXPECT_THAT(page(true), AllOf(HasSubstr("CPU counter"), Not(HasSubstr("count-instructions"))));
  EXPECT_THAT(page(nullptr), AllOf(HasSubstr("CPU counter"), HasSubstr("count-instructions")));
  EXPECT_THAT(page(true), Not(HasSubstr("Instructions |"))) << "a column of nothing";
}

TEST(LayersPage, AsCsvHasNumbers) {
  const auto csv = render_layers(two_layers(9), Format::csv);
  const auto row = row_by_name(csv, 1);
  EXPECT_EQ(row.at("id"), "dds");
  EXPECT_EQ(row.at("round_trip_ns_added_median"), "10000.0");
  EXPECT_EQ(row.at("round_trip_ns_added_repetitions"), "9");
  EXPECT_EQ(row.at("instructions_total_median"), "");
  EXPECT_EQ(row.at("baseline"), row.at("adds_to"));
}

}  // namespace
}  // namespace ontime::report
