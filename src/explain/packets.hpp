// SPDX-License-Identifier: Apache-2.0
// What became of the packets that threads gave to the kernel of their machine.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "explain/timeline.hpp"

namespace ontime::explain {

// An interface's queue, or none: nullptr is what was not seen of it.
struct Queue {
  const trace::Event *in = nullptr, *out = nullptr;
};
// Events of the timeline, or nullptr. Of one that was dropped before it was queued that is all. It was
// `queued` by the thread that gave it to the kernel, and `sent` when it left the last of its queues.
struct Packet {
  const trace::Event *queued = nullptr, *sent = nullptr, *received = nullptr, *dropped = nullptr;
  std::vector<Queue> queues{};  // of the interface, and of those that it was handed on to
};

// Of threads that are `ours`, from `from_ns` until `to_ns`, in order. The kernel gives a packet's number to
// another as soon as it is done with it; one that comes again on another interface by the thread that has
// just sent it is handed on, by a bridge or a VLAN. `one_machine`: what is received there is what was sent.
std::vector<Packet> packets_of(const Timeline&, const std::function<bool(std::int32_t thread)>& ours,
                               bool one_machine, std::int64_t from_ns, std::int64_t to_ns);

}  // namespace ontime::explain
