// SPDX-License-Identifier: Apache-2.0
// Runs that have a histogram in place of samples, or of all but a few.
#pragma once

#include "statistics/statistics.hpp"

namespace ontime::statistics {

// From its outcome's `histogram`. Throws record::WrongFile if that is not as `ontime import` writes it.
void summarise_imported(Summary&);
// For a run that keeps only samples around its worst messages: replaces what these samples alone would bias
// by the outcome's counters and `histogram`, or by unknown.
void summarise_worst(Summary&);

}  // namespace ontime::statistics
