// SPDX-License-Identifier: Apache-2.0
#include "output.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <initializer_list>
#include <sstream>
#include <system_error>
#include <utility>

#include <boost/algorithm/string/case_conv.hpp>
#include <boost/algorithm/string/replace.hpp>
#include <boost/algorithm/string/trim.hpp>
#include <fmt/format.h>
#include <linux/capability.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include "orders/orders.hpp"
#include "realtime/privileges.hpp"
#include "scenario_files.hpp"
#include "table/table.hpp"
#include "terminal.hpp"

namespace ontime::app {

namespace fs = std::filesystem;

namespace {

// By the first variable that is set, as in setlocale(3).
bool locale_is_utf8() {
  for (const auto* name : {"LC_ALL", "LC_CTYPE", "LANG"})
    if (const char* const value = std::getenv(name);  // NOLINT(concurrency-mt-unsafe): nothing sets it
        value != nullptr && *value != '\0') {
      const std::string_view locale(value);
      return locale.find("UTF-8") != locale.npos || locale.find("utf8") != locale.npos;
    }
  return false;
}

// Filled with NUL.
std::string beginning_of(const std::string& path, std::size_t bytes) {
  std::string beginning(bytes, '\0');
  std::ifstream(path, std::ios::binary).read(beginning.data(), static_cast<std::streamsize>(bytes));
  return beginning;
}

}  // namespace

std::size_t output_columns() {
  constexpr unsigned short fewest = 20;  // fewer cannot be read
  winsize size{};
  return ioctl(STDOUT_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col >= fewest ? size.ws_col : 80;
}

std::size_t reading_columns() { return isatty(STDOUT_FILENO) != 0 ? output_columns() : std::string::npos; }

std::string wrapped_lines(const std::string& text, std::size_t width) {
  std::string lines;
  std::istringstream stream(text);
  for (std::string line; std::getline(stream, line);)
    lines += table::width_of(line) <= width
                 ? line + "\n"
                 : table::wrapped(boost::algorithm::trim_left_copy(line), width,
                                  std::string(std::min(line.find_first_not_of(' '), line.size()), ' '));
  return lines;
}

std::string for_terminal(std::string text, int descriptor) {
  if (isatty(descriptor) == 0 || locale_is_utf8()) return text;
  const std::pair<const char*, const char*> plain[] = {
      {"µ", "u"}, {"≥", ">="}, {"≤", "<="}, {"–", "-"}, {"…", "..."},  {"×", "x"}, {"±", "+-"}, {"→", "->"},
      {"−", "-"}, {"█", "#"},  {"·", "."},  {"’", "'"}, {"⁻⁶", "^-6"}, {"†", "#"}, {"é", "e"}};
  for (const auto& [sign, with] : plain) boost::algorithm::replace_all(text, sign, with);
  // One sign for each other character, so that columns stay aligned.
  std::erase_if(text, [](unsigned char c) { return (c & 0xC0) == 0x80; });
  for (auto& c : text)
    if (static_cast<unsigned char>(c) >= 0x80) c = '?';
  return text;
}

std::string for_output(std::string text) { return for_terminal(std::move(text), STDOUT_FILENO); }

std::string shown(const std::vector<statistics::Summary>& runs, report::Format format, bool full,
                  report::Origin origin) {
  const auto own = realtime::privileges();
  origin.is_root = own.is_root();
  origin.has_no_root = origin.is_own && own.is_final_without(CAP_SYS_ADMIN);  // of the machine that measured
  origin.trusts = is_trusted;
  return full ? report::render(runs, format, origin, output_columns())
              : report::render_answer(runs, format, origin, output_columns());
}

std::string about(std::chrono::duration<double> time) {
  const auto s = std::max<std::int64_t>(0, std::chrono::round<std::chrono::seconds>(time).count());
  if (s < 60) return fmt::format("{} s", s);
  const auto min = (s + 30) / 60;
  if (min < 60) return fmt::format("{} min", min);
  return min % 60 == 0 ? fmt::format("{} h", min / 60) : fmt::format("{} h {} min", min / 60, min % 60);
}

bool is_results(const std::string& path) {
  constexpr std::string_view mark = "SQLite format 3";
  return beginning_of(path, mark.size()) == mark;
}

Kind kind_of(report::Format format) {
  using report::Format;
  return format == Format::json    ? Kind::json
         : format == Format::csv   ? Kind::csv
         : format == Format::latex ? Kind::latex
         : format == Format::html  ? Kind::page
                                   : Kind::text;
}

bool can_replace(const std::string& path, Kind kind) {
  std::error_code ignored;
  if (!fs::is_regular_file(path, ignored) || fs::file_size(path, ignored) == 0) return true;
  const auto begin = beginning_of(path, 4096);
  const auto begins = [&](std::initializer_list<std::string_view> marks) {
    return std::ranges::any_of(marks, [&](const auto mark) { return begin.starts_with(mark); });
  };
  const auto has = [&](std::string_view mark) { return begin.find(mark) != begin.npos; };
  switch (kind) {
    case Kind::json:
      return begins({"{", "["});
    case Kind::csv:
      return begins({"run,id,", "id,variant,", "id,transport,"});
    case Kind::latex:
      return begins({"\\begin{table", "% No run "});
    case Kind::page:
      return has("<meta name=\"generator\" content=\"ontime");
    case Kind::junit:
      return has("<testsuite");
    case Kind::figure:
      return begins({"%PDF", "\x89PNG"}) || has("<svg");
    case Kind::text:
      break;
  }
  // What a text is cannot be read from it.
  constexpr std::array endings = {".txt", ".text", ".md", ".markdown", ".rst", ".log", ".out"};
  const auto ending = boost::algorithm::to_lower_copy(fs::path(path).extension().string());
  return std::ranges::find(endings, ending) != endings.end() && !is_results(path) && !begins({"#!"});
}

bool is_written_in_place(const std::string& path) {
  std::error_code none;
  const auto status = fs::status(path, none);
  return path.starts_with("/proc/") || path.starts_with("/dev/std") || path.starts_with("/dev/fd/") ||
         (fs::exists(status) && !fs::is_regular_file(status) && !fs::is_directory(status));
}

Output::Output(std::string path, Kind kind) : path_(std::move(path)) {
  constexpr const char* names[] = {"a text file (.txt, .md, .rst, .log or .out)",
                                   "JSON",
                                   "a CSV file of ontime",
                                   "a LaTeX table",
                                   "an ontime page",
                                   "JUnit XML",
                                   "a figure"};
  std::error_code ignored;
  const bool to_stdout = path_.empty();
  if (!can_replace(path_, kind))
    throw orders::Error(
        2, is_results(path_)
               ? fmt::format("{} is a results file and is not replaced. Fix: name another file", path_)
               : fmt::format("{} exists and is not {}. Fix: name another file", path_,
                             names[static_cast<std::size_t>(kind)]));
  if (to_stdout) {
    file_.reset(::fdopen(::dup(STDOUT_FILENO), "w"));
  } else if (is_written_in_place(path_) || fs::is_directory(path_, ignored)) {
    file_.reset(std::fopen(path_.c_str(), "we"));
  } else {
    // A killed process leaves its part, and process numbers repeat in containers.
    auto number = ::getpid();
    do {
      part_ = fmt::format("{}.part-{}", path_, number++);
      file_.reset(std::fopen(part_.c_str(), "wxe"));
    } while (!file_ && errno == EEXIST);
  }
  if (!file_) {
    part_.clear();
    fail(errno);
  }
}

Output::~Output() {
  std::error_code ignored;
  if (!part_.empty()) fs::remove(part_, ignored);
}

void Output::write(std::string_view whole) {
  if (path_.empty()) clear_progress_line();
  const auto text = path_.empty() ? for_output(std::string(whole)) : std::string(whole);
  if (std::fwrite(text.data(), 1, text.size(), file_.get()) != text.size()) fail(errno);
}

void Output::flush() {
  if (std::fflush(file_.get()) != 0) fail(errno);
}

void Output::finish() {
  if (std::fclose(file_.release()) != 0) fail(errno);  // a network disk may report only now that it is full
  if (part_.empty()) return;
  if (std::rename(part_.c_str(), path_.c_str()) != 0) fail(errno);
  part_.clear();
}

void write_whole(const std::string& path, std::string_view text, Kind kind) {
  Output output(path, kind);
  output.write(text);
  output.finish();
}

void Output::fail(int error) const {
  if (error == EPIPE && path_.empty()) throw ReaderGone();
  // A library may have filled the free descriptor with one that only reads.
  if (path_.empty() && (error == EBADF || error == EINVAL)) throw orders::Error(3, closed_output);
  const bool is_folder = error == EISDIR, has_no_folder = error == ENOENT || error == ENOTDIR;
  throw orders::Error(
      is_folder || has_no_folder ? 2 : 3,
      fmt::format("{} cannot be written: {}. Fix: {}", path_.empty() ? "standard output" : path_,
                  std::generic_category().message(error),
                  is_folder                            ? "name a file in this folder"
                  : has_no_folder                      ? "make its folder first, or name another file"
                  : error == ENOSPC || error == EDQUOT ? "name another file, or free disk space"
                                                       : "name another file"));
}

}  // namespace ontime::app
