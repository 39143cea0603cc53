// SPDX-License-Identifier: Apache-2.0
#include "record/outcome.hpp"

#include <algorithm>
#include <utility>

#include <fmt/format.h>

#include "record/document.hpp"
#include "record/record.hpp"

namespace ontime::record {
namespace {

using nlohmann::json;

// The path below a value to the first that is of another kind than its member: empty, if it is the value
// itself.
using Misfit = std::optional<std::string>;

// Adds a misfit within the value of that name, if it is the first.
void note(Misfit& first, const std::string& name, const Misfit& within) {
  if (within && !first) first = within->empty() ? name : name + "." + *within;
}

// Each overload reads JSON of its type, and leaves the value unchanged if the type differs or the key is
// missing (which is no misfit). In a class, so that each overload may call all others.
struct Reading {
  template <typename Value>
  static Misfit read_if(bool fits, const json& from, Value& into) {
    if (fits) into = from.get<Value>();
    return fits || from.is_null() ? Misfit() : "";
  }
  static Misfit read(const json& from, bool& into) { return read_if(from.is_boolean(), from, into); }
  static Misfit read(const json& from, std::int64_t& into) {
    return read_if(from.is_number_integer(), from, into);
  }
  static Misfit read(const json& from, std::uint64_t& into) {
    return read_if(from.is_number_integer() && from >= 0, from, into);
  }
  static Misfit read(const json& from, int& into) {
    return read_if(from.is_number_integer() && from >= 0 && from <= INT32_MAX, from, into);
  }
  static Misfit read(const json& from, double& into) { return read_if(from.is_number(), from, into); }
  static Misfit read(const json& from, std::string& into) { return read_if(from.is_string(), from, into); }
  static Misfit read(const json& from, json& into) {
    into = from;
    return {};
  }

  template <typename Value>
  static Misfit read(const json& from, std::vector<Value>& into) {
    if (!from.is_array()) return from.is_null() ? Misfit() : "";
    Misfit first;
    for (std::size_t i = 0; i < from.size(); ++i)
      note(first, std::to_string(i), read(from[i], into.emplace_back()));
    return first;
  }
  template <typename Value>
  static Misfit read(const json& from, ByName<Value>& into) {
    if (!from.is_object()) return from.is_null() ? Misfit() : "";
    Misfit first;
    for (const auto& [name, value] : from.items()) note(first, name, read(value, into[name]));
    return first;
  }
  // Facts of a transport: others than texts are read where they stand.
  static Misfit read(const json& from, ByName<std::string>& into) {
    if (from.is_object())
      for (const auto& [name, value] : from.items())
        if (value.is_string()) into.emplace(name, value.get<std::string>());
    return {};
  }
  template <typename Value>
  static Misfit read(const json& from, std::optional<Value>& into) {
    if (from.is_null()) return {};
    Value value{};
    auto misfit = read(from, value);
    if (!misfit || !misfit->empty()) into = std::move(value);
    return misfit;
  }
  // An invalid load still counts as noted: an older ontime noted none.
  static Misfit read(const json& from, std::optional<GivenLoad>& into) {
    return from.is_null() ? Misfit() : read(from, into.emplace());
  }
  // A reason that is not a text still counts as a reason.
  static Misfit read(const json& from, std::optional<std::string>& into) {
    if (!from.is_null()) into = from.is_string() ? from.get<std::string>() : text_of(from);
    return {};
  }

