// SPDX-License-Identifier: Apache-2.0
// The keys of a run that are settings of the machines: "kernel.NAME" for each of settings::table().
#pragma once

#include "campaign/campaign.hpp"

namespace ontime::campaign {

std::vector<Key> kernel_keys();

// The priority of the threads that a message passes through; 0: they have none.
int application_priority(const Run&);

}  // namespace ontime::campaign
