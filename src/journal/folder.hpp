// SPDX-License-Identifier: Apache-2.0
// The folder of journals and its files, once they are seen to be this user's alone: who could write there
// could make us change this machine.
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <unistd.h>

#include "journal/journal.hpp"

namespace ontime::journal {

class Fd {
 public:
  explicit Fd(int fd = -1) : fd_(fd) {}
  Fd(Fd&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  Fd& operator=(Fd&& other) noexcept {
    std::swap(fd_, other.fd_);
    return *this;
  }
  ~Fd() {
    if (fd_ >= 0) close(fd_);
  }
  Fd(const Fd&) = delete;
  Fd& operator=(const Fd&) = delete;
  int get() const { return fd_; }

 private:
  int fd_;
};

Error cannot(const std::string& what,
             int error);  // "…; without a journal ontime changes nothing on this machine"

// /run/ontime, or an ordinary user's own. It exists only while there are journals in it.
std::string folder_path();

// As long as one lives, no other ontime is at work in the folder. The fewer moments the better.
class Folder {
 public:
  // Throws Error if it is not ours alone, or if another one is at work in it for ten seconds.
  static Folder make();
  static std::optional<Folder> find();  // nothing if there is none

  Folder(Folder&&) = default;
  ~Folder();  // removes it when no journal is left in it

  const std::string& path() const { return path_; }
  std::vector<std::string> journals() const;  // names, the newest first
  std::vector<std::string> kept() const;      // the same of what is not to be taken back

  // Made and locked, for as long as it is open.
  std::pair<std::string, Fd> add_journal();

  struct Opened {
    Fd fd;
    bool alive = false;        // locked by its owner; else it is locked by us
    std::string not_believed;  // why its contents are not to be looked at
  };
  Opened open(const std::string& name) const;
  void remove(const std::string& name) const;
  void keep(const std::string& name) const;  // a journal, from now on among those

  // Of these lines, those that were not told before; they count as told from now on.
  std::vector<std::string> not_yet_told(const std::vector<std::string>& lines) const;

 private:
  explicit Folder(std::string path, Fd fd) : path_(std::move(path)), fd_(std::move(fd)) {}
  static std::optional<Folder> enter(bool make);
  std::vector<std::string> names(const std::string& suffix) const;

  std::string path_;
  Fd fd_;
};

constexpr off_t max_journal_bytes = off_t{1} << 20;

// The whole of a journal.
std::string text_of(int fd);
// Adds to a journal: on the disk when it returns, or nothing of it. Throws Error.
void append(int fd, const std::string& text);
void cut(int fd, std::size_t length);

}  // namespace ontime::journal
