// SPDX-License-Identifier: Apache-2.0
#include <string_view>

#include <fmt/format.h>

#include "table/table.hpp"

namespace ontime::table {
namespace {

std::string escape(const std::string& text) {
  std::string result;
  for (const char c : text) {
    if (c == '\n')
      result += ' ';
    else if (std::string_view("\\`*_[]<>|~#&$!").find(c) != std::string_view::npos)
      result += fmt::format("\\{}", c);
    else
      result += c;
  }
  return result;
}

std::string line_of(std::vector<std::string> cells) {
  for (auto& cell : cells) cell = escape(cell);
  return "| " + join(cells, " | ") + " |\n";
}

std::string markdown_of(const Table& table) {
  std::string text = "### " + escape(table.title) + "\n\n";
  if (!table.conditions.empty()) text += escape(table.conditions) + "\n\n";
  text += line_of(names_of(table)) + "|";
  for (const auto& column : table.columns) text += column.align == Column::Align::left ? " :-- |" : " --: |";
  text += "\n";
  for (const auto& row : table.rows) text += line_of(row);
  text += "\n";
  for (const auto& note : table.notes) text += "- " + escape(note) + "\n";
  return table.notes.empty() ? text : text + "\n";
}

}  // namespace

std::string as_markdown(const Page& page) {
  std::string text;
  for (const auto& table : page.tables) text += markdown_of(table);
  for (const auto& note : page.notes) text += "- " + escape(note) + "\n";
  if (!page.notes.empty() && !page.legend.empty()) text += "\n";
  if (!page.legend.empty()) text += escape(page.legend) + "\n";
  return text;
}

}  // namespace ontime::table
