// SPDX-License-Identifier: Apache-2.0
#include "settings/file.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <filesystem>
#include <system_error>

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include "process/process.hpp"

namespace ontime::settings {

journal::Error trouble(const std::string& what, int error) {
  return journal::Error(fmt::format("{}: {}", what, std::generic_category().message(error)));
}

journal::Value read_file(const std::string& path) {
  const process::Fd fd(open(path.c_str(), O_RDONLY | O_CLOEXEC));
  if (fd.get() < 0 && (errno == ENOENT || errno == ENOTDIR)) return {};
  if (fd.get() < 0) throw trouble(path, errno);
  std::array<char, 4096> text;
  const auto bytes = read(fd.get(), text.data(), text.size());
  if (bytes < 0 && errno == ENODEV) return {};  // its device or control group went after it was opened
  if (bytes < 0) throw trouble(path, errno);
  std::string value(text.data(), static_cast<std::size_t>(bytes));
  value.erase(0, value.find_first_not_of(" \t\n"));
  value.erase(value.find_last_not_of(" \t\n") + 1);
  return value;
}

void write_file(const std::string& path, const std::string& text) {
  const process::Fd fd(open(path.c_str(), O_WRONLY | O_CLOEXEC));
  if (fd.get() < 0) throw trouble(path, errno);
  if (write(fd.get(), text.data(), text.size()) < 0)
    throw trouble(fmt::format("\"{}\" into {}", text, path), errno);
}

std::vector<std::string> names_in(const std::string& folder) {
  std::vector<std::string> names;
  std::error_code error;  // also of a process that ends while its threads are listed
  std::filesystem::directory_iterator entry(folder, error);
  for (const std::filesystem::directory_iterator end; !error && entry != end; entry.increment(error))
    names.push_back(entry->path().filename().string());
  // Else what is there would be taken for gone.
  for (const int lack : {EMFILE, ENFILE, ENOMEM})
    if (error == std::error_code(lack, std::generic_category())) throw trouble(folder, lack);
  std::sort(names.begin(), names.end());
  return names;
}

}  // namespace ontime::settings
