// SPDX-License-Identifier: Apache-2.0
// Kernel settings of a machine: the kernel's threads and its network path. One table; each setting stands for
// things of this machine (threads, files of /proc and /sys), which the journal changes and restores. Ordinary
// thread only; changes need root, any user can read.
#pragma once

#include <map>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include "journal/journal.hpp"

namespace ontime::settings {

// "irq-threads: this kernel has no IRQ threads. Fix: boot with threadirqs, or a PREEMPT_RT kernel"
struct Error : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// It names a CPU or an interface that is not here, or asks a form at_every_boot() for what it cannot express
// (exit code 2; Error is 3).
struct WrongInput : Error {
  using Error::Error;
};

// The interface of the traffic, and its network namespace by its `ip netns` name; "": this process's own.
struct Link {
  std::string interface, network_namespace;
};

// A thing of this machine, such as one thread, by its kind's name for it.
struct Thing {
  const journal::Kind* kind;
  std::string what;
  std::string title() const;  // for people
};

struct Setting {
  const char* name;    // "ksoftirqd"; in a scenario "kernel.ksoftirqd"
  const char* values;  // for people: "1-99|other"
  const char* help;
  bool of_interface;
  const char* comes_with;  // the setting that, switched on, creates its things; "": none does
  // A value in its one spelling: "90" for "090". Throws std::invalid_argument, with a text for people, for an
  // invalid one.
  std::string (*stated)(const std::string& asked);
  // The things that it sets here, never empty. Throws journal::Error with what this kernel or interface
  // lacks, and the fix.
  std::vector<Thing> (*things)(const std::string& interface);
  // The new value of a thing whose value is `now`; "": it is not meant. Throws journal::Error if this machine
  // cannot have it.
  std::string (*wanted)(const std::string& asked, const Thing&, const std::string& now);
};
std::span<const Setting> table();  // in the order in which they are applied
// The values of a setting whose plain number is a time.
inline constexpr const char* microseconds = "0-1000000";

// The kinds of all things of the table, for a journal.
std::span<const journal::Kind> kinds();

using Wishes = std::map<std::string, std::string>;  // name of a setting → value
// The paper's priorities of kernel threads: interrupts 90, ksoftirqd 60.
const Wishes& paper();

// Wishes that keep the interface's interrupts (if it, or one below it, is hardware) and the kernel's unbound
// work on these CPUs. Throws Error if the interface cannot be read, or its interrupts are not found.
Wishes away_to(const std::string& cpus, const Link&);

// The interrupts of a hardware interface and of those below it (of a bond, a VLAN), from the files below
// `root`. Throws journal::Error if a file cannot be read.
std::vector<int> listed_interrupts(const std::string& interface, const std::string& root = "");

// Whether a kernel thread of that name receives the interface's packets. Before Linux 5.17 the kernel cut
// thread names, so two interfaces may share one: then it is true for both.
bool is_napi_thread(const std::string& thread, const std::string& interface);

// The value of a thing before and after a change.
struct Change {
  const Setting* setting;
  Thing thing;  // kind is null if another setting will create it
  std::string before, after;
};
// The changes that apply() would make; changes nothing. Throws Error for the first impossible one.
std::vector<Change> plan(const Wishes&, const Link&);
// Throws Error for the first that is to be written into a file which is read-only here, as in a container.
void require_writable(const std::vector<Change>&, const Link&);
// Makes all changes or none: if one fails, undoes the earlier ones and throws Error.
std::vector<Change> apply(journal::Journal&, const Wishes&, const Link&);
// Records things that already had their value, so that journal::kept() also checks them.
void remember(journal::Journal&, const std::vector<Change>&, const Link&);
// Restores the earlier values, the last change first. Returns a line for each that could not be restored.
std::vector<std::string> take_back(journal::Journal&, const std::vector<Change>&);
// The present value; nullopt: gone, or not visible.
journal::Value now(const Change&, const Link&);

// A warning about priorities above the application's (0: it has none); "": none is higher.
std::string warning(const Wishes&, int application_priority);

// Of a wish that this machine's kernel accepts and does not act on, for people: "rt-throttling: …"; "": none.
std::string without_effect(const Wishes&);

// Every setting: its things, or why it cannot be set.
struct State {
  const Setting* setting;
  std::vector<std::pair<Thing, std::string>> things;
  std::string cannot;
};
// Throws WrongInput if the named interface does not exist, and journal::Error if it cannot be looked at.
std::vector<State> show(const Link&);
// The value for --set that would keep a thing's value `now`: "on", "60"; `now` itself if there is no such
// word.
std::string value_that_keeps(const Setting&, const Thing&, const std::string& now);
// Of all its things: one value if they are alike, "0=60,1=other", or each with its name. "": it has none.
std::string values_that_keep(const State&);

// An offline CPU keeps its files and threads, but the kernel neither reads nor sets all of them.
std::vector<int> online_cpus();
std::string missing_cpu(const std::string& cpus);  // "there is no CPU 9; there are 0-3"; "": all are there

// "ontime tune apply --set gro=off --interface eth0"
std::string command_to_apply(const std::string& program, const Wishes&, const Link&);
// Text that sets them at every boot: a systemd unit that runs a program, lines of tmpfiles.d, or a script.
// Throws WrongInput for what this form cannot express, and Error if users of this machine could change it.
struct Program {
  std::string path;
  bool is_here = true;  // else on another machine
};
enum class Form { systemd, tmpfiles, shell };
std::string at_every_boot(Form, const Wishes&, const std::vector<Change>&, const Link&, const Program&);

}  // namespace ontime::settings
