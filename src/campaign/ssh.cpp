// SPDX-License-Identifier: Apache-2.0
#include "campaign/ssh.hpp"

#include <cerrno>
#include <cstdlib>
#include <filesystem>
#include <system_error>

#include <fmt/format.h>

#include "table/table.hpp"

namespace ontime::campaign {
namespace {

using orders::Error;

// Exit codes: 126 and 127 are the shell's, 255 is ssh's, the others are ours.
constexpr int cannot_run = 126, not_found = 127, ssh_failed = 255;

// A signal to all processes of a service or a terminal is for the coordinator, which then ends its sessions
// in order. The signals are blocked, because an ssh that shares a connection resets ignored signals. The
// output of ssh itself comes last.
constexpr const char* first_script =
    "trap '' HUP INT TERM; command -v ssh >/dev/null || exit 125; "
    "env --block-signal=HUP,INT,TERM ssh \"$@\"; code=$?; cat \"$0/said\"; rm -rf \"$0\"; exit $code";
// The first session may be over, and the folder with it: another user could have made one of this name.
constexpr const char* another_script =
    "trap '' HUP INT TERM; [ ! -L \"$0\" ] && [ -O \"$0\" ] || exit 255; env --block-signal=HUP,INT,TERM ssh "
    "\"$@\"; code=$?; "
    "cat \"$0/said\" 2>/dev/null; exit $code";

constexpr std::size_t longest_socket =
    90;  // of 108 bytes that its address has; ssh adds 17 while it makes it

std::string make_folder() {
  std::error_code missing;
  auto folder = (std::filesystem::temp_directory_path(missing) / "ontime-ssh-XXXXXX").string();
  if (missing || folder[0] != '/')
    throw Error(3,
                "no temporary folder for ssh's socket. Fix: set TMPDIR to the absolute path of a folder, or "
                "unset it");
  if (folder.size() + 2 > longest_socket)
    throw Error(
        3, fmt::format("{} is too long a path for ssh's socket. Fix: set TMPDIR to a shorter path", folder));
  if (mkdtemp(folder.data()) == nullptr)
    throw Error(3, fmt::format("cannot create folder {}: {}. Fix: set TMPDIR to a writable folder", folder,
                               std::generic_category().message(errno)));
  return folder;
}

std::string last_line(std::string text) {
  text.erase(text.find_last_not_of(" \r\n") + 1);
  const auto before = text.find_last_of("\r\n");
  return before == text.npos ? text : text.substr(before + 1);
}

std::string reason_of_failed_ssh(const std::string& destination, const std::string& ssh_said) {
  const auto has = [&](const char* words) { return ssh_said.find(words) != ssh_said.npos; };
  const auto line = last_line(ssh_said);
  if (has("IDENTIFICATION HAS CHANGED"))
    return fmt::format(
        "the host key of {} has changed: another machine answers there, or it was installed anew. Details: "
        "ssh {} true. Only if you expected this, remove the old key: ssh-keygen -R HOST",
        destination, destination);
  if (has("Host key verification failed"))
    return fmt::format(
        "ssh does not know the host key of {}. Compare its fingerprint (there: ssh-keygen -lf "
        "/etc/ssh/ssh_host_ed25519_key.pub) and accept it once: ssh {}",
        destination, destination);
  if (has("Permission denied"))
    return fmt::format(
        "{} rejects your ssh key ({}). Fix: ssh-copy-id {} (with a passphrase also: ssh-add). Check: ssh -o "
        "BatchMode=yes {} true",
        destination, line, destination, destination);
  for (const auto* words : {"Could not resolve", "Connection refused", "No route to host", "timed out",
                            "Network is unreachable", "Host is down"})
    if (has(words) && has("connect to host"))
      return fmt::format("{} cannot be reached: {}. Check that the machine is on and runs an ssh server",
                         destination, line);
  if (has("Could not resolve"))
    return fmt::format("{} cannot be reached: {}. Fix: add the name to ~/.ssh/config, /etc/hosts or DNS",
                       destination, line);
  if (has(ssh_invalid))
    return fmt::format("'{}' is not a host for ssh, such as me@robot: {}", destination, line);
  return fmt::format("the connection to {} was lost{}", destination, line.empty() ? "" : " (" + line + ")");
}

}  // namespace

const std::vector<std::string>& ssh_options() {
  static const std::vector<std::string> all{"-o", "ControlPersist=no",       "-o", "BatchMode=yes",
                                            "-o", "LogLevel=ERROR",          "-o", "RemoteCommand=none",
                                            "-o", "ClearAllForwardings=yes", "-o", "ForwardAgent=no",
                                            "-o", "ForwardX11=no",           "-o", "ConnectTimeout=20",
                                            "-o", "ServerAliveInterval=5",   "-o", "ServerAliveCountMax=2"};
  return all;
}

std::string by_root(const std::string& destination) {
  if (destination.find("://") != destination.npos) return "ssh as root";
  const auto at = destination.rfind('@');
  return "ssh: root@" + (at == destination.npos ? destination : destination.substr(at + 1));
}

std::string reason_of_prefix(const std::string& destination, const std::vector<std::string>& prefix,
                             int code) {
  constexpr int sudo_failed = 1;
  if (code != sudo_failed || prefix.empty() || std::filesystem::path(prefix.front()).filename() != "sudo")
    return "";
  const bool here = destination.empty();
  return fmt::format(
      "sudo{} did not start ontime; its own message is above. If it asks for a password: permit ontime with "
      "NOPASSWD in sudoers{}, or use {} without host-prefix. If it does not find ontime: set program: PATH",
      here ? "" : " on " + destination, here ? "" : " there", here ? "`sudo ontime`" : by_root(destination));
}

std::string reason_of(const std::string& destination, const std::string& program, int code,
                      const std::string& said) {
  if (code == no_ssh_here) return "no ssh client on this machine. Fix: sudo apt install openssh-client";
  if (code == ssh_failed) return reason_of_failed_ssh(destination, said);
  if (code == not_found)
    return fmt::format(
        "{} not found on {}. Fix: install ontime there, set program: PATH in the scenario, or use `ontime "
        "run --deploy`",
        program, destination);
  if (code == cannot_run)
    return fmt::format("{} cannot be run on {}: it is not executable, or is for another architecture",
                       program, destination);
  if (!said.empty())
    return fmt::format(
        "unexpected output from {}: \"{}\". If a shell start-up file there (.bashrc …) prints it, limit that "
        "to interactive shells",
        destination, said.substr(0, said.find('\n')));
  return "";
}

std::string note_of_ssh_link(const std::string& host, const std::optional<record::SshLink>& link) {
  if (!link || !link->shared) return "";
  if (!link->interface) return fmt::format("unknown whether ssh to the {} uses the link under test", host);
  return fmt::format("ssh to the {} uses {}, which is or may be the link under test", host, *link->interface);
}

Ssh::Ssh(std::string destination) : destination_(std::move(destination)), folder_(make_folder()) {}

Ssh::~Ssh() {
  std::error_code none;
  std::filesystem::remove_all(folder_, none);
}

std::vector<std::string> Ssh::first(const std::vector<std::string>& there) const {
  return command(first_script, "ControlMaster=yes", there);
}

std::vector<std::string> Ssh::another(const std::vector<std::string>& there) const {
  return command(another_script, "ControlMaster=no", there);
}

std::vector<std::string> Ssh::command(const char* local_script, const char* sharing,
                                      const std::vector<std::string>& there) const {
  std::vector<std::string> words{"sh", "-c",           local_script, folder_,          "-T",
                                 "-S", folder_ + "/c", "-E",         folder_ + "/said"};
  words.insert(words.end(), {"-o", sharing});
  const auto& options = ssh_options();
  words.insert(words.end(), options.begin(), options.end());
  words.insert(words.end(), {"--", destination_, table::shell_line(there)});
  return words;
}

orders::Between Ssh::between(const std::string& program, const std::vector<std::string>& prefix,
                             const std::string& shown) const {
  const auto reason = [destination = destination_, program, prefix](int code, const auto& said) {
    if (auto why = reason_of_prefix(destination, prefix, code); !why.empty()) return why;
    auto why = reason_of(destination, program, code, said);
    // `ip netns exec` ends with ssh's own exit code.
    if (code == ssh_failed && said.empty() && !prefix.empty())
      why += fmt::format(", or `{}` failed there; then its own message is above", table::shell_line(prefix));
    return why;
  };
  return {{}, reason, fmt::format("{} on {}", shown, destination_)};
}

}  // namespace ontime::campaign
