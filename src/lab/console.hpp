// SPDX-License-Identifier: Apache-2.0
// What a machine writes to a serial line, which is a file here: a pipe could be full, and the machine would
// wait.
#pragma once

#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

namespace ontime::lab {

class Console {
 public:
  explicit Console(const std::filesystem::path& file) : file_(file), input_(file, std::ios::binary) {}
  // The lines that are whole since it was asked last; at the end of the machine also one that is not.
  std::vector<std::string> lines(bool at_end = false);
  // The one that is being written, or written anew: how far the machine is.
  std::string present() const;
  // The last lines of all, for people.
  std::string tail() const;

 private:
  std::filesystem::path file_;
  std::ifstream input_;
  std::string part_;
  bool anew_ = false;
};

}  // namespace ontime::lab
