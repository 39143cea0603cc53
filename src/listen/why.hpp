// SPDX-License-Identifier: Apache-2.0
// Why a message was late, by what the kernel did meanwhile. Pure.
#pragma once

#include <cstdint>
#include <functional>

#include "listen/listen.hpp"
#include "trace/trace.hpp"

namespace ontime::listen {

// The process of a thread; number 0 where it is gone, or is none.
using OwnerOf = std::function<Party(std::int32_t thread)>;

// What has to be known for it; of a miss that the probes did not see, of no length.
trace::Span span_of(const Miss&);
// Accuses nothing that accounts for less than half of the delay above the usual.
Why why(const Miss&, const trace::Window&, const OwnerOf&);

}  // namespace ontime::listen
