// SPDX-License-Identifier: Apache-2.0
// A results file that another process writes.
#pragma once

#include "record_fixture.hpp"

namespace ontime::watch {

class Following : public record::RecordTest {
 protected:
  static nlohmann::json asked() {
    return {{"id", "Test1.B\"\\\n\x1b[31m"}, {"transport", "udp"}, {"repetition", 1}, {"duration_s", 60}};
  }
  // A process that wrote with `write`, and still holds the file.
  pid_t measuring(const std::function<void(record::Writer&)>& write) {
    int written[2];
    EXPECT_EQ(::pipe(written), 0);
    const auto child = ::fork();
    if (child == 0) {
      record::Writer writer(path_);
      write(writer);
      writer.flush();
      [[maybe_unused]] auto ignored = ::write(written[1], "x", 1);
      ::pause();
      ::_exit(0);
    }
    char byte = 0;
    EXPECT_EQ(::read(written[0], &byte, 1), 1);
    for (const int end : written) ::close(end);
    return child;
  }
  static void kill(pid_t child) {
    ::kill(child, SIGKILL);
    ::waitpid(child, nullptr, 0);
  }
};

}  // namespace ontime::watch
