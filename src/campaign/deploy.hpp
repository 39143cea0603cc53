// SPDX-License-Identifier: Apache-2.0
// This program, brought to a machine that has none, for as long as a keeper runs there.
#pragma once

#include <set>
#include <string>
#include <utility>
#include <vector>

#include "campaign/ssh.hpp"

namespace ontime::campaign {

// A command that is a keeper once what goes ahead of the orders has been read there. The program and those of
// the transports that lie beside it go over ssh's first session into a private folder there; a shell waits
// for the keeper, however it ends, and removes the folder. A machine of another architecture gets the program
// that is installed for it in PREFIX/share/ontime/deploy/`uname -m`. Where none is, or libraries are missing
// there, `between` says which and what to do. Throws Error.
std::pair<std::vector<std::string>, orders::Between> deployment(const Ssh&,
                                                                const std::vector<std::string>& reach,
                                                                const std::set<std::string>& transports);

// "libddsc.so.0debian" → "libddsc0debian": the packages that have these libraries here, where dpkg knows;
// sorted, each once.
std::vector<std::string> packages_of(const std::vector<std::string>& libraries);

}  // namespace ontime::campaign
