// SPDX-License-Identifier: Apache-2.0
#include "listen/cost.hpp"

#ifdef __x86_64__
#include <algorithm>
#include <chrono>
#include <cstdint>
#include <fstream>
#include <limits>
#include <memory>
#include <string>

#include <bpf/libbpf.h>

// Two functions that differ in the instruction under the probe: one that the kernel emulates, one that it
// steps over.
asm(R"(
  .text
  .type ontime_emulated, @function
ontime_emulated:
  push %rbp
  pop %rbp
  xor %eax, %eax
  ret
  .size ontime_emulated, . - ontime_emulated
  .type ontime_stepped, @function
ontime_stepped:
  xor %eax, %eax
  ret
  .size ontime_stepped, . - ontime_stepped
)");
// By rmw's arguments of a publish and of a take.
extern "C" int ontime_emulated(const void* endpoint, const void* message, const bool* taken);
extern "C" int ontime_stepped(const void* endpoint, const void* message, const bool* taken);
#endif

namespace ontime::listen {

#ifdef __x86_64__
namespace {

using Function = int (*)(const void*, const void*, const bool*);
using Link = std::unique_ptr<bpf_link, int (*)(bpf_link*)>;

constexpr const char* this_program = "/proc/self/exe";
constexpr int rounds = 10, calls = 100;

// Where a function is in the program's file; 0: not found.
std::size_t offset_of(Function function) {
  const auto address = reinterpret_cast<std::uintptr_t>(function);
  std::ifstream maps("/proc/self/maps");
  for (std::string line; std::getline(maps, line);) {
    std::size_t read = 0;
    const auto begin = std::stoull(line, &read, 16);
    const auto end = std::stoull(line.substr(read + 1), nullptr, 16);
    if (address < begin || address >= end) continue;
    const auto offset_at = line.find(' ', line.find(' ') + 1) + 1;
    return address - begin + std::stoull(line.substr(offset_at), nullptr, 16);
  }
  return 0;
}

Link set(bpf_program* program, Function function, bool on_return) {
  bpf_uprobe_opts options{};
  options.sz = sizeof options;
  options.retprobe = on_return;
  return {bpf_program__attach_uprobe_opts(program, 0, this_program, offset_of(function), &options),
          bpf_link__destroy};
}

// Of a call, in the quietest round.
double time_of(Function function) {
  struct {
    const char *implementation = "", *data = nullptr, *topic = "/ontime";
  } const endpoint;
  const bool taken = true;
  auto least_ns = std::numeric_limits<double>::max();
  for (int round = 0; round < rounds; ++round) {
    const auto begin = std::chrono::steady_clock::now();
    for (int call = 0; call < calls; ++call) function(&endpoint, nullptr, &taken);
    const std::chrono::duration<double, std::nano> time = std::chrono::steady_clock::now() - begin;
    least_ns = std::min(least_ns, time.count() / calls);
  }
  return least_ns;
}

}  // namespace

std::optional<ProbeCosts> measure_probe_costs(bpf_program* publish, bpf_program* take, bpf_program* taken) {
  const auto without_ns = time_of(ontime_emulated);
  ProbeCosts costs;
  {
    const auto emulated = set(publish, ontime_emulated, false), stepped = set(publish, ontime_stepped, false);
    if (!emulated || !stepped) return {};
    costs.publish_ns = time_of(ontime_emulated) - without_ns;
    costs.step_ns = std::max(0.0, time_of(ontime_stepped) - without_ns - costs.publish_ns);
  }
  const auto entry = set(take, ontime_emulated, false), end = set(taken, ontime_emulated, true);
  if (!entry || !end) return {};
  costs.take_ns = time_of(ontime_emulated) - without_ns;
  return costs;
}
#else
std::optional<ProbeCosts> measure_probe_costs(bpf_program*, bpf_program*, bpf_program*) { return {}; }
#endif

}  // namespace ontime::listen
