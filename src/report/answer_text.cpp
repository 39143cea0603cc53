// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <functional>
#include <numeric>
#include <span>

#include <fmt/format.h>

#include "report/answer.hpp"
#include "report/answer_entries.hpp"
#include "report/runs.hpp"
#include "report/words.hpp"

namespace ontime::report {
namespace {

using Row = Answer::Row;
using State = Answer::State;

constexpr std::size_t few_lines = 2, most_lines = 6;  // of a caution

std::string spread_cell(const std::optional<Answer::Spread>& spread, bool whole) {
  if (!spread) return nothing;
  const auto low = milliseconds(spread->low_ns), high = milliseconds(spread->high_ns);
  const auto* const at_least = spread->is_least ? "≥ " : "";
  return at_least + (whole && low != high ? low + "–" + high : milliseconds(spread->median_ns));
}

std::string missed_of(const Row& row, bool with_cycles) {
  if (!row.knows_missed) return nothing;
  auto text = with_cycles ? fmt::format("{}/{}", row.missed, row.cycles) : grouped(row.missed);
  if (row.missed == 0) return text;
  return fmt::format("{} ({} %)", text, percent(share_of(row)));
}

std::string wait_of(const Row& row) {
  return row.worst_wait_ns ? (row.is_open ? "≥ " : "") + milliseconds(*row.worst_wait_ns) : nothing;
}

// A missed requirement says more than a late message, which may be within its limit.
const char* word_of(const Row& row) {
  const bool is_judged = row.state >= State::no_limit && row.state <= State::late;
  if (is_judged && row.missed_requirement) return "FAIL";
  return is_judged && row.open_requirement && row.state != State::late ? "open" : report::word_of(row.state);
}

// The places of so many rows that are worst, in the order of the rows. The greatest share is among them.
std::vector<std::size_t> worst_of(const std::vector<Row>& rows, std::size_t most) {
  std::vector<std::size_t> places(rows.size());
  std::iota(places.begin(), places.end(), 0);
  const auto rank = [](const Row& row) {
    if (row.state == State::failed) return 4;
    if (row.missed > 0 || row.missed_requirement) return 3;  // a run that was cut off need not have any
    return row.state >= State::running ? 2 : row.state == State::not_applied ? 1 : 0;
  };
  const auto badness = [&](std::size_t place) {
    const auto& row = rows[place];
    return std::tuple(rank(row), row.missed_requirement, row.open_requirement, share_of(row),
                      row.worst_wait_ns.value_or(0));
  };
  std::ranges::stable_sort(places, std::greater(), badness);
  if (places.size() > most) {
    const auto share_at = [&](std::size_t place) { return share_of(rows[place]); };
    const auto greatest = std::ranges::max_element(places, {}, share_at);
    if (greatest - places.begin() >= static_cast<std::ptrdiff_t>(most))
      std::iter_swap(greatest, places.begin() + static_cast<std::ptrdiff_t>(most) - 1);
    places.resize(most);
  }
  std::ranges::sort(places);
  return places;
}

Table table_of(const std::vector<Row>& rows, const std::vector<std::size_t>& places, std::size_t width) {
  using enum Column::Align;
  const bool same_cycles = rows.front().cycles > 0 && std::ranges::all_of(rows, [&](const Row& row) {
                             return row.cycles == rows.front().cycles;
                           });
  Table table{.columns = {{"", left},
                          {"", left},
                          {same_cycles ? fmt::format("not in time\nof {}", grouped(rows.front().cycles))
                                       : "not in\ntime"},
                          {"worst\nwait", right, false, 3},
                          {"p50", right, false, 1},
                          {"p99", right, false, 4},
                          {"max", right, false, 2},
                          {"", left}}};
  std::string before;
  for (const auto place : places) {
    const auto& row = rows[place];
    // The id "load" says the first word of "load, RT".
    const auto said = (row.conditions + ", ").starts_with(row.id + ", ") ? row.id.size() + 2 : 0;
    auto id = row.conditions.size() <= said ? row.id : row.id + " " + row.conditions.substr(said);
    const bool same = id == before;
    before = id;
    table.rows.push_back({same ? "" : id, row.name, missed_of(row, !same_cycles), wait_of(row),
                          spread_cell(row.p50, false), spread_cell(row.p99, true),
                          row.max_ns ? milliseconds(*row.max_ns) : nothing, word_of(row)});
  }
  // Names tell runs apart: where an id leaves no space for them, it stands on a line of its own.
  constexpr std::size_t gap = 2, id = 0, name = 1;
  const auto width_of_column = [&](std::size_t column) { return table::width_of_column(table, column); };
  std::size_t numbers = gap;
  for (std::size_t i = name + 1; i < table.columns.size(); ++i) numbers += gap + width_of_column(i);
  const auto left_by = [&](std::size_t taken) {
    return width > numbers + taken ? width - numbers - taken : 0;
  };
  // So much that a narrow terminal loses columns first.
  const auto name_width = std::max(width * 3 / 20 + gap, left_by(0));
  shorten_names(table.rows, name, name_width);
  if (const auto id_width = std::max(width / 4, left_by(width_of_column(name)));
      id_width + width_of_column(name) + numbers <= width)
    shorten_names(table.rows, id, id_width);
  return table;
}

std::size_t lines_in(const std::string& text, std::size_t width) {
  std::size_t lines = 0;
  for (const auto& line : split(text, '\n')) lines += line.empty() ? 0 : (width_of(line) + width - 1) / width;
  return lines;
}

// `lines`: of each that is shown.
std::string cautions_of(const Answer& answer, std::size_t width, std::span<const std::size_t> lines) {
  constexpr std::size_t heading = sizeof("Caution: ") - 1;
  std::string text;
  for (std::size_t i = 0; i < std::min(lines.size(), answer.cautions.size()); ++i) {
    // Words do not fill each of several lines, and those but the first are indented.
    const auto room = lines[i] == 1 ? width - std::min(heading, width)
                                    : lines[i] * (width - 2) - std::min(heading + 9, width);
    text += wrapped("Caution: " + shortened(printable(answer.cautions[i]), room), width);
  }
  return text + more_cautions(answer.cautions.size());
}

ordered_json ms(const std::optional<double>& ns) { return ns ? ordered_json(*ns / 1e6) : ordered_json(); }
ordered_json json_of(const std::optional<Answer::Spread>& of) {
  if (!of || of->is_least) return nullptr;
  return {{"low", of->low_ns / 1e6}, {"median", of->median_ns / 1e6}, {"high", of->high_ns / 1e6}};
}

}  // namespace

std::string steps_text(const std::vector<Answer::Step>& steps, std::size_t width) {
  std::size_t widest = 0;
  for (const auto& step : steps) widest = std::max(widest, width_of(step.why) + 1);
  std::string text;
  std::vector<std::string> to_fill_in;
  for (const auto& [why, command, fill_in] : steps) {  // a command stays on one line where it can
    const bool fits = widest + 2 + width_of(command) <= width;
    text += fits ? fmt::format("{:<{}}  {}\n", why + ":", widest, command)
                 : fmt::format("{}: {}\n", why, command);
    for (const auto& word : fill_in) add_once(to_fill_in, word);
  }
  return to_fill_in.empty() ? text : text + fmt::format("Fill in: {}\n", join(to_fill_in, ", "));
}

const char* word_of(State state) {
  constexpr const char* words[] = {"imported",    "no limit", "ok",      "LATE",
                                   "NOT APPLIED", "running",  "CUT OFF", "FAILED"};
  return words[static_cast<std::size_t>(state)];
}

std::string text_of(const Answer& answer, std::size_t width) {
  auto text = wrapped(printable(answer.sentence), width);
  if (answer.rows.empty()) return text;
  text += wrapped(
      printable((answer.conditions.empty() ? "" : answer.conditions + "; ") + answer.times + " in ms"),
      width);
  constexpr std::size_t header = 2, note = 1;
  const auto steps = steps_text(answer.next, width);
  std::string rest;
  std::size_t taken = 0;
  std::array<std::size_t, most_cautions> lines{};
  lines.fill(most_lines);
  const auto fits = [&] {
    rest = cautions_of(answer, width, lines) + steps;
    taken = lines_in(text, width) + lines_in(rest, width) + header;
    return taken + answer.rows.size() <= screen_lines;
  };
  // The fix stands at the end of a caution: it is cut only where all rows fit then, of the last one first.
  for (auto most = lines.rbegin(); most != lines.rend(); ++most)
    while (!fits() && *most > 1) --*most;
  if (!fits()) {
    lines.fill(few_lines);
    fits();
  }
  constexpr std::size_t fewest_rows = 2;
  const std::size_t free =
      taken + fewest_rows + note < screen_lines ? screen_lines - taken : fewest_rows + note;
  auto most = answer.rows.size() <= free ? answer.rows.size() : free - note;
  std::vector<std::size_t> shown;
  for (;; --most) {  // an id may take a line, too
    shown = worst_of(answer.rows, most);
    auto table = table::as_text({.tables = {table_of(answer.rows, shown, width)}}, width);
    table.pop_back();  // the empty line after it
    const auto rows = lines_in(table, width) - header + (most < answer.rows.size() ? note : 0);
    if (rows > free && most > fewest_rows) continue;
    text += table;
    break;
  }
  if (const auto more = answer.rows.size() - most; more > 0) {
    const auto is_bad = [](const Row& row) {
      return row.state > State::ok || row.missed_requirement || row.open_requirement;
    };
    const auto bad = std::ranges::count_if(answer.rows, is_bad) -
                     std::ranges::count_if(shown, [&](auto place) { return is_bad(answer.rows[place]); });
    const auto wait_of_row = [](const Row& row) { return row.worst_wait_ns.value_or(0); };
    const auto& waited = *std::ranges::max_element(answer.rows, {}, wait_of_row);
    const bool is_shown = std::ranges::any_of(
        shown, [&](auto place) { return wait_of_row(answer.rows[place]) == wait_of_row(waited); });
    std::vector<std::string> but;
    if (bad > 0) but.push_back(fmt::format("{} not ok", bad));
    if (!is_shown) but.push_back(fmt::format("one waited {} ms", wait_of(waited)));
    text += fmt::format("… and {}, none worse{}{}\n", many(more, "more row", "more rows"),
                        but.empty() ? "" : ", but ", join(but, ", "));
  }
  return text + rest;
}

ordered_json json_of(const Answer& answer) {
  auto rows = ordered_json::array(), next = ordered_json::array();
  for (const auto& row : answer.rows)
    rows.push_back({{"id", row.id},
                    {"conditions", row.conditions},
                    {"name", row.name},
                    {"runs", row.runs},
                    {"state", report::word_of(row.state)},
                    {"requirement", row.missed_requirement ? ordered_json("FAIL")
                                    : row.open_requirement ? ordered_json("open")
                                                           : ordered_json()},
                    {"cycles", row.cycles},
                    {"not_in_time", row.knows_missed ? ordered_json(row.missed) : ordered_json()},
                    {"worst_wait_ms", ms(row.worst_wait_ns)},
                    {"worst_wait_is_open", row.is_open},
                    {"p50_ms", json_of(row.p50)},
                    {"p99_ms", json_of(row.p99)},
                    {"max_ms", ms(row.max_ns)}});
  for (const auto& step : answer.next) next.push_back({{"why", step.why}, {"command", step.command}});
  return {{"sentence", answer.sentence},
          {"conditions", answer.conditions},
          {"rows", rows},
          {"cautions", answer.cautions},
          {"next", next}};
}

}  // namespace ontime::report
