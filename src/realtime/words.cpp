// SPDX-License-Identifier: Apache-2.0
#include <cstdio>
#include <set>
#include <string_view>
#include <utility>

#include <fmt/format.h>

#include "number.hpp"
#include "realtime/realtime.hpp"

namespace ontime::realtime {
namespace {

constexpr std::pair<Policy, const char*> words[] = {{Policy::other, "other"},
                                                    {Policy::fifo, "fifo"},
                                                    {Policy::round_robin, "rr"},
                                                    {Policy::deadline, "deadline"}};
constexpr int max_cpu = 1023;

std::optional<int> cpu_of(std::string_view text) {
  const auto cpu = number_in<int>(text);
  return cpu && text[0] != '-' && *cpu <= max_cpu ? cpu : std::nullopt;
}

}  // namespace

bool is_kernel_since(int major, int minor, const std::string& release) {
  int of_major = 0, of_minor = 0;
  return std::sscanf(release.c_str(), "%d.%d", &of_major, &of_minor) == 2 &&
         std::pair(of_major, of_minor) >= std::pair(major, minor);
}

std::optional<Policy> policy_of(const std::string& word) {
  for (const auto& [policy, name] : words)
    if (word == name) return policy;
  return {};
}

const char* word_of(Policy policy) {
  for (const auto& [candidate, name] : words)
    if (candidate == policy) return name;
  return "other";
}

std::optional<std::vector<int>> cpus_of(const std::string& list) {
  std::set<int> cpus;
  for (std::string_view rest = list;;) {
    const auto comma = rest.find(',');
    const auto range = rest.substr(0, comma);
    const auto dash = range.find('-');
    const auto first = cpu_of(range.substr(0, dash));
    const auto last = dash == range.npos ? first : cpu_of(range.substr(dash + 1));
    if (!first || !last || *first > *last) return {};
    for (int cpu = *first; cpu <= *last; ++cpu) cpus.insert(cpu);
    if (comma == rest.npos) break;
    rest.remove_prefix(comma + 1);
  }
  return std::vector(cpus.begin(), cpus.end());
}

std::string list_of(const std::vector<int>& cpus) {
  const std::set<int> sorted(cpus.begin(), cpus.end());
  std::string list;
  for (auto next = sorted.begin(); next != sorted.end();) {
    const int first = *next;
    int last = first;
    while (++next != sorted.end() && *next == last + 1) ++last;
    if (!list.empty()) list += ',';
    list += first == last ? fmt::format("{}", first) : fmt::format("{}-{}", first, last);
  }
  return list;
}

}  // namespace ontime::realtime
