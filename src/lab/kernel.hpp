// SPDX-License-Identifier: Apache-2.0
// A kernel of Debian's, as apt has it: downloaded and verified by apt, unpacked and kept in the user's cache
// folder, installed nowhere.
#pragma once

#include <filesystem>
#include <functional>
#include <string>

namespace ontime::lab {

struct Kernel {
  std::string release;            // "6.1.0-56-rt-amd64"
  std::string package;            // "linux-image-6.1.0-56-rt-amd64_6.1.192-2_amd64"
  std::filesystem::path image;    // the compressed kernel
  std::filesystem::path modules;  // …/lib/modules/RELEASE
};

// That of the package, or of the one that it depends on, in the version that apt would install; fetched if it
// is not there yet, which is told. Where apt cannot: one of that package that is there, which is told as
// well. Throws Error.
Kernel fetch_kernel(const std::string& package, const std::function<void(const std::string&)>& told);

}  // namespace ontime::lab
