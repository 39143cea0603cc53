// SPDX-License-Identifier: Apache-2.0
#include "lab/lab.hpp"

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <thread>

#include <gmock/gmock.h>
#include <sys/personality.h>
#include <unistd.h>

#include "background/background.hpp"
#include "background/child.hpp"
#include "lab/console.hpp"
#include "lab/guest.hpp"
#include "lab/image.hpp"
#include "lab/kernel.hpp"
#include "lab/qemu.hpp"
#include "lab/results.hpp"
#include "machine/machine.hpp"

namespace ontime::lab {
namespace {

namespace fs = std::filesystem;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::IsSupersetOf;
using ::testing::Not;

class Lab : public ::testing::Test {
 protected:
  void SetUp() override { ASSERT_NE(mkdtemp(pattern_.data()), nullptr); }
  void TearDown() override { fs::remove_all(folder()); }
  fs::path folder() const { return pattern_; }
  fs::path write(const std::string& name, const std::string& text) const {
    std::ofstream(folder() / name) << text;
    return folder() / name;
  }
  static std::string read(const fs::path& file) {
    std::ostringstream text;
    text << std::ifstream(file, std::ios::binary).rdbuf();
    return text.str();
  }
  std::vector<std::string> command(const Machine& machine,
                                   Accelerator accelerator = Accelerator::emulation) const {
    return qemu_command(machine, accelerator, "7.2.22", "/boot/vmlinuz", Files(folder()), false);
  }

 private:
  std::string pattern_ = (fs::temp_directory_path() / "ontime-lab-test-XXXXXX").string();
};

std::string list_of(const fs::path& archive) {
  return background::output_of({"python3", "-c", R"py(
import sys
data, at = open(sys.argv[1], "rb").read(), 0
while True:
    fields = [int(data[at + 6 + 8 * i:at + 14 + 8 * i], 16) for i in range(13)]
    name = data[at + 110:at + 110 + fields[11] - 1].decode()
    if name == "TRAILER!!!": break
    at = (at + 110 + fields[11] + 3) // 4 * 4
    content = data[at:at + fields[6]]
    at = (at + fields[6] + 3) // 4 * 4
    print(oct(fields[1]), name, fields[5], content if len(content) < 40 else len(content))
)py",
                                archive.string()},
                               "python3");
}

TEST_F(Lab, ImageHasFoldersBeforeTheirFilesAndNoDates) {
  Image image;
  image.add_text("/init", "#!/bin/sh\n", true);
  image.add(write("scenario.yaml", "runs: []\n"), "/scenarios/1/scenario.yaml");
  image.add_link("/lib", "usr/lib");
  image.write(folder() / "image");
  EXPECT_EQ(list_of(folder() / "image"),
            "0o100755 init 0 b'#!/bin/sh\\n'\n0o120777 lib 0 b'usr/lib'\n0o40755 scenarios 0 b''\n"
            "0o40755 scenarios/1 0 b''\n0o100644 scenarios/1/scenario.yaml 0 b'runs: []\\n'\n");
}

TEST_F(Lab, ProgramInAnImageHasItsLibraries) {
  Image image;
  image.add_program(fs::read_symlink("/proc/self/exe"), "/usr/bin/this");
  image.write(folder() / "image");
  const auto list = list_of(folder() / "image");
  EXPECT_THAT(list, HasSubstr("0o100755 usr/bin/this 0"));
  EXPECT_THAT(list, HasSubstr("libstdc++.so.6"));
#ifdef __x86_64__
  EXPECT_THAT(list, HasSubstr("usr/lib64/ld-linux-x86-64.so.2"));
#elif defined(__aarch64__)
  EXPECT_THAT(list, HasSubstr("usr/lib/ld-linux-aarch64.so.1"));
#endif
}

TEST_F(Lab, ImageOfATreeKeepsItsLinks) {
  fs::create_directory(folder() / "mine");
  write("mine/profile.xml", "<a/>");
  fs::create_symlink("profile.xml", folder() / "mine/default.xml");
  Image image;
  image.add_tree(folder() / "mine");
  image.write(folder() / "image");
  const auto list = list_of(folder() / "image");
  EXPECT_THAT(list, HasSubstr("mine/profile.xml 0 b'<a/>'"));
  EXPECT_THAT(list, HasSubstr("mine/default.xml 0 b'profile.xml'"));
}

TEST_F(Lab, MissingFileIsRefusedByImage) {
  Image image;
  EXPECT_THROW(image.add(folder() / "none", "/none"), Error);
}

TEST_F(Lab, LiveMachineUsesKvmAndItsNameStatesIt) {
  Machine machine;
  machine.deterministic = false;
  EXPECT_THAT(command(machine), testing::AllOf(Contains("tcg"), testing::Not(Contains("kvm"))));
  const auto by_kvm = command(machine, Accelerator::kvm);
  EXPECT_THAT(by_kvm, testing::AllOf(Contains("kvm"), testing::Not(Contains("tcg")),
                                     Contains(HasSubstr("KVM, live time"))));
}

TEST_F(Lab, DeterministicMachineCountsInstructionsAsTime) {
  Machine machine;
  EXPECT_THAT(command(machine), IsSupersetOf({"shift=1,sleep=off,rr=record,rrfile=/dev/null",
                                              "clock=vm,base=2026-01-01T00:00:00", "1"}));
  EXPECT_THAT(command(machine), Contains(HasSubstr("nokaslr tsc=reliable")));
  machine.deterministic = false;
  EXPECT_THAT(command(machine), Not(Contains("-icount")));
  EXPECT_THAT(command(machine), Not(Contains(HasSubstr("nokaslr"))));
}

TEST_F(Lab, SeveralDeterministicCpusTakeShortTurns) {
  Machine machine;
  EXPECT_THAT(command(machine), Not(Contains(HasSubstr("filter-buffer"))));
  machine.cpus = 2;
  EXPECT_THAT(command(machine), IsSupersetOf({"-smp", "2", "shift=1,sleep=off",
                                              "filter-buffer,id=turn,netdev=turns,interval=20"}));
  machine.deterministic = false;
  EXPECT_THAT(command(machine), Not(Contains(HasSubstr("filter-buffer"))));
}

TEST_F(Lab, KernelCommandLineStatesTheSimulation) {
  Machine machine;
  machine.nic = "virtio";
  const auto words = command(machine);
  const auto append = std::find(words.begin(), words.end(), "-append") + 1;
  EXPECT_EQ(machine::simulated(*append), "QEMU 7.2.22, virtio, time from counted instructions, 2 ns each");
  EXPECT_THAT(words, Contains(HasSubstr("virtio-net-pci,netdev=n1,mac=")));
}

TEST_F(Lab, SpeedOfTheWireIsSetOnTheNics) {
  for (const auto* name : {"busybox", "kmod", "ip", "ethtool"})
    if (program(name).empty()) GTEST_SKIP() << "there is no " << name;
  const Kernel kernel{"6.1.0", "linux-image", "/boot/vmlinuz", folder() / "modules"};
  fs::create_directory(kernel.modules);
  write("modules/modules.dep", "");
  Machine machine;
  machine.nic_mbit_per_s = 10;
  image_of(machine, kernel, {"true"}, {}).write(folder() / "image");
  const auto image = read(folder() / "image");  // its programs contain these words, too
  const auto begin = image.find("#!/bin/busybox sh"), end = image.find("\ndone\n", begin);
  ASSERT_NE(end, image.npos);
  EXPECT_THAT(image.substr(begin, end - begin),
              testing::AllOf(
                  HasSubstr("  ethtool -s \"$nic\" speed 10 duplex full autoneg off || fail \"$nic cannot"),
                  HasSubstr("10 Mbit/s")));
}

TEST_F(Lab, ImageOnAFullDiskIsAnErrorThatNamesTmpdir) {
  Image image;
  image.add_text("/init", std::string(1 << 20, 'x'));
  try {
    image.write("/dev/full");
    FAIL() << "it was written";
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), testing::AllOf(HasSubstr("No space left on device"), HasSubstr("TMPDIR")));
  }
}

