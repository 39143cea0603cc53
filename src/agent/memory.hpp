// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <istream>
#include <string>

namespace ontime::agent {

// Of the text of /proc/meminfo: why no end with locked memory is to be opened on this machine; "": there is
// enough. Many components can take all of it, and then the kernel kills some process, not always one of ours.
std::string lacks_memory(std::istream& meminfo);

}  // namespace ontime::agent
