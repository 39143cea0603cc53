// SPDX-License-Identifier: Apache-2.0
// What the rows of the list of fields are made of: a codec for each kind of value.
#pragma once

#include <cmath>
#include <initializer_list>
#include <limits>
#include <stdexcept>
#include <type_traits>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "conditions/conditions.hpp"

namespace ontime::conditions {

using Text = const std::string&;
using Json = const nlohmann::json&;

// A value in words (of a scenario or a flag) and in JSON, both ways. All throw std::exception.
template <typename Value>
struct Codec {
  std::function<Value(Text)> of_text;
  std::function<nlohmann::json(const Value&)> to_json;
  std::function<Value(Json)> of_json;
  std::string values{};  // for people, where they follow from it: "on|off"
  Field::Unit unit = Field::Unit::none;
};

// Where a run holds a value.
template <typename Value>
using Place = std::function<std::type_identity_t<Value>&(Run&)>;

// How a field is said: as Field has it.
struct Said {
  std::string path, flag, values, help;
  Field::For end = Field::For::client;
  std::string phrase{};
};
inline constexpr auto client = Field::For::client, both = Field::For::both;

template <typename Value>
Field field(Said said, std::string json, Codec<Value> codec, Place<Value> place) {
  Field made{said.path,   said.flag, said.values.empty() ? codec.values : said.values, said.help, said.end,
             said.phrase, codec.unit};
  if (!said.path.empty() && codec.of_text)
    made.set = [place, of_text = codec.of_text](Run& run, Text text) { place(run) = of_text(text); };
  if (json.empty()) return made;
  made.json = std::move(json);
  // A place is where to read and to write; a copy of a whole run to read one value would be a waste.
  made.to_json = [place, to = codec.to_json](const Run& run) { return to(place(const_cast<Run&>(run))); };
  made.from_json = [place, of_json = codec.of_json](Run& run, Json from) { place(run) = of_json(from); };
  return made;
}
// The same, of what is in JSON alone.
template <typename Value>
Field recorded(std::string json, Codec<Value> codec, Place<Value> place) {
  return field<Value>({}, std::move(json), std::move(codec), std::move(place));
}
// The same, of what is said in a way of its own.
inline Field said(Field field, std::function<void(Run&, Text)> set) {
  field.set = std::move(set);
  return field;
}

// ── Codecs ──

bool yes_or_no(Text);
double finite(Json);  // throws for what is no number

inline Codec<std::string> text() {
  return {[](Text text) { return text; }, [](Text value) { return nlohmann::json(value); },
          [](Json from) { return from.get<std::string>(); }};
}
// Where none is said by null.
inline Codec<std::string> text_or_null() {
  auto codec = text();
  codec.to_json = [](Text value) { return value.empty() ? nlohmann::json() : nlohmann::json(value); };
  return codec;
}
inline Codec<bool> on_or_off() {
  return {yes_or_no, [](bool value) { return nlohmann::json(value); },
          [](Json from) { return from.get<bool>(); }, "on|off"};
}
// Where only `on` says something.
inline Codec<bool> on_or_null() {
  auto codec = on_or_off();
  codec.to_json = [](bool value) { return value ? nlohmann::json(true) : nlohmann::json(); };
  return codec;
}

template <typename Number>
Number whole(Json from) {
  const auto value = finite(from);
  if (value != std::floor(value) || value < static_cast<double>(std::numeric_limits<Number>::min()) ||
      value >= std::ldexp(1.0, std::numeric_limits<Number>::digits))
    throw std::invalid_argument(from.dump() + " is not such a number");
  return from.is_number_float() ? static_cast<Number>(value) : from.get<Number>();
}
template <typename Number>
nlohmann::json as_is(const Number& value) {
  return value;
}
// With another way from words than a plain number.
template <typename Number>
Codec<Number> number(std::type_identity_t<std::function<Number(Text)>> of_text) {
  return {std::move(of_text), as_is<Number>, whole<Number>};
}
template <typename Number>
Codec<Number> number(std::int64_t least, std::int64_t most) {
  auto codec = number<Number>([=](Text text) { return static_cast<Number>(number_of(text, least, most)); });
  codec.values = fmt::format("{}-{}", least, most);
  return codec;
}
inline Codec<std::optional<int>> number_or_null(std::int64_t least, std::int64_t most) {
  return {[=](Text text) { return std::optional(static_cast<int>(number_of(text, least, most))); },
          [](const std::optional<int>& value) { return value ? nlohmann::json(*value) : nlohmann::json(); },
          [](Json from) { return std::optional(whole<int>(from)); }, fmt::format("{}-{}", least, most)};
}
inline Codec<std::uint64_t> size(std::function<std::uint64_t(Text)> of_text = bytes_of) {
  auto codec = number<std::uint64_t>(std::move(of_text));
  codec.values = "SIZE";
  codec.unit = Field::Unit::bytes;
  return codec;
}
inline Codec<double> share(std::function<double(Text)> of_text = share_of) {
  return {std::move(of_text), as_is<double>, finite, "PERCENT", Field::Unit::share};
}

// A time that JSON has in units of so many ns: µs, s.
inline constexpr double us = 1e3, s = 1e9;
inline std::chrono::nanoseconds time_from(Json from, double unit_ns) {
  const auto value = static_cast<long double>(finite(from)) * unit_ns;  // exact for what can be asked
  if (std::abs(value) > 9e18L) throw std::invalid_argument(from.dump() + " is out of range");
  return std::chrono::nanoseconds(std::llround(value));
}
inline double in_us(std::chrono::nanoseconds time) { return static_cast<double>(time.count()) / us; }
inline Codec<std::chrono::nanoseconds> time(double unit_ns,
                                            std::function<std::chrono::nanoseconds(Text)> of_text) {
  return {
      std::move(of_text),
      [=](const std::chrono::nanoseconds& value) { return nlohmann::json(in_us(value) / (unit_ns / us)); },
      [=](Json from) { return time_from(from, unit_ns); }, "TIME",
      unit_ns == us ? Field::Unit::us : Field::Unit::s};
}

// One of these words, each of which word_of() gives for its value.
template <typename Value>
Codec<Value> words(std::initializer_list<Value> all, const char* (*word_of)(Value)) {
  std::vector<std::pair<std::string, Value>> known;
  std::vector<std::string> names;
  for (const auto value : all) known.emplace_back(names.emplace_back(word_of(value)), value);
  const auto of_text = [known, names](Text text) {
    for (const auto& [word, value] : known)
      if (word == text) return value;
    throw std::invalid_argument(fmt::format("'{}' is not one of {}", text, fmt::join(names, ", ")));
  };
  return {of_text, [word_of](const Value& value) { return nlohmann::json(word_of(value)); },
          [of_text](Json from) { return of_text(from.get<std::string>()); },
          fmt::format("{}", fmt::join(names, "|"))};
}

// What the files of the list add to it.
using Fields = std::vector<Field>;
void add(Fields& all, Fields more);
Fields realtime_fields();
Fields network_fields();    // concurrent traffic, and the link's faults
Fields neighbour_fields();  // ordinary topics beside the critical one
Fields isolation_fields();
Fields kernel_fields();
std::uint64_t payload_of(Text);
inline std::chrono::nanoseconds up_to_an_hour(Text text) {
  return positive_duration(text, std::chrono::hours(1));
}
Codec<transport::Reliability> reliability();

}  // namespace ontime::conditions