TEST_F(Lab, KernelThatAptLacksIsTakenFromTheCache) {
  fs::create_directories(folder() / "ontime/kernels/linux-image-1-rt_1_amd64/lib/modules/1-rt");
  fs::create_directory(folder() / "ontime/kernels/linux-image-1-rt_1_amd64/boot");
  write("ontime/kernels/linux-image-1-rt_1_amd64/boot/vmlinuz-1-rt", "");
  fs::permissions(folder() / "ontime/kernels", fs::perms::owner_all);
  write("apt-cache", "#!/bin/sh\necho 'N: a word' >&2\necho 'E: No packages found' >&2\nexit 100\n");
  fs::permissions(folder() / "apt-cache", fs::perms::owner_all);
  const std::string before = std::getenv("PATH");
  setenv("PATH", (folder().string() + ":" + before).c_str(), 1);
  setenv("XDG_CACHE_HOME", folder().c_str(), 1);
  std::string told, said;
  Kernel kernel;
  try {
    kernel = fetch_kernel("linux-image-1-rt", [&](const std::string& text) { told = text; });
    fetch_kernel("linux-image-rt-amd64", [](const std::string&) {});
  } catch (const Error& error) {
    said = error.what();
  }
  unsetenv("XDG_CACHE_HOME");
  setenv("PATH", before.c_str(), 1);
  EXPECT_EQ(kernel.release, "1-rt");
  EXPECT_THAT(told, HasSubstr("linux-image-1-rt_1_amd64"));
  EXPECT_THAT(said, testing::AllOf(HasSubstr("linux-image-rt-amd64"), HasSubstr(": No packages found."),
                                   HasSubstr("--kernel linux-image-1-rt")));
}

