// SPDX-License-Identifier: Apache-2.0
#include "lab/lab.hpp"

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <optional>
#include <string_view>
#include <system_error>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <unistd.h>

#include "commands.hpp"
#include "flags.hpp"
#include "journal/journal.hpp"
#include "keeper/keeper.hpp"
#include "measured.hpp"
#include "scenario_files.hpp"
#include "terminal.hpp"

namespace ontime::app {
namespace {

namespace fs = std::filesystem;
using campaign::Error;

constexpr std::uint64_t least_memory_bytes = std::uint64_t{512} << 20U;  // that the kernel needs for itself
constexpr const char* results_name = "results.ontime";

struct LabArguments {
  std::vector<std::string> scenarios, with;
  Choice choice;
  lab::Machine machine;
  std::string memory, results, format = "table";
  std::optional<int> cpus;
  bool live = false, full = false;
};

bool is_of_kernel(std::string_view package) {
  return package.starts_with("linux-image-") &&
         package.find_first_not_of("abcdefghijklmnopqrstuvwxyz0123456789+.-") == package.npos;
}

lab::Machine machine_of(const LabArguments& arguments) {
  auto machine = arguments.machine;
  const auto nics = lab::nics();
  if (std::find(nics.begin(), nics.end(), machine.nic) == nics.end())
    throw Error(2, fmt::format("--nic: '{}' is not one of {}", machine.nic, fmt::join(nics, ", ")));
  if (!is_of_kernel(machine.kernel))
    throw Error(2, fmt::format("--kernel: '{}' is no package of a kernel, such as linux-image-rt-amd64",
                               machine.kernel));
  machine.deterministic = !arguments.live;
  machine.cpus = arguments.cpus.value_or(arguments.live ? 2 : 1);
  try {
    if (!arguments.memory.empty()) machine.memory_bytes = campaign::bytes_of(arguments.memory);
  } catch (const std::invalid_argument& error) {
    throw Error(2, fmt::format("--memory: {}", error.what()));
  }
  if (machine.memory_bytes < least_memory_bytes)
    throw Error(2, fmt::format("--memory: '{}' is too little: 512 MiB are the least", arguments.memory));
  for (const auto& path : arguments.with) {
    if (!fs::exists(path)) throw Error(2, fmt::format("--with: {}: there is no such file or folder", path));
    machine.with.push_back(fs::canonical(path));
    if (machine.with.back() == "/") throw Error(2, "--with: / is all of this machine: name what is wanted");
    for (const auto* own : {"/dev", "/proc", "/run", "/sys", "/tmp"})
      if (const auto folder = machine.with.back().string() + '/'; folder.starts_with(std::string(own) + '/'))
        throw Error(2,
                    fmt::format("--with: {}: the lab's machine has a {} of its own, which would hide it: put "
                                "it elsewhere",
                                path, own));
  }
  return machine;
}

lab::Observer observer_of(Terminal& terminal, const campaign::Interrupts& interrupts) {
  lab::Observer observer;
  observer.note = [&](const std::string& text) { terminal.note(text); };
  observer.says = [&](const std::string& line) { terminal.line(line); };
  observer.waits = [&](std::chrono::seconds since, const std::optional<std::string>& line) {
    terminal.waits(line ? fmt::format("({} here) {}", about(since), *line)
                        : fmt::format("the lab's machine starts … {}", about(since)));
  };
  observer.interrupted = [&] { return interrupts > 0; };
  return observer;
}

// Of its wire, where that is one that a NIC can have; 0: whatever they say.
int speed_of(const campaign::Scenario& scenario) {
  constexpr std::uint64_t mbit = 1'000'000;
  const auto rate = scenario.hosts.wire.bits_per_s;
  return rate == 10 * mbit || rate == 100 * mbit || rate == 1000 * mbit ? static_cast<int>(rate / mbit) : 0;
}

std::string words_of_speed(int mbit_per_s) {
  return mbit_per_s == 0 ? "none" : fmt::format("{} Mbit/s", mbit_per_s);
}

// As they are to be found there, each in a folder of its own, for two may have one name.
std::vector<lab::File> files_of(const std::vector<std::string>& scenarios,
                                const campaign::Selection& selection, lab::Machine& machine) {
  std::vector<lab::File> files;
  for (const auto& scenario : campaign::read_scenarios(scenario_files(scenarios), selection)) {
    const auto& file = scenario.file;
    if (scenario.hosts.kind != campaign::Hosts::Kind::namespaces)
      throw Error(2, fmt::format("{}: the lab has two machines in one, and needs hosts: namespaces", file));
    const auto speed = speed_of(scenario);
    if (files.empty()) machine.nic_mbit_per_s = speed;
    if (speed != machine.nic_mbit_per_s)
      throw Error(2, fmt::format("{}: its wire asks for NICs of a speed ({}), and {}'s for another ({}): the "
                                 "lab's have one for all, so run them one after the other",
                                 file, words_of_speed(speed), files.front().here.string(),
                                 words_of_speed(machine.nic_mbit_per_s)));
    files.push_back(
        {file, fmt::format("/scenarios/{}/{}", files.size() + 1, fs::path(file).filename().string())});
  }
  return files;
}

// What measures there, of the same scenarios by the same choice.
std::vector<std::string> command_of(const std::vector<lab::File>& scenarios, const Choice& choice) {
  std::vector<std::string> words = {"ontime", "run", "--only-measure"};
  const auto add = [&](const char* flag, const std::string& value) {
    if (!value.empty()) words.insert(words.end(), {flag, value});
  };
  for (const auto& file : scenarios) words.push_back(file.there.string());
  add("--cable", fmt::format("{},{}", lab::controller_nic, lab::component_nic));
  add("--results", (fs::path(lab::results_folder) / results_name).string());
  add("--only", fmt::format("{}", fmt::join(choice.selection.only, ",")));
  add("--transports", fmt::format("{}", fmt::join(choice.selection.transports, ",")));
  add("--duration", choice.duration);
  if (choice.selection.explain) words.emplace_back("--explain");
  return words;
}

int run(const LabArguments& arguments, const GateFlags& flags) {
  const auto format = format_flag(arguments.format);
  const auto gates = flags.gates();
  auto machine = machine_of(arguments);
  const auto scenarios = files_of(arguments.scenarios, arguments.choice.checked(), machine);
  const auto results =
      arguments.results.empty() ? new_results_file(arguments.scenarios.front()) : arguments.results;
  if (fs::exists(fs::symlink_status(results)))
    throw Error(2, fmt::format("--results: {} exists, and the lab writes a new file: name another", results));
  if (const auto there = fs::absolute(results).parent_path(); access(there.c_str(), W_OK | X_OK) != 0)
    throw Error(3, fmt::format("--results: {} cannot be written there: {}: name another file", results,
                               std::generic_category().message(errno)));
  auto& interrupts = catch_interrupts();
  Terminal terminal;
  const auto observer = observer_of(terminal, interrupts);
  journal::revert_abandoned(keeper::kinds());
  journal::Journal journal(keeper::kinds());
  const fs::path folder = journal::add_directory(journal, "lab-results");
  try {
    const auto outcome =
        lab::run(machine, journal, command_of(scenarios, arguments.choice), scenarios, folder, observer);
    terminal.note(fmt::format("the lab's machine ran for {} of its time, which took {}", about(outcome.time),
                              about(outcome.real)));
    if (!fs::exists(folder / results_name)) return outcome.code;
    fs::copy_file(folder / results_name, results);
    record::Writer writer(results);
    return show_measured({writer, results, 0, outcome.code}, format, arguments.full, flags, gates, terminal);
  } catch (const lab::Interrupted&) {
    terminal.note("interrupted: the machine and its measurements are lost");
    return 130;
  }
}

int shell(const LabArguments& arguments) {
  const auto machine = machine_of(arguments);
  auto& interrupts = catch_interrupts();
  Terminal terminal;
  journal::revert_abandoned(keeper::kinds());
  journal::Journal journal(keeper::kinds());
  terminal.note("the machine starts in about 10 to 30 s; leave it with exit, or Ctrl-A X");
  lab::shell(machine, journal, observer_of(terminal, interrupts));
  return 0;
}

void add_machine(Command& command, LabArguments& arguments) {
  command.add_option("--nic", arguments.machine.nic, "emulated network card: e1000e, virtio or igb: e1000e")
      ->type_name("e1000e|virtio|igb")
      ->check(given);
  auto* deterministic =
      command.add_flag("--deterministic", arguments.machine.deterministic,
                       "time is made of instructions, so that every run repeats exactly: the default");
  command.add_flag("--live", arguments.live, "this machine's time, with all its disturbances")
      ->excludes(deterministic);
  command.add_option("--cpus", arguments.cpus, "number of CPUs: 1; with --live 2")
      ->type_name("N")
      ->range(1, lab::most_cpus);
  command.add_option("--kernel", arguments.machine.kernel, "Debian's package: linux-image-rt-amd64")
      ->type_name("PACKAGE")
      ->check(given);
  command.add_option("--memory", arguments.memory, "memory of the machine: 2 GiB")
      ->type_name("SIZE")
      ->check(given);
  command
      .add_option("--with", arguments.with,
                  "copy this file or folder to the same place in the machine; repeatable")
      ->allow_extra_args(false)
      ->type_name("PATH")
      ->check(given);
}

}  // namespace

void add_lab(Command& app, Action& action) {
  auto* command = app.add_subcommand(
      "lab", "A simulated machine with PREEMPT_RT and two NICs, in which scenarios repeat exactly");
  command->require_subcommand();
  command->footer(
      "It is QEMU with a Debian kernel, which apt fetches into the user's cache folder (500 MB). It compares "
      "settings; it does not predict the times of a real machine.");
  auto* runs = command->add_subcommand(
      "run", "Carries out scenarios there, with hosts: namespaces; brings out the results");
  auto measured = std::make_shared<LabArguments>();
  runs->add_option("SCENARIO", measured->scenarios,
                   "scenario files, folders of them, or names that `ontime scenarios` shows")
      ->required();
  add_machine(*runs, *measured);
  add_choice(*runs, measured->choice);
  add_file(*runs, "--results", measured->results, "this new results file (default: one here)");
  add_report_format(*runs, measured->format);
  add_full(*runs, measured->full);
  auto flags = std::make_shared<GateFlags>(*runs, gate::Use::fail_if);
  runs->callback(
      [&action, measured, flags] { action = [measured, flags] { return run(*measured, *flags); }; });

  auto* shells = command->add_subcommand("shell", "A shell in such a machine, to look around");
  auto looked = std::make_shared<LabArguments>();
  add_machine(*shells, *looked);
  shells->callback([&action, looked] { action = [looked] { return shell(*looked); }; });
}

}  // namespace ontime::app
