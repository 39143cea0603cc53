// SPDX-License-Identifier: Apache-2.0
#include "record/record.hpp"

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <limits>
#include <memory>
#include <random>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sqlite3.h>
#include <sys/mount.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

namespace ontime::record {
namespace {

using roundtrip::Fate;
using roundtrip::Sample;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
namespace fs = std::filesystem;

class RecordTest : public ::testing::Test {
 protected:
  RecordTest() {
    // In memory where there is such a place: no test shall wait for a disk that others keep busy.
    const fs::path memory = "/dev/shm";
    const auto place = ::access(memory.c_str(), W_OK) == 0 ? memory : fs::temp_directory_path();
    std::string name = (place / "ontime-record-test-XXXXXX").string();
    folder_ = ::mkdtemp(name.data());
    fs::permissions(folder_, fs::perms::owner_all | fs::perms::group_exec | fs::perms::others_exec |
                                 fs::perms::group_read | fs::perms::others_read);
    path_ = (folder_ / "results.db").string();
  }
  ~RecordTest() override {
    if (mounted_) ::umount2(folder_.c_str(), MNT_DETACH);
    fs::remove_all(folder_);
  }

  // A small disk of our own. False where we may not.
  bool mount_disk(const char* options) {
    mounted_ = ::mount("ontime-test", folder_.c_str(), "tmpfs", 0, options) == 0;
    return mounted_;
  }
  bool make_disk_read_only() const {
    return ::mount("ontime-test", folder_.c_str(), "tmpfs", MS_REMOUNT | MS_RDONLY, nullptr) == 0;
  }

  std::vector<std::string> files() const {
    std::vector<std::string> names;
    for (const auto& entry : fs::directory_iterator(folder_))
      names.push_back(entry.path().filename().string());
    std::sort(names.begin(), names.end());
    return names;
  }

  fs::path folder_;
  std::string path_;

