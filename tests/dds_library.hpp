// SPDX-License-Identifier: Apache-2.0
// For a test that stands in for a function of a middleware's.
#pragma once

#include <filesystem>

#include <dlfcn.h>
#include <link.h>

namespace ontime::transport::test {

// The function that a call would have reached without us: transports are loaded where RTLD_NEXT does not
// look.
template <typename Function>
Function* in_library(const char* library, const char* function) {
  struct Wanted {
    const char* name;
    void* handle = nullptr;
  } wanted{library};
  dl_iterate_phdr(
      [](dl_phdr_info* info, std::size_t, void* data) {
        auto& of = *static_cast<Wanted*>(data);
        if (!std::filesystem::path(info->dlpi_name).filename().string().starts_with(of.name)) return 0;
        of.handle = dlopen(info->dlpi_name, RTLD_LAZY | RTLD_NOLOAD);
        return 1;
      },
      &wanted);
  return reinterpret_cast<Function*>(dlsym(wanted.handle, function));
}

}  // namespace ontime::transport::test
