// SPDX-License-Identifier: Apache-2.0
// Copies this program to a machine without ontime, for as long as a keeper runs there.
#pragma once

#include <functional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "campaign/ssh.hpp"

namespace ontime::campaign {

// A command that becomes a keeper once it has read what is sent ahead of the orders. The program and its
// transports go over ssh's first session into a private folder there. A shell waits until the keeper ends, in
// any way, and removes the folder. A machine of another architecture gets the program that is installed for
// it in PREFIX/share/ontime/deploy/`uname -m`. If that or a library is missing, `between` says which and what
// to do. Throws Error.
std::pair<std::vector<std::string>, orders::Between> deployment(const Ssh&,
                                                                const std::vector<std::string>& reach,
                                                                const std::set<std::string>& transports,
                                                                std::function<bool()> interrupted);

// "libddsc.so.0debian" → "libddsc0debian": the packages that have these libraries here, where dpkg knows;
// sorted, each once. Once it is interrupted, those found so far.
std::vector<std::string> packages_of(const std::vector<std::string>& libraries,
                                     const std::function<bool()>& interrupted);

}  // namespace ontime::campaign