 private:
  bool mounted_ = false;
};

std::string bytes_of(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

void write_bytes(const std::string& path, const std::string& bytes) {
  std::ofstream(path, std::ios::binary) << bytes;
}

// What an outsider with sqlite3 gets: the first column of the first row.
std::string query(const std::string& path, const std::string& sql) {
  sqlite3* raw = nullptr;
  sqlite3_open(path.c_str(), &raw);
  const std::unique_ptr<sqlite3, decltype(&sqlite3_close)> database(raw, sqlite3_close);
  std::string answer;
  const auto keep = [](void* to, int, char** values, char**) {
    *static_cast<std::string*>(to) = values[0] != nullptr ? values[0] : "NULL";
    return 0;
  };
  char* message = nullptr;
  if (sqlite3_exec(raw, sql.c_str(), keep, &answer, &message) != SQLITE_OK) answer = message;
  sqlite3_free(message);
  return answer;
}

// As of a run at 100 Hz on a machine that has been up for ten days.
Sample usual(std::uint64_t index) {
  Sample sample{};
  sample.index = index;
  sample.intended_ns = 864'000'000'000'000 + static_cast<std::int64_t>(index) * 10'000'000;
  sample.due_ns = sample.intended_ns;
  sample.woke_ns = sample.due_ns + 61'234;
  sample.sent_ns = sample.woke_ns + 9'876;
  sample.received_ns = sample.sent_ns + 987'654;
  sample.server_received_ns = 500'000'000'000'000 + sample.sent_ns;
  sample.server_sent_ns = sample.server_received_ns + 41'234;
  sample.fate = Fate::on_time;
  return sample;
}

std::vector<Sample> usual(std::uint64_t first, std::uint64_t count) {
  std::vector<Sample> samples;
  for (std::uint64_t index = first; index < first + count; ++index) samples.push_back(usual(index));
  return samples;
}

std::vector<Sample> samples_of(const Reader& reader, std::int64_t run) {
  std::vector<Sample> samples;
  reader.each_sample(run, [&](const Sample& sample) { samples.push_back(sample); });
  return samples;
}

auto fields(const Sample& s) {
  return std::tuple(s.index, s.intended_ns, s.due_ns, s.woke_ns, s.sent_ns, s.received_ns,
                    s.server_received_ns, s.server_sent_ns, s.skipped_cycles, s.fate);
}

void expect_same(const std::vector<Sample>& found, const std::vector<Sample>& expected) {
  ASSERT_EQ(found.size(), expected.size());
  for (std::size_t i = 0; i < found.size(); ++i)
    ASSERT_EQ(fields(found[i]), fields(expected[i])) << "sample " << i;
}

template <class Action>
std::string error_of(Action action) {
  try {
    action();
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

// Runs `work` in a child, and kills it with SIGKILL once it has said by a byte that it is far enough.
template <class Work>
void kill_9(Work work) {
  int pipe_ends[2];
  ASSERT_EQ(::pipe(pipe_ends), 0);
  const pid_t child = ::fork();
  if (child == 0) {
    try {
      work([&] {
        [[maybe_unused]] const auto written = ::write(pipe_ends[1], "x", 1);
        ::pause();
      });
    } catch (const std::exception& error) {
      std::fputs(error.what(), stderr);
    }
    ::_exit(1);
  }
  ::close(pipe_ends[1]);
  char byte = 0;
  const auto got = ::read(pipe_ends[0], &byte, 1);
  ::close(pipe_ends[0]);
  ::kill(child, SIGKILL);
  ::waitpid(child, nullptr, 0);
  ASSERT_EQ(got, 1) << "the child failed";
}

TEST_F(RecordTest, EverySampleComesBackAsItWas) {
  std::mt19937_64 random(20240607);
  const auto any_time = [&]() -> std::int64_t {
    switch (random() % 4) {
      case 0:
        return 0;
      case 1:
        return static_cast<std::int64_t>(random() % 1'000'000'000'000);
      case 2:
        return random() % 2 != 0 ? std::numeric_limits<std::int64_t>::max()
                                 : std::numeric_limits<std::int64_t>::min();
      default:
        return static_cast<std::int64_t>(random());
    }
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
      for (std::size_t i = random() % 20; i > 0; --i) {
        samples.push_back({expected[which].size() + samples.size(), any_time(), any_time(), any_time(),
                           any_time(), any_time(), any_time(), any_time(), any_time(),
                           static_cast<std::uint32_t>(random()), static_cast<Fate>(random() % 3)});
      }
      writer.append(runs[which], samples);
      expected[which].insert(expected[which].end(), samples.begin(), samples.end());
      if (random() % 10 == 0) writer.flush();
    }
  }
  const Reader reader(path_);
  for (std::size_t i = 0; i < 3; ++i)
    expect_same(samples_of(reader, static_cast<std::int64_t>(i) + 1), expected[i]);
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
  EXPECT_EQ(runs[0].asked, asked);
  EXPECT_EQ(runs[0].outcome, nlohmann::json({{"duplicates", 2}}));
  EXPECT_EQ(runs[1].outcome, nullptr);
  EXPECT_EQ(runs[2].number, 3);
  EXPECT_EQ(runs[2].asked.at("id"), "later");
}

TEST_F(RecordTest, TextThatIsNoUtf8IsRecordedAllTheSame) {
  Writer(path_).begin_run({{"command_line", "caf\xe9"}});
  EXPECT_EQ(Reader(path_).runs().at(0).asked.at("command_line"), "caf\xef\xbf\xbd");
}

TEST_F(RecordTest, LeavesOneFileAndNothingBesideIt) {
  {
    Writer writer(path_);
    writer.append(writer.begin_run({}), usual(0, 100));
  }
  EXPECT_THAT(files(), ElementsAre("results.db"));
  EXPECT_EQ(query(path_, "PRAGMA journal_mode"), "delete");
}

TEST_F(RecordTest, AnybodyCanReadItWithSqlite) {
  {
    Writer writer(path_);
    auto samples = usual(0, 2);
    samples[1].fate = Fate::lost;
    samples[1].received_ns = samples[1].server_received_ns = samples[1].server_sent_ns = 0;
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
    EXPECT_EQ(reader.runs().at(0).asked.at("id"), "by hand");
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

TEST_F(RecordTest, WriterThatEndsWhileSomebodyReadsLosesNothing) {
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

TEST_F(RecordTest, OneWriterAtATime) {
  {
    Writer writer(path_);
    const auto run = writer.begin_run({});
    const auto refusal = AllOf(HasSubstr(path_), HasSubstr("another program"));
    EXPECT_THAT(error_of([&] { Writer second(path_); }), refusal) << "with nothing to commit";
    writer.append(run, usual(0, 10));
    EXPECT_THAT(error_of([&] { Writer second(path_); }), refusal) << "with something to commit";
    writer.append(run, usual(10, 10));
    writer.flush();
    EXPECT_EQ(samples_of(Reader(path_), run).size(), 20u);
  }
  EXPECT_EQ(Writer(path_).begin_run({}), 2);
}

TEST_F(RecordTest, KilledWriterLosesNothingThatWasFlushed) {
  kill_9([&](auto far_enough) {
    Writer writer(path_);
    const auto run = writer.begin_run({{"id", "killed"}});
    for (std::uint64_t i = 0; i < 50'000; i += 100) writer.append(run, usual(i, 100));
    writer.flush();
    writer.append(run, usual(50'000, 1));
    far_enough();
  });
  const auto before = bytes_of(path_);
  {
    const Reader reader(path_);
    EXPECT_EQ(reader.runs().at(0).outcome, nullptr);
    const auto samples = samples_of(reader, 1);
    EXPECT_GE(samples.size(), 50'000u);
    expect_same(samples, usual(0, samples.size()));
  }
  EXPECT_EQ(bytes_of(path_), before) << "reading changed the file";
  {
    Writer writer(path_);
    EXPECT_EQ(writer.begin_run({}), 2);
  }
  EXPECT_THAT(files(), ElementsAre("results.db"));
  EXPECT_GE(samples_of(Reader(path_), 1).size(), 50'000u);
}

TEST_F(RecordTest, KilledWriterLosesAtMostTheLastSecond) {
  // Of a Writer that never flushes: what it had appended a second before it was killed.
  const std::string known = (folder_ / "known").string();
  kill_9([&](auto far_enough) {
    Writer writer(path_);
    const auto run = writer.begin_run({});
    std::uint64_t appended = 0;
    const auto append_for = [&](std::chrono::milliseconds time) {
      const auto end = std::chrono::steady_clock::now() + time;
      while (std::chrono::steady_clock::now() < end) {
        writer.append(run, usual(appended, 10));
        appended += 10;
        std::this_thread::sleep_for(std::chrono::milliseconds(5));
      }
    };
    append_for(std::chrono::milliseconds(300));
    write_bytes(known, std::to_string(appended));
    append_for(std::chrono::milliseconds(1000));
    far_enough();
  });
  EXPECT_GE(samples_of(Reader(path_), 1).size(), std::stoul(bytes_of(known)));
}

TEST_F(RecordTest, ReadsInAReadOnlyPlace) {
  if (!mount_disk("size=8m")) GTEST_SKIP() << "mounting a tmpfs needs root";
  {
    Writer writer(path_);
    writer.append(writer.begin_run({}), usual(0, 1000));
  }
  const std::string killed = (folder_ / "killed.db").string();
  kill_9([&](auto far_enough) {
    Writer writer(killed);
    writer.append(writer.begin_run({}), usual(0, 1000));
    writer.flush();
    far_enough();
  });
  const std::string torn = (folder_ / "torn.db").string();  // the log came along, SQLite's lock file did not
  fs::copy_file(killed, torn);
  fs::copy_file(killed + "-wal", torn + "-wal");
  ASSERT_TRUE(make_disk_read_only());
  EXPECT_EQ(samples_of(Reader(path_), 1).size(), 1000u);
  EXPECT_EQ(samples_of(Reader(killed), 1).size(), 1000u);
  EXPECT_THAT(error_of([&] { Reader reader(torn); }),
              AllOf(HasSubstr(torn + "-wal"), HasSubstr("Copy both")));
  EXPECT_THAT(error_of([&] { Writer writer(path_); }), AllOf(HasSubstr(path_), HasSubstr("read-only")));
}

TEST_F(RecordTest, FileThatMayNotBeWritten) {
  { Writer(path_).begin_run({}); }
  fs::permissions(path_, fs::perms::owner_read | fs::perms::group_read | fs::perms::others_read);
  // Root may write everywhere, so it becomes nobody for this.
  const bool root = ::geteuid() == 0;
  constexpr uid_t nobody = 65534;
  if (root) {
    ASSERT_EQ(::seteuid(nobody), 0);
  }
  const auto error = error_of([&] { Writer writer(path_); });
  const auto readable = error_of([&] { EXPECT_EQ(Reader(path_).runs().size(), 1u); });
  if (root) {
    ASSERT_EQ(::seteuid(0), 0);
  }
  EXPECT_THAT(error, AllOf(HasSubstr(path_), HasSubstr("read-only")));
  EXPECT_EQ(readable, "");
}

TEST_F(RecordTest, FullDiskKeepsWhatWasCommitted) {
  if (!mount_disk("size=2m")) GTEST_SKIP() << "mounting a tmpfs needs root";
  std::uint64_t committed = 0;
  std::string error;
  {
    Writer writer(path_);
    const auto run = writer.begin_run({});
    error = error_of([&] {
      for (;; committed += 500) {
        writer.append(run, usual(committed, 500));
        writer.flush();
      }
    });
  }
  EXPECT_THAT(error,
              AllOf(HasSubstr(path_), ::testing::AnyOf(HasSubstr("disk is full"), HasSubstr("No space"))));
  EXPECT_GT(committed, 0u);
  expect_same(samples_of(Reader(path_), 1), usual(0, committed));
}

TEST_F(RecordTest, DiskThatIsFullFromTheStartGetsNothingHalfWritten) {
  if (!mount_disk("size=64k")) GTEST_SKIP() << "mounting a tmpfs needs root";
  write_bytes((folder_ / "filler").string(), std::string(65'536, 'x'));
  EXPECT_THAT(error_of([&] { Writer writer(path_); }), HasSubstr(path_));
  EXPECT_THAT(files(), ElementsAre("filler"));
}

TEST_F(RecordTest, FileThatMayNotGrowKeepsWhatWasCommitted) {
  // A limit of the process instead of the disk, so that it can be tried without root.
  std::signal(SIGXFSZ, SIG_IGN);
  rlimit before{};
  ::getrlimit(RLIMIT_FSIZE, &before);
  std::uint64_t committed = 0;
  std::string error;
  {
    Writer writer(path_);
    const auto run = writer.begin_run({});
    const rlimit limit{1'000'000, before.rlim_max};
    ::setrlimit(RLIMIT_FSIZE, &limit);
    error = error_of([&] {
      for (;; committed += 500) {
        writer.append(run, usual(committed, 500));
        writer.flush();
      }
    });
    ::setrlimit(RLIMIT_FSIZE, &before);
  }
  std::signal(SIGXFSZ, SIG_DFL);
  EXPECT_THAT(error, HasSubstr(path_));
  EXPECT_GT(committed, 0u);
  expect_same(samples_of(Reader(path_), 1), usual(0, committed));
}

TEST_F(RecordTest, WhatIsNoResultsFileIsRefusedAndLeftAlone) {
  { Writer(path_).begin_run({}); }
  const auto results = bytes_of(path_);
  const auto made = [&](const std::string& name, const std::string& bytes) {
    write_bytes((folder_ / name).string(), bytes);
    return (folder_ / name).string();
  };
  const auto text = made("text", std::string(5000, 'x') + "\n");
  const auto other = (folder_ / "other.db").string();
  query(other, "CREATE TABLE bookmark (url TEXT)");
  const auto newer = made("newer.db", results);
  query(newer, "PRAGMA user_version = 2");
  const auto cut = made("cut.db", results.substr(0, 5000));
  const struct {
    std::string path, found;
  } cases[] = {
      {text, "not a results file"}, {other, "another program's"}, {newer, "newer ontime"}, {cut, "damaged"}};
  for (const auto& one : cases) {
    const auto& path = one.path;
    const auto& found = one.found;
    const auto before = bytes_of(path);
    EXPECT_THAT(error_of([&] { Writer writer(path); }), AllOf(HasSubstr(path), HasSubstr(found)));
    EXPECT_THAT(error_of([&] { samples_of(Reader(path), 1); }), AllOf(HasSubstr(path), HasSubstr(found)));
    EXPECT_EQ(bytes_of(path), before) << path;
  }
  EXPECT_THAT(files(), ElementsAre("cut.db", "newer.db", "other.db", "results.db", "text"));
}

TEST_F(RecordTest, MissingFilesAndFolders) {
  const auto folder = folder_.string();
  const auto nowhere = (folder_ / "no" / "where.db").string();
  EXPECT_THAT(error_of([&] { Reader reader(path_); }), AllOf(HasSubstr(path_), HasSubstr("No such file")));
  EXPECT_THAT(error_of([&] { Writer writer(nowhere); }),
              AllOf(HasSubstr(nowhere), HasSubstr("No such file")));
  EXPECT_THAT(error_of([&] { Reader reader(folder); }), AllOf(HasSubstr(folder), HasSubstr("not a file")));
  EXPECT_THAT(error_of([&] { Writer writer(folder); }), AllOf(HasSubstr(folder), HasSubstr("not a file")));
  EXPECT_THAT(files(), IsEmpty());
}

TEST_F(RecordTest, EmptyFileIsWrittenButNotRead) {
  write_bytes(path_, "");
  EXPECT_THAT(error_of([&] { Reader reader(path_); }), AllOf(HasSubstr(path_), HasSubstr("empty")));
  EXPECT_EQ(Writer(path_).begin_run({}), 1);
}

TEST_F(RecordTest, DamageIsSaidNotGuessed) {
  {
    Writer writer(path_);
    writer.append(writer.begin_run({}), usual(0, 1));
  }
  query(path_, "UPDATE sample SET fate = 7");
  EXPECT_THAT(error_of([&] { samples_of(Reader(path_), 1); }), AllOf(HasSubstr(path_), HasSubstr("fate 7")));
  query(path_, "UPDATE run SET outcome = '{'");
  EXPECT_THAT(error_of([&] { Reader(path_).runs(); }), AllOf(HasSubstr(path_), HasSubstr("no JSON")));
}

TEST_F(RecordTest, RunsThatAreNotThere) {
  Writer writer(path_);
  const auto run = writer.begin_run({});
  writer.end_run(run, {});
  EXPECT_THAT(error_of([&] { writer.append(run, usual(0, 1)); }), HasSubstr("no run 1"));
  EXPECT_THAT(error_of([&] { writer.end_run(9, {}); }), HasSubstr("no run 9"));
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
