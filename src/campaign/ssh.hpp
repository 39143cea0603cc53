// SPDX-License-Identifier: Apache-2.0
// Another machine by the system's own OpenSSH client, with its configuration, its keys and the hosts it
// knows. It never asks for a password, and no check of ssh's is switched off.
#pragma once

#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "orders/orders.hpp"

namespace ontime::campaign {

// One connection, for all that is started there: the first session's ssh opens it and holds it until the last
// session is over, however its coordinator ends; a folder of its own has the socket by which they share it.
class Ssh {
 public:
  // Connects to nothing yet. Throws Error.
  explicit Ssh(std::string destination);
  ~Ssh();
  Ssh(const Ssh&) = delete;
  Ssh& operator=(const Ssh&) = delete;

  // A command here that has the words run there, as one command and none of them split, by any shell
  // the user has there. The first session is to be there before another.
  std::vector<std::string> first(const std::vector<std::string>& there) const;
  std::vector<std::string> another(const std::vector<std::string>& there) const;

  // This user's alone; it goes with the connection, and all that is in it.
  const std::string& folder() const { return folder_; }

  // Why that command came to nothing, and what to do; `program` is ontime as it was called there.
  orders::Between between(const std::string& program) const;

 private:
  std::vector<std::string> command(const char* local_script, const char* sharing,
                                   const std::vector<std::string>& there) const;
  std::string destination_, folder_;
};

// The same, of the exit code and of what was said in place of events, by ssh or there. "" where neither
// tells.
std::string reason_of(const std::string& destination, const std::string& program, int code,
                      const std::string& said);

// Of what an agent said of the link by which it is reached (agent/agent.hpp): what a reader of the run should
// know. "" where that link is another than the one under test.
std::string note_of_ssh_link(const std::string& host, const nlohmann::json& link);

}  // namespace ontime::campaign
