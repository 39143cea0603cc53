// SPDX-License-Identifier: Apache-2.0
// Reads what a machine writes to a serial line. The line is a file here, because the machine would wait for a
// full pipe.
#pragma once

#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

namespace ontime::lab {

class Console {
 public:
  explicit Console(const std::filesystem::path& file) : file_(file), input_(file, std::ios::binary) {}
  // The complete lines since the last call; `at_end`: also the incomplete last line.
  std::vector<std::string> lines(bool at_end = false);
  // The line that is being written or rewritten: the progress.
  std::string present() const;
  // The last lines, for people.
  std::string tail() const;

 private:
  std::filesystem::path file_;
  std::ifstream input_;
  std::string part_;
  bool anew_ = false;
};

}  // namespace ontime::lab
