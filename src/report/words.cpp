// SPDX-License-Identifier: Apache-2.0
#include "report/words.hpp"

#include <cmath>
#include <map>

#include <fmt/format.h>

#include "gate/gate.hpp"
#include "record/document.hpp"

namespace ontime::report {

std::string word(const nlohmann::json& value) {
  if (value.is_null()) return nothing;
  return printable(value.is_string() ? value.get<std::string>() : record::text_of(value));
}

std::string word(const std::string& text) { return text.empty() ? nothing : printable(text); }
std::string word(std::optional<std::int64_t> number) { return number ? fmt::format("{}", *number) : nothing; }

const char* word_of(roundtrip::Fate fate) {
  using roundtrip::Fate;
  return fate == Fate::on_time ? "on time" : fate == Fate::late ? "late" : "lost";
}

const char* quantity_of(const record::Asked& asked) {
  if (asked.imported) return "Wake-up latency";
  if (!asked.is_listened()) return "Round trip";
  return asked.measures == "age" ? "Age" : "Period";
}

std::string id_of(const record::Asked& asked) {
  // A topic's age and its period have ids that differ at their ends alone.
  const auto id = word(asked.id), quantity = " " + asked.measures;
  if (!asked.is_listened() || !id.ends_with(quantity)) return shortened(id, gate::longest_id);
  return shortened(id.substr(0, id.size() - quantity.size()), gate::longest_id - quantity.size()) + quantity;
}

std::string cell_of(const nlohmann::ordered_json& value) {
  if (value.is_null()) return "";
  return value.is_string() ? value.get<std::string>()
                           : value.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

std::vector<Column> columns_of(const std::string& first, std::initializer_list<const char*> others) {
  std::vector<Column> columns = {{first, Column::Align::left}};
  for (const auto* name : others) columns.push_back({name});
  return columns;
}

std::string cell_at(const nlohmann::ordered_json& object, const std::vector<std::string>& path) {
  const auto* value = &object;
  for (const auto& key : path) {
    if (!value->is_object() || !value->contains(key)) return "";
    value = &value->at(key);
  }
  return cell_of(*value);
}

void shorten_names(std::vector<std::vector<std::string>>& rows, std::size_t column, std::size_t most) {
  std::map<std::pair<std::size_t, std::string>, std::vector<std::string*>> by_short;
  std::size_t group = 0;
  for (auto& row : rows) {
    if (column > 0 && !row.front().empty()) ++group;
    by_short[{group, shortened(row[column], most)}].push_back(&row[column]);
  }
  for (const auto& alike : by_short) {
    const auto& names = alike.second;
    const auto& first = *names.front();
    auto common = first.size();
    for (const auto* name : names)
      common =
          std::min(common, static_cast<std::size_t>(std::ranges::mismatch(*name, first).in1 - name->begin()));
    auto from = common;
    for (int word = 0; word < 2 && from > 0 && from != std::string::npos; ++word)
      from = first.rfind(' ', from - 1);
    if (from == std::string::npos || common - from > most / 3) {  // words too long for that
      from = common - std::min(common, most / 3);
      while (from > 0 && from < first.size() && (static_cast<unsigned char>(first[from]) & 0xc0U) == 0x80U)
        --from;
    }
    const bool differ = std::ranges::any_of(names, [&](const auto* name) { return *name != first; });
    for (auto* name : names)
      *name = shortened(
          differ && from > 0 ? shortened(name->substr(0, from), most / 3) + name->substr(from) : *name, most);
  }
}

void add_once(std::vector<std::string>& all, const std::string& text) {
  if (std::ranges::find(all, text) == all.end()) all.push_back(text);
}

std::string microseconds(double ns) {
  const double us = ns / 1e3;
  return fmt::format("{:.{}f}", us, std::abs(us) < 99.95 ? 1 : 0);
}

std::string milliseconds(double ns) {
  const double ms = ns / 1e6;
  if (ms > 0 && ms < 0.0005) return fmt::format("{:.{}f}", ms, decimals_that_show(ms));
  return fmt::format("{:.{}f}", ms, ms < 0.0995 ? 3 : ms < 0.995 ? 2 : ms < 99.5 ? 1 : 0);
}

double rounded_up(double number) {
  const double unit = std::pow(10, std::floor(std::log10(number)) - 1);
  return std::ceil(number / unit) * unit;
}

std::string duration(std::chrono::nanoseconds time) {
  const auto value = static_cast<double>(time.count()) / 1e3;
  if (value >= 3600e6 && std::fmod(value, 360e6) == 0) return fmt::format("{:.6g} h", value / 3600e6);
  if (value >= 999'999.5e6) return fmt::format("{:.0f} s", value / 1e6);  // without an exponent
  if (value >= 1e6) return fmt::format("{:.6g} s", value / 1e6);
  if (value >= 1e3) return fmt::format("{:.6g} ms", value / 1e3);
  if (value > 0 && value < 1) return fmt::format("{} ns", time.count());
  return fmt::format("{:.6g} µs", value);
}

std::string megabits(std::optional<double> bit_s) { return bit_s ? table::megabits(*bit_s) : nothing; }

std::string size(std::uint64_t bytes) {
  if (bytes >= 1 << 20 && bytes % (1 << 20) == 0) return fmt::format("{} MiB", bytes >> 20);
  if (bytes >= 1 << 10 && bytes % (1 << 10) == 0) return fmt::format("{} KiB", bytes >> 10);
  return fmt::format("{} B", bytes);
}

std::string more_cautions(std::size_t all) {
  if (all <= most_cautions) return "";
  return fmt::format("… and {} (--full)\n", many(all - most_cautions, "more caution", "more cautions"));
}

}  // namespace ontime::report
