// SPDX-License-Identifier: Apache-2.0
// What a machine wrote to its disk: an archive, and no file system.
#pragma once

#include <filesystem>

namespace ontime::lab {

// Puts the files of it into a folder, by their names alone. Throws Error if it is no archive.
void bring_out(const std::filesystem::path& disk, const std::filesystem::path& folder);

}  // namespace ontime::lab
