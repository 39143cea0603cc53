// SPDX-License-Identifier: Apache-2.0
// A third party's transport that can do little, and says so: what is above the port has to go by that.
#include "transport/transport.hpp"

namespace ontime::transport {
namespace {

class Modest final : public Endpoint {
  Matched matched() override { return {}; }
  bool send(std::uint64_t, std::span<const std::byte>) noexcept override { return false; }
  std::vector<Thread> threads() override { return {}; }
  std::map<std::string, std::string> facts() override { return {}; }
};

std::string version() { return "1"; }
std::unique_ptr<Endpoint> open(const Config&, Sink&) { return std::make_unique<Modest>(); }

}  // namespace
}  // namespace ontime::transport

extern "C" __attribute__((visibility("default")))
const ontime::transport::Plugin ontime_transport{.abi = ontime::transport::abi,
                                                 .name = "modest",
                                                 .version = ontime::transport::version,
                                                 .capabilities = {.listener = true,
                                                                  .waitset = false,
                                                                  .max_payload_bytes = 500,
                                                                  .topics = false,
                                                                  .below_ip = true,
                                                                  .past_the_kernel = true,
                                                                  .qos = false},
                                                 .options = {},
                                                 .open = ontime::transport::open};
