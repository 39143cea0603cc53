// SPDX-License-Identifier: Apache-2.0
// Driver settings by ethtool's system call.
#include <algorithm>
#include <cerrno>
#include <set>
#include <sstream>

#include <fmt/format.h>
#include <linux/ethtool.h>
#include <linux/sockios.h>
#include <net/if.h>
#include <sys/ioctl.h>
#include <sys/socket.h>

#include "number.hpp"
#include "process/process.hpp"
#include "settings/file.hpp"
#include "settings/kinds.hpp"

namespace ontime::settings {
namespace {

using journal::Value;

// 0 or an errno.
int call(const std::string& interface, void* command) {
  ifreq request{};
  interface.copy(static_cast<char*>(request.ifr_name), IFNAMSIZ - 1);
  request.ifr_data = static_cast<char*>(command);
  const process::Fd any(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  return any.get() >= 0 && ioctl(any.get(), SIOCETHTOOL, &request) == 0 ? 0 : errno;
}

// Whether the interface is there and has the like; throws for all other errors.
bool answered(const std::string& interface, const char* what, int error) {
  if (error == ENODEV || error == EOPNOTSUPP) return false;
  if (error != 0) throw trouble(fmt::format("{} of {}", what, interface), error);
  return true;
}

Value read_gro(const std::string& interface) {
  ethtool_value command{.cmd = ETHTOOL_GGRO, .data = 0};
  if (!answered(interface, "generic receive offload", call(interface, &command))) return {};
  return command.data != 0 ? "on" : "off";
}

void write_gro(const std::string& interface, const Value& value) {
  ethtool_value command{.cmd = ETHTOOL_SGRO, .data = value == "on" ? 1U : 0U};
  if (const int error = call(interface, &command); error != 0)
    throw trouble(fmt::format("generic receive offload of {}", interface), error);
}

struct Field {
  const char* name;
  std::uint32_t ethtool_coalesce::*value;
  bool is_switch;
};
constexpr Field fields[] = {{"rx-usecs", &ethtool_coalesce::rx_coalesce_usecs, false},
                            {"rx-frames", &ethtool_coalesce::rx_max_coalesced_frames, false},
                            {"tx-usecs", &ethtool_coalesce::tx_coalesce_usecs, false},
                            {"tx-frames", &ethtool_coalesce::tx_max_coalesced_frames, false},
                            {"adaptive-rx", &ethtool_coalesce::use_adaptive_rx_coalesce, true},
                            {"adaptive-tx", &ethtool_coalesce::use_adaptive_tx_coalesce, true}};

std::string text_of(const ethtool_coalesce& state) {
  std::string text;
  for (const auto& [name, value, is_switch] : fields)
    text += fmt::format("{}{}={}", text.empty() ? "" : ",", name,
                        is_switch ? (state.*value != 0 ? "on" : "off") : std::to_string(state.*value));
  return text;
}

void set(ethtool_coalesce& state, const std::string& text) {
  std::istringstream parts(text + ',');  // so that nothing behind the last comma is a part, too
  std::set<std::string> names;
  for (std::string part; std::getline(parts, part, ',');) {
    const auto equals = std::min(part.find('='), part.size());
    const auto name = part.substr(0, equals), said = part.substr(std::min(part.size(), equals + 1));
    const auto* const field = std::ranges::find(fields, name, &Field::name);
    if (field == std::end(fields))
      throw std::invalid_argument(fmt::format(
          "'{}' is not one of rx-usecs=N, rx-frames=N, tx-usecs=N, tx-frames=N, adaptive-rx=on|off, "
          "adaptive-tx=on|off",
          part));
    if (!names.insert(name).second)
      throw std::invalid_argument(fmt::format("'{}' names {} twice", text, name));
    const auto number = number_in<std::uint32_t>(said);
    const bool good = field->is_switch ? said == "on" || said == "off" : number.has_value();
    if (!good)
      throw std::invalid_argument(
          fmt::format("'{}' is not {}", part, field->is_switch ? "on or off" : "a whole number"));
    state.*field->value = number.value_or(said == "on" ? 1 : 0);
  }
}

std::optional<ethtool_coalesce> coalescing_of(const std::string& interface) {
  ethtool_coalesce state{};
  state.cmd = ETHTOOL_GCOALESCE;
  if (!answered(interface, "interrupt coalescing", call(interface, &state))) return {};
  return state;
}

Value read_coalescing(const std::string& interface) {
  const auto state = coalescing_of(interface);
  return state ? Value(text_of(*state)) : Value();
}

void write_coalescing(const std::string& interface, const Value& value) {
  auto state = coalescing_of(interface);
  if (!state) throw trouble(fmt::format("interrupt coalescing of {}", interface), EOPNOTSUPP);
  try {
    set(*state, value.value_or(""));
  } catch (const std::invalid_argument& error) {
    throw journal::Error(error.what());
  }
  state->cmd = ETHTOOL_SCOALESCE;
  if (const int error = call(interface, &*state); error != 0)
    throw trouble(fmt::format("interrupt coalescing {} of {}", *value, interface), error);
}

}  // namespace

const journal::Kind coalescing =
    kind_of_interface<read_coalescing, write_coalescing>("coalescing", is_interface);
const journal::Kind gro = kind_of_interface<read_gro, write_gro>("generic receive offload", is_interface);

std::string with_coalescing(const std::string& value, const std::string& asked) {
  ethtool_coalesce state{};
  if (!value.empty()) set(state, value);
  set(state, asked);
  return text_of(state);
}

}  // namespace ontime::settings
