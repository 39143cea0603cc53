// SPDX-License-Identifier: Apache-2.0
// Where inputs become files: in memory, if there is such a place.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>

#include <unistd.h>

namespace ontime::fuzz {

class Folder {
 public:
  Folder() {
    namespace fs = std::filesystem;
    std::string name = (fs::path(::access("/dev/shm", W_OK) == 0 ? "/dev/shm" : fs::temp_directory_path()) /
                        "ontime-fuzz-XXXXXX");
    path_ = ::mkdtemp(name.data());
  }
  ~Folder() { std::filesystem::remove_all(path_); }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;

  std::string path(const char* name) const { return (path_ / name).string(); }
  // The only one that there is.
  std::string file(const char* name, const std::uint8_t* data, std::size_t size) const {
    for (const auto& entry : std::filesystem::directory_iterator(path_)) std::filesystem::remove(entry);
    std::ofstream(path(name), std::ios::binary)
        .write(reinterpret_cast<const char*>(data), static_cast<std::streamsize>(size));
    return path(name);
  }

 private:
  std::filesystem::path path_;
};

}  // namespace ontime::fuzz
