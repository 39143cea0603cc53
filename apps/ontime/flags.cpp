// SPDX-License-Identifier: Apache-2.0
#include "flags.hpp"

#include <boost/algorithm/string/predicate.hpp>
#include <fmt/format.h>

#include "campaign/campaign.hpp"
#include "terminal.hpp"
#include "watch/watch.hpp"

namespace ontime::app {

void add_list(Command& command, const std::string& flag, std::vector<std::string>& values, const char* what,
              const char* help) {
  add_value(command, flag, values, what, help)->one_a_flag()->comma_separated();
}

Option* add_file(Command& command, const char* flag, std::string& file, const char* help) {
  return add_value(command, flag, file, "FILE", help);
}

void add_results(Command& command, std::string& file, const char* help) {
  add_file(command, "--results", file, help)->in_a_folder();
}

void add_resume(Command& command, bool& resume) {
  command
      .add_flag("--resume", resume,
                "skip runs that are complete in these results: same conditions, repetition, scenario text "
                "and version of ontime")
      ->needs("--results");
}

void add_output(Command& command, std::string& file) {
  add_file(command, "--output", file, "write to this file instead of standard output");
}

void add_report_output(Command& command, std::string& file) {
  add_file(command, "--output", file,
           "write to this file instead of standard output; without --format, its ending .html, .json, .csv, "
           ".md or .tex decides the format");
}

void add_report_format(Command& command, std::string& word, bool& full) {
  command.add_option("--format", word, "table, json, csv, markdown, latex or html (default: table)",
                     "FORMAT");
  command.add_flag("--full", full, "print every table instead of the 24-line summary");
}

void add_format(Command& command, std::string& word) {
  command.add_option("--format", word, "table or json (default: table)", "FORMAT");
}

void add_link(Command& command, std::string& interface, std::string& peer, const char* interface_help) {
  add_value(command, "--interface", interface, "NAME", interface_help);
  add_value(command, "--peer", peer, "HOST", "use the interface that routes to this host")
      ->excludes("--interface");
}

void add_metrics(Command& command, std::string& address) {
  add_value(command, "--metrics", address, "[ADDR:]PORT",
            "serve the same to Prometheus over HTTP; a PORT alone is on loopback");
}

report::Format format_flag(const std::string& word) {
  using enum report::Format;
  return word_flag<report::Format>("--format", word,
                                   {{"table", table},
                                    {"json", json},
                                    {"csv", csv},
                                    {"markdown", markdown},
                                    {"latex", latex},
                                    {"html", html}});
}

report::Format format_flag(const std::string& word, const std::string& file) {
  using enum report::Format;
  if (!word.empty()) return format_flag(word);
  for (const auto& [ending, format] :
       {std::pair(".html", html), {".json", json}, {".csv", csv}, {".md", markdown}, {".tex", latex}})
    if (file.ends_with(ending)) return format;
  for (const auto* ending : {".svg", ".pdf", ".png", ".eps", ".jpg", ".jpeg", ".gif", ".htm", ".xml", ".yaml",
                             ".yml", ".xlsx", ".ods", ".docx", ".odt"})
    if (boost::algorithm::iends_with(file, ending))
      throw wrong(
          "--output: a {} is none of the formats here. Fix: name a file with the ending .html, .json, .csv, "
          ".md, .tex or .txt; `ontime plot` and `ontime compare --plot` draw figures, --junit writes XML",
          ending);
  return table;
}

bool is_json_flag(const std::string& word) {
  return word_flag<bool>("--format", word, {{"table", false}, {"json", true}});
}

std::chrono::nanoseconds duration_flag(const std::string& flag, const std::string& text) {
  return read_flag(flag, [&] { return campaign::positive_duration(text); });
}

std::uint64_t bytes_flag(const std::string& flag, const std::string& text) {
  return read_flag(flag, [&] { return campaign::bytes_of(text); });
}

std::unique_ptr<watch::Metrics> metrics_at(const std::string& address) {
  if (address.empty()) return nullptr;
  try {
    auto metrics = std::make_unique<watch::Metrics>(address);
    print_error(fmt::format("metrics are at http://{}/metrics", metrics->address()));
    return metrics;
  } catch (const std::invalid_argument& error) {
    throw wrong("--metrics: {}", error.what());
  } catch (const std::runtime_error& error) {
    throw campaign::Error(3, fmt::format("--metrics: {}", error.what()));
  }
}

}  // namespace ontime::app
