// SPDX-License-Identifier: Apache-2.0
// A simulated machine: Debian's PREEMPT_RT kernel in QEMU, with this ontime and two NICs on one emulated
// wire. It runs in memory, and leaves no files. Ordinary thread only.
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include "journal/journal.hpp"

namespace ontime::lab {

// What is missing on this machine, or how the lab's machine failed, with the fix.
struct Error : std::runtime_error {
  using std::runtime_error::runtime_error;
};

struct Machine {
  std::string nic = "e1000e";  // one of nics()
  // The speed that the NICs report, which some disciplines need (taprio): 10, 100 or 1000 Mbit/s; 0: their
  // own. Frames still leave at once.
  int nic_mbit_per_s = 0;
  // Its time is the number of executed instructions, so that a run repeats exactly, whatever else this
  // machine does. Otherwise this machine's time.
  bool deterministic = true;
  int cpus = 1;                                 // up to most_cpus
  std::string kernel = "linux-image-rt-amd64";  // Debian's package
  std::uint64_t memory_bytes = std::uint64_t{2} << 30U;
  std::vector<std::filesystem::path> with;  // files and folders to copy to the same paths
};
std::span<const char* const> nics();
inline constexpr int most_cpus = 8;
// The names of the two NICs in the machine; they are down, without addresses.
inline constexpr const char* controller_nic = "eth0";
inline constexpr const char* component_nic = "eth1";

// A file of this machine, and its path in the lab's machine.
struct File {
  std::filesystem::path here, there;
};

// Called while the machine runs.
struct Observer {
  std::function<void(const std::string& text)> note;  // for people
  std::function<void(const std::string& line)> says;  // a line of the command
  // A results file that the command sent; deleted after the call.
  std::function<void(const std::filesystem::path& results)> sent;
  // Called repeatedly: the time since the start, and the command's current line; empty while it boots.
  std::function<void(std::chrono::seconds since, const std::optional<std::string>& line)> waits;
  std::function<bool()> interrupted;
};

struct Outcome {
  int code = 0;                    // the command's
  std::chrono::milliseconds time;  // time since the start: the lab machine's, and this machine's
  std::chrono::milliseconds real;
};

// The command's working folder in the machine.
inline constexpr const char* results_folder = "/results";
// Where the command sends its results files (results.hpp).
inline constexpr const char* outlet = "/dev/vport0p1";

// Starts the machine and runs the command. Throws Error, with the last lines of the console if the machine
// fails; or Interrupted. Before that, Observer::sent gets all files sent so far.
struct Interrupted {};
Outcome run(const Machine&, journal::Journal&, const std::vector<std::string>& command,
            const std::vector<File>&, const Observer&);

// A shell in the machine on this terminal, until the machine is powered off from inside. Throws Error.
void shell(const Machine&, journal::Journal&, const Observer&);

}  // namespace ontime::lab
