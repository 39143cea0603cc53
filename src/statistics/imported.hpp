// SPDX-License-Identifier: Apache-2.0
// Runs that have a histogram in place of samples, or of all but a few.
#pragma once

#include "statistics/statistics.hpp"

namespace ontime::statistics {

// From its outcome's `histogram`. Throws record::WrongFile if that is not as `ontime import` writes it.
void summarise_imported(Summary&);
// Of a run that keeps the worst of its messages only, after its samples were gone through: what these alone
// tell wrong is from the outcome's counters and `histogram`, or unknown.
void summarise_worst(Summary&);

}  // namespace ontime::statistics
