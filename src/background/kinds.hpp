// SPDX-License-Identifier: Apache-2.0
// The kernel's packet filter and queueing disciplines; what of them is made for a run, by the names that the
// journal has for it.
#pragma once

#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "journal/journal.hpp"

namespace ontime::background {

// Has `nft` carry out these commands, all or none, in the caller's network namespace, and returns what it
// wrote. Throws Error with what it said, or with what to install.
std::string nft(const std::string& commands);
// All that there are of a kind of things: of "counter" what `nft --json list counters` says.
std::vector<nlohmann::json> nft_list(const std::string& kind);

// Runs iproute2's `tc` in the caller's network namespace, and returns its output. Throws Error if it fails.
std::string tc(const std::vector<std::string>& arguments);

// A table of nftables: "NETNS/FAMILY/ontime-NAME", its value "NAMESPACE:HANDLE", by both of which it is told
// from a later one. It is made empty.
extern const journal::Kind table_kind;
// The root queueing discipline of an interface, "NETNS/INTERFACE": nothing, as long as it is the kernel's own
// choice; else what and whose it is. Made is a netem of ours, that does nothing yet; or, of
// "NETNS/INTERFACE/WORDS", what tc calls by these words, with what is below its classes, which goes with it.
// The interface is "3:eth0", its index and the name that it had: it may be renamed meanwhile.
extern const journal::Kind qdisc_kind;
extern const char* const our_qdisc_handle;
std::string our_qdisc_of(const std::string& words);  // its value, of "netem" or "prio bands 3"

std::string table_what(const std::string& netns, const std::string& family, const std::string& name);
// Of an interface of the caller's network namespace, which `ip netns` calls so.
std::string qdisc_what(const std::string& netns, const std::string& interface, const std::string& words = "");
// What has tc make it at the root of an interface.
std::vector<std::string> make_root(const std::string& interface, const std::vector<std::string>& words);

}  // namespace ontime::background
