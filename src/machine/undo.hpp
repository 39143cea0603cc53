// SPDX-License-Identifier: Apache-2.0
// The ways back. Each can be repeated, and does nothing where there is nothing to undo.
#pragma once

#include <string>

namespace ontime::machine {

enum class Undone { done, nothing_there };

// Both throw Error that says why it could not be.
Undone remove_namespace(const std::string& name);
Undone remove_directory(const std::string& path);

// A name that is one component of a path, so that nothing else can ever be removed in its stead.
bool is_plain_name(const std::string& name);
std::string namespace_path(const std::string& name);

}  // namespace ontime::machine
