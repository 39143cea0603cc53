// SPDX-License-Identifier: Apache-2.0
// Runs that have a histogram in place of samples.
#pragma once

#include "statistics/statistics.hpp"

namespace ontime::statistics {

// From its outcome's `histogram`. Throws record::WrongFile if that is not as `ontime import` writes it.
void summarise_imported(Summary&);

}  // namespace ontime::statistics
