// SPDX-License-Identifier: Apache-2.0
// What the tests of results files have in common: a folder of their own, usual samples, what outsiders see.
#pragma once

#include <algorithm>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <memory>
#include <string>
#include <tuple>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sqlite3.h>
#include <sys/mount.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "record/record.hpp"

namespace ontime::record {

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

inline std::string bytes_of(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

inline void write_bytes(const std::string& path, const std::string& bytes) {
  std::ofstream(path, std::ios::binary) << bytes;
}

// What an outsider with sqlite3 gets: the first column of the first row.
inline std::string query(const std::string& path, const std::string& sql) {
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
inline Sample usual(std::uint64_t index) {
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

inline std::vector<Sample> usual(std::uint64_t first, std::uint64_t count) {
  std::vector<Sample> samples;
  for (std::uint64_t index = first; index < first + count; ++index) samples.push_back(usual(index));
  return samples;
}

inline std::vector<Sample> samples_of(const Reader& reader, std::int64_t run) {
  std::vector<Sample> samples;
  reader.each_sample(run, [&](const Sample& sample) { samples.push_back(sample); });
  return samples;
}

inline auto fields(const Sample& s) {
  return std::tuple(s.index, s.intended_ns, s.due_ns, s.woke_ns, s.sent_ns, s.received_ns,
                    s.server_received_ns, s.server_sent_ns, s.skipped_cycles, s.fate, s.passed_wake_ns);
}

inline void expect_same(const std::vector<Sample>& found, const std::vector<Sample>& expected) {
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

}  // namespace ontime::record
