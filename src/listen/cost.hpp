// SPDX-License-Identifier: Apache-2.0
// What a probe costs the thread that hits it, measured on functions of this program.
#pragma once

#include <optional>

struct bpf_program;

namespace ontime::listen {

struct ProbeCosts {
  double publish_ns = 0;  // a call with a probe at its entry, where the kernel emulates the instruction
  double take_ns = 0;     // a call with such a probe, and one at its return
  double step_ns = 0;     // how much more it is where the kernel steps over the instruction
};

// Uses the same BPF programs as in other processes. It takes 0.2 s and makes some hundred calls, with events
// of this process. Empty: not x86-64, or the kernel sets no probe here.
std::optional<ProbeCosts> measure_probe_costs(bpf_program* publish, bpf_program* take, bpf_program* taken);

}  // namespace ontime::listen
