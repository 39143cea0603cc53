// SPDX-License-Identifier: Apache-2.0
// Queueing disciplines in the words of tc.
#include <algorithm>
#include <sstream>

#include "conditions/around.hpp"

namespace ontime::conditions {
namespace {

// One of tc's words that is neither a path nor an option of tc itself.
bool is_word(const std::string& word) {
  const bool is_negative = word.size() > 1 && word[0] == '-' && word[1] >= '0' && word[1] <= '9';
  return (word[0] != '-' || is_negative) && std::all_of(word.begin(), word.end(), [](char c) {
           return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' ||
                  c == '@' || c == ':' || c == '.' || c == '-';
         });
}

bool is_class(const std::string& text) {
  constexpr std::size_t most_digits = 4;
  return !text.empty() && text.size() <= most_digits &&
         text.find_first_not_of("0123456789abcdef") == text.npos && text.find_first_not_of('0') != text.npos;
}

}  // namespace

const std::vector<std::string>& known_disciplines() {
  static const std::vector<std::string> known{"prio", "mqprio", "taprio", "etf", "cbs"};
  return known;
}

std::vector<Discipline> disciplines_of(const std::string& words) {
  std::vector<Discipline> all(1);
  std::istringstream text(words);
  for (std::string word; text >> word;)
    if (word != "below") {
      all.back().words.push_back(word);
    } else {
      all.emplace_back();
      text >> all.back().below;
    }
  return all;
}

bool is_qdisc(const std::string& words) {
  constexpr std::size_t longest = 2000;
  const auto all = disciplines_of(words);
  return words.size() <= longest && std::ranges::all_of(all, [&](const Discipline& one) {
           const bool is_root = &one == &all.front();
           return !one.words.empty() && std::ranges::count(known_disciplines(), one.words.front()) > 0 &&
                  (is_root || is_class(one.below)) && std::ranges::all_of(one.words, is_word);
         });
}

bool has_etf(const std::string& words) {
  return std::ranges::any_of(disciplines_of(words), [](const Discipline& one) {
    return !one.words.empty() && one.words.front() == "etf";
  });
}

}  // namespace ontime::conditions
