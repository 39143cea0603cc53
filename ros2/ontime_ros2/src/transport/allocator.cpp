// SPDX-License-Identifier: Apache-2.0
#include "allocator.hpp"

#include <mutex>
#include <vector>

#ifdef ONTIME_HAS_TLSF
#include <tlsf/tlsf.h>
#endif

namespace ontime::transport::ros2 {
namespace {

constexpr std::size_t pool_bytes = std::size_t{8} << 20;

std::pmr::memory_resource* pmr_resource() {
  static std::vector<std::byte> memory(pool_bytes);
  static std::pmr::monotonic_buffer_resource buffer(memory.data(), memory.size(),
                                                    std::pmr::null_memory_resource());
  static std::pmr::synchronized_pool_resource pool(&buffer);
  return &pool;
}

#ifdef ONTIME_HAS_TLSF
// The same TLSF that tlsf_cpp wraps. Its own wrapper destroys the pool's lock with the first copy of the
// allocator that ends, and rclcpp copies allocators.
class Tlsf final : public std::pmr::memory_resource {
 public:
  Tlsf() : memory_(pool_bytes) { init_memory_pool(memory_.size(), memory_.data()); }

 private:
  void* do_allocate(std::size_t bytes, std::size_t) override {
    const std::lock_guard lock(mutex_);
    void* const block = malloc_ex(bytes, memory_.data());
    if (block == nullptr) throw std::bad_alloc();
    return block;
  }
  void do_deallocate(void* block, std::size_t, std::size_t) override {
    const std::lock_guard lock(mutex_);
    free_ex(block, memory_.data());
  }
  bool do_is_equal(const memory_resource& other) const noexcept override { return this == &other; }

  std::mutex mutex_;
  std::vector<std::byte> memory_;
};

std::pmr::memory_resource* tlsf_resource() {
  static Tlsf tlsf;
  return &tlsf;
}
#else
std::pmr::memory_resource* tlsf_resource() {
  throw Error(
      "ros2: this transport was built without allocator tlsf. Fix: install the ROS package tlsf_cpp and "
      "rebuild ontime_ros2");
}
#endif

}  // namespace

void choose_resource(Allocator allocator) {
  if (allocator == Allocator::pmr) chosen_resource = pmr_resource();
  if (allocator == Allocator::tlsf) chosen_resource = tlsf_resource();
}

}  // namespace ontime::transport::ros2
