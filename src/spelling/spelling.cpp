// SPDX-License-Identifier: Apache-2.0
#include "spelling/spelling.hpp"

#include <algorithm>
#include <numeric>
#include <utility>

#include <boost/algorithm/string/predicate.hpp>

namespace ontime::spelling {
namespace {

// Damerau–Levenshtein, where no letter is changed twice.
std::size_t changes(const std::string& a, const std::string& b) {
  std::vector<std::size_t> before, last, row(b.size() + 1);
  std::iota(row.begin(), row.end(), 0);
  for (std::size_t i = 1; i <= a.size(); ++i) {
    before = std::exchange(last, row);
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t replaced = a[i - 1] == b[j - 1] ? 0 : 1;
      row[j] = std::min({last[j] + 1, row[j - 1] + 1, last[j - 1] + replaced});
      if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1])
        row[j] = std::min(row[j], before[j - 2] + 1);
    }
  }
  return row.back();
}

}  // namespace

std::string nearest(const std::string& word, const std::vector<std::string>& words) {
  const auto is_it = [&](const auto& one) { return boost::algorithm::iequals(one, word); };
  if (const auto other_case = std::ranges::find_if(words, is_it); !word.empty() && other_case != words.end())
    return *other_case;
  constexpr std::size_t letters_per_change = 3, shortest_beginning = 3;
  std::string found;
  auto least = std::max<std::size_t>(word.size() / letters_per_change, 1) + 1;
  for (const auto& one : words) {
    const bool begins = word.size() >= shortest_beginning && one.starts_with(word);
    const auto needed = begins ? 0 : changes(word, one);
    if (needed >= least || needed >= word.size()) continue;
    least = needed;
    found = one;
  }
  return found;
}

std::string suggestion(const std::string& word, const std::vector<std::string>& words) {
  const auto found = nearest(word, words);
  return found.empty() ? "" : " (did you mean '" + found + "'?)";
}

}  // namespace ontime::spelling
