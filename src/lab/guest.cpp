// SPDX-License-Identifier: Apache-2.0
#include "lab/guest.hpp"

#include <algorithm>
#include <array>
#include <fstream>
#include <sstream>
#include <string_view>

#include <fmt/format.h>

#include "table/table.hpp"

namespace ontime::lab {
namespace {

namespace fs = std::filesystem;

// Programs that the machine needs; programs that scenarios use, or a person in the shell.
constexpr std::array needed = {"ip", "kmod"};
constexpr std::array wanted = {"tc",   "nft",   "stress-ng", "iperf3", "ethtool", "sysctl", "chrt", "taskset",
                               "ps",   "bash",  "ls",        "cat",    "grep",    "sed",    "head", "tail",
                               "less", "top",   "kill",      "sleep",  "cut",     "sort",   "find", "awk",
                               "env",  "uname", "dmesg",     "nice",   "cp",      "mv",     "rm",   "mkdir",
                               "date", "perf",  "trace-cmd", "setpriv"};

// The kernel's modules below these paths are copied, with their dependencies.
constexpr std::array modules = {
    "kernel/net/core/",
    "kernel/net/sched/",
    "kernel/net/netfilter/",
    "kernel/net/ipv4/",
    "kernel/net/ipv6/",
    "kernel/net/8021q/",
    "kernel/crypto/crc32c_generic.ko",  // nf_tables needs it, and modules.dep does not say so
    "kernel/drivers/net/veth.ko",
    "kernel/drivers/net/ifb.ko",
    "kernel/drivers/net/dummy.ko",
    "kernel/drivers/net/virtio_net.ko",
    "kernel/drivers/net/ethernet/intel/e1000e/",
    "kernel/drivers/net/ethernet/intel/igb/",
    "kernel/drivers/virtio/virtio_pci.ko",
    "kernel/drivers/char/virtio_console.ko"};

// Loads the drivers itself, because there is no udev. The kernel loads network modules on demand.
constexpr std::string_view start = R"sh(#!/bin/busybox sh
# SPDX-License-Identifier: Apache-2.0
export PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root TERM=linux
mount() {{ /bin/busybox mount -t "$1" "$1" "$2"; }}
fail() {{ echo "$1"; /bin/busybox usleep 500000; /bin/busybox poweroff -f; }}
/bin/busybox mkdir -p /proc /sys /dev /run /tmp /root {results}
mount proc /proc
mount sysfs /sys
mount devtmpfs /dev
/bin/busybox mkdir -p /dev/shm /dev/pts
mount devpts /dev/pts
for folder in /run /tmp /dev/shm; do mount tmpfs "$folder"; done
mount cgroup2 /sys/fs/cgroup
mount tracefs /sys/kernel/tracing
mount debugfs /sys/kernel/debug
/bin/busybox hostname ontime-lab
ip link set lo up
modprobe {driver}
for nic in {nics}; do
  left=1000
  until [ -e "/sys/class/net/$nic" ]; do
    [ $((left -= 1)) -gt 0 ] || fail "interface $nic is missing: this kernel has no driver for {card}. Fix: use another --nic or --kernel"
    /bin/busybox usleep 10000
  done
  {speed}
done
{then}
/bin/busybox sync
/bin/busybox poweroff -f
)sh";

// The results' device exists a moment before it can be opened. Closing the serial line waits until all is
// sent.
constexpr std::string_view then_run = R"sh(modprobe -a virtio_pci virtio_console
until [ -c {outlet} ] && (: >{outlet}) 2>/dev/null; do /bin/busybox usleep 10000; done
exec 3>/dev/ttyS1
echo '{up}' >&3
cd {results}
{command} </dev/null >/dev/null 2>&3 3>&-
echo "{ended}$? $(/bin/busybox cut -d ' ' -f 1 /proc/uptime)" >&3
exec 3>&-)sh";

constexpr std::string_view then_shell = R"sh(cd /root
/bin/busybox setsid /bin/busybox cttyhack {shell})sh";

const char* driver_of(const std::string& nic) {
  return nic == "virtio" ? "-a virtio_pci virtio_net" : nic.c_str();
}

