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

fs::path folder_of(const std::string& interface, const std::string& root = "") {
  if (root.empty()) return folder_of_interface(interface);
  return fmt::format("{}/sys/class/net/{}", root, interface);
}

bool is_hardware(const fs::path& folder) {
  std::error_code none;
  return fs::exists(folder / "device", none);
}

// The interfaces that receive the packets of a bond, a VLAN or a bridge.
std::vector<std::string> interfaces_below(const fs::path& folder) {
  constexpr std::string_view lower = "lower_";
  std::vector<std::string> found;
  for (const auto& name : names_in(folder))
    if (name.starts_with(lower)) found.push_back(name.substr(lower.size()));
  return found;
}

// Interrupts of the device, or (for a card on a bus such as virtio or USB) of its parent.
void add_of_device(const fs::path& folder, const std::string& root, std::set<int>& numbers) {
  std::error_code none;
  const auto all_devices = fs::canonical(root + "/sys/devices", none);
  for (auto device = fs::canonical(folder / "device", none);
       device.has_relative_path() && device != all_devices; device = device.parent_path()) {
    for (const auto& number : names_in(device / "msi_irqs")) numbers.insert(std::stoi(number));
    const auto wired = read_file(device / "irq");
    if (numbers.empty() && wired && interrupt.accepts(*wired) && *wired != "0")
      numbers.insert(std::stoi(*wired));
    if (!numbers.empty()) return;
  }
}

bool is_of(const std::string& interrupt, const std::string& owner) {
  return !owner.empty() && (interrupt == owner || interrupt.starts_with(owner + '-'));
}

// A board's built-in card is found only by the name that the driver gave the interrupts: "eth0",
// "eth0-rx-0", or the device's "30be0000.ethernet".
void add_by_name(const fs::path& folder, const std::string& root, std::set<int>& numbers) {
  std::error_code none;
  const auto interface = folder.filename().string();
  const auto device = fs::canonical(folder / "device", none).filename().string();
  std::ifstream file(root + "/proc/interrupts");
  for (std::string line; std::getline(file, line);) {
    const auto colon = line.find(':'), blank = line.rfind(' ');
    if (colon == line.npos || blank == line.npos || blank < colon) continue;
    std::istringstream head(line.substr(0, colon));
    const auto name = line.substr(blank + 1);
    if (int number = 0; head >> number && (is_of(name, interface) || is_of(name, device)))
      numbers.insert(number);
  }
}

}  // namespace

std::vector<int> listed_interrupts(const std::string& interface, const std::string& root) {
  const auto folder = folder_of(interface, root);
  std::set<int> numbers;
  for (const auto& below : interfaces_below(folder))
    for (const int number : listed_interrupts(below, root)) numbers.insert(number);
  // The kernel's list is the whole machine's: a veth may be called as another's card is.
  if (numbers.empty() && is_hardware(folder)) {
    add_of_device(folder, root, numbers);
    if (numbers.empty()) add_by_name(folder, root, numbers);
  }
  return {numbers.begin(), numbers.end()};
}

bool hides_interrupts(const std::string& interface) {
  const auto folder = folder_of(interface);
  const auto is_upon_another = [&] {  // a veth is of no such type
    return read_file(folder / "uevent").value_or("").find("DEVTYPE=") != std::string::npos;
  };
  const auto below = interfaces_below(folder);
  if (!below.empty()) return std::ranges::any_of(below, hides_interrupts);
  return is_hardware(folder) ? interrupts_of(interface).empty() : is_upon_another();
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