TEST_F(Lab, UnreadableFolderInPathIsSkipped) {
  const std::string before = std::getenv("PATH");
  setenv("PATH", ("/" + std::string(5000, 'x') + ":" + before).c_str(), 1);
  const auto found = program("sh");
  setenv("PATH", before.c_str(), 1);
  EXPECT_EQ(found.filename(), "sh");
}

// PER_LINUX32: an x86_64 kernel reports i686 to this process.
TEST_F(Lab, OtherArchitectureIsRefused) {
  const auto before = static_cast<unsigned long>(personality(PER_LINUX32));
  std::string said;
  try {
    check_qemu({});
  } catch (const Error& error) {
    said = error.what();
  }
  personality(before);
  EXPECT_THAT(said, HasSubstr("needs an x86_64"));
}

TEST_F(Lab, MissingQemuNamesThePackage) {
#ifndef __x86_64__
  GTEST_SKIP() << "a lab needs an x86_64";
#endif
  const std::string before = std::getenv("PATH");
  setenv("PATH", folder().c_str(), 1);
  std::string said;
  try {
    check_qemu({});
  } catch (const Error& error) {
    said = error.what();
  }
  setenv("PATH", before.c_str(), 1);
  EXPECT_THAT(said, HasSubstr("sudo apt install qemu-system-x86"));
}

TEST_F(Lab, QemuWithoutTheNicNamesThePackageThatHasIt) {
#ifndef __x86_64__
  GTEST_SKIP() << "a lab needs an x86_64";
#endif
  const std::string before = std::getenv("PATH");
  write("qemu-system-x86_64",
        "#!/bin/sh\n[ \"$1\" = --version ] && echo 'QEMU emulator version 7.2.22 (Debian)'\nexit 0\n");
  fs::permissions(folder() / "qemu-system-x86_64", fs::perms::owner_all);
  setenv("PATH", (folder().string() + ":" + before).c_str(), 1);
  std::string said;
  try {
    Machine machine;
    machine.nic = "igb";
    check_qemu(machine);
  } catch (const Error& error) {
    said = error.what();
  }
  setenv("PATH", before.c_str(), 1);
  EXPECT_THAT(said, HasSubstr("no igb: QEMU emulator version 7.2.22 (Debian)"));
  EXPECT_THAT(said, HasSubstr("bookworm-backports"));
}

TEST_F(Lab, ConsoleGivesWholeLines) {
  std::ofstream line(folder() / "console");
  Console console(folder() / "console");
  line << "one\r\ntw" << std::flush;
  EXPECT_THAT(console.lines(), ElementsAre("one"));
  EXPECT_THAT(console.lines(), IsEmpty());
  line << "o\r\nthree" << std::flush;
  EXPECT_THAT(console.lines(), ElementsAre("two"));
  EXPECT_EQ(console.tail(), "one\ntwo\nthree");
  EXPECT_THAT(console.lines(true), ElementsAre("three"));
}

TEST_F(Lab, ConsoleReplacesARewrittenLine) {
  std::ofstream line(folder() / "console");
  Console console(folder() / "console");
  line << "1/9 s\r\033[K2/9 s" << std::flush;
  EXPECT_THAT(console.lines(), IsEmpty());
  EXPECT_EQ(console.present(), "2/9 s");
  line << "\r\033[Kdone\r\n" << std::flush;
  EXPECT_THAT(console.lines(), ElementsAre("done"));
  EXPECT_EQ(console.present(), "");
}

TEST_F(Lab, SentFilesArriveInTheirOrder) {
  const auto out = folder() / "out", into = folder() / "into";
  Arrivals arrivals(out);
  EXPECT_FALSE(arrivals.next(into)) << "nothing was sent yet";
  const auto large = std::string(200'000, 'x');
  send(write("one", large), out);
  send(write("two", ""), out);
  send(write("three", "3"), out);
  for (const auto& text : {large, std::string(), std::string("3")}) {
    EXPECT_TRUE(arrivals.next(into));
    EXPECT_EQ(read(into), text);
  }
  EXPECT_FALSE(arrivals.next(into));
}

TEST_F(Lab, PartOfASentFileIsNotYetAnArrival) {
  const auto whole = folder() / "whole", out = folder() / "out", into = folder() / "into";
  send(write("one", "all of it"), whole);
  const auto bytes = read(whole);
  Arrivals arrivals(out);
  for (std::size_t length = 0; length < bytes.size(); ++length) {
    write("out", bytes.substr(0, length));
    EXPECT_FALSE(arrivals.next(into)) << length;
  }
  write("out", bytes);
  EXPECT_TRUE(arrivals.next(into));
  EXPECT_EQ(read(into), "all of it");
}

TEST_F(Lab, ImpossibleLengthOfASentFileIsNotAnArrival) {
  Arrivals arrivals(write("out", std::string(16, '\xff')));
  EXPECT_FALSE(arrivals.next(folder() / "into"));
}

TEST_F(Lab, FileThatCannotBeSentIsAnError) {
  EXPECT_THROW(send(write("one", "1"), folder() / "none/out"), Error);
}

}  // namespace
}  // namespace ontime::lab
