// SPDX-License-Identifier: Apache-2.0
// The instance of tracefs that is ours: a ring of its own, which no other user of tracing is disturbed by.
#pragma once

#include "journal/journal.hpp"

namespace ontime::trace {

extern const journal::Kind instance_kind;
inline constexpr const char* instance_name = "ontime-trace";
inline constexpr const char* instance_path = "instances/ontime-trace";  // within tracefs

}  // namespace ontime::trace
