// SPDX-License-Identifier: Apache-2.0
// The kinds of change that the journal module defines itself.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "journal/journal.hpp"

namespace ontime::journal {

// Its value is its identity, "" for a name with nothing behind it. Written in the thread that lives in the
// namespace.
extern const Kind namespace_kind;
// Its value is its device and inode.
extern const Kind directory_kind;

// Finds a kind by its name: one of the two above, or of `more`. Null if the name is unknown.
const Kind* find_kind(std::string_view name, std::span<const Kind> more);

// Lower case letters, digits and hyphens: one component of a path, so it cannot name anything else.
bool is_plain_name(std::string_view name);
std::string namespace_path(const std::string& name);
// The name of a network namespace in `ip netns`, found by its identity.
std::optional<std::string> namespace_name(const std::string& identity);

}  // namespace ontime::journal
