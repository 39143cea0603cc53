// SPDX-License-Identifier: Apache-2.0
// nftables tables and qdiscs that are created for a run, and their names in the journal.
#pragma once

#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "journal/journal.hpp"

namespace ontime::background {

// Runs these commands with `nft`, all or none, in the caller's network namespace, and returns the output.
// Throws Error with that output, or with the package to install.
std::string nft(const std::string& commands);
// All objects of a kind: for "counter" those of `nft --json list counters`.
std::vector<nlohmann::json> nft_list(const std::string& kind);

// Runs iproute2's `tc` in the caller's network namespace, and returns its output. Throws Error if it fails.
std::string tc(std::vector<std::string> arguments);

// An nftables table: "NETNS/FAMILY/ontime-NAME". Its value "NAMESPACE:HANDLE" distinguishes it from a later
// table of that name. It is created empty.
extern const journal::Kind table_kind;
// The root qdisc of an interface, "NETNS/INTERFACE". Its value is nothing while it is the kernel's default,
// else its kind and handle. Created is an idle netem, or for "NETNS/INTERFACE/WORDS" what tc makes of these
// words, with the qdiscs below its classes, which are removed with it. INTERFACE is "3:eth0", its index and
// name at that time: it may be renamed.
extern const journal::Kind qdisc_kind;
// The same without NETNS: of the network namespace in which they were made. From another one they cannot be
// seen, and are not gone.
extern const journal::Kind local_table_kind, local_qdisc_kind;
const journal::Kind& kind_of_tables(const std::string& netns);
const journal::Kind& kind_of_qdiscs(const std::string& netns);
extern const char* const our_qdisc_handle;
std::string our_qdisc_of(const std::string& words);  // its value, of "netem" or "prio bands 3"

std::string table_what(const std::string& netns, const std::string& family, const std::string& name);
// For an interface in the caller's network namespace, named as by `ip netns`.
std::string qdisc_what(const std::string& netns, const std::string& interface, const std::string& words = "");
// The arguments with which tc creates it at the root of an interface.
std::vector<std::string> make_root(const std::string& interface, const std::vector<std::string>& words);

}  // namespace ontime::background
