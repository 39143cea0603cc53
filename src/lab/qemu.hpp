// SPDX-License-Identifier: Apache-2.0
// QEMU's command line for the machine.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "lab/lab.hpp"

namespace ontime::lab {

// The machine's files, in its temporary folder.
struct Files {
  explicit Files(const std::filesystem::path& folder)
      : image(folder / "image"),
        results(folder / "results"),
        arrived(folder / "arrived.ontime"),
        console(folder / "console"),
        words(folder / "words") {}
  std::filesystem::path image;
  std::filesystem::path results, arrived;  // all sent files; the one that is being read
  std::filesystem::path console, words;
};

// Returns QEMU's version. Throws Error if QEMU or the NIC is missing, or if this machine is not an x86_64.
std::string check_qemu(const Machine&);

// What executes the machine's instructions. That /dev/kvm opens does not prove that a machine boots under
// KVM.
enum class Accelerator { emulation, kvm };
bool may_use_kvm();

// QEMU's command. `at_terminal`: the console is the terminal, and results are not sent.
std::vector<std::string> qemu_command(const Machine&, Accelerator, const std::string& version,
                                      const std::filesystem::path& kernel, const Files&, bool at_terminal);

}  // namespace ontime::lab
