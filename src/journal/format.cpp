// SPDX-License-Identifier: Apache-2.0
#include "journal/format.hpp"

#include <cstdint>
#include <limits>

#include "json.hpp"

namespace ontime::journal {
namespace {

using nlohmann::json;

struct NotUnderstood {};

const json& at(const json& line, const char* key) {
  const auto found = line.find(key);
  if (found == line.end()) throw NotUnderstood();
  return *found;
}

std::string text(const json& line, const char* key) {
  const auto& value = at(line, key);
  if (!value.is_string()) throw NotUnderstood();
  return value.get<std::string>();
}

Value value(const json& line, const char* key) {
  if (at(line, key).is_null()) return {};
  return text(line, key);
}

std::uint64_t number(const json& line, const char* key) {
  const auto& value = at(line, key);
  if (!value.is_number_unsigned()) throw NotUnderstood();
  return value.get<std::uint64_t>();
}

json json_of(const Value& value) { return value ? json(*value) : json(nullptr); }

std::string line_of(const json& line) {
  try {
    return line.dump() + "\n";
  } catch (const json::exception&) {
    throw Error("a journal can hold only UTF-8 names; without a journal ontime changes nothing");
  }
}

Header header_of(const json& line) {
  if (number(line, "journal") != format_version) throw NotUnderstood();
  const auto pid = number(line, "pid");
  if (pid > static_cast<std::uint64_t>(std::numeric_limits<pid_t>::max())) throw NotUnderstood();
  return {text(line, "boot"), static_cast<pid_t>(pid), text(line, "command")};
}

void add(const json& line, std::vector<Entry>& entries) {
  if (line.contains("kind")) {
    entries.push_back({text(line, "kind"), text(line, "where"), text(line, "what"), value(line, "before"),
                       value(line, "after")});
    return;
  }
  const auto index = number(line, "change");
  if (index >= entries.size()) throw NotUnderstood();
  if (line.contains("after"))
    entries[index].after = text(line, "after");
  else if (at(line, "done") == json(true))
    entries[index].done = true;
  else
    throw NotUnderstood();
}

}  // namespace

std::string line_of(const Header& header) {
  json line = {
      {"journal", format_version}, {"boot", header.boot}, {"pid", header.pid}, {"command", header.command}};
  // A command line may hold any bytes.
  return line.dump(-1, ' ', false, json::error_handler_t::replace) + "\n";
}

std::string line_of(const Entry& entry) {
  return line_of(json{{"kind", entry.kind},
                      {"where", entry.where},
                      {"what", entry.what},
                      {"before", json_of(entry.before)},
                      {"after", json_of(entry.after)}});
}

std::string line_of_identity(std::size_t index, const std::string& after) {
  return line_of(json{{"change", index}, {"after", after}});
}

std::string line_of_done(std::size_t index) { return line_of(json{{"change", index}, {"done", true}}); }

Contents parse(std::string_view text) {
  Contents contents;
  std::size_t begin = 0;
  for (auto end = text.find('\n'); end != text.npos; begin = end + 1, end = text.find('\n', begin)) {
    const auto words = text.substr(begin, end - begin);
    try {
      const auto line = json_or_discarded(words);
      if (!line.is_object()) throw NotUnderstood();
      if (begin == 0)
        contents.header = header_of(line);
      else
        add(line, contents.entries);
      if (contents.begins.size() < contents.entries.size()) contents.begins.push_back(begin);
    } catch (const NotUnderstood&) {
      contents.not_understood = in_quotes(words);
      return contents;
    }
  }
  return contents;
}

std::string in_quotes(std::string_view text) {
  constexpr std::size_t enough = 100;
  const json start = std::string(text.substr(0, enough));
  const auto shown = start.dump(-1, ' ', true, json::error_handler_t::replace);
  return text.size() > enough ? shown + " …" : shown;
}

}  // namespace ontime::journal
