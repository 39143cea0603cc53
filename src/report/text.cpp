// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <numeric>
#include <utility>

#include <fmt/format.h>

#include "report/page.hpp"
#include "report/words.hpp"

namespace ontime::report {
namespace {

constexpr std::size_t page_width = 100;
constexpr std::size_t column_gap = 2;

// Of UTF-8, taking each code point as one column wide.
std::size_t width(const std::string& text) {
  return static_cast<std::size_t>(std::count_if(
      text.begin(), text.end(), [](char c) { return (static_cast<unsigned char>(c) & 0xc0) != 0x80; }));
}

// Breaks a paragraph between words. Its lines after the first are indented further.
std::string wrap(const std::string& paragraph, const std::string& indent) {
  std::string text, line = indent;
  for (const auto& word : split(paragraph, ' ')) {
    const bool fresh = line.ends_with(' ') || line.empty();
    if (!fresh && width(line) + 1 + width(word) > page_width) {
      text += line + "\n";
      line = indent + "  ";
    } else if (!fresh) {
      line += ' ';
    }
    line += word;
  }
  return text + line + "\n";
}

std::string text_of_note(const std::string& note, const std::string& indent) {
  const auto lines = split(note, '\n');
  std::string text = wrap(lines.front(), indent);
  for (std::size_t i = 1; i < lines.size(); ++i) text += indent + "  " + lines[i] + "\n";
  return text;
}

std::string pad(const std::string& cell, std::size_t to, Column::Align align) {
  const std::string space(to - width(cell), ' ');
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

// Where the page is too narrow for them, names of rows may be wider than their column: such a one stands on a
// line of its own, above its numbers.
void narrow_names(std::vector<std::size_t>& widths, const Table& table, std::size_t header_width) {
  const auto others = std::accumulate(widths.begin() + 1, widths.end(), column_gap * (widths.size() - 1));
  if (widths.front() + others <= page_width || header_width + others > page_width) return;
  widths.front() = header_width;
  for (const auto& row : table.rows)
    if (const auto name = width(row.front()); name + others <= page_width)
      widths.front() = std::max(widths.front(), name);
}

std::string text_of(const Table& table) {
  const auto header = header_of(table.columns);
  std::vector<std::size_t> widths(table.columns.size());
  std::size_t header_width = 0;
  for (const auto& line : header) header_width = std::max(header_width, width(line.front()));
  for (const auto* lines : {&header, &table.rows})
    for (const auto& line : *lines)
      for (std::size_t i = 0; i < widths.size(); ++i) widths[i] = std::max(widths[i], width(line[i]));
  narrow_names(widths, table, header_width);

  std::string text = table.title + "\n";
  if (!table.conditions.empty()) text += wrap(table.conditions, "");
  for (const auto& line : header) text += line_of(line, table.columns, widths);
  for (auto row : table.rows) {
    if (width(row.front()) > widths.front()) text += wrap(std::exchange(row.front(), ""), "");
    text += line_of(row, table.columns, widths);
  }
  for (const auto& note : table.notes) text += text_of_note(note, "  ");
  return text + "\n";
}

}  // namespace

std::string as_text(const Page& page) {
  std::string text;
  for (const auto& table : page.tables) text += text_of(table);
  for (const auto& note : page.notes) text += text_of_note(note, "") + "\n";
  if (!page.legend.empty()) text += wrap(page.legend, "");
  return text;
}

}  // namespace ontime::report
