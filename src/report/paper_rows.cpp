// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <iterator>
#include <sstream>

#include "report/paper.hpp"
#include "report/words.hpp"

namespace ontime::report {
namespace {

// Captions, the second column, are quoted where they hold commas; all others are plain.
PaperRow row_of(const std::string& line) {
  const auto number = [](const std::string& text) { return std::stoll(text); };
  constexpr std::size_t after_caption = 7;
  const auto fields = split(line, ',');
  const auto* const last = &fields.at(fields.size() - after_caption);
  return {fields.front(),
          join({fields.begin() + 1, fields.end() - after_caption}, ","),
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

double traffic_bit_s_of(const std::string& caption) {
  const auto unit = caption.find(" Mbps");
  if (unit == caption.npos) return 0;
  return std::stod(caption.substr(caption.rfind(' ', unit - 1) + 1)) * 1e6;
}

bool has_load(const nlohmann::json& asked) {
  for (const auto* host : {"controller", "component"})
    for (const auto* kind : {"cpu", "vm", "io", "hdd"})
      if (count(at(at(at(asked, "load"), host), kind)) > 0) return true;
  return false;
}

// In what a scenario sets beside the times; how much of a load there is need not be the same.
bool is_as(const std::string& caption, const nlohmann::json& asked) {
  const auto says = [&](const char* words) { return caption.find(words) != caption.npos; };
  const auto& bit_s = at(at(asked, "traffic"), "bit_s");
  return is_true(at(asked, "realtime")) == says("RT settings") && has_load(asked) == says("under load") &&
         (bit_s.is_number() ? bit_s.get<double>() : 0) == traffic_bit_s_of(caption) &&
         !at(asked, "kernel").is_null() == says("ksoftirqd") && at(asked, "link").is_null();
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
               [&](const PaperRow& row) { return row.test == id && is_as(row.caption, asked); });
  return rows;
}

}  // namespace ontime::report
