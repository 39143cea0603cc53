// SPDX-License-Identifier: Apache-2.0
#include "foreign/foreign.hpp"

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <regex>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include "statistics/statistics.hpp"

namespace ontime::foreign {
namespace {

using nlohmann::json;
using ::testing::HasSubstr;
namespace fs = std::filesystem;

// As cyclictest 2.4 printed it: -t2 -h 6.
constexpr const char* text = R"(# /dev/cpu_dma_latency set to 0us
# Histogram
000000 000000	000000
000001 000000	000001
000002 000007	000000
000003 000000	000002
000004 000001	000000
000005 000000	000000
# Total: 000000008 000000003
# Min Latencies: 00002 00001
# Avg Latencies: 00002 00004
# Max Latencies: 00004 00019
# Histogram Overflows: 00000 00002
# Histogram Overflow at cycle number:
# Thread 0:
# Thread 1: 00003 00004

)";

// As it wrote it: -t1 -h 100 --json.
constexpr const char* document = R"({
  "file_version": 1,
  "cmdline:": "cyclictest -t1 -h 100 -q --json=c.json",
  "rt_test_version:": "2.40",
  "start_time": "Sat, 21 Nov 2026 14:44:51 +0000",
  "return_code": 0,
  "sysinfo": {"sysname": "Linux", "nodename": "robot", "release": "6.1.0-rt", "version": "#1 SMP PREEMPT_RT"},
  "num_threads": 1,
  "resolution_in_ns": 0,
  "thread": {"0": {"histogram": {"9": 1, "10": 98}, "cycles": 100, "min": 9, "max": 3908, "avg": 48.91, "cpu": 0}}
})";

class Imports : public ::testing::Test {
 protected:
  Imports() {
    auto name = (fs::temp_directory_path() / "ontime-foreign-test-XXXXXX").string();
    folder_ = ::mkdtemp(name.data());
    file_ = folder_ / "old.txt";
  }
  ~Imports() override { fs::remove_all(folder_); }

  std::vector<Import> read(const std::string& content, What what = {}) {
    std::ofstream(file_, std::ios::binary) << content;
    return foreign::read(file_, what);
  }
  std::string error_of(const std::string& content, What what = {}) {
    try {
      read(content, what);
    } catch (const record::WrongFile& error) {
      return error.what();
    }
    return "no error";
  }
  // As it is read back from a results file.
  std::vector<statistics::Summary> summaries(const std::vector<Import>& imports) {
    const auto results = (folder_ / "results.ontime").string();
    {
      record::Writer writer(results);
      for (const auto& [asked, outcome] : imports) writer.end_run(writer.begin_run(asked), outcome);
    }
    const record::Reader reader(results);
    std::vector<statistics::Summary> all;
    for (const auto& run : reader.runs()) all.push_back(statistics::summarise(reader, run));
    return all;
  }

  fs::path folder_;
  std::string file_;
};

const What as_json{.form = Form::cyclictest_json};

std::string changed(const std::string& in, const std::string& what, const std::string& with) {
  const auto at = in.find(what);
  EXPECT_NE(at, in.npos) << what;
  return std::string(in).replace(at, what.size(), with);
}

TEST_F(Imports, AHistogramIsARunOfEachThread) {
  const auto runs = summaries(read(text));
  ASSERT_EQ(runs.size(), 2U);
  const auto& all = runs[0].wake_up;
  EXPECT_EQ(all.count, 8U);
  EXPECT_EQ(all.min, 2000);
  EXPECT_EQ(all[statistics::Figure::p50], 2000);
  EXPECT_EQ(all[statistics::Figure::p90], 4000);
  EXPECT_EQ(all.max, 4000);
  EXPECT_EQ(all.mean, 2250) << "of its values, for the average is printed without its fraction";
  EXPECT_NE(runs[0].run.key, runs[1].run.key);
}

TEST_F(Imports, UnknownValuesStayNull) {
  const auto runs = summaries(read(text));
  const auto& run = runs.at(1);
  ASSERT_TRUE(run.imported);
  EXPECT_EQ(run.imported->beyond, 2U);
  EXPECT_EQ(run.wake_up.count, 5U);
  EXPECT_EQ(run.wake_up.max, 19000);
  EXPECT_FALSE(statistics::is_lower_bound(run, statistics::Figure::p50));
  EXPECT_FALSE(statistics::is_lower_bound(run, statistics::Figure::p90)) << "it is the greatest";
  EXPECT_EQ(run.wake_up[statistics::Figure::p50], 3000);
  EXPECT_EQ(run.wake_up[statistics::Figure::p90], 19000)
      << "of five values the fifth: the greatest, which it says";
  EXPECT_EQ(run.sent, 0U) << "there were no messages";
  EXPECT_EQ(run.round_trip.count, 0U);
  EXPECT_TRUE(run.shape.slices.empty()) << "nor any order in time";
}

TEST_F(Imports, PercentilesBeyondTheHistogramAreLowerBounds) {
  const auto runs = summaries(read(changed(text, "00000 00002", "00000 00097")));
  const auto& run = runs.at(1);
  EXPECT_TRUE(statistics::is_lower_bound(run, statistics::Figure::p50));
  EXPECT_EQ(run.wake_up[statistics::Figure::p50], 6000);
}

