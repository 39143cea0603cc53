// SPDX-License-Identifier: Apache-2.0
#include "flags.hpp"

#include <stdexcept>

#include <fmt/format.h>

#include "campaign/campaign.hpp"

namespace ontime::app {

using campaign::Error;

std::string given(const std::string& value) { return value.empty() ? "a value is needed" : ""; }

Option* add_file(Command& command, const char* flag, std::string& file, const char* help) {
  return command.add_option(flag, file, help)->type_name("FILE")->check(given);
}

void add_output(Command& command, std::string& file) {
  add_file(command, "--output", file, "into this file instead of standard output");
}

void add_report_format(Command& command, std::string& word) {
  command.add_option("--format", word, "table, json, csv, markdown, latex or html: table")
      ->type_name("FORMAT");
}

void add_format(Command& command, std::string& word) {
  command.add_option("--format", word, "table or json: table")->type_name("FORMAT");
}

void add_link(Command& command, std::string& interface, std::string& peer, const char* interface_help) {
  auto* named = command.add_option("--interface", interface, interface_help)->type_name("NAME")->check(given);
  command.add_option("--peer", peer, "instead: the interface by which the traffic to it goes")
      ->type_name("HOST")
      ->check(given)
      ->excludes(named);
}

report::Format format_flag(const std::string& word) {
  const auto format = report::format_of(word);
  if (!format)
    throw Error(2, fmt::format("--format: '{}' is not one of table, json, csv, markdown, latex, html", word));
  return *format;
}

bool is_json_flag(const std::string& word) {
  if (word != "json" && word != "table")
    throw Error(2, fmt::format("--format: '{}' is not one of table, json", word));
  return word == "json";
}

std::chrono::nanoseconds duration_flag(const std::string& flag, const std::string& text) {
  try {
    return campaign::positive_duration(text);
  } catch (const std::invalid_argument& error) {
    throw Error(2, fmt::format("{}: {}", flag, error.what()));
  }
}

}  // namespace ontime::app
