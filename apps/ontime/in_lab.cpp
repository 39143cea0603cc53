// SPDX-License-Identifier: Apache-2.0
#include "in_lab.hpp"

#include <algorithm>
#include <filesystem>
#include <string_view>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "flags.hpp"
#include "journal/journal.hpp"
#include "keeper/keeper.hpp"
#include "lab/results.hpp"
#include "output.hpp"
#include "record/record.hpp"

namespace ontime::app {
namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t least_memory_bytes = std::uint64_t{512} << 20U;  // that the kernel needs for itself
constexpr const char* results_name = "results.ontime";

bool is_of_kernel(std::string_view package) {
  return package.starts_with("linux-image-") &&
         package.find_first_not_of("abcdefghijklmnopqrstuvwxyz0123456789+.-") == package.npos;
}

fs::path brought_along(const std::string& path) {
  if (!fs::exists(path)) throw wrong("--with: {}: no such file or folder", path);
  auto whole = fs::canonical(path);
  if (whole == "/") throw wrong("--with: / is the whole machine. Fix: name a file or folder in it");
  for (const auto* own : {"/dev", "/proc", "/run", "/sys", "/tmp"})
    if ((whole.string() + '/').starts_with(std::string(own) + '/'))
      throw wrong(
          "--with: {}: the lab's machine has its own {}, which would hide it. Fix: move it to another folder",
          path, own);
  return whole;
}

// The wire's speed if a NIC can have it; 0: the NICs keep their own.
int speed_of(const campaign::Scenario& scenario) {
  constexpr std::uint64_t mbit = 1'000'000;
  const auto rate = scenario.hosts.wire.bits_per_s;
  return rate == 10 * mbit || rate == 100 * mbit || rate == 1000 * mbit ? static_cast<int>(rate / mbit) : 0;
}

std::string words_of_speed(int mbit_per_s) {
  return mbit_per_s == 0 ? "any" : fmt::format("{} Mbit/s", mbit_per_s);
}

// A copy of the earlier runs, for --resume in the machine.
lab::File brought(const record::Reader& reader, const fs::path& folder) {
  const auto file = folder / results_name;
  record::Writer copy(file.string());
  for (const auto& run : reader.runs()) record::copy_run(reader, run, copy);
  return {file, fs::path(lab::results_folder) / results_name};
}

}  // namespace

void LabFlags::add(Command& command, const std::string& title) {
  const auto add = [&](Option* option) {
    if (!title.empty()) option->group(title);
    options_.push_back(option);
    return option;
  };
  add(add_value(command, "--nic", machine_.nic, "e1000e|virtio|igb", "emulated NIC (default: e1000e)"));
  add(command.add_flag("--deterministic", machine_.deterministic,
                       "count instructions as time, so that every run repeats exactly (default)"));
  add(command.add_flag("--live", live_, "use this machine's time, with its disturbances"))
      ->excludes("--deterministic");
  add(command.add_option("--cpus", cpus_, "number of CPUs (default: 1; with --live: 2)", "N"))
      ->range(1, lab::most_cpus);
  add(add_value(command, "--kernel", machine_.kernel, "PACKAGE",
                "Debian package of the kernel (default: linux-image-rt-amd64)"));
  add(add_value(command, "--memory", memory_, "SIZE", "memory of the machine (default: 2 GiB)"));
  add(add_value(command, "--with", with_, "PATH",
                "copy this file or folder to the same path in the machine; repeatable"))
      ->one_a_flag();
}

lab::Machine LabFlags::machine() const {
  auto machine = machine_;
  const auto nics = lab::nics();
  if (std::ranges::find(nics, machine.nic) == nics.end())
    throw wrong("--nic: '{}' is not one of {}", machine.nic, fmt::join(nics, ", "));
  if (!is_of_kernel(machine.kernel))
    throw wrong("--kernel: '{}' is not a kernel package, such as linux-image-rt-amd64", machine.kernel);
  machine.deterministic = !live_;
  machine.cpus = cpus_.value_or(live_ ? 2 : 1);
  if (!memory_.empty()) machine.memory_bytes = bytes_flag("--memory", memory_);
  if (machine.memory_bytes < least_memory_bytes)
    throw wrong("--memory: '{}' is too small. The least is 512 MiB", memory_);
  for (const auto& path : with_) machine.with.push_back(brought_along(path));
  return machine;
}

std::string LabFlags::first_given() const {
  const auto found = std::ranges::find_if(options_, [](const auto* option) { return option->count() > 0; });
  return found == options_.end() ? "" : (*found)->name();
}

