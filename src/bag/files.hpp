// SPDX-License-Identifier: Apache-2.0
// The files of a bag, and the form of each.
#pragma once

#include <memory>
#include <set>
#include <string>
#include <vector>

#include "bag/reader.hpp"

namespace ontime::bag {

struct Files {
  std::vector<std::string> paths;    // in the order in which they were recorded
  std::vector<std::string> remarks;  // on the folder and its metadata
  std::set<std::string> silent{};    // topics without messages, by its metadata
};
// `path` is a folder, or the only file. Throws listen::WrongInput.
Files files_of(const std::string& path);

// Chooses by the first bytes of the file. Throws listen::WrongInput for unknown ones.
std::unique_ptr<Reader> reader_of(const std::string& path);

}  // namespace ontime::bag
