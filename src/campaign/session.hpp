// SPDX-License-Identifier: Apache-2.0
// One run, on agents that live just for it.
#pragma once

#include "campaign/campaign.hpp"

namespace ontime::campaign {

struct Interrupted {};  // the second time, or before anything was measured

class Session {
 public:
  // `component`: where to start the server too; nothing if somebody else serves.
  Session(const Run&, const Host& controller, const std::optional<Host>& component);

  // Measures into the writer; returns the outcome for the record. Throws Error or Interrupted; what was
  // measured until then is in the writer.
  nlohmann::json measure(std::chrono::nanoseconds wait, std::int64_t number, record::Writer&, Observer&,
                         const Interrupts&);

 private:
  struct End {
    std::string host;
    agent::Handle agent;
    nlohmann::json opened, closed;
  };
  void open(End&, const agent::Task&, Observer&, const Interrupts&);
  nlohmann::json pump(std::int64_t number, record::Writer&, Observer&, const Interrupts&);
  // Throws Interrupted once there are more interruptions than are tolerated.
  static nlohmann::json await(End&, const std::string& event, const Interrupts&, int tolerated = 0);

  const Run& run_;
  Host controller_host_;
  std::optional<Host> component_host_;
  std::optional<End> controller_, component_;
};

// The server's part of a run.
agent::Task server_task(const Run&, const Host&);

}  // namespace ontime::campaign
