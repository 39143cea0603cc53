// SPDX-License-Identifier: Apache-2.0
#include "run_flags.hpp"

#include <algorithm>
#include <iterator>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "flags.hpp"
#include "process/process.hpp"
#include "settings/settings.hpp"
#include "table/table.hpp"
#include "transport/shipped.hpp"
#include "transport/transport.hpp"

namespace ontime::app {

using campaign::Key;

namespace {

std::string transports_here() {
  const auto names = transport::available();
  return names.empty() ? "no transport is installed" : fmt::format("installed: {}", fmt::join(names, ", "));
}

// The command as it was given, with the transport that needs least, and to a component of its own if it names
// no other; "" without any transport.
std::string with_a_transport() {
  const auto here = transport::available();
  if (here.empty()) return "";
  const auto* shipped =
      std::ranges::find_first_of(transport::all_shipped, here, {}, &transport::Shipped::name);
  const bool is_shipped = shipped != std::end(transport::all_shipped);
  auto words = process::command_line();
  words.insert(words.end(), {"--transport", is_shipped ? std::string(shipped->name) : here.front()});
  const auto states = [&](std::string_view flag) {
    return std::ranges::any_of(words, [&](const auto& word) { return word.starts_with(flag); });
  };
  if (words[1] == "ping" && !states("--peer") && !states("--interface") && !states("--loopback"))
    words.emplace_back("--loopback");
  const auto line = table::line_to_paste(words);
  return line ? ". Fix: " + *line : "";
}

// pong answers every payload up to this one; its default is campaign::pong's.
constexpr const char* pong_payload = "largest payload, without the 8-byte sequence number (default: 60 kB)";

// "time from one cycle to the next (default: 10 ms)"
std::string help_of(const Key& key, Key::For end) {
  if (end == Key::For::both && key.path == "payload") return pong_payload;
  if (key.path == "transport") return key.help + "; " + transports_here();
  return key.by_default.empty() ? key.help : fmt::format("{} (default: {})", key.help, key.by_default);
}

}  // namespace

RunFlags::RunFlags(Command& app, Key::For end) {
  for (const auto& key : campaign::keys()) {
    if (key.flag.empty() || (end == Key::For::both && key.end == Key::For::client)) continue;
    auto& flag = flags_[key.path];
    auto* option = flag.option = app.add_option(key.flag, flag.value, help_of(key, end),
                                                key.path == "transport" ? "TRANSPORT" : key.values);
    if (key.values == "on|off") option->without_value();  // it is on then
    if (key.path.starts_with("realtime.")) option->group("Real-time settings (each implies --realtime on)");
  }
  add_value(app, "--interface", interface_, "NAME", "the link under test; messages use no other");
  app.add_option("--peer", peers_,
                 "address of the peer: for a transport without discovery, or besides the discovery of a DDS",
                 "HOST[:PORT]");
  app.add_option("--option", options_, "option of the transport; an unknown NAME lists all", "NAME=VALUE");
}

campaign::Run RunFlags::run() const {
  campaign::Run run;
  run.id = "ping";
  for (const auto& key : campaign::keys()) {
    const auto flag = flags_.find(key.path);
    if (flag == flags_.end() || flag->second.option->count() == 0) continue;
    const auto& value = flag->second.value;
    const bool alone = value.empty() && key.values == "on|off";
    if (value.empty() && !alone) throw wrong("{}: a value is needed", key.flag);
    read_flag(key.flag, [&] { key.set(run, alone ? "on" : value); });
    if (const auto missing = key.path.ends_with(".cpus") ? settings::missing_cpu(value) : "";
        !missing.empty())  // for programs of this machine
      throw wrong("{}: {}", key.flag, missing);
  }
  if (std::ranges::any_of(peers_, [](const auto& peer) { return peer.empty(); }))
    throw wrong("--peer: a value is needed");
  for (const auto& peer : peers_) read_flag("--peer", [&] { campaign::check_address(peer); });
  for (const auto& option : options_) {
    const auto equals = option.find('=');
    if (equals == std::string::npos || equals == 0) throw wrong("--option: '{}' is not NAME=VALUE", option);
    campaign::set_option(run, "options." + option.substr(0, equals), option.substr(equals + 1));
  }
  run.task.config.peers = peers_;
  run.task.config.interface = interface_;
  if (run.task.transport.empty())
    throw wrong("--transport NAME is missing; {}{}", transports_here(), with_a_transport());
  try {
    campaign::complete(run);
    campaign::check_transports(run);
  } catch (const std::invalid_argument& error) {
    throw wrong("{}", error.what());
  }
  return run;
}

}  // namespace ontime::app
