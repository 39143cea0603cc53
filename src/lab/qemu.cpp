// SPDX-License-Identifier: Apache-2.0
#include "lab/qemu.hpp"

#include <algorithm>
#include <array>
#include <fstream>
#include <sstream>

#include <fmt/format.h>
#include <sys/utsname.h>
#include <unistd.h>

#include "background/background.hpp"
#include "background/child.hpp"
#include "machine/machine.hpp"

namespace ontime::lab {
namespace {

namespace fs = std::filesystem;

constexpr const char* qemu = "qemu-system-x86_64";
constexpr const char* package = "qemu-system-x86";
// CPUs with counted instructions take turns; a turn ends when a timer of QEMU is due. The timer of an
// otherwise unused filter keeps turns short.
constexpr int turn_us = 10;
// Records to /dev/null: only while recording do QEMU's other threads wait until the instructions before a
// halt are counted. Otherwise a thread can advance the machine's clock too early, and times differ. QEMU
// refuses it with more than one CPU.
constexpr const char* recording = ",rr=record,rrfile=/dev/null";
constexpr std::array all_nics = {"e1000e", "virtio", "igb"};

std::string device_of(const std::string& nic) { return nic == "virtio" ? "virtio-net-pci" : nic; }

std::string answer(const std::vector<std::string>& command) {
  try {
    return background::output_of(command, package);
  } catch (const background::Error& error) {
    throw Error(error.what());
  }
}

// QEMU writes a comma in a value as two.
std::string escaped(const fs::path& path) {
  std::string result;
  for (const char c : path.string()) result += c == ',' ? std::string(",,") : std::string(1, c);
  return result;
}

void check_memory(const Machine& machine) {
  std::ifstream text("/proc/meminfo");
  std::uint64_t kib = 0;
  for (std::string word; text >> word;)
    if (word == "MemAvailable:" && text >> kib && kib * 1024 < machine.memory_bytes)
      throw Error(
          fmt::format("the lab's machine needs {} MiB of memory, but {} MiB are free. Fix: reduce --memory, "
                      "or stop other programs",
                      machine.memory_bytes >> 20U, kib >> 10U));
}

bool takes_turns(const std::string& version) {
  int major = 0, minor = 0;
  char point = 0;
  std::istringstream(version) >> major >> point >> minor;
  return major > 8 || (major == 8 && minor > 0);
}

std::string kernel_words(const Machine& machine, Accelerator accelerator, const std::string& version) {
  std::string time = accelerator == Accelerator::kvm ? "KVM, " : "";
  time += machine::live_time;
  if (machine.deterministic) time = "time from counted instructions, 2 ns each";
  if (machine.deterministic && machine.cpus > 1) time += fmt::format(", {} CPUs in turn", machine.cpus);
  const auto what = fmt::format("QEMU {}, {}, {}", version, machine.nic, time);
  return fmt::format("console=ttyS0 quiet panic=-1 {}{}",
                     machine.deterministic ? "nokaslr tsc=reliable clocksource=tsc " : "",
                     machine::simulated_by(what));
}

}  // namespace

std::span<const char* const> nics() { return all_nics; }

std::string check_qemu(const Machine& machine) {
  utsname here{};
  uname(&here);
  if (std::string_view(here.machine) != "x86_64")
    throw Error(fmt::format("the lab needs an x86_64 machine, but this one is {}", here.machine));
  const auto said = answer({qemu, "--version"});
  if (answer({qemu, "-device", "help"}).find(fmt::format("name \"{}\"", device_of(machine.nic))) == said.npos)
    throw Error(fmt::format(
        "this QEMU has no {}: {}. Fix for igb on Debian 12: sudo apt install -t bookworm-backports {}",
        machine.nic, said.substr(0, said.find('\n')), package));
  check_memory(machine);
  constexpr std::string_view before = "version ";
  const auto begin = said.find(before);
  if (begin == said.npos) throw Error(fmt::format("{} does not print its version, but: {}", qemu, said));
  auto version = said.substr(begin + before.size());
  version.erase(std::min(version.find_first_of(" \n"), version.size()));
  if (machine.deterministic && machine.cpus > 1 && !takes_turns(version))
    throw Error(
        fmt::format("QEMU {} cannot boot {} CPUs with --deterministic. Fix: use QEMU later than 8.0 (sudo "
                    "apt install -t bookworm-backports {}), or --cpus 1",
                    version, machine.cpus, package));
  return version;
}

bool may_use_kvm() { return access("/dev/kvm", R_OK | W_OK) == 0; }

std::vector<std::string> qemu_command(const Machine& machine, Accelerator accelerator,
                                      const std::string& version, const fs::path& kernel, const Files& files,
                                      bool at_terminal) {
  std::vector<std::string> words = {qemu, "-nodefaults", "-no-user-config", "-no-reboot", "-display", "none"};
  const auto add = [&](std::initializer_list<std::string> more) { words.insert(words.end(), more); };
  add({"-machine", "q35", "-m", fmt::format("{}M", machine.memory_bytes >> 20U), "-smp",
       fmt::format("{}", machine.cpus)});
  if (machine.deterministic)
    add({"-accel", "tcg", "-icount", fmt::format("shift=1,sleep=off{}", machine.cpus > 1 ? "" : recording),
         "-rtc", "clock=vm,base=2026-01-01T00:00:00", "-seed", "1"});
  else
    add({"-accel", accelerator == Accelerator::kvm ? "kvm" : "tcg"});
  if (machine.deterministic && machine.cpus > 1)
    add({"-netdev", "hubport,hubid=1,id=turns", "-object",
         fmt::format("filter-buffer,id=turn,netdev=turns,interval={}", turn_us * machine.cpus)});
  if (accelerator == Accelerator::kvm) add({"-cpu", "host"});
  add({"-kernel", kernel.string(), "-initrd", files.image.string(), "-append",
       kernel_words(machine, accelerator, version)});
  // Slots are apart, for igb's virtual functions; without ROM, the firmware skips the NICs.
  for (int end = 0; end < 2; ++end)
    add({"-netdev", fmt::format("hubport,hubid=0,id=n{}", end), "-device",
         fmt::format("{},netdev=n{},mac=52:54:00:00:00:0{},addr={},romfile=", device_of(machine.nic), end,
                     end + 1, 4 + 4 * end)});
  if (at_terminal) {
    add({"-serial", "mon:stdio"});
  } else {
    for (const auto& line : {files.console, files.words}) add({"-serial", "file:" + escaped(line)});
    // No disk: the firmware would read it, for a time that varies. ioeventfd=off: writes are handled at once,
    // not when another thread runs.
    add({"-chardev", "file,id=results,path=" + escaped(files.results), "-device",
         "virtio-serial-pci,addr=c,ioeventfd=off", "-device", "virtserialport,chardev=results"});
  }
  return words;
}

}  // namespace ontime::lab
