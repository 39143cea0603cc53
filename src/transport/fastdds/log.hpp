// SPDX-License-Identifier: Apache-2.0
// Fast DDS prints by itself. As long as this lives it prints nothing, and what it would have said is kept.
// One at a time in a process.
#pragma once

#include <memory>
#include <string>

#include <fastdds/dds/log/Log.hpp>

namespace ontime::transport::fastdds {

class Log {
 public:
  Log() {
    Vendor::SetVerbosity(Vendor::Kind::Error);
    Vendor::ClearConsumers();
    Vendor::RegisterConsumer(std::make_unique<Keeper>(text_));
  }
  ~Log() {
    Vendor::ClearConsumers();
    Vendor::KillThread();
  }
  Log(const Log&) = delete;
  Log& operator=(const Log&) = delete;

  std::string text() {
    Vendor::Flush();
    return text_;
  }

 private:
  using Vendor = eprosima::fastdds::dds::Log;
  struct Keeper : eprosima::fastdds::dds::LogConsumer {
    explicit Keeper(std::string& to) : text(to) {}
    void Consume(const Vendor::Entry& entry) override { text += (text.empty() ? "" : "; ") + entry.message; }
    std::string& text;
  };

  std::string text_;
};

}  // namespace ontime::transport::fastdds
