// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <iterator>
#include <sstream>

#include "report/paper.hpp"
#include "report/words.hpp"

namespace ontime::report {
namespace {

// Titles, the second column, are quoted where they hold commas; all others are plain.
PaperRow row_of(const std::string& line) {
  const auto number = [](const std::string& text) { return std::stoll(text); };
  constexpr std::size_t after_title = 7;
  const auto fields = split(line, ',');
  const auto* const last = &fields.at(fields.size() - after_title);
  return {fields.front(),
          last[0],
          number(last[1]),
          number(last[2]),
          number(last[3]),
          static_cast<std::uint64_t>(number(last[4])),
          static_cast<std::uint64_t>(number(last[5])),
          static_cast<std::uint64_t>(number(last[6]))};
}

std::uint64_t payload_of(const std::string& test) {
  constexpr std::uint64_t kib = 1024;
  if (test == "Test3.A" || test == "Test3.B") return 32 * kib;
  return test == "Test3.C" ? 128 * kib : 500;
}

}  // namespace

const std::vector<PaperRow>& paper() {
  static const auto rows = [] {
    std::vector<PaperRow> all;
    std::istringstream lines(paper_csv);
    std::string line;
    std::getline(lines, line);  // the columns' names
    while (std::getline(lines, line))
      if (!line.empty()) all.push_back(row_of(line));
    return all;
  }();
  return rows;
}

std::vector<PaperRow> paper_rows(const nlohmann::json& asked) {
  constexpr double period_us = 10000;
  const auto id = word(at(asked, "id"));
  std::vector<PaperRow> rows;
  if (at(asked, "period_us") != period_us || at(asked, "deadline_us") != period_us ||
      at(asked, "schedule") != "next-free" || count(at(asked, "payload_bytes")) != payload_of(id))
    return rows;
  std::copy_if(paper().begin(), paper().end(), std::back_inserter(rows),
               [&](const PaperRow& row) { return row.test == id; });
  return rows;
}

}  // namespace ontime::report
