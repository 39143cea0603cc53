// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <clocale>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cwchar>
#include <string_view>
#include <utility>

#include <boost/algorithm/string/split.hpp>
#include <fmt/format.h>
#include <fmt/ranges.h>

#include "table/table.hpp"

namespace ontime::table {
namespace {

struct CodePoint {
  std::uint32_t value = 0;
  std::size_t length = 0;  // in bytes; 0: not a code point
};

// Of UTF-8, in its shortest form only.
CodePoint first_of(std::string_view text) {
  const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(text[i]); };
  if (byte(0) < 0x80) return {byte(0), 1};
  const std::size_t length = byte(0) >= 0xf0 ? 4 : byte(0) >= 0xe0 ? 3 : 2;
  if (byte(0) < 0xc2 || byte(0) > 0xf4 || text.size() < length) return {};
  std::uint32_t value = byte(0) & (0x7fu >> length);
  for (std::size_t i = 1; i < length; ++i) {
    if ((byte(i) & 0xc0) != 0x80) return {};
    value = value << 6 | (byte(i) & 0x3fu);
  }
  constexpr std::uint32_t least[] = {0x80, 0x800, 0x10000};
  const bool surrogate = value >= 0xd800 && value < 0xe000;
  if (value < least[length - 2] || value > 0x10ffff || surrogate) return {};
  return {value, length};
}

bool breaks_a_line(std::uint32_t c) {
  return (c >= '\t' && c <= '\r') || c == 0x85 || c == 0x2028 || c == 0x2029;
}

bool steers(std::uint32_t c) {
  const auto within = [c](std::uint32_t first, std::uint32_t last) { return first <= c && c <= last; };
  return c < 0x20 || within(0x7f, 0x9f) ||                        // C0, DEL, C1
         c == 0x061c || within(0x200e, 0x200f) ||                 // marks of direction
         within(0x202a, 0x202e) || within(0x2066, 0x2069) ||      // overrides and isolates of direction
         c == 0x00ad || c == 0x200b || within(0x2060, 0x2065) ||  // nothing to be seen
         within(0x206a, 0x206f) || c == 0xfeff || within(0xfff9, 0xfffb) || within(0xe0000, 0xe007f) ||
         (c & 0xfffeU) == 0xfffe;  // no characters, which XML cannot have
}

bool ends_in_digit(const std::string& word) {
  return !word.empty() && word.back() >= '0' && word.back() <= '9';
}

// Also before a comma: "2 s, no load".
bool is_unit(const std::string& word) {
  const auto units = {"%",  "s",   "ms",  "µs",  "ns", "min", "h",      "B",      "kB",    "MB",
                      "GB", "KiB", "MiB", "GiB", "Hz", "kHz", "kbit/s", "Mbit/s", "Gbit/s"};
  return std::ranges::find(units, word.substr(0, word.find_last_not_of(".,;:)]") + 1)) != units.end();
}

}  // namespace

std::string printable(const std::string& text) {
  std::string result;
  result.reserve(text.size());
  for (std::size_t i = 0; i < text.size();) {
    const auto [c, length] = first_of(std::string_view(text).substr(i));
    if (length != 0 && breaks_a_line(c))
      result += ' ';
    else if (length == 0 || steers(c))
      result += '?';
    else
      result.append(text, i, length);
    i += length == 0 ? 1 : length;
  }
  return result;
}

// By Unicode's data in the C library, in whatever language the user works: wide letters take two columns,
// combining marks and joiners none.
std::size_t width_of(const std::string& text) {
  static const auto utf8 = newlocale(LC_CTYPE_MASK, "C.UTF-8", nullptr);
  const auto before = uselocale(utf8);
  std::size_t width = 0;
  for (std::size_t i = 0; i < text.size();) {
    const auto [c, length] = first_of(std::string_view(text).substr(i));
    const auto columns = length > 1 ? wcwidth(static_cast<wchar_t>(c)) : 1;
    width += columns < 0 ? 1 : static_cast<std::size_t>(columns);
    i += std::max<std::size_t>(length, 1);
  }
  uselocale(before);
  return width;
}

std::string wrapped(const std::string& paragraph, std::size_t width, const std::string& indent) {
  std::vector<std::vector<std::string>> values(1);  // two blanks apart
  for (auto& word : split(paragraph, ' ')) {
    auto& words = values.back();
    if (word.empty() && !words.empty())
      values.emplace_back();
    else if (!words.empty() && ends_in_digit(words.back()) && is_unit(word))
      words.back() += ' ' + word;
    else if (!word.empty())
      words.push_back(std::move(word));
  }
  std::string text, line = indent;
  const auto fits = [&](const std::string& before, std::size_t columns) {
    return width_of(before) + columns <= width;
  };
  const auto end_line = [&] { text += std::exchange(line, indent + "  ") + "\n"; };
  const auto is_fresh = [&] { return line.ends_with(' ') || line.empty(); };
  for (const auto& words : values) {
    if (words.empty()) continue;  // blanks at the end
    const auto whole = width_of(join(words, " "));
    if (!is_fresh() && !fits(line, 2 + whole) && fits(indent, 2 + whole)) end_line();
    std::size_t gap = 2;
    for (const auto& word : words) {
      if (!is_fresh() && !fits(line, gap + width_of(word))) end_line();
      if (!is_fresh()) line.append(gap, ' ');
      line += word;
      gap = 1;
    }
  }
  return text + line + "\n";
}

