// SPDX-License-Identifier: Apache-2.0
// The link under test: whether it is there, and that nothing else carries what a DDS sends and receives.
#pragma once

#include <cstdint>
#include <map>
#include <string>

#include "transport/transport.hpp"

namespace ontime::transport::dds {

// Throws Error if this host has not that link, or it does not run.
void check_link(const Config& config, const std::string& transport);

// This process's internet sockets, by file descriptor; the kernel's number tells one from a later one that
// has the same descriptor.
using Sockets = std::map<int, std::uint64_t>;
Sockets sockets();

// Binds each that was opened since `before` to the link under test, if one is named: then the kernel sends
// and receives by no other, whatever a vendor's configuration or a peer says of addresses. (What two ends on
// one host send each other never leaves it.) Throws Error where the kernel does not.
void keep_to_link(const Sockets& before, const Config& config, const std::string& transport);

// Of participants on this host that look for others on another link than ours, for people; empty if there are
// none.
std::string others_elsewhere(const Config& config);

}  // namespace ontime::transport::dds
