// SPDX-License-Identifier: Apache-2.0
// Reserved CPUs for some processes, and a limit for the load beside them: by control groups of version 2 or
// 1, whichever has the controller on this machine. Ordinary thread only; needs root.
//
// cgroup v2: a partition of the root group; the kernel keeps all other processes off its CPUs, and no process
// is moved. cgroup v1: processes in the root group that may run on all CPUs are moved into a group with the
// other CPUs, and back at the end; a process bound to CPUs, or in another group, stays. If all processes are
// bound since boot (isolcpus, systemd's CPUAffinity=), those CPUs cannot be reserved.
#pragma once

#include <span>
#include <string>
#include <vector>

#include <sys/types.h>

#include "conditions/around.hpp"
#include "journal/journal.hpp"

namespace ontime::isolation {

using Wish = conditions::Isolation;

class Isolation {
 public:
  // Throws journal::Error, for people, and then nothing is changed.
  Isolation(journal::Journal&, const Wish&);
  const Wish& wish() const { return wish_; }
  ~Isolation();
  Isolation(const Isolation&) = delete;
  Isolation& operator=(const Isolation&) = delete;

  // Binds that process, with all its threads, to the reserved CPUs. Throws journal::Error.
  void keep(pid_t) const;
  // The CPUs of all other processes; "" if none are reserved.
  const std::string& rest() const { return rest_; }
  // Kernel files into which a load process writes a 0 at its start, to join the load's group.
  std::vector<std::string> beside() const;

  // The changes of the machine, and their present state ("gone": no longer there).
  struct State {
    std::string setting, thing, before, after, now;  // "cpus", "all other processes": "0-1", "0", "0"
  };
  std::vector<State> state() const;
  // Other threads that can still run on the reserved CPUs, except the kernel's per-CPU threads: the first
  // ones, for people; "": none.
  std::string stay() const;

  // Restores everything before the destructor would. Returns a line for each change that could not be undone.
  std::vector<std::string> take_back();

 private:
  struct Made {
    const journal::Kind* kind;
    std::string what;
  };
  void make(const journal::Kind&, const std::string& what, const journal::Value&);
  void keep_cpus();
  void move_others() const;
  void limit();
  journal::Journal& journal_;
  const Wish wish_;
  std::string everybodys_, rest_;
  std::vector<Made> made_;
  std::vector<State> limits_;
};

// The kinds of change that a journal may have to undo.
std::span<const journal::Kind> kinds();

}  // namespace ontime::isolation
