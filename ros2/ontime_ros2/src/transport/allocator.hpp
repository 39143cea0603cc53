// SPDX-License-Identifier: Apache-2.0
// The allocators that publishers, subscriptions, messages and executors can be given beside the standard one.
#pragma once

#include <cstddef>
#include <memory_resource>
#include <new>
#include <type_traits>

#include "options.hpp"

namespace ontime::transport::ros2 {

// Where ResourceAllocator takes from. rclcpp default-constructs allocators here and there, so there can be no
// more than one choice at a time.
inline std::pmr::memory_resource* chosen_resource = nullptr;

// Sets chosen_resource to memory that exists already, and touched. Throws Error for TLSF where it was not
// there when this was built.
void choose_resource(Allocator allocator);

template <typename T>
struct ResourceAllocator {
  using value_type = T;
  using is_always_equal = std::true_type;

  ResourceAllocator() = default;
  template <typename U>
  ResourceAllocator(const ResourceAllocator<U>&) noexcept {}  // NOLINT(google-explicit-constructor)

  // rclcpp gives memory back with another size than it took (allocator_common.hpp), and after another choice
  // there may be some from before: hence each block knows where it belongs.
  T* allocate(std::size_t count) {
    const std::size_t bytes = sizeof(Header) + count * element_bytes();
    auto* const header = static_cast<Header*>(chosen_resource->allocate(bytes));
    *header = {chosen_resource, bytes};
    return reinterpret_cast<T*>(header + 1);
  }
  void deallocate(T* memory, std::size_t) noexcept {
    if (memory == nullptr) return;
    auto* const header = reinterpret_cast<Header*>(memory) - 1;
    header->resource->deallocate(header, header->bytes);
  }

  friend bool operator==(const ResourceAllocator&, const ResourceAllocator&) noexcept { return true; }

 private:
  struct alignas(std::max_align_t) Header {
    std::pmr::memory_resource* resource;
    std::size_t bytes;
  };
  static constexpr std::size_t element_bytes() {
    if constexpr (std::is_void_v<T>)
      return 1;
    else
      return sizeof(T);  // NOLINT(bugprone-sizeof-expression): also where T is a pointer
  }
};

}  // namespace ontime::transport::ros2
