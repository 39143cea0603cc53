// SPDX-License-Identifier: Apache-2.0
#include <sstream>

#include <fmt/format.h>

#include "table/table.hpp"

namespace ontime::table {
namespace {

std::string cells_of(const std::vector<std::string>& row, const std::vector<Column>& columns) {
  std::string text;
  for (std::size_t i = 0; i < row.size(); ++i) {
    if (columns[i].drawn) continue;
    const bool left = columns[i].align == Column::Align::left;
    text += i == 0 ? fmt::format("<th scope=\"row\">{}</th>", escaped(row[i]))
                   : fmt::format("<td{}>{}</td>", left ? "" : " class=\"number\"", escaped(row[i]));
  }
  return "<tr>" + text + "</tr>\n";
}

}  // namespace

std::string escaped(const std::string& text) {
  std::string result;
  for (const char c : printable(text)) {
    switch (c) {
      case '&':
        result += "&amp;";
        break;
      case '<':
        result += "&lt;";
        break;
      case '>':
        result += "&gt;";
        break;
      case '"':
        result += "&quot;";
        break;
      case '\'':
        result += "&#39;";
        break;
      default:
        result += c;
    }
  }
  return result;
}

std::string note_as_html(const std::string& note) {
  std::vector<std::string> lines;
  std::istringstream text(note);
  for (std::string line; std::getline(text, line);) lines.push_back(escaped(line));
  return "<p class=\"note\">" + join(lines, "\n") + "</p>\n";
}

std::string as_html(const Table& table) {
  std::string text = "<div class=\"wide\" tabindex=\"0\" role=\"region\" aria-label=\"" +
                     escaped(table.title) + "\">\n<table>\n<caption>" + escaped(table.title) +
                     "</caption>\n<thead><tr>";
  for (const auto& column : table.columns)
    if (!column.drawn)
      text +=
          fmt::format("<th scope=\"col\"{}>{}</th>",
                      column.align == Column::Align::left ? "" : " class=\"number\"", escaped(column.name));
  text += "</tr></thead>\n<tbody>\n";
  for (const auto& row : table.rows) text += cells_of(row, table.columns);
  text += "</tbody>\n</table>\n</div>\n";
  if (!table.conditions.empty()) text = "<p>" + escaped(table.conditions) + "</p>\n" + text;
  for (const auto& note : table.notes) text += note_as_html(note);
  return text;
}

}  // namespace ontime::table
