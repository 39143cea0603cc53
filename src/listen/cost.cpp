// SPDX-License-Identifier: Apache-2.0
#include "listen/cost.hpp"

#ifdef __x86_64__
#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <fstream>
#include <memory>
#include <string>
#include <thread>

#include <bpf/libbpf.h>

#include "listen/event.h"

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
constexpr int calls = 51;
constexpr std::chrono::microseconds sleep{500};

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
  options.bpf_cookie = ontime_argument_1 << ontime_cookie_endpoint |
                       ontime_argument_3 << ontime_cookie_taken | 16 << ontime_cookie_topic;
  options.retprobe = on_return;
  return {bpf_program__attach_uprobe_opts(program, 0, this_program, offset_of(function), &options),
          bpf_link__destroy};
}

// The median time of a call by a thread that just woke, as nodes do. In a loop a call takes a third of it.
double time_of(Function function) {
  const char name[] = "/ontime";  // on the stack, which is in memory
  const struct { const char *implementation, *data, *topic; } endpoint{"", nullptr, name};
  const bool taken = true;
  std::array<double, calls> times_ns{};
  for (auto& time_ns : times_ns) {
    std::this_thread::sleep_for(sleep);
    const auto begin = std::chrono::steady_clock::now();
    function(&endpoint, nullptr, &taken);
    time_ns = std::chrono::duration<double, std::nano>(std::chrono::steady_clock::now() - begin).count();
  }
  std::nth_element(times_ns.begin(), times_ns.begin() + calls / 2, times_ns.end());
  return times_ns[calls / 2];
}

}  // namespace

std::optional<ProbeCosts> measure_probe_costs(bpf_program* publish, bpf_program* take, bpf_program* taken) {
  const auto without_ns = time_of(ontime_emulated);
  ProbeCosts costs;
  {
    const auto emulated = set(publish, ontime_emulated, false), stepped = set(publish, ontime_stepped, false);
    if (!emulated || !stepped) return {};
    costs.publish_ns = std::max(0.0, time_of(ontime_emulated) - without_ns);
    costs.step_ns = std::max(0.0, time_of(ontime_stepped) - without_ns - costs.publish_ns);
  }
  const auto entry = set(take, ontime_emulated, false), end = set(taken, ontime_emulated, true);
  if (!entry || !end) return {};
  costs.take_ns = std::max(0.0, time_of(ontime_emulated) - without_ns);
  return costs;
}
#else
std::optional<ProbeCosts> measure_probe_costs(bpf_program*, bpf_program*, bpf_program*) { return {}; }
#endif

}  // namespace ontime::listen
