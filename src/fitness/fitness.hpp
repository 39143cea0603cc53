// SPDX-License-Identifier: Apache-2.0
// Whether a machine is ready for messages that must arrive on time: a table of short checks. Each reports the
// current state, the required one, the reason and the fix. They read files and change nothing. Ordinary
// thread only.
#pragma once

#include <optional>
#include <string>
#include <vector>

namespace ontime::fitness {

enum class Severity {
  fine,
  hint,   // may cost time now and then, or may be intended
  wrong,  // makes messages late, or prevents real-time settings
};
const char* word_of(Severity);  // "ok", "warning", "error"

struct Finding {
  Severity severity = Severity::fine;
  std::string is;
  std::string should, why, remedy;  // "" if it is fine; the remedy is a command or an instruction
  std::string check{};              // "governor"
};

// What is checked.
struct Subject {
  std::string root;                     // a folder that stands for "/"; "": the machine itself
  std::vector<std::string> interfaces;  // none: all that are hardware
  std::optional<bool> synchronised;     // if `root` is a folder: its clock; nullopt: unknown
};

// In the order of the table; without checks that do not apply to this machine.
std::vector<Finding> check(const Subject&);
bool fit(const std::vector<Finding>&);               // no errors
std::string counts_of(const std::vector<Finding>&);  // "1 error, 9 warnings"

}  // namespace ontime::fitness