std::string labelled(const std::string& label, const std::string& text, std::size_t column,
                     std::size_t width) {
  if (width < fewest_for_two) return (label.empty() ? "" : label + "\n") + wrapped(text, width, "  ");
  const std::string before(column - width_of(label), ' ');
  if (column + width_of(text) <= width) return label + before + text + "\n";
  return label + before + wrapped(text, width, std::string(column, ' ')).substr(column);
}

std::string shortened(const std::string& text, std::size_t most) {
  std::size_t end = 0, kept = 0;
  for (std::size_t width = 0; end < text.size();) {
    const auto length = std::max<std::size_t>(first_of(std::string_view(text).substr(end)).length, 1);
    width += width_of(text.substr(end, length));
    if (width > most) return text.substr(0, kept) + "…";
    end += length;
    if (width < most) kept = end;  // a column is left for "…"
  }
  return text;
}

std::string megabits(double bit_s) {
  const auto mbit_s = bit_s / 1e6;
  return mbit_s < 9999.5 ? fmt::format("{:.4g}", mbit_s) : fmt::format("{:.0f}", mbit_s);  // no exponent
}

int decimals_that_show(double below_one) { return static_cast<int>(std::ceil(-std::log10(below_one))); }

std::string percent(double share, int digits) {
  if (share < 0) return "-" + percent(-share, digits);
  const double of_hundred = share * 100 + 0.0, rest = 100 - of_hundred;  // not -0
  const auto with = [&](int decimals) {
    const auto text = fmt::format("{:.{}f}", of_hundred, decimals);
    return text.substr(0, text.find_last_not_of('0') + 1);
  };
  if (rest < 1e-9) return fmt::format("{:.0f}", of_hundred);  // a sum of shares may be beyond by its rounding
  if (rest <= std::pow(10, 2 - digits) / 2) return with(decimals_that_show(rest));
  if (of_hundred > 1e-9 && of_hundred < 1e-4)  // without an exponent
    return with(decimals_that_show(of_hundred) + digits - 1);
  return fmt::format("{:.{}g}", of_hundred, digits);
}

std::string percent(double share, int digits, Limit limit) {
  const double of_hundred = share * 100, rest = 100 - of_hundred;
  if (of_hundred < 1e-9 || rest < 1e-9) return fmt::format("{:.0f}", of_hundred);
  const int decimals = rest < std::pow(10, 2 - digits)
                           ? decimals_that_show(rest)
                           : std::max(0, digits - 1 - static_cast<int>(std::floor(std::log10(of_hundred))));
  constexpr double noise = 1e-6;  // of binary numbers: 0.07 is not to become 7.1 %
  const double units = of_hundred * std::pow(10, decimals);
  const double rounded = limit == Limit::low ? std::floor(units + noise) : std::ceil(units - noise);
  auto text = fmt::format("{:.{}f}", rounded / std::pow(10, decimals), decimals);
  if (decimals > 0) text.resize(text.find_last_not_of('0') + 1);
  if (text.back() == '.') text.pop_back();
  return text;
}

std::string points(double difference) { return (difference < 0 ? "" : "+") + percent(difference, 3); }

std::string grouped(std::uint64_t number) {
  const auto digits = fmt::format("{}", number);
  std::string text;
  for (std::size_t i = 0; i < digits.size(); ++i) {
    if (i > 0 && (digits.size() - i) % 3 == 0) text += ',';
    text += digits[i];
  }
  return text;
}

std::string many(std::uint64_t number, const char* one, const char* several) {
  return fmt::format("{} {}", grouped(number), number == 1 ? one : several);
}

std::string join(const std::vector<std::string>& parts, std::string_view separator) {
  return fmt::format("{}", fmt::join(parts, separator));
}

std::vector<std::string> split(const std::string& text, char separator) {
  std::vector<std::string> parts;
  boost::algorithm::split(parts, text, [&](char c) { return c == separator; });
  return parts;
}

std::string replace_all(std::string_view text, std::string_view what, std::string_view with) {
  std::string result;
  for (auto found = text.find(what); found != text.npos; found = text.find(what)) {
    result.append(text.substr(0, found)).append(with);
    text.remove_prefix(found + what.size());
  }
  return result.append(text);
}

// To fish, a backslash within quotes may escape the next one.
std::string in_quotes(const std::string& word) {
  std::string text = "'";
  for (const char c : word)
    if (c == '\'' || c == '\\')
      text += std::string("'\\") + c + "'";
    else
      text += c;
  return text + "'";
}

std::string shell_line(const std::vector<std::string>& words) {
  constexpr const char* plain = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-./:,+@%=";
  std::vector<std::string> quoted;
  quoted.reserve(words.size());
  for (const auto& word : words) {
    // What begins with "=" is a program's path to zsh.
    const bool is_plain = !word.empty() && word.front() != '=' && word.find_first_not_of(plain) == word.npos;
    quoted.push_back(is_plain ? word : in_quotes(word));
  }
  return join(quoted, " ");
}

std::optional<std::string> line_to_paste(const std::vector<std::string>& words) {
  for (const auto& word : words)
    if (printable(word) != word) return std::nullopt;
  return shell_line(words);
}

std::string as_operand(const std::string& file) { return (file.starts_with('-') ? "./" : "") + file; }

}  // namespace ontime::table