  template <typename Struct>
  static Misfit read(const json& from, Struct& into) {
    if constexpr (requires { into.document; }) into.document = from;
    if (!from.is_object()) return from.is_null() ? Misfit() : "";
    Misfit first;
    Struct::fields(into, [&](const char* name, auto& member, auto...) {
      note(first, name, read(at(from, name), member));
    });
    return first;
  }
};

template <typename Value>
concept Struct = requires(const Value& of) {
  Value::fields(of, [](auto&&...) {});
};

struct Writing {
  static json write(const auto& plain) { return plain; }
  template <typename Value>
  static json write(const std::optional<Value>& value) {
    return value ? write(*value) : json();
  }
  template <typename Value>
  static json write(const std::vector<Value>& values) {
    auto to = json::array();
    for (const auto& value : values) to.push_back(write(value));
    return to;
  }
  template <typename Value>
  static json write(const ByName<Value>& values) {
    auto to = json::object();
    for (const auto& [name, value] : values) to[name] = write(value);
    return to;
  }
  template <Struct Value>
  static json write(const Value& from) {
    if constexpr (requires { from.document; })
      if (!from.document.is_null()) return from.document;
    auto to = json::object();
    Value::fields(from, [&](const char* name, const auto& member, Written written) {
      auto value = write(member);
      const bool is_default = written != always && value == write(std::remove_cvref_t<decltype(member)>());
      if (!is_default || written == or_null) to[name] = is_default ? json() : std::move(value);
    });
    return to;
  }
};

}  // namespace

Outcome::Outcome(json from) : has_counters(true) { misfit = Reading::read(from, *this); }

Asked::Asked(json from) : conditions::Run(conditions::run_of_record(from)) {
  misfit = Reading::read(from, *this);
  auto& client = task.client;
  for (const auto& [name, time] : {std::pair("period_us", &client.period),
                                   {"deadline_us", &client.deadline},
                                   {"timeout_us", &client.timeout},
                                   {"duration_s", &client.duration}})
    if (!at(from, name).is_number()) *time = {};
  if (!at(from, "payload_bytes").is_number()) client.payload_bytes = 0;
  if (const auto& stated = at(from, "others"); stated.is_object())
    for (const auto& other : stated) {
      ++others.components;
      for (const auto* name : {"payload_bytes", "period_us", "schedule"})
        others.messages |= !at(other, name).is_null();
      auto stress = json::object();
      for (const auto& [name, is_known] :
           {std::pair("load", others.load), {"traffic", others.traffic}, {"background", others.topics}})
        if (const auto& value = at(other, name); !is_known && value.is_object()) stress[name] = value;
      if (stress.empty()) continue;
      const auto run = conditions::run_of_record(stress);
      others.load |= run.controller_load.any() || run.component_load.any();
      others.traffic |= run.traffic.any();
      others.topics |= run.task.background.topics > 0;
    }
  // An older ontime has numbers here.
  if (const auto& settings = at(from, "kernel"); settings.is_object())
    for (const auto& [name, value] : settings.items())
      if (value.is_number()) kernel.emplace(name, text_of(value));
}

std::string misfit_of(const Asked& asked, const Outcome& outcome) {
  for (const auto& [name, misfit] : {std::pair("asked", &asked.misfit), {"outcome", &outcome.misfit}})
    if (*misfit) return (*misfit)->empty() ? name : fmt::format("{}.{}", name, **misfit);
  return "";
}

template <typename Value>
json to_json(const Value& value) {
  return Writing::write(value);
}
template <typename Value>
Value read(const json& from) {
  Value value;
  Reading::read(from, value);
  return value;
}
template json to_json(const Outcome&);
template json to_json(const Host&);
template Host read(const json&);
template Machine read(const json&);
template Activity read(const json&);
template Drops read(const json&);
template json to_json(const Link&);
template Link read(const json&);
template json to_json(const ByName<Host>&);
template json to_json(const LateCause&);
template LateCause read(const json&);
template json to_json(const Causes&);
template json to_json(const Traced&);
template Traced read(const json&);

std::vector<std::pair<std::string, CpuQuota>> throttled(const Outcome& outcome) {
  const auto is_ordinary = [](const Thread& thread) {
    return (thread.role == "send" || thread.role == "receive" || thread.role == "delivery") &&
           thread.policy == "other";
  };
  std::vector<std::pair<std::string, CpuQuota>> all;
  for (const auto* name : both_hosts)
    if (const auto& host = find(outcome.hosts, name);
        host.cpu_quota && std::ranges::any_of(host.threads, is_ordinary))
      all.emplace_back(fmt::format("the {}'s", name), *host.cpu_quota);
  if (all.size() > 1 && on_one_machine(outcome)) {
    if (all[1].second.throttled_ns > all[0].second.throttled_ns) all[0] = all[1];
    all[0].first = "ontime's";
    all.pop_back();
  }
  return all;
}

bool on_one_machine(const Outcome& outcome) {
  const auto& one = find(outcome.hosts, "controller").machine.boot_id;
  return !one.empty() && one == find(outcome.hosts, "component").machine.boot_id;
}

}  // namespace ontime::record
