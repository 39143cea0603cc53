// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <sstream>

#include <fmt/format.h>

#include "report/runs.hpp"
#include "report/words.hpp"

namespace ontime::report {
namespace {

using nlohmann::json;

// How a run ended, if not as asked.
std::string ending(const json& outcome) {
  if (outcome.is_null()) return "not ended (cut off, or still running): shown is what is recorded";
  if (const auto& error = at(outcome, "error"); !error.is_null()) return "failed: " + word(error);
  return is_true(at(outcome, "interrupted")) ? "interrupted before its end" : "";
}

std::string many(std::uint64_t number, const char* one, const char* several) {
  return fmt::format("{} {}", number, number == 1 ? one : several);
}

struct Refused {
  std::string found, remedy;
  std::vector<std::string> asked;
};

// As word(), but lines stay lines, for they are to be copied.
std::string lines(const nlohmann::json& value) {
  if (!value.is_string()) return word(value);
  std::istringstream text(value.get<std::string>());
  std::vector<std::string> result;
  for (std::string line; std::getline(text, line);) result.push_back(word(line));
  return join(result, "\n");
}

}  // namespace

std::string remarks(const statistics::Summary& summary) {
  const auto& outcome = summary.run.outcome;
  std::vector<std::string> parts;
  if (const auto text = ending(outcome); !text.empty()) parts.push_back(text);
  for (const auto& [host, facts] : at(outcome, "hosts").items())
    if (at(facts, "load_running") == false)
      parts.push_back("the load on the " + word(host) + " had died by the end");
  if (summary.skipped_cycles > 0)
    parts.push_back(
        many(summary.skipped_cycles, "skipped cycle", "skipped cycles") +
        fmt::format(" (response time up to {} µs)", microseconds(static_cast<double>(summary.response.max))));
  const struct {
    const char *key, *one, *several;
  } counters[] = {{"duplicates", "duplicate", "duplicates"},
                  {"strays", "stray answer", "stray answers"},
                  {"reordered", "answer out of order", "answers out of order"},
                  {"refused_sends", "message refused by the transport", "messages refused by the transport"},
                  {"dropped_records", "sample not recorded, and missing above",
                   "samples not recorded, and missing above"}};
  for (const auto& [key, one, several] : counters)
    if (const auto number = count(at(outcome, key)); number > 0) parts.push_back(many(number, one, several));
  return join(parts, "; ");
}

std::vector<std::string> refusals(const Summaries& summaries) {
  std::vector<Refused> all;
  for (const auto& summary : summaries) {
    for (const auto& [host, facts] : at(summary.run.outcome, "hosts").items()) {
      for (const auto& [index, refusal] : at(facts, "refusals").items()) {
        const auto asked = word(at(refusal, "asked")), found = word(at(refusal, "found")),
                   remedy = lines(at(refusal, "remedy"));
        auto same = std::find_if(all.begin(), all.end(), [&](const auto& other) {
          return other.found == found && other.remedy == remedy;
        });
        if (same == all.end()) same = all.insert(all.end(), {found, remedy, {}});
        if (std::find(same->asked.begin(), same->asked.end(), asked) == same->asked.end())
          same->asked.push_back(asked);
      }
    }
  }
  std::vector<std::string> notes;
  notes.reserve(all.size());
  for (const auto& refused : all)
    notes.push_back(fmt::format("Asked but not given: {};\nfound: {};\nto permit it: {}",
                                join(refused.asked, ", "), refused.found, refused.remedy));
  return notes;
}

}  // namespace ontime::report
