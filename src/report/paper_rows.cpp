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

// In what a scenario sets beside the times; how much of a load there is need not be the same.
bool is_as(const std::string& caption, const record::Asked& asked) {
  const auto says = [&](const char* words) { return caption.find(words) != caption.npos; };
  return asked.task.realtime.on == says("RT settings") &&
         (asked.controller_load.any() || asked.component_load.any()) == says("under load") &&
         static_cast<double>(asked.traffic.bits_per_s) == traffic_bit_s_of(caption) &&
         !asked.kernel.empty() == says("ksoftirqd") && !asked.faults.any();
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

std::vector<PaperRow> paper_rows(const record::Asked& asked) {
  constexpr std::chrono::milliseconds period{10};
  const auto& client = asked.task.client;
  std::vector<PaperRow> rows;
  if (client.period != period || client.deadline != period ||
      client.schedule != roundtrip::Schedule::next_free || client.payload_bytes != payload_of(asked.id))
    return rows;
  std::ranges::copy_if(paper(), std::back_inserter(rows), [&](const PaperRow& row) {
    return row.test == asked.id && is_as(row.caption, asked);
  });
  return rows;
}

}  // namespace ontime::report
