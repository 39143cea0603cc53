// SPDX-License-Identifier: Apache-2.0
// Whether a machine is fit for messages that must arrive on time: a table of short checks, each of which says
// what is, what should be, why, and what mends it. They read files and change nothing. Ordinary thread only.
#pragma once

#include <optional>
#include <string>
#include <vector>

namespace ontime::fitness {

enum class Severity {
  fine,
  hint,   // may cost now and then, or somebody who knows his machine may want it so
  wrong,  // messages will be late by it, or nothing of real-time is to be had: to be mended
};
const char* word_of(Severity);

struct Finding {
  std::string check;  // "governor"
  Severity severity = Severity::fine;
  std::string is;
  std::string should, why, remedy;  // "" where it is fine; the remedy is a command, or says where to do what
};

// What is looked at.
struct Subject {
  std::string root;                     // a folder that stands for "/"; "": the machine itself
  std::vector<std::string> interfaces;  // none: all that are hardware
  std::optional<bool> synchronised;     // its clock, by whoever was asked; nothing: it is not known
};

// In the order of the table. What a machine does not have is not told of.
std::vector<Finding> check(const Subject&);
bool fit(const std::vector<Finding>&);  // nothing is wrong

}  // namespace ontime::fitness
