// SPDX-License-Identifier: Apache-2.0
// Settings that were requested, and denied: those with one fix together.
#include <utility>

#include <fmt/format.h>

#include "report/report.hpp"
#include "report/runs.hpp"
#include "report/words.hpp"

namespace ontime::report {
namespace {

// By remedy, what it permits.
struct Refused {
  std::vector<std::string> found, asked;
};
using ByRemedy = std::vector<std::pair<std::string, Refused>>;

void add_refusals(ByRemedy& all, const record::Host& end) {
  for (const auto& refusal : end.refusals) {
    auto remedy = table::printable_lines(refusal.remedy);  // which are to be copied
    if (remedy.ends_with('\n')) remedy.pop_back();
    auto& [found, asked] = entry_of(all, remedy);
    add_once(found, word(refusal.found));
    add_once(asked, word(refusal.asked));
  }
}

std::vector<std::string> notes_of(const ByRemedy& all) {
  std::vector<std::string> notes;
  notes.reserve(all.size());
  for (const auto& [remedy, refused] : all)
    notes.push_back(fmt::format("Requested, denied: {};\nfound: {};\nfix: {}", join(refused.asked, ", "),
                                join(refused.found, "; "), remedy));
  return notes;
}

}  // namespace

std::vector<std::string> refusals(const Summaries& summaries) {
  ByRemedy all;
  for (const auto& summary : summaries)
    for (const auto& [host, end] : summary.run.outcome.hosts) add_refusals(all, end);
  return notes_of(all);
}

std::vector<std::string> refusals_of(const record::Host& end) {
  ByRemedy all;
  add_refusals(all, end);
  return notes_of(all);
}

}  // namespace ontime::report
