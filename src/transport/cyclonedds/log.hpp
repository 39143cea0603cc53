// SPDX-License-Identifier: Apache-2.0
// Cyclone DDS prints by itself. While this lives, its output is kept for an error; later it is silent. What
// it prints before it aborts is always shown.
#pragma once

#include <cstdio>
#include <mutex>
#include <string>

#include <dds/dds.h>

#include "transport/cyclonedds/configuration.hpp"

namespace ontime::transport::cyclonedds {

class Log {
 public:
  Log() { dds_set_log_sink(keep, this); }
  ~Log() { dds_set_log_sink(drop, nullptr); }
  Log(const Log&) = delete;
  Log& operator=(const Log&) = delete;

  std::string text() {
    const std::lock_guard lock(mutex_);
    while (text_.ends_with('\n') || text_.ends_with(' ')) text_.pop_back();
    return legible(text_);
  }

 private:
  static void drop(void*, const dds_log_data_t* entry) {
    if (entry->priority & DDS_LC_FATAL) std::fwrite(entry->message, 1, entry->size, stderr);
  }
  static void keep(void* self, const dds_log_data_t* entry) {
    drop(nullptr, entry);
    auto& log = *static_cast<Log*>(self);
    const std::lock_guard lock(log.mutex_);
    log.text_ += std::string(entry->message, entry->size) + " ";
  }

  std::mutex mutex_;
  std::string text_;
};

}  // namespace ontime::transport::cyclonedds
