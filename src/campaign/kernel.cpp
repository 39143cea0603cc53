// SPDX-License-Identifier: Apache-2.0
#include "campaign/kernel.hpp"

#include <algorithm>
#include <optional>
#include <stdexcept>

#include <fmt/format.h>

namespace ontime::campaign {
namespace {

constexpr const char* as_is = "as-is";

void set_preset(Run& run, const std::string& text) {
  if (text != "paper" && text != "none")
    throw std::invalid_argument(fmt::format("'{}' is not one of paper, none", text));
  run.kernel = text == "paper" ? settings::paper() : settings::Wishes{};
}

// A size in words is a number of bytes to the kernel.
std::string in_kernels_words(const settings::Setting& setting, const std::string& text) {
  if (setting.values != std::string_view("SIZE")) return text;
  return std::to_string(bytes_of(text));
}

void set(Run& run, const settings::Setting& setting, const std::string& text) {
  run.kernel.erase(setting.name);
  if (text == as_is) return;
  const auto value = in_kernels_words(setting, text);
  setting.check(value);
  run.kernel[setting.name] = value;
}

}  // namespace

std::vector<Key> kernel_keys() {
  const auto client = Key::For::client;
  std::vector<Key> keys{{"kernel.preset", "", "paper|none",
                         "priorities of the kernel's threads as in the paper: irq-threads 90, ksoftirqd 60",
                         client, set_preset}};
  for (const auto& setting : settings::table())
    keys.push_back({fmt::format("kernel.{}", setting.name), "", fmt::format("{}|{}", setting.values, as_is),
                    setting.help, client,
                    [&setting](Run& run, const std::string& text) { set(run, setting, text); }});
  return keys;
}

std::string of_an_interface(const Run& run) {
  for (const auto& setting : settings::table())
    if (setting.of_interface && run.kernel.contains(setting.name))
      return fmt::format("kernel.{}", setting.name);
  return run.isolation.interrupts ? "isolation.interrupts" : "";
}

int application_priority(const Run& run) {
  constexpr int above_all = 100;
  std::optional<int> least;
  for (const auto* role : {"send", "receive", "delivery"}) {
    const auto thread = run.task.realtime.threads.find(role);
    if (thread == run.task.realtime.threads.end()) continue;
    const bool is_deadline = thread->second.policy == realtime::Policy::deadline;
    const int its = is_deadline ? above_all : thread->second.priority;
    least = std::min(least.value_or(its), its);
  }
  return least.value_or(0);
}

}  // namespace ontime::campaign
