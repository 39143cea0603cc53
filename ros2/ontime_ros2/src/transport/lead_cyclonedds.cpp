// SPDX-License-Identifier: Apache-2.0
// Cyclone DDS takes its configuration from the environment, so ours goes there, the user's merged in.
#include <memory>

#include "lead.hpp"
#include "transport/cyclonedds/configuration.hpp"
#include "transport/cyclonedds/log.hpp"
#include "transport/dds.hpp"

namespace ontime::transport::ros2 {
namespace {

class CycloneLead final : public Lead {
 public:
  explicit CycloneLead(const cyclonedds::Configuration& configuration)
      : uri_("CYCLONEDDS_URI", configuration.xml) {
    source = configuration.source;
    carrier = configuration.carrier;
  }

  std::string said() override { return log_.text(); }

 private:
  dds::Override uri_;
  cyclonedds::Log log_;
};

}  // namespace
}  // namespace ontime::transport::ros2

extern "C" __attribute__((visibility("default"))) std::unique_ptr<ontime::transport::ros2::Lead> ontime_lead(
    const ontime::transport::Config& config) {
  return std::make_unique<ontime::transport::ros2::CycloneLead>(
      ontime::transport::cyclonedds::configuration(config));
}
