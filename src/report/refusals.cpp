// SPDX-License-Identifier: Apache-2.0
// Settings that were requested, and denied: those with one fix together.
#include <algorithm>

#include <fmt/format.h>

#include "report/report.hpp"
#include "report/runs.hpp"
#include "report/words.hpp"

namespace ontime::report {
namespace {

// What one remedy permits.
struct Refused {
  std::string remedy;
  std::vector<std::string> found, asked;
};

void add_once(std::vector<std::string>& all, const std::string& text) {
  if (std::find(all.begin(), all.end(), text) == all.end()) all.push_back(text);
}

// Its lines stay lines, for they are to be copied.
std::string printable_lines(const std::string& text) {
  auto lines = split(text, '\n');
  if (lines.back().empty()) lines.pop_back();
  for (auto& line : lines) line = printable(line);
  return join(lines, "\n");
}

void add_refusals(std::vector<Refused>& all, const record::Host& end) {
  for (const auto& refusal : end.refusals) {
    const auto asked = word(refusal.asked), found = word(refusal.found),
               remedy = printable_lines(refusal.remedy);
    auto same =
        std::find_if(all.begin(), all.end(), [&](const auto& other) { return other.remedy == remedy; });
    if (same == all.end()) same = all.insert(all.end(), {remedy, {}, {}});
    add_once(same->found, found);
    add_once(same->asked, asked);
  }
}

std::vector<std::string> notes_of(const std::vector<Refused>& all) {
  std::vector<std::string> notes;
  notes.reserve(all.size());
  for (const auto& refused : all)
    notes.push_back(fmt::format("Requested, denied: {};\nfound: {};\nfix: {}", join(refused.asked, ", "),
                                join(refused.found, "; "), refused.remedy));
  return notes;
}

}  // namespace

std::vector<std::string> refusals(const Summaries& summaries) {
  std::vector<Refused> all;
  for (const auto& summary : summaries)
    for (const auto& [host, end] : summary.run.outcome.hosts) add_refusals(all, end);
  return notes_of(all);
}

std::vector<std::string> refusals_of(const record::Host& end) {
  std::vector<Refused> all;
  add_refusals(all, end);
  return notes_of(all);
}

}  // namespace ontime::report
