// SPDX-License-Identifier: Apache-2.0
// Reaches another machine with the system's OpenSSH client, its configuration, keys and known hosts. It never
// asks for a password, and switches off no check of ssh.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "orders/orders.hpp"
#include "record/outcome.hpp"

namespace ontime::campaign {

// One connection for all processes there: the ssh of the first session opens it and holds it until the last
// session is over, however its coordinator ends. The sessions share it by a socket in a private folder.
class Ssh {
 public:
  // Connects to nothing yet. Throws Error.
  explicit Ssh(std::string destination);
  ~Ssh();
  Ssh(const Ssh&) = delete;
  Ssh& operator=(const Ssh&) = delete;

  // A local command that runs these words there as one command; no shell there splits a word. first() must
  // run before another().
  std::vector<std::string> first(const std::vector<std::string>& there) const;
  std::vector<std::string> another(const std::vector<std::string>& there) const;

  // Only this user can access it; it is removed with the connection.
  const std::string& folder() const { return folder_; }

  // Why that command failed, and what to do. `program`: ontime as called there; `prefix`: the words before
  // it; `shown`: the whole command as the user knows it.
  orders::Between between(const std::string& program, const std::vector<std::string>& prefix,
                          const std::string& shown) const;

 private:
  std::vector<std::string> command(const char* local_script, const char* sharing,
                                   const std::vector<std::string>& there) const;
  std::string destination_, folder_;
};

// The exit code of such a command where this machine has no ssh client.
inline constexpr int no_ssh_here = 125;
// Options that a user's ssh configuration may set otherwise, and that would break a worker's pipe. A dead
// link is detected as fast as a silent worker. Of an option that is stated twice, ssh takes the first.
const std::vector<std::string>& ssh_options();
// What ssh says of a destination that can be none.
inline constexpr const char* ssh_invalid = "contains invalid characters";
// As Between::reason: from the exit code and from output that is not an event. "" if unknown.
std::string reason_of(const std::string& destination, const std::string& program, int code,
                      const std::string& said);

// How a scenario says that it is root there: "pw@c1" → "ssh: root@c1".
std::string by_root(const std::string& destination);
// Why the words before the command (`sudo`) did not start it; "" if unknown. `destination`: "": this machine.
std::string reason_of_prefix(const std::string& destination, const std::vector<std::string>& prefix,
                             int code);

// A note for the record if ssh uses, or may use, the link under test; else "".
std::string note_of_ssh_link(const std::string& host, const std::optional<record::SshLink>&);

}  // namespace ontime::campaign
