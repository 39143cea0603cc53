// SPDX-License-Identifier: Apache-2.0
// cyclictest of rt-tests: each of its threads wakes at an interval, and it notes how late. That is ontime's
// wake-up, without a message.
#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <sstream>
#include <string_view>
#include <system_error>
#include <utility>

#include <fmt/format.h>

#include "foreign/foreign.hpp"
#include "json.hpp"
#include "number.hpp"
#include "record/document.hpp"
#include "record/record.hpp"

namespace ontime::foreign {
namespace {

using nlohmann::json;
using record::at;

constexpr std::size_t most_values = 200'000;                  // different ones, that a run's record holds
constexpr std::uint64_t most_ns = std::uint64_t{1} << 60U;    // 36 years
constexpr std::uint64_t most_seen = std::uint64_t{1} << 53U;  // exact in every reader's numbers
constexpr std::uintmax_t most_text_bytes = std::uintmax_t{256} << 20U;  // a million values of 30 threads
constexpr std::uintmax_t most_json_bytes = std::uintmax_t{32} << 20U;   // ten times as much as a document
constexpr std::size_t most_line = 1 << 16;
constexpr std::size_t longest_word = 4096;  // of what is kept beside the numbers
constexpr std::size_t most_threads = 4096;
constexpr int deepest = 16;

[[noreturn]] void fail(const std::string& file, const std::string& where, const std::string& what) {
  throw record::WrongFile(
      fmt::format("{}: {}{}{}. Nothing was imported.", file, where, where.empty() ? "" : ": ", what));
}

// How often a value was seen, and what is known of those that were not kept.
struct Histogram {
  std::vector<std::pair<std::uint64_t, std::uint64_t>> values;  // ascending: value, how many, at least one
  std::uint64_t beyond = 0;                                     // values of `beyond_from` or more, not kept
  std::uint64_t beyond_from = 0;
  std::uint64_t min = 0, max = 0;  // of all
  double mean = 0;                 // of all
};

// `outcome.histogram`, in nanoseconds. Throws if what the tool says of the whole does not fit what it kept.
json json_of(const Histogram& of, std::int64_t unit_ns, const std::string& file, const std::string& where) {
  const auto unit = static_cast<std::uint64_t>(unit_ns);
  const auto wrong = [&](const std::string& what) { fail(file, where, what); };
  if (of.values.empty()) wrong("the histogram is empty; cyclictest keeps values up to the N of -h N");
  if (of.values.size() > most_values)
    wrong(fmt::format("it has {} different values; at most {} are supported", of.values.size(), most_values));
  if (of.max > most_ns / unit) wrong(fmt::format("the maximum {} is out of range", of.max));
  if (!(of.mean >= 0 && of.mean <= static_cast<double>(of.max)))
    wrong(fmt::format("its mean, {}, is not between 0 and its maximum, {}", of.mean, of.max));
  std::uint64_t seen = of.beyond;
  if (seen > most_seen) wrong("more values than any run has");
  for (const auto& [value, count] : of.values)
    if (count > most_seen || (seen += count) > most_seen) wrong("more values than any run has");
  const auto [least, greatest] = std::pair(of.values.front().first, of.values.back().first);
  if (of.min != least) wrong(fmt::format("minimum {}, but the histogram begins with {}", of.min, least));
  if (of.beyond == 0 ? of.max != greatest : of.max < of.beyond_from)
    wrong(fmt::format("maximum {}, but the histogram ends with {}{}", of.max, greatest,
                      of.beyond == 0 ? "" : " and overflows"));

  auto values = json::array();
  for (const auto& [value, count] : of.values) values.push_back({value * unit, count});
  return {{"of", "wake-up"},
          {"unit_ns", unit_ns},
          {"values", std::move(values)},
          {"beyond", of.beyond},
          {"beyond_from_ns", of.beyond == 0 ? 0 : of.beyond_from * unit},
          {"max_ns", of.max * unit},
          {"mean_ns", of.mean * static_cast<double>(unit)}};
}

std::ifstream open(const std::string& file, std::uintmax_t most_bytes) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(file, error))
    fail(file, "", error ? error.message() : "it is not a file");
  if (const auto size = std::filesystem::file_size(file, error); size > most_bytes)
    fail(file, "", fmt::format("it has {} bytes; at most {} are read", size, most_bytes));
  std::ifstream in(file);
  if (!in) fail(file, "", std::generic_category().message(errno));
  return in;
}

