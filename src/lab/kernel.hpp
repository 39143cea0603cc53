// SPDX-License-Identifier: Apache-2.0
// A kernel package of Debian: apt downloads and verifies it; it is unpacked in the user's cache folder, and
// not installed.
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

// The kernel of the package, or of the package that it depends on, in the version that apt would install.
// Downloads it if the cache lacks it. If apt cannot: the newest of that package in the cache. `told` gets a
// line in both cases. Throws Error.
Kernel fetch_kernel(const std::string& package, const std::function<void(const std::string&)>& told);

}  // namespace ontime::lab
