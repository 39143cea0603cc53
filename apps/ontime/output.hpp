// SPDX-License-Identifier: Apache-2.0
// What a command makes: a file, whole or not at all, or text on a terminal. Ordinary thread.
#pragma once

#include <cstdio>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "report/report.hpp"

namespace ontime::app {

// Columns of the terminal at standard output; 80 where there is none.
std::size_t output_columns();
// To break lines at; npos where no terminal reads them, which may be a program.
std::size_t reading_columns();
inline constexpr std::size_t fewest_for_two = 60;  // columns, to have names beside what they mean
// As the terminal at this descriptor can show it: where its locale is no UTF-8, µ becomes u and ≥ becomes >=.
// For a file or a pipe the text stays as it is.
std::string for_terminal(std::string text, int descriptor);
// For standard output.
std::string for_output(std::string text);

// Of a file that need not be there: its first so many bytes, and NUL after its end.
std::string beginning_of(const std::string& path, std::size_t bytes);

// The first screen of these runs, or with `full`, or in another form than a table, all of them.
std::string shown(const std::vector<statistics::Summary>&, report::Format, bool full,
                  const std::string& results);

// Standard output is a pipe, and its reader has left (`| head`): main() ends as SIGPIPE would have ended it.
struct ReaderGone {};

class Output {
 public:
  // An empty path: standard output. A file of that name is replaced once finish() has returned, and not
  // before, and never if it is one of results; what is no file (a pipe, a device) is written to as it is. All
  // throw campaign::Error, which names the file, or ReaderGone.
  explicit Output(std::string path);
  ~Output();
  Output(const Output&) = delete;
  Output& operator=(const Output&) = delete;

  void write(std::string_view);
  void flush();  // what was written can be read now: of a file only after finish()
  void finish();

 private:
  [[noreturn]] void fail(int error) const;
  struct Close {
    void operator()(std::FILE* file) const { std::fclose(file); }
  };
  std::string path_, part_;  // part: where it is written to until it is whole; empty: to the path itself
  std::unique_ptr<std::FILE, Close> file_;
};

void write_whole(const std::string& path, std::string_view text);  // by an Output

}  // namespace ontime::app
