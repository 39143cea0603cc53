// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <map>
#include <string_view>

#include <fmt/format.h>

#include "table/table.hpp"

namespace ontime::table {
namespace {

// LaTeX keeps 18 figures and tables without a place, those of the document around these among them.
constexpr std::size_t most_unplaced = 10;

// pdflatex stops at a letter that it does not know. With T1 fonts it knows these; others become their number,
// unless escape_latex() has a sign for them.
bool is_known(std::string_view letter) {
  const auto is_one_of = [&](std::string_view letters) { return letters.find(letter) != letters.npos; };
  return letter.size() == 2 ? letter < "\u0180" && !is_one_of("ĦħĸĿŀŉŦŧſ") : is_one_of("—‘’“”„€");
}

std::string number_of(std::string_view letter) {
  auto value = static_cast<unsigned char>(letter[0]) & (0x7fU >> letter.size());
  for (const char c : letter.substr(1)) value = value << 6U | (static_cast<unsigned char>(c) & 0x3fU);
  return fmt::format("\\texttt{{U+{:04X}}}", value);
}

std::string escape_latex(const std::string& text) {
  static const std::map<std::string_view, const char*> commands = {{"\\", "\\textbackslash{}"},
                                                                   {"~", "\\textasciitilde{}"},
                                                                   {"^", "\\textasciicircum{}"},
                                                                   {"<", "\\textless{}"},
                                                                   {">", "\\textgreater{}"},
                                                                   {"|", "\\textbar{}"},
                                                                   {"\n", " "},
                                                                   {"µ", "$\\mu$"},
                                                                   {"μ", "$\\mu$"},
                                                                   {"λ", "$\\lambda$"},
                                                                   {"Δ", "$\\Delta$"},
                                                                   {"Ω", "$\\Omega$"},
                                                                   {"·", "$\\cdot$"},
                                                                   {"±", "$\\pm$"},
                                                                   {"≤", "$\\leq$"},
                                                                   {"≥", "$\\geq$"},
                                                                   {"→", "$\\rightarrow$"},
                                                                   {"×", "$\\times$"},
                                                                   {"−", "$-$"},
                                                                   {"⁻", "$^{-}$"},
                                                                   {"⁶", "$^{6}$"},
                                                                   {"–", "--"},
                                                                   {"█", "\\rule{.5em}{1ex}"},
                                                                   {"…", "\\ldots{}"}};
  std::string result;
  for (std::size_t i = 0, length = 0; i < text.size(); i += length) {
    const auto first = static_cast<unsigned char>(text[i]);
    length = first < 0xc0 ? 1 : first < 0xe0 ? 2 : first < 0xf0 ? 3 : 4;
    const auto letter = std::string_view(text).substr(i, length);
    if (const auto command = commands.find(letter); command != commands.end())
      result += command->second;
    else if (length > 1 && !is_known(letter))
      result += number_of(letter);
    else
      result.append(std::string_view("{}$&#_%").find(letter) == letter.npos ? "" : "\\").append(letter);
  }
  return result;
}

std::string latex_line_of(std::vector<std::string> cells) {
  for (auto& cell : cells) cell = escape_latex(cell);
  return join(cells, " & ") + " \\\\ \\hline\n";
}

// A note stays with its table without being printed.
std::string comment(const std::string& note) { return "% " + replace_all(note, "\n", " ") + "\n"; }

// Below the table, where readers of the document see it.
std::string printed_below(const std::vector<std::string>& texts) {
  std::vector<std::string> paragraphs;
  for (const auto& text : texts)
    if (!text.empty()) paragraphs.push_back(escape_latex(text));
  if (paragraphs.empty()) return "";
  return "\\par\\smallskip\n\\begin{minipage}{\\linewidth}\\footnotesize\n" + join(paragraphs, "\\par\n") +
         "\n\\end{minipage}\n";
}

std::string latex_of(const Table& whole, const std::string& legend) {
  const auto table = without_unknown(whole);
  std::string alignment = "|";
  for (const auto& column : table.columns) alignment += column.align == Column::Align::left ? "l|" : "r|";
  std::string text = "\\begin{table*}[ht]\n\\centering\n\\caption{" + escape_latex(table.title) + "}\n";
  text += "\\begin{tabular}{" + alignment + "}\n\\hline\n" + latex_line_of(names_of(table));
  for (const auto& row : table.rows) text += latex_line_of(row);
  text += "\\end{tabular}\n" + printed_below({table.conditions, legend}) + "\\end{table*}\n";
  for (const auto& note : table.notes) text += comment(note);
  return text + "\n";
}

}  // namespace

std::string as_latex(const Page& page) {
  const bool has_own = std::ranges::any_of(page.tables, [](const Table& one) { return !one.legend.empty(); });
  std::string text;
  for (std::size_t i = 0; i < page.tables.size(); ++i)
    text += (i > 0 && i % most_unplaced == 0 ? "\\clearpage\n" : "") +
            latex_of(page.tables[i], has_own ? page.tables[i].legend : page.legend);
  for (const auto& note : page.notes) text += comment(note);
  return text;
}

}  // namespace ontime::table
