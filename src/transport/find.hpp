// SPDX-License-Identifier: Apache-2.0
// Where load() finds a transport, without loading it.
#pragma once

#include <filesystem>
#include <string>

namespace ontime::transport {

// The shared object of that name. Throws the Error of load() where there is none.
std::filesystem::path find(const std::string& name);

}  // namespace ontime::transport
