// SPDX-License-Identifier: Apache-2.0
// A scenario to start from, for hosts that are reached by ssh.
#include <array>
#include <cstdio>
#include <filesystem>
#include <sstream>

#include <fmt/format.h>
#include <sys/wait.h>

#include "campaign/campaign.hpp"
#include "campaign/ssh.hpp"
#include "command.hpp"
#include "commands.hpp"
#include "flags.hpp"
#include "machine/machine.hpp"
#include "output.hpp"
#include "table/table.hpp"
#include "terminal.hpp"

namespace ontime::app {
namespace {

using campaign::Error;

struct InitArguments {
  std::vector<std::string> hosts;
  std::string output;
};

// A host, with the interface of its ssh connection, and its IPv4 address there: messages use no other.
struct Place {
  std::string ssh;  // "": this machine
  std::string interface, address;
  std::string peer;  // the address at the other end of the ssh connection
  bool has_ontime = true;
};

bool is_ipv6(const std::string& address) { return address.find(':') != address.npos; }

[[noreturn]] void refuse_without_ipv4(const std::string& host, const std::string& address) {
  throw Error(3, fmt::format("{}: ssh uses the IPv6 address {}. Messages need an IPv4 address, and none of "
                             "its interface is known. Fix: ssh by IPv4 (AddressFamily inet in ~/.ssh/config)",
                             host, address));
}

// What ssh prints with these arguments, with its errors, and its exit code.
std::pair<std::string, int> said_by_ssh(const std::vector<std::string>& words) {
  const auto command = fmt::format("command -v ssh >/dev/null || exit {}; exec ssh {} 2>&1 </dev/null",
                                   campaign::no_ssh_here, table::shell_line(words));
  auto* const pipe = ::popen(command.c_str(), "re");
  if (pipe == nullptr) throw Error(3, "this machine cannot start another process: ssh");
  std::string said;
  std::array<char, 4096> part{};
  while (const auto bytes = std::fread(part.data(), 1, part.size(), pipe)) said.append(part.data(), bytes);
  const int status = ::pclose(pipe);
  return {said, WIFEXITED(status) ? WEXITSTATUS(status) : 1};
}

// Prints both addresses of the ssh connection, whether ontime is installed, the host's interface with the
// second address (of a local one without its %zone), and the first IPv4 address of that interface.
constexpr const char* question = R"sh(set -- $SSH_CONNECTION
echo ontime-init "$1" "$3" "$(command -v ontime >/dev/null && echo yes || echo no)" \
  "$(ip -o addr show 2>/dev/null | awk -v "a=${3%%%*}" '{split($4, b, "/")}
    b[1] == a && i == "" {i = $2}
    $3 == "inet" && !($2 in v) {v[$2] = b[1]}
    END {print i, v[i]}')")sh";

Place place_of(const std::string& host) {
  std::vector<std::string> words_here{"-T", "-o", "ConnectTimeout=5"};
  const auto& options = campaign::ssh_options();
  words_here.insert(words_here.end(), options.begin(), options.end());
  words_here.insert(words_here.end(), {"--", host, table::shell_line({"sh", "-c", question})});
  const auto [said, code] = said_by_ssh(words_here);
  const auto answer = said.find("ontime-init ");
  if (code != 0 || answer == said.npos)
    throw Error(said.find(campaign::ssh_invalid) != said.npos ? 2 : 3,
                campaign::reason_of(host, "sh", code, said));
  Place place;
  place.ssh = host;
  std::istringstream words(said.substr(answer));
  std::string mark, has_ontime, ipv4;
  // Without an interface the host has no `ip`, or the address is a router's.
  words >> mark >> place.peer >> place.address >> has_ontime >> place.interface >> ipv4;
  place.has_ontime = has_ontime == "yes";
  if (!is_ipv6(place.address)) return place;
  if (ipv4.empty()) refuse_without_ipv4(host, place.address);
  place.address = ipv4;
  return place;
}

// This machine, as the other end of the connection to `other` sees it; through a jump host or a router, what
// it sees is no address of this machine.
Place this_machine(const Place& other) {
  Place place;
  place.address = other.peer;
  place.interface = machine::interface_to(other.address, "");
  // A link-local address has the other machine's zone, and is of the same link.
  const bool is_own =
      place.address.find('%') != place.address.npos || machine::interface_with(place.address).has_value();
  if (is_own && !is_ipv6(place.address)) return place;
  for (const auto& interface : machine::interfaces())
    if (interface.name == place.interface && !interface.addresses.empty()) {
      if (!is_own)
        print_error(fmt::format(
            "{}: ssh reaches it by way of another host ({}). Check that messages from {} reach it directly",
            other.ssh, other.peer, interface.name));
      place.address = interface.addresses.front();
      return place;
    }
  if (!is_ipv6(place.address)) return place;
  refuse_without_ipv4("this machine", place.address);
}

std::string line_of(const char* role, const Place& place) {
  auto line = fmt::format("  {}: {{", role);
  if (!place.ssh.empty()) line += fmt::format("ssh: {}, ", table::shell_line({place.ssh}));
  return line + fmt::format("interface: {}, address: {}}}\n",
                            place.interface.empty() ? "NAME" : place.interface, place.address);
}

std::string scenario_of(const Place& controller, const Place& component) {
  return fmt::format(R"(# Run it: ontime run FILE. All keys: docs/reference/keys.md.
title: From {0} to {1}

# The controller sends, the component replies. "ssh" is what you type after `ssh`.
# A host without "ssh" is this machine. "interface" is the link under test.
# "address" is this host's address on that link.
hosts:
{2}{3}
# Defaults for all runs. `ontime scenarios FILE` shows how long the runs take.
defaults:
  transport: udp     # or a list: [udp, cyclonedds, fastdds]
  payload: 500 B
  period: 10 ms
  deadline: 10 ms    # a later reply is late
  duration: 10 s

runs:
  - id: idle
    title: Nothing else runs
  - id: loaded
    title: The component's CPUs are busy
    load: {{component: {{cpu: 2}}}}
  - id: loaded-realtime
    title: The component's CPUs are busy, with real-time settings
    load: {{component: {{cpu: 2}}}}
    realtime: on
)",
                     controller.ssh.empty() ? "this machine" : controller.ssh, component.ssh,
                     line_of("controller", controller), line_of("component", component));
}

// "me@robot.local" → "robot"; "me@10.0.0.2" → "10.0.0.2".
std::string stem_of(const std::string& host) {
  auto name = host.substr(host.find('@') == host.npos ? 0 : host.find('@') + 1);
  if (name.find_first_not_of("0123456789.") != name.npos) name = name.substr(0, name.find('.'));
  std::erase_if(name,
                [](unsigned char c) { return std::isalnum(c) == 0 && c != '-' && c != '_' && c != '.'; });
  return name.empty() ? "scenario" : name;
}

int init(const InitArguments& arguments) {
  if (arguments.hosts.size() > 2)
    throw wrong("HOST: name one or two hosts. With one, this machine is the controller");
  for (const auto& host : arguments.hosts)
    if (host.empty() || host.starts_with('-'))
      throw wrong("HOST: '{}' is not a host for ssh, such as me@robot", host);
  const auto file = arguments.output.empty() ? stem_of(arguments.hosts.back()) + ".yaml" : arguments.output;
  if (std::filesystem::exists(std::filesystem::symlink_status(file)))
    throw wrong("{} exists. Fix: name another file with --output FILE", file);
  const auto component = place_of(arguments.hosts.back());
  const auto controller =
      arguments.hosts.size() == 2 ? place_of(arguments.hosts.front()) : this_machine(component);
  write_whole(file, scenario_of(controller, component));
  bool lacks_ontime = false;
  for (const auto* place : {&controller, &component}) {
    if (place->ssh.empty()) continue;
    lacks_ontime = lacks_ontime || !place->has_ontime;
    print_error(fmt::format("{}: reached{}", place->ssh,
                            place->has_ontime ? "" : "; ontime is not installed there, so use --deploy"));
    if (place->interface.empty())
      print_error(fmt::format("{}: no interface there has address {}. Fix: replace NAME in {}", place->ssh,
                              place->address, file));
  }
  print(fmt::format("{} is written. Check it, then: ontime run {}{}\n", file, table::shell_line({file}),
                    lacks_ontime ? " --deploy" : ""));
  return 0;
}

}  // namespace

void add_init(Command& app) {
  auto* command =
      app.add_subcommand("init", "Checks that ssh reaches the hosts, and writes a scenario for them");
  command->footer(
      fmt::format("The scenario uses the addresses and interfaces that ssh uses. If messages take another "
                  "link, change them in the file.\n\n{}",
                  exit_codes));
  auto arguments = std::make_shared<InitArguments>();
  command
      ->add_option("HOST", arguments->hosts,
                   "what you type after ssh: the component, or the controller and the component")
      ->required();
  add_file(*command, "--output", arguments->output,
           "write the scenario to this file (default: COMPONENT.yaml)");
  command->calls([arguments] { return init(*arguments); });
}

}  // namespace ontime::app
