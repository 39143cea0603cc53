// SPDX-License-Identifier: Apache-2.0
// What the files of /proc and /sys say, as pure functions of their text.
#pragma once

#include <cstdint>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "machine/machine.hpp"
#include "process/process.hpp"

namespace ontime::machine {

using process::field, process::number, process::text_of, process::word;

// Of the text of a file in /proc/pressure: microseconds in which some task waited, or -1.
std::int64_t parse_stall(const std::string& text);

// Of the text of /proc/self/cgroup: the group's path and those of all groups around it, innermost first (""
// is the root). Controller "" is version 2's hierarchy.
std::vector<std::string> cgroups_of(const std::string& text, const std::string& controller);

// Of the text of a control group's memory.stat, of either version: bytes of pages of files, with those of the
// groups within.
std::uint64_t parse_file_pages(const std::string& text);

// Of the text of a control group's cpu.stat, of either version.
void parse_throttled(const std::string& text, GroupQuota&);

// Of the text of /proc/net/dev.
std::optional<Traffic> parse_traffic(const std::string& text, const std::string& interface);

// Frames dropped on an interface, of the text of /proc/net/dev: received, sent.
std::pair<Drops::Count, Drops::Count> parse_dropped(const std::string& text, const std::string& interface);
// Of the text of /proc/net/snmp, such as "Udp", "RcvbufErrors".
Drops::Count parse_snmp(const std::string& text, const std::string& protocol, const std::string& name);
// Of the text of /proc/net/udp: what these sockets, by their inodes, had no room for.
Drops::Count parse_socket_drops(const std::string& text, const std::set<std::uint64_t>& inodes);
// Of the text of /proc/net/softnet_stat: dropped, by all CPUs.
Drops::Count parse_backlog_drops(const std::string& text);

// Of the text of /proc/PID/maps: names of the shared memory segments of a DDS, each once.
std::vector<std::string> parse_segments(const std::string& text);

}  // namespace ontime::machine
