// SPDX-License-Identifier: Apache-2.0
// Flags that several commands have, each with one word for it and one check.
#pragma once

#include <chrono>
#include <memory>
#include <stdexcept>
#include <string>

#include "command.hpp"
#include "orders/orders.hpp"
#include "report/report.hpp"

namespace ontime::watch {
class Metrics;
}

namespace ontime::app {

// With a value that is not empty, which --help calls `what`.
template <class Value>
Option* add_value(Command& command, const std::string& flag, Value& value, const char* what,
                  const std::string& help) {
  return command.add_option(flag, value, help)->type_name(what)->given();
}
// Its values between commas, or the flag once more.
Option* add_list(Command&, const std::string& flag, std::vector<std::string>& values, const char* what,
                 const char* help);
Option* add_file(Command&, const char* flag, std::string& file, const char* help);
void add_output(Command&, std::string& file);  // --output FILE, of what goes to standard output else
// --format, for format_flag(), and --full: every table instead of the first screen.
void add_report_format(Command&, std::string& word, bool& full);
void add_format(Command&, std::string& word);  // --format, for is_json_flag()
// --interface NAME, or --peer HOST in its place.
void add_link(Command&, std::string& interface, std::string& peer, const char* interface_help);
void add_metrics(Command&, std::string& address);  // --metrics, for metrics_at()

// What stands there, checked. Each throws Error{2} that names the flag.
report::Format format_flag(const std::string& word);
bool is_json_flag(const std::string& word);
std::chrono::nanoseconds duration_flag(const std::string& flag, const std::string& text);
std::uint64_t bytes_flag(const std::string& flag, const std::string& text);
template <class Read>
auto read_flag(const std::string& flag, const Read& read) {
  try {
    return read();
  } catch (const std::invalid_argument& error) {
    throw orders::Error(2, flag + ": " + error.what());
  }
}

// What Prometheus reads over HTTP; says where. Without an address nullptr. Throws campaign::Error: 2 it is no
// address, 3 it cannot be had.
std::unique_ptr<watch::Metrics> metrics_at(const std::string& address);

}  // namespace ontime::app
