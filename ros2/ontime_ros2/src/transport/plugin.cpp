// SPDX-License-Identifier: Apache-2.0
// The transport as ontime loads it. It is linked with nothing of ROS 2, for librcl ends the process when it
// is loaded with an RMW_IMPLEMENTATION that it does not find: so what was asked is checked first, and only
// then comes the part that has rclcpp in it.
#include <cstdlib>
#include <filesystem>
#include <set>
#include <sstream>

#include <dlfcn.h>
#include <rclcpp/version.h>

#include "environment.hpp"
#include "open.hpp"
#include "options.hpp"
#include "transport/dds.hpp"

namespace ontime::transport::ros2 {
namespace {

namespace fs = std::filesystem;

constexpr const char* rmw_variable = "RMW_IMPLEMENTATION";

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

void check_rmw(const std::string& rmw) {
  const auto installed = installed_rmws();
  if (installed.empty())
    throw Error(
        "ros2: no ROS 2 is sourced (AMENT_PREFIX_PATH has none); source its setup.bash and then that "
        "of the workspace with ontime_ros2");
  if (rmw.empty() || installed.contains(rmw)) return;
  std::string text = "ros2: the RMW '" + rmw + "' is not installed; there are:";
  for (const auto& name : installed) text += " " + name;
  throw Error(text + "; install the package " + debian_package(rmw));
}

OpenFunction* rclcpp_part() {
  Dl_info here;
  dladdr(reinterpret_cast<const void*>(&installed_rmws), &here);
  const auto file = fs::path(here.dli_fname).parent_path() / "libontime_rclcpp.so";
  void* const object = dlopen(file.c_str(), RTLD_NOW | RTLD_LOCAL | RTLD_NODELETE);
  if (object == nullptr)
    throw Error("ros2: " + file.string() + " does not load: " + dlerror() +  // NOLINT(concurrency-mt-unsafe)
                "; source the setup.bash of the ROS 2 that it was built in, and build it anew for another");
  return reinterpret_cast<OpenFunction*>(dlsym(object, "ontime_open_ros2"));
}

std::string version() { return "rclcpp " RCLCPP_VERSION_STR; }

std::unique_ptr<Endpoint> open(const Config& asked, Sink& sink) {
  const Config config = without_localhost_only(asked);
  dds::check(config, "ros2", known_options);
  Options options = options_of(config);
  if (options.rmw.empty()) options.rmw = environment(rmw_variable);
  check_rmw(options.rmw);
  // For good: an RMW stays loaded, and rcl compares the two whenever it starts.
  if (!options.rmw.empty()) setenv(rmw_variable, options.rmw.c_str(), 1);  // NOLINT(concurrency-mt-unsafe)
  return rclcpp_part()(config, options, sink);
}

}  // namespace
}  // namespace ontime::transport::ros2

extern "C" __attribute__((visibility("default"))) const ontime::transport::Plugin ontime_transport{
    .abi = ontime::transport::abi,
    .name = "ros2",
    .version = ontime::transport::ros2::version,
    .capabilities = {.listener = true,
                     .waitset = true,
                     .loans = false,  // of a message that has no upper bound
                     .discovery = true,
                     .thread_settings = true,
                     .max_payload_bytes = ontime::transport::dds::max_payload_bytes},
    .options = ontime::transport::ros2::known_options,
    .open = ontime::transport::ros2::open};
