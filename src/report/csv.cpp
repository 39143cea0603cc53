// SPDX-License-Identifier: Apache-2.0
#include "report/page.hpp"
#include "report/words.hpp"

namespace ontime::report {
namespace {

std::string line_of(const std::vector<std::string>& fields) {
  std::vector<std::string> quoted;
  for (const auto& field : fields) {
    const bool plain = field.find_first_of(",\"\r\n") == std::string::npos;
    quoted.push_back(plain ? field : '"' + replace_all(field, "\"", "\"\"") + '"');
  }
  return join(quoted, ",") + "\n";
}

}  // namespace

std::string as_csv(const std::vector<std::string>& header,
                   const std::vector<std::vector<std::string>>& rows) {
  std::string text = line_of(header);
  for (const auto& row : rows) text += line_of(row);
  return text;
}

}  // namespace ontime::report
