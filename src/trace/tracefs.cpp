// SPDX-License-Identifier: Apache-2.0
#include "trace/tracefs.hpp"

#include <array>
#include <cerrno>
#include <system_error>

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/mount.h>
#include <unistd.h>

#include "trace/trace.hpp"

namespace ontime::trace {
namespace {

Error trouble(const std::string& what, int error) {
  const bool is_denied = error == EPERM || error == EACCES;
  const auto* const remedy =
      is_denied && geteuid() != 0 ? ". explain needs root. Fix: run as root"
      : is_denied ? " (explain needs root with CAP_SYS_ADMIN; a kernel in lockdown denies it even then, "
                    "see /sys/kernel/security/lockdown)"
      : error == ENOSYS ? " (explain needs Linux 5.2 or later, built with CONFIG_TRACING)"
                        : "";
  return Error(fmt::format("{}: {}{}", what, std::generic_category().message(error), remedy));
}

process::Fd mounted() {
  const process::Fd context(fsopen("tracefs", FSOPEN_CLOEXEC));
  if (context.get() < 0 || fsconfig(context.get(), FSCONFIG_CMD_CREATE, nullptr, nullptr, 0) != 0)
    throw trouble("cannot mount tracefs", errno == ENODEV ? ENOSYS : errno);
  process::Fd root(fsmount(context.get(), FSMOUNT_CLOEXEC, 0));
  if (root.get() < 0) throw trouble("cannot mount tracefs", errno);
  return root;
}

}  // namespace

Tracefs::Tracefs() : root_(mounted()) {}

bool Tracefs::look(const std::string& path, struct stat& found) const {
  if (fstatat(root_.get(), path.c_str(), &found, AT_SYMLINK_NOFOLLOW) == 0) return true;
  if (errno == ENOENT) return false;
  throw trouble("tracefs " + path, errno);
}

bool Tracefs::has(const std::string& path) const {
  struct stat found {};
  return look(path, found);
}

process::Fd Tracefs::open(const std::string& path, int flags) const {
  process::Fd fd(openat(root_.get(), path.c_str(), flags | O_CLOEXEC | O_NOFOLLOW));
  if (fd.get() < 0) throw trouble("tracefs " + path, errno);
  return fd;
}

std::string Tracefs::read(const std::string& path) const {
  const auto file = open(path, O_RDONLY);
  std::string text;
  std::array<char, 4096> part;
  while (true) {
    const auto bytes = ::read(file.get(), part.data(), part.size());
    if (bytes < 0) throw trouble("tracefs " + path, errno);
    if (bytes == 0) return text;
    text.append(part.data(), static_cast<std::size_t>(bytes));
  }
}

void Tracefs::write(const std::string& path, const std::string& text) const {
  const auto file = open(path, O_WRONLY | O_TRUNC);
  if (::write(file.get(), text.data(), text.size()) != static_cast<ssize_t>(text.size()))
    throw trouble(fmt::format("cannot write \"{}\" to tracefs {}", text, path), errno);
}

void Tracefs::make(const std::string& folder) const {
  if (mkdirat(root_.get(), folder.c_str(), 0700) != 0) throw trouble("tracefs " + folder, errno);
}

void Tracefs::remove(const std::string& folder) const {
  if (unlinkat(root_.get(), folder.c_str(), AT_REMOVEDIR) != 0) throw trouble("tracefs " + folder, errno);
}

}  // namespace ontime::trace