TEST_F(Imports, SumColumnOfDashHIsNoThread) {
  const std::string with_sum =
      std::regex_replace(std::string(text), std::regex("\n(\\d+ \\d+\t\\d+)"), "\n$1\t000009");
  auto sums = changed(with_sum, "000000008 000000003", "000000008 000000003 000000011");
  sums = changed(sums, "00004 00019", "00004 00019 00019");
  sums = changed(sums, "00000 00002\n", "00000 00002 00002\n");
  EXPECT_EQ(read(sums).size(), 2U);
}

TEST_F(Imports, TextOfDashBNamesItsThreadsOnceMore) {
  EXPECT_EQ(read(std::string(text) + "# Thread Ids: 27331 27332\n# Break thread: 27331\n# Break value: 936\n")
                .size(),
            2U);
}

TEST_F(Imports, JsonSaysWhetherTheKernelIsRealTime) {
  const auto preemption = [&](const std::string& content) {
    return read(content, as_json)[0].outcome.at("hosts").at("controller").at("machine").at("preemption");
  };
  EXPECT_EQ(preemption(document), nullptr);
  EXPECT_EQ(preemption(changed(document, "PREEMPT_RT\"", "PREEMPT_RT\", \"realtime\": 1")), "rt");
  EXPECT_EQ(preemption(changed(document, "PREEMPT_RT\"", "PREEMPT_DYNAMIC\", \"realtime\": 0")), "not rt");
}

