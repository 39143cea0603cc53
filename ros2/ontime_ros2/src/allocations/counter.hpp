// SPDX-License-Identifier: Apache-2.0
// Counts what is allocated in this program, by the layer whose code asks for it.
#pragma once

#include <array>
#include <cstdint>

namespace ontime::allocations {

enum class Layer { ontime, rclcpp, rcl_and_rmw, rmw_implementation, dds, type_support, other };
inline constexpr std::array<const char*, 7> layer_names{
    "ontime", "rclcpp", "rcl and rmw", "RMW implementation", "DDS", "type support and CDR", "other"};
using Counts = std::array<std::uint64_t, layer_names.size()>;

// Between the two every malloc, calloc and realloc, and operator new above them, of any thread is counted.
// The layer is that of the nearest caller that is not the C or C++ library. Code of rclcpp's templates that
// the compiler put into ontime's objects is rclcpp's.
void arm();
Counts disarm();

}  // namespace ontime::allocations
