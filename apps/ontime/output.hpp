// SPDX-License-Identifier: Apache-2.0
// The output of a command: a complete file or none, or text on a terminal. Ordinary thread.
#pragma once

#include <chrono>
#include <cstdio>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "report/report.hpp"

namespace ontime::app {

// Columns of the terminal at standard output; 80 without a terminal.
std::size_t output_columns();
// Where to wrap lines; npos without a terminal, because a program may read them.
std::size_t reading_columns();
// Each line of a text, where it is wider; further lines are indented further than it is.
std::string wrapped_lines(const std::string& text, std::size_t width);
// The text as the terminal at this descriptor can show it: without UTF-8, µ becomes u and ≥ becomes >=.
// Unchanged for a file or a pipe.
std::string for_terminal(std::string text, int descriptor);
// For standard output.
std::string for_output(std::string text);

// "45 s", "12 min", "7 h 40 min".
std::string about(std::chrono::duration<double>);
inline constexpr const char* simulated_time = " of simulated time";  // after about()

// What a command writes to a file. An existing file is replaced only by its own kind, so that a mistyped name
// destroys nothing. `page` is the HTML of this ontime or another; a table of text has no mark, so it goes by
// the end of the name.
enum class Kind { text, json, csv, latex, page, junit, figure };
Kind kind_of(report::Format);
bool can_replace(const std::string& path, Kind);  // also an empty file, or none
bool is_results(const std::string& path);         // by its first bytes
// A pipe, a device, or the name of an open file, such as /dev/stdout, which root must not replace.
bool is_written_in_place(const std::string& path);

// The summary of these runs; with `full`, or in another format than a table, everything.
std::string shown(const std::vector<statistics::Summary>&, report::Format, bool full, report::Origin);

inline constexpr const char* closed_output = "standard output is closed";  // `>&-`

// The reader of standard output has closed the pipe (`| head`): main() then ends by SIGPIPE.
struct ReaderGone {};

class Output {
 public:
  // An empty path: standard output. finish() replaces an existing file, if can_replace(). A pipe or a device
  // is written directly. All throw orders::Error, which names the file, or ReaderGone.
  explicit Output(std::string path, Kind = Kind::text);
  ~Output();
  Output(const Output&) = delete;
  Output& operator=(const Output&) = delete;

  void write(std::string_view);
  void flush();  // makes written text readable; a file only after finish()
  void finish();

 private:
  [[noreturn]] void fail(int error) const;
  struct Close {
    void operator()(std::FILE* file) const { std::fclose(file); }
  };
  std::string path_, part_;  // part: where it is written to until it is whole; empty: to the path itself
  std::unique_ptr<std::FILE, Close> file_;
};

void write_whole(const std::string& path, std::string_view text, Kind = Kind::text);  // by an Output

}  // namespace ontime::app
