// SPDX-License-Identifier: Apache-2.0
#include "foreign/histogram.hpp"

#include <fmt/format.h>

#include "record/record.hpp"

namespace ontime::foreign {
namespace {

constexpr std::size_t most_values = 200'000;                  // different ones, that a run's record holds
constexpr std::uint64_t most_ns = std::uint64_t{1} << 60U;    // 36 years
constexpr std::uint64_t most_seen = std::uint64_t{1} << 53U;  // exact in every reader's numbers

}  // namespace

void fail(const std::string& file, const std::string& where, const std::string& what) {
  throw record::WrongFile(
      fmt::format("{}: {}{}{}. Nothing was imported.", file, where, where.empty() ? "" : ": ", what));
}

nlohmann::json json_of(const Histogram& of, std::int64_t unit_ns, const std::string& file,
                       const std::string& where) {
  const auto unit = static_cast<std::uint64_t>(unit_ns);
  const auto wrong = [&](const std::string& what) { fail(file, where, what); };
  if (of.values.empty())
    wrong("there is no value in its histogram; cyclictest keeps values up to the N of -h N");
  if (of.values.size() > most_values)
    wrong(fmt::format("it has {} different values; at most {} can be kept", of.values.size(), most_values));
  if (of.max > most_ns / unit) wrong(fmt::format("a maximum of {} cannot be", of.max));
  if (!(of.mean >= 0 && of.mean <= static_cast<double>(of.max)))
    wrong(fmt::format("its mean, {}, is not between 0 and its maximum, {}", of.mean, of.max));
  std::uint64_t seen = of.beyond;
  if (seen > most_seen) wrong("more values than any run has");
  for (const auto& [value, count] : of.values)
    if (count > most_seen || (seen += count) > most_seen) wrong("more values than any run has");
  const auto [least, greatest] = std::pair(of.values.front().first, of.values.back().first);
  if (of.min != least)
    wrong(fmt::format("it says that the least value is {}, and its histogram begins with {}", of.min, least));
  if (of.beyond == 0 ? of.max != greatest : of.max < of.beyond_from)
    wrong(fmt::format("it says that the greatest value is {}, and its histogram ends with {}{}", of.max,
                      greatest, of.beyond == 0 ? "" : " and values beyond"));

  auto values = nlohmann::json::array();
  for (const auto& [value, count] : of.values) values.push_back({value * unit, count});
  return {{"of", "wake-up"},
          {"unit_ns", unit_ns},
          {"values", std::move(values)},
          {"beyond", of.beyond},
          {"beyond_from_ns", of.beyond == 0 ? 0 : of.beyond_from * unit},
          {"max_ns", of.max * unit},
          {"mean_ns", of.mean * static_cast<double>(unit)}};
}

}  // namespace ontime::foreign
