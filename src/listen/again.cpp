// SPDX-License-Identifier: Apache-2.0
#include <limits>

#include "listen/listen.hpp"
#include "listen/why.hpp"

namespace ontime::listen {
namespace {

using nlohmann::json;

constexpr const char* kinds[] = {"age", "gap"};

constexpr std::pair<const char*, std::int64_t Course::*> times[] = {
    {"before_ns", &Course::before_ns},       {"since_ns", &Course::since_ns},
    {"published_ns", &Course::published_ns}, {"taken_before_ns", &Course::taken_before_ns},
    {"taken_ns", &Course::taken_ns},         {"usual_ns", &Course::usual_ns}};

json json_of(const Party& party) { return {{"pid", party.process}, {"name", party.name}}; }

struct Wrong {};

template <class Whole>
Whole whole_of(const json& number, std::int64_t least = 0,
               std::int64_t most = std::numeric_limits<Whole>::max()) {
  if (!number.is_number_integer()) throw Wrong();
  const auto value = number.get<std::int64_t>();
  if (value < least || value > most) throw Wrong();
  return static_cast<Whole>(value);
}

// In this range no difference overflows.
std::int64_t time_of(const json& number) {
  constexpr std::int64_t most = std::int64_t{1} << 60;
  return whole_of<std::int64_t>(number, 0, most);
}

Party party_of(const json& party) {
  return {whole_of<std::uint32_t>(party.at("pid")), party.at("name").get<std::string>()};
}

}  // namespace

json way_of(const Miss& miss) {
  const auto& course = miss.course;
  json way{{"limit", kinds[static_cast<int>(miss.kind)]},
           {"value_ns", miss.value_ns},
           {"at_ns", miss.at_ns},
           {"publisher", course.publisher},
           {"taker", course.taker},
           {"missing", course.missing},
           {"writer", json_of(miss.writer)},
           {"reader", json_of(miss.reader)},
           {"threads", json::array()}};
  for (const auto& [name, time] : times) way[name] = course.*time;
  for (const auto& [thread, owner] : miss.surroundings->owners) {
    auto one = json_of(owner);
    one["thread"] = thread;
    way["threads"].push_back(std::move(one));
  }
  return way;
}

std::optional<Miss> explained_again(const json& way, const trace::Window& window) try {
  if (!window.whole) return {};
  Miss miss;
  const auto& limit = way.at("limit");
  if (limit != kinds[0] && limit != kinds[1]) return {};
  miss.kind = limit == kinds[0] ? Miss::Kind::age : Miss::Kind::gap;
  miss.value_ns = time_of(way.at("value_ns"));
  miss.at_ns = whole_of<std::int64_t>(way.at("at_ns"));
  auto& course = miss.course;
  for (const auto& [name, time] : times) course.*time = time_of(way.at(name));
  course.publisher = whole_of<std::int32_t>(way.at("publisher"));
  course.taker = whole_of<std::int32_t>(way.at("taker"));
  course.missing = static_cast<std::uint64_t>(whole_of<std::int64_t>(way.at("missing")));
  miss.writer = party_of(way.at("writer"));
  miss.reader = party_of(way.at("reader"));
  std::map<std::int32_t, Party> owners;
  if (!way.at("threads").is_array()) throw Wrong();
  for (const auto& thread : way.at("threads"))
    owners[whole_of<std::int32_t>(thread.at("thread"))] = party_of(thread);
  miss.why = why(miss, window, [&](std::int32_t thread) {
    const auto found = owners.find(thread);
    return found == owners.end() ? Party{} : found->second;
  });
  return miss;
} catch (const Wrong&) {
  return {};
} catch (const json::exception&) {
  return {};
}

}  // namespace ontime::listen
