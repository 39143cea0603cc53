// SPDX-License-Identifier: Apache-2.0
// What a machine left, as an archive.
#pragma once

#include <filesystem>

namespace ontime::lab {

// Puts the files of it into a folder, by their names alone. Throws Error if it is no archive, or none whole.
void bring_out(const std::filesystem::path& left, const std::filesystem::path& folder);

}  // namespace ontime::lab
