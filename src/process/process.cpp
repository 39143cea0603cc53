// SPDX-License-Identifier: Apache-2.0
#include "process/process.hpp"

#include <algorithm>
#include <cerrno>
#include <cstddef>
#include <fstream>
#include <sstream>

#include <signal.h>
#include <spawn.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include "number.hpp"

namespace ontime::process {
namespace {

constexpr const char* white = " \t\n\r";

}  // namespace

void heed_ends_of_children() {
  struct sigaction now {};
  sigaction(SIGCHLD, nullptr, &now);
  if (now.sa_handler != SIG_IGN) return;
  now.sa_handler = SIG_DFL;
  sigaction(SIGCHLD, &now, nullptr);
}

Started start(std::vector<std::string> command, const std::array<int, 3>& streams, Group group) {
  heed_ends_of_children();
  std::vector<char*> words;
  words.reserve(command.size() + 1);
  for (auto& word : command) words.push_back(word.data());
  words.push_back(nullptr);
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  for (int stream = 0; stream < 3; ++stream)
    if (const int own = streams[static_cast<std::size_t>(stream)]; own != stream)
      posix_spawn_file_actions_adddup2(&actions, own, stream);
  posix_spawnattr_t attributes;
  posix_spawnattr_init(&attributes);
  // What ontime ignores itself: a program that writes a part and goes on would seem to have succeeded.
  sigset_t by_default;
  sigemptyset(&by_default);
  for (const int signal : {SIGPIPE, SIGXFSZ}) sigaddset(&by_default, signal);
  posix_spawnattr_setsigdefault(&attributes, &by_default);
  posix_spawnattr_setflags(
      &attributes,
      static_cast<short>(POSIX_SPAWN_SETSIGDEF | (group == Group::own ? POSIX_SPAWN_SETPGROUP : 0)));
  pid_t pid = -1;
  const int error = posix_spawnp(&pid, words[0], &actions, &attributes, words.data(), environ);
  posix_spawnattr_destroy(&attributes);
  posix_spawn_file_actions_destroy(&actions);
  return {pid, error};
}

std::vector<std::string> command_line() {
  std::vector<std::string> words;
  std::ifstream arguments("/proc/self/cmdline");
  for (std::string word; std::getline(arguments, word, '\0');) words.push_back(word);
  return words;
}

std::optional<std::string> text_of(const std::string& path) {
  std::ifstream file(path);
  if (!file) return {};
  try {
    std::string text(std::istreambuf_iterator<char>(file), {});
    return text;
  } catch (const std::ios_base::failure&) {  // of a process that has ended meanwhile
    return {};
  }
}

std::optional<std::string> word(const std::optional<std::string>& text) {
  const auto first = text ? text->find_first_not_of(white) : std::string::npos;
  if (first == std::string::npos) return {};
  return text->substr(first, text->find_last_not_of(white) - first + 1);
}

std::optional<std::int64_t> number(const std::optional<std::string>& text) {
  const auto digits = word(text);
  return digits ? number_in<std::int64_t>(*digits) : std::nullopt;
}

std::optional<std::string> field(const std::string& text, const std::string& key) {
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    const auto colon = line.find(':');
    if (colon != line.npos && word(line.substr(0, colon)) == key)
      return word(line.substr(colon + 1)).value_or("");
  }
  return {};
}

std::optional<Stat> parse_stat(const std::string& text) {
  const auto name_begin = text.find('(');
  const auto name_end = text.rfind(')');  // a thread may call itself ") R 1 ("
  if (name_begin == text.npos || name_end == text.npos || name_end < name_begin) return {};
  Stat stat{};
  std::istringstream number(text.substr(0, name_begin)), fields(text.substr(name_end + 1));
  std::string skipped;
  int next = 3;  // as proc(5) counts the fields
  const auto read = [&](int at, auto& field) {
    for (; next < at; ++next) fields >> skipped;
    fields >> field;
    ++next;
  };
  number >> stat.pid;
  stat.name = text.substr(name_begin + 1, name_end - name_begin - 1);
  read(3, stat.state);
  read(4, stat.parent);
  read(5, stat.group);
  read(9, stat.flags);
  read(10, stat.minor_faults);
  read(12, stat.major_faults);
  read(22, stat.start_ticks);
  read(40, stat.priority);
  read(41, stat.policy);
  return number && fields ? std::optional(std::move(stat)) : std::nullopt;
}

bool has_ended(pid_t pid) {
  siginfo_t info{};
  return waitid(P_PID, static_cast<id_t>(pid), &info, WEXITED | WNOHANG | WNOWAIT) != 0 || info.si_pid == pid;
}

int wait_for(pid_t pid) {
  int status = -1;
  while (waitpid(pid, &status, 0) < 0 && errno == EINTR) continue;
  return status;
}

Memory::Memory() : fd_(memfd_create("ontime", MFD_CLOEXEC)) {}

bool Memory::hold(const std::string& text) {
  return write(fd(), text.data(), text.size()) == static_cast<ssize_t>(text.size()) &&
         lseek(fd(), 0, SEEK_SET) == 0;
}

std::string Memory::text(off_t most) const {
  std::string all(static_cast<std::size_t>(std::clamp<off_t>(lseek(fd(), 0, SEEK_END), 0, most)), '\0');
  const auto bytes = pread(fd(), all.data(), all.size(), 0);
  all.resize(static_cast<std::size_t>(std::max<ssize_t>(bytes, 0)));
  return all;
}

}  // namespace ontime::process
