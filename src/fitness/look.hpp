// SPDX-License-Identifier: Apache-2.0
// A machine's files, below the folder that stands for "/".
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "fitness/fitness.hpp"
#include "process/process.hpp"

namespace ontime::fitness {

class Look {
 public:
  explicit Look(const Subject& subject) : subject_(subject) {}
  const Subject& subject() const { return subject_; }

  // Without leading and trailing white space; nullopt if it cannot be read.
  std::optional<std::string> text(const std::string& path) const;
  std::optional<std::int64_t> number(const std::string& path) const;
  std::vector<std::string> names(const std::string& folder) const;  // in order
  bool exists(const std::string& path) const;

  std::vector<process::Stat> kernel_threads(const std::string& prefix) const;
  // Any process may have this name: where its program can be read, that counts, too.
  bool runs(const std::string& program) const;

 private:
  std::string at(const std::string& path) const { return subject_.root + path; }
  std::vector<process::Stat> processes() const;
  const Subject& subject_;
};

inline Finding fine(std::string is) { return {Severity::fine, std::move(is), "", "", ""}; }

using Findings = std::vector<Finding>;
// Empty if the check does not apply to this machine.
Findings preemption(const Look&), throttling(const Look&), fair_server(const Look&), autogroup(const Look&),
    timer_migration(const Look&), clock_source(const Look&), clock_synchronised(const Look&);
Findings governor(const Look&), idle_states(const Look&), smt(const Look&), isolation(const Look&),
    full_isolation(const Look&), virtualisation(const Look&), stolen_time(const Look&),
    cpu_quota(const Look&);
Findings priority_limit(const Look&), memory_limit(const Look&), priority_budget(const Look&),
    swap(const Look&), huge_pages(const Look&), memory_balancing(const Look&), compaction(const Look&);
Findings buffers(const Look&), fragments(const Look&), interrupts(const Look&),
    interrupt_balance(const Look&), napi(const Look&);
Findings middlewares(const Look&);

}  // namespace ontime::fitness
