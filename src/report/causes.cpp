// SPDX-License-Identifier: Apache-2.0
#include "report/causes.hpp"

#include <algorithm>
#include <cstdlib>
#include <map>
#include <regex>
#include <utility>

#include <fmt/format.h>

namespace ontime::report {
namespace {

struct Gathered {
  std::vector<const record::Note*> notes{};
  std::vector<std::pair<double, double>> times{};  // of each time in the text: shortest and longest, in ms
  bool has_same_details = true;                    // all of them
  std::vector<std::string> details{};
};

std::string undated(const std::string& text) { return text.substr(date_of(text).size()); }

// Calls the functions with the pieces of a text that `ontime listen` noted, in order: what is equal for the
// same cause, the number of a time in ms, and a detail: a CPU, how many other threads ran, the number of a
// process other than the late one.
template <class Equal, class Time, class Detail>
void each_piece(const std::string& text, const Equal& equal, const Time& time, const Detail& detail) {
  static const std::regex varies(
      R"(\b\d{1,9}\.\d(?= ms)|, CPU \d{1,5}| \[\d{1,10}\]| \d{1,5}(?= others \())");
  std::string late_one;
  auto rest = text.begin();
  for (std::sregex_iterator next(text.begin(), text.end(), varies), end; next != end; ++next) {
    equal(std::string(rest, (*next)[0].first));
    rest = (*next)[0].second;
    const auto piece = next->str();
    if (piece.starts_with(" [") && late_one.empty()) late_one = piece;
    if (piece == late_one)
      equal(piece);
    else if (piece.find_first_not_of("0123456789.") == piece.npos)
      time(std::strtod(piece.c_str(), nullptr));
    else
      detail(piece);
  }
  equal(std::string(rest, text.end()));
}

SameCause told_by(Gathered gathered) {
  std::string text;
  auto time = gathered.times.begin();
  each_piece(
      undated(gathered.notes.front()->text), [&](const std::string& piece) { text += piece; },
      [&](double) {
        const auto [least, most] = *time++;
        text += least == most ? fmt::format("{:.1f}", most) : fmt::format("{:.1f} to {:.1f}", least, most);
      },
      [&](const std::string& piece) { text += gathered.has_same_details ? piece : ""; });
  const std::string before_fix = "; fix: ";
  const auto fix = text.find(before_fix);
  if (fix == text.npos) return {std::move(gathered.notes), std::move(text)};
  return {std::move(gathered.notes), text.substr(0, fix), text.substr(fix + before_fix.size())};
}

}  // namespace

std::string date_of(const std::string& text) {
  static const std::regex date(R"(\d{4}-\d\d-\d\d \d\d:\d\d:\d\d  )");
  std::smatch found;
  return std::regex_search(text, found, date, std::regex_constants::match_continuous) ? found.str() : "";
}

std::vector<SameCause> same_causes_of(const std::vector<const record::Note*>& notes) {
  std::vector<Gathered> all;
  // By what is equal and how many times are between; the text may contain anything.
  std::map<std::pair<std::string, std::size_t>, std::size_t> places;
  for (const auto* note : notes) {
    std::string key;
    std::vector<double> times;
    std::vector<std::string> details;
    each_piece(
        undated(note->text), [&](const std::string& piece) { key += piece; },
        [&](double ms) {
          key += '\0';
          times.push_back(ms);
        },
        [&](const std::string& piece) { details.push_back(piece); });
    const auto [place, is_new] = places.try_emplace({key, times.size()}, all.size());
    if (is_new) {
      all.push_back({.details = details});
      for (const auto ms : times) all.back().times.emplace_back(ms, ms);
    }
    auto& same = all[place->second];
    same.notes.push_back(note);
    same.has_same_details = same.has_same_details && details == same.details;
    for (std::size_t i = 0; i < times.size(); ++i)
      same.times[i] = {std::min(same.times[i].first, times[i]), std::max(same.times[i].second, times[i])};
  }
  std::ranges::stable_sort(all, std::ranges::greater(), [](const auto& same) { return same.notes.size(); });
  std::vector<SameCause> causes;
  causes.reserve(all.size());
  for (auto& gathered : all) causes.push_back(told_by(std::move(gathered)));
  return causes;
}

}  // namespace ontime::report
