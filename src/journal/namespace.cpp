// SPDX-License-Identifier: Apache-2.0
// A network namespace as `ip netns` has it: mounted over a file in /run/netns. Made without `ip`, so that its
// identity is in the journal before another process can see it.
#include <cerrno>
#include <filesystem>
#include <future>
#include <system_error>

#include <fcntl.h>
#include <fmt/format.h>
#include <sched.h>
#include <sys/mount.h>
#include <sys/stat.h>

#include "journal/folder.hpp"
#include "journal/kinds.hpp"
#include "journal/place.hpp"

namespace ontime::journal {
namespace {

constexpr const char* folder = "/run/netns";
constexpr const char* own = "/proc/thread-self/ns/net";

Error namespace_trouble(const std::string& name, const char* what, int error) {
  return Error(fmt::format("network namespace {} cannot be {}: {}", name, what,
                           std::generic_category().message(error)));
}

bool accepts(const std::string& name) { return is_own_name(name); }

Value read(const std::string& name) {
  const Fd fd(open(namespace_path(name).c_str(), O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC));
  if (fd.get() < 0 && errno == ENOENT) return {};
  if (fd.get() < 0) throw namespace_trouble(name, "read", errno);
  auto identity = network_identity(fd.get());
  struct stat found {};
  if (!identity.empty() || (fstat(fd.get(), &found) == 0 && S_ISREG(found.st_mode) && found.st_size == 0))
    return identity;
  return "no namespace";
}

// As `ip netns` does it: all mount namespaces see what is mounted in the folder.
void make_folder(const std::string& name) {
  if (mkdir(folder, 0755) != 0 && errno != EEXIST) throw namespace_trouble(name, "made", errno);
  if (mount("", folder, "none", MS_SHARED | MS_REC, nullptr) == 0) return;
  if (errno != EINVAL || mount(folder, folder, "none", MS_BIND | MS_REC, nullptr) != 0 ||
      mount("", folder, "none", MS_SHARED | MS_REC, nullptr) != 0)
    throw namespace_trouble(name, "made", errno);
}

void make_name(const std::string& name) {
  make_folder(name);
  const Fd fd(open(namespace_path(name).c_str(), O_RDONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0));
  if (fd.get() < 0 && errno == EEXIST) throw MadeByAnother(namespace_trouble(name, "made", errno).what());
  if (fd.get() < 0) throw namespace_trouble(name, "made", errno);
}

// Unmounts it in this mount namespace; in all others the mount ends with the file.
void unmount(const std::string& name, const Value& present) {
  while (read(name) == present)
    if (umount2(namespace_path(name).c_str(), MNT_DETACH | UMOUNT_NOFOLLOW) != 0)
      throw namespace_trouble(name, "removed", errno);
}

void write(const std::string& name, const Value& value, const Value& present) {
  const auto path = namespace_path(name);
  if (!value) {
    if (read(name) != "") throw namespace_trouble(name, "removed", EBUSY);
    if (unlink(path.c_str()) != 0) throw namespace_trouble(name, "removed", errno);
  } else if (!value->empty()) {
    if (mount(own, path.c_str(), "none", MS_BIND, nullptr) != 0) throw namespace_trouble(name, "made", errno);
  } else if (!present) {
    make_name(name);
  } else {
    unmount(name, present);
  }
}

// In a separate thread: only that thread enters the new namespace, and it ends afterwards.
void make(Journal& journal, const std::string& name) {
  if (unshare(CLONE_NEWNET) != 0) throw namespace_trouble(name, "made", errno);
  const Fd itself(open(own, O_RDONLY | O_CLOEXEC));
  journal.change(namespace_kind, name, network_identity(itself.get()));
}

// As `ip netns exec` does it: /sys shows the interfaces of the namespace that it was mounted in.
void enter(const std::string& name) {
  const Fd fd(open(namespace_path(name).c_str(), O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC));
  if (fd.get() < 0 || setns(fd.get(), CLONE_NEWNET) != 0 || unshare(CLONE_NEWNS) != 0 ||
      mount("", "/", "none", MS_SLAVE | MS_REC, nullptr) != 0 ||
      mount("sysfs", "/sys", "sysfs", 0, nullptr) != 0)
    throw namespace_trouble(name, "entered", errno);
}

}  // namespace

const Kind namespace_kind = {"namespace", Scope::mount_namespace, accepts, read, write};

std::string namespace_path(const std::string& name) { return fmt::format("{}/{}", folder, name); }

std::optional<std::string> namespace_name(const std::string& identity) {
  std::error_code error;
  std::filesystem::directory_iterator entry(folder, error);
  for (const std::filesystem::directory_iterator end; !error && entry != end; entry.increment(error)) {
    auto name = entry->path().filename().string();  // not const: it is returned by a move
    const Fd fd(open(entry->path().c_str(), O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC));
    // Else what is there would be taken for gone.
    if (fd.get() < 0 && (errno == EMFILE || errno == ENFILE)) throw namespace_trouble(name, "read", errno);
    if (fd.get() >= 0 && network_identity(fd.get()) == identity) return name;
  }
  if (error && error != std::errc::no_such_file_or_directory) throw cannot(folder, error.value());
  return {};
}

void within_namespace(const std::string& name, const std::function<void()>& action) {
  if (name.empty()) return action();
  if (name.find('/') != name.npos || name == "." || name == "..")
    throw namespace_trouble(name, "entered", EINVAL);
  const auto inside = [&] {
    enter(name);
    action();
  };
  std::async(std::launch::async, inside).get();
}

void add_namespace(Journal& journal, const std::string& name) {
  if (!accepts(name))
    throw Error(
        fmt::format("network namespace \"{}\": the name must be {}NAME, of lower case letters, digits and "
                    "hyphens",
                    name, own_prefix));
  journal.hold();
  if (read(name))
    throw Error(
        fmt::format("network namespace {} already exists, and ontime did not make it. Fix: if no process "
                    "needs it, sudo ip "
                    "netns delete {}",
                    name, name));
  journal.change(namespace_kind, name, "");
  std::async(std::launch::async, [&] { make(journal, name); }).get();
}

}  // namespace ontime::journal
