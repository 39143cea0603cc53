// SPDX-License-Identifier: Apache-2.0
#include <map>
#include <string_view>
#include <utility>

#include "table/table.hpp"

namespace ontime::table {
namespace {

std::string escape_latex(const std::string& text) {
  static const std::map<char, const char*> commands = {{'\\', "\\textbackslash{}"},
                                                       {'~', "\\textasciitilde{}"},
                                                       {'^', "\\textasciicircum{}"},
                                                       {'<', "\\textless{}"},
                                                       {'>', "\\textgreater{}"},
                                                       {'|', "\\textbar{}"},
                                                       {'\n', " "}};
  std::string result;
  for (const char c : text) {
    if (const auto command = commands.find(c); command != commands.end()) {
      result += command->second;
      continue;
    }
    if (std::string_view("{}$&#_%").find(c) != std::string_view::npos) result += '\\';
    result += c;
  }
  for (const auto& [sign, set] : {std::pair{"µ", "$\\mu$"},
                                  {"·", "$\\cdot$"},
                                  {"±", "$\\pm$"},
                                  {"≤", "$\\leq$"},
                                  {"≥", "$\\geq$"},
                                  {"→", "$\\rightarrow$"},
                                  {"×", "$\\times$"},
                                  {"…", "\\ldots{}"}})
    result = replace_all(result, sign, set);
  return result;
}

std::string latex_line_of(std::vector<std::string> cells) {
  for (auto& cell : cells) cell = escape_latex(cell);
  return join(cells, " & ") + " \\\\ \\hline\n";
}

// A note stays with its table without being set.
std::string comment(const std::string& note) { return "% " + replace_all(note, "\n", " ") + "\n"; }

std::string latex_of(const Table& table) {
  std::string alignment = "|";
  for (const auto& column : table.columns) alignment += column.align == Column::Align::left ? "l|" : "r|";
  std::string text = "\\begin{table*}[ht]\n\\centering\n\\caption{" + escape_latex(table.title) + "}\n";
  if (!table.conditions.empty()) text += comment(table.conditions);
  text += "\\begin{tabular}{" + alignment + "}\n\\hline\n" + latex_line_of(names_of(table));
  for (const auto& row : table.rows) text += latex_line_of(row);
  text += "\\end{tabular}\n\\end{table*}\n";
  for (const auto& note : table.notes) text += comment(note);
  return text + "\n";
}

}  // namespace

std::string as_latex(const Page& page) {
  std::string text;
  for (const auto& table : page.tables) text += latex_of(table);
  for (const auto& note : page.notes) text += comment(note);
  if (!page.legend.empty()) text += comment(page.legend);
  return text;
}

}  // namespace ontime::table
