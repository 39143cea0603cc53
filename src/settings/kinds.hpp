// SPDX-License-Identifier: Apache-2.0
// How each kind of thing is found, read and written. All throw journal::Error.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "settings/settings.hpp"

namespace ontime::settings {

// A kernel thread. "14:25:ksoftirqd/0" is its id, its start time (a later thread may have the same id) and
// its name. Its value is policy, priority (or niceness) and CPUs: "fifo:60:0-1", "other:0:1".
extern const journal::Kind thread;
// A kernel thread whose CPUs the kernel chooses: an interrupt's thread follows its interrupt, and the thread
// of an offline CPU has none. Its value: "fifo:60", "other:0".
extern const journal::Kind thread_priority;
// "net/core/rmem_max", "kernel/timer_migration": a file below /proc/sys. A file of the network exists only in
// namespaces where it can be written.
extern const journal::Kind network_sysctl, kernel_sysctl;
extern const journal::Kind governor;  // "cpu0"
// "unbound": the CPUs for kernel work that may run on any CPU.
extern const journal::Kind workqueues;
// "41:PCI-MSI 524288": its number, chip and hardware interrupt; its value: CPUs
extern const journal::Kind interrupt;
extern const journal::Kind threaded;  // an interface; "0" or "1"
extern const journal::Kind steering;  // "3:eth0/rx-0": to which CPUs its packets are handed; "none"
// An interface; "rx-usecs=3,rx-frames=0,tx-usecs=0,tx-frames=0,adaptive-rx=off,adaptive-tx=off"
extern const journal::Kind coalescing;
extern const journal::Kind gro;  // an interface; "on" or "off"

// The error for a CPU or an interface that does not exist here: wrong input.
struct Unknown : journal::Error {
  using journal::Error::Error;
};

// An interface is "3:eth0": its index, and its name at that time. A renamed interface keeps its index.
std::string interface_here(const std::string& name);
// Its folder in /sys. Throws if /sys shows the interfaces of another network namespace than this thread's:
// one of them may have that name.
std::string folder_of_interface(const std::string& name);
bool is_interface(const std::string& what);
std::string name_of_interface(const std::string& interface_or_queue);  // "eth0", "eth0/rx-0"
// Its current name; nullopt: no interface has that index. Throws if it seems to have been moved to another
// network namespace: its settings go with it.
std::optional<std::string> name_now(const std::string& interface_or_queue);
// Whether `is_so` holds in a network namespace of a process or of `ip netns`, other than this thread's.
bool in_another_namespace(const std::function<bool()>& is_so);

// Reads and writes by its present name.
template <auto read, auto write>
constexpr journal::Kind kind_of_interface(const char* name, bool (*accepts)(const std::string&)) {
  return {name, journal::Scope::network_namespace, accepts,
          [](const std::string& what) {
            const auto its_name = name_now(what);
            return its_name ? read(*its_name) : journal::Value();
          },
          [](const std::string& what, const journal::Value& value, const journal::Value&) {
            const auto its_name = name_now(what);
            if (!its_name) throw journal::Error(what + " no longer exists");
            write(*its_name, value);
          }};
}

// If the thing is a file that is the same at the next boot: its path, and the text to write for a value; else
// nullopt.
struct File {
  std::string path, text;
};
std::optional<File> file_of(const Thing&, const std::string& value);

// Why the thing's file cannot be written even by root, and the fix; "": it can, or it is no file.
std::string read_only(const Thing&);

std::vector<Thing> threads_named(const std::string& prefix);
std::string name_of_thread(const std::string& what);
// The threads that receive the packets of an interface of this network namespace.
std::vector<Thing> napi_threads_of(const std::string& interface);
// For kernels that report only thread names: throws if two interfaces have the same name.
std::vector<Thing> napi_threads_by_name(const std::string& interface);
// A thread's value with one part replaced.
std::string with_priority(const std::string& value, const std::string& asked);
std::string with_cpus(const std::string& value, const std::string& cpus);

// The members of listed_interrupts() whose CPUs can be set.
std::vector<int> interrupts_of(const std::string& interface);
// Whether some interrupts of an interface are unknown: of its device, or of a device below it, which may be
// in another network namespace.
bool hides_interrupts(const std::string& interface);
std::string interrupt_here(int number);
std::vector<Thing> cpus_with_governor();  // of those that are online
std::vector<Thing> receive_queues_of(const std::string& interface);
std::string with_coalescing(const std::string& value, const std::string& asked);

}  // namespace ontime::settings
