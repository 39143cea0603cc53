// SPDX-License-Identifier: Apache-2.0
// A machine that is not there: Debian's PREEMPT_RT kernel in QEMU, with this ontime in it and two NICs on one
// emulated wire. It lives in memory, and nothing of it is left. Ordinary thread only.
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

// What this machine lacks for it, or how it failed, with what to do.
struct Error : std::runtime_error {
  using std::runtime_error::runtime_error;
};

struct Machine {
  std::string nic = "e1000e";  // one of nics()
  // The speed that they say they have, by which some disciplines reckon (taprio): 10, 100 or 1000 Mbit/s; 0:
  // whatever they say. What they are given goes at once all the same.
  int nic_mbit_per_s = 0;
  // Its time is the number of instructions that it carried out: whatever else this machine does, it goes the
  // same way again. Else this machine's time.
  bool deterministic = true;
  int cpus = 1;                                 // up to most_cpus
  std::string kernel = "linux-image-rt-amd64";  // Debian's package
  std::uint64_t memory_bytes = std::uint64_t{2} << 30U;
  std::vector<std::filesystem::path> with;  // files and folders that it has at the same place
};
std::span<const char* const> nics();
inline constexpr int most_cpus = 8;
// The two NICs, as Linux calls them there; down, and without addresses.
inline constexpr const char* controller_nic = "eth0";
inline constexpr const char* component_nic = "eth1";

// A file of this machine, and where it is to be there.
struct File {
  std::filesystem::path here, there;
};

// What is told while it goes on.
struct Observer {
  std::function<void(const std::string& text)> note;  // something a person should know
  std::function<void(const std::string& line)> says;  // what the command writes there
  // A results file that the command sent, which is gone after that.
  std::function<void(const std::filesystem::path& results)> sent;
  // Now and then: for how long already, and the line that the command is writing; nothing: it boots.
  std::function<void(std::chrono::seconds since, const std::optional<std::string>& line)> waits;
  std::function<bool()> interrupted;
};

struct Outcome {
  int code = 0;                    // the command's
  std::chrono::milliseconds time;  // since the machine was started: its own, and ours
  std::chrono::milliseconds real;
};

// The folder in which the command is carried out there.
inline constexpr const char* results_folder = "/results";
// Where the command sends results files (results.hpp), each as soon as it has it.
inline constexpr const char* outlet = "/dev/vport0p1";

// Starts the machine and has the command carried out. Throws Error, with the last lines of its console if it
// fails; Interrupted. All that had been sent by then is told before.
struct Interrupted {};
Outcome run(const Machine&, journal::Journal&, const std::vector<std::string>& command,
            const std::vector<File>&, const Observer&);

// The machine at this terminal, until it is switched off from within. Throws Error.
void shell(const Machine&, journal::Journal&, const Observer&);

}  // namespace ontime::lab
