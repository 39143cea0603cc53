// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <optional>
#include <set>
#include <sstream>

#include <dlfcn.h>
#include <elf.h>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <link.h>

#include "spelling/spelling.hpp"
#include "transport/shipped.hpp"
#include "transport/transport.hpp"

namespace ontime::transport {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view prefix = "ontime_transport_", suffix = ".so";

constexpr const char* path_variable = "ONTIME_TRANSPORT_PATH";
constexpr const char* ament_variable = "AMENT_PREFIX_PATH";

// Empty for a program with file capabilities: any user could make it load code that way.
std::vector<fs::path> folders_in(const char* variable) {
  std::vector<fs::path> folders;
  const char* value = secure_getenv(variable);
  std::istringstream list(value != nullptr ? value : "");
  for (std::string folder; std::getline(list, folder, ':');)
    if (!folder.empty()) folders.emplace_back(folder);
  return folders;
}

std::vector<fs::path> search_path() {
  auto folders = folders_in(path_variable);
  std::error_code none;
  const auto program = fs::read_symlink("/proc/self/exe", none);
  if (program.empty()) return folders;
  auto own = program.parent_path().parent_path() / ONTIME_LIBDIR / "ontime";
  if (std::ranges::find(folders, own) == folders.end()) folders.push_back(std::move(own));
  return folders;
}

// What the folder holds, as far as it can be read.
std::vector<std::string> files_in(const fs::path& folder, std::error_code& error) {
  std::vector<std::string> names;
  for (fs::directory_iterator entry(folder, error), end; entry != end; entry.increment(error))
    names.push_back(entry->path().filename().string());
  return names;
}

// An ament package that brings a transport registers it as a resource of type ontime_transport, whose content
// is where the shared object lies below the package's prefix.
constexpr const char* ament_index = "share/ament_index/resource_index/ontime_transport";

void refuse_if_no_file(const fs::path& file) {
  std::error_code none;
  if (fs::is_other(file, none))  // a FIFO would be waited for without end
    throw Error(fmt::format("{} is not a file. Fix: remove it", file.string()));
}

std::optional<fs::path> in_ament_index(const std::string& name) {
  for (const auto& prefix_path : folders_in(ament_variable)) {
    const auto file = prefix_path / ament_index / name;
    refuse_if_no_file(file);
    std::ifstream resource(file);
    if (!resource) continue;
    std::string relative;
    std::getline(resource, relative);
    if (relative.empty())
      throw Error(fmt::format("{} is empty: the transport's package is half installed. Fix: build it again",
                              file.string()));
    return prefix_path / relative;
  }
  return {};
}

std::string remedy(const std::string& name) {
  const auto* const own = shipped(name);
  return own == nullptr ? "" : own->install;
}

// Where none is found, the program was copied without them.
std::string remedy_for_none() {
  return fmt::format(
      ". Fix: install ontime (cmake --install build/release), or name the folder of its "
      "transports in {}",
      path_variable);
}

std::string not_followed() {
  std::vector<std::string> ignored;
  for (const char* variable : {path_variable, ament_variable})
    // NOLINTNEXTLINE(concurrency-mt-unsafe): nothing here sets the environment
    if (std::getenv(variable) != nullptr && secure_getenv(variable) == nullptr)
      ignored.emplace_back(variable);
  if (ignored.empty()) return "";
  return fmt::format(
      ". {} ignored: with file capabilities or setuid this program would load any user's code. Fix: sudo "
      "setcap -r PROGRAM, and permit real-time by the limits rtprio and memlock",
      fmt::join(ignored, " and "));
}

// Whether the file is shorter than its ELF header states, as after an interrupted copy or on a full disk.
// dlopen() maps such a file, and SIGBUS then kills the process. It reports other damage itself.
bool is_truncated(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  ElfW(Ehdr) head{};
  if (!in.read(reinterpret_cast<char*>(&head), sizeof head)) return false;
  constexpr unsigned char own_class = sizeof(void*) == 8 ? ELFCLASS64 : ELFCLASS32;
  if (!std::equal(head.e_ident, head.e_ident + SELFMAG, ELFMAG) || head.e_ident[EI_CLASS] != own_class ||
      head.e_phentsize != sizeof(ElfW(Phdr)))
    return false;
  std::error_code none;
  const std::uintmax_t bytes = fs::file_size(file, none);
  const auto ends_beyond = [bytes](std::uintmax_t offset, std::uintmax_t length) {
    return offset > bytes || length > bytes - offset;
  };
  if (ends_beyond(head.e_shoff, std::uintmax_t{head.e_shentsize} * head.e_shnum)) return true;
  in.seekg(static_cast<std::streamoff>(head.e_phoff));
  for (unsigned left = head.e_phnum; left > 0; --left) {
    ElfW(Phdr) segment{};
    if (!in.read(reinterpret_cast<char*>(&segment), sizeof segment)) return true;
    if (segment.p_type == PT_LOAD && ends_beyond(segment.p_offset, segment.p_filesz)) return true;
  }
  return false;
}

template <class Part>
std::optional<Part> declared(const std::string& name, Part Shipped::*own, Part Plugin::*loaded) {
  if (const auto* const one = shipped(name)) return one->*own;
  try {
    return load(name).*loaded;
  } catch (const Error&) {  // the agent that opens it says why
    return {};
  }
}

}  // namespace

