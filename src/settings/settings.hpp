// SPDX-License-Identifier: Apache-2.0
// Kernel settings of a machine: the kernel's threads and its network path. One table; each setting stands for
// things of this machine (threads, files of /proc and /sys), which the journal changes and restores. Ordinary
// thread only; changes need root, any user can read.
#pragma once

#include <map>
#include <optional>
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

// The interface that the traffic takes, and the network namespace that it is in, by the name that `ip netns`
// has for it; "": this process's own.
struct Link {
  std::string interface, network_namespace;
};

// A thing of this machine, such as one thread, by the name that its kind has for it.
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
  const char* comes_with;  // with this setting on its things come to be; "": they are there, or never will be
  // Throws std::invalid_argument, for people, where that is no value of it.
  void (*check)(const std::string& asked);
  // What it stands for here, never nothing. Throws journal::Error that says what this kernel or the interface
  // lacks, and what would help.
  std::vector<Thing> (*things)(const std::string& interface);
  // What a thing that is `now` so is to be then. Throws journal::Error where that cannot be had here.
  std::string (*wanted)(const std::string& asked, const Thing&, const std::string& now);
};
std::span<const Setting> table();  // in the order in which they are applied

// Of all things of the table: what a journal that may hold them must know.
std::span<const journal::Kind> kinds();

using Wishes = std::map<std::string, std::string>;  // name of a setting → value
// The paper's, of the kernel's threads: interrupts at 90, ksoftirqd at 60.
const Wishes& paper();

// That the interface's interrupts, if it or one below it is hardware, and the kernel's unbound work come on
// these CPUs alone. Throws Error where the interface cannot be looked at, or must have interrupts and none
// are found.
Wishes away_to(const std::string& cpus, const Link&);

// The interrupts of an interface, and of those below it (of a bond, a VLAN), if it is hardware, by what the
// machine's files below `root` say. Throws journal::Error where the kernel does not say.
std::vector<int> listed_interrupts(const std::string& interface, const std::string& root = "");

// Whether a kernel's thread of that name takes in the packets of the interface, or seems to: before
// Linux 5.17 the kernel cut the names of threads, so two interfaces may share one.
bool is_napi_thread(const std::string& thread, const std::string& interface);

// What a thing was and what it is, or is to be.
struct Change {
  const Setting* setting;
  Thing thing;  // of kind null, if it will only come with another setting
  std::string before, after;
};
// What would be changed. Throws Error for the first that cannot be had; changes nothing.
std::vector<Change> plan(const Wishes&, const Link&);
// All of it, or nothing: throws Error, and what was changed is given back.
std::vector<Change> apply(journal::Journal&, const Wishes&, const Link&);
// That those which were so before are to stay so, too (journal::kept()).
void remember(journal::Journal&, const std::vector<Change>&, const Link&);
// As they were before, the last first. Returns what could not be given back, for people.
std::vector<std::string> take_back(journal::Journal&, const std::vector<Change>&);
// What they are now; nothing: gone, or not to be seen.
journal::Value now(const Change&, const Link&);

// What a priority above the application's (0: it has none) can do; "" where nothing is so high.
std::string warning(const Wishes&, int application_priority);

// Every setting: what its things are, or why it cannot be set.
struct State {
  const Setting* setting;
  std::vector<std::pair<Thing, std::string>> things;
  std::string cannot;
};
// Throws journal::Error: an interface is named that is not there.
std::vector<State> show(const Link&);
// The value that would leave a thing that is `now` so as it is: "on", "60"; `now` where no such word would.
std::string value_that_keeps(const Setting&, const Thing&, const std::string& now);

// "ontime tune apply --set gro=off --interface eth0"
std::string command_to_apply(const std::string& program, const Wishes&, const Link&);
// What sets them at every boot: a unit of systemd that has `program` do it, lines of tmpfiles.d, or a script.
// Throws Error for what cannot be said so.
enum class Form { systemd, tmpfiles, shell };
std::optional<Form> form_of(const std::string& word);
std::string at_every_boot(Form, const Wishes&, const std::vector<Change>&, const Link&,
                          const std::string& program);

}  // namespace ontime::settings
