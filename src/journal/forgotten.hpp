// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <ctime>
#include <string>
#include <vector>

namespace ontime::journal {

// Folders of add_directory() that were last changed before this moment. A power cut leaves folders on a disk
// and takes the journal, which is in memory. Nothing removes them: only their name says whose they are. A
// folder that a journal names is not forgotten: the clock may have been set since. Throws Error as hold()
// does.
std::vector<std::string> forgotten_directories(std::time_t before);
std::time_t time_of_boot();  // 0: the kernel does not say

}  // namespace ontime::journal
