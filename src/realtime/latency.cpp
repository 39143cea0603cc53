// SPDX-License-Identifier: Apache-2.0
#include <cerrno>
#include <cstdint>
#include <limits>

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include "realtime/privileges.hpp"
#include "realtime/realtime.hpp"

namespace ontime::realtime {
namespace {

constexpr const char* device = "/dev/cpu_dma_latency";

std::string remedy_for(int error) {
  if (error == ENOENT || error == ENODEV || error == ENXIO)
    return "none on this kernel; in a container: docker run --device /dev/cpu_dma_latency";
  if (privileges().is_root()) return "start the container with docker run --device /dev/cpu_dma_latency";
  return "run as root, or: sudo chgrp realtime /dev/cpu_dma_latency && sudo chmod g+rw /dev/cpu_dma_latency, "
         "and join the group realtime";
}

}  // namespace

CpuLatencyRequest::CpuLatencyRequest(std::chrono::microseconds latency) {
  const auto asked = fmt::format("CPU idle states of at most {} µs exit latency", latency.count());
  if (latency.count() < 0 || latency.count() > std::numeric_limits<std::int32_t>::max()) {
    refusal_ = Refusal{asked, "out of range", "0 … 2147483647 µs"};
    return;
  }
  const auto latency_us = static_cast<std::int32_t>(latency.count());
  fd_ = process::Fd(open(device, O_WRONLY | O_CLOEXEC));
  if (fd_.get() >= 0 && write(fd_.get(), &latency_us, sizeof latency_us) == sizeof latency_us) return;
  const int error = errno;
  refusal_ = Refusal{asked, fmt::format("{}: {}", device, message_of(error)), remedy_for(error)};
}

}  // namespace ontime::realtime
