// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

#include <fmt/format.h>

#include "conditions/conditions.hpp"
#include "number.hpp"

namespace ontime::conditions {
namespace {

// A long double holds every number of nanoseconds or bytes that the result does.
using Units = std::vector<std::pair<std::string, long double>>;

const Units& times() {
  static const Units units{{"ns", 1},  {"us", 1e3},   {"µs", 1e3},   {"ms", 1e6},
                           {"s", 1e9}, {"min", 60e9}, {"h", 3600e9}, {"d", 86400e9}};
  return units;
}

// " (did you mean '5 s' or '5 ms'?)": both are usual for a time; for other quantities the example's unit.
std::string suggestion_of(const std::string& number, const Units& units, const std::string& example) {
  if (&units == &times()) return fmt::format(" (did you mean '{0} s' or '{0} ms'?)", number);
  return fmt::format(" (did you mean '{} {}'?)", number, example.substr(example.find(' ') + 1));
}

long double quantity(const std::string& text, const Units& units, const std::string& example) {
  std::string names;
  for (const auto& [name, factor] : units) names += (names.empty() ? "" : ", ") + name;
  long double number = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (error != std::errc{})
    throw std::invalid_argument(fmt::format("'{}' is not a number with a unit, such as '{}'", text, example));
  std::string unit(static_cast<const char*>(end), text.data() + text.size());
  unit.erase(0, std::min(unit.find_first_not_of(' '), unit.size()));
  if (unit.size() > 1 && unit[0] == ',' && unit[1] >= '0' && unit[1] <= '9')
    throw std::invalid_argument(fmt::format("'{}': the decimal sign is a point, such as '1.5'", text));
  if (unit.empty())
    throw std::invalid_argument(fmt::format("'{}' has no unit{}. Units: {}", text,
                                            number > 0 ? suggestion_of(text, units, example) : "", names));
  for (const auto& [name, factor] : units) {
    if (unit != name) continue;
    const auto value = number * factor;
    if (!std::isfinite(value) || std::abs(value) > 9e18L)
      throw std::invalid_argument(fmt::format("'{}' is out of range", text));
    return value;
  }
  if (&units == &times() && unit.ends_with("Hz"))
    throw std::invalid_argument(fmt::format("'{}' is a rate; a time is needed, such as '{}'", text, example));
  throw std::invalid_argument(fmt::format("'{}' has an unknown unit. Units: {}", text, names));
}

}  // namespace

std::chrono::nanoseconds duration_of(const std::string& text) {
  return std::chrono::nanoseconds(std::llround(quantity(text, times(), "10 ms")));
}

std::chrono::nanoseconds positive_duration(const std::string& text, std::chrono::hours most) {
  const auto duration = duration_of(text);
  if (duration.count() <= 0) throw std::invalid_argument(fmt::format("'{}' must be positive", text));
  if (duration > most)
    throw std::invalid_argument(fmt::format("'{}' is too long: at most {} h", text, most.count()));
  return duration;
}

std::string text_of(std::chrono::nanoseconds duration) {
  auto text = fmt::format("{} ns", duration.count());
  for (const auto& [name, factor] : times())
    if (const auto ns = static_cast<std::int64_t>(factor);
        duration.count() >= ns && duration.count() % ns == 0)
      text = fmt::format("{} {}", duration.count() / ns, name);
  return text;
}

std::uint64_t bytes_of(const std::string& text) {
  static const Units units{{"B", 1},           {"kB", 1e3}, {"KiB", 1024.0},      {"MB", 1e6},
                           {"MiB", 1048576.0}, {"GB", 1e9}, {"GiB", 1073741824.0}};
  const auto bytes = quantity(text, units, "500 B");
  if (bytes < 0) throw std::invalid_argument(fmt::format("'{}' is negative", text));
  const auto own_error = 4 * std::numeric_limits<long double>::epsilon() * bytes;  // of a binary number
  if (std::abs(bytes - std::round(bytes)) > own_error)
    throw std::invalid_argument(fmt::format("'{}' is not a whole number of bytes", text));
  return static_cast<std::uint64_t>(std::llround(bytes));
}

std::uint64_t bit_rate_of(const std::string& text) {
  static const Units units{{"bit/s", 1}, {"kbit/s", 1e3}, {"Mbit/s", 1e6}, {"Gbit/s", 1e9}};
  const auto rate = quantity(text, units, "80 Mbit/s");
  if (rate < 1) throw std::invalid_argument(fmt::format("'{}' is less than 1 bit/s", text));
  return static_cast<std::uint64_t>(std::llround(rate));
}

std::chrono::nanoseconds period_of_rate(const std::string& text) {
  static const Units units{{"Hz", 1}, {"kHz", 1e3}};
  const auto rate = quantity(text, units, "100 Hz");
  if (!(rate >= 0.1L) || rate > 1e5L)
    throw std::invalid_argument(fmt::format("'{}' is not a message rate from 0.1 Hz to 100 kHz", text));
  return std::chrono::nanoseconds(std::llround(1e9L / rate));
}

std::string text_of_share(double share) { return fmt::format("{:.7g} %", share * 100); }

double share_of(const std::string& text) {
  static const Units units{{"%", 0.01L}};
  const auto share = quantity(text, units, "1 %");
  const auto millionths = share * 1e6L;  // as the kernel divides
  if (!(share >= 1e-6L) || share > 1)
    throw std::invalid_argument(fmt::format("'{}' is not a share from 0.0001 % to 100 %", text));
  if (std::abs(millionths - std::round(millionths)) > 1e-6L)  // that much is the binary numbers' own
    throw std::invalid_argument(
        fmt::format("'{}' is not a multiple of 0.0001 %, the kernel's smallest step", text));
  return static_cast<double>(share);
}

std::int64_t number_of(const std::string& text, std::int64_t least, std::int64_t most) {
  const auto value = number_in<std::int64_t>(text);
  if (!value || *value < least || *value > most)
    throw std::invalid_argument(fmt::format("'{}' is not a whole number from {} to {}", text, least, most));
  return *value;
}

}  // namespace ontime::conditions