const Plugin& load(const std::string& name) {
  const auto file = find(name);
  refuse_if_no_file(file);
  if (is_truncated(file))
    throw Error(fmt::format(
        "transport {} is truncated: its file ends too early. Fix: install or build it again", file));
  void* object = dlopen(file.c_str(), RTLD_NOW | RTLD_LOCAL | RTLD_NODELETE);
  if (object == nullptr)
    throw Error(fmt::format("transport {} does not load: {}{}", file,
                            dlerror(),  // NOLINT(concurrency-mt-unsafe): glibc's is a thread's own
                            remedy(name)));
  const auto* plugin = static_cast<const Plugin*>(dlsym(object, "ontime_transport"));
  if (plugin == nullptr)
    throw Error(fmt::format("{} is not an ontime transport: it exports no ontime_transport", file));
  if (plugin->abi != abi)
    throw Error(
        fmt::format("transport {} is of another ontime version (its interface version is {}, ours {}). Fix: "
                    "install or build both in one version",
                    file, plugin->abi, abi));
  return *plugin;
}

std::string find(const std::string& name) {
  // A name may come from a stranger's scenario: it must not lead to a file elsewhere, whose code would run.
  if (name.empty() || name == "." || name == ".." || name.find('/') != name.npos)
    throw Error(
        fmt::format("'{}' is not a transport's name; available: {}", name, fmt::join(available(), ", ")));
  const auto folders = search_path();
  for (const auto& folder : folders) {
    auto file = folder / fmt::format("{}{}{}", prefix, name, suffix);
    std::error_code none;
    if (fs::exists(file, none)) return file;
  }
  if (const auto file = in_ament_index(name)) return *file;
  std::vector<std::string> looked;
  for (const auto& folder : folders) {
    std::error_code error;
    files_in(folder, error);
    looked.push_back(folder.string());
    if (error && error != std::errc::no_such_file_or_directory)
      looked.back() += fmt::format(" (cannot be read: {})", error.message());
  }
  const auto others = available();
  const auto fix = remedy(name);
  throw Error(fmt::format(
      "no transport '{}' here{}{}; looked in {}; available: {}{}", name, spelling::suggestion(name, others),
      fix.empty() && others.empty() ? remedy_for_none() : fix, fmt::join(looked, ", "),
      others.empty() ? "none" : fmt::format("{}", fmt::join(others, ", ")), not_followed()));
}

std::optional<Capabilities> declared(const std::string& name) {
  return declared(name, &Shipped::can, &Plugin::capabilities);
}

std::optional<std::span<const Option>> declared_options(const std::string& name) {
  return declared(name, &Shipped::options, &Plugin::options);
}

std::string unknown_option(const std::string& transport, std::span<const Option> its,
                           const std::map<std::string, std::string>& options) {
  std::vector<std::string> names, described;
  for (const auto& option : its) {
    names.emplace_back(option.name);
    described.push_back(fmt::format("{} ({})", option.name, option.values));
  }
  for (const auto& [name, value] : options)
    if (std::ranges::find(names, name) == names.end())
      return fmt::format("transport {} has no option '{}'{}; it has: {}", transport, name,
                         spelling::suggestion(name, names),
                         names.empty() ? "none" : fmt::format("{}", fmt::join(described, ", ")));
  return "";
}

std::vector<std::string> available() {
  std::set<std::string> names;
  std::error_code ignored;  // find() says it
  for (const auto& folder : search_path())
    for (const auto& file : files_in(folder, ignored))
      if (file.starts_with(prefix) && file.ends_with(suffix))
        names.insert(file.substr(prefix.size(), file.size() - prefix.size() - suffix.size()));
  for (const auto& prefix_path : folders_in(ament_variable)) {
    const auto files = files_in(prefix_path / ament_index, ignored);
    names.insert(files.begin(), files.end());
  }
  return {names.begin(), names.end()};
}

}  // namespace ontime::transport
