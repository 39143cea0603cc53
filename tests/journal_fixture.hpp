// SPDX-License-Identifier: Apache-2.0
// What the tests of the journal share.
#pragma once

#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "journal/folder.hpp"
#include "journal/format.hpp"
#include "journal/journal.hpp"
#include "journal/kinds.hpp"
#include "journal/place.hpp"
#include "own_run.hpp"

namespace ontime::journal {

namespace fs = std::filesystem;

inline std::string read_file(const fs::path& path) {
  std::ifstream file(path);
  return {std::istreambuf_iterator<char>(file), {}};
}

inline void write_file(const fs::path& path, const std::string& text) { std::ofstream(path) << text; }

inline std::string make_folder(Journal& journal) {
  auto path = add_directory(journal, "journal-test");
  fs::create_directories(path + "/in/side");
  write_file(path + "/in/side/file", "text");
  return path;
}

inline bool there_is_no_folder() { return !fs::exists(fs::symlink_status(folder_path())); }

inline std::vector<fs::path> journals() {
  std::vector<fs::path> found;
  for (const auto& entry : fs::directory_iterator(folder_path()))
    if (entry.path().extension() == ".journal") found.push_back(entry.path());
  return found;
}

// A journal as a process that is gone would have left it, and what it may be: ours alone.
inline fs::path plant(const std::string& text,
                      const std::string& name = "0000000000000001-00000001.journal") {
  fs::create_directory(folder_path());
  fs::permissions(folder_path(), fs::perms::owner_all);
  auto path = fs::path(folder_path()) / name;
  write_file(path, text);
  fs::permissions(path, fs::perms::owner_read | fs::perms::owner_write);
  return path;
}

inline void unplant(const fs::path& path) {
  fs::remove_all(path);
  fs::remove(path.parent_path() / "told");
  fs::remove(path.parent_path());
}

inline std::string text_of_all(const Header& header, const std::vector<Entry>& entries) {
  auto text = line_of(header);
  for (const auto& entry : entries) text += line_of(entry);
  return text;
}

class Journals : public ::testing::Test {
 protected:
  void TearDown() override {
    EXPECT_TRUE(there_is_no_folder()) << "a journal is left";
    EXPECT_THAT(revert_abandoned(), ::testing::IsEmpty());
  }
};

}  // namespace ontime::journal
