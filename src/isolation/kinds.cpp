// SPDX-License-Identifier: Apache-2.0
#include <array>
#include <cerrno>
#include <chrono>
#include <thread>

#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include "isolation/groups.hpp"
#include "isolation/isolation.hpp"
#include "realtime/realtime.hpp"
#include "settings/file.hpp"

namespace ontime::isolation {
namespace {

using journal::Value;
using settings::read_file;
using settings::trouble;
using settings::write_file;

bool is_controller(const std::string& what) { return what == "cpuset" || what == "cpu"; }

bool accepts_group(const std::string& what) {
  const auto slash = what.find('/');
  return slash != what.npos && is_controller(what.substr(0, slash)) &&
         journal::is_own_name(what.substr(slash + 1));
}

// The kernel numbers folders in the order of their creation and never reuses a number.
Value read_group(const std::string& what) {
  struct stat found {};
  const auto folder = folder_of(what);
  if (stat(folder.c_str(), &found) != 0) {
    if (errno == ENOENT) return {};
    throw trouble(folder, errno);
  }
  return std::to_string(found.st_ino);
}

// Interrupt threads follow their interrupts. When the CPUs of their group change, the kernel forgets this
// until the CPUs of the interrupt are written again.
void say_interrupts_again() {
  for (const auto& number : settings::names_in("/proc/irq")) {
    const auto file = fmt::format("/proc/irq/{}/smp_affinity_list", number);
    try {
      if (const auto cpus = read_file(file); cpus) write_file(file, *cpus);
    } catch (const journal::Error&) {  // of the kernel or of one CPU: it cannot be moved
      continue;
    }
  }
}

std::vector<int> cpus_given_to(const std::string& folder) {
  return realtime::cpus_of(read_file(folder + "/cpuset.cpus").value_or("")).value_or(std::vector<int>{});
}

// For a cpuset of cgroup v1. Linux before 6.2 forgets which of the group's CPUs a thread had requested.
void move_with_its_cpus(pid_t id, const std::string& group, const std::string& root) {
  const auto had = cpus_of_thread(id);
  if (move(id, root + "/tasks") && had != cpus_given_to(group) && cpus_of_thread(id) == cpus_given_to(root))
    set_cpus(id, had);
}

// Its processes may fork, and ended ones need some time to disappear: repeated until it can be removed.
void remove_group(const std::string& what) {
  constexpr int tries = 400;
  const auto folder = folder_of(what);
  const auto root = hierarchy_of(what.substr(0, what.find('/')));
  const bool is_cpuset = what.starts_with("cpuset/");
  const auto* const list = root.unified ? "/cgroup.procs" : "/tasks";
  // The kernel completes the removal of a group some time later; only then all processes have its CPUs again.
  if (const auto partition = folder + "/cpuset.cpus.partition"; is_cpuset && read_file(partition))
    write_file(partition, "member");
  for (int i = 0; i < tries; ++i) {
    for (const auto id : ids_in(folder + list))
      if (is_cpuset && !root.unified)
        move_with_its_cpus(id, folder, root.folder);
      else
        move(id, root.folder + list);
    if (rmdir(folder.c_str()) == 0 || errno == ENOENT) {
      if (is_cpuset && root.unified) say_interrupts_again();
      return;
    }
    if (errno != EBUSY) throw trouble(folder + " cannot be removed", errno);
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  throw trouble(folder + " cannot be removed: it is not empty", EBUSY);
}

void write_group(const std::string& what, const Value& value, const Value& present) {
  if (value) {
    const auto folder = folder_of(what);
    if (mkdir(folder.c_str(), 0755) == 0) return;
    if (errno == EEXIST)
      throw journal::MadeByAnother(
          fmt::format("control group {0} already exists, and this ontime did not make it. Fix: if no process "
                      "uses it, sudo rmdir {0}",
                      folder));
    throw trouble(folder, errno);
  }
  if (present != journal::to_be_made && read_group(what) != present)
    throw journal::Error(
        fmt::format("control group {} cannot be removed: another program made it anew", what));
  remove_group(what);
}

std::string unified_root(const std::string& controller) {
  auto root = hierarchy_of(controller);
  if (!root.unified)
    throw journal::Error(fmt::format("controller '{}' has meanwhile moved to cgroup v1", controller));
  return std::move(root.folder);
}

constexpr const char* passed_on = "/cgroup.subtree_control";

bool is_passed_on(const std::string& group, const std::string& controller) {
  const auto to = ' ' + read_file(group + passed_on).value_or("") + ' ';
  return to.find(' ' + controller + ' ') != to.npos;
}

// A group that has changed a setting of this controller, or passes the controller on to groups below it (then
// the kernel refuses to turn it off); "": none.
std::string user_of(const std::string& controller) {
  const auto root = hierarchy_of(controller).folder;
  for (const auto& name : settings::names_in(root)) {
    if (journal::is_own_name(name)) continue;
    const auto is = [&](const char* file, const char* usual) {
      const auto said = read_file(fmt::format("{}/{}/{}", root, name, file));
      return !said || *said == usual;
    };
    const bool as_born = controller == "cpuset" ? is("cpuset.cpus", "") && is("cpuset.mems", "")
                                                : is("cpu.weight", "100") && is("cpu.max", "max 100000");
    if (!as_born || is_passed_on(fmt::format("{}/{}", root, name), controller)) return name;
  }
  return "";
}

Value read_controller(const std::string& controller) {
  if (!is_passed_on(unified_root(controller), controller)) return "off";
  const auto user = user_of(controller);
  return user.empty() ? "on" : "on, for " + user;
}

void write_controller(const std::string& controller, const Value& value, const Value&) {
  write_file(unified_root(controller) + passed_on, (value == "on" ? "+" : "-") + controller);
}

bool is_root(const std::string& what) { return what == "root"; }
std::string balance_file() { return hierarchy_of("cpuset").folder + "/cpuset.sched_load_balance"; }
Value read_balance(const std::string&) { return read_file(balance_file()); }
void write_balance(const std::string&, const Value& value, const Value&) {
  write_file(balance_file(), value.value_or("1"));
}

}  // namespace

// Mounts are visible in a mount namespace.
const journal::Kind group_kind = {"control group", journal::Scope::mount_namespace, accepts_group, read_group,
                                  write_group};
const journal::Kind controller_kind = {"control group controller", journal::Scope::mount_namespace,
                                       is_controller, read_controller, write_controller};
const journal::Kind balance_kind = {"cpuset load balancing", journal::Scope::mount_namespace, is_root,
                                    read_balance, write_balance};

std::span<const journal::Kind> kinds() {
  static const std::array all{group_kind, controller_kind, balance_kind};
  return all;
}

}  // namespace ontime::isolation
