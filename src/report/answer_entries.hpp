// SPDX-License-Identifier: Apache-2.0
// For answer_of(): the rows of the first screen with their runs, and what they must be read with.
#pragma once

#include <string>
#include <vector>

#include "report/answer.hpp"
#include "report/runs.hpp"

namespace ontime::report {

// Stress on the machines and the link, in a word: "load".
struct Stress {
  std::string what;
  bool is_of_another = false;  // component, at the same time
  bool operator==(const Stress&) const = default;
};
// Stress, and the settings against it, in words.
struct Regime {
  std::vector<Stress> stress;
  std::vector<std::string> tuned;
  bool is_listened = false;  // to a robot's own messages
  bool operator==(const Regime&) const = default;
};
Regime regime_of(const statistics::Summary&);
// "load", "traffic beside it", with these words for another component's.
std::vector<std::string> words_of(const std::vector<Stress>&, const char* of_another);

// Repetitions together, in the order of the first.
struct Entry {
  Group runs;
  Answer::Row row;
};
std::vector<Entry> entries_of(const Summaries&, std::optional<std::int64_t> running_from);

double share_of(const Answer::Row&);                              // of its cycles, those not in time
std::string name_of(const Answer::Row&, bool with_id);            // "Test1.B udp", or "udp"
std::vector<std::string> cautions_of(const std::vector<Entry>&);  // the gravest first

}  // namespace ontime::report
