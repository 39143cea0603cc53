// SPDX-License-Identifier: Apache-2.0
#include "campaign/isolation.hpp"

#include <algorithm>
#include <stdexcept>

#include <fmt/format.h>

namespace ontime::campaign {
namespace {

using Text = const std::string&;

std::string cpus_of(Text text) {
  if (text == "none") return "";
  const auto cpus = realtime::cpus_of(text);
  if (!cpus || cpus->empty())
    throw std::invalid_argument(
        fmt::format("'{}' is not one of none, lists of CPUs such as 1 or 0-1,3", text));
  return realtime::list_of(*cpus);
}

bool on_or_off(Text text) {
  if (text != "on" && text != "off")
    throw std::invalid_argument(fmt::format("'{}' is neither on nor off", text));
  return text == "on";
}

// As systemd's CPUQuota: of one CPU, and so more than 100 % where there are several.
double quota_of(Text text) {
  constexpr std::int64_t most = 102'400;  // of 1024 CPUs
  if (text == "none") return 0;
  constexpr std::string_view unit = " %";
  if (!text.ends_with(unit))
    throw std::invalid_argument(fmt::format("'{}' is no share of a CPU's time; write it as '50 %'", text));
  return static_cast<double>(number_of(text.substr(0, text.size() - unit.size()), 1, most)) / 100;
}

}  // namespace

std::vector<Key> isolation_keys() {
  const auto client = Key::For::client;
  return {{"isolation.cpus", "", "LIST|none",
           "the CPUs that are kept for the two ends, and for nobody else: none", client,
           [](Run& run, Text text) { run.isolation.cpus = cpus_of(text); }},
          {"isolation.interrupts", "", "on|off",
           "keep the interface's interrupts and the kernel's unbound work off them, too: off", client,
           [](Run& run, Text text) { run.isolation.interrupts = on_or_off(text); }},
          {"isolation.load-quota", "", "PERCENT|none",
           "how much of one CPU's time load and traffic may have together: any", client,
           [](Run& run, Text text) { run.isolation.load_quota = quota_of(text); }},
          {"isolation.load-weight", "", "1-10000|none",
           "of load and traffic together, where all others have 100: none", client, [](Run& run, Text text) {
             run.isolation.load_weight = text == "none" ? 0 : static_cast<int>(number_of(text, 1, 10'000));
           }}};
}

void complete_isolation(const Run& run) {
  const auto& wish = run.isolation;
  if (wish.interrupts && wish.cpus.empty())
    throw std::invalid_argument("isolation.interrupts needs isolation.cpus, which they are to be kept off");
  for (const auto* name : {"irq-cpus", "workqueue-cpus"})
    if (wish.interrupts && run.kernel.contains(name))
      throw std::invalid_argument(
          fmt::format("isolation.interrupts sets kernel.{}, which is stated as well: leave out one", name));
  if (wish.limits() && run.traffic.priority > 0)
    throw std::invalid_argument(
        "a real-time priority knows no quota and no weight: leave out traffic.priority, or "
        "isolation.load-quota and isolation.load-weight");
  if (wish.cpus.empty()) return;
  const auto kept = realtime::cpus_of(wish.cpus).value_or(std::vector<int>{});
  for (const auto& [role, thread] : run.task.realtime.threads)
    for (const int cpu : thread.cpus)
      if (std::find(kept.begin(), kept.end(), cpu) == kept.end())
        throw std::invalid_argument(
            fmt::format("threads of role {} cannot run on CPU {}: isolation.cpus, which both ends are kept "
                        "to, are {}",
                        role, cpu, wish.cpus));
}

}  // namespace ontime::campaign
