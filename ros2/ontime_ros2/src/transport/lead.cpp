// SPDX-License-Identifier: Apache-2.0
#include "lead.hpp"

#include <filesystem>

#include <dlfcn.h>

namespace ontime::transport::ros2 {
namespace {

// Empty for a DDS that ontime knows nothing of.
std::string file_for(const std::string& rmw) {
  if (rmw == "rmw_cyclonedds_cpp") return "libontime_lead_cyclonedds.so";
  if (rmw == "rmw_fastrtps_cpp" || rmw == "rmw_fastrtps_dynamic_cpp") return "libontime_lead_fastdds.so";
  return {};
}

std::unique_ptr<Lead> without_link(const std::string& rmw, const Config& config, const std::string& why) {
  if (!config.interface.empty() || !config.peers.empty())
    throw Error("ros2: ontime cannot set an interface or peer for " + rmw + why +
                ". Fix: set it in the configuration of the RMW, and name neither here");
  auto own = std::make_unique<Lead>();
  own->source = rmw + "'s own";
  own->carrier = "unknown";
  return own;
}

}  // namespace

std::unique_ptr<Lead> lead(const std::string& rmw, const Config& config) {
  const std::string name = file_for(rmw);
  if (name.empty()) return without_link(rmw, config, "");
  Dl_info here;
  dladdr(reinterpret_cast<const void*>(&file_for), &here);
  const auto file = std::filesystem::path(here.dli_fname).parent_path() / name;
  if (!std::filesystem::exists(file))
    return without_link(rmw, config, " (ontime_ros2 was built without its DDS: no " + file.string() + ")");
  void* const object = dlopen(file.c_str(), RTLD_NOW | RTLD_LOCAL | RTLD_NODELETE);
  if (object == nullptr)
    throw Error("ros2: " + file.string() + " does not load: " + dlerror() +  // NOLINT(concurrency-mt-unsafe)
                ". Fix: rebuild ontime_ros2 for this ROS 2");
  return reinterpret_cast<LeadFunction*>(dlsym(object, "ontime_lead"))(config);
}

}  // namespace ontime::transport::ros2
