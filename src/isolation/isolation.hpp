// SPDX-License-Identifier: Apache-2.0
// CPUs that are kept for some processes, and a limit for what runs beside them: by the kernel's control
// groups, of version 2 or 1, whichever the machine has the controller in. Ordinary thread only; root alone
// may.
//
// Version 2: a partition of the root, which the kernel itself keeps all others off, wherever they are; no
// process is moved. Version 1: who is in the root and may run anywhere is moved into a group that has the
// other CPUs, and back; a process with its own CPUs, or in another group, stays. Where that is true of all
// (isolcpus, systemd's CPUAffinity=), the CPUs that all have cannot be reserved.
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

  // That process has the reserved CPUs from now on, with all its threads, and no others. Throws
  // journal::Error.
  void keep(pid_t) const;
  // The CPUs of all others; "" where none are kept.
  const std::string& rest() const { return rest_; }
  // What a process that is to run beside writes a 0 into, before anything else: files of the kernel.
  std::vector<std::string> beside() const;

  // What was made of the machine, and what it is at this moment ("gone" where it is no more).
  struct State {
    std::string setting, thing, before, after, now;  // "cpus", "all other processes": "0-1", "0", "0"
  };
  std::vector<State> state() const;
  // The threads of others that may run on the reserved CPUs all the same, but for the kernel's own of each
  // CPU: the first of them, for people; "": there are none.
  std::string stay() const;

  // Before the end, which does the same. Returns what could not be given back, for people.
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

// What of it a journal may have to give back.
std::span<const journal::Kind> kinds();

}  // namespace ontime::isolation
