// SPDX-License-Identifier: Apache-2.0
// A message has arrived when the application can read it: after rcl's take, in any way of waiting.
#include <atomic>
#include <chrono>
#include <filesystem>
#include <thread>

#include <dlfcn.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <link.h>

#include "ends.hpp"
#include "transport/clock.hpp"

namespace {

std::atomic<std::int64_t> taken_ns{0};  // when rcl last gave us a message

// What librcl calls by that name; it is loaded where RTLD_NEXT does not look.
template <typename Function>
Function* in_librcl(const char* function) {
  void* librcl = nullptr;
  dl_iterate_phdr(
      [](dl_phdr_info* info, std::size_t, void* found) {
        if (std::filesystem::path(info->dlpi_name).filename() != "librcl.so") return 0;
        *static_cast<void**>(found) = dlopen(info->dlpi_name, RTLD_LAZY | RTLD_NOLOAD);
        return 1;
      },
      &librcl);
  return reinterpret_cast<Function*>(dlsym(librcl, function));
}

}  // namespace

// This program stands between rclcpp and rcl.
extern "C" int rcl_take(const void* subscription, void* message, void* info, void* allocation) {
  static auto* const real = in_librcl<decltype(rcl_take)>("rcl_take");
  const int result = real(subscription, message, info, allocation);
  if (result == 0) taken_ns = ontime::transport::now_ns();
  return result;
}

namespace ontime::transport {
namespace {

using namespace std::chrono_literals;

// Slow, so that messages queue up behind it.
class Stamps final : public Sink {
 public:
  void arrived(std::uint64_t, std::span<std::byte>, std::int64_t arrival_ns) noexcept override {
    if (arrival_ns < taken_ns) wrong = "stamped before the message was taken";
    if (arrival_ns < left_ns_) wrong = "stamped while the message before it was being read";
    if (arrival_ns > now_ns()) wrong = "stamped in the future";
    std::this_thread::sleep_for(2ms);
    left_ns_ = now_ns();
    ++count;
  }
  std::atomic<const char*> wrong{nullptr};
  std::atomic<int> count{0};

 private:
  std::int64_t left_ns_ = 0;
};

class Arrival : public testing::TestWithParam<const char*> {};

TEST_P(Arrival, IsWhenTheMessageCanBeRead) {
  for (const std::string rmw : rmws) {
    const two_ends::Child server([&](int end, int) {
      Config config = config_of(Role::server, {{"rmw", rmw}});
      config.qos.depth = 20;
      two_ends::serve(config, end);
    });
    EXPECT_EQ(in_own_process([&] {
                Config config = config_of(Role::client, {{"rmw", rmw}, {"executor", GetParam()}});
                config.qos.depth = 20;
                Stamps stamps;
                const auto endpoint = two_ends::plugin().open(config, stamps);
                const Receiving receiving(*endpoint, config.receive);
                require(two_ends::await_match(*endpoint), "no match; seen: " + endpoint->seen());
                for (std::uint64_t i = 1; i < 2000 && stamps.count < 40; ++i) {
                  endpoint->send(i, {});
                  if (i % 10 == 0) std::this_thread::sleep_for(20ms);
                }
                require(stamps.count >= 40, "nothing arrives");
                require(taken_ns != 0, "rcl_take was not called");
                require(stamps.wrong == nullptr, stamps.wrong.load() ? stamps.wrong.load() : "");
              }),
              "")
        << rmw;
  }
}

INSTANTIATE_TEST_SUITE_P(By, Arrival, testing::Values("single", "multi", "waitset", "wait"),
                         [](const auto& each) { return std::string(each.param); });

}  // namespace
}  // namespace ontime::transport
