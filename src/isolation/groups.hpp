// SPDX-License-Identifier: Apache-2.0
// The mounted control groups, and the threads in them. All functions throw journal::Error.
#pragma once

#include <string>
#include <vector>

#include <sys/types.h>

#include "journal/journal.hpp"

namespace ontime::isolation {

struct Hierarchy {
  std::string folder;  // of the root group
  bool unified;        // version 2; else version 1 with this controller
};
// The hierarchy with the controller "cpuset" or "cpu". Throws, with the fix, if it is not mounted or is only
// a part of a larger one (in a container).
Hierarchy hierarchy_of(const std::string& controller, const std::string& mounts = "/proc/self/mounts");

// The groups below the root that have some of these CPUs set, sorted.
std::vector<std::string> owners_of(const Hierarchy&, const std::vector<int>& cpus);

// ontime's own groups below the root: "cpuset/ontime-robot". The value is the group's identity; processes in
// it move to the root when it is removed.
extern const journal::Kind group_kind;
// A controller of cgroup v2 for the groups below the root: "off", "on", or "on, for GROUP": GROUP would lose
// its settings if it were switched off.
extern const journal::Kind controller_kind;
// "root" of cgroup v1: "1" if the scheduler balances load over all its CPUs, "0" if only within groups.
extern const journal::Kind balance_kind;

std::string folder_of(const std::string& group);  // of "cpuset/ontime-robot"

struct Thread {
  pid_t id;
  std::string name;
  std::vector<int> cpus;
  bool of_kernel, bound;  // bound: to its CPUs; the kernel permits no change
};
std::vector<Thread> threads();
std::vector<pid_t> ids_in(const std::string& file);
bool move(pid_t, const std::string& file);           // false: it has ended, or the kernel refuses
std::vector<int> cpus_of_thread(pid_t);              // empty: it has ended
void set_cpus(pid_t, const std::vector<int>& cpus);  // no effect if it has ended or the kernel refuses

// Whether a thread would lose its own CPUs after a partition of some of `everybodys` CPUs was made and
// removed. Linux 6.2 and later `remembers` the CPUs that threads requested.
bool would_be_forgotten(const Thread&, const std::vector<int>& everybodys, const std::vector<int>& kept,
                        bool remembers);

}  // namespace ontime::isolation