lab::Observer observer_of(Terminal& terminal, const campaign::Interrupts& interrupts) {
  lab::Observer observer;
  observer.note = [&](const std::string& text) { terminal.note(text); };
  observer.says = [&](const std::string& line) { terminal.line(line); };
  observer.waits = [&](std::chrono::seconds since, const std::optional<std::string>& line) {
    terminal.waits(line ? fmt::format("({} real time) {}", about(since), *line)
                        : fmt::format("the lab's machine boots … {}", about(since)));
  };
  observer.interrupted = [&] { return interrupts > 0; };
  return observer;
}

// Each scenario has its own folder, because two files can have the same name.
InLab::InLab(lab::Machine machine, LabTask task) : machine_(std::move(machine)), task_(std::move(task)) {
  for (const auto& scenario : campaign::read_scenarios(task_.scenarios, task_.choice.checked())) {
    const auto& file = scenario.file;
    if (scenario.hosts.kind != campaign::Hosts::Kind::namespaces)
      throw wrong("{}: the lab needs hosts: namespaces. Fix: set it, or use `ontime run`", file);
    const auto speed = speed_of(scenario);
    if (scenarios_.empty()) machine_.nic_mbit_per_s = speed;
    if (speed != machine_.nic_mbit_per_s)
      throw wrong(
          "{}: its wire needs NICs of another speed ({}) than {} ({}). Fix: run these scenarios one at a "
          "time",
          file, words_of_speed(speed), scenarios_.front().here.string(),
          words_of_speed(machine_.nic_mbit_per_s));
    scenarios_.push_back(
        {file, fmt::format("/scenarios/{}/{}", scenarios_.size() + 1, fs::path(file).filename().string())});
  }
}

std::vector<std::string> InLab::command() const {
  auto words = task_.command;
  const auto add = [&](const char* flag, const std::string& value) {
    if (!value.empty()) words.insert(words.end(), {flag, value});
  };
  const auto& choice = task_.choice;
  for (const auto& file : scenarios_) words.push_back(file.there.string());
  add("--send-to", lab::outlet);
  add("--cable", fmt::format("{},{}", lab::controller_nic, lab::component_nic));
  add("--results", (fs::path(lab::results_folder) / results_name).string());
  add("--only", fmt::format("{}", fmt::join(choice.selection.only, ",")));
  add("--transports", fmt::format("{}", fmt::join(choice.selection.transports, ",")));
  add("--duration", choice.duration);
  if (choice.selection.explain) words.emplace_back("--explain");
  if (task_.resume) words.emplace_back("--resume");
  words.insert(words.end(), task_.more.begin(), task_.more.end());
  return words;
}

// Of a scenario's file in the lab's machine.
std::string InLab::name_here(const std::string& there) const {
  const auto file = std::ranges::find(scenarios_, fs::path(there), &lab::File::there);
  return file == scenarios_.end() ? there : file->here.string();
}

LabEnd InLab::measure(record::Writer& writer, Terminal& terminal, const campaign::Interrupts& interrupts) {
  const auto known = writer.reader().runs().size();
  LabEnd end;
  auto observer = observer_of(terminal, interrupts);
  observer.says = [&](const std::string& line) { terminal.line(end.said = line); };
  observer.sent = [&](const fs::path& sent) {
    const record::Reader reader(sent.string());
    for (auto& run : reader.runs()) {
      run.asked.document["command_line"] = command_line();  // as typed on this machine
      run.asked.document["scenario_file"] = name_here(run.asked.scenario_file);
      record::copy_run(reader, run, writer);
    }
  };
  for (const auto& line : journal::revert_abandoned(keeper::kinds())) terminal.note(line);
  journal::Journal journal(keeper::kinds());
  auto files = scenarios_;
  if (known > 0) files.push_back(brought(writer.reader(), journal::add_directory(journal, "lab-results")));
  try {
    const auto outcome = lab::run(machine_, journal, command(), files, observer);
    terminal.note(fmt::format("the lab's machine ran for {} of its own time, in {} of real time",
                              about(outcome.time), about(outcome.real)));
    end.code = outcome.code;
  } catch (const lab::Interrupted&) {
    end.unfinished = "interrupted: the lab's machine stopped, and its unfinished run is lost";
    end.code = 130;
  } catch (const lab::Error& error) {
    if (writer.reader().runs().size() == known) throw;
    end.unfinished = error.what();
    end.code = 3;
  }
  if (!end.unfinished.empty()) terminal.note(end.unfinished);
  return end;
}

void send_from_lab(record::Writer& writer, std::int64_t run, const std::string& to) {
  const auto reader = writer.reader();
  const auto alone = fmt::format("run-{}.ontime", run);
  {
    record::Writer copy(alone);
    record::copy_run(reader, reader.runs(run).front(), copy);
  }
  lab::send(alone, to);
  fs::remove(alone);
}

}  // namespace ontime::app
