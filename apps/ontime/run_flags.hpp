// SPDX-License-Identifier: Apache-2.0
// The flags of ping and pong that say what a run is: made from the table that scenario files are read by.
#pragma once

#include <memory>

#include <CLI/CLI.hpp>

#include "campaign/campaign.hpp"
#include "report/report.hpp"

namespace ontime::app {

class RunFlags {
 public:
  RunFlags(CLI::App&, campaign::Key::For end);
  campaign::Run run() const;  // throws Error{2} that names the flag

 private:
  struct Flag {
    CLI::Option* option = nullptr;
    std::string value;
  };
  std::map<std::string, Flag> flags_;  // by path
  std::vector<std::string> options_;
  std::vector<std::string> peers_;
  std::string interface_;
};

// Refuses an empty value, which a script's unset variable is.
extern const CLI::Validator given;

// A flag that takes a word or a quantity, checked as such.
report::Format format_flag(const std::string& word);
std::chrono::nanoseconds duration_flag(const std::string& flag, const std::string& text);

}  // namespace ontime::app
