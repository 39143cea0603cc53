// SPDX-License-Identifier: Apache-2.0
// The transport as ontime loads it. It is linked with nothing of ROS 2, for librcl ends the process when it
// is loaded with another RMW than it was told to expect: so that is settled first (rmw.hpp), and only then
// comes the part that has rclcpp in it.
#include <array>
#include <atomic>
#include <cstdint>
#include <filesystem>
#include <future>
#include <memory>

#include <dlfcn.h>
#include <linux/capability.h>
#include <rclcpp/version.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "environment.hpp"
#include "options.hpp"
#include "rmw.hpp"
#include "transport/dds.hpp"
#include "transport/shipped.hpp"

namespace ontime::transport::ros2 {
namespace {

// The one function of the part that is linked with rclcpp.
using OpenFunction = std::unique_ptr<Endpoint>(const Config&, const Options&, Sink&);

OpenFunction* rclcpp_part() {
  Dl_info here;
  dladdr(reinterpret_cast<const void*>(&rclcpp_part), &here);
  const auto file = std::filesystem::path(here.dli_fname).parent_path() / "libontime_rclcpp.so";
  void* const object = dlopen(file.c_str(), RTLD_NOW | RTLD_LOCAL | RTLD_NODELETE);
  if (object == nullptr)
    throw Error("ros2: " + file.string() + " does not load: " + dlerror() +  // NOLINT(concurrency-mt-unsafe)
                ". Fix: source the setup.bash of the ROS 2 that it was built in, or rebuild it for this one");
  return reinterpret_cast<OpenFunction*>(dlsym(object, "ontime_open_ros2"));
}

// What starts threads as it is loaded gives them the privileges of the thread that loads it. LTTng's, behind
// ROS 2's trace points, block every signal, so that nothing could take privileges from them later.
// Of this thread alone: priorities, and locked memory, are what an end still needs.
void keep_few_privileges() {
  constexpr std::uint32_t kept = (1U << CAP_SYS_NICE) | (1U << CAP_IPC_LOCK);
  __user_cap_header_struct header{_LINUX_CAPABILITY_VERSION_3, 0};
  std::array<__user_cap_data_struct, _LINUX_CAPABILITY_U32S_3> sets{};
  if (syscall(SYS_capget, &header, sets.data()) != 0) return;
  sets[0] = {.effective = sets[0].effective & kept, .permitted = sets[0].permitted & kept, .inheritable = 0};
  sets[1] = {};
  syscall(SYS_capset, &header, sets.data());
}

// What `load` returns, from a thread with few privileges. Where it throws Error there, once more with all of
// the caller's: the files may be in a folder that root reads by privilege only.
template <typename Load>
auto loaded_unprivileged(const Load& load) {
  try {
    return std::async(std::launch::async,
                      [&] {
                        keep_few_privileges();
                        return load();
                      })
        .get();
  } catch (const Error&) {
    return load();
  }
}

// Between two processes the RMW carries every message, which would be measured in silence.
void check_other_end_is_here(const Config& config, const Options& options) {
  static std::atomic<bool> has_server{false};
  if (!options.intra_process) return;
  if (config.role == Role::server) has_server = true;
  if (!has_server)
    throw WrongInput(
        "ros2: intra-process carries messages only within a process, and ontime's client and server are two "
        "processes. Fix: omit intra-process");
}

std::string version() { return "rclcpp " RCLCPP_VERSION_STR; }

std::unique_ptr<Endpoint> open(const Config& asked, Sink& sink) {
  const Config config = without_localhost_only(asked);
  dds::check(config, "ros2");
  Options options = options_of(config);
  if (config.background) options = options_beside(options);
  check_other_end_is_here(config, options);
  OpenFunction* const open_rclcpp = loaded_unprivileged([&options] {
    options.rmw = load_rmw(options.rmw);
    return rclcpp_part();
  });
  return open_rclcpp(config, options, sink);
}

}  // namespace
}  // namespace ontime::transport::ros2

extern "C" __attribute__((visibility("default")))
const ontime::transport::Plugin ontime_transport{.abi = ontime::transport::abi,
                                                 .name = "ros2",
                                                 .version = ontime::transport::ros2::version,
                                                 .capabilities = ontime::transport::shipped("ros2")->can,
                                                 .options = ontime::transport::shipped("ros2")->options,
                                                 .open = ontime::transport::ros2::open};
