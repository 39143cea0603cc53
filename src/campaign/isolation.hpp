// SPDX-License-Identifier: Apache-2.0
// The keys of a run that keep CPUs for its two ends, and limit what runs beside.
#pragma once

#include "campaign/campaign.hpp"

namespace ontime::campaign {

std::vector<Key> isolation_keys();
// What only all of them together can tell. Throws std::invalid_argument, for people.
void complete_isolation(const Run&);

}  // namespace ontime::campaign
