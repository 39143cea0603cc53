// SPDX-License-Identifier: Apache-2.0
#include "command.hpp"

#include <algorithm>
#include <filesystem>
#include <iostream>
#include <sstream>
#include <system_error>
#include <utility>

#include <CLI/CLI.hpp>
#include <boost/algorithm/string/trim.hpp>
#include <fmt/format.h>
#include <unistd.h>

#include "output.hpp"
#include "spelling/spelling.hpp"
#include "table/table.hpp"
#include "terminal.hpp"
#include "transport/transport.hpp"

namespace ontime::app {
namespace {

namespace fs = std::filesystem;

// "ontime tune apply".
std::string path_of(const CLI::App& command) {
  return (command.get_parent() == nullptr ? "" : path_of(*command.get_parent()) + " ") + command.get_name();
}

// What the user may have meant by the first word that the command does not know.
std::string meant(const CLI::App& command, const std::vector<std::string>& unknown) {
  if (unknown.empty()) return "";
  const auto word = unknown.front().substr(0, unknown.front().find('='));
  std::vector<std::string> words;
  if (word.starts_with('-')) {
    for (const auto* option : command.get_options())
      if (!option->get_group().empty())
        for (const auto& name : option->get_lnames()) words.push_back("--" + name);
    if (std::ranges::count(words, word) > 0)
      return fmt::format(". Fix: write {} after {}", word, path_of(command));
  } else {
    for (const auto* one : command.get_subcommands({})) {
      if (!one->get_group().empty()) words.push_back(one->get_name());
      for (const auto* below : one->get_subcommands({}))
        if (below->get_name() == word)
          return fmt::format(" (did you mean '{} {}'?)", one->get_name(), below->get_name());
    }
  }
  return spelling::suggestion(word, words);
}

// A value without its option: --help lists settings as NAME=VALUE, and ping(8) takes an address.
std::string as_value(const CLI::App& command, const std::string& word) {
  const auto takes = [&](const char* flag) { return command.get_option_no_throw(flag) != nullptr; };
  const auto has = [&](const char* any) { return word.find_first_of(any) != word.npos; };
  const auto transports = transport::available();
  std::error_code none;
  const bool is_file = fs::is_regular_file(word, none);
  const bool may_be_run =
      !is_file && fs::path(word).extension().string().size() <= 2;  // "Test1.A", not "a.svg"
  const auto* const flag = word.starts_with('-')                                              ? ""
                           : takes("--set") && has("=")                                       ? "--set "
                           : takes("--transport") && std::ranges::count(transports, word) > 0 ? "--transport "
                           : takes("--scenario") && (is_file || word.ends_with(".yaml"))      ? "--scenario "
                           : takes("--peer") && has(".:")                                     ? "--peer "
                           : takes("--only") && takes("RESULTS") && may_be_run                ? "--only "
                                                                                              : "";
  return *flag == '\0' ? "" : std::string(". Fix: ") + flag + table::shell_line({word});
}

// The command that the user named: CLI11 reports a command's errors as the program's own.
const CLI::App& named(const CLI::App& from) {
  const auto chosen = from.get_subcommands();
  return chosen.empty() ? from : named(*chosen.back());
}

std::string message_of(const CLI::App* from, const CLI::Error& error) {
  const auto& command = named(*from);
  auto unknown = command.remaining(true);
  if (unknown.empty()) unknown = from->remaining(true);  // before the command: "ontime me ping"
  std::string text = error.what();
  const bool lacks_command =
      dynamic_cast<const CLI::RequiredError*>(&error) != nullptr && !command.get_subcommands({}).empty();
  if (!unknown.empty() && (lacks_command || dynamic_cast<const CLI::ExtrasError*>(&error) != nullptr))
    text = fmt::format("{} '{}'",
                       unknown.front().starts_with('-') ? "unknown option"
                       : lacks_command                  ? "unknown command"
                                                        : "unexpected argument",
                       unknown.front());
  // CLI11 counts: "--duration: At Most 1 required but received 2".
  else if (const auto end = text.find(": At Most 1 required"); end != text.npos)
    text.replace(end, text.npos, " is given twice");
  if (!unknown.empty()) text += as_value(command, unknown.front());
  return "ontime: " + table::printable(text) + meant(command, unknown) + "\nSee: " + path_of(command) +
         " --help\n";
}

}  // namespace

void Option::group(const std::string& title) { option_->group(title); }
void Option::required() { option_->required(); }
Option* Option::given() {
  const auto flaw = [](const std::string& value) { return value.empty() ? "a value is needed" : ""; };
  option_->check(CLI::Validator(flaw, ""));
  return this;
}
void Option::in_a_folder() {
  const auto flaw = [](const std::string& file) -> std::string {
    const auto name = table::printable(file);
    std::error_code none, unknown;
    if (fs::is_directory(file, none)) return name + " is a folder. Fix: name a file in it";
    const auto folder = fs::path(file).has_parent_path() ? fs::path(file).parent_path() : fs::path(".");
    // Where it cannot be looked for, opening the file says why.
    return fs::is_directory(folder, unknown) || (unknown && unknown != std::errc::no_such_file_or_directory &&
                                                 unknown != std::errc::not_a_directory)
               ? ""
               : fmt::format("{}: {} is no folder. Fix: make it first", name,
                             table::printable(folder.string()));
  };
  option_->check(CLI::Validator(flaw, ""));
}
void Option::range(int least, int most) { option_->check(CLI::Range(least, most)); }
Option* Option::one_a_flag() {
  option_->allow_extra_args(false);
  return this;
}
void Option::comma_separated() { option_->delimiter(','); }
void Option::without_value() { option_->expected(0, 1); }
Option* Option::excludes(const std::string& flag) {
  option_->excludes(flag);
  return this;
}
void Option::needs(const std::string& flag) { option_->needs(flag); }

std::size_t Option::count() const { return option_->count(); }
bool Option::is_shown() const { return !option_->get_group().empty(); }
bool Option::is_positional() const { return option_->get_positional(); }
bool Option::takes_value() const { return option_->get_items_expected_max() > 0; }
bool Option::may_stand_alone() const { return option_->get_items_expected_min() == 0; }
std::vector<std::string> Option::flags() const {
  auto names = option_->get_lnames();
  for (auto& name : names) name.insert(0, "--");
  return names;
}
std::string Option::name() const { return option_->get_name(); }
std::string Option::type_name() const { return option_->get_type_name(); }

Command::Command(CLI::App* app, Action& chosen) : app_(app), chosen_(chosen) { keep(app_->get_help_ptr()); }

Option* Command::keep(CLI::Option* option) { return &options_.emplace_back(option); }

Command* Command::add_subcommand(const std::string& name, const std::string& help) {
  return commands_.emplace_back(std::make_unique<Command>(app_->add_subcommand(name, help), chosen_)).get();
}

template <class Value>
Option* Command::add_option(const std::string& flags, Value& value, const std::string& help,
                            const std::string& what) {
  auto* const option = app_->add_option(flags, value, help);
  // CLI11 takes the next word, whatever it is.
  const auto flaw = [](const std::string& word) {
    return word == "-h" || (word.size() > 2 && word.starts_with("--")) ? "a value is missing before " + word
                                                                       : "";
  };
  if (!option->get_positional()) option->check(CLI::Validator(flaw, ""));
  return keep(what.empty() && !option->get_positional() ? option : option->type_name(what));
}
using Text = const std::string&;
template Option* Command::add_option(Text, std::string&, Text, Text);
template Option* Command::add_option(Text, std::vector<std::string>&, Text, Text);
template Option* Command::add_option(Text, std::optional<int>&, Text, Text);
template Option* Command::add_option(Text, std::optional<std::int64_t>&, Text, Text);
Option* Command::add_flag(const std::string& flags, bool& value, const std::string& help) {
  return keep(app_->add_flag(flags, value, help));
}

Command* Command::group(const std::string& title) {
  app_->group(title);
  return this;
}
void Command::footer(const std::string& text) { app_->footer(text); }
void Command::require_subcommand() { app_->require_subcommand(1); }
void Command::calls(Action action) {
  app_->callback([this, action = std::move(action)] { chosen_ = action; });
}

std::string Command::name() const { return app_->get_name(); }
bool Command::is_shown() const { return !app_->get_group().empty(); }

namespace {

constexpr std::size_t help_column = 34;  // where descriptions start

// Help text, wrapped to this many columns.
std::string fitted(const std::string& help, std::size_t columns) {
  std::string text;
  for (const auto& line : table::split(help, '\n')) {
    // CLI11 ends a group of hidden options with an empty line, too.
    if (line.empty() && text.ends_with("\n\n")) continue;
    if (table::width_of(line) <= columns) {
      text += line + "\n";
    } else if (!line.starts_with("  ")) {
      text += table::wrapped(line, columns);
    } else if (line.size() <= help_column || line[help_column - 1] != ' ') {
      text += table::wrapped(boost::algorithm::trim_copy(line), columns, "  ");
    } else {
      const auto name = boost::algorithm::trim_right_copy(line.substr(0, help_column));
      const bool beside = columns >= table::fewest_for_two;
      auto what =
          table::wrapped(line.substr(help_column), columns, std::string(beside ? help_column : 4, ' '));
      if (beside)
        what.replace(0, name.size(), name);
      else if (!name.empty())
        text += name + "\n";
      text += what;
    }
  }
  text.pop_back();  // the newline after the last line
  return text;
}

}  // namespace

Program::Program(const std::string& name, const std::string& help, const std::string& version)
    : app_(std::make_unique<CLI::App>(help, name)), command_(app_.get(), chosen_) {
  app_->set_version_flag("--version", version);
  app_->get_formatter()->column_width(help_column);
  app_->get_formatter()->label("REQUIRED", "(required)");
  app_->failure_message(message_of);
}
Program::~Program() = default;

Action Program::parse(int argc, char** argv) {
  std::vector<std::string> words(argv + std::min(argc, 1), argv + argc);
  // "ontime help ping", as other programs have it. An unknown command is refused below.
  if (!words.empty() && words.front() == "help") {
    words.erase(words.begin());
    const auto is_first = [&](const CLI::App* command) { return command->get_name() == words.front(); };
    if (words.empty() || !app_->get_subcommands(is_first).empty()) words.emplace_back("--help");
  }
  std::ranges::reverse(words);  // as CLI11 takes them
  try {
    app_->parse(std::move(words));
    return chosen_;
  } catch (const CLI::ParseError& error) {
    std::ostringstream help;
    std::ostringstream wrong;
    const int code = app_->exit(error, help, wrong) == 0 ? 0 : 2;
    if (!help.str().empty()) print(fitted(help.str(), reading_columns()));
    std::cerr << for_terminal(wrong.str(), STDERR_FILENO);
    return [code] { return code; };
  }
}

}  // namespace ontime::app
