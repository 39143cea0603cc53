// SPDX-License-Identifier: Apache-2.0
#include "lab/results.hpp"

#include <array>
#include <cerrno>
#include <fstream>
#include <memory>
#include <system_error>

#include <archive.h>
#include <archive_entry.h>
#include <fmt/format.h>

#include "lab/lab.hpp"

namespace ontime::lab {
namespace {

namespace fs = std::filesystem;

void bring_one_out(archive* from, const fs::path& file) {
  std::ofstream output(file, std::ios::binary | std::ios::trunc);
  std::array<char, 65536> part;
  for (la_ssize_t bytes = 0; (bytes = archive_read_data(from, part.data(), part.size())) != 0;) {
    if (bytes < 0)
      throw Error(fmt::format("what the machine left cannot be read: {}", archive_error_string(from)));
    output.write(part.data(), bytes);
  }
  if (!output.flush())
    throw Error(
        fmt::format("{} cannot be written: {}", file.string(), std::generic_category().message(errno)));
}

}  // namespace

void bring_out(const fs::path& left, const fs::path& folder) {
  const std::unique_ptr<archive, decltype(&archive_read_free)> from(archive_read_new(), archive_read_free);
  archive_read_support_format_tar(from.get());
  constexpr std::size_t block = 65536;
  archive_entry* entry = nullptr;
  if (archive_read_open_filename(from.get(), left.c_str(), block) != ARCHIVE_OK)
    throw Error(fmt::format("what the machine left cannot be read: {}", archive_error_string(from.get())));
  int result = ARCHIVE_OK;
  while ((result = archive_read_next_header(from.get(), &entry)) == ARCHIVE_OK)
    if (archive_entry_filetype(entry) == AE_IFREG)
      bring_one_out(from.get(), folder / fs::path(archive_entry_pathname(entry)).filename());
  if (result != ARCHIVE_EOF)
    throw Error(fmt::format("what the machine left cannot be read: {}", archive_error_string(from.get())));
}

}  // namespace ontime::lab
