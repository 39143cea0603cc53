// SPDX-License-Identifier: Apache-2.0
// A command line: commands, their options, and what --help says. It hides CLI11, which costs every file that
// includes it five seconds of compiling.
#pragma once

#include <cstdint>
#include <functional>
#include <list>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace CLI {
class App;
class Option;
}  // namespace CLI

namespace ontime::app {

using Action = std::function<int()>;  // returns the exit code

class Option {
 public:
  explicit Option(CLI::Option* option) : option_(option) {}
  Option(const Option&) = delete;
  Option& operator=(const Option&) = delete;

  void group(const std::string& title);  // in --help; "": --help hides it
  void required();
  Option* given();     // refuses an empty value, such as a script's unset variable
  void in_a_folder();  // refuses a file where none can be made: a folder, or one in a missing folder
  void range(int least, int most);
  Option* one_a_flag();                       // each value of a list has its own flag …
  void comma_separated();                     // … or stands behind a comma
  void without_value();                       // its value can be left out
  Option* excludes(const std::string& flag);  // a flag that was added before
  void needs(const std::string& flag);        // a flag that was added before

  std::size_t count() const;  // how often the user gave it
  bool is_shown() const;      // in --help
  bool is_positional() const;
  bool takes_value() const;
  bool may_stand_alone() const;            // without its value
  std::vector<std::string> flags() const;  // "--only"; without those of one letter
  std::string name() const;                // "--only", or "RESULTS"
  std::string type_name() const;

 private:
  CLI::Option* option_;
};

class Command {
 public:
  Command(CLI::App* app, Action& chosen);
  Command(const Command&) = delete;
  Command& operator=(const Command&) = delete;

  // Options and commands live as long as this one. A value must live until the command has run.
  Command* add_subcommand(const std::string& name, const std::string& help);
  // A string, a list of strings, or an optional number. --help calls the value `what`; of "on|off" shells
  // complete the words.
  template <class Value>
  Option* add_option(const std::string& flags, Value& value, const std::string& help,
                     const std::string& what = "");
  Option* add_flag(const std::string& flags, bool& value, const std::string& help);

  Command* group(const std::string& title);  // in --help; "": --help hides it
  void footer(const std::string& text);
  void require_subcommand();
  void calls(Action);  // if the user names it, after the whole command line is parsed

  std::string name() const;
  bool is_shown() const;
  const std::vector<std::unique_ptr<Command>>& subcommands() const { return commands_; }
  const std::list<Option>& options() const { return options_; }

 private:
  Option* keep(CLI::Option*);
  CLI::App* app_;
  Action& chosen_;
  std::vector<std::unique_ptr<Command>> commands_;
  std::list<Option> options_;  // --help first
};

// The root of all commands.
class Program {
 public:
  Program(const std::string& name, const std::string& help, const std::string& version);
  ~Program();
  Command& command() { return command_; }
  // The requested action. Prints --help and errors itself; then the action only returns the exit code.
  Action parse(int argc, char** argv);

 private:
  std::unique_ptr<CLI::App> app_;
  Action chosen_;
  Command command_;
};

}  // namespace ontime::app
