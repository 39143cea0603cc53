// SPDX-License-Identifier: Apache-2.0
#include "report/words.hpp"

#include <cmath>

#include <boost/algorithm/string/split.hpp>
#include <fmt/format.h>
#include <fmt/ranges.h>

namespace ontime::report {

std::string word(const nlohmann::json& value) {
  if (value.is_null()) return nothing;
  const auto text = value.is_string() ? value.get<std::string>()
                                      : value.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
  return printable(text);
}

std::string id_of(const nlohmann::json& asked) { return shortened(word(at(asked, "id")), gate::longest_id); }

std::string cell_of(const nlohmann::ordered_json& value) {
  if (value.is_null()) return "";
  return value.is_string() ? value.get<std::string>()
                           : value.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

bool is_true(const nlohmann::json& value) { return value.is_boolean() && value.get<bool>(); }
bool is_said(const nlohmann::json& value) {
  return value.is_string() && !value.get_ref<const std::string&>().empty();
}

std::uint64_t count(const nlohmann::json& value) {
  return value.is_number_integer() && value >= 0 ? value.get<std::uint64_t>() : 0;
}

std::string microseconds(double ns) {
  const double us = ns / 1e3;
  return fmt::format("{:.{}f}", us, std::abs(us) < 99.95 ? 1 : 0);
}

std::string duration(const nlohmann::json& us) {
  if (!us.is_number()) return nothing;
  const auto value = us.get<double>();
  if (value >= 1e6) return fmt::format("{:.6g} s", value / 1e6);
  if (value >= 1e3) return fmt::format("{:.6g} ms", value / 1e3);
  return fmt::format("{:.6g} µs", value);
}

std::string megabits(const nlohmann::json& bit_s) {
  return bit_s.is_number() ? fmt::format("{:.4g}", bit_s.get<double>() / 1e6) : nothing;
}

std::string many(std::uint64_t number, const char* one, const char* several) {
  return fmt::format("{} {}", number, number == 1 ? one : several);
}

std::string size(const nlohmann::json& bytes) {
  if (!bytes.is_number_integer()) return nothing;
  const auto value = count(bytes);
  if (value >= 1 << 20 && value % (1 << 20) == 0) return fmt::format("{} MiB", value >> 20);
  if (value >= 1 << 10 && value % (1 << 10) == 0) return fmt::format("{} KiB", value >> 10);
  return fmt::format("{} B", value);
}

std::string shortened(const std::string& text, std::size_t most) {
  const auto beginning = fmt::format("{:.{}}", text, most);  // fmt counts code points
  return beginning.size() < text.size() ? beginning + "…" : text;
}

std::string join(const std::vector<std::string>& parts, std::string_view separator) {
  return fmt::format("{}", fmt::join(parts, separator));
}

std::vector<std::string> split(const std::string& text, char separator) {
  std::vector<std::string> parts;
  boost::algorithm::split(parts, text, [&](char c) { return c == separator; });
  return parts;
}

std::string replace_all(std::string text, std::string_view what, std::string_view with) {
  for (auto found = text.find(what); found != std::string::npos; found = text.find(what, found + with.size()))
    text.replace(found, what.size(), with);
  return text;
}

}  // namespace ontime::report
