// SPDX-License-Identifier: Apache-2.0
// The files of a machine in memory: an archive that Linux unpacks at boot (initramfs).
#pragma once

#include <filesystem>
#include <map>
#include <string>

namespace ontime::lab {

class Image {
 public:
  using Path = std::filesystem::path;

  // Adds an existing file or folder. Throws Error if it cannot be read.
  void add(const Path& here, const Path& there);
  void add_text(const Path& there, const std::string& text, bool runs = false);
  void add_link(const Path& there, const Path& target);
  void add_folder(const Path& there);
  // Adds a program or a library, with all libraries that the dynamic linker would load; by default at its own
  // path. Throws Error if a library is missing.
  void add_program(const Path& here, Path there = {});
  // Adds all below it at the same paths; programs with their libraries.
  void add_tree(const Path& here);

  // The same files always give the same bytes, for every user. Throws Error.
  void write(const Path& archive) const;

 private:
  struct Entry {
    Path here;         // the file with the content; if empty:
    std::string text;  // the content, or a link's target
    unsigned type;     // as in st_mode
    unsigned permissions;
  };
  void put(const Path& there, Entry);
  std::map<Path, Entry>
      entries_;  // by path in the machine, without the leading slash; a folder comes before its files
};

// Finds a program in PATH and in /usr/sbin, /usr/bin, /sbin, /bin; empty: not found.
std::filesystem::path program(const std::string& name);

}  // namespace ontime::lab
