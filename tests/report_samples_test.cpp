// SPDX-License-Identifier: Apache-2.0
#include "json.hpp"
#include "report/report.hpp"
#include "report_fixture.hpp"

namespace ontime::report {
namespace {

using roundtrip::Fate;
using roundtrip::Sample;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

Sample sample(std::uint64_t index, Fate fate) {
  Sample one{};
  one.index = index;
  one.intended_ns = 1'000'000'000 + static_cast<std::int64_t>(index) * 10'000'000;
  one.due_ns = one.intended_ns + 20'000'000;
  one.skipped_cycles = 2;
  one.woke_ns = one.due_ns + 50'001;
  one.sent_ns = one.woke_ns + 5;
  one.fate = fate;
  if (fate == Fate::lost) return one;
  one.received_ns = one.sent_ns + 1'234'567;
  one.server_received_ns = 77;
  one.server_sent_ns = 1'077;
  return one;
}

class Export : public ::testing::Test {
 protected:
  std::string exported(SampleFormat format) {
    std::string text;
    const auto reader = writer_.reader();
    export_samples(reader, reader.runs(), format, [&](std::string_view piece) {
      longest_ = std::max(longest_, piece.size());
      text += piece;
    });
    return text;
  }
  void add(const json& asked, const std::vector<Sample>& samples, const json& outcome = report::outcome()) {
    const auto run = writer_.begin_run(asked);
    writer_.append(run, samples);
    writer_.end_run(run, outcome);
  }
  record::Writer writer_{""};
  std::size_t longest_ = 0;
};

TEST_F(Export, LinesTellOfWhichRunTheyAre) {
  auto first = asked("a", "udp"), second = first;
  first.update({{"variant", "payload 1 KiB, \"x\""}, {"component", "arm"}});
  add(first, {sample(0, Fate::on_time)});
  auto cut = outcome();
  cut["interrupted"] = true;
  add(second, {sample(0, Fate::on_time)}, cut);
  const auto csv = exported(SampleFormat::csv);
  const auto fit = row_by_name(csv, 0), unfit = row_by_name(csv, 1);
  EXPECT_EQ(fit.at("variant"), "payload 1 KiB, \"x\"");
  EXPECT_EQ(fit.at("component"), "arm");
  EXPECT_EQ(fit.at("complete"), "true");
  EXPECT_EQ(fit.at("unfit"), "");
  EXPECT_EQ(unfit.at("variant") + unfit.at("component"), "");
  EXPECT_EQ(unfit.at("complete"), "false");
  EXPECT_THAT(unfit.at("unfit"), HasSubstr("not measured to its end"));
  const auto lines = lines_of(exported(SampleFormat::jsonl));
  EXPECT_EQ(parsed_json(lines.at(0)).at("unfit"), nullptr);
  EXPECT_EQ(parsed_json(lines.at(0)).at("variant"), "payload 1 KiB, \"x\"");
  EXPECT_EQ(parsed_json(lines.at(1)).at("complete"), false);
}

TEST_F(Export, HasEveryTimeOfEveryMessageToTheNanosecond) {
  add(asked("a", "udp"), {sample(0, Fate::on_time), sample(1, Fate::late), sample(2, Fate::lost)});
  const auto csv = exported(SampleFormat::csv);
  const auto late = row_by_name(csv, 1);
  EXPECT_EQ(late.at("run"), "1");
  EXPECT_EQ(late.at("id"), "a");
  EXPECT_EQ(late.at("transport"), "udp");
  EXPECT_EQ(late.at("message"), "1");
  EXPECT_EQ(late.at("fate"), "late");
  EXPECT_EQ(late.at("intended_ns"), "10000000") << "after the run's first message was due";
  EXPECT_EQ(late.at("due_ns"), "30000000");
  EXPECT_EQ(late.at("sent_ns"), "30050006");
  EXPECT_EQ(late.at("wake_up_us"), "50.001");
  EXPECT_EQ(late.at("round_trip_us"), "1234.567");
  EXPECT_EQ(late.at("response_us"), "21284.573");
  EXPECT_EQ(late.at("server_us"), "1.000");
  EXPECT_EQ(late.at("server_received_ns"), "77");
  EXPECT_EQ(late.at("skipped_cycles"), "2");
  const auto lost = row_by_name(csv, 2);
  EXPECT_EQ(lost.at("fate"), "lost");
  for (const auto* column :
       {"received_ns", "round_trip_us", "response_us", "server_us", "server_received_ns"})
    EXPECT_EQ(lost.at(column), "") << column;
}

TEST_F(Export, TimesCountFromTheFirstMessageWithItsSampleOrWithout) {
  add(asked("a", "udp"), {sample(3, Fate::on_time)});
  const auto reader = writer_.reader();
  auto runs = reader.runs();
  runs.at(0).start_ns = 1'000'000'000;
  std::string csv;
  export_samples(reader, runs, SampleFormat::csv, [&](std::string_view piece) { csv += piece; });
  EXPECT_EQ(row_by_name(csv, 0).at("intended_ns"), "30000000");
}

TEST_F(Export, SaysTheSameInBothFormats) {
  auto odd = asked("=cmd|' /C calc'!A0, \"x\"\n\x1b[31m", "udp");
  odd["schedule"] = "back-to-back";
  add(odd, {sample(0, Fate::on_time), sample(1, Fate::lost)});
  const auto csv = exported(SampleFormat::csv);
  const auto lines = lines_of(exported(SampleFormat::jsonl));
  ASSERT_EQ(lines.size(), 2U);
  for (std::size_t i = 0; i < lines.size(); ++i) {
    const auto object = parsed_json(lines[i]);
    EXPECT_EQ(object.at("id"), odd.at("id"));
    EXPECT_EQ(object.at("wake_up_us"), nullptr) << "it wakes for nothing";
    const auto row = row_by_name(csv, i);
    EXPECT_EQ(row.size(), object.size());
    for (const auto& [name, value] : object.items()) {
      if (value.is_number_integer()) {
        EXPECT_EQ(row.at(name), value.dump()) << name;
      }
    }
  }
  EXPECT_THAT(csv, HasSubstr("\"'=cmd")) << "no formula for a spreadsheet";
  EXPECT_EQ(csv.find('\x1b'), csv.npos);
}

TEST_F(Export, ManySamplesAreHandedOverInPieces) {
  std::vector<Sample> samples;
  for (std::uint64_t i = 0; i < 20'000; ++i) samples.push_back(sample(i, Fate::on_time));
  add(asked("a", "udp"), samples);
  add(asked("b", "udp"), {sample(0, Fate::on_time)});
  EXPECT_EQ(lines_of(exported(SampleFormat::csv)).size(), 20'002U);
  EXPECT_LT(longest_, 100'000U);
}

TEST_F(Export, NoSamplesGiveAHeaderAlone) {
  EXPECT_EQ(lines_of(exported(SampleFormat::csv)).size(), 1U);
  EXPECT_EQ(exported(SampleFormat::jsonl), "");
}

}  // namespace
}  // namespace ontime::report
