// SPDX-License-Identifier: Apache-2.0
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <functional>
#include <list>
#include <mutex>
#include <thread>

#include <sys/resource.h>

#include "record_fixture.hpp"

namespace ontime::record {
namespace {

// Between SQLite and the disk: calls us at whatever is written or synced.
class Disk {
 public:
  Disk() {
    vfs_ = *real_;
    vfs_.zName = "ontime-test-disk";
    vfs_.xOpen = open;
    sqlite3_vfs_register(&vfs_, 1);
    disk_ = this;
  }
  ~Disk() {
    sqlite3_vfs_unregister(&vfs_);
    sqlite3_vfs_register(real_, 1);
    disk_ = nullptr;
  }
  Disk(const Disk&) = delete;
  Disk& operator=(const Disk&) = delete;

  std::function<void()> on_write = [] {}, on_sync = [] {};

 private:
  // The file as it was opened, but for two of its methods.
  static int open(sqlite3_vfs*, sqlite3_filename name, sqlite3_file* file, int flags, int* out_flags) {
    const int code = real_->xOpen(real_, name, file, flags, out_flags);
    if (file->pMethods == nullptr) return code;
    const std::lock_guard lock(mutex_);
    auto& own = methods_.emplace_back(*file->pMethods);
    real_write_ = own.xWrite;
    real_sync_ = own.xSync;
    own.xWrite = write;
    own.xSync = sync;
    file->pMethods = &own;
    return code;
  }
  static int write(sqlite3_file* file, const void* bytes, int size, sqlite3_int64 at) {
    disk_->on_write();
    return real_write_(file, bytes, size, at);
  }
  static int sync(sqlite3_file* file, int flags) {
    disk_->on_sync();
    return real_sync_(file, flags);
  }

  sqlite3_vfs vfs_;
  static inline sqlite3_vfs* const real_ = sqlite3_vfs_find(nullptr);
  static inline Disk* disk_ = nullptr;
  static inline std::mutex mutex_;
  static inline std::list<sqlite3_io_methods> methods_;
  static inline int (*real_write_)(sqlite3_file*, const void*, int, sqlite3_int64) = nullptr;
  static inline int (*real_sync_)(sqlite3_file*, int) = nullptr;
};

// Where a sync waits while the gate is shut.
class Gate {
 public:
  void shut() { set(false); }
  void open() { set(true); }
  void pass() {
    std::unique_lock lock(mutex_);
    ++waiting_;
    changed_.wait_for(lock, patience, [this] { return open_; });
    --waiting_;
  }
  bool somebody_waits() {
    const std::lock_guard lock(mutex_);
    return waiting_ > 0;
  }

