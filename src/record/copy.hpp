// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "record/record.hpp"

namespace ontime::record {

// Adds a run of one results file to another: samples, notes, traces and outcome, under the next number there,
// which it returns. A run without an outcome has none in the copy either, which began when it was copied.
std::int64_t copy_run(const Reader& from, const Run&, Writer& to);

}  // namespace ontime::record
