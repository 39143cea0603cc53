// SPDX-License-Identifier: Apache-2.0
// The kernel's control groups as they are mounted here, and the threads that are in them. All throw
// journal::Error.
#pragma once

#include <string>
#include <vector>

#include <sys/types.h>

#include "journal/journal.hpp"

namespace ontime::isolation {

struct Hierarchy {
  std::string folder;  // of the root group
  bool unified;        // of version 2; else of version 1, and of this controller
};
// Of the controller "cpuset" or "cpu". Throws where there is none, or only a part of it (in a container),
// with what would help.
Hierarchy hierarchy_of(const std::string& controller, const std::string& mounts = "/proc/self/mounts");

// The groups below the root that have been given some of these CPUs, in order.
std::vector<std::string> owners_of(const Hierarchy&, const std::vector<int>& cpus);

// Names of our own below the root: "cpuset/ontime-robot". Its value is its identity; what is in it when it is
// removed goes to the root.
extern const journal::Kind group_kind;
// A controller of version 2, for the groups below the root: "off", "on", or "on, for GROUP" whose settings it
// would be taken from.
extern const journal::Kind controller_kind;
// "root" of version 1: "1" if the scheduler balances load over all of its CPUs, "0" if only within groups.
extern const journal::Kind balance_kind;

std::string folder_of(const std::string& group);  // of "cpuset/ontime-robot"

struct Thread {
  pid_t id;
  std::string name;
  std::vector<int> cpus;
  bool of_kernel, bound;  // bound: to its CPUs, for ever
};
std::vector<Thread> threads();
std::vector<pid_t> ids_in(const std::string& file);
bool move(pid_t, const std::string& file);           // false: it has ended, or the kernel does not let it go
std::vector<int> cpus_of_thread(pid_t);              // none: it has ended
void set_cpus(pid_t, const std::vector<int>& cpus);  // if it has not ended, and the kernel lets it

// Whether a thread of a machine whose threads have `everybodys` CPUs would not have its own again once a
// partition was made of some of them, and removed; Linux from 6.2 on `remembers` what threads asked for.
bool would_be_forgotten(const Thread&, const std::vector<int>& everybodys, const std::vector<int>& kept,
                        bool remembers);

}  // namespace ontime::isolation
