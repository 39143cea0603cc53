// SPDX-License-Identifier: Apache-2.0
// The interrupts of a network interface.
#include <filesystem>
#include <fstream>
#include <set>
#include <sstream>

#include <fmt/format.h>

#include "settings/file.hpp"
#include "settings/kinds.hpp"

namespace ontime::settings {
namespace {

namespace fs = std::filesystem;

// Of the device, or (of a card on a bus, such as virtio or USB) of the one that it hangs on.
void add_of_device(const std::string& interface, const std::string& root, std::set<int>& numbers) {
  std::error_code none;
  const auto all_devices = fs::canonical(root + "/sys/devices", none);
  for (auto device = fs::canonical(fmt::format("{}/sys/class/net/{}/device", root, interface), none);
       device.has_relative_path() && device != all_devices; device = device.parent_path()) {
    for (const auto& number : names_in(device / "msi_irqs")) numbers.insert(std::stoi(number));
    const auto wired = read_file(device / "irq");
    if (numbers.empty() && wired && interrupt.accepts(*wired) && *wired != "0")
      numbers.insert(std::stoi(*wired));
    if (!numbers.empty()) return;
  }
}

// Of a board's own card there is only the name that its driver gave them: "eth0", "eth0-rx-0".
void add_by_name(const std::string& interface, const std::string& root, std::set<int>& numbers) {
  std::ifstream file(root + "/proc/interrupts");
  for (std::string line; std::getline(file, line);) {
    const auto colon = line.find(':'), blank = line.rfind(' ');
    if (colon == line.npos || blank == line.npos || blank < colon) continue;
    std::istringstream head(line.substr(0, colon));
    const auto name = line.substr(blank + 1);
    if (int number = 0; head >> number && (name == interface || name.starts_with(interface + '-')))
      numbers.insert(number);
  }
}

}  // namespace

std::vector<int> listed_interrupts(const std::string& interface, const std::string& root) {
  // The kernel's list is the whole machine's: a veth may be called as another's card is.
  if (std::error_code none; !fs::exists(fmt::format("{}/sys/class/net/{}/device", root, interface), none))
    return {};
  std::set<int> numbers;
  add_of_device(interface, root, numbers);
  if (numbers.empty()) add_by_name(interface, root, numbers);
  return {numbers.begin(), numbers.end()};
}

std::vector<int> interrupts_of(const std::string& interface) {
  auto numbers = listed_interrupts(interface);
  std::erase_if(numbers, [](int number) { return !interrupt.read(interrupt_here(number)); });
  return numbers;
}

std::string interrupt_here(int number) {
  const auto said = [&](const char* file) {
    return read_file(fmt::format("/sys/kernel/irq/{}/{}", number, file)).value_or("");
  };
  return fmt::format("{}:{} {}", number, said("chip_name"), said("hwirq"));
}

}  // namespace ontime::settings
