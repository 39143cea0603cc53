// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <filesystem>
#include <iterator>
#include <set>
#include <sstream>
#include <system_error>

#include "machine/machine.hpp"
#include "machine/proc.hpp"

namespace ontime::machine {
namespace {

namespace fs = std::filesystem;

std::set<std::uint64_t> own_sockets() {
  const std::string before = "socket:[";
  std::set<std::uint64_t> inodes;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator("/proc/self/fd", error)) {
    const auto target = fs::read_symlink(entry.path(), error).string();
    if (error || !target.starts_with(before)) continue;
    if (const auto inode = number(target.substr(before.size(), target.size() - before.size() - 1)))
      inodes.insert(static_cast<std::uint64_t>(*inode));
  }
  return inodes;
}

std::vector<std::string> words_of(const std::string& line) {
  std::istringstream words(line);
  return {std::istream_iterator<std::string>(words), {}};
}

Drops::Count count(const std::string& word) {
  const auto value = number(word);
  return value && *value >= 0 ? Drops::Count(static_cast<std::uint64_t>(*value)) : std::nullopt;
}

}  // namespace

Drops drops(const std::string& interface) {
  const auto text = [](const char* path) { return text_of(path).value_or(""); };  // which says nothing
  const auto snmp = text("/proc/thread-self/net/snmp");
  const auto frames = parse_dropped(text("/proc/thread-self/net/dev"), interface);
  return {.own_sockets = parse_socket_drops(text("/proc/thread-self/net/udp"), own_sockets()),
          .udp_receive = parse_snmp(snmp, "Udp", "RcvbufErrors"),
          .udp_send = parse_snmp(snmp, "Udp", "SndbufErrors"),
          .fragments = parse_snmp(snmp, "Ip", "ReasmFails"),
          .interface_received = frames.first,
          .interface_sent = frames.second,
          .backlog = parse_backlog_drops(text("/proc/thread-self/net/softnet_stat"))};
}

nlohmann::json between(const Drops& first, const Drops& last) {
  const auto since = [](const Drops::Count& before, const Drops::Count& now) -> nlohmann::json {
    if (!before || !now || *now < *before) return nullptr;
    return *now - *before;
  };
  return {{"own_sockets", since(first.own_sockets, last.own_sockets)},
          {"udp_receive", since(first.udp_receive, last.udp_receive)},
          {"udp_send", since(first.udp_send, last.udp_send)},
          {"fragments", since(first.fragments, last.fragments)},
          {"interface_received", since(first.interface_received, last.interface_received)},
          {"interface_sent", since(first.interface_sent, last.interface_sent)},
          {"backlog", since(first.backlog, last.backlog)}};
}

std::pair<Drops::Count, Drops::Count> parse_dropped(const std::string& text, const std::string& interface) {
  constexpr std::size_t received = 3, sent = 11;
  const auto counts = words_of(field(text, interface).value_or(""));
  if (counts.size() <= sent) return {};
  return {count(counts[received]), count(counts[sent])};
}

// Two lines a protocol: the names, then the numbers.
Drops::Count parse_snmp(const std::string& text, const std::string& protocol, const std::string& name) {
  std::istringstream lines(text);
  std::vector<std::string> names;
  for (std::string line; std::getline(lines, line);) {
    if (!line.starts_with(protocol + ":")) continue;
    auto words = words_of(line);
    if (names.empty()) {
      names = std::move(words);
      continue;
    }
    const auto place = static_cast<std::size_t>(std::ranges::find(names, name) - names.begin());
    return place < words.size() ? count(words[place]) : std::nullopt;
  }
  return {};
}

Drops::Count parse_socket_drops(const std::string& text, const std::set<std::uint64_t>& inodes) {
  constexpr std::size_t inode = 9, drops = 12;
  std::istringstream lines(text);
  std::string line;
  if (!std::getline(lines, line)) return {};  // not even the names of the columns
  std::uint64_t all = 0;
  while (std::getline(lines, line)) {
    const auto words = words_of(line);
    if (words.size() <= drops) continue;
    const auto which = count(words[inode]), dropped = count(words[drops]);
    if (which && dropped && inodes.contains(*which)) all += *dropped;
  }
  return all;
}

// A line a CPU, of hexadecimal numbers; the second is what was dropped.
Drops::Count parse_backlog_drops(const std::string& text) {
  std::istringstream lines(text);
  Drops::Count all;
  for (std::string line; std::getline(lines, line);) {
    std::istringstream words(line);
    std::uint64_t processed = 0, dropped = 0;
    if (words >> std::hex >> processed >> dropped) all = all.value_or(0) + dropped;
  }
  return all;
}

}  // namespace ontime::machine
