// SPDX-License-Identifier: Apache-2.0
// ontime's own instance of tracefs. It has its own ring buffer, so it disturbs no other user of tracing.
#pragma once

#include "journal/journal.hpp"

namespace ontime::trace {

extern const journal::Kind instance_kind;
inline constexpr const char* instance_name = "ontime-trace";
inline constexpr const char* instance_path = "instances/ontime-trace";  // within tracefs

}  // namespace ontime::trace
