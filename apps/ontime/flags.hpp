// SPDX-License-Identifier: Apache-2.0
// Flags that several commands share, with one check for each.
#pragma once

#include <chrono>
#include <initializer_list>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>

#include <fmt/format.h>

#include "command.hpp"
#include "orders/orders.hpp"
#include "report/report.hpp"

namespace ontime::watch {
class Metrics;
}

namespace ontime::app {

// Wrong usage or input, for people: exit code 2.
template <class... Arguments>
orders::Error wrong(fmt::format_string<Arguments...> text, Arguments&&... arguments) {
  return {2, fmt::format(text, std::forward<Arguments>(arguments)...)};
}

// An option whose value must not be empty; --help calls the value `what`.
template <class Value>
Option* add_value(Command& command, const std::string& flag, Value& value, const char* what,
                  const std::string& help) {
  return command.add_option(flag, value, help, what)->given();
}
// A list: values separated by commas, or the flag repeated.
void add_list(Command&, const std::string& flag, std::vector<std::string>& values, const char* what,
              const char* help);
Option* add_file(Command&, const char* flag, std::string& file, const char* help);
// --results, to write: refuses a folder, and a file whose folder does not exist.
void add_results(Command&, std::string& file, const char* help);
void add_resume(Command&, bool& resume);              // --resume, of runs, with --results
void add_output(Command&, std::string& file);         // --output FILE, instead of standard output
void add_report_output(Command&, std::string& file);  // --output FILE, whose ending may be the format
// --format, for format_flag(), and --full: every table instead of the first screen.
void add_report_format(Command&, std::string& word, bool& full);
void add_format(Command&, std::string& word);  // --format, for is_json_flag()
// --interface NAME, or --peer HOST instead.
void add_link(Command&, std::string& interface, std::string& peer, const char* interface_help);
void add_metrics(Command&, std::string& address);  // --metrics, for metrics_at()

// The checked value of a flag. Each throws Error{2} that names the flag.
report::Format format_flag(const std::string& word);
report::Format format_flag(const std::string& word, const std::string& file);  // without a word by the file
bool is_json_flag(const std::string& word);
std::chrono::nanoseconds duration_flag(const std::string& flag, const std::string& text);
std::uint64_t bytes_flag(const std::string& flag, const std::string& text);
// One of these words.
template <class Value>
Value word_flag(const std::string& flag, const std::string& word,
                std::initializer_list<std::pair<const char*, Value>> words) {
  std::string all;
  for (const auto& [one, value] : words) {
    if (word == one) return value;
    all += (all.empty() ? "" : ", ") + std::string(one);
  }
  throw wrong("{}: '{}' is not one of {}", flag, word, all);
}
template <class Read>
auto read_flag(const std::string& flag, const Read& read) {
  try {
    return read();
  } catch (const std::invalid_argument& error) {
    throw wrong("{}: {}", flag, error.what());
  }
}

// Serves metrics over HTTP and prints their URL; nullptr without an address. Throws campaign::Error: 2 for an
// invalid address, 3 if it cannot listen there.
std::unique_ptr<watch::Metrics> metrics_at(const std::string& address);

}  // namespace ontime::app
