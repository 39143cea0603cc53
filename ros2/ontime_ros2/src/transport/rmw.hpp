// SPDX-License-Identifier: Apache-2.0
// Which RMW this process has. librcl ends the process when it is loaded while what was asked and what loads
// differ, so all that is settled here before.
#pragma once

#include <string>

namespace ontime::transport::ros2 {

// Loads the RMW of that name (empty: as the environment has it, and else as ROS 2 chooses), and returns what
// is now loaded. For good: a process keeps its first one. Throws Error where it is not installed, does not
// load, or is not what was asked for here or by the environment.
std::string load_rmw(const std::string& asked);

}  // namespace ontime::transport::ros2
