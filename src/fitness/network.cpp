// SPDX-License-Identifier: Apache-2.0
// The network: buffers, interrupts, NAPI.
#include <algorithm>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <sched.h>

#include "fitness/look.hpp"
#include "settings/settings.hpp"

namespace ontime::fitness {
namespace {

constexpr const char* interface_folder = "/sys/class/net/";
constexpr std::int64_t enough = std::int64_t{4} << 20;  // bytes of a buffer

std::vector<std::string> interfaces(const Look& look) {
  if (!look.subject().interfaces.empty()) return look.subject().interfaces;
  auto names = look.names(interface_folder);
  std::erase_if(names,
                [&](const std::string& name) { return !look.exists(interface_folder + name + "/device"); });
  return names;
}

std::vector<int> interrupts_of(const Look& look, const std::string& interface) {
  try {
    return settings::listed_interrupts(interface, look.subject().root);
  } catch (const journal::Error&) {
    return {};  // what cannot be read is not looked at
  }
}

bool has_priority(const process::Stat& thread) {
  return thread.policy == SCHED_FIFO || thread.policy == SCHED_RR;
}

std::string state_of(const process::Stat& thread) {
  return has_priority(thread)
             ? fmt::format("SCHED_{} {}", thread.policy == SCHED_FIFO ? "FIFO" : "RR", thread.priority)
             : "SCHED_OTHER";
}

Finding napi_of(const Look& look, const std::string& interface) {
  if (look.number(interface_folder + interface + "/threaded").value_or(0) == 0)
    return fine(fmt::format("{}: not threaded", interface));
  auto threads = look.kernel_threads("napi/");
  std::erase_if(threads, [&](const auto& one) { return !settings::is_napi_thread(one.name, interface); });
  if (threads.empty())
    return fine(
        fmt::format("{}: threaded, but no threads found (interface down, or in a container)", interface));
  if (std::ranges::all_of(threads, has_priority))
    return fine(fmt::format("{}: threaded, {}", interface, state_of(threads.front())));
  return {
      Severity::wrong, fmt::format("{}: threaded, its threads are SCHED_OTHER", interface),
      "a real-time priority, or not threaded",
      "packets wait for all real-time threads and share the CPU with ordinary ones. Measured under load on "
      "Linux 6.1-rt: 405 of 1,454 messages late; with SCHED_FIFO 60: 0",
      fmt::format("sudo ontime tune apply --set napi-threads=60 --interface {}", interface)};
}

}  // namespace

Findings buffers(const Look& look) {
  const auto most = look.number("/proc/sys/net/core/rmem_max");
  if (!most) return {};
  const auto is = fmt::format("at most {} bytes in the receive buffer of a socket", *most);
  if (*most >= enough) return {fine(is)};
  auto remedy = fmt::format("sudo ontime tune apply --set rmem-max={}B", enough);
  if (look.number("/proc/sys/net/core/wmem_max").value_or(enough) < enough)
    remedy += fmt::format(" --set wmem-max={}B", enough);
  return {{Severity::hint, is, fmt::format("{} or more, if messages are larger than a few kB", enough),
           "a burst, or the fragments of one large message, overflow it and are dropped", remedy}};
}

Findings fragments(const Look& look) {
  const auto most = look.number("/proc/sys/net/ipv4/ipfrag_high_thresh");
  if (!most) return {};
  const auto is = fmt::format("at most {} bytes for fragments of incomplete packets", *most);
  if (*most >= enough) return {fine(is)};
  return {
      {Severity::hint, is, fmt::format("{} or more, if messages are larger than a packet", enough),
       "after a lost fragment the others stay for 30 s; once the buffer is full, all large messages are lost",
       fmt::format("sudo sysctl net.ipv4.ipfrag_high_thresh={} net.ipv4.ipfrag_time=3", enough)}};
}

Findings interrupts(const Look& look) {
  Findings findings;
  for (const auto& interface : interfaces(look)) {
    std::vector<std::string> words;
    for (const int number : interrupts_of(look, interface)) {
      const auto cpus = look.text(fmt::format("/proc/irq/{}/effective_affinity_list", number));
      if (!cpus) continue;
      const auto threads = look.kernel_threads(fmt::format("irq/{}-", number));
      words.push_back(fmt::format("{} on CPU {}{}", number, *cpus,
                                  threads.empty() ? "" : ", thread at " + state_of(threads.front())));
    }
    if (!words.empty()) findings.push_back(fine(fmt::format("{}: {}", interface, fmt::join(words, "; "))));
  }
  return findings;
}

Findings interrupt_balance(const Look& look) {
  if (!look.runs("irqbalance")) return {};
  return {
      {Severity::hint, "running", "not running, or configured to ignore the link's interrupts",
       "it moves interrupts between CPUs every 10 s and undoes irq-cpus",
       "sudo systemctl disable --now irqbalance; or IRQBALANCE_BANNED_CPULIST in /etc/default/irqbalance"}};
}

Findings napi(const Look& look) {
  Findings findings;
  for (const auto& interface : interfaces(look))
    if (look.exists(interface_folder + interface + "/threaded")) findings.push_back(napi_of(look, interface));
  return findings;
}

}  // namespace ontime::fitness
