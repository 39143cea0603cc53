// SPDX-License-Identifier: Apache-2.0
// QEMU's side of the machine.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "lab/lab.hpp"

namespace ontime::lab {

// Where the machine's files are, in a folder that goes with it.
struct Files {
  explicit Files(const std::filesystem::path& folder)
      : image(folder / "image"),
        results(folder / "results"),
        arrived(folder / "arrived.ontime"),
        console(folder / "console"),
        words(folder / "words") {}
  std::filesystem::path image;
  std::filesystem::path results, arrived;  // all that was sent, and the one of them that is looked at
  std::filesystem::path console, words;
};

// The version of the QEMU that is here. Throws Error if there is none, if it has no such NIC, or if this
// machine is not one whose programs it could run.
std::string check_qemu(const Machine&);

// Who carries the machine's instructions out. That /dev/kvm opens does not say that a machine comes up under
// it.
enum class Accelerator { emulation, kvm };
bool may_use_kvm();

// Its command. `at_terminal`: the console is the terminal, and nothing takes results.
std::vector<std::string> qemu_command(const Machine&, Accelerator, const std::string& version,
                                      const std::filesystem::path& kernel, const Files&, bool at_terminal);

}  // namespace ontime::lab
