// SPDX-License-Identifier: Apache-2.0
// rmw_fastrtps opens its participant with the default QoS of Fast DDS's factory, which is that of the default
// profile: so the link goes in there, on top of the user's own profiles.
#include <memory>

#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastrtps/xmlparser/XMLProfileManager.h>

#include "lead.hpp"
#include "transport/fastdds/log.hpp"
#include "transport/fastdds/profiles.hpp"

namespace ontime::transport::ros2 {
namespace {

namespace vendor = eprosima::fastdds::dds;

class FastLead final : public Lead {
 public:
  explicit FastLead(const fastdds::Profiles& profiles) {
    source = profiles.source;
    carrier = profiles.carrier;
    eprosima::fastrtps::xmlparser::XMLProfileManager::DeleteInstance();  // of an earlier end of this process
    auto& factory = *vendor::DomainParticipantFactory::get_instance();
    factory.load_profiles();  // that is, none: it does so once, and the RMW's call does nothing then
    const auto loaded = factory.load_XML_profiles_string(profiles.xml.data(), profiles.xml.size());
    if (loaded != ReturnCode_t::RETCODE_OK || !said().empty())
      throw Error("ros2: Fast DDS cannot use the profiles of " + source + ": " + said());
    factory.set_default_participant_qos(vendor::PARTICIPANT_QOS_DEFAULT);  // that is, the default profile
  }

  std::string said() override { return log_.text(); }

 private:
  fastdds::Log log_;
  const fastdds::NoFile no_file_;
};

}  // namespace
}  // namespace ontime::transport::ros2

extern "C" __attribute__((visibility("default"))) std::unique_ptr<ontime::transport::ros2::Lead> ontime_lead(
    const ontime::transport::Config& config) {
  using namespace ontime::transport;
  return std::make_unique<ros2::FastLead>(fastdds::profiles(config, "ros2"));
}
