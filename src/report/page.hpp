// SPDX-License-Identifier: Apache-2.0
// A report for people before it has a form, and its forms.
#pragma once

#include <algorithm>
#include <string>
#include <vector>

namespace ontime::report {

struct Column {
  enum class Align { left, right };
  std::string name;  // '\n' where a narrow form may break it
  Align align = Align::right;
  bool drawn = false;  // of blocks, each in its place: for a terminal alone
};

struct Table {
  std::string title;
  std::string conditions;
  std::vector<Column> columns;
  std::vector<std::vector<std::string>> rows;
  std::vector<std::string>
      notes;  // what follows a '\n' in one stays on its line, so that a command can be copied
};

inline std::vector<std::string> names_of(const Table& table) {
  std::vector<std::string> names(table.columns.size());
  std::transform(table.columns.begin(), table.columns.end(), names.begin(),
                 [](const Column& c) { return c.name; });
  return names;
}

struct Page {
  std::vector<Table> tables;
  std::vector<std::string> notes;  // on all of them
  std::string legend;
};

std::string as_text(const Page&);
std::string as_markdown(const Page&);
std::string as_latex(const Page&);
// RFC 4180, lines ended by '\n'.
std::string as_csv(const std::vector<std::string>& header, const std::vector<std::vector<std::string>>& rows);

}  // namespace ontime::report
