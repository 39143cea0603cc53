// SPDX-License-Identifier: Apache-2.0
// Results files of earlier formats.
#include "record_fixture.hpp"

namespace ontime::record {
namespace {

// Results files of format 1, as ontime 0.1.0 left them: of four runs, and of one that was killed in its
// first, whose samples are in the log beside it.
class Format1 : public RecordTest {
 protected:
  Format1() {
    const fs::path data = ONTIME_TEST_DATA;
    fs::copy_file(data / "format1.db", path_);
    fs::copy_file(data / "format1-killed.db", killed_);
    fs::copy_file(data / "format1-killed.db-wal", killed_ + "-wal");
  }

  static void expect_as_measured(const Reader& reader) {
    const auto runs = reader.runs();
    ASSERT_GE(runs.size(), 4u);
    EXPECT_EQ(runs[0].asked.id, "udp");
    EXPECT_EQ(runs[2].asked.repetition, 2);
    EXPECT_EQ(runs[3].outcome.counters.on_time, 30u);
    EXPECT_EQ(runs[0].key, "cef90dcf372a29afca060c3075a906b0");
    EXPECT_EQ(runs[2].key, runs[0].key) << "the second time of the same";
    EXPECT_NE(runs[1].key, runs[0].key);
    const std::int64_t round_trips[] = {2966988, 6249405, 2263719, 5914411};  // as the old program has them
    const std::int64_t starts[] = {1921302657670, 1921752224486, 1922196874386, 1922646857613};
    for (std::size_t i = 0; i < 4; ++i) {
      const auto samples = samples_of(reader, runs[i].number);
      ASSERT_EQ(samples.size(), 30u);
      EXPECT_EQ(samples[0].intended_ns, starts[i]);
      std::int64_t round_trip = 0;
      for (const auto& sample : samples) {
        round_trip += sample.received_ns - sample.sent_ns;
        EXPECT_EQ(sample.passed_wake_ns, 0);
        EXPECT_EQ(sample.fate, Fate::on_time);
      }
      EXPECT_EQ(round_trip, round_trips[i]);
      EXPECT_THAT(reader.notes(runs[i].number), IsEmpty());
    }
  }

