// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <charconv>
#include <cmath>
#include <string_view>
#include <utility>

#include <fmt/format.h>

#include "gate/gate.hpp"

namespace ontime::gate {
namespace {

using statistics::Figure;

constexpr std::pair<std::string_view, double> times_ns[] = {
    {"ns", 1}, {"us", 1e3}, {"µs", 1e3}, {"ms", 1e6}, {"s", 1e9}};

constexpr std::size_t longest = 200;

class Parser {
 public:
  Parser(const std::string& text, Use use, std::string_view before)
      : text_(text), use_(use), before_(before) {
    gate_.text = text;
  }

  Gate parse() {
    if (text_.size() > longest) fail(longest, fmt::format("a gate has at most {} characters", longest));
    read_figure();
    read_comparison();
    read_limit();
    skip_blanks();
    if (at_ < text_.size()) fail(at_, fmt::format("unexpected '{}'", text_.substr(at_)));
    return std::move(gate_);
  }

 private:
  [[noreturn]] void fail(std::size_t at, const std::string& what) const {
    throw Error(fmt::format("column {}: {}. Example: {}", column(at), what,
                            use_ == Use::fail_if_compared ? "p99.9 > +10%"
                            : use_ == Use::require        ? is_share() ? "late <= 0" : "p99.9 <= 2 ms"
                            : use_ == Use::goal           ? is_share() ? "late = 0" : "p99.9 < 2 ms"
                            : is_share()                  ? "late > 0"
                                                          : "p99.9 > 2 ms"));
  }
  // As an editor counts them, "µ" once.
  std::size_t column(std::size_t at) const {
    const auto length = [](std::string_view text) {
      return static_cast<std::size_t>(
          std::ranges::count_if(text, [](char c) { return (static_cast<unsigned char>(c) & 0xc0) != 0x80; }));
    };
    return 1 + length(before_) + length(std::string_view(text_).substr(0, at));
  }

  void skip_blanks() { at_ = std::min(text_.find_first_not_of(" \t", at_), text_.size()); }
  std::string word(std::string_view ends) {
    const auto begin = std::exchange(at_, std::min(text_.find_first_of(ends, at_), text_.size()));
    return text_.substr(begin, at_ - begin);
  }

  void read_figure() {
    skip_blanks();
    auto begin = at_;
    auto name = word(" \t<>=+-");
    if (name == "response") {
      gate_.times = statistics::Times::response;
      skip_blanks();
      begin = at_;
      name = word(" \t<>=+-");
    }
    std::string known;
    for (const auto& row : statistics::metrics) {
      if (use_ == Use::goal && row.figure == Figure::mean && name != row.name) continue;  // it takes no mean
      known += (known.empty() ? "" : ", ") + std::string(row.name);
      if (name != row.name) continue;
      gate_.figure = row.figure;
      if (row.figure == Figure::lost && gate_.times == statistics::Times::response)
        fail(begin, "a lost message has no response time: write 'lost' without 'response'");
      return;
    }
    fail(begin, fmt::format("{}; metrics: {}, with 'response' before one for response times",
                            name.empty() ? "a metric is missing" : "'" + name + "' is not a metric", known));
  }

  void read_comparison() {
    skip_blanks();
    const auto begin = std::exchange(at_, std::min(text_.find_first_not_of("<>=!", at_), text_.size()));
    const auto found = text_.substr(begin, at_ - begin);
    if (use_ == Use::goal && (found == "<" || found == "=")) return;
    const auto* const wanted = use_ == Use::require ? "<=" : use_ == Use::goal ? "<" : ">";
    if (found != (use_ == Use::goal ? "<=" : wanted))
      fail(begin, fmt::format("expected '{}'{}", wanted, found.empty() ? " here" : ", not '" + found + "'"));
  }

  bool is_share() const { return statistics::metric_of(gate_.figure).is_share; }

