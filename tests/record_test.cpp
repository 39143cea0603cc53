// SPDX-License-Identifier: Apache-2.0
#include <random>

#include "record/document.hpp"
#include "record_fixture.hpp"

namespace ontime::record {
namespace {

TEST_F(RecordTest, AForgottenRunWasNeverThere) {
  {
    Writer writer(path_);
    writer.forget_run(writer.begin_run({{"id", "no answer"}}));
  }
  EXPECT_FALSE(fs::exists(path_)) << "a file made for it alone";
  {
    Writer writer(path_);
    const auto kept = writer.begin_run({{"id", "kept"}});
    writer.end_run(kept, nlohmann::json::object());
    const auto gone = writer.begin_run({{"id", "no answer"}});
    writer.note(gone, {"note", "nothing", {}, {}});
    writer.end_run(gone, nlohmann::json::object());
    writer.forget_run(gone);
  }
  const Reader reader(path_);
  ASSERT_EQ(reader.runs().size(), 1u);
  EXPECT_EQ(reader.runs()[0].asked.id, "kept");
  EXPECT_EQ(Writer(path_).begin_run({{"id", "the next"}}), 2);
  EXPECT_TRUE(Reader(path_).notes(2).empty());
}

// SQLite takes more steps for so many than a damaged file is allowed between two rows.
TEST_F(RecordTest, ALongRunIsForgottenToo) {
  Writer writer(path_);
  const auto gone = writer.begin_run({{"id", "gone"}});
  writer.append(gone, usual(0, 500'000));
  EXPECT_EQ(error_of([&] { writer.forget_run(gone); }), "");
  EXPECT_THAT(writer.reader().runs(), IsEmpty());
  const auto next = writer.begin_run({{"id", "next"}});
  EXPECT_THAT(samples_of(writer.reader(), next), IsEmpty());
}

TEST_F(RecordTest, EverySampleComesBackAsItWas) {
  std::mt19937_64 random(20240607);
  // Any possible time; 0 means that the time is missing.
  const auto any_time = [&]() -> std::int64_t {
    constexpr std::int64_t most = std::int64_t{1} << 60;
    switch (random() % 4) {
      case 0:
        return 0;
      case 1:
        return static_cast<std::int64_t>(random() % 1'000'000'000'000);
      case 2:
        return random() % 2 != 0 ? most : -most;
      default:
        return static_cast<std::int64_t>(random() % most);
    }
  };
  const auto any_sample = [&](std::uint64_t index) {
    Sample sample{.index = index,
                  .intended_ns = any_time(),
                  .due_ns = any_time(),
                  .woke_ns = any_time(),
                  .passed_wake_ns = std::abs(any_time()),
                  .sent_ns = any_time(),
                  .received_ns = any_time(),
                  .server_received_ns = any_time(),
                  .server_sent_ns = any_time(),
                  .skipped_cycles = static_cast<std::uint32_t>(random()),
                  .fate = static_cast<Fate>(random() % 2)};
    if (sample.received_ns < sample.sent_ns) sample.received_ns = 0;  // no answer comes before
    if (sample.received_ns == 0) sample.fate = Fate::lost;
    return sample;
  };
  std::vector<std::vector<Sample>> expected(3);
  {
    Writer writer(path_);
    std::vector<std::int64_t> runs(expected.size());
    for (auto& run : runs) run = writer.begin_run({{"id", "several at once"}});
    ASSERT_THAT(runs, ElementsAre(1, 2, 3));
    for (int batch = 0; batch < 200; ++batch) {
      const std::size_t which = random() % runs.size();
      std::vector<Sample> samples;
      for (std::size_t i = random() % 20; i > 0; --i)
        samples.push_back(any_sample(expected[which].size() + samples.size()));
      writer.append(runs[which], samples);
      expected[which].insert(expected[which].end(), samples.begin(), samples.end());
      if (random() % 10 == 0) writer.flush();
    }
  }
  const Reader reader(path_);
  for (std::size_t i = 0; i < 3; ++i)
    expect_same(samples_of(reader, static_cast<std::int64_t>(i) + 1), expected[i]);
}

TEST_F(RecordTest, CopiedRunIsTheSameUnderTheNextNumber) {
  const Trace trace{"controller", {{7, 1, 2}, {}, {}}};
  const auto other = (folder_ / "other.db").string();
  {
    Writer from(path_);
    from.begin_run({{"id", "one"}});
    const auto two = from.begin_run({{"id", "two"}, {"transport", "udp"}});
    from.append(two, usual(0, 5000));
    from.note(two, {"peer-left", "it left", 5, 3});
    from.note(two, {"gate-missed", "late", {}, {}});
    from.trace(two, trace);
    from.end_run(two, {{"sent", 5000}});
    Writer to(other);
    to.begin_run({{"id", "first"}});
    const auto reader = from.reader();
    const auto runs = reader.runs();
    EXPECT_EQ(copy_run(reader, runs[1], to), 2);
    EXPECT_EQ(copy_run(reader, runs[0], to), 3);
  }
  const Reader from(path_), to(other);
  const auto original = from.runs(2).front();
  const auto copies = to.runs();
  ASSERT_EQ(copies.size(), 3U);
  EXPECT_EQ(copies[1].asked.document, original.asked.document);
  EXPECT_EQ(copies[1].outcome.document, original.outcome.document);
  EXPECT_EQ(copies[1].key, original.key);
  expect_same(samples_of(to, 2), samples_of(from, 2));
  ASSERT_EQ(to.notes(2).size(), 2U);
  EXPECT_EQ(to.notes(2)[0].message, 3U);
  EXPECT_EQ(to.notes(2)[1].kind, "gate-missed");
  int traces = 0;
  to.each_trace(2, [&](const Trace& copy) {
    ++traces;
    EXPECT_EQ(trace::to_json(copy.window), trace::to_json(trace.window));
  });
  EXPECT_EQ(traces, 1);
  EXPECT_EQ(query(other, "SELECT start_ns FROM run WHERE number = 2"),
            query(path_, "SELECT start_ns FROM run WHERE number = 2"));
  EXPECT_TRUE(copies[2].outcome.document.is_null()) << "it was cut off";
}

TEST_F(RecordTest, SampleThatIsThereAlreadyIsReplaced) {
  auto given_up = usual(0, 4);
  for (auto& sample : given_up) {
    sample.fate = Fate::lost;
    sample.received_ns = sample.server_received_ns = sample.server_sent_ns = 0;
  }
  auto expected = usual(0, 5);
  expected[3] = given_up[3];
  {
    Writer writer(path_);
    const auto run = writer.begin_run({});
    writer.append(run, std::vector{given_up[0], given_up[1], usual(1)});  // within what is committed at once
    writer.flush();
    writer.append(run, std::vector{given_up[2]});
    writer.append(run, std::vector{usual(2), given_up[3], usual(4), usual(0)});  // and long after
  }
  expect_same(samples_of(Reader(path_), 1), expected);
}

TEST_F(RecordTest, SamplesThatCannotBeAreRefused) {
  constexpr std::int64_t too_much = (std::int64_t{1} << 60) + 1;
  Writer writer(path_);
  const auto run = writer.begin_run({});
  writer.append(run, usual(0, 10));
  const auto refusal = [&](auto change) {
    auto samples = usual(10, 2);
    change(samples[1]);
    return error_of([&] { writer.append(run, samples); });
  };
  const auto cannot_be = AllOf(HasSubstr(path_), HasSubstr("message"), HasSubstr("impossible"));
  EXPECT_THAT(refusal([](Sample& s) { s.fate = Fate::lost; }), cannot_be) << "lost, with an answer";
  EXPECT_THAT(refusal([](Sample& s) { s.received_ns = 0; }), cannot_be) << "on time, without";
  EXPECT_THAT(refusal([](Sample& s) { s.fate = static_cast<Fate>(7); }), cannot_be) << "no Reader takes that";
  EXPECT_THAT(refusal([](Sample& s) { s.received_ns = s.sent_ns - 1; }), cannot_be) << "before it was sent";
  EXPECT_THAT(refusal([](Sample& s) { s.passed_wake_ns = -1; }), cannot_be);
  EXPECT_THAT(refusal([](Sample& s) { s.server_sent_ns = too_much; }), cannot_be);
  EXPECT_THAT(refusal([](Sample& s) { s.sent_ns = -too_much; }), cannot_be);
  EXPECT_THAT(refusal([](Sample& s) { s.index = std::uint64_t{1} << 63; }), cannot_be);
  writer.flush();
  expect_same(samples_of(Reader(path_), run), usual(0, 10));
}

TEST_F(RecordTest, RunsKeepWhatWasAskedAndWhatCameOfIt) {
  const nlohmann::json asked = {{"id", "Test1.A"}, {"scenario", "a \"text\"\nwith µ"}, {"period_us", 10000}};
  {
    Writer writer(path_);
    writer.end_run(writer.begin_run(asked), {{"duplicates", 2}});
    writer.begin_run({{"id", "cut off"}});
  }
  Writer(path_).begin_run({{"id", "later"}});
  const auto runs = Reader(path_).runs();
  ASSERT_EQ(runs.size(), 3u);
  EXPECT_EQ(runs[0].number, 1);
  EXPECT_EQ(runs[0].asked.document, asked);
  EXPECT_EQ(runs[0].outcome.document, nlohmann::json({{"duplicates", 2}}));
  EXPECT_FALSE(runs[1].outcome.has_ended());
  EXPECT_EQ(runs[2].number, 3);
  EXPECT_EQ(runs[2].asked.id, "later");
}

// What `ontime run` asks for, in short.
const nlohmann::json conditions = {{"id", "Test1.A"},
                                   {"transport", "udp"},
                                   {"period_us", 10000.0},
                                   {"qos", {{"depth", 1}, {"reliability", "best-effort"}}},
                                   {"hosts", "loopback"}};

class KeyTest : public RecordTest {
 protected:
  static nlohmann::json with(const nlohmann::json& patch) {
    auto asked = conditions;
    asked.merge_patch(patch);
    return asked;
  }
  static std::string key_of(const nlohmann::json& asked) {
    Writer writer("");
    writer.begin_run(asked);
    return writer.reader().runs().at(0).key;
  }
};

TEST_F(KeyTest, StaysWhatItIs) {
  // Files that are compared with one another are years apart: where this changes, no two are alike any more.
  EXPECT_EQ(key_of(conditions), "7de123f15e99142f3720a6bcb9e46a4d");
}

TEST_F(KeyTest, IsOfTheConditionsAndNothingElse) {
  const auto key = key_of(conditions);
  EXPECT_EQ(key_of(with({{"repetition", 7},
                         {"title", "in words"},
                         {"variant", "payload 500"},
                         {"adds_to", "udp"},
                         {"scenario", "runs: []"},
                         {"scenario_file", "/somewhere/paper.yaml"},
                         {"command_line", {"ontime", "run"}},
                         {"ontime", "9.9.9"}})),
            key);
  for (const nlohmann::json& patch :
       {nlohmann::json{{"id", "Test1.B"}}, nlohmann::json{{"transport", "fastdds"}},
        nlohmann::json{{"period_us", 10000.5}}, nlohmann::json{{"qos", {{"depth", 2}}}},
        nlohmann::json{{"hosts", "namespaces"}}, nlohmann::json{{"ping_topic", "/robot/ping"}},
        nlohmann::json{{"something", false}}, nlohmann::json{{"something", 0}}})
    EXPECT_NE(key_of(with(patch)), key) << patch;
}

TEST_F(KeyTest, MeaningTheSameIsTheSame) {
  const auto key = key_of(conditions);
  EXPECT_EQ(key_of(with({{"period_us", 10000}, {"qos", {{"depth", 1.0}}}})), key) << "10000 and 10000.0";
  EXPECT_EQ(key_of(with(
                {{"something", ""}, {"more", {{"nested", nlohmann::json::array()}}}, {"qos", {{"x", {}}}}})),
            key)
      << "empty and missing fields give the same key";
  EXPECT_EQ(key_of(with({{"ping_topic", "/ping"}, {"pong_topic", "/pong"}})), key)
      << "what it was before it could be chosen";
  EXPECT_EQ(
      key_of(nlohmann::ordered_json::parse(R"({"hosts": "loopback", "period_us": 1e4, "transport": "udp",
      "qos": {"reliability": "best-effort", "depth": 1}, "id": "Test1.A"})")),
      key)
      << "in another order";
  EXPECT_NE(key_of({{"list", {"", "a"}}}), key_of({{"list", {"a", ""}}})) << "the places of a list count";
}

TEST_F(KeyTest, IsInEveryRun) {
  Writer(path_).begin_run(conditions);
  EXPECT_EQ(query(path_, "SELECT key FROM run"), key_of(conditions));
  EXPECT_EQ(Reader(path_).runs().at(0).key, key_of(conditions));
  EXPECT_NE(key_of({}), key_of(7));
}

void expect_same_notes(const std::vector<Note>& found, const std::vector<Note>& expected) {
  const auto all = [](const std::vector<Note>& notes) {
    std::vector<
        std::tuple<std::string, std::string, std::optional<std::int64_t>, std::optional<std::uint64_t>>>
        tuples;
    tuples.reserve(notes.size());
    for (const auto& n : notes) tuples.emplace_back(n.kind, n.text, n.at_ns, n.message);
    return tuples;
  };
  EXPECT_EQ(all(found), all(expected));
}

TEST_F(RecordTest, NotesComeBackInTheirOrder) {
  const std::vector<Note> first = {{"peer-left", "the pong has left", 864'000'000'000'007, {}},
                                   {"second-pong", "", -5, 3},
                                   {"a", std::string("\x1b[31m and \0 as they are", 22), {}, {}}};
  const std::vector<Note> second = {{"cause", "a page fault", {}, 9}};
  {
    Writer writer(path_);
    const auto one = writer.begin_run({}), two = writer.begin_run({});
    writer.note(one, first[0]);
    writer.append(one, usual(0, 5));
    writer.note(two, second[0]);
    writer.note(one, first[1]);
    writer.end_run(one, {});
    writer.note(one, first[2]);  // known only afterwards
    EXPECT_THAT(error_of([&] { writer.note(9, first[0]); }), AllOf(HasSubstr(path_), HasSubstr("no run 9")));
    EXPECT_THAT(error_of([&] {
                  writer.note(one, {"", "", {}, std::uint64_t{1} << 63});
                }),
                HasSubstr("impossible"));
    EXPECT_THAT(error_of([&] {
                  writer.note(one, {"", "", std::int64_t{1} << 62, {}});
                }),
                HasSubstr("impossible"));
  }
  const Reader reader(path_);
  expect_same_notes(reader.notes(1), first);
  expect_same_notes(reader.notes(2), second);
  EXPECT_THAT(error_of([&] { reader.notes(3); }), HasSubstr("no run 3"));
  EXPECT_EQ(query(path_, "SELECT group_concat(number || kind) FROM note WHERE run = 1"),
            "1peer-left,2second-pong,3a");
}

TEST_F(RecordTest, TextThatIsNoUtf8IsRecordedAllTheSame) {
  Writer(path_).begin_run({{"command_line", "caf\xe9"}});
  {
    Writer writer(path_);
    writer.note(1, {"k\xff", "caf\xe9", {}, {}});
  }
  const Reader reader(path_);
  EXPECT_EQ(reader.runs().at(0).asked.document.at("command_line"), "caf\xef\xbf\xbd");
  expect_same_notes(reader.notes(1), {{"k\xef\xbf\xbd", "caf\xef\xbf\xbd", {}, {}}});
}

TEST_F(RecordTest, UnreadableRecordIsNotWritten) {
  nlohmann::json deep = 1;
  for (int i = 0; i < 100; ++i) deep = nlohmann::json::array({std::move(deep)});
  const nlohmann::json large = std::string(9 << 20, 'x');
  Writer writer(path_);
  const auto run = writer.begin_run({{"id", "sound"}});
  for (const nlohmann::json* json : {&std::as_const(deep), &large}) {
    EXPECT_THAT(error_of([&] { writer.begin_run(*json); }), HasSubstr("too long"));
    EXPECT_THAT(error_of([&] { writer.end_run(run, *json); }), HasSubstr("too long"));
  }
  writer.end_run(run, {{"sent", 0}});
  EXPECT_EQ(writer.reader().runs().size(), 1u);
}

TEST(DocumentTest, BracketsAreCountedOutsideOfStringsOnly) {
  const auto nested = [](int depth) { return std::string(depth, '[') + "1" + std::string(depth, ']'); };
  EXPECT_TRUE(json_of(nested(64)));
  EXPECT_FALSE(json_of(nested(65)));
  EXPECT_TRUE(json_of("[\"" + std::string(100, '[') + "\\\"" + std::string(100, '{') + "\"]"));
  EXPECT_TRUE(json_of(R"({"a": "\\", "b": [1]})"));
  EXPECT_FALSE(json_of("\"" + std::string(100, '[')));
  EXPECT_FALSE(json_of("]"));
}

TEST_F(RecordTest, LeavesOneFileAndNothingBesideIt) {
  {
    Writer writer(path_);
    writer.append(writer.begin_run({}), usual(0, 100));
  }
  EXPECT_THAT(files(), ElementsAre("results.db"));
  EXPECT_EQ(query(path_, "PRAGMA journal_mode"), "delete");
}

TEST_F(RecordTest, LeavesOneFileBesideAReaderThatEndsSoon) {
  auto writer = std::make_unique<Writer>(path_);
  const auto run = writer->begin_run({});
  writer->append(run, usual(0, 10));
  writer->flush();
  auto reader = std::make_unique<Reader>(path_);
  ASSERT_EQ(samples_of(*reader, run).size(), 10u);
  std::thread leaves([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    reader.reset();
  });
  writer.reset();
  leaves.join();
  EXPECT_THAT(files(), ElementsAre("results.db"));
}

TEST_F(RecordTest, AFileMadeForRunsIsNotLeftWithoutOne) {
  {
    Writer writer(path_);
    EXPECT_TRUE(writer.reader().runs().empty());
  }
  EXPECT_THAT(files(), IsEmpty());
  Writer(path_).begin_run({});
  const auto before = query(path_, "SELECT count(*) FROM run");
  { const Writer writer(path_); }
  EXPECT_EQ(query(path_, "SELECT count(*) FROM run"), before) << "it was there before";
}

TEST_F(RecordTest, IsReadableWithSqlite) {
  {
    Writer writer(path_);
    auto samples = usual(0, 2);
    samples[1].fate = Fate::lost;
    samples[1].received_ns = samples[1].server_received_ns = samples[1].server_sent_ns = 0;
    samples[1].passed_wake_ns = 7'000;
    writer.append(writer.begin_run({{"id", "Test1.A"}, {"transport", "udp"}, {"repetition", 2}}), samples);
  }
  const auto column = [&](const char* name, int message) {
    return query(path_,
                 std::string("SELECT ") + name + " FROM message WHERE message = " + std::to_string(message));
  };
  EXPECT_EQ(column("id || transport || repetition", 0), "Test1.Audp2");
  EXPECT_EQ(column("fate", 0), "on time");
  EXPECT_EQ(column("intended_s", 0), "0.0");
  EXPECT_EQ(column("intended_s", 1), "0.01");
  EXPECT_EQ(column("wake_up_us", 0), "61.234");
  EXPECT_EQ(column("round_trip_us", 0), "987.654");
  EXPECT_EQ(column("response_us", 0), "1058.764");
  EXPECT_EQ(column("server_us", 0), "41.234");
  EXPECT_EQ(column("passed_wake_us", 0), "0.0");
  EXPECT_EQ(column("passed_wake_us", 1), "7.0");
  EXPECT_EQ(column("fate", 1), "lost");
  EXPECT_EQ(column("round_trip_us", 1), "NULL");
  EXPECT_EQ(column("response_us", 1), "NULL");
}

TEST_F(RecordTest, TwelveHoursAtAHundredHertzTakeLessThan300MB) {
  constexpr std::uint64_t hundredth = 43'200;
  {
    Writer writer(path_);
    const auto run = writer.begin_run({});
    for (std::uint64_t first = 0; first < hundredth; first += 50) writer.append(run, usual(first, 50));
  }
  EXPECT_LT(fs::file_size(path_), 3'000'000u);
}

// The files that this process has open although they are gone, of those that were in a folder.
std::vector<std::string> unlinked_files_of(const fs::path& folder) {
  std::vector<std::string> targets;
  for (const auto& entry : fs::directory_iterator("/proc/self/fd")) {
    std::error_code gone;  // as the iterator's own is
    const auto target = fs::read_symlink(entry.path(), gone).string();
    if (target.starts_with(folder.string()) && target.ends_with(" (deleted)")) targets.push_back(target);
  }
  return targets;
}

TEST_F(RecordTest, TemporaryFileGoesWithItsWriter) {
  sqlite3_temp_directory = sqlite3_mprintf("%s", folder_.c_str());
  {
    Writer writer("");
    const auto run = writer.begin_run({{"id", "by hand"}});
    const auto samples = usual(0, 100'000);
    writer.append(run, samples);
    writer.flush();
    const Reader reader = writer.reader();
    EXPECT_EQ(reader.runs().at(0).asked.id, "by hand");
    expect_same(samples_of(reader, run), samples);
    EXPECT_THAT(unlinked_files_of(folder_), Not(IsEmpty())) << "so that memory does not grow";
    EXPECT_THAT(files(), IsEmpty()) << "a kill -9 now would leave it behind";
  }
  EXPECT_THAT(unlinked_files_of(folder_), IsEmpty());
  EXPECT_THAT(files(), IsEmpty());
  sqlite3_free(sqlite3_temp_directory);
  sqlite3_temp_directory = nullptr;
}

TEST_F(RecordTest, ReadsWhileAWriterIsActive) {
  Writer writer(path_);
  const auto run = writer.begin_run({});
  writer.append(run, usual(0, 10));
  writer.flush();
  const Reader reader(path_);
  EXPECT_EQ(samples_of(reader, run).size(), 10u);
  writer.append(run, usual(10, 10));
  writer.flush();
  EXPECT_EQ(samples_of(reader, run).size(), 20u);
  EXPECT_EQ(samples_of(writer.reader(), run).size(), 20u);
}

TEST_F(RecordTest, WriterThatEndsDuringAReadLosesNothing) {
  auto writer = std::make_unique<Writer>(path_);
  const auto run = writer->begin_run({});
  writer->append(run, usual(0, 10));
  writer->flush();
  auto reader = std::make_unique<Reader>(path_);
  ASSERT_EQ(samples_of(*reader, run).size(), 10u);
  writer->append(run, usual(10, 10));
  writer.reset();
  EXPECT_EQ(samples_of(*reader, run).size(), 20u);
  reader.reset();
  Writer again(path_);
  EXPECT_EQ(samples_of(again.reader(), run).size(), 20u);
}

TEST_F(RecordTest, RunsThatAreNotThere) {
  Writer writer(path_);
  const auto run = writer.begin_run({});
  writer.end_run(run, {});
  EXPECT_THAT(error_of([&] { writer.append(run, usual(0, 1)); }), HasSubstr("run 1 is not open"));
  EXPECT_THAT(error_of([&] { writer.end_run(9, {}); }), HasSubstr("run 9 is not open"));
  EXPECT_THAT(error_of([&] { samples_of(writer.reader(), 9); }), HasSubstr("no run 9"));
}

TEST_F(RecordTest, NoPathMeansAnythingSpecial) {
  const auto here = fs::current_path();
  fs::current_path(folder_);
  for (const std::string name : {":memory:", "file:x?mode=memory", "50%20 of #1"}) Writer(name).begin_run({});
  fs::current_path(here);
  EXPECT_THAT(files(), ElementsAre("50%20 of #1", ":memory:", "file:x?mode=memory"));
}

}  // namespace
}  // namespace ontime::record
