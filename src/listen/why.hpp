// SPDX-License-Identifier: Apache-2.0
// Why a message was late, by the kernel's events of that time. Pure.
#pragma once

#include <cstdint>
#include <functional>

#include "listen/listen.hpp"
#include "trace/trace.hpp"

namespace ontime::listen {

// The process of a thread; number 0: it ended, or does not exist.
using OwnerOf = std::function<Party(std::int32_t thread)>;

// The time span that an explanation needs; empty for a miss that the probes did not see.
trace::Span span_of(const Miss&);
// Names no cause that makes less than half of the delay above the usual one.
Why why(const Miss&, const trace::Window&, const OwnerOf&);

}  // namespace ontime::listen
