// SPDX-License-Identifier: Apache-2.0
// What bash and zsh complete, from the command line's own description of itself.
#include <algorithm>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "commands.hpp"
#include "flags.hpp"
#include "scenario_files.hpp"
#include "table/table.hpp"
#include "terminal.hpp"
#include "transport/transport.hpp"

namespace ontime::app {
namespace {

// The possible values, from a type name such as "on|off"; none if there are others.
std::vector<std::string> spellings_of(const Option& option) {
  auto words = table::split(option.type_name(), '|');
  std::erase(words, "");
  const auto is_word = [](const std::string& one) {
    return one.find_first_not_of("abcdefghijklmnopqrstuvwxyz-") == one.npos;
  };
  return words.size() > 1 && std::ranges::all_of(words, is_word) ? words : std::vector<std::string>{};
}

// The kind of a value that this machine's files or transports decide.
std::string kind_of(const std::string& name) {
  if (name.starts_with("SCENARIO")) return "scenarios";
  if (name.starts_with("TRANSPORT")) return "transports";
  return name.starts_with("RESULTS") || name == "A" || name == "B" ? "results" : "";
}

// A case for each command, and for each of its options that takes a value.
struct Cases {
  std::string commands, words, values;

  void add(const Command& command, const std::string& path) {
    std::vector<std::string> next;
    std::string kind;
    for (const auto& one : command.subcommands()) {
      if (!one->is_shown()) continue;
      next.push_back(one->name());
      commands += fmt::format("      '{}/{}') command='{}/{}' ;;\n", path, one->name(), path, one->name());
    }
    for (const auto& option : command.options()) {
      if (!option.is_shown()) continue;  // --help hides it, too
      if (option.is_positional() && kind.empty()) kind = kind_of(option.name());
      const auto flags = option.flags();
      next.insert(next.end(), flags.begin(), flags.end());
      const auto few = spellings_of(option);
      if (!option.takes_value() || (few.empty() && option.may_stand_alone())) continue;
      for (const auto& flag : flags)
        values += fmt::format("    '{} {}') words='{}' kind='{}' ;;\n", path, flag, fmt::join(few, " "),
                              flag == "--results" ? "results" : kind_of(option.type_name()));
    }
    words += fmt::format("    '{}') words='{}' kind='{}' ;;\n", path, fmt::join(next, " "), kind);
    for (const auto& one : command.subcommands())
      if (one->is_shown()) add(*one, path + '/' + one->name());
  }
};

std::string function(const Command& app) {
  Cases cases;
  cases.add(app, "");
  return fmt::format(R"sh(_ontime_words() {{
  local command='' words='' kind='' list='' word current="${{COMP_WORDS[COMP_CWORD]}}"
  for word in "${{COMP_WORDS[@]:1:COMP_CWORD-1}}"; do
    case "$command/$word" in
{}    esac
  done
  case "$command" in
{}  esac
  case "$command ${{COMP_WORDS[COMP_CWORD-1]}}" in
{}  esac
  case "$kind" in
    scenarios | transports) [[ $current == -* ]] || words=$("${{COMP_WORDS[0]}}" completion "$kind" 2>/dev/null) ;;
    results) [[ $current == -* ]] || words='' ;;
  esac
  [[ $current != *,* ]] || list="${{current%,*}},"
  COMPREPLY=($(compgen -P "$list" -W "$words" -- "${{current##*,}}"))
  [[ $current != -* ]] || return
  local IFS=$'\n'
  case "$kind" in
    scenarios) COMPREPLY+=($(compgen -f -X '!*.yaml' -- "$current")) ;;
    results) COMPREPLY+=($(compgen -f -X '!*.ontime' -- "$current")) ;;
  esac
}}
)sh",
                     cases.commands, cases.words, cases.values);
}

std::string text_for(const Command& app, const std::string& what) {
  if (what == "bash") return function(app) + "complete -o default -F _ontime_words ontime\n";
  if (what == "zsh")
    return "#compdef ontime\nautoload -Uz bashcompinit && bashcompinit\n" + function(app) +
           "_bash_complete -o default -F _ontime_words\n";
  if (what == "scenarios") return fmt::format("{}\n", fmt::join(own_scenario_names(), "\n"));
  if (what == "transports") return fmt::format("{}\n", fmt::join(transport::available(), "\n"));
  throw wrong("SHELL: '{}' is not one of bash, zsh", what);
}

}  // namespace

void add_completion(Command& app) {
  auto* command = app.add_subcommand("completion", "Prints the completion script for bash or zsh");
  command->footer(
      "For this shell: source <(ontime completion bash)\n"
      "For every new shell: ontime completion bash | sudo tee /usr/share/bash-completion/completions/ontime "
      ">/dev/null");
  auto shell = std::make_shared<std::string>();
  command->add_option("SHELL", *shell, "bash or zsh")->required();
  command->calls([&app, shell] {
    print(text_for(app, *shell));
    return 0;
  });
}

}  // namespace ontime::app