std::string speed_of(const Machine& machine) {
  if (machine.nic_mbit_per_s == 0) return ":";
  if (program("ethtool").empty())
    throw Error("the lab needs ethtool to set the speed of its NICs. Fix: sudo apt install ethtool");
  return fmt::format(
      "ethtool -s \"$nic\" speed {0} duplex full autoneg off || fail \"$nic cannot have the speed of the "
      "scenario's wire, {0} Mbit/s. Fix: use another --nic\"",
      machine.nic_mbit_per_s);
}

void add_programs(Image& image) {
  const auto busybox = program("busybox");
  if (busybox.empty()) throw Error("the lab needs busybox. Fix: sudo apt install busybox-static");
  image.add(busybox, "/usr/bin/busybox");
  for (const auto* name : needed)
    if (const auto file = program(name); !file.empty())
      image.add_program(file);
    else
      throw Error(fmt::format("the lab needs {}. Fix: sudo apt install {}", name,
                              std::string_view(name) == "ip" ? "iproute2" : name));
  for (const auto* name : wanted)
    if (const auto file = program(name); !file.empty()) image.add_program(file);
  image.add_link("/usr/sbin/modprobe", program("kmod"));
}

void add_ontime(Image& image) {
  const auto self = fs::read_symlink("/proc/self/exe");
  image.add_program(self, "/usr/bin/ontime");
  const auto transports = fs::path(ONTIME_LIBDIR) / "ontime";
  std::error_code none;
  for (const auto& entry : fs::directory_iterator(self.parent_path().parent_path() / transports, none))
    if (entry.path().extension() == ".so")
      image.add_program(entry.path(), fs::path("/usr") / transports / entry.path().filename());
}

void add_modules(Image& image, const Kernel& kernel) {
  const auto there = fs::path("/usr/lib/modules") / kernel.release;
  const auto add = [&](const std::string& name) { image.add(kernel.modules / name, there / name); };
  std::ifstream dependencies(kernel.modules / "modules.dep");  // "MODULE: all its dependencies"
  for (std::string line; std::getline(dependencies, line);) {
    const auto colon = line.find(':');
    const auto is_there = [&](std::string_view place) { return line.starts_with(place); };
    if (colon == line.npos || std::ranges::none_of(modules, is_there)) continue;
    add(line.substr(0, colon));
    std::istringstream others(line.substr(colon + 1));
    for (std::string other; others >> other;) add(other);
  }
  for (const auto& entry : fs::directory_iterator(kernel.modules))
    if (entry.is_regular_file()) add(entry.path().filename());
}

}  // namespace

Image image_of(const Machine& machine, const Kernel& kernel, const std::vector<std::string>& command,
               const std::vector<File>& files) {
  Image image;
  // Links as on this machine, such as /bin to /usr/bin.
  for (const auto* name : {"bin", "sbin", "lib", "lib64"}) {
    image.add_folder(fs::path("/usr") / name);
    image.add_link(fs::path("/") / name, fs::path("usr") / name);
  }
  add_programs(image);
  add_ontime(image);
  add_modules(image, kernel);
  image.add_text("/etc/passwd", "root:x:0:0:root:/root:/bin/sh\n");
  image.add_text("/etc/group", "root:x:0:\n");
  image.add_text("/etc/hosts", "127.0.0.1 localhost\n::1 localhost\n");
  for (const auto& path : machine.with) image.add_tree(path);
  for (const auto& file : files) image.add(file.here, file.there);

  const auto then = command.empty()
                        ? fmt::format(fmt::runtime(then_shell),
                                      fmt::arg("shell", program("bash").empty() ? "/bin/busybox sh" : "bash"))
                        : fmt::format(fmt::runtime(then_run), fmt::arg("up", up), fmt::arg("ended", ended),
                                      fmt::arg("outlet", outlet), fmt::arg("results", results_folder),
                                      fmt::arg("command", table::shell_line(command)));
  image.add_text("/init",
                 fmt::format(fmt::runtime(start), fmt::arg("results", results_folder),
                             fmt::arg("card", machine.nic), fmt::arg("driver", driver_of(machine.nic)),
                             fmt::arg("nics", fmt::format("{} {}", controller_nic, component_nic)),
                             fmt::arg("speed", speed_of(machine)), fmt::arg("then", then)),
                 true);
  return image;
}

}  // namespace ontime::lab