 private:
  void set(bool open) {
    const std::lock_guard lock(mutex_);
    open_ = open;
    changed_.notify_all();
  }
  static constexpr std::chrono::seconds patience{60};
  std::mutex mutex_;
  std::condition_variable changed_;
  bool open_ = true;
  int waiting_ = 0;
};

TEST_F(RecordTest, StalledDiskDelaysNoCaller) {
  Disk disk;
  Gate gate;
  disk.on_sync = [&] { gate.pass(); };
  std::uint64_t appended = 0;
  {
    Writer writer(path_);
    const auto run = writer.begin_run({});
    const auto append_some = [&] {
      writer.append(run, usual(appended, 10'000));
      appended += 10'000;
    };
    gate.shut();
    for (int tries = 0; tries < 12'000 && !gate.somebody_waits(); ++tries) {
      if (appended < 1'000'000) append_some();  // enough to be copied into the file
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    ASSERT_TRUE(gate.somebody_waits());
    for (int i = 0; i < 20; ++i) append_some();
    writer.note(run, {"kind", "in the midst of it", {}, {}});
    EXPECT_TRUE(gate.somebody_waits()) << "it came through only because the disk did";
    gate.open();
  }
  EXPECT_THAT(files(), ElementsAre("results.db"));
  EXPECT_EQ(samples_of(Reader(path_), 1).size(), appended);
}

TEST_F(RecordTest, LogIsBegunAnewAgainAndAgain) {
  std::uintmax_t longest = 0;
  {
    Writer writer(path_);
    const auto run = writer.begin_run({});
    for (std::uint64_t first = 0; first < 1'000'000; first += 20'000) {
      writer.append(run, usual(first, 20'000));
      writer.flush();
      longest = std::max(longest, fs::file_size(path_ + "-wal"));
    }
  }
  EXPECT_LT(longest, 24'000'000u);
  EXPECT_GT(fs::file_size(path_), 2 * longest);
}

// An error of the disk is known only after what caused it.
TEST_F(RecordTest, FailedWriteIsReportedByTheNextCall) {
  if (!mount_disk("size=2m")) GTEST_SKIP() << "mounting a tmpfs needs root";
  std::string error;
  {
    Writer writer(path_);
    const auto run = writer.begin_run({});
    writer.append(run, usual(0, 100));
    writer.flush();
    writer.append(run, usual(100, 100'000));
    while (error.empty()) {
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
      error = error_of([&] { writer.append(run, usual(100'100, 1)); });
    }
  }
  EXPECT_THAT(error,
              AllOf(HasSubstr(path_), ::testing::AnyOf(HasSubstr("disk is full"), HasSubstr("No space"))));
  expect_same(samples_of(Reader(path_), 1), usual(0, 100));
}

TEST_F(RecordTest, MigrationThatIsCutOffAnywhereCostsNothing) {
  const fs::path old = fs::path(ONTIME_TEST_DATA) / "format1.db";
  const auto expected = samples_of(Reader(old.string()), 4);
  const auto through = folder_ / "through";
  int migrated = 0, not_migrated = 0;
  for (int step = 1; !fs::exists(through); ++step) {
    fs::copy_file(old, path_, fs::copy_options::overwrite_existing);
    kill_9([&](auto far_enough) {
      Disk disk;
      int steps = 0;
      disk.on_write = disk.on_sync = [&] {
        if (++steps == step) far_enough();
      };
      Writer writer(path_);
      write_bytes(through.string(), "");
      far_enough();
    });
    const auto as_it_was_or_will_be = [&](const Reader& reader) {
      const auto runs = reader.runs();
      ASSERT_EQ(runs.size(), 4u);
      EXPECT_EQ(runs[3].outcome.counters.on_time, 30u);
      expect_same(samples_of(reader, 4), expected);
    };
    const auto error = error_of([&] { as_it_was_or_will_be(Reader(path_)); });
    EXPECT_THAT(error, ::testing::AnyOf("", HasSubstr("rolled back"))) << step;
    const auto version = query(path_, "PRAGMA user_version");
    EXPECT_EQ(query(path_, "SELECT count(*) FROM pragma_table_info('sample') WHERE name = 'passed_wake_ns'"),
              version == "4" ? "1" : "0");
    if (version == "4") {
      EXPECT_EQ(query(path_, "SELECT count(*) FROM run WHERE key = ''"), "0");
    }
    ++(version == "4" ? migrated : not_migrated);
    as_it_was_or_will_be(Writer(path_).reader());
    EXPECT_THAT(query(path_, "SELECT key FROM run WHERE number = 4"), Not(IsEmpty()));
    EXPECT_EQ(query(path_, "PRAGMA integrity_check"), "ok");
    for (const auto* suffix : {"", "-wal", "-shm", "-journal"}) fs::remove(path_ + suffix);
  }
  EXPECT_GT(not_migrated, 10);
  EXPECT_GT(migrated, 0);
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

TEST_F(RecordTest, ReplacementOfTheFileIsLeftAlone) {
  const auto other = (folder_ / "other").string();
  write_bytes(other, "another's");
  {
    Writer writer(path_);
    fs::rename(other, path_);
  }
  EXPECT_EQ(bytes_of(path_), "another's");
}

TEST_F(RecordTest, AFileThatIsRemovedWhileAWriterWaitsForItTakesNoRun) {
  { Writer(path_).begin_run({{"id", "one"}}); }
  sqlite3* holder = nullptr;
  sqlite3_open(path_.c_str(), &holder);
  ASSERT_EQ(sqlite3_exec(holder, "BEGIN EXCLUSIVE", nullptr, nullptr, nullptr), SQLITE_OK);
  std::string error;
  std::atomic<bool> gave_up = false;
  std::thread waiting([&] {
    error = error_of([&] { Writer(path_).begin_run({{"id", "two"}}); });
    gave_up = true;
  });
  const auto opened = [&] {
    std::error_code gone;
    return std::count_if(fs::directory_iterator("/proc/self/fd"), fs::directory_iterator(),
                         [&](const auto& entry) { return fs::read_symlink(entry, gone) == path_; });
  };
  while (opened() < 2 && !gave_up) std::this_thread::yield();
  fs::remove(path_);
  sqlite3_close(holder);
  waiting.join();
  EXPECT_THAT(error, HasSubstr("removed"));
  EXPECT_THAT(files(), IsEmpty());
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
    EXPECT_FALSE(reader.runs().at(0).outcome.has_ended());
    const auto samples = samples_of(reader, 1);
    EXPECT_GE(samples.size(), 50'000u);
    expect_same(samples, usual(0, samples.size()));
  }
  EXPECT_TRUE(bytes_of(path_) == before) << "reading changed the file";
  {
    Writer writer(path_);
    EXPECT_EQ(writer.begin_run({}), 2);
  }
  EXPECT_THAT(files(), ElementsAre("results.db"));
  EXPECT_GE(samples_of(Reader(path_), 1).size(), 50'000u);
}

TEST_F(RecordTest, KilledWriterLosesAtMostTheLastSecond) {
  // Of a Writer that never flushes: what it had appended a second before it was killed. On a machine that
  // stood still meanwhile it may be killed before it could write.
  const std::string known = (folder_ / "known").string();
  std::size_t kept = 0, expected = 1;
  for (std::int64_t run = 1; run <= 3 && kept < expected; ++run) {
    kill_9([&](auto far_enough) {
      Writer writer(path_);
      writer.begin_run({});
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
    kept = samples_of(Reader(path_), run).size();
    expected = std::stoul(bytes_of(known));
  }
  EXPECT_GE(kept, expected);
}

TEST_F(RecordTest, LogOfARenamedFileIsNotLostToANewOne) {
  kill_9([&](auto far_enough) {
    Writer writer(path_);
    writer.append(writer.begin_run({}), usual(0, 1000));
    writer.flush();
    far_enough();
  });
  const auto renamed = (folder_ / "renamed.db").string(), log = path_ + "-wal";
  fs::rename(path_, renamed);
  EXPECT_THAT(error_of([&] { Writer writer(path_); }), AllOf(HasSubstr(log), HasSubstr("renamed")));
  EXPECT_FALSE(fs::exists(path_));
  fs::rename(log, renamed + "-wal");
  EXPECT_EQ(samples_of(Reader(renamed), 1).size(), 1000u);
  EXPECT_EQ(Writer(path_).begin_run({}), 1);
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

// Root may read and write everywhere, so it becomes another user for this.
template <class Action>
std::string error_of_nobody(const Action& action) {
  constexpr uid_t nobody = 65534;
  const bool root = ::geteuid() == 0;
  EXPECT_EQ(::seteuid(root ? nobody : ::geteuid()), 0);
  auto error = error_of(action);
  EXPECT_EQ(::seteuid(root ? 0 : ::geteuid()), 0);
  return error;
}

TEST_F(RecordTest, FileThatMayNotBeWritten) {
  { Writer(path_).begin_run({}); }
  fs::permissions(path_, fs::perms::owner_read | fs::perms::group_read | fs::perms::others_read);
  EXPECT_THAT(error_of_nobody([&] { Writer writer(path_); }),
              AllOf(HasSubstr(path_), HasSubstr("read-only")));
  EXPECT_EQ(error_of_nobody([&] { EXPECT_EQ(Reader(path_).runs().size(), 1u); }), "");
  EXPECT_THAT(error_of_nobody([&] { Writer writer("/ontime-test-of-nobody.ontime"); }),
              AllOf(HasSubstr("cannot be opened"), HasSubstr("Permission denied")));
}

TEST_F(RecordTest, FileThatMayNotBeReadIsNamedAndNotItsFolder) {
  { Writer(path_).begin_run({}); }
  fs::permissions(path_, fs::perms::none);
  EXPECT_THAT(error_of_nobody([&] { Reader reader(path_); }), HasSubstr("(" + path_ + ": Permission denied"));
  EXPECT_THAT(error_of_nobody([&] { Writer writer(path_); }), HasSubstr("(" + path_ + ": Permission denied"));
}

TEST_F(RecordTest, FullDiskAtANewFileHasNoEarlierData) {
  if (!mount_disk("size=64k")) GTEST_SKIP() << "mounting a tmpfs needs root";
  std::ofstream(folder_ / "filler") << std::string(64 << 10, 'x');
  EXPECT_THAT(error_of([&] { Writer writer(path_); }),
              AllOf(HasSubstr("the disk is full."), ::testing::Not(HasSubstr("Earlier data"))));
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

}  // namespace
}  // namespace ontime::record
