// SPDX-License-Identifier: Apache-2.0
// The files of a machine that lives in memory, as Linux unpacks them when it starts (initramfs).
#pragma once

#include <filesystem>
#include <map>
#include <string>

namespace ontime::lab {

class Image {
 public:
  using Path = std::filesystem::path;

  // A folder, or a file, by what it is here. Throws Error where there is none.
  void add(const Path& here, const Path& there);
  void add_text(const Path& there, const std::string& text, bool runs = false);
  void add_link(const Path& there, const Path& target);
  void add_folder(const Path& there);
  // A program or a library, and with it all that the dynamic linker would load; at its own place, if no other
  // is named. Throws Error if a library is missing.
  void add_program(const Path& here, Path there = {});
  // All below it, at its own place: what can be run or loaded, with its libraries.
  void add_tree(const Path& here);

  // The same files are the same archive, byte for byte, always and for every user. Throws Error.
  void write(const Path& archive) const;

 private:
  struct Entry {
    Path here;         // whose content it has; else
    std::string text;  // that, or where a link leads
    unsigned type;     // as in st_mode
    unsigned permissions;
  };
  void put(const Path& there, Entry);
  std::map<Path, Entry> entries_;  // by where they are there, without the root; a folder before what is in it
};

// A program by that name, where PATH and an administrator's folders have it; empty: nowhere.
std::filesystem::path program(const std::string& name);

}  // namespace ontime::lab
