// SPDX-License-Identifier: Apache-2.0
// What bash and zsh complete, from the command line's own description of itself.
#include <algorithm>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "campaign/campaign.hpp"
#include "commands.hpp"
#include "terminal.hpp"

namespace ontime::app {
namespace {

// "on|off": what may stand there, if it is one of a few words.
std::vector<std::string> words_of(const Option& option) {
  std::vector<std::string> words;
  std::string word;
  for (const char c : option.type_name() + '|') {
    if (c != '|') {
      word += c;
    } else if (!word.empty()) {
      words.push_back(std::exchange(word, ""));
    }
  }
  const auto is_word = [](const std::string& one) {
    return std::all_of(one.begin(), one.end(), [](char c) { return (c >= 'a' && c <= 'z') || c == '-'; });
  };
  return words.size() > 1 && std::all_of(words.begin(), words.end(), is_word) ? words
                                                                              : std::vector<std::string>{};
}

// A case for each command, and for each of its options that takes one of a few words.
struct Cases {
  std::string commands, words, values;

  void add(const Command& command, const std::string& path) {
    std::vector<std::string> next;
    for (const auto& one : command.subcommands()) {
      if (!one->is_shown()) continue;
      next.push_back(one->name());
      commands += fmt::format("      '{}/{}') command='{}/{}' ;;\n", path, one->name(), path, one->name());
    }
    for (const auto& option : command.options()) {
      if (!option->is_shown()) continue;  // which no help names either
      const auto flags = option->flags();
      next.insert(next.end(), flags.begin(), flags.end());
      if (const auto few = words_of(*option); !few.empty())
        for (const auto& flag : flags)
          values += fmt::format("    '{} {}') words='{}' ;;\n", path, flag, fmt::join(few, " "));
    }
    words += fmt::format("    '{}') words='{}' ;;\n", path, fmt::join(next, " "));
    for (const auto& one : command.subcommands())
      if (one->is_shown()) add(*one, path + '/' + one->name());
  }
};

std::string function(const Command& app) {
  Cases cases;
  cases.add(app, "");
  return fmt::format(R"sh(_ontime_words() {{
  local command='' words='' word
  for word in "${{COMP_WORDS[@]:1:COMP_CWORD-1}}"; do
    case "$command/$word" in
{}    esac
  done
  case "$command" in
{}  esac
  case "$command ${{COMP_WORDS[COMP_CWORD-1]}}" in
{}  esac
  COMPREPLY=($(compgen -W "$words" -- "${{COMP_WORDS[COMP_CWORD]}}"))
}}
)sh",
                     cases.commands, cases.words, cases.values);
}

}  // namespace

void add_completion(Command& app, Action& action) {
  auto* command =
      app.add_subcommand("completion", "What bash or zsh needs to complete this command line")->group("");
  auto shell = std::make_shared<std::string>();
  command->add_option("SHELL", *shell, "bash or zsh")->required();
  command->callback([&app, &action, shell] {
    action = [&app, shell] {
      if (*shell == "bash")
        print(function(app) + "complete -o default -F _ontime_words ontime\n");
      else if (*shell == "zsh")
        print("#compdef ontime\nautoload -Uz bashcompinit && bashcompinit\n" + function(app) +
              "_bash_complete -o default -F _ontime_words\n");
      else
        throw campaign::Error(2, fmt::format("'{}' is neither bash nor zsh", *shell));
      return 0;
    };
  });
}

}  // namespace ontime::app
