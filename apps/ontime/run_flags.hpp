// SPDX-License-Identifier: Apache-2.0
// The flags of ping and pong that describe a run, made from the table of scenario keys.
#pragma once

#include <map>

#include "campaign/campaign.hpp"
#include "command.hpp"

namespace ontime::app {

class RunFlags {
 public:
  RunFlags(Command&, campaign::Key::For end);
  campaign::Run run() const;  // throws Error{2} that names the flag

 private:
  struct Flag {
    Option* option = nullptr;
    std::string value;
  };
  std::map<std::string, Flag> flags_;  // by path
  std::vector<std::string> options_;
  std::vector<std::string> peers_;
  std::string interface_;
};

}  // namespace ontime::app
