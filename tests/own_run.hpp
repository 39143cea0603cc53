// SPDX-License-Identifier: Apache-2.0
// For tests that change this machine: a /run of their own, and processes that can be killed.
#pragma once

#include <array>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <string>

#include <fcntl.h>
#include <gmock/gmock.h>
#include <grp.h>
#include <sched.h>
#include <signal.h>
#include <sys/mount.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include "journal/journal.hpp"

namespace ontime::test {

// The program was started again by one of its own tests, which made the surroundings.
constexpr const char* inside_variable = "ONTIME_TEST_INSIDE";
inline bool has_own_run = false;

// NOLINTBEGIN(concurrency-mt-unsafe): before any thread, or in a process of its own
inline void set(const char* name, const std::string& value) { setenv(name, value.c_str(), 1); }
inline bool inside_another() { return std::getenv(inside_variable) != nullptr; }
// NOLINTEND(concurrency-mt-unsafe)

// Root gets a /run of its own, seen by this process and its children only: journals and namespaces of these
// tests and of an ontime that runs on this machine do not meet. Others get a folder.
class OwnRun : public ::testing::Environment {
 public:
  void SetUp() override {
    if (inside_another()) return;
    if (geteuid() == 0) {
      has_own_run = unshare(CLONE_NEWNS) == 0 &&
                    mount("none", "/", nullptr, MS_REC | MS_PRIVATE, nullptr) == 0 &&
                    mount("none", "/run", "tmpfs", 0, "mode=755") == 0;
      return;
    }
    ASSERT_NE(mkdtemp(folder_.data()), nullptr);
    set("XDG_RUNTIME_DIR", folder_);
  }
  void TearDown() override {
    if (!inside_another() && geteuid() != 0) std::filesystem::remove_all(folder_);
  }

 private:
  std::string folder_ = (std::filesystem::temp_directory_path() / "ontime-own-run-XXXXXX").string();
};

inline int status_of(pid_t child) {
  int status = -1;
  EXPECT_EQ(waitpid(child, &status, 0), child);
  return WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
}

inline pid_t start_child(const std::function<void()>& body) {
  const pid_t child = fork();
  if (child < 0) std::abort();  // its id would be killed: -1 means all processes
  if (child > 0) return child;
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  try {
    body();
  } catch (const std::exception& error) {
    ADD_FAILURE() << error.what();
  }
  _exit(::testing::Test::HasFailure() ? 1 : 0);
}

inline void in_child(const std::function<void()>& body) {
  EXPECT_EQ(status_of(start_child(body)), 0) << "see above";
}

// A process with a journal, killed by kill -9 once it has made its changes. What it says is told to the test.
class Victim {
 public:
  explicit Victim(const std::function<std::string(journal::Journal&)>& change,
                  std::span<const journal::Kind> kinds = {}) {
    std::array<int, 2> told;
    EXPECT_EQ(pipe2(told.data(), O_CLOEXEC), 0);
    pid_ = start_child([&] {
      journal::Journal journal(kinds);
      const auto said = change(journal) + "\n";
      EXPECT_EQ(write(told[1], said.data(), said.size()), static_cast<ssize_t>(said.size()));
      pause();
    });
    close(told[1]);
    for (char one = 0; read(told[0], &one, 1) == 1 && one != '\n';) said_ += one;
    close(told[0]);
  }
  ~Victim() {
    kill_9();
    wait();
  }
  Victim(const Victim&) = delete;
  Victim& operator=(const Victim&) = delete;
  const std::string& said() const { return said_; }
  pid_t pid() const { return pid_; }
  void kill_9() {
    if (pid_ <= 0) return;
    kill(pid_, SIGKILL);
    siginfo_t info{};
    waitid(P_PID, static_cast<id_t>(pid_), &info, WEXITED | WNOWAIT);  // it stays a zombie
  }
  void wait() {
    if (pid_ > 0) waitpid(pid_, nullptr, 0);
    pid_ = -1;
  }

 private:
  pid_t pid_;
  std::string said_;
};

inline std::string error_of(const std::function<void()>& action) {
  try {
    action();
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "";
}

inline void become_ordinary_user(id_t id = 65534) {
  ASSERT_EQ(setgroups(0, nullptr), 0);
  ASSERT_EQ(setresgid(id, id, id), 0);
  ASSERT_EQ(setresuid(id, id, id), 0);
}

}  // namespace ontime::test
