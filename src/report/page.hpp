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
  int dropped = 0;     // where a terminal is too narrow: 1 first; 0 never
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

inline constexpr std::size_t usual_width = 100;
// Lines of at most `width` columns where cells and words allow it: a table that is wider drops columns, or
// has the names of its rows on lines of their own.
std::string as_text(const Page&, std::size_t width = usual_width);
std::string wrapped(const std::string& paragraph, std::size_t width, const std::string& indent = "");
std::size_t width_of(const std::string&);  // of UTF-8, in columns of a terminal
std::string as_markdown(const Page&);
std::string as_latex(const Page&);
// RFC 4180, lines ended by '\n'.
std::string as_csv(const std::vector<std::string>& header, const std::vector<std::vector<std::string>>& rows);

}  // namespace ontime::report
