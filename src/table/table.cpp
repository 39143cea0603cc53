// SPDX-License-Identifier: Apache-2.0
#include "table/table.hpp"

namespace ontime::table {

std::string printable_lines(const std::string& text) {
  return join(texts_of(split(text, '\n'), [](const std::string& line) { return printable(line); }), "\n");
}

Page printable(Page page) {
  for (auto& table : page.tables) {
    table.title = printable(table.title);
    table.conditions = printable(table.conditions);
    for (auto& row : table.rows)
      for (auto& cell : row) cell = printable(cell);
    for (auto& column : table.columns) column.name = printable_lines(column.name);
    for (auto& note : table.notes) note = printable_lines(note);
  }
  for (auto& note : page.notes) note = printable_lines(note);
  page.legend = printable(page.legend);
  return page;
}

Page without_drawings(Page page) {
  for (auto& table : page.tables)
    for (std::size_t i = table.columns.size(); i-- > 0;) {
      if (!table.columns[i].drawn) continue;
      const auto place = static_cast<std::ptrdiff_t>(i);
      table.columns.erase(table.columns.begin() + place);
      for (auto& row : table.rows) row.erase(row.begin() + place);
    }
  return page;
}

}  // namespace ontime::table
