// SPDX-License-Identifier: Apache-2.0
// The instance of tracefs that is ours: a ring of its own, which no other user of tracing is disturbed by.
#pragma once

#include "journal/journal.hpp"

namespace ontime::trace {

extern const journal::Kind instance_kind;
extern const char* const instance_name;
extern const char* const instance_path;  // within tracefs

}  // namespace ontime::trace
