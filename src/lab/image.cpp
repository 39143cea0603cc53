// SPDX-License-Identifier: Apache-2.0
#include "lab/image.hpp"

#include <array>
#include <cstdlib>
#include <fstream>
#include <memory>
#include <sstream>
#include <system_error>

#include <archive.h>
#include <archive_entry.h>
#include <fmt/format.h>
#include <unistd.h>

#include "background/background.hpp"
#include "background/child.hpp"
#include "lab/lab.hpp"

namespace ontime::lab {
namespace {

namespace fs = std::filesystem;

// The path with links to folders resolved; the last name stays, because programs look for it.
fs::path place_of(const fs::path& here) {
  return fs::canonical(fs::absolute(here).parent_path()) / here.filename();
}

bool is_elf(const fs::path& file) {
  std::array<char, 4> magic{};
  return std::ifstream(file, std::ios::binary).read(magic.data(), magic.size()) && magic[0] == '\x7f' &&
         magic[1] == 'E' && magic[2] == 'L' && magic[3] == 'F';
}

// From lines of ldd: "libz.so.1 => /lib/x86_64-linux-gnu/libz.so.1 (0x…)", "/lib64/ld-linux-x86-64.so.2
// (0x…)".
std::vector<fs::path> libraries_of(const fs::path& object) {
  std::istringstream lines;
  try {
    lines.str(background::output_of({"ldd", object.string()}, "libc-bin"));
  } catch (const background::Error&) {  // linked statically
    return {};
  }
  std::vector<fs::path> libraries;
  for (std::string line; std::getline(lines, line);) {
    if (line.find("=> not found") != line.npos)
      throw Error(fmt::format("{} needs a library that is missing here:{}", object.string(), line));
    const auto begin = line.find('/'), end = line.rfind(" (0x");
    if (begin != line.npos && end != line.npos && begin < end)
      libraries.emplace_back(line.substr(begin, end - begin));
  }
  return libraries;
}

using Archive = std::unique_ptr<archive, decltype(&archive_write_free)>;

void check(archive* of, int result, const fs::path& file) {
  if (result >= ARCHIVE_OK) return;
  const auto error = archive_errno(of);
  throw Error(fmt::format(
      "the lab's files cannot be written to {}: {}. Fix: free disk space, or set TMPDIR to another folder",
      file.string(), error > 0 ? std::generic_category().message(error) : archive_error_string(of)));
}

}  // namespace

void Image::put(const Path& there, Entry entry) {
  const auto inside = there.relative_path();
  if (inside.has_parent_path()) add_folder(inside.parent_path());
  entries_.insert_or_assign(inside, std::move(entry));
}

void Image::add_folder(const Path& there) {
  const auto inside = there.relative_path();
  if (!inside.empty() && entries_.find(inside) == entries_.end()) put(inside, {"", "", AE_IFDIR, 0755});
}

void Image::add_text(const Path& there, const std::string& text, bool runs) {
  put(there, {"", text, AE_IFREG, runs ? 0755U : 0644U});
}

void Image::add_link(const Path& there, const Path& target) {
  put(there, {"", target.string(), AE_IFLNK, 0777});
}

void Image::add(const Path& here, const Path& there) {
  if (fs::is_directory(here)) return add_folder(there);
  if (!fs::is_regular_file(here) || access(here.c_str(), R_OK) != 0)
    throw Error(fmt::format("{}: not a readable file to copy into the lab's machine", here.string()));
  put(there, {here, "", AE_IFREG, access(here.c_str(), X_OK) == 0 ? 0755U : 0644U});
}

void Image::add_program(const Path& here, Path there) {
  add(here, there.empty() ? place_of(here) : there);
  for (const auto& library : libraries_of(here)) add(library, place_of(library));
}

void Image::add_tree(const Path& here) {
  if (!fs::is_directory(here)) return is_elf(here) ? add_program(here) : add(here, place_of(here));
  add_folder(fs::canonical(here));
  for (const auto& entry : fs::recursive_directory_iterator(here)) {
    if (entry.is_symlink())
      add_link(place_of(entry.path()), fs::read_symlink(entry.path()));
    else if (entry.is_directory())
      add_folder(place_of(entry.path()));
    else if (is_elf(entry.path()))
      add_program(entry.path());
    else if (entry.is_regular_file())
      add(entry.path(), place_of(entry.path()));
  }
}

void Image::write(const Path& file) const {
  const Archive archive(archive_write_new(), archive_write_free);
  archive_write_set_format_cpio_newc(archive.get());
  check(archive.get(), archive_write_open_filename(archive.get(), file.c_str()), file);
  const std::unique_ptr<archive_entry, decltype(&archive_entry_free)> header(archive_entry_new(),
                                                                             archive_entry_free);
  for (const auto& [there, entry] : entries_) {
    const auto content = entry.here.empty() ? entry.text : process::text_of(entry.here.string()).value_or("");
    archive_entry_clear(header.get());
    archive_entry_set_pathname(header.get(), there.c_str());
    archive_entry_set_filetype(header.get(), entry.type);
    archive_entry_set_perm(header.get(), entry.permissions);
    if (entry.type == AE_IFLNK) archive_entry_set_symlink(header.get(), content.c_str());
    // libarchive needs a size for folders and links, too.
    archive_entry_set_size(header.get(),
                           entry.type == AE_IFREG ? static_cast<la_int64_t>(content.size()) : 0);
    check(archive.get(), archive_write_header(archive.get(), header.get()), file);
    if (entry.type == AE_IFREG && archive_write_data(archive.get(), content.data(), content.size()) !=
                                      static_cast<la_ssize_t>(content.size()))
      check(archive.get(), ARCHIVE_FATAL, file);
  }
  check(archive.get(), archive_write_close(archive.get()), file);
}

fs::path program(const std::string& name) {
  const char* path = std::getenv("PATH");  // NOLINT(concurrency-mt-unsafe): no thread sets it
  std::istringstream folders(std::string(path == nullptr ? "" : path) + ":/usr/sbin:/usr/bin:/sbin:/bin");
  std::error_code unseen;  // unreadable folders are skipped
  for (std::string folder; std::getline(folders, folder, ':');)
    if (auto file = fs::path(folder) / name;
        folder.starts_with('/') && fs::is_regular_file(file, unseen) && access(file.c_str(), X_OK) == 0)
      return file;
  return {};
}

}  // namespace ontime::lab
