// SPDX-License-Identifier: Apache-2.0
// What limits this process, and how to permit it more: the words of refusals.
#pragma once

#include <string>

namespace ontime::realtime {

bool capable(int capability);        // in the effective set of this thread; a CAP_ of <linux/capability.h>
std::string limit_of(int resource);  // "0", "unlimited"
std::string message_of(int error);   // "Operation not permitted"
// For a service by its unit, for a login by limits.d.
std::string how_to_permit(int priority = 0);
// The lines of the unit, by the texts of /proc/PID/environ and cgroup; "" where it is no service of the
// system.
std::string how_to_permit_service(const std::string& environment, const std::string& cgroup,
                                  int priority = 0);
std::string how_to_permit_capabilities();  // where no limit would do
// The file with this process's budget of real-time CPU time if that is zero (cgroup v1), or "".
std::string file_of_empty_realtime_budget();

}  // namespace ontime::realtime
