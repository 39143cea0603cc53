// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <limits>
#include <numeric>
#include <utility>

#include "table/table.hpp"

namespace ontime::table {
namespace {

constexpr std::size_t column_gap = 2;

std::string text_of_note(const std::string& note, std::size_t width, const std::string& indent) {
  const auto lines = split(note, '\n');
  std::string text = wrapped(lines.front(), width, indent);
  for (std::size_t i = 1; i < lines.size(); ++i) text += indent + "  " + lines[i] + "\n";
  return text;
}

std::string pad(const std::string& cell, std::size_t to, Column::Align align) {
  const std::string space(to - width_of(cell), ' ');
  return align == Column::Align::left ? cell + space : space + cell;
}

std::string line_of(const std::vector<std::string>& cells, const std::vector<Column>& columns,
                    const std::vector<std::size_t>& widths) {
  std::string line;
  for (std::size_t i = 0; i < columns.size(); ++i) {
    if (i > 0) line.append(column_gap, ' ');
    line += pad(cells[i], widths[i], columns[i].align);
  }
  line.erase(line.find_last_not_of(' ') + 1);
  return line + "\n";
}

// The names of the columns as lines of cells, the last line full.
std::vector<std::vector<std::string>> header_of(const std::vector<Column>& columns) {
  std::size_t height = 1;
  for (const auto& column : columns) height = std::max(height, split(column.name, '\n').size());
  std::vector<std::vector<std::string>> lines(height, std::vector<std::string>(columns.size()));
  for (std::size_t i = 0; i < columns.size(); ++i) {
    const auto parts = split(columns[i].name, '\n');
    for (std::size_t k = 0; k < parts.size(); ++k) lines[height - parts.size() + k][i] = parts[k];
  }
  return lines;
}

struct Layout {
  std::vector<std::size_t> widths;  // of the columns
  std::size_t header = 0;           // of the first column's name
  std::size_t others() const {
    return std::accumulate(widths.begin() + 1, widths.end(), column_gap * (widths.size() - 1));
  }
};

Layout layout_of(const Table& table) {
  Layout layout{.widths = {}};
  for (std::size_t i = 0; i < table.columns.size(); ++i) layout.widths.push_back(width_of_column(table, i));
  for (const auto& line : split(table.columns.front().name, '\n'))
    layout.header = std::max(layout.header, width_of(line));
  return layout;
}

// Drops columns for as long as even short names of rows leave no room for the numbers. Adds their names.
Table fitted(Table table, std::size_t width, std::vector<std::string>& omitted) {
  for (;;) {
    const auto layout = layout_of(table);
    if (layout.header + layout.others() <= width) return table;
    const auto next = std::ranges::min_element(table.columns, {}, [](const Column& column) {
      return column.dropped > 0 ? column.dropped : std::numeric_limits<int>::max();
    });
    if (next->dropped == 0) return table;
    const auto place = next - table.columns.begin();
    if (const auto name = replace_all(next->name, "\n", " ");
        !name.empty() && std::ranges::find(omitted, name) == omitted.end())
      omitted.push_back(name);
    table.columns.erase(next);
    for (auto& row : table.rows) row.erase(row.begin() + place);
  }
}

// Where the page is too narrow for them, names of rows may be wider than their column: such a one stands on a
// line of its own, above its numbers.
void narrow_names(Layout& layout, const Table& table, std::size_t width) {
  const auto others = layout.others();
  if (layout.widths.front() + others <= width) return;
  layout.widths.front() = layout.header;
  for (const auto& row : table.rows)
    if (const auto name = width_of(row.front()); name + others <= width)
      layout.widths.front() = std::max(layout.widths.front(), name);
}

std::string text_of(const Table& whole, std::size_t width, std::vector<std::string>& omitted) {
  const auto table = fitted(whole, width, omitted);
  auto layout = layout_of(table);
  narrow_names(layout, table, width);
  std::string text = table.title.empty() ? "" : table.title + "\n";
  if (!table.conditions.empty()) text += wrapped(table.conditions, width);
  for (const auto& line : header_of(table.columns)) text += line_of(line, table.columns, layout.widths);
  for (auto row : table.rows) {
    if (width_of(row.front()) > layout.widths.front()) text += wrapped(std::exchange(row.front(), ""), width);
    text += line_of(row, table.columns, layout.widths);
  }
  for (const auto& note : table.notes) text += text_of_note(note, width, "  ");
  return text + "\n";
}

}  // namespace

std::size_t width_of_column(const Table& table, std::size_t column) {
  std::size_t widest = 0;
  for (const auto& line : split(table.columns[column].name, '\n')) widest = std::max(widest, width_of(line));
  for (const auto& row : table.rows) widest = std::max(widest, width_of(row[column]));
  return widest;
}

std::string as_text(const Page& page, std::size_t width) {
  std::string text;
  std::vector<std::string> omitted;
  for (const auto& table : page.tables) text += text_of(table, width, omitted);
  for (const auto& note : page.notes) text += text_of_note(note, width, "") + "\n";
  if (!page.legend.empty())
    text += wrapped(
        page.legend + (omitted.empty()
                           ? ""
                           : " Omitted for lack of space in some tables: " + join(omitted, ", ") + "."),
        width);
  return text;
}

}  // namespace ontime::table
