// SPDX-License-Identifier: Apache-2.0
#include "record/outcome.hpp"

#include <type_traits>
#include <utility>

#include "record/document.hpp"
#include "record/record.hpp"

namespace ontime::record {
namespace {

using nlohmann::json;

// Each reads what is of its kind, and leaves the rest as it is.
void read(const json& from, bool& into) {
  if (from.is_boolean()) into = from.get<bool>();
}
void read(const json& from, std::int64_t& into) {
  if (from.is_number_integer()) into = from.get<std::int64_t>();
}
void read(const json& from, std::uint64_t& into) {
  if (from.is_number_integer() && from >= 0) into = from.get<std::uint64_t>();
}
void read(const json& from, int& into) {
  if (from.is_number_integer() && from >= 0 && from <= INT32_MAX) into = from.get<int>();
}
void read(const json& from, double& into) {
  if (from.is_number()) into = from.get<double>();
}
void read(const json& from, std::string& into) {
  if (from.is_string()) into = from.get<std::string>();
}
void read(const json& from, json& into) { into = from; }
struct AnyField {
  void operator()(const char*, auto&) const {}
};
template <typename Struct>
concept Listed = requires(Struct& of) {
  Struct::fields(of, AnyField{});
};
template <Listed Struct>
void read(const json& from, Struct& into);
template <typename Value>
void read(const json& from, std::vector<Value>& into);
template <typename Value>
void read(const json& from, ByName<Value>& into);
template <typename Value>
void read(const json& from, std::optional<Value>& into);
void read(const json& from, std::optional<std::string>& into);
void read(const json& from, ByName<std::string>& into);
void read(const json& from, conditions::Wire& into) {
  read(at(from, "bits_per_s"), into.bits_per_s);
  read(at(from, "vlan"), into.vlan);
}

template <typename Value>
Value read_as(const json& from) {
  Value value{};
  read(from, value);
  return value;
}
template <typename Value>
void read(const json& from, std::vector<Value>& into) {
  if (from.is_array())
    for (const auto& element : from) into.push_back(read_as<Value>(element));
}
template <typename Value>
void read(const json& from, ByName<Value>& into) {
  if (from.is_object())
    for (const auto& [name, value] : from.items()) into.emplace(name, read_as<Value>(value));
}
void read(const json& from, ByName<std::string>& into) {
  if (from.is_object())
    for (const auto& [name, value] : from.items())
      if (value.is_string()) into.emplace(name, value.get<std::string>());
}

template <typename Value>
constexpr bool is_a(const json& from) {
  if constexpr (std::is_same_v<Value, bool>) return from.is_boolean();
  if constexpr (std::is_floating_point_v<Value>) return from.is_number();
  if constexpr (std::is_integral_v<Value>)
    return from.is_number_integer() && (std::is_signed_v<Value> || from >= 0);
  return !from.is_null();
}
template <typename Value>
void read(const json& from, std::optional<Value>& into) {
  if (is_a<Value>(from)) into = read_as<Value>(from);
}
// A reason that is no text is one all the same.
void read(const json& from, std::optional<std::string>& into) {
  if (!from.is_null()) into = from.is_string() ? from.get<std::string>() : text_of(from);
}

template <Listed Struct>
void read(const json& from, Struct& into) {
  if constexpr (requires { into.document; }) into.document = from;
  Struct::fields(into, [&](const char* name, auto& member) { read(at(from, name), member); });
}

}  // namespace

Outcome::Outcome(json from) { read(from, *this); }

Asked::Asked(json from) : conditions::Run(conditions::run_of_record(from)) {
  read(from, *this);
  auto& client = task.client;
  for (const auto& [name, time] : {std::pair("period_us", &client.period),
                                   {"deadline_us", &client.deadline},
                                   {"timeout_us", &client.timeout},
                                   {"duration_s", &client.duration}})
    if (!at(from, name).is_number()) *time = {};
  if (!at(from, "payload_bytes").is_number()) client.payload_bytes = 0;
  // An older ontime has numbers here.
  if (const auto& settings = at(from, "kernel"); settings.is_object())
    for (const auto& [name, value] : settings.items())
      if (value.is_number()) kernel.emplace(name, text_of(value));
}

Host host_of(const json& from) { return read_as<Host>(from); }

bool on_one_machine(const Outcome& outcome) {
  const auto& one = find(outcome.hosts, "controller").machine.boot_id;
  return !one.empty() && one == find(outcome.hosts, "component").machine.boot_id;
}

}  // namespace ontime::record
