// SPDX-License-Identifier: Apache-2.0
// A file that a command makes: whole, or not at all. Ordinary thread.
#pragma once

#include <cstdio>
#include <memory>
#include <string>
#include <string_view>

namespace ontime::app {

class Output {
 public:
  // An empty path: standard output. A file of that name is replaced once finish() has returned, and not
  // before, and never if it is one of results; what is no file (a pipe, a device) is written to as it is. All
  // throw campaign::Error, which names the file.
  explicit Output(std::string path);
  ~Output();
  Output(const Output&) = delete;
  Output& operator=(const Output&) = delete;

  void write(std::string_view);
  void finish();

 private:
  [[noreturn]] void fail(int error) const;
  struct Close {
    void operator()(std::FILE* file) const { std::fclose(file); }
  };
  std::string path_, part_;  // part: where it is written to until it is whole; empty: to the path itself
  std::unique_ptr<std::FILE, Close> file_;
};

}  // namespace ontime::app
