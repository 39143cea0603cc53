// SPDX-License-Identifier: Apache-2.0
// What limits this process, and how to permit it more: the words of refusals.
#pragma once

#include <string>

namespace ontime::realtime {

// What a process may do to the machine, by the texts of its /proc/PID/status and uid_map. A user namespace
// other than the first, as of a rootless container, grants nothing of that.
struct Privileges {
  std::string status, uid_map;
  bool is_of_first_namespace() const;
  bool is_root() const;
  bool has(int capability) const;  // a CAP_ of <linux/capability.h>
  // Whether only a container that is started in another way can have it: it is root already, or neither sudo
  // nor setcap gives it.
  bool is_final_without(int capability) const;
  std::string lack_of(const char* name) const;  // "no CAP_SYS_NICE"
};
Privileges privileges();  // of this thread

bool capable(int capability);        // in the effective set of this thread, in whichever user namespace
std::string limit_of(int resource);  // "0", "unlimited"
std::string message_of(int error);   // "Operation not permitted"
// For a service by its unit, for a login by limits.d.
std::string how_to_permit(int priority = 0);
// The lines of the unit, by the texts of /proc/PID/environ and cgroup; "" where it is no service of the
// system.
std::string how_to_permit_service(const std::string& environment, const std::string& cgroup,
                                  int priority = 0);
std::string how_to_permit_capabilities();  // where no limit would do
// By the options of docker, where a login's limits and setcap are of no use; "" elsewhere.
std::string how_to_permit_container(const Privileges&);
// For what root may do on a machine; "" where sudo is enough.
std::string how_to_be_root_in_container(const Privileges&);
// The file with this process's budget of real-time CPU time if that is zero (cgroup v1), or "".
std::string file_of_empty_realtime_budget();

}  // namespace ontime::realtime