  const std::string killed_ = (folder_ / "killed.db").string();
};

TEST_F(Format1, IsReadAndLeftAsItIs) {
  const auto before = bytes_of(path_), killed_before = bytes_of(killed_);
  expect_as_measured(Reader(path_));
  {
    const Reader reader(killed_);
    EXPECT_FALSE(reader.runs().at(0).outcome.has_ended());
    EXPECT_EQ(samples_of(reader, 1).size(), 110u);
  }
  EXPECT_TRUE(bytes_of(path_) == before);
  EXPECT_TRUE(bytes_of(killed_) == killed_before);
  EXPECT_EQ(query(path_, "PRAGMA user_version"), "1");
}

TEST_F(Format1, TakesNewRuns) {
  auto late = usual(0);
  late.skipped_cycles = 3;
  late.passed_wake_ns = 4'711;
  {
    Writer writer(path_);
    expect_as_measured(writer.reader());
    const auto run = writer.begin_run({{"id", "new"}});
    EXPECT_EQ(run, 5);
    writer.append(run, std::vector{late});
    writer.note(run, {"kind", "text", {}, 0});
    writer.note(1, {"kind", "of an old run", {}, {}});
  }
  {
    const Reader reader(path_);
    expect_same(samples_of(reader, 5), {late});
    EXPECT_EQ(reader.notes(5).size(), 1u);
    EXPECT_EQ(reader.notes(1).at(0).text, "of an old run");
  }
  EXPECT_EQ(query(path_, "PRAGMA user_version"), "4");
  EXPECT_EQ(query(path_, "SELECT key FROM run WHERE number = 3"), "cef90dcf372a29afca060c3075a906b0");
  EXPECT_EQ(query(path_, "SELECT passed_wake_us FROM message WHERE run = 5"), "4.711");
  EXPECT_EQ(query(path_, "PRAGMA integrity_check"), "ok");
  Writer(killed_).begin_run({});
  EXPECT_EQ(samples_of(Reader(killed_), 1).size(), 110u);
  EXPECT_EQ(query(killed_, "PRAGMA user_version"), "4");
}

TEST_F(Format1, BecomesLikeAFileMadeNow) {
  const auto made_now = (folder_ / "now.db").string();
  {
    const Writer one(path_);
    Writer(made_now).begin_run({});  // of a file without a run nothing is left
  }
  for (const auto* table : {"run", "sample", "note", "message", "trace"}) {
    const auto columns =
        std::string(
            "SELECT group_concat(concat, '; ') FROM (SELECT cid || ' ' || name || ' ' || type || ' ' || "
            "\"notnull\" || ' ' || ifnull(dflt_value, 'none') || ' ' || pk || ' ' || hidden AS concat FROM "
            "pragma_table_xinfo('") +
        table + "'))";
    EXPECT_EQ(query(path_, columns), query(made_now, columns));
    EXPECT_NE(query(path_, columns), "NULL") << table;
  }
}

TEST_F(Format1, FailedMigrationLeavesTheFileUnchanged) {
  query(path_, "UPDATE run SET outcome = '{' WHERE number = 4");
  const auto before = bytes_of(path_);
  EXPECT_THAT(error_of([&] { Writer writer(path_); }),
              AllOf(HasSubstr(path_), HasSubstr("run 4"), HasSubstr("JSON")));
  EXPECT_EQ(query(path_, "PRAGMA user_version"), "1");
  EXPECT_EQ(samples_of(Reader(path_), 4).size(), 30u);
}

// A results file of format 2, of two runs over udp: what is in it, and that it takes traces once it is
// written to.
TEST_F(RecordTest, Format2IsReadAndTakesTraces) {
  fs::copy_file(fs::path(ONTIME_TEST_DATA) / "format2.db", path_);
  const auto expect_as_measured = [](const Reader& reader) {
    const auto runs = reader.runs();
    ASSERT_GE(runs.size(), 2u);
    EXPECT_EQ(runs[1].key, "8ed9985b0a70aa62b5508ebac789eefa");
    std::int64_t round_trip = 0;
    for (const auto& sample : samples_of(reader, 2)) round_trip += sample.received_ns - sample.sent_ns;
    EXPECT_EQ(round_trip, 1'444'661);
    reader.each_trace(2, [](const auto&) { FAIL() << "unexpected trace"; });
  };
  expect_as_measured(Reader(path_));
  EXPECT_EQ(query(path_, "PRAGMA user_version"), "2");
  const Trace trace{
      "controller",
      {{3, 1'000, 2'000}, true, {{.at_ns = 1'500, .kind = trace::Kind::timer, .thread = {1, "a", 120}}}}};
  {
    Writer writer(path_);
    expect_as_measured(writer.reader());
    writer.trace(2, trace);
  }
  EXPECT_EQ(query(path_, "PRAGMA user_version"), "4");
  std::size_t traces = 0;
  Reader(path_).each_trace(2, [&](const Trace& read) {
    ++traces;
    EXPECT_EQ(read.host, "controller");
    EXPECT_EQ(read.window.span.message, 3u);
    EXPECT_EQ(read.window.events, trace.window.events);
  });
  EXPECT_EQ(traces, 1u);
  const auto error_with = [&](const char* change) {
    query(path_, change);
    return error_of([&] { Reader(path_).each_trace(2, [](const auto&) {}); });
  };
  EXPECT_THAT(error_with("UPDATE trace SET message = 4"), HasSubstr("another message"));
  EXPECT_THAT(error_with("UPDATE trace SET events = '[]'"), HasSubstr("trace of message 4"));
  EXPECT_THAT(error_with("UPDATE trace SET events = '{'"), HasSubstr("JSON"));
}

// A results file of format 3, of a bag: it takes causes once it is written to.
TEST_F(RecordTest, Format3IsReadAndTakesCauses) {
  fs::copy_file(fs::path(ONTIME_TEST_DATA) / "format3.db", path_);
  const auto expect_as_noted = [](const Reader& reader) {
    const auto notes = reader.notes(1);
    ASSERT_GE(notes.size(), 1u);
    EXPECT_EQ(notes[0].text, "open: --age: the age of 1 of 5 messages of /scan is unknown");
    EXPECT_FALSE(notes[0].cause);
    EXPECT_EQ(samples_of(reader, 2).size(), 4u);
  };
  expect_as_noted(Reader(path_));
  EXPECT_EQ(query(path_, "PRAGMA user_version"), "3");
  {
    Writer writer(path_);
    expect_as_noted(writer.reader());
    writer.note(
        1, {cause_of_late, "6.0 ms old", 5, 3, LateCause{.value_ns = 6, .sentence = "a; fix: b", .cpu = 1}});
  }
  EXPECT_EQ(query(path_, "PRAGMA user_version"), "4");
  expect_as_noted(Reader(path_));
  const auto cause = Reader(path_).notes(1).at(1).cause;
  ASSERT_TRUE(cause);
  EXPECT_EQ(cause->sentence, "a; fix: b");
  EXPECT_EQ(cause->cpu, 1);
  EXPECT_EQ(query(path_, "SELECT count(*) FROM note WHERE cause IS NULL"), "1");
  const std::string whole = R"({"value_ns": 6, "sentence": "a", "limit_ns": 5, "ns": 4, "cpu": 1})";
  const auto is_taken = [&](const std::string& text) {
    query(path_, fmt::format("UPDATE note SET cause = '{}' WHERE number = 2", text).c_str());
    const auto note = Reader(path_).notes(1).at(1);
    EXPECT_EQ(note.text, "6.0 ms old");
    return note.cause.has_value();
  };
  EXPECT_TRUE(is_taken(whole));
  for (const auto* odd : {"[]", "[1]", "5", "\"x\"", "{}", "{\"value_ns\": 6}", "{\"sentence\": \"a\"}"})
    EXPECT_FALSE(is_taken(odd)) << odd;
  for (const auto* name : {"value_ns\": 6", "limit_ns\": 5", "ns\": 4", "cpu\": 1"})
    for (const auto* value : {"-1", "1152921504606846977", "18446744073709551615", "-9223372036854775808"}) {
      auto odd = whole;
      const std::string member = std::string("\"") + name;
      odd.replace(odd.find(member) + member.size() - 1, 1, value);
      EXPECT_FALSE(is_taken(odd)) << odd;
    }
  query(path_, "UPDATE note SET cause = '{' WHERE number = 2");
  EXPECT_THAT(error_of([&] { Reader(path_).notes(1); }), HasSubstr("JSON"));
}

}  // namespace
}  // namespace ontime::record