  void read_limit() {
    skip_blanks();
    const auto begin = at_;
    double sign = 1;
    const bool relative = at_ < text_.size() && (text_[at_] == '+' || text_[at_] == '-');
    if (relative) sign = text_[at_++] == '-' ? -1 : 1;
    const auto number = read_number();
    skip_blanks();
    const auto unit_at = at_;
    const auto unit = word(" \t");
    if (relative) {
      if (use_ != Use::fail_if_compared)
        fail(begin, "a limit with + or - compares two runs, as `ontime compare` does");
      if (gate_.figure == Figure::max)
        fail(begin,
             "each max is a single message, so a change proves nothing: compare p99.99, or use a limit "
             "without + or -");
    }
    if (unit.empty()) return set_count(number, relative, begin, unit_at);
    if (unit == "%") return set_percent(number, sign, relative, begin);
    if (unit == "points" && relative && is_share()) return set(Gate::Limit::difference, sign * number / 100);
    for (const auto& [name, ns] : times_ns)
      if (unit == name) {
        if (is_share()) fail(unit_at, "late and lost take a number of messages or a %, not a time");
        return set(relative ? Gate::Limit::difference : Gate::Limit::absolute,
                   sign * std::round(number * ns * 1e3) / 1e3);  // "1.001 ms" is 1,001,000 ns
      }
    fail(unit_at, fmt::format("'{}' is not a unit here. Units: {}", unit,
                              is_share() ? relative ? "% (of the earlier value), points (% of all messages)"
                                                    : "% or none"
                              : relative ? "%, ns, us, ms, s"
                                         : "ns, us, ms, s"));
  }

  double read_number() {
    double number = 0;
    const auto* begin = text_.data() + at_;
    const auto [end, error] =
        std::from_chars(begin, text_.data() + text_.size(), number, std::chars_format::fixed);
    if (error != std::errc{} || !std::isfinite(number) || number < 0 || number > 1e15)
      fail(at_, "expected a number");
    at_ = static_cast<std::size_t>(end - text_.data());
    if (at_ + 1 < text_.size() && text_[at_] == ',' && text_[at_ + 1] >= '0' && text_[at_ + 1] <= '9')
      fail(at_, "the decimal sign is a point, such as 1.5");
    return number;
  }

  void set_count(double number, bool relative, std::size_t begin, std::size_t unit_at) {
    if (!is_share() || relative)
      fail(unit_at, fmt::format("a unit is missing: {}", !relative    ? "ns, us, ms, s"
                                                         : is_share() ? "% or points"
                                                                      : "%, ns, us, ms, s"));
    if (number != std::floor(number)) fail(begin, "a number of messages must be whole");
    set(Gate::Limit::count, number);
  }

  void set_percent(double number, double sign, bool relative, std::size_t begin) {
    if (relative) {
      if (sign < 0 && number >= 100) fail(begin, "a value cannot fall by 100 % or more");
      return set(Gate::Limit::ratio, 1 + sign * number / 100);
    }
    if (!is_share())
      fail(begin, use_ == Use::fail_if_compared
                      ? "a limit in % compares two runs and needs a sign, such as +10%"
                      : "the limit of a time is a time, such as 2 ms");
    if (number > 100) fail(begin, "at most 100 % of messages can be late or lost");
    // 0 % counts messages: no run could ever prove a share of 0.
    set(number == 0 ? Gate::Limit::count : Gate::Limit::absolute, number / 100);
  }

  void set(Gate::Limit kind, double limit) {
    gate_.kind = kind;
    gate_.limit = limit;
  }

  const std::string& text_;
  const Use use_;
  const std::string_view before_;
  std::size_t at_ = 0;
  Gate gate_;
};

}  // namespace

std::string Gate::requirement() const {
  auto positive = text;
  if (const auto at = positive.find('>'); at != std::string::npos) positive.replace(at, 1, "<=");
  return positive;
}

Gate parse(const std::string& text, Use use, std::string_view before) {
  return Parser(text, use, before).parse();
}

}  // namespace ontime::gate
