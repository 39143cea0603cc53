// SPDX-License-Identifier: Apache-2.0
// The keys of a run that are settings of the machines: "kernel.NAME" for each of settings::table().
#pragma once

#include "campaign/campaign.hpp"

namespace ontime::campaign {

std::vector<Key> kernel_keys();

// The first key of it by which something of the interface itself is set; "": none is.
std::string of_an_interface(const Run&);

}  // namespace ontime::campaign
