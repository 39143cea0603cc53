// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "commands.hpp"
#include "flags.hpp"
#include "output.hpp"
#include "report/words.hpp"
#include "scenario/scenario.hpp"
#include "scenario_files.hpp"
#include "table/table.hpp"

namespace ontime::app {
namespace {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

std::vector<std::string> own_files() {
  const auto own = own_scenarios();
  if (own.empty())
    throw orders::Error(3, "no scenarios are installed with this program. Fix: name a file or a folder");
  std::vector<std::string> files;
  for (const auto& name : own_scenario_names()) files.push_back((own / (name + ".yaml")).string());
  return files;
}

// By the name that `ontime run` takes.
std::string name_of(const std::string& file) {
  const auto own = own_scenarios();
  const auto name = fs::path(file).lexically_relative(own);
  if (own.empty() || name.empty() || name.native().starts_with("..")) return file;
  return fs::path(name).replace_extension().string();
}

ordered_json line_of(const std::string& file) {
  ordered_json line = {{"name", name_of(file)}, {"file", file},        {"title", nullptr}, {"runs", nullptr},
                       {"seconds", nullptr},    {"searches", nullptr}, {"error", nullptr}};
  try {
    const auto scenario = scenario::read_scenario(file, {});
    line["title"] = scenario.title;
    line["runs"] = scenario.size();
    line["seconds"] = std::round(scenario::time_of(scenario).count() * 1e3) / 1e3;
    line["searches"] =
        std::ranges::any_of(scenario.runs, [](const scenario::Run& run) { return run.step.of > 0; });
  } catch (const scenario::Error& error) {
    line["error"] = error.what();
  }
  return line;
}

std::string text_of(const std::vector<ordered_json>& lines) {
  const auto columns = reading_columns();
  std::size_t width = 0;
  for (const auto& line : lines)
    width = std::max(width, table::width_of(table::printable(line.at("name"))) + 2);
  std::string text;
  const auto add = [&](const std::string& name, const std::string& what) {
    text += table::labelled(name, what, width, columns);
  };
  for (const auto& line : lines) {
    const auto name = table::printable(line.at("name"));
    if (!line.at("error").is_null()) {
      add(name, "cannot be run: " + table::printable(line.at("error")));
      continue;
    }
    const auto runs = line.at("runs").get<std::size_t>();
    const bool is_of_lab = name.starts_with("lab/") && line.at("file") != name;
    const auto title = table::printable(line.at("title"));
    add(name, fmt::format("{}{}{}{}, {}{}", title, title.empty() ? "" : ": ",
                          line.at("searches").get<bool>() ? "at most " : "", table::many(runs, "run", "runs"),
                          about(std::chrono::duration<double>(line.at("seconds").get<double>())),
                          is_of_lab ? simulated_time : ""));
  }
  return text;
}

}  // namespace

void add_scenarios(Command& app) {
  auto* command = app.add_subcommand("scenarios", "Lists scenarios with title, number of runs and duration");
  struct Arguments {
    std::vector<std::string> names;
    std::string format = "table";
  };
  auto arguments = std::make_shared<Arguments>();
  command->add_option("SCENARIO", arguments->names,
                      "scenario files, folders, or names (default: all installed scenarios)");
  add_format(*command, arguments->format);
  command->calls([arguments] {
    const bool as_json = is_json_flag(arguments->format);
    const auto files = arguments->names.empty() ? own_files() : scenario_files(arguments->names);
    std::vector<ordered_json> lines;
    lines.reserve(files.size());
    for (const auto& file : files) lines.push_back(line_of(file));
    write_whole("", as_json ? report::json_text(ordered_json(lines)) : text_of(lines));
    return std::ranges::all_of(lines, [](const auto& line) { return line.at("error").is_null(); }) ? 0 : 2;
  });
}

}  // namespace ontime::app
