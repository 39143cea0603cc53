// SPDX-License-Identifier: Apache-2.0
#include "journal/folder.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <chrono>
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <random>
#include <system_error>
#include <thread>

#include <dirent.h>
#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/stat.h>

namespace ontime::journal {
namespace {

using namespace std::chrono_literals;

constexpr auto longest_hold = 10s;
constexpr const char* suffix = ".journal";
constexpr const char* kept_suffix = ".kept";
constexpr const char* told = "told";  // a line for each report that the user already saw

struct CloseDirectory {
  void operator()(DIR* entries) const { closedir(entries); }
};

struct stat stat_of(int fd) {
  struct stat found {};
  if (fstat(fd, &found) != 0) found.st_uid = static_cast<uid_t>(-1);
  return found;
}

bool same(const struct stat& one, const struct stat& other) {
  return one.st_dev == other.st_dev && one.st_ino == other.st_ino;
}

// Why other users can change it; "" if only this user can.
std::string fault_of(const struct stat& found) {
  if (found.st_uid != geteuid()) return fmt::format("it belongs to user {}", found.st_uid);
  if ((found.st_mode & (S_IWGRP | S_IWOTH)) != 0) return "others may write to it";
  return "";
}

// The time in a journal's name; 0 if it has another name.
std::uint64_t number_of(const std::string& name) {
  constexpr std::size_t digits = 16;
  std::uint64_t number = 0;
  const char* const end = name.data() + std::min(digits, name.size());
  return std::from_chars(name.data(), end, number, 16).ptr == name.data() + digits ? number : 0;
}

// False if another process held it all that time.
bool lock(int fd, std::chrono::nanoseconds limit) {
  for (const auto end = std::chrono::steady_clock::now() + limit; flock(fd, LOCK_EX | LOCK_NB) != 0;
       std::this_thread::sleep_for(2ms))
    if (errno != EINTR && std::chrono::steady_clock::now() >= end) return false;
  return true;
}

Error no_room(int error) { return cannot("the journal in " + folder_path(), error); }

Error not_ours(const std::string& path, const std::string& fault) {
  return Error(fmt::format(
      "{} (folder of ontime's journals) is not trusted: {}. ontime changes nothing on this machine. "
      "Fix: remove it, or ask its owner{}",
      path, fault, geteuid() == 0 ? "" : "; or set XDG_RUNTIME_DIR to a folder of your own"));
}

}  // namespace

Error cannot(const std::string& what, int error) {
  return Error(fmt::format("{}: {}; without a journal ontime changes nothing on this machine", what,
                           std::generic_category().message(error)));
}

std::string folder_path() {
  if (geteuid() == 0) return "/run/ontime";
  const char* const own = std::getenv("XDG_RUNTIME_DIR");  // NOLINT(concurrency-mt-unsafe): no thread sets it
  struct stat found {};                                    // after `su` it may be another user's
  if (own != nullptr && own[0] == '/' && stat(own, &found) == 0 && fault_of(found).empty())
    return std::string(own) + "/ontime";
  return fmt::format("/tmp/ontime-{}", geteuid());
}

Folder Folder::make() {
  auto folder = enter(true);
  if (!folder) throw cannot(folder_path(), ENOENT);
  return std::move(*folder);
}

std::optional<Folder> Folder::find() { return enter(false); }

std::optional<Folder> Folder::enter(bool make) {
  const auto path = folder_path();
  // Another process may remove the folder with its own journal while this one waits: try again.
  for (int attempt = 0; attempt < 100; ++attempt) {
    if (make && mkdir(path.c_str(), 0700) != 0 && errno != EEXIST) throw cannot(path, errno);
    Fd fd(::open(path.c_str(), O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC));
    if (fd.get() < 0 && errno == ENOENT) {
      if (make) continue;
      return {};
    }
    if (fd.get() < 0 && (errno == ENOTDIR || errno == ELOOP)) throw not_ours(path, "it is not a folder");
    if (fd.get() < 0 && errno == EACCES) throw not_ours(path, std::generic_category().message(errno));
    if (fd.get() < 0) throw cannot(path, errno);
    const auto found = stat_of(fd.get());
    if (const auto fault = fault_of(found); !fault.empty()) throw not_ours(path, fault);
    if (!lock(fd.get(), longest_hold))
      throw Error(
          fmt::format("another ontime has locked {} for {}. Fix: wait, or end that ontime", path, "10 s"));
    struct stat now {};
    if (lstat(path.c_str(), &now) == 0 && same(found, now)) return Folder(path, std::move(fd));
  }
  return {};
}

Folder::~Folder() {
  try {
    if (fd_.get() < 0 || !journals().empty()) return;
  } catch (const Error&) {  // the next ontime removes it
    return;
  }
  unlinkat(fd_.get(), told, 0);
  rmdir(path_.c_str());
}

std::vector<std::string> Folder::journals() const { return names(suffix); }

std::vector<std::string> Folder::kept() const { return names(kept_suffix); }

std::vector<std::string> Folder::names(const std::string& ending) const {
  std::vector<std::string> names;
  const int itself = ::openat(fd_.get(), ".", O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  const std::unique_ptr<DIR, CloseDirectory> entries(itself < 0 ? nullptr : fdopendir(itself));
  if (!entries) throw cannot(path_, errno);
  while (const auto* entry = readdir(entries.get())) {  // NOLINT(concurrency-mt-unsafe): a stream of our own
    std::string name = entry->d_name;
    if (name.ends_with(ending)) names.push_back(std::move(name));
  }
  std::sort(names.rbegin(), names.rend());
  return names;
}

std::pair<std::string, Fd> Folder::add_journal() {
  // Sorted by time, so that two changes of one thing are undone in the right order, also if the clock was
  // set back between them.
  const std::chrono::nanoseconds now = std::chrono::system_clock::now().time_since_epoch();
  auto number = static_cast<std::uint64_t>(now.count());
  for (const auto* ending : {suffix, kept_suffix})
    for (const auto& name : names(ending)) number = std::max(number, number_of(name) + 1);
  std::random_device random;
  auto name = fmt::format("{:016x}-{:08x}{}", number, random(), suffix);
  Fd fd(
      ::openat(fd_.get(), name.c_str(), O_RDWR | O_APPEND | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0600));
  if (fd.get() < 0 || !lock(fd.get(), 0s) || fsync(fd_.get()) != 0) {
    const int error = errno;
    if (fd.get() >= 0) remove(name);
    throw cannot(path_ + '/' + name, error);
  }
  return {std::move(name), std::move(fd)};
}

Folder::Opened Folder::open(const std::string& name) const {
  Opened opened;
  struct stat before {};
  const auto not_opened = [&] {
    opened.not_used = fmt::format("cannot be opened: {}", std::generic_category().message(errno));
    return std::move(opened);
  };
  const auto not_trusted = [&](const std::string& fault) {
    opened.not_used = fmt::format("is not trusted: {}. Fix: remove it", fault);
    return std::move(opened);
  };
  if (fstatat(fd_.get(), name.c_str(), &before, AT_SYMLINK_NOFOLLOW) != 0) return not_opened();
  if (!S_ISREG(before.st_mode)) return not_trusted("it is not a file");
  if (before.st_nlink != 1) return not_trusted("it has more than one name (hard link)");
  if (before.st_size > max_journal_bytes) return not_trusted("it is larger than any journal");
  if (const auto fault = fault_of(before); !fault.empty()) return not_trusted(fault);
  constexpr int flags = O_APPEND | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC;
  opened.fd = Fd(::openat(fd_.get(), name.c_str(), O_RDWR | flags));
  // On a disk that became read-only, what it lists can still be restored.
  if (opened.fd.get() < 0 && errno == EROFS)
    opened.fd = Fd(::openat(fd_.get(), name.c_str(), O_RDONLY | flags));
  if (opened.fd.get() < 0) return not_opened();
  if (!same(before, stat_of(opened.fd.get()))) return not_trusted("another program replaces it");
  opened.alive = !lock(opened.fd.get(), 0s);
  return opened;
}

void Folder::remove(const std::string& name) const { unlinkat(fd_.get(), name.c_str(), 0); }

void Folder::keep(const std::string& name) const {
  const auto stem = name.substr(0, name.rfind('.'));
  if (renameat(fd_.get(), name.c_str(), fd_.get(), (stem + kept_suffix).c_str()) != 0 ||
      fsync(fd_.get()) != 0)
    throw cannot(path_ + '/' + name, errno);
}

std::vector<std::string> Folder::not_yet_told(const std::vector<std::string>& lines) const {
  if (lines.empty()) return {};
  const Fd fd(
      ::openat(fd_.get(), told, O_RDWR | O_APPEND | O_CREAT | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC, 0600));
  const auto found = stat_of(fd.get());
  if (fd.get() < 0 || !S_ISREG(found.st_mode) || found.st_size > max_journal_bytes) return lines;
  const auto before = "\n" + text_of(fd.get());
  std::vector<std::string> fresh;
  std::copy_if(lines.begin(), lines.end(), std::back_inserter(fresh),
               [&](const std::string& line) { return before.find("\n" + line + "\n") == before.npos; });
  if (fresh.empty()) return {};
  try {
    append(fd.get(), fmt::format("{}\n", fmt::join(fresh, "\n")));
  } catch (const Error&) {  // then it is reported again
  }
  return fresh;
}

std::string text_of(int fd) {
  std::string text;
  std::array<char, 4096> part;
  for (ssize_t bytes = 0; static_cast<off_t>(text.size()) <= max_journal_bytes &&
                          (bytes = pread(fd, part.data(), part.size(), static_cast<off_t>(text.size()))) > 0;)
    text.append(part.data(), static_cast<std::size_t>(bytes));
  return text;
}

void append(int fd, const std::string& text) {
  if (stat_of(fd).st_nlink == 0)
    throw Error(
        "the journal was removed by another program; without a journal ontime changes nothing on this "
        "machine. Fix: start ontime again");
  const auto length = lseek(fd, 0, SEEK_END);
  std::string_view rest = text;
  // A disk that has become full takes a part, and says so only of the rest.
  for (ssize_t taken = 0; length >= 0 && !rest.empty(); rest.remove_prefix(static_cast<std::size_t>(taken)))
    if (taken = ::write(fd, rest.data(), rest.size()); taken <= 0) break;
  if (length >= 0 && rest.empty() && fsync(fd) == 0) return;
  const int error = errno;
  if (length >= 0 && ftruncate(fd, length) != 0) throw no_room(errno);
  throw no_room(error);
}

void cut(int fd, std::size_t length) {
  if (ftruncate(fd, static_cast<off_t>(length)) != 0 || fsync(fd) != 0) throw no_room(errno);
}

}  // namespace ontime::journal
