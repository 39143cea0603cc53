// SPDX-License-Identifier: Apache-2.0
// Units and scripts that apply settings at every boot.
#include <algorithm>
#include <filesystem>

#include <fmt/format.h>
#include <sys/stat.h>

#include "settings/kinds.hpp"

namespace ontime::settings {
namespace {

namespace fs = std::filesystem;

// Characters without a special meaning in a shell, in systemd and in a regular expression.
constexpr const char* plain = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-/@:";

// A program that root starts at every boot, and all folders above it, must be writable by root only.
void require_roots(const std::string& program) {
  for (fs::path path = program;; path = path.parent_path()) {
    struct stat found {};
    const bool roots = lstat(path.c_str(), &found) == 0 && found.st_uid == 0 &&
                       (found.st_mode & S_IWOTH) == 0 &&
                       (found.st_gid == 0 || (found.st_mode & S_IWGRP) == 0);
    if (!roots)
      throw Error(fmt::format(
          "root would start {} at every boot, but users other than root can write {}. Fix: install "
          "ontime (sudo cmake --install build/release) and use the installed program",
          program, path.string()));
    if (!path.has_relative_path()) return;
  }
}

std::string systemd(const Wishes& wishes, const Link& link, const Program& program) {
  for (const auto& word : {link.interface, program.path})
    if (const auto at = word.find_first_not_of(fmt::format("{}.", plain)); at != word.npos)
      throw WrongInput(fmt::format("'{}' cannot be in a unit: '{}' is not a letter, digit or one of _-/@:.",
                                   word, word[at]));
  if (program.is_here) require_roots(program.path);
  return fmt::format(R"(# /etc/systemd/system/ontime-tune.service
[Unit]
Description=Kernel settings for messages that arrive on time
After=network.target

[Service]
Type=oneshot
RemainAfterExit=yes
ExecStart={}
ExecStop={} tune revert

[Install]
WantedBy=multi-user.target
)",
                     command_to_apply(program.path, wishes, link), program.path);
}

[[noreturn]] void not_in(const char* form, const Change& change, const std::string& why) {
  throw WrongInput(fmt::format("{}: {} {}. Fix: --print systemd", change.setting->name, form, why));
}

std::string tmpfiles(const std::vector<Change>& changes) {
  std::string text = "# /etc/tmpfiles.d/ontime.conf\n";
  for (const auto& change : changes) {
    const auto file = change.thing.kind == nullptr ? std::nullopt : file_of(change.thing, change.after);
    if (!file) not_in("tmpfiles", change, "can only write files, and this setting is not a file");
    text += fmt::format("w {} - - - - {}\n", file->path, file->text);
  }
  return text;
}

// The pattern for pgrep. Numbers in thread names differ from boot to boot, except CPU numbers. Any other
// character becomes '.': an interface's name can contain anything, and root's shell reads it.
std::string pattern_of(const std::string& name) {
  std::string pattern;
  for (const char c : name)
    if (c == '.')
      pattern += "[.]";
    else
      pattern += std::string_view(plain).find(c) == std::string_view::npos ? '.' : c;
  const auto number = pattern.find_last_not_of("0123456789") + 1;
  if (name.starts_with("irq/"))
    return "irq/[0-9]+" + pattern.substr(std::min(pattern.size(), pattern.find('-')));
  if (name.starts_with("napi/"))
    return pattern.substr(0, number) + "[0-9]*";  // older kernels cut names short
  return pattern;
}

// Only what the setting is about: the rest of a thread's state is this boot's.
std::string shell_of_thread(const Change& change) {
  const auto& state = change.after;
  const auto first = state.find(':'), second = state.find(':', first + 1);
  const auto policy = state.substr(0, first), number = state.substr(first + 1, second - first - 1);
  const bool has_priority = policy == "fifo" || policy == "rr";
  const auto command = std::string_view(change.setting->name).ends_with("-cpus")
                           ? fmt::format("taskset --cpu-list --pid {}", state.substr(second + 1))
                           : fmt::format("chrt --{} --pid {}", policy, has_priority ? number : "0");
  return fmt::format("for pid in $(threads '{}'); do {} \"$pid\"; done\n",
                     pattern_of(name_of_thread(change.thing.what)), command);
}

// A driver may refuse a parameter that it does not support, even with its present value: only those asked
// for.
std::string shell_of_driver(const Thing& thing, std::string asked) {
  std::replace_if(
      asked.begin(), asked.end(), [](char c) { return c == '=' || c == ','; }, ' ');
  return thing.kind == &gro ? fmt::format("ethtool --features '{}' gro {}\n", thing.title(), asked)
                            : fmt::format("ethtool --coalesce '{}' {}\n", thing.title(), asked);
}

std::string shell(const Wishes& wishes, const std::vector<Change>& changes) {
  std::string text = R"sh(#!/bin/sh
set -e
pgrep --version >/dev/null
threads() { pgrep --parent 2 --exact "$1"; }  # of the kernel: others may call themselves so, too
)sh";
  for (const auto& change : changes) {
    if (change.thing.kind == nullptr)
      not_in("a script", change,
             fmt::format("cannot find its threads before {} is set", change.setting->comes_with));
    std::string line;
    if (const auto file = file_of(change.thing, change.after))
      line = fmt::format("echo '{}' > '{}'\n", file->text, file->path);
    else if (change.thing.kind == &thread || change.thing.kind == &thread_priority)
      line = shell_of_thread(change);
    else
      line = shell_of_driver(change.thing, wishes.at(change.setting->name));
    if (text.find("\n" + line) == text.npos) text += line;
  }
  return text;
}

bool is_size(const std::string& name) {
  const auto all = table();
  const auto found = std::ranges::find(all, name, &Setting::name);
  return found != all.end() && found->values == std::string_view("SIZE");
}

}  // namespace

std::string command_to_apply(const std::string& program, const Wishes& wishes, const Link& link) {
  std::string command = program + " tune apply";
  for (const auto& [name, value] : wishes)  // --set takes a size only with its unit
    command += fmt::format(" --set {}={}{}", name, value, is_size(name) ? "B" : "");
  if (!link.interface.empty()) command += " --interface " + link.interface;
  if (!link.network_namespace.empty()) command += " --namespace " + link.network_namespace;
  return command;
}

std::string at_every_boot(Form form, const Wishes& wishes, const std::vector<Change>& changes,
                          const Link& link, const Program& program) {
  if (!link.network_namespace.empty())
    throw WrongInput(
        fmt::format("the network namespace {} does not exist at boot. Fix: create it first, then "
                    "run ontime tune apply",
                    link.network_namespace));
  if (form == Form::systemd) return systemd(wishes, link, program);
  for (const auto& change : changes)
    if (change.thing.kind == &interrupt)
      not_in(form == Form::tmpfiles ? "tmpfiles" : "a script", change,
             "would name interrupts by numbers, which may be other devices' at the next boot");
  return form == Form::tmpfiles ? tmpfiles(changes) : shell(wishes, changes);
}

}  // namespace ontime::settings
