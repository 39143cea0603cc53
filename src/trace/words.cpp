// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <iterator>
#include <utility>

#include <fmt/format.h>

#include "trace/trace.hpp"

namespace ontime::trace {
namespace {

using nlohmann::json;

constexpr const char* words[] = {  // by Kind
    "switch",    "waking",  "interrupt",   "interrupt-end", "softirq", "softirq-end", "timer",
    "timer-end", "queued",  "sent",        "received",      "dropped", "signal",      "waits",
    "moved",     "reclaim", "reclaim-end", "freeze",        "thaw",    "no-route",    "no-neighbour"};
static_assert(std::size(words) == static_cast<std::size_t>(Kind::no_neighbour) + 1);

// No clock that counts from a machine's start shows more: 36 years.
constexpr std::int64_t latest_ns = std::int64_t{1} << 60;
constexpr std::int32_t most_cpus = 8192;      // that Linux can be built for
constexpr std::size_t most_of_file = 50'000;  // several times those that a Recorder keeps of a window

// What an event does not say is left out.
template <class Value>
void put(json& object, const char* name, const Value& value) {
  if (value != Value{}) object[name] = value;
}

// Whole, and one that we can hold.
template <class Number>
Number number_of(const json& number) {
  const bool too_large =
      number.is_number_unsigned() && !std::in_range<std::int64_t>(number.get<std::uint64_t>());
  if (!number.is_number_integer() || too_large || !std::in_range<Number>(number.get<std::int64_t>()))
    throw Error("a number is out of range");
  return static_cast<Number>(number.get<std::int64_t>());
}

std::int32_t number_in(const json& object, const char* name) {
  const auto found = object.find(name);
  return found == object.end() ? 0 : number_of<std::int32_t>(*found);
}

std::int64_t time_of(std::int64_t ns) {
  if (ns < -latest_ns || ns > latest_ns) throw Error("a time is out of range");
  return ns;
}
std::int64_t time_in(const json& object, const char* name) {
  return time_of(number_of<std::int64_t>(object.at(name)));
}

std::int32_t cpu_in(const json& object) {
  const auto cpu = number_of<std::int32_t>(object.at("cpu"));
  if (cpu < 0 || cpu >= most_cpus) throw Error(fmt::format("CPU {} is out of range", cpu));
  return cpu;
}

json to_json(const Event& event, std::int64_t from_ns) {
  json object{{"at", event.at_ns - from_ns}, {"cpu", event.cpu}, {"kind", word_of(event.kind)}};
  put(object, "thread", event.thread.id);
  put(object, "name", event.thread.name);
  put(object, "priority", event.thread.priority);
  put(object, "other", event.other.id);
  put(object, "other_name", event.other.name);
  put(object, "other_priority", event.other.priority);
  put(object, "what", event.what);
  put(object, "packet", event.packet);
  put(object, "bytes", event.bytes);
  return object;
}

Event event_of(const json& object, std::int64_t from_ns) {
  const auto kind = kind_of(object.at("kind"));
  if (!kind) throw Error("an event has an unknown kind; a later ontime may know it");
  return {.at_ns = time_of(from_ns + time_in(object, "at")),
          .cpu = cpu_in(object),
          .kind = *kind,
          .thread = {number_in(object, "thread"), object.value("name", ""), number_in(object, "priority")},
          .other = {number_in(object, "other"), object.value("other_name", ""),
                    number_in(object, "other_priority")},
          .what = object.value("what", ""),
          .packet = number_in(object, "packet"),
          .bytes = number_in(object, "bytes")};
}

}  // namespace

const char* word_of(Kind kind) { return words[static_cast<std::size_t>(kind)]; }

std::optional<Kind> kind_of(const std::string& word) {
  const auto* const found = std::find(std::begin(words), std::end(words), word);
  return found == std::end(words) ? std::nullopt : std::optional(static_cast<Kind>(found - words));
}

std::int32_t running_at(const Event& event) {
  const bool by_another =
      event.kind == Kind::waking || event.kind == Kind::signal || event.kind == Kind::moved;
  return by_another ? event.other.id : event.thread.id;
}

json to_json(const Window& window) {
  auto events = json::array();
  for (const auto& event : window.events) events.push_back(to_json(event, window.span.from_ns));
  return {{"message", window.span.message},
          {"from_ns", window.span.from_ns},
          {"to_ns", window.span.to_ns},
          {"whole", window.whole},
          {"events", std::move(events)}};
}

Window window_of(const json& object) {
  const auto message = number_of<std::int64_t>(object.at("message"));
  if (message < 0) throw Error("a message number is negative");
  Window window{{static_cast<std::uint64_t>(message), time_in(object, "from_ns"), time_in(object, "to_ns")},
                object.at("whole"),
                {}};
  const auto& events = object.at("events");
  if (events.size() > most_of_file)
    throw Error(
        fmt::format("a window has {} events, more than the possible {}", events.size(), most_of_file));
  for (const auto& event : events) window.events.push_back(event_of(event, window.span.from_ns));
  if (!std::ranges::is_sorted(window.events, {}, &Event::at_ns))
    throw Error("events are not in order of time");
  return window;
}

}  // namespace ontime::trace
