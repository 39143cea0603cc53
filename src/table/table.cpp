// SPDX-License-Identifier: Apache-2.0
#include "table/table.hpp"

#include <cstddef>

namespace ontime::table {
namespace {

void make_printable(std::string& text) {
  auto lines = split(text, '\n');
  for (auto& line : lines) line = printable(line);
  text = join(lines, "\n");
}

}  // namespace

Page printable(Page page) {
  for (auto& table : page.tables) {
    table.title = printable(table.title);
    table.conditions = printable(table.conditions);
    for (auto& row : table.rows)
      for (auto& cell : row) cell = printable(cell);
    for (auto& column : table.columns) make_printable(column.name);
    for (auto& note : table.notes) make_printable(note);
  }
  for (auto& note : page.notes) make_printable(note);
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
