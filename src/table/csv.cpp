// SPDX-License-Identifier: Apache-2.0
#include <charconv>
#include <string_view>
#include <system_error>

#include "table/table.hpp"

namespace ontime::table {
namespace {

bool is_number(const std::string& text) {
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  return error == std::errc{} && end == text.data() + text.size();
}

// A spreadsheet runs what looks like a formula, unless it is marked as text.
std::string harmless(const std::string& text) {
  const auto first = text.find_first_not_of(' ');
  const bool formula =
      first != std::string::npos && std::string_view("=+-@").find(text[first]) != std::string::npos;
  return formula && !is_number(text) ? "'" + text : text;
}

std::string csv_line_of(const std::vector<std::string>& fields) {
  std::vector<std::string> quoted;
  for (const auto& raw : fields) {
    const auto field = harmless(printable(raw));
    const bool plain = field.find_first_of(",\"") == std::string::npos;
    quoted.push_back(plain ? field : '"' + replace_all(field, "\"", "\"\"") + '"');
  }
  return join(quoted, ",") + "\n";
}

}  // namespace

std::string as_csv(const std::vector<std::string>& header,
                   const std::vector<std::vector<std::string>>& rows) {
  std::string text = csv_line_of(header);
  for (const auto& row : rows) text += csv_line_of(row);
  return text;
}

}  // namespace ontime::table
