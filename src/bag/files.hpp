// SPDX-License-Identifier: Apache-2.0
// The files of a bag, and the form of each.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "bag/reader.hpp"

namespace ontime::bag {

struct Files {
  std::vector<std::string> paths;    // in the order in which they were recorded
  std::vector<std::string> remarks;  // on what the folder says of them
};
// Of a folder, or of a file, which is the only one. Throws listen::WrongInput.
Files files_of(const std::string& path);

// By how the file begins. Throws listen::WrongInput: it begins otherwise.
std::unique_ptr<Reader> reader_of(const std::string& path);

}  // namespace ontime::bag
