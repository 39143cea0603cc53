// SPDX-License-Identifier: Apache-2.0
#include "campaign/deploy.hpp"

#include <algorithm>
#include <cctype>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <optional>
#include <sstream>
#include <string_view>
#include <system_error>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <sys/utsname.h>

#include "machine/machine.hpp"
#include "table/table.hpp"

namespace ontime::campaign {
namespace {

namespace fs = std::filesystem;
using orders::Error;

constexpr int not_executable = 120, no_room = 121, other_machine = 122, libraries_missing = 123;

// $1: the architecture; then for each file its path in the folder and its size. dd reads exactly that many
// bytes from the pipe; BusyBox's head would take more. A temporary folder may be mounted with noexec: then
// another folder gets the program. A signal to the whole session ends the keeper; this script then cleans up.
// If the keeper was killed (exit code 128 or more), a second keeper without orders restores what the journal
// holds: no other program there can.
constexpr const char* script = R"sh(
umask 077
[ "$(uname -m)" = "$1" ] || { uname -m; exit 122; }
shift
trap : HUP INT TERM
trap 'rm -rf "$folder"' EXIT
code=121
for there in "${TMPDIR:-/tmp}" /var/tmp "${XDG_RUNTIME_DIR:-/run}" "${HOME:-/run}"; do
  folder=$(mktemp -d "$there/ontime-program-XXXXXXXX" 2>/dev/null) || continue
  code=120
  printf '#!/bin/sh\n' >"$folder/try" && chmod 700 "$folder/try" && "$folder/try" 2>/dev/null && code=0 && break
  rm -rf "$folder"
done
[ $code = 0 ] || exit $code
program=$folder/$1
missing=
while [ $# -gt 0 ]; do
  mkdir -p "$folder/${1%/*}" && {
    [ "$2" -lt 65536 ] || dd bs=65536 count=$(($2 / 65536)) iflag=fullblock
    [ $(($2 % 65536)) = 0 ] || dd bs=$(($2 % 65536)) count=1 iflag=fullblock
  } >"$folder/$1" 2>/dev/null && chmod 700 "$folder/$1" || exit 121
  [ "$(wc -c <"$folder/$1")" = "$2" ] || exit 121
  missing="$missing $(ldd "$folder/$1" | sed -n 's/ => not found//p')"
  shift 2
done
set -- $missing
[ $# = 0 ] || { printf '%s\n' "$@" | sort -u; exit 123; }
"$program" keeper
code=$?
[ $code -lt 128 ] || "$program" keeper </dev/null >/dev/null
exit $code
)sh";

utsname here() {
  utsname names{};
  uname(&names);
  return names;
}

struct Part {
  fs::path there;  // in the folder
  std::string content;
};

Part read(const fs::path& here, const fs::path& there) {
  std::error_code none;
  std::ifstream file;
  if (fs::is_regular_file(here, none))
    file.open(here, std::ios::binary);  // a FIFO would be waited for without end
  std::string content{std::istreambuf_iterator<char>(file), {}};
  if (!file || content.empty()) throw Error(3, fmt::format("--deploy: cannot read {}", here.string()));
  return {there, std::move(content)};
}

// Debug information makes a program ten times larger; without a working `strip` here it is sent too.
Part without_symbols(const fs::path& here, const fs::path& there, const std::string& folder) {
  constexpr std::chrono::seconds limit{10};
  const auto copy = folder + "/stripped";
  if (!machine::answer_of({"strip", "-o", copy, here.string()}, limit)) return read(here, there);
  auto file = read(copy, there);
  fs::remove(copy);
  return file;
}

// Installations for other architectures lie within this one, each in a folder named as `uname -m` there.
fs::path others() {
  return fs::path(orders::this_program()).parent_path().parent_path() / "share/ontime/deploy";
}

struct Installation {
  std::string machine;
  fs::path program, prefix;
};

// This installation, unless there are others: then the architecture of that machine decides. If it does not
// answer, or no installation is for it, the session that follows reports why.
Installation installation_for(const Ssh& ssh, const std::vector<std::string>& reach) {
  constexpr std::chrono::seconds limit{30};
  const fs::path program = orders::this_program();
  Installation own{here().machine, program, program.parent_path().parent_path()};
  std::error_code none;
  if (!fs::is_directory(others(), none)) return own;
  auto words = reach;
  words.insert(words.end(), {"uname", "-m"});
  auto machine = machine::answer_of(ssh.another(words), limit).value_or("");
  machine = machine.substr(0, machine.find('\n'));
  const auto prefix = others() / machine;
  if (machine.empty() || machine == own.machine || fs::path(machine).filename() != machine ||
      !fs::exists(prefix / "bin/ontime", none))
    return own;
  return {machine, prefix / "bin/ontime", prefix};
}

// Where a distribution installs libraries depends on the architecture.
std::optional<fs::path> transport_in(const fs::path& prefix, const std::string& name) {
  const auto file = fmt::format("ontime_transport_{}.so", name);
  std::error_code none;
  if (auto own = prefix / ONTIME_LIBDIR / "ontime" / file; fs::exists(own, none)) return own;
  // A folder there that is closed to this user is no reason to end.
  constexpr auto options = fs::directory_options::skip_permission_denied;
  for (const auto& entry : fs::recursive_directory_iterator(prefix / "lib", options, none))
    if (entry.path().filename() == file) return entry.path();
  return {};
}

// The program first.
std::vector<Part> files(const Installation& from, const std::set<std::string>& transports,
                        const std::string& folder) {
  std::vector<Part> all{without_symbols(from.program, "bin/ontime", folder)};
  for (const auto& name : transports)
    if (const auto file = transport_in(from.prefix, name))  // else the agent says that it has none
      all.push_back(without_symbols(*file, file->lexically_relative(from.prefix), folder));
  return all;
}

std::string reason_of_bringing(int code, const std::string& said, const std::function<bool()>& interrupted) {
  if (code == not_executable)
    return "no folder there can hold programs: the temporary folder, /var/tmp, the runtime folder and the "
           "home are mounted with noexec. Fix: set TMPDIR there to a folder on another mount";
  if (code == no_room) return "the temporary folder there is full or not writable";
  if (code == other_machine)
    return fmt::format(
        "that machine is {}, this ontime is for {}. Fix: install ontime for {} there, or for --deploy in {} "
        "here (`scripts/setup arm64` builds one for aarch64)",
        said, here().machine, said, (others() / said).string());
  if (code != libraries_missing) return "";
  std::istringstream words(said);
  const std::vector<std::string> libraries(std::istream_iterator<std::string>(words), {});
  const auto packages = packages_of(libraries, interrupted);
  return fmt::format(
      "libraries are missing there: {}{}", fmt::join(libraries, ", "),
      packages.empty() ? "" : fmt::format(". Fix there: sudo apt install {}", fmt::join(packages, " ")));
}

}  // namespace

std::vector<std::string> packages_of(const std::vector<std::string>& libraries,
                                     const std::function<bool()>& interrupted) {
  // dpkg reads the list of files of each package: on a busy machine, that takes long.
  constexpr std::chrono::seconds limit{60};
  std::set<std::string> packages;
  // What came from another machine becomes part of a pattern here.
  const auto odd = [](char c) {
    return std::isalnum(static_cast<unsigned char>(c)) == 0 &&
           std::string_view("._+-").find(c) == std::string_view::npos;
  };
  for (const auto& library : libraries) {
    if (std::any_of(library.begin(), library.end(), odd)) continue;
    if (interrupted()) break;
    if (const auto answer = machine::answer_of({"dpkg-query", "-S", "*/" + library}, limit, interrupted))
      packages.insert(answer->substr(0, answer->find(':')));  // "libfmt9:amd64: /usr/lib/…"
  }
  return {packages.begin(), packages.end()};
}

std::pair<std::vector<std::string>, orders::Between> deployment(const Ssh& ssh,
                                                                const std::vector<std::string>& reach,
                                                                const std::set<std::string>& transports,
                                                                std::function<bool()> interrupted) {
  auto words = reach;
  const auto from = installation_for(ssh, reach);
  words.insert(words.end(), {"sh", "-c", script, "ontime", from.machine});
  auto shown = reach;
  shown.insert(shown.end(), {"ontime", "keeper"});
  auto between = ssh.between("the deployed ontime", reach, table::shell_line(shown));
  for (const auto& file : files(from, transports, ssh.folder())) {
    words.insert(words.end(), {file.there.string(), std::to_string(file.content.size())});
    between.ahead.insert(between.ahead.end(), file.content.begin(), file.content.end());
  }
  between.reason = [of_ssh = std::move(between.reason), interrupted = std::move(interrupted)](
                       int code, const std::string& said) {
    const auto reason = reason_of_bringing(code, said, interrupted);
    return reason.empty() ? of_ssh(code, said) : reason;
  };
  return {ssh.first(words), std::move(between)};
}

}  // namespace ontime::campaign