// --- the text ---

bool is_digit(char c) { return c >= '0' && c <= '9'; }
bool is_letter(char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z'); }

class Text {
 public:
  explicit Text(const std::string& file) : file_(file) {}

  std::vector<Histogram> read() {
    auto in = open(file_, most_text_bytes);
    std::vector<char> buffer(most_line);
    while (in.getline(buffer.data(), most_line)) {
      ++line_;
      is_cut_off_ = in.eof();
      line(buffer.data());
    }
    if (!in.eof()) {
      ++line_;
      wrong(fmt::format("it is longer than {} characters", most_line - 1));
    }
    finish();
    return std::move(threads_);
  }

 private:
  [[noreturn]] void wrong(const std::string& what) const { fail(file_, fmt::format("line {}", line_), what); }

  void line(const std::string& text) {
    const auto first = text.find_first_not_of(" \t");
    if (first == text.npos) return;
    if (text[first] != '#') return values(numbers(text));
    for (const auto* name :
         {"Total", "Min Latencies", "Avg Latencies", "Max Latencies", "Histogram Overflows"})
      if (const auto key = fmt::format("# {}:", name); text.compare(first, key.size(), key) == 0) {
        if (!totals_.try_emplace(name, numbers(text.substr(first + key.size()))).second)
          wrong(fmt::format("'{}' occurs twice; a file has one histogram", name));
        return;
      }
    constexpr std::string_view thread = "# Thread ";  // "# Thread 0:"; with -b also "# Thread Ids: 41 42"
    if (text.compare(first, thread.size(), thread) == 0 && is_digit(text[first + thread.size()])) ++named_;
  }

  std::vector<std::uint64_t> numbers(const std::string& text) const {
    std::istringstream words(text);
    std::vector<std::uint64_t> result;
    for (std::string word; words >> word;) {
      const auto count = number_in<std::uint64_t>(word);
      if (!count)
        wrong(fmt::format("'{:.20}' is not a whole number of at least 0{}", word,
                          is_letter(word[0]) ? "; `cyclictest -h N -q` prints the histogram alone" : ""));
      result.push_back(*count);
    }
    return result;
  }

  void values(const std::vector<std::uint64_t>& columns) {
    if (columns.size() < 2) wrong("a line needs a value and its count");
    if (threads_.empty()) {
      if (columns.size() - 1 > most_threads) wrong("it has more columns than machines have CPUs");
      threads_.resize(columns.size() - 1);
    } else if (columns.size() - 1 != threads_.size()) {
      wrong(fmt::format("it has {} columns, the lines before {}", columns.size(), threads_.size() + 1));
    } else if (columns[0] < next_) {
      wrong(fmt::format("{} comes after {}", columns[0], next_ - 1));
    }
    if (columns[0] > most_ns) wrong(fmt::format("{} is out of range", columns[0]));
    next_ = columns[0] + 1;
    for (std::size_t i = 0; i < threads_.size(); ++i)
      if (columns[i + 1] > 0) threads_[i].values.emplace_back(columns[0], columns[i + 1]);
  }

  std::uint64_t total(const char* name, std::size_t thread) const {
    const auto found = totals_.find(name);
    if (found == totals_.end() || found->second.size() < threads_.size())
      fail(file_, "",
           fmt::format("no '# {}:' with a number for each of {} columns: the file is cut off, or not from "
                       "`cyclictest -h N -q`",
                       name, threads_.size()));
    return found->second[thread];
  }

  void finish() {
    if (threads_.empty()) fail(file_, "", "no histogram in the file; `cyclictest -h N -q` prints one");
    if (is_cut_off_) wrong("no end of line: the file is cut off");  // a number may lack its last digits
    // Of -H the last column is the sum of the others, and no thread.
    if (named_ > 0 && threads_.size() == named_ + 1) threads_.pop_back();
    if (named_ > 0 && threads_.size() != named_)
      fail(file_, "", fmt::format("it has {} columns, but names {} threads", threads_.size(), named_));
    for (std::size_t i = 0; i < threads_.size(); ++i) {
      auto& thread = threads_[i];
      thread.min = total("Min Latencies", i);
      thread.max = total("Max Latencies", i);
      thread.mean = static_cast<double>(total("Avg Latencies", i));
      thread.beyond = total("Histogram Overflows", i);
      thread.beyond_from = next_;
      std::uint64_t seen = 0;
      double sum = 0;
      for (const auto& [value, count] : thread.values) {
        if (__builtin_add_overflow(seen, count, &seen)) fail(file_, "", "more values than any run has");
        sum += static_cast<double>(value) * static_cast<double>(count);
      }
      // The average is printed without its fraction.
      if (thread.beyond == 0) thread.mean = sum / static_cast<double>(std::max<std::uint64_t>(seen, 1));
      if (seen != total("Total", i))
        fail(file_, "",
             fmt::format("column {}: the counts add up to {}, but 'Total' is {}", i + 1, seen,
                         total("Total", i)));
    }
  }

  const std::string& file_;
  std::size_t line_ = 0, named_ = 0;
  bool is_cut_off_ = false;  // within its last line
  std::uint64_t next_ = 0;   // the least that may come
  std::vector<Histogram> threads_;
  std::map<std::string, std::vector<std::uint64_t>> totals_;
};

// --- JSON ---

json document_of(const std::string& file) {
  auto in = open(file, most_json_bytes);
  const std::string text{std::istreambuf_iterator<char>(in), {}};
  if (record::is_nested_deeper(text, deepest)) fail(file, "", "it is nested deeper than cyclictest's JSON");
  try {
    return parsed_json(text);
  } catch (const json::exception& error) {
    fail(file, "", fmt::format("it is not JSON, or cut off ({})", error.what()));
  }
}

// null if it is neither a number nor a short text.
json word_of(const json& value) {
  const bool fits =
      value.is_number() || (value.is_string() && value.get_ref<const std::string&>().size() <= longest_word);
  return fits ? value : json();
}

Histogram histogram_of(const json& of, const std::string& file, const std::string& where) {
  const auto whole = [&](const char* key) {
    const auto& value = at(of, key);
    if (!value.is_number_unsigned())
      fail(file, where, fmt::format("'{}' is not a whole number of at least 0", key));
    return value.get<std::uint64_t>();
  };
  Histogram result;
  std::map<std::uint64_t, std::uint64_t> values;
  const auto& histogram = at(of, "histogram");
  if (!histogram.is_object()) fail(file, where, "no histogram");
  std::uint64_t seen = 0;
  for (const auto& [value, count] : histogram.items()) {
    const auto number = number_in<std::uint64_t>(value);
    if (!number || *number > most_ns || !count.is_number_unsigned())
      fail(file, where, fmt::format("'{:.20}' in the histogram is not a value with a count", value));
    if (__builtin_add_overflow(seen, count.get<std::uint64_t>(), &seen))
      fail(file, where, "more values than any run has");
    if (count > 0 && !values.try_emplace(*number, count.get<std::uint64_t>()).second)
      fail(file, where, fmt::format("{} occurs twice in the histogram", *number));
  }
  result.values.assign(values.begin(), values.end());
  const auto cycles = whole("cycles");
  if (seen > cycles) fail(file, where, fmt::format("the histogram has {} values of {} cycles", seen, cycles));
  result.beyond = cycles - seen;  // JSON has neither their number nor where the histogram ended
  if (!values.empty()) result.beyond_from = values.rbegin()->first + 1;
  result.min = whole("min");
  result.max = whole("max");
  if (!at(of, "avg").is_number()) fail(file, where, "'avg' is not a number");
  result.mean = at(of, "avg").get<double>();
  return result;
}

// --- both ---

json asked_of(const std::string& file, const What& what, std::size_t thread) {
  const auto* form = what.form == Form::cyclictest_json ? "cyclictest-json" : "cyclictest-histogram";
  return {{"id", what.id},         {"variant", fmt::format("thread {}", thread)},
          {"thread", thread},      {"repetition", 1},
          {"measures", "wake-up"}, {"imported", {{"from", form}, {"file", file}}}};
}

std::vector<Import> read_text(const std::string& file, const What& what) {
  std::vector<Import> runs;
  const auto threads = Text(file).read();
  for (std::size_t i = 0; i < threads.size(); ++i)
    runs.push_back(
        {asked_of(file, what, i),
         {{"interrupted", false},
          {"histogram", json_of(threads[i], what.unit_ns, file, fmt::format("column {}", i + 1))}}});
  return runs;
}

// Of a kernel without PREEMPT_RT the file does not say which other kind it has.
json preemption_of(const json& realtime) {
  return realtime == 1 ? json("rt") : realtime == 0 ? json("not rt") : json();
}

std::vector<Import> read_json(const std::string& file, const What& what) {
  const auto document = document_of(file);
  const auto& threads = at(document, "thread");
  if (!threads.is_object() || threads.empty())
    fail(file, "", "no 'thread' in the file; `cyclictest -h N --json=FILE` writes it");
  std::map<std::size_t, const json*> in_order;  // "10" comes after "9"
  for (const auto& [name, thread] : threads.items()) {
    const auto number = number_in<std::uint64_t>(name);
    if (!number || *number >= most_threads)
      fail(file, "thread", fmt::format("'{:.20}' is not a thread number", name));
    if (!in_order.try_emplace(*number, &thread).second)
      fail(file, "thread", fmt::format("{} occurs twice", *number));
  }
  if (const auto& code = at(document, "return_code"); code.is_number() && code != 0)
    fail(file, "",
         fmt::format("'return_code' is {}: cyclictest failed, and its histograms may lack values. Fix: "
                     "measure again",
                     record::text_of(code)));
  const auto unit_ns = at(document, "resolution_in_ns") == 1 ? 1 : 1000;
  std::vector<Import> runs;
  for (const auto& [number, thread] : in_order) {
    const auto where = fmt::format("thread {}", number);
    auto asked = asked_of(file, what, number);
    for (const auto* key : {"cmdline", "rt_test_version", "start_time", "return_code"}) {
      const auto with_colon = fmt::format("{}:", key);  // so rt-tests 2.4 writes some of them
      asked["imported"][key] = word_of(at(document, (document.contains(key) ? key : with_colon.c_str())));
    }
    const auto& system = at(document, "sysinfo");
    const json machine = {{"hostname", word_of(at(system, "nodename"))},
                          {"kernel_release", word_of(at(system, "release"))},
                          {"kernel_version", word_of(at(system, "version"))},
                          {"preemption", preemption_of(at(system, "realtime"))}};
    runs.push_back({std::move(asked),
                    {{"interrupted", false},
                     {"hosts", {{"controller", {{"machine", machine}}}}},
                     {"histogram", json_of(histogram_of(*thread, file, where), unit_ns, file, where)}}});
  }
  return runs;
}

}  // namespace

std::vector<Import> read(const std::string& file, const What& what) {
  return what.form == Form::cyclictest_json ? read_json(file, what) : read_text(file, what);
}

}  // namespace ontime::foreign
