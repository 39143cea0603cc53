// SPDX-License-Identifier: Apache-2.0
// Fast DDS prints by itself. While this lives, the output of all participants of this process is kept
// instead. One at a time in a process.
#pragma once

#include <memory>
#include <mutex>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <fastdds/dds/log/Log.hpp>

namespace ontime::transport::fastdds {

class Log {
 public:
  Log() {
    Vendor::SetVerbosity(Vendor::Kind::Error);
    Vendor::ClearConsumers();
    Vendor::RegisterConsumer(std::make_unique<Keeper>(said_));
  }
  ~Log() {
    Vendor::ClearConsumers();
    Vendor::KillThread();
  }
  Log(const Log&) = delete;
  Log& operator=(const Log&) = delete;

  // Of the categories that begin so.
  std::string text(std::string_view categories = "") {
    Vendor::Flush();
    std::string text;
    const std::lock_guard lock(said_.mutex);  // who is open already may say something meanwhile
    for (const auto& [category, message] : said_.entries)
      if (category.starts_with(categories)) text += (text.empty() ? "" : "; ") + message;
    return text;
  }

 private:
  using Vendor = eprosima::fastdds::dds::Log;
  struct Said {
    std::mutex mutex;
    std::vector<std::pair<std::string, std::string>> entries;
  };
  struct Keeper : eprosima::fastdds::dds::LogConsumer {
    explicit Keeper(Said& to) : said(to) {}
    void Consume(const Vendor::Entry& entry) override {
      const std::lock_guard lock(said.mutex);
      said.entries.emplace_back(entry.context.category, entry.message);
    }
    Said& said;
  };

  Said said_;
};

}  // namespace ontime::transport::fastdds
