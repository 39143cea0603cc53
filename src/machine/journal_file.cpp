// SPDX-License-Identifier: Apache-2.0
#include "machine/journal_file.hpp"

#include <array>
#include <cerrno>
#include <charconv>
#include <cstdlib>
#include <filesystem>
#include <system_error>

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include "machine/machine.hpp"
#include "machine/proc.hpp"

namespace ontime::machine {
namespace {

constexpr const char* suffix = ".journal";

Error cannot(const std::string& what, int error) {
  return Error(fmt::format("{}: {}; without a journal nothing of this machine is changed", what,
                           std::generic_category().message(error)));
}

class File {
 public:
  File(const std::string& path, int flags) : fd_(open(path.c_str(), flags | O_CLOEXEC | O_NOFOLLOW, 0600)) {}
  ~File() {
    if (fd_ >= 0) close(fd_);
  }
  File(const File&) = delete;
  File& operator=(const File&) = delete;
  bool is_open() const { return fd_ >= 0; }
  int fd() const { return fd_; }

 private:
  int fd_;
};

// In a folder where others may write too, it must be ours alone.
void make_folder(const std::string& folder) {
  if (mkdir(folder.c_str(), 0700) != 0 && errno != EEXIST) throw cannot(folder, errno);
  struct stat found {};
  if (lstat(folder.c_str(), &found) != 0) return;  // just removed with somebody's last journal: come again
  if (!S_ISDIR(found.st_mode) || found.st_uid != geteuid() || (found.st_mode & (S_IWGRP | S_IWOTH)) != 0)
    throw Error(fmt::format("{} is not a folder of this user's alone: remove it", folder));
}

bool write_all(int fd, const std::string& text) {
  return write(fd, text.data(), text.size()) == static_cast<ssize_t>(text.size()) && fsync(fd) == 0;
}

template <typename Number>
bool take(const char*& at, const char* end, Number& number) {
  const auto [rest, error] = std::from_chars(at, end, number);
  at = rest;
  return error == std::errc{};
}

}  // namespace

std::string line_of(const Change& change) { return fmt::format("{} {}\n", change.kind, change.what); }

std::vector<Change> parse_journal(const std::string& text) {
  std::vector<Change> changes;
  std::size_t begin = 0;
  for (auto end = text.find('\n'); end != text.npos; begin = end + 1, end = text.find('\n', begin)) {
    const auto line = text.substr(begin, end - begin);
    const auto space = line.find(' ');
    changes.push_back({line.substr(0, space), space == line.npos ? "" : line.substr(space + 1)});
  }
  return changes;
}

Owner this_process() {
  const auto self = parse_process(text_of("/proc/self/stat").value_or(""));
  if (!self) throw Error("/proc/self/stat cannot be read: mount /proc");
  return {getpid(), self->start_ticks};
}

bool alive(const Owner& owner) {
  const auto process = parse_process(text_of(fmt::format("/proc/{}/stat", owner.pid)).value_or(""));
  // One that was killed but not yet waited for is gone all the same.
  return process && process->start_ticks == owner.start_ticks && process->state != 'Z' &&
         process->state != 'X';
}

std::string name_of(const Owner& owner, unsigned number) {
  return fmt::format("{}-{}-{}{}", owner.pid, owner.start_ticks, number, suffix);
}

std::optional<Owner> owner_of(const std::string& name) {
  Owner owner{};
  unsigned number = 0;
  const char* at = name.data();
  const char* const end = at + name.size();
  const auto dash = [&] { return at != end && *at++ == '-'; };
  if (!take(at, end, owner.pid) || !dash() || !take(at, end, owner.start_ticks) || !dash() ||
      !take(at, end, number))
    return {};
  if (owner.pid <= 0 || std::string(at, end) != suffix) return {};
  return owner;
}

std::string journal_folder() {
  if (geteuid() == 0) return "/run/ontime";
  const char* const own = std::getenv("XDG_RUNTIME_DIR");  // NOLINT(concurrency-mt-unsafe): nobody sets it
  struct stat found {};                                    // after `su` it may be that of another user
  if (own != nullptr && own[0] == '/' && stat(own, &found) == 0 && found.st_uid == geteuid())
    return std::string(own) + "/ontime";
  return fmt::format("/tmp/ontime-{}", geteuid());
}

std::vector<JournalFile> journal_files() {
  std::vector<JournalFile> files;
  std::error_code error;
  for (std::filesystem::directory_iterator entry(journal_folder(), error), end; !error && entry != end;
       entry.increment(error))
    if (const auto owner = owner_of(entry->path().filename().string()))
      files.push_back({entry->path(), *owner});
  return files;
}

off_t append(const std::string& path, const Change& change) {
  const auto folder = std::filesystem::path(path).parent_path().string();
  // Another process may remove the folder with its own last journal between the two steps.
  for (int attempt = 0; attempt < 100; ++attempt) {
    make_folder(folder);
    const File file(path, O_WRONLY | O_APPEND | O_CREAT);
    if (!file.is_open() && errno == ENOENT) continue;
    const auto length = file.is_open() ? lseek(file.fd(), 0, SEEK_END) : -1;
    if (length < 0) throw cannot(path, errno);
    if (!write_all(file.fd(), line_of(change))) {
      const int error = errno;
      cut(path, length);
      throw cannot(path, error);
    }
    const File parent(folder, O_RDONLY | O_DIRECTORY);
    if (parent.is_open() && fsync(parent.fd()) != 0) throw cannot(folder, errno);
    return length;
  }
  throw cannot(path, ENOENT);
}

void cut(const std::string& path, off_t length) {
  if (length == 0) return remove_journal(path);
  const File file(path, O_WRONLY);
  if (!file.is_open() || ftruncate(file.fd(), length) != 0 || fsync(file.fd()) != 0)
    throw cannot(path, errno);
}

void remove_journal(const std::string& path) {
  unlink(path.c_str());
  remove_empty_folder();
}

void remove_empty_folder() { rmdir(journal_folder().c_str()); }

}  // namespace ontime::machine
