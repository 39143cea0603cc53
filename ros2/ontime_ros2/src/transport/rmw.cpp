// SPDX-License-Identifier: Apache-2.0
#include "rmw.hpp"

#include <cstdlib>
#include <filesystem>
#include <set>
#include <sstream>
#include <system_error>

#include <dlfcn.h>
#include <rcutils/error_handling.h>

#include "environment.hpp"
#include "transport/transport.hpp"

namespace ontime::transport::ros2 {
namespace {

namespace fs = std::filesystem;

constexpr const char* chosen_variable = "RMW_IMPLEMENTATION";
constexpr const char* asserted_variable = "RCL_ASSERT_RMW_ID_MATCHES";

std::set<std::string> installed_rmws() {
  std::set<std::string> names;
  std::istringstream prefixes(environment("AMENT_PREFIX_PATH"));
  for (std::string prefix; std::getline(prefixes, prefix, ':');) {
    std::error_code none;
    const auto index = fs::path(prefix) / "share/ament_index/resource_index/rmw_typesupport";
    for (const auto& entry : fs::directory_iterator(index, none)) names.insert(entry.path().filename());
  }
  names.erase("rmw_implementation");  // the one that loads the others
  return names;
}

std::string debian_package(const std::string& ros_package) {
  std::string name = "ros-" + environment("ROS_DISTRO") + "-" + ros_package;
  for (char& letter : name)
    if (letter == '_') letter = '-';
  return name;
}

void check_installed(const std::string& rmw) {
  const auto installed = installed_rmws();
  if (installed.empty())
    throw Error(
        "ros2: no ROS 2 is sourced (AMENT_PREFIX_PATH has none). Fix: source its setup.bash, then that of "
        "the workspace with ontime_ros2");
  if (rmw.empty() || installed.contains(rmw)) return;
  std::string text = "ros2: the RMW '" + rmw + "' is not installed; available:";
  std::string meant;
  for (const auto& name : installed) {
    text += " " + name;
    if (name.find(rmw) != std::string::npos) meant += (meant.empty() ? "" : " or ") + name;
  }
  if (!meant.empty()) throw Error(text + " (did you mean " + meant + "?)");
  if (!rmw.starts_with("rmw_")) throw Error(text + ". Fix: state one of these");
  throw Error(text + ". Fix: install the package " + debian_package(rmw));
}

template <typename Function>
Function* function_in(void* object, const char* name) {
  return reinterpret_cast<Function*>(dlsym(object, name));
}

// The library that rcl uses too; it does not depend on rcl. A ROS 2 built with a single RMW has no
// librmw_implementation: everything is linked to that RMW.
void* rmw_library(const std::string& chosen) {
  const auto load = [](const std::string& name) {
    return dlopen(name.c_str(), RTLD_NOW | RTLD_LOCAL | RTLD_NODELETE);
  };
  if (void* const object = load("librmw_implementation.so")) return object;
  const auto installed = installed_rmws();
  const auto only = !chosen.empty() ? chosen : installed.size() == 1 ? *installed.begin() : "";
  return only.starts_with("rmw_") ? load("lib" + only + ".so") : nullptr;
}

// Empty if none loads.
std::string loaded_rmw(const std::string& chosen, std::string& why_not) {
  void* const object = rmw_library(chosen);
  if (object == nullptr) {
    why_not = dlerror();  // NOLINT(concurrency-mt-unsafe)
    return {};
  }
  auto* const identifier = function_in<const char*()>(object, "rmw_get_implementation_identifier");
  if (identifier == nullptr) {
    why_not = "its library is not an RMW";
    return {};
  }
  const char* const name = identifier();
  if (name != nullptr) return name;
  if (auto* const error = function_in<rcutils_error_string_t()>(object, "rcutils_get_error_string"))
    why_not = error().str;
  return {};
}

}  // namespace

std::string load_rmw(const std::string& asked) {
  const std::string chosen = asked.empty() ? environment(chosen_variable) : asked;
  check_installed(chosen);
  if (!chosen.empty()) setenv(chosen_variable, chosen.c_str(), 1);  // NOLINT(concurrency-mt-unsafe)
  std::string why_not;
  std::string loaded = loaded_rmw(chosen, why_not);
  if (loaded.empty())
    throw Error("ros2: " + (chosen.empty() ? "no RMW loads" : "the RMW " + chosen + " does not load") + ": " +
                why_not + ". Fix: source the setup.bash of the ROS 2 that it was built in");
  if (!chosen.empty() && loaded != chosen)
    throw Error("ros2: requested RMW " + chosen + ", but " + loaded +
                " is loaded; a process keeps its first RMW");
  const std::string asserted = environment(asserted_variable);
  if (!asserted.empty() && loaded != asserted)
    throw Error(std::string("ros2: ") + asserted_variable + " requires RMW " + asserted + ", but " + loaded +
                " is loaded. Fix: unset it, or request that RMW by --option rmw=" + asserted + " or " +
                chosen_variable);
  return loaded;
}

}  // namespace ontime::transport::ros2
