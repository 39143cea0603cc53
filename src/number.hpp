// SPDX-License-Identifier: Apache-2.0
// A text that is a number, as a whole.
#pragma once

#include <charconv>
#include <optional>
#include <string_view>
#include <system_error>

namespace ontime {

// Nothing if it is not one, does not fit, or has anything before or behind it: also a blank or a '+'.
template <class Number>
std::optional<Number> number_in(std::string_view text) {
  Number number{};
  const auto* const end = text.data() + text.size();
  const auto [last, error] = std::from_chars(text.data(), end, number);
  return error == std::errc{} && last == end ? std::optional(number) : std::nullopt;
}

}  // namespace ontime