TEST_F(Imports, JsonSaysItsUnitAndWhereItIsFrom) {
  const auto imports = read(document, as_json);
  ASSERT_EQ(imports.size(), 1U);
  EXPECT_EQ(imports[0].asked.at("imported").at("cmdline"), "cyclictest -t1 -h 100 -q --json=c.json");
  EXPECT_EQ(imports[0].outcome.at("hosts").at("controller").at("machine").at("kernel_release"), "6.1.0-rt");
  const auto runs = summaries(imports);
  EXPECT_EQ(runs[0].wake_up[statistics::Figure::p90], 10'000);
  EXPECT_EQ(runs[0].wake_up.max, 3'908'000);
  EXPECT_EQ(runs[0].imported->beyond, 1U);
  const auto in_ns =
      summaries(read(changed(document, "\"resolution_in_ns\": 0", "\"resolution_in_ns\": 1"), as_json));
  EXPECT_EQ(in_ns[1].wake_up[statistics::Figure::p90], 10);
}

TEST_F(Imports, SameThreadOfTwoFilesHasTheSameKey) {
  const auto runs = summaries({read(text)[0], read(document, as_json)[0], read(text, {.id = "idle"})[0]});
  EXPECT_EQ(runs[0].run.key, runs[1].run.key);
  EXPECT_NE(runs[0].run.key, runs[2].run.key);
}

TEST_F(Imports, UnitOfATextIsTheStatedOne) {
  EXPECT_EQ(summaries(read(text, {.unit_ns = 1}))[0].wake_up[statistics::Figure::p50], 2);
}

TEST_F(Imports, EachInvalidTextIsRefusedWithItsFault) {
  const std::string good = text;
  const std::pair<std::string, const char*> cases[] = {
      {"", "no histogram"},
      {std::string(100'000, 'x'), "longer than"},
      {std::string(1000, '\0'), "no histogram"},
      {"\x7f"
       "ELF\x01\x01",
       "line 1: '\x7f"
       "ELF\x01\x01' is not a whole number"},
      {good.substr(0, 109), "cut off"},
      {good.substr(0, good.rfind("# Thread 1") + 20), "line 16: no end of line"},
      {good.substr(0, good.rfind("00019") + 4), "line 12: no end of line"},
      {good.substr(0, good.find("# Max")), "'# Max Latencies:'"},
      {changed(good, "000002 000007", "000002 -00007"), "line 5: '-00007' is not a whole number"},
      {changed(good, "000002 000007", "000002 nan"), "'nan' is not a whole number"},
      {changed(good, "000002 000007", "000002 7.5"), "'7.5' is not a whole number"},
      {changed(good, "000002 000007", "000002 99999999999999999999"), "not a whole number"},
      {changed(good, "000002 000007", "000002 18446744073709551615"), "more values than any run has"},
      {changed(good, "000002 000007", "000002 000009"),
       "column 1: the counts add up to 10, but 'Total' is 8"},
      {changed(good, "000002 000007\t000000", "000002 000007"), "line 5: it has 2 columns"},
      {changed(good, "000002 000007\t000000", "000002"), "a value and its count"},
      {changed(good, "000003 ", "000001 "), "1 comes after 2"},
      {changed(good, "# Min Latencies: 00002", "# Min Latencies: 00003"), "minimum 3"},
      {changed(good, "# Max Latencies: 00004", "# Max Latencies: 00005"), "maximum 5"},
      {changed(good, "# Max Latencies: 00004", "# Max Latencies: 99999999999999"), "maximum 99999999999999"},
      {changed(good, "00004 00019", "00004 18446744073709551615"),
       "the maximum 18446744073709551615 is out of range"},
      {changed(good, "# Thread 1: 00003 00004", "# Thread 1:\n# Thread 2:\n# Thread 3:"), "names 4 threads"},
      {changed(good, "00000 00002", "00000 18446744073709551615"), "more values than any run has"},
      {good + good, "line 20"},
      {document, "line 1: '{' is not a whole number"},
      {changed(good, "# Histogram", "policy: fifo: loadavg: 1.0"),
       "line 2: 'policy:' is not a whole number of at least 0; `cyclictest -h N -q`"},
  };
  for (const auto& [content, expected] : cases) {
    EXPECT_THAT(error_of(content), HasSubstr(expected));
    EXPECT_THAT(error_of(content), HasSubstr(file_));
    EXPECT_THAT(error_of(content), HasSubstr("Nothing was imported"));
  }
}

TEST_F(Imports, EachInvalidJsonIsRefusedWithItsFault) {
  const std::string good = document;
  const std::pair<std::string, const char*> cases[] = {
      {"", "not JSON"},
      {"[]", "no 'thread'"},
      {"nan", "not JSON"},
      {good.substr(0, good.size() / 2), "cut off"},
      {std::string(100'000, '['), "nested deeper"},
      {changed(good, "\"thread\"", "\"threads\""), "no 'thread'"},
      {changed(good, "\"0\": {", "\"-1\": {"), "'-1' is not a thread number"},
      {changed(good, R"({"9": 1, "10": 98})", "{}"), "the histogram is empty"},
      {changed(good, R"({"9": 1, "10": 98})", "[1]"), "no histogram"},
      {changed(good, "\"9\": 1", "\"9\": -1"), "'9' in the histogram"},
      {changed(good, "\"9\": 1", "\"9\": 1.5"), "'9' in the histogram"},
      {changed(good, "\"9\": 1", "\"x\": 1"), "'x' in the histogram"},
      {changed(good, "\"9\": 1", "\"9\": 18446744073709551615"), "more values than any run has"},
      {changed(good, "\"cycles\": 100", "\"cycles\": 98"), "99 values of 98 cycles"},
      {changed(good, "\"cycles\": 100", "\"cycles\": -100"), "'cycles' is not a whole number"},
      {changed(good, "\"min\": 9", "\"min\": 8"), "minimum 8"},
      {changed(good, "\"avg\": 48.91", "\"avg\": \"NaN\""), "'avg' is not a number"},
      {changed(good, "\"avg\": 48.91", "\"avg\": -1"),
       "its mean, -1, is not between 0 and its maximum, 3908"},
      {changed(good, "\"avg\": 48.91", "\"avg\": 1e306"), "is not between 0 and its maximum"},
      {changed(good, "\"9\": 1", "\"9\": 1, \"09\": 1"), "9 occurs twice in the histogram"},
      {changed(good, "\"thread\": {", "\"thread\": {\"00\": {}, "), "0 occurs twice"},
      {changed(good, "\"avg\": 48.91", "\"avg\": 1e999"), "not JSON"},
      {changed(good, "\"max\": 3908", "\"max\": 1e3"), "'max' is not a whole number"},
      {changed(good, "\"return_code\": 0", "\"return_code\": 1"), "'return_code' is 1: cyclictest failed"},
  };
  for (const auto& [content, expected] : cases)
    EXPECT_THAT(error_of(content, as_json), HasSubstr(expected)) << content.substr(0, 200);
}

TEST_F(Imports, MissingFileIsNamed) {
  EXPECT_THROW(foreign::read((folder_ / "none").string(), {}), record::WrongFile);
  EXPECT_THROW(foreign::read(folder_.string(), {}), record::WrongFile);
}

// A results file may come from any source.
TEST_F(Imports, AHistogramThatCannotBeIsRefusedWhenItIsRead) {
  const auto good = read(text)[0];
  EXPECT_NO_THROW(summaries({good}));
  const std::pair<const char*, json> changes[] = {{"/values", nullptr},
                                                  {"/values", json::array()},
                                                  {"/values", {{1, 2, 3}}},
                                                  {"/values", {{-1, 2}}},
                                                  {"/values", {{4000, -1}}},
                                                  {"/values", {{4000, 1}, {4000, 1}}},
                                                  {"/values", {{1.5, 1}}},
                                                  {"/values", {{5000, 1}}},
                                                  {"/values", {{4000, std::int64_t{1} << 62}}},
                                                  {"/max_ns", -1},
                                                  {"/max_ns", "x"},
                                                  {"/mean_ns", nullptr},
                                                  {"/beyond", -1},
                                                  {"/beyond", 5},
                                                  {"/beyond_from_ns", -5},
                                                  {"", 7}};
  for (const auto& [path, value] : changes) {
    auto run = good;
    run.outcome["histogram"][json::json_pointer(path)] = value;
    fs::remove(folder_ / "results.ontime");
    EXPECT_THROW(summaries({run}), record::WrongFile) << path << value;
  }
}

}  // namespace
}  // namespace ontime::foreign
