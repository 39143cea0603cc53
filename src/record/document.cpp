// SPDX-License-Identifier: Apache-2.0
#include "record/document.hpp"

#include <array>
#include <cmath>
#include <cstdint>
#include <stdexcept>

#include <sodium.h>

#include "json.hpp"
#include "record/record.hpp"

namespace ontime::record {
namespace {

using nlohmann::json;

constexpr int deepest = 64;

// Members that differ between repetitions of the same conditions, and texts for users.
constexpr const char* not_of_the_key[] = {"adds_to",    "command_line", "imported", "kept",          "ontime",
                                          "repetition", "require",      "scenario", "scenario_file", "search",
                                          "title",      "variant",      "varied"};

// One form for what means the same: no matter whether a number was written 10 or 10.0, and whether something
// was left empty or left out. By that, what only a later version can be asked for leaves the keys of all runs
// that do not ask for it as they were.
json canonical(const json& value) {
  if (value.is_number_float()) {
    constexpr double exact_up_to = 9007199254740992;  // 2^53
    const double number = value.get<double>();
    const bool whole = std::abs(number) <= exact_up_to && number == std::trunc(number);
    return whole ? json(static_cast<std::int64_t>(number)) : value;
  }
  if (value.is_array()) {
    auto result = json::array();
    for (const auto& element : value) result.push_back(canonical(element));
    return result;
  }
  if (!value.is_object()) return value;
  auto result = json::object();
  for (const auto& [name, member] : value.items()) {
    auto kept = canonical(member);
    const bool says_nothing =
        kept.is_string() ? kept.get_ref<const std::string&>().empty() : kept.empty();  // null is, 0 is not
    if (!says_nothing) result[name] = std::move(kept);
  }
  return result;
}

}  // namespace

std::string text_of(const json& value) { return value.dump(-1, ' ', false, json::error_handler_t::replace); }

std::string utf8_of(const std::string& text) { return parsed_json(text_of(text)).get<std::string>(); }

// Counted before anything is parsed: nlohmann's parser, asked to look at each depth, takes a time that grows
// with the square of an object's members.
bool is_nested_deeper(const std::string& text, int levels) {
  int depth = 0;
  bool in_string = false;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    if (in_string) {
      if (c == '\\') ++i;
      if (c == '"') in_string = false;
    } else if (c == '"') {
      in_string = true;
    } else if (c == '[' || c == '{') {
      if (++depth > levels) return true;
    } else if (c == ']' || c == '}') {
      --depth;
    }
  }
  return false;
}

std::optional<json> json_of(const std::string& text) {
  if (text.size() > longest_text || is_nested_deeper(text, deepest)) return std::nullopt;
  auto value = json_or_discarded(text);
  if (value.is_discarded()) return std::nullopt;
  return value;
}

const json& at(const json& object, std::string_view key) {
  static const json none;
  if (!object.is_object()) return none;
  const auto found = object.find(key);
  return found == object.end() ? none : *found;
}

json conditions_of(const json& asked) {
  auto conditions = canonical(asked);
  if (!conditions.is_object()) return conditions;
  for (const auto* name : not_of_the_key) conditions.erase(name);
  // What they were before they could be chosen.
  conditions.emplace("ping_topic", "/ping");
  conditions.emplace("pong_topic", "/pong");
  return conditions;
}

std::string key_of(const json& asked) {
  if (sodium_init() < 0) throw std::runtime_error("libsodium does not start");
  const auto text = text_of(conditions_of(asked));  // objects are sorted by name
  std::array<unsigned char, crypto_generichash_BYTES_MIN> hash;
  crypto_generichash(hash.data(), hash.size(), reinterpret_cast<const unsigned char*>(text.data()),
                     text.size(), nullptr, 0);
  std::array<char, 2 * hash.size() + 1> digits;
  return sodium_bin2hex(digits.data(), digits.size(), hash.data(), hash.size());
}

}  // namespace ontime::record
