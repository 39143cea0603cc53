// SPDX-License-Identifier: Apache-2.0
// A results file that another process writes.
#pragma once

#include <array>

#include <sys/socket.h>

#include "record_fixture.hpp"

namespace ontime::watch {

class Following : public record::RecordTest {
 protected:
  static nlohmann::json asked() {
    return {{"id", "Test1.B\"\\\n\x1b[31m"}, {"transport", "udp"}, {"repetition", 1}, {"duration_s", 60}};
  }
  // A process that wrote with the first of `steps`, and still holds the file. next_step() lets it go on.
  using Steps = std::vector<std::function<void(record::Writer&)>>;
  pid_t measuring(const Steps& steps) {
    EXPECT_EQ(::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, both_.data()), 0);
    const auto child = ::fork();
    if (child == 0) {
      record::Writer writer(path_);
      for (const auto& step : steps) {
        step(writer);
        writer.flush();
        char byte = 'x';
        if (::write(both_[1], &byte, 1) != 1 || ::read(both_[1], &byte, 1) != 1) break;
      }
      ::pause();
      ::_exit(0);
    }
    wait();
    return child;
  }
  void next_step() {
    EXPECT_EQ(::write(both_[0], "x", 1), 1);
    wait();
  }
  void kill(pid_t child) {
    ::kill(child, SIGKILL);
    ::waitpid(child, nullptr, 0);
    for (const int end : both_) ::close(end);
  }

 private:
  void wait() {
    char byte = 0;
    EXPECT_EQ(::read(both_[0], &byte, 1), 1);
  }
  std::array<int, 2> both_{};
};

}  // namespace ontime::watch
