// SPDX-License-Identifier: Apache-2.0
// The robot's own messages on this machine while a run is measured: runs of their own in the same results.
// A thread has the sensor; it touches neither the file nor the terminal. All else: ordinary thread.
#pragma once

#include <atomic>
#include <mutex>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "campaign/campaign.hpp"
#include "listen_results.hpp"

namespace ontime::app {

class ListenBeside {
 public:
  // Begins to look for the nodes.
  ListenBeside(record::Writer&, const campaign::Run&, const nlohmann::json& command_line);
  ListenBeside(const ListenBeside&) = delete;
  ListenBeside& operator=(const ListenBeside&) = delete;

  bool is_there() const;  // it judges every message from now on; throws campaign::Error if it failed
  void write();           // what arrived until now; call it often
  // Completes its runs. Returns remarks, such as on requested topics that were not seen.
  std::vector<std::string> end(bool interrupted);

 private:
  void listen(const std::stop_token&);
  listen::Findings wanted();  // the latest findings of the thread
  void keep_rows();

  const std::set<std::string> topics_;
  const listen::Limits limits_;
  ListenResults results_;
  std::atomic<bool> there_ = false;
  mutable std::mutex mutex_;  // of these three
  std::vector<listen::Row> rows_;
  listen::Findings findings_;
  std::string failure_;
  std::chrono::steady_clock::time_point write_at_;
  std::jthread thread_;  // last: it uses the rest
};

}  // namespace ontime::app
