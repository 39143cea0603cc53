// SPDX-License-Identifier: Apache-2.0
// Cyclone DDS takes its configuration from the environment, so ours goes there, the user's merged in.
#include <cstdio>
#include <mutex>

#include <dds/dds.h>

#include "environment.hpp"
#include "lead.hpp"
#include "transport/cyclonedds/configuration.hpp"

namespace ontime::transport::ros2 {
namespace {

class CycloneLead final : public Lead {
 public:
  explicit CycloneLead(const cyclonedds::Configuration& configuration)
      : uri_("CYCLONEDDS_URI", configuration.xml) {
    source = configuration.source;
    carrier = configuration.carrier;
    dds_set_log_sink(keep, this);
  }
  ~CycloneLead() override { dds_set_log_sink(drop, nullptr); }

  std::string said() override {
    const std::lock_guard lock(mutex_);
    while (said_.ends_with('\n') || said_.ends_with(' ')) said_.pop_back();
    return cyclonedds::legible(said_);
  }

 private:
  // Cyclone prints by itself, which is kept while a node opens and not wanted later. Before it aborts it must
  // be heard.
  static void drop(void*, const dds_log_data_t* entry) {
    if (entry->priority & DDS_LC_FATAL) std::fwrite(entry->message, 1, entry->size, stderr);
  }
  static void keep(void* self, const dds_log_data_t* entry) {
    drop(nullptr, entry);
    auto& lead = *static_cast<CycloneLead*>(self);
    const std::lock_guard lock(lead.mutex_);
    lead.said_ += std::string(entry->message, entry->size) + " ";
  }

  Variable uri_;
  std::mutex mutex_;
  std::string said_;
};

}  // namespace
}  // namespace ontime::transport::ros2

extern "C" __attribute__((visibility("default"))) std::unique_ptr<ontime::transport::ros2::Lead> ontime_lead(
    const ontime::transport::Config& config) {
  return std::make_unique<ontime::transport::ros2::CycloneLead>(
      ontime::transport::cyclonedds::configuration(config));
}
