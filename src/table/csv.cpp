// SPDX-License-Identifier: Apache-2.0
#include <string_view>

#include "number.hpp"
#include "table/table.hpp"

namespace ontime::table {
namespace {

// A spreadsheet runs what looks like a formula, unless it is marked as text.
std::string harmless(const std::string& text) {
  const auto first = text.find_first_not_of(' ');
  const bool formula =
      first != std::string::npos && std::string_view("=+-@").find(text[first]) != std::string::npos;
  return formula && !number_in<double>(text) ? "'" + text : text;
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
