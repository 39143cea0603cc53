// SPDX-License-Identifier: Apache-2.0
// What the user may choose of rclcpp.
#pragma once

#include <string>

#include "transport/transport.hpp"

namespace ontime::transport::ros2 {

enum class Executor { single, multi, events, waitset, wait };
enum class Allocator { standard, tlsf, pmr };

struct Options {
  Executor executor;
  Allocator allocator = Allocator::standard;
  std::string rmw;  // empty: as the environment has it, and else as ROS 2 chooses
  bool intra_process = false;
  bool loaned = false;
  bool statistics = true;
  std::string node;
};

// Of the options of a Config that has only known ones. Throws WrongInput.
Options options_of(const Config& config);
// Of background topics, which are ordinary whatever the critical one has of its own.
Options options_beside(Options);

const char* word_of(Executor executor);
const char* word_of(Allocator allocator);

}  // namespace ontime::transport::ros2
