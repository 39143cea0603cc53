// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cctype>
#include <map>
#include <tuple>

#include <fmt/format.h>

#include "report/runs.hpp"
#include "report/words.hpp"

namespace ontime::report {
namespace {

using record::LateCause;

// Between the times of these two.
std::string sentence_between(const LateCause& least, const LateCause& most, bool with_details) {
  const auto between = [&](std::int64_t low_ns, std::int64_t high_ns) {
    const auto low = milliseconds(static_cast<double>(low_ns)),
               high = milliseconds(static_cast<double>(high_ns));
    return low == high ? high : low + " to " + high;
  };
  auto text =
      fmt::format("{} ms {} (limit {:g} ms): {}", between(least.value_ns, most.value_ns),
                  most.measures == "age" ? "old" : "after the previous message",
                  static_cast<double>(most.limit_ns) / 1e6, with_details ? most.sentence : most.alike);
  if (most.ns != 0) text += fmt::format(": {} ms", between(least.ns, most.ns));
  if (with_details && most.cpu) text += fmt::format(", CPU {}", *most.cpu);
  return text;
}

// Without the fix. Each number counts as the same, but not the digits of a name, such as "camera1".
std::string without_numbers(const std::string& text) {
  constexpr char number = '\0';
  std::string rest;
  for (const char next : text.substr(0, text.find("; fix: "))) {
    const auto before = static_cast<unsigned char>(rest.empty() ? ' ' : rest.back());
    if (std::isdigit(static_cast<unsigned char>(next)) == 0 || std::isalnum(before) != 0 || before == '_')
      rest += next;
    else if (rest.empty() || rest.back() != number)
      rest += number;
  }
  return rest;
}

void tell(SameCause& same) {
  std::ranges::stable_sort(same.notes, {}, [](const auto* note) { return note->at_ns.value_or(0); });
  const auto& first = same.notes.front()->cause;
  if (!first) {
    const auto& text = same.notes.front()->text;
    const bool is_of_all =
        std::ranges::all_of(same.notes, [&](const auto* note) { return note->text == text; });
    same.text = (is_of_all ? "" : "such as ") + text;
    return;
  }
  auto least = *first, most = *first;
  bool has_same_details = true;
  for (const auto* note : same.notes) {
    const auto& one = *note->cause;
    for (const auto time : {&LateCause::value_ns, &LateCause::ns}) {
      least.*time = std::min(least.*time, one.*time);
      most.*time = std::max(most.*time, one.*time);
    }
    has_same_details &=
        std::tie(one.sentence, one.fix, one.cpu) == std::tie(most.sentence, most.fix, most.cpu);
  }
  same.text = sentence_between(least, most, has_same_details);
  same.fix = has_same_details ? most.fix : most.alike_fix;
}

}  // namespace

std::string text_of(const LateCause& of) {
  return (of.date.empty() ? "" : of.date + "  ") + sentence_between(of, of, true) +
         (of.fix.empty() ? "" : "; fix: " + of.fix);
}

std::string text_of(const record::Note& note) {
  return printable(note.cause ? text_of(*note.cause) : note.text.empty() ? note.kind : note.text);
}

std::vector<SameCause> same_causes_of(const std::vector<const record::Note*>& notes) {
  std::vector<SameCause> causes;
  std::map<std::tuple<bool, std::string, std::int64_t, std::string, std::string, bool>, std::size_t> places;
  for (const auto* note : notes) {
    const auto& of = note->cause;
    const auto key = of ? std::tuple(true, of->measures, of->limit_ns, of->alike, of->alike_fix, of->ns != 0)
                        : std::tuple(false, without_numbers(note->text), std::int64_t{0}, std::string(),
                                     std::string(), false);
    const auto [place, is_new] = places.try_emplace(key, causes.size());
    if (is_new) causes.emplace_back();
    causes[place->second].notes.push_back(note);
  }
  std::ranges::stable_sort(causes, std::ranges::greater(),
                           [](const auto& same) { return same.notes.size(); });
  std::ranges::for_each(causes, tell);
  return causes;
}

}  // namespace ontime::report
