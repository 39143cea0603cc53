// SPDX-License-Identifier: Apache-2.0
// Follows the packets that threads give to their machine's kernel.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "explain/timeline.hpp"

namespace ontime::explain {

// The passage of an interface's queue; nullptr: no event of it.
struct Queue {
  const trace::Event *in = nullptr, *out = nullptr;
};
// Events of the timeline, or nullptr. A packet dropped before it was queued has only `dropped`. `queued` is
// by the thread that gave it to the kernel, `sent` when it left its last queue.
struct Packet {
  const trace::Event *queued = nullptr, *sent = nullptr, *received = nullptr, *dropped = nullptr;
  std::vector<Queue> queues{};  // of the interface, and of those that it was handed on to
};

// Packets of threads for which `is_sender`, from `from_ns` until `to_ns`, in order. The kernel reuses a
// packet's number as soon as the packet is freed. The same number on another interface, by the thread that
// has just sent it, is the same packet, handed on by a bridge or a VLAN. `one_machine`: a received packet is
// a sent one.
std::vector<Packet> packets_of(const Timeline&, const std::function<bool(std::int32_t thread)>& is_sender,
                               bool one_machine, std::int64_t from_ns, std::int64_t to_ns);

}  // namespace ontime::explain
