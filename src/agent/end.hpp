// SPDX-License-Identifier: Apache-2.0
// One end of one run, from `open` on: what it was given, and the account of what its threads, its link and
// its middleware did between begin() and ended().
#pragma once

#include <istream>
#include <map>
#include <memory>
#include <set>
#include <vector>

#include "agent/agent.hpp"
#include "machine/machine.hpp"
#include "realtime/realtime.hpp"
#include "record/outcome.hpp"

namespace ontime::agent {

class End {
 public:
  explicit End(Task);  // throws orders::Error, or what the transport throws

  roundtrip::Client* client() { return client_.get(); }                    // null at the server's end
  roundtrip::Server* server() { return server_.get(); }                    // null at the client's end
  roundtrip::BackgroundTopics* background() { return background_.get(); }  // null without background topics
  // The measured endpoint; in a process with background topics only, one of theirs.
  transport::Endpoint& endpoint() {
    return client_ ? client_->endpoint() : server_ ? server_->endpoint() : background_->endpoint();
  }
  const Task& task() const { return task_; }
  void drop_privileges();  // those that an open end no longer needs
  record::Host opened();

  // Called again once peers have matched, because a middleware may start threads at any time.
  void set_threads();
  void begin();
  record::Host ended();  // without what the keeper knows

 private:
  void open();
  std::vector<transport::Thread> threads();
  void set_thread_of_background(const transport::Thread&);
  void refuse(const std::vector<realtime::Refusal>&);
  record::Thread during(const transport::Thread&, const realtime::ThreadState& now) const;
  record::Losses losses();
  std::uint64_t answered() const;
  record::Link link() const;

  Task task_;
  std::unique_ptr<realtime::CpuLatencyRequest> latency_;
  const transport::Plugin* plugin_ = nullptr;
  std::unique_ptr<roundtrip::Client> client_;
  std::unique_ptr<roundtrip::Server> server_;
  std::unique_ptr<roundtrip::BackgroundTopics> background_;  // beside one of these, or alone
  std::set<pid_t> set_;
  std::vector<record::Refusal> refusals_;
  std::map<pid_t, realtime::ThreadState> before_;
  std::map<pid_t, realtime::InstructionCounter> instructions_;
  transport::Losses losses_before_;
  std::uint64_t answered_before_ = 0;
  std::optional<machine::Traffic> traffic_before_;
  machine::Drops drops_before_;
  std::vector<machine::GroupQuota> quotas_before_;
  std::unique_ptr<machine::LinkWatch> link_watch_;  // null: of no interface
};

// From the text of /proc/meminfo and the limit of the control group: why there is too little memory for an
// end with locked memory; "": there is enough. Many components could use all memory, and then the kernel
// kills any process.
std::string lacks_memory(std::istream& meminfo, const std::optional<machine::GroupMemory>&);

// Why an end cannot use an interface without an IPv4 address. `master`: the bridge or bond that it is a port
// of, whose address is then its own, or "".
std::string lacks_address(const std::string& interface, const std::string& master,
                          const std::vector<machine::Interface>& all);

}  // namespace ontime::agent
