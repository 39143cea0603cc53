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
  std::function<std::string(const Value&)> to_text;  // empty: "" is its text
  std::function<nlohmann::json(const Value&)> to_json;
  std::function<Value(Json)> of_json;
  std::string values{};  // for people, where they follow from it: "on|off"
  Field::Unit unit = Field::Unit::none;
};

// Where a run holds a value.
template <typename Value>
using Place = std::function<std::type_identity_t<Value>&(Run&)>;

// A nested member: within(&Run::faults, &Faults::loss).
template <typename... Members>
auto within(Members... path) {
  return [=](Run & run) -> auto& { return (run.*....*path); };
}

inline constexpr auto client = Field::For::client, both = Field::For::both;

// A key whose text sets that place. Its default is what a run has there; "none": no text sets that.
template <typename Value>
Field said_at(Field key, Codec<Value> codec, Place<Value> place) {
  if (key.by_default.empty()) try {
      Run run;
      key.by_default = codec.to_text ? codec.to_text(place(run)) : "";
      codec.of_text(key.by_default);
    } catch (const std::invalid_argument&) {
      key.by_default = "none";
    }
  if (key.values.empty()) key.values = codec.values;
  key.set = [place, of_text = codec.of_text](Run& run, Text text) { place(run) = of_text(text); };
  key.stated = [of_text = codec.of_text, to = codec.to_json](Text text) { return to(of_text(text)); };
  return key;
}
// A field that JSON has; `made`: its key, if it has one.
template <typename Value>
Field recorded(std::string json, Codec<Value> codec, Place<Value> place, Field made = {}) {
  made.unit = codec.unit;
  made.json = std::move(json);
  // A place is where to read and to write; a copy of a whole run to read one value would be a waste.
  made.to_json = [place, to = codec.to_json](const Run& run) { return to(place(const_cast<Run&>(run))); };
  made.from_json = [place, of_json = codec.of_json](Run& run, Json from) { place(run) = of_json(from); };
  return made;
}
// `key`: its path, flag and help.
template <typename Value>
Field field(Field key, std::string json, Codec<Value> codec, Place<Value> place) {
  return recorded(std::move(json), codec, place, said_at(std::move(key), codec, place));
}
// A field whose text `set` parses in its own way.
inline Field said(Field field, std::function<void(Run&, Text)> set) {
  field.set = std::move(set);
  return field;
}

// ── Codecs ──

bool yes_or_no(Text);
double finite(Json);  // throws if it is not a finite number

// In JSON as it is.
template <typename Value>
Codec<Value> plain(std::function<Value(Text)> of_text = {},
                   std::function<std::string(const Value&)> to_text = {}, std::string values = {}) {
  return {std::move(of_text), std::move(to_text), [](const Value& value) { return nlohmann::json(value); },
          [](Json from) { return from.get<Value>(); }, std::move(values)};
}
inline Codec<std::string> text() {
  const auto same = [](Text text) { return text; };
  return plain<std::string>(same, same);
}
inline Codec<bool> on_or_off() {
  return plain<bool>(
      yes_or_no, [](bool is_on) { return is_on ? "on" : "off"; }, "on|off");
}
// Where the value without a statement (off, empty) is null in JSON.
template <typename Value>
Codec<Value> or_null(Codec<Value> codec) {
  codec.to_json = [to_json = codec.to_json](const Value& value) {
    return value == Value{} ? nlohmann::json() : to_json(value);
  };
  return codec;
}
template <typename Value>
Codec<std::optional<Value>> optional(Codec<Value> codec) {
  using Optional = std::optional<Value>;
  return {
      [of_text = codec.of_text](Text text) { return Optional(of_text(text)); },
      [to_text = codec.to_text](const Optional& value) { return value ? to_text(*value) : ""; },
      [to_json = codec.to_json](const Optional& value) { return value ? to_json(*value) : nlohmann::json(); },
      [of_json = codec.of_json](Json from) { return Optional(of_json(from)); },
      codec.values,
      codec.unit};
}

template <typename Number>
Number whole(Json from) {
  const auto value = finite(from);
  if (value != std::floor(value) || value < static_cast<double>(std::numeric_limits<Number>::min()) ||
      value >= std::ldexp(1.0, std::numeric_limits<Number>::digits))
    throw std::invalid_argument(from.dump() + " is not a whole number in range");
  return from.is_number_float() ? static_cast<Number>(value) : from.get<Number>();
}
template <typename Number>
nlohmann::json as_is(const Number& value) {
  return value;
}
// A number that `of_text` reads.
template <typename Number>
Codec<Number> number(std::type_identity_t<std::function<Number(Text)>> of_text) {
  return {std::move(of_text), [](Number value) { return fmt::to_string(value); }, as_is<Number>,
          whole<Number>};
}
template <typename Number>
Codec<Number> number(std::int64_t least, std::int64_t most) {
  auto codec = number<Number>([=](Text text) { return static_cast<Number>(number_of(text, least, most)); });
  codec.values = fmt::format("{}-{}", least, most);
  return codec;
}
inline Codec<std::uint64_t> size(std::function<std::uint64_t(Text)> of_text = bytes_of) {
  auto codec = number<std::uint64_t>(std::move(of_text));
  codec.to_text = [](std::uint64_t bytes) { return fmt::format("{} B", bytes); };
  codec.values = "SIZE";
  codec.unit = Field::Unit::bytes;
  return codec;
}
inline Codec<double> share(std::function<double(Text)> of_text = share_of) {
  return {std::move(of_text), text_of_share, as_is<double>, finite, "PERCENT", Field::Unit::share};
}

// A time that JSON gives in a unit of µs or s.
inline constexpr double us = 1e3, s = 1e9;
inline std::chrono::nanoseconds time_from(Json from, double unit_ns) {
  const auto value = static_cast<long double>(finite(from)) * unit_ns;  // exact for what can be asked
  if (std::abs(value) > 9e18L) throw std::invalid_argument(from.dump() + " is out of range");
  return std::chrono::nanoseconds(std::llround(value));
}
inline double in_us(std::chrono::nanoseconds time) { return static_cast<double>(time.count()) / us; }
inline Codec<std::chrono::nanoseconds> time(double unit_ns,
                                            std::function<std::chrono::nanoseconds(Text)> of_text) {
  const auto to_json = [=](std::chrono::nanoseconds value) { return in_us(value) / (unit_ns / us); };
  return {std::move(of_text),
          text_of,
          to_json,
          [=](Json from) { return time_from(from, unit_ns); },
          "TIME",
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
  return {of_text, word_of, word_of, [of_text](Json from) { return of_text(from.get<std::string>()); },
          fmt::format("{}", fmt::join(names, "|"))};
}

// The fields that each file adds to the list.
using Fields = std::vector<Field>;
void add(Fields& all, Fields more);
Fields realtime_fields();
Fields network_fields();     // concurrent traffic, and the link's faults
Fields background_fields();  // ordinary topics beside the critical one
Fields isolation_fields();
Fields kernel_fields();
std::uint64_t payload_of(Text);
inline std::chrono::nanoseconds up_to_an_hour(Text text) {
  return positive_duration(text, std::chrono::hours(1));
}
Codec<transport::Reliability> reliability();

}  // namespace ontime::conditions
