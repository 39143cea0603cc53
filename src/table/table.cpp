// SPDX-License-Identifier: Apache-2.0
#include "table/table.hpp"

#include <algorithm>

namespace ontime::table {
namespace {

template <class IsUnwanted>
void erase_columns(Table& table, const IsUnwanted& is_unwanted) {
  for (std::size_t i = table.columns.size(); i-- > 0;) {
    if (!is_unwanted(i)) continue;
    const auto place = static_cast<std::ptrdiff_t>(i);
    table.columns.erase(table.columns.begin() + place);
    for (auto& row : table.rows) row.erase(row.begin() + place);
  }
}

}  // namespace

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
    table.legend = printable(table.legend);
  }
  for (auto& note : page.notes) note = printable_lines(note);
  page.legend = printable(page.legend);
  return page;
}

Page without_drawings(Page page) {
  for (auto& table : page.tables)
    erase_columns(table, [&](std::size_t column) { return table.columns[column].drawn; });
  return page;
}

Table without_unknown(Table table) {
  const auto is_unknown = [](const std::string& cell) { return cell == "-" || cell.empty(); };
  erase_columns(table, [&](std::size_t column) {
    return column > 0 && !table.rows.empty() && std::ranges::all_of(table.rows, [&](const auto& row) {
             return column < row.size() && is_unknown(row[column]);
           });
  });
  return table;
}

}  // namespace ontime::table
