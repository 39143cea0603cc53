// SPDX-License-Identifier: Apache-2.0
#include "plot/sheet.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include <fmt/format.h>

#include "report/words.hpp"

namespace ontime::plot {
namespace {

using namespace report;

constexpr double column_cm = 8.8, page_cm = 18.2;  // of a paper of two columns, as IEEE and ACM set them
constexpr int font_pt = 7;
constexpr double pixels_a_cm = 300 / 2.54;                         // of a PNG
constexpr double pixels_a_pt = 96.0 / 72;                          // of an SVG
constexpr double sample_cm = 0.85, mark_cm = 0.65, gap_cm = 0.35;  // of a legend

// Whole sizes: a part of a pixel is nothing to gnuplot.
std::string terminal(const Plot& plot, double width_cm, double height_cm) {
  if (plot.form == Plot::Form::svg)  // of 96 pixels an inch
    return fmt::format(
        "set terminal svg size {:.0f},{:.0f} font 'Helvetica,{:.1f}' linewidth 1 rounded noenhanced "
        "background '#ffffff'\n",
        width_cm / 2.54 * 96, height_cm / 2.54 * 96, font_pt * pixels_a_pt);
  if (plot.form == Plot::Form::pdf)
    return fmt::format(
        "set terminal pdfcairo size {:.2f}cm,{:.2f}cm font 'Helvetica,{}' linewidth 1 rounded noenhanced\n",
        width_cm, height_cm, font_pt);
  return fmt::format(
      "set terminal pngcairo size {0:.0f},{1:.0f} font 'Helvetica,{2}' fontscale {3:.3f} linewidth {3:.3f} "
      "pointscale {3:.3f} rounded noenhanced\n",
      width_cm * pixels_a_cm, height_cm * pixels_a_cm, font_pt, pixels_a_cm * 2.54 / 96);
}

constexpr const char* looks =
    "set encoding utf8\nset border 3 linewidth 0.7\nset tics out nomirror scale 0.5\nset grid ytics linetype "
    "1 linewidth 0.4 linecolor rgb '#dddddd'\nset key off\nset multiplot\n";

// As gnuplot's commands have it: nothing in it is a command. gnuplot reads nothing within single quotes but
// their end. A quote is a string of its own, joined by dots: doubled at the beginning it would end there.
std::string in_quotes(const std::string& text) {
  return "'" + replace_all(printable(text), "'", "'.\"\\047\".'") + "'";
}

// With "…" where there is more.
std::string fitting(const std::string& text, double width_cm) {
  constexpr double narrowest_cm = 0.06;
  auto most = std::min(width_of(text), static_cast<std::size_t>(width_cm / narrowest_cm));
  auto shown = shortened(text, most);
  while (text_width_cm(shown) > width_cm && most > 1) shown = shortened(text, --most);
  return shown;
}

// "300", "(2": what follows is counted.
bool is_number(const std::string& word) {
  return !word.empty() && word.find_first_not_of("0123456789.,+-([") == word.npos && word.back() >= '0' &&
         word.back() <= '9';
}

// "300 ms" is one.
std::vector<std::string> words_of(const std::string& text) {
  std::vector<std::string> words;
  for (auto& word : split(printable(text), ' '))
    if (!words.empty() && is_number(words.back()) && !word.empty() && !is_number(word))
      words.back() += " " + word;
    else
      words.push_back(std::move(word));
  return words;
}

}  // namespace

double text_width_cm(const std::string& text) {
  // In hundredths of the font's size, from the blank to '~'. Of others an upper limit of most.
  constexpr std::array<int, 95> ascii = {
      32, 40, 46, 84, 64, 95, 78, 28, 39,  39, 50, 84, 32, 36, 32, 34, 64, 64, 64, 64, 64, 64, 64, 64,
      64, 64, 34, 34, 84, 84, 84, 53, 100, 68, 69, 70, 77, 63, 58, 78, 75, 30, 30, 66, 56, 86, 75, 79,
      60, 79, 70, 64, 61, 73, 68, 99, 69,  61, 69, 39, 34, 39, 84, 50, 50, 61, 64, 55, 64, 62, 35, 64,
      63, 28, 28, 58, 28, 97, 63, 61, 64,  64, 41, 52, 39, 63, 59, 82, 59, 59, 53, 64, 34, 64, 84};
  constexpr int other = 84, wide = 100;  // "→"; of Chinese, for instance
  const auto is_within = [](char byte) { return (static_cast<unsigned char>(byte) & 0xc0U) == 0x80U; };
  int width = 0;
  for (std::size_t i = 0, next = 0; i < text.size(); i = next) {
    for (next = i + 1; next < text.size() && is_within(text[next]);) ++next;
    const auto letter = text.substr(i, next - i);
    const auto columns = width_of(letter);
    width += letter[0] >= ' ' && letter[0] <= '~' ? ascii[static_cast<std::size_t>(letter[0] - ' ')]
             : columns > 1                        ? wide
                                                  : other * static_cast<int>(columns);
  }
  return width / 100.0 * font_pt / 72 * 2.54;
}

std::string colour(std::size_t i) {
  constexpr std::array<const char*, colours> all = {"#0072b2", "#d55e00", "#009e73", "#cc79a7",
                                                    "#e69f00", "#56b4e9", "#000000"};
  return all[i % all.size()];
}

std::string dash(std::size_t i) {
  constexpr std::array<const char*, dashes> all = {"1", "(12,6)", "(4,5)", "(14,5,4,5)"};
  return all[i % all.size()];
}

std::vector<std::string> wrapped(const std::string& text, double width_cm) {
  constexpr std::size_t most_lines = 4;
  width_cm = std::max(width_cm, 1.0);
  std::vector<std::string> lines{""};
  for (const auto& word : words_of(text)) {
    const auto shown = fitting(word, width_cm), longer = lines.back() + " " + shown;
    if (lines.back().empty())
      lines.back() = shown;
    else if (text_width_cm(longer) <= width_cm)
      lines.back() = longer;
    else
      lines.push_back(shown);
  }
  if (lines.size() > most_lines) {
    lines.resize(most_lines);
    lines.back() = fitting(lines.back() + " …", width_cm);
  }
  return lines;
}

void add_lines(std::vector<Line>& title, const std::string& text, double width_cm, const char* style) {
  for (auto& line : wrapped(text, width_cm)) title.push_back({std::move(line), style});
}

double Sheet::width_cm(const Plot& plot) { return plot.wide ? page_cm : column_cm; }

Sheet::Sheet(const Plot& plot, double height_cm)
    : width_(width_cm(plot)), height_(height_cm), commands_(terminal(plot, width_, height_) + looks) {}

std::string Sheet::at(double x, double y) const {
  return fmt::format("screen {:.5f}, screen {:.5f}", x / width_, 1 - y / height_);
}

void Sheet::text(double x, double y, const std::string& text, const std::string& style) {
  commands_ += fmt::format("set label {} at {} {}\n", in_quotes(text), at(x, y), style);
}

void Sheet::line(double x, double y, double to_x, double to_y, const std::string& style) {
  commands_ += fmt::format("set arrow from {} to {} nohead {}\n", at(x, y), at(to_x, to_y), style);
}

void Sheet::point(double x, double y, const std::string& style) {
  commands_ += fmt::format("set label '' at {} point {}\n", at(x, y), style);
}

void Sheet::add(const std::string& command) { commands_ += command + "\n"; }

void Sheet::draw(const std::string& name, const std::string& lines, const std::string& with) {
  if (lines.empty()) return;
  commands_ += fmt::format("${} << END\n{}END\n", name, lines);
  draw(fmt::format("${} {}", name, with));
}

void Sheet::plot(const Box& axes) {
  commands_ += fmt::format(
      "set lmargin at screen {:.5f}\nset rmargin at screen {:.5f}\nset tmargin at screen {:.5f}\nset bmargin "
      "at screen {:.5f}\n",
      axes.left / width_, axes.right / width_, 1 - axes.top / height_, 1 - axes.bottom / height_);
  const auto parts = std::exchange(parts_, {});
  commands_ += "plot " + (parts.empty() ? "NaN" : join(parts, ", \\\n  ")) + "\nunset label\nunset arrow\n";
}

Legend::Legend(std::vector<Entry> entries, double width_cm) {
  double x = 0, y = 0;
  std::size_t lines_of_row = 1;
  for (auto& entry : entries) {
    std::vector<Line> lines;
    add_lines(lines, entry.text, width_cm - sample_cm);
    if (!entry.note.empty()) add_lines(lines, entry.note, width_cm - sample_cm, grey_text);
    double width = 0;
    const auto sample = entry.line.empty() && entry.point.empty() ? 0 : sample_cm;
    for (const auto& [text, style] : lines) width = std::max(width, sample + text_width_cm(text) + gap_cm);
    if (x > 0 && x + width - gap_cm > width_cm) {
      x = 0;
      y += line_cm * static_cast<double>(std::exchange(lines_of_row, 1));
    }
    lines_of_row = std::max(lines_of_row, lines.size());
    placed_.push_back({std::move(entry), std::move(lines), x, y});
    x += width;
  }
  height_ = placed_.empty() ? 0 : y + line_cm * static_cast<double>(lines_of_row);
}

void Legend::draw(Sheet& sheet, double left, double top) const {
  for (const auto& [entry, lines, x, y] : placed_) {
    const double middle = top + y + line_cm / 2, from = left + x;
    if (!entry.line.empty()) sheet.line(from, middle, from + mark_cm, middle, entry.line);
    if (!entry.point.empty()) sheet.point(from + mark_cm / 2, middle, entry.point);
    const auto words = entry.line.empty() && entry.point.empty() ? from : from + sample_cm;
    for (std::size_t i = 0; i < lines.size(); ++i)
      sheet.text(words, middle + line_cm * static_cast<double>(i), lines[i].text, lines[i].style);
  }
}

std::string number_text(double number) {
  if (number >= 999.5 && number < 1e15) return grouped(static_cast<std::uint64_t>(std::llround(number)));
  if (number <= 0 || number >= 1e-4) return fmt::format("{:g}", number);
  const auto text = fmt::format("{:.{}f}", number, decimals_that_show(number) + 2);
  return text.substr(0, text.find_last_not_of('0') + 1);
}

std::string time_tics(const char* axis, double least_ms, double greatest_ms) {
  // Fewer than two powers of ten: others have a name too. Of many only each third.
  const auto span = greatest_ms / least_ms;
  const bool all_named =
      span < 30 || std::floor(std::log10(greatest_ms)) - std::ceil(std::log10(least_ms)) < 1;
  const int every = span > 2e6 ? 3 : 1;
  const auto digits = span < 4 ? std::vector<double>{1, 1.5, 2, 3, 5, 7} : std::vector<double>{1, 2, 5};
  std::vector<std::string> tics;
  for (int power = -6; power < 8; ++power)
    for (const auto digit : digits) {
      const auto ms = digit * std::pow(10, power);
      if (ms < least_ms || ms > greatest_ms) continue;
      const bool named = (digit == 1 && power % every == 0) || all_named;
      const auto [unit, size] = ms >= 999        ? std::pair{"s", 1e3}
                                : ms >= 0.999    ? std::pair{"ms", 1.0}
                                : ms >= 0.000999 ? std::pair{"µs", 1e-3}
                                                 : std::pair{"ns", 1e-6};
      tics.push_back(named ? fmt::format("'{:g} {}' {:g}", ms / size, unit, ms)
                           : fmt::format("'' {:g} 1", ms));
    }
  return fmt::format("set {}tics ({})", axis, join(tics, ", "));
}

std::string share_tics(const char* axis, double least) {
  std::vector<std::string> tics;
  for (int power = 0; power > -12; --power) {
    const auto share = std::pow(10, power);
    if (share < least) break;
    tics.push_back(fmt::format(
        "'{}' {:g}",
        share >= 0.9e-4 ? fmt::format("{:g} %%", share * 100) : fmt::format("{:g} ppm", share * 1e6), share));
  }
  return fmt::format("set {}tics ({})", axis, join(tics, ", "));
}

}  // namespace ontime::plot
