// SPDX-License-Identifier: Apache-2.0
#include "lab/kernel.hpp"

#include <algorithm>
#include <cstdlib>
#include <sstream>
#include <system_error>

#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include "background/background.hpp"
#include "background/child.hpp"
#include "lab/lab.hpp"
#include "table/table.hpp"

namespace ontime::lab {
namespace {

namespace fs = std::filesystem;
using background::output_of;
using namespace std::chrono_literals;

using Told = std::function<void(const std::string&)>;
constexpr std::uint64_t unpacked_bytes = 500'000'000;  // including the package
constexpr auto time_to_ask = 300s, time_to_fetch = 600s, time_to_unpack = 300s;

fs::path cache() {
  const auto variable = [](const char* name) {
    const char* value = std::getenv(name);  // NOLINT(concurrency-mt-unsafe): no thread sets it
    return fs::path(value == nullptr ? "" : value);
  };
  auto folder = variable("XDG_CACHE_HOME");
  if (!folder.is_absolute()) folder = variable("HOME") / ".cache";
  if (!folder.is_absolute())
    throw Error(
        "the lab needs a cache folder for its kernel, but neither XDG_CACHE_HOME nor HOME is an absolute "
        "path");
  return folder / "ontime" / "kernels";
}

// A user who can write there could run code as root in the machine.
void check_own(const fs::path& folder) {
  struct stat found {};
  if (lstat(folder.c_str(), &found) != 0 || !S_ISDIR(found.st_mode))
    throw Error(fmt::format("the lab's kernel cache {} is not a folder", folder.string()));
  if (found.st_uid != geteuid() || (found.st_mode & (S_IWGRP | S_IWOTH)) != 0)
    throw Error(
        fmt::format("other users can write to the lab's kernel cache {}. Fix: remove their rights, or set "
                    "XDG_CACHE_HOME to another folder",
                    folder.string()));
}

// The errors in apt's output.
std::string reason_of(const std::string& said) {
  std::string reason;
  std::istringstream lines(said);
  for (std::string line; std::getline(lines, line);)
    if (const auto at = line.find("E: "); at != line.npos && (at == 0 || line[at - 1] == ' '))
      reason += (reason.empty() ? "" : "; ") + line.substr(at + 3);
  return reason.empty() ? said : reason;
}

struct NotToBeHad : Error {
  using Error::Error;
};
NotToBeHad not_to_be_had(const std::string& package, const std::string& why) {
  return NotToBeHad(
      fmt::format("the kernel package {} is not available here: {}. It is a package of Debian 12. Fix: check "
                  "the network, run sudo apt update, and try again",
                  package, reason_of(why)));
}

// The output of an apt command for a package.
std::string said_of(const std::string& package, const std::vector<std::string>& command,
                    std::chrono::nanoseconds limit) {
  try {
    return output_of(command, "apt", limit);
  } catch (const background::Error& error) {
    throw not_to_be_had(package, error.what());
  }
}

// "linux-image-rt-amd64" only depends on the current kernel package.
std::string present_one(const std::string& package) {
  std::istringstream lines(said_of(package, {"apt-cache", "depends", "--important", package}, time_to_ask));
  for (std::string word; lines >> word;)
    if (word.starts_with("linux-image-") && word != package) return word;
  return package;
}

struct Download {
  std::string file;
  std::uint64_t bytes = 0;
};

// 'ADDRESS' FILE BYTES HASH
Download download_of(const std::string& package) {
  std::istringstream lines(said_of(package, {"apt-get", "download", "--print-uris", package}, time_to_ask));
  Download download;
  for (std::string line; std::getline(lines, line);) {
    std::string address;
    std::istringstream words(line);
    if (words >> address >> download.file >> download.bytes && address.starts_with('\'') &&
        download.file.ends_with(".deb") && download.file.find('/') == download.file.npos)
      return download;
  }
  throw not_to_be_had(package, "apt has no address to download it from");
}

void check_room(const fs::path& folder) {
  if (const auto free = fs::space(folder).available; free < unpacked_bytes)
    throw Error(
        fmt::format("the lab's kernel needs {} MB in {}, but {} MB are free. Fix: free disk space, or set "
                    "XDG_CACHE_HOME to another folder",
                    unpacked_bytes / 1'000'000, folder.string(), free / 1'000'000));
}

Kernel kernel_in(const fs::path& folder) {
  std::error_code none;
  for (const auto& entry : fs::directory_iterator(folder / "lib/modules", none)) {
    const auto release = entry.path().filename().string();
    const auto image = folder / "boot" / ("vmlinuz-" + release);
    if (fs::exists(image)) return {release, folder.filename().string(), image, entry.path()};
  }
  throw Error(fmt::format("{} has no kernel. The lab downloads it again after: {}", folder.string(),
                          table::shell_line({"rm", "-r", folder.string()})));
}

// Complete or not at all: renames the folder last.
void unpack(const fs::path& package, const fs::path& folder) {
  const auto unfinished = package.parent_path() / "unpacked";
  output_of({"dpkg-deb", "--extract", package.string(), unfinished.string()}, "dpkg", time_to_unpack);
  const auto kernel = kernel_in(unfinished);
  output_of({"depmod", "--basedir", unfinished.string(), kernel.release}, "kmod", time_to_unpack);
  fs::rename(unfinished, folder);
}

// A temporary folder, removed with its files.
struct Unfinished {
  explicit Unfinished(std::string pattern) : folder(std::move(pattern)) {
    if (mkdtemp(folder.data()) == nullptr)
      throw Error(fmt::format("{} cannot be created: {}", folder, std::generic_category().message(errno)));
  }
  ~Unfinished() {
    std::error_code ignored;
    fs::remove_all(folder, ignored);
  }
  Unfinished(const Unfinished&) = delete;
  Unfinished& operator=(const Unfinished&) = delete;
  std::string folder;
};

Kernel present_kernel(const std::string& package, const fs::path& folder, const Told& told) {
  const auto name = present_one(package);
  const auto download = download_of(name);
  const auto kept = folder / fs::path(download.file).stem();
  if (fs::exists(kept)) return kernel_in(kept);
  check_room(folder);
  told(fmt::format("downloading {} ({} MB) with apt, and unpacking it into {} ({} MB)", name,
                   download.bytes / 1'000'000, folder.string(), unpacked_bytes / 1'000'000));
  const Unfinished unfinished((folder / "unfinished-XXXXXX").string());
  said_of(name, {"sh", "-c", "cd \"$1\" && exec apt-get download \"$2\"", "sh", unfinished.folder, name},
          time_to_fetch);
  unpack(fs::path(unfinished.folder) / download.file, kept);
  return kernel_in(kept);
}

}  // namespace

Kernel fetch_kernel(const std::string& package, const Told& told) {
  const auto folder = cache();
  std::error_code failed;
  if (fs::create_directories(folder, failed); failed)
    throw Error(fmt::format(
        "the lab's kernel cache {} cannot be created: {}. Fix: set XDG_CACHE_HOME to another folder",
        folder.string(), failed.message()));
  check_own(folder);
  try {
    return present_kernel(package, folder, told);
  } catch (const NotToBeHad& error) {
    std::string others;
    fs::path last;
    for (const auto& entry : fs::directory_iterator(folder)) {
      const auto kept = entry.path().filename().string(), its = kept.substr(0, kept.find('_'));
      if (its == package && (last.empty() || entry.last_write_time() > fs::last_write_time(last)))
        last = entry.path();
      if (its != package && its != kept)
        others += fmt::format(". Another kernel is in the cache: --kernel {}", its);
    }
    if (last.empty()) throw Error(error.what() + others);
    told(fmt::format("{}. The lab uses the newest in its cache, {}", error.what(), last.filename().string()));
    return kernel_in(last);
  }
}

}  // namespace ontime::lab
