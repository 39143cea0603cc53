// SPDX-License-Identifier: Apache-2.0
// The folder of journals and its files, after a check that only this user can write to them: another user
// could otherwise make ontime change this machine.
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "journal/journal.hpp"
#include "process/process.hpp"

namespace ontime::journal {

using process::Fd;

Error cannot(const std::string& what,
             int error);  // "…; without a journal ontime changes nothing on this machine"

// /run/ontime, or an ordinary user's own. It exists only while there are journals in it.
std::string folder_path();

// Locks the folder as long as it lives: no other ontime works in it. Keep its life short.
class Folder {
 public:
  // Throws Error if other users can change the folder, or if another ontime locks it for ten seconds.
  static Folder make();
  static std::optional<Folder> find();  // nothing if it does not exist

  Folder(Folder&&) = default;
  ~Folder();  // removes it when no journal is left in it

  const std::string& path() const { return path_; }
  std::vector<std::string> journals() const;  // names, the newest first
  std::vector<std::string> kept() const;      // names of the journals of changes to keep

  // Creates a journal, which stays locked while the file is open.
  std::pair<std::string, Fd> add_journal();

  struct Opened {
    Fd fd;
    bool alive = false;    // locked by its owner; else it is locked by us
    std::string not_used;  // why it is not read, for people: "is not trusted: …"
  };
  Opened open(const std::string& name) const;
  void remove(const std::string& name) const;
  void keep(const std::string& name) const;  // moves a journal to the kept ones

  // Those of these lines that were not reported before; from now on they count as reported.
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
// Adds to a journal: on the disk when it returns, or nothing of it. Throws Error, also if the journal was
// removed.
void append(int fd, const std::string& text);
void cut(int fd, std::size_t length);

}  // namespace ontime::journal
