// SPDX-License-Identifier: Apache-2.0
// The kernel's packet filter and queueing disciplines, in a network namespace.
#pragma once

#include <functional>
#include <string>
#include <vector>

namespace ontime::background {

// In a thread that is there meanwhile: in the network namespace of that name, as `ip netns` has it ("": in
// this process's own), or in a new and empty one, gone with the thread. What the job throws is thrown. Throws
// Error where it cannot be entered or made.
void in_namespace(const std::string& name, const std::function<void()>& job);
void in_new_namespace(const std::function<void()>& job);

// Has `nft` carry out these commands, all or none, in the caller's network namespace, and returns what it
// wrote. Throws Error with what it said, or with what to install.
std::string nft(const std::string& commands);
std::string nft_json(const std::string& commands);

// Runs iproute2's `tc` in the caller's network namespace, and returns what it wrote. Throws Error likewise.
std::string tc(const std::vector<std::string>& arguments);

// A name that means the same to nft, to tc and in a path.
bool is_interface_name(const std::string& name);

}  // namespace ontime::background
