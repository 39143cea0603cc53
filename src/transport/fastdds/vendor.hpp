// SPDX-License-Identifier: Apache-2.0
// Fast DDS 2 and 3, where they name or declare the same thing differently.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/domain/DomainParticipantListener.hpp>
#include <fastdds/dds/subscriber/qos/DataReaderQos.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>

#include "transport/fastdds/profiles.hpp"

#if __has_include(<fastdds/config.hpp>)
#include <fastdds/config.hpp>
#include <fastdds/utils/IPFinder.hpp>
#include <fastdds/utils/IPLocator.hpp>

// The library has this, but no header: without it, profiles of an earlier end of this process stay.
namespace eprosima::fastdds::xmlparser {
struct XMLProfileManager {
  static void DeleteInstance();
};
}  // namespace eprosima::fastdds::xmlparser
#else
#define ONTIME_FASTDDS_2
#include <fastrtps/config.h>
#include <fastrtps/utils/IPFinder.h>
#include <fastrtps/utils/IPLocator.h>
#include <fastrtps/xmlparser/XMLProfileManager.h>
#endif

namespace ontime::transport::fastdds {

namespace vendor = eprosima::fastdds::dds;
#ifdef ONTIME_FASTDDS_2
namespace rtps = eprosima::fastrtps::rtps;
using XmlProfiles = eprosima::fastrtps::xmlparser::XMLProfileManager;
using eprosima::fastrtps::c_TimeInfinite;
constexpr auto done = eprosima::fastrtps::types::ReturnCode_t::RETCODE_OK;
constexpr const char* vendor_version = FASTRTPS_VERSION_STR;
constexpr Names vendor_names = names_of_2;
inline auto& representation_of(vendor::DataReaderQos& qos) { return qos.type_consistency().representation; }
#else
namespace rtps = eprosima::fastdds::rtps;
using XmlProfiles = eprosima::fastdds::xmlparser::XMLProfileManager;
using vendor::c_TimeInfinite;
constexpr auto done = vendor::RETCODE_OK;
constexpr const char* vendor_version = FASTDDS_VERSION_STR;
constexpr Names vendor_names = names_of_3;
inline auto& representation_of(vendor::DataReaderQos& qos) { return qos.representation(); }
#endif

// A type of messages that is matched by its name alone, like rclcpp's. Samples are ours, never Fast DDS's.
// Each message calls static functions of `Of`, which the compiler can inline:
//   bool write(const void* sample, rtps::SerializedPayload_t& to);
//   bool read(const rtps::SerializedPayload_t& from, void* sample);
//   std::uint32_t bytes_of(const void* sample);
template <typename Of>
class Type : public vendor::TopicDataType {
 public:
  Type(const std::string& name, std::size_t max_bytes, bool has_key) {
    const auto bytes = static_cast<std::uint32_t>(max_bytes);
#ifdef ONTIME_FASTDDS_2
    setName(name.c_str());
    m_typeSize = bytes;
    m_isGetKeyDefined = has_key;
    auto_fill_type_object(false);
    auto_fill_type_information(false);
#else
    set_name(name);
    max_serialized_type_size = bytes;
    is_compute_key_provided = has_key;
#endif
  }

 private:
  // All instances are one: none is kept for its own sake.
  static bool key(rtps::InstanceHandle_t& to) {
    to.value[0] = 1;
    return true;
  }

#ifdef ONTIME_FASTDDS_2
  bool serialize(void* sample, rtps::SerializedPayload_t* to) final { return Of::write(sample, *to); }
  bool deserialize(rtps::SerializedPayload_t* from, void* sample) final { return Of::read(*from, sample); }
  std::function<std::uint32_t()> getSerializedSizeProvider(void* sample) final {
    return [sample] { return Of::bytes_of(sample); };
  }
  void* createData() final { return nullptr; }
  void deleteData(void*) final {}
  bool getKey(void*, rtps::InstanceHandle_t* to, bool) final { return key(*to); }
#else
  using Representation = vendor::DataRepresentationId_t;
  bool serialize(const void* sample, rtps::SerializedPayload_t& to, Representation) final {
    return Of::write(sample, to);
  }
  bool deserialize(rtps::SerializedPayload_t& from, void* sample) final { return Of::read(from, sample); }
  std::uint32_t calculate_serialized_size(const void* sample, Representation) final {
    return Of::bytes_of(sample);
  }
  void* create_data() final { return nullptr; }
  void delete_data(void*) final {}
  bool compute_key(rtps::SerializedPayload_t&, rtps::InstanceHandle_t& to, bool) final { return key(to); }
  bool compute_key(const void*, rtps::InstanceHandle_t& to, bool) final { return key(to); }
#endif
};

// What is known of a reader or a writer of another participant.
struct Described {
  std::string topic, type;
  bool has_key = false, is_exclusive = false;
  std::vector<std::string> partitions;
  auto operator<=>(const Described&) const = default;  // NOLINT(modernize-use-nullptr): it means <=> 0
};

// Hears what is discovered, on threads of Fast DDS's, which holds its locks meanwhile.
class Discovery : public vendor::DomainParticipantListener {
 private:
  // It is here or has gone; `at` are the addresses of its user's messages.
  virtual void note_participant(const vendor::DomainParticipant& self, const rtps::GUID_t&, bool is_here,
                                const rtps::RemoteLocatorList& at) = 0;
  virtual void note_reader(Described&&) {}
  virtual void note_writer(Described&&) = 0;

#ifdef ONTIME_FASTDDS_2
  void on_participant_discovery(vendor::DomainParticipant* self,
                                rtps::ParticipantDiscoveryInfo&& found) final {
    using Info = rtps::ParticipantDiscoveryInfo;
    note_participant(*self, found.info.m_guid,
                     found.status != Info::REMOVED_PARTICIPANT && found.status != Info::DROPPED_PARTICIPANT,
                     found.info.default_locators);
  }
  void on_subscriber_discovery(vendor::DomainParticipant*, rtps::ReaderDiscoveryInfo&& found) final {
    if (found.status == rtps::ReaderDiscoveryInfo::DISCOVERED_READER) note_reader(described(found.info));
  }
  void on_publisher_discovery(vendor::DomainParticipant*, rtps::WriterDiscoveryInfo&& found) final {
    if (found.status == rtps::WriterDiscoveryInfo::DISCOVERED_WRITER) note_writer(described(found.info));
  }
  template <typename Info>
  static Described described(const Info& info) {
    return described(info.topicName().to_string(), info.typeName().to_string(), info.topicKind(),
                     info.m_qos.m_ownership, info.m_qos.m_partition);
  }
#else
  void on_participant_discovery(vendor::DomainParticipant* self, rtps::ParticipantDiscoveryStatus status,
                                const vendor::ParticipantBuiltinTopicData& info, bool&) final {
    using Status = rtps::ParticipantDiscoveryStatus;
    note_participant(*self, info.guid,
                     status != Status::REMOVED_PARTICIPANT && status != Status::DROPPED_PARTICIPANT,
                     info.default_locators);
  }
  void on_data_reader_discovery(vendor::DomainParticipant*, rtps::ReaderDiscoveryStatus status,
                                const vendor::SubscriptionBuiltinTopicData& info, bool&) final {
    if (status == rtps::ReaderDiscoveryStatus::DISCOVERED_READER) note_reader(described(info));
  }
  void on_data_writer_discovery(vendor::DomainParticipant*, rtps::WriterDiscoveryStatus status,
                                const vendor::PublicationBuiltinTopicData& info, bool&) final {
    if (status == rtps::WriterDiscoveryStatus::DISCOVERED_WRITER) note_writer(described(info));
  }
  template <typename Info>
  static Described described(const Info& info) {
    return described(info.topic_name.to_string(), info.type_name.to_string(), info.topic_kind, info.ownership,
                     info.partition);
  }
#endif
  static Described described(const std::string& topic, const std::string& type, rtps::TopicKind_t kind,
                             const vendor::OwnershipQosPolicy& ownership,
                             const vendor::PartitionQosPolicy& partitions) {
    Described found{.topic = topic,
                    .type = type,
                    .has_key = kind == rtps::WITH_KEY,
                    .is_exclusive = ownership.kind == vendor::EXCLUSIVE_OWNERSHIP_QOS,
                    .partitions = {}};
    for (auto one = partitions.begin(); one != partitions.end(); ++one)
      found.partitions.emplace_back(one->name());
    return found;
  }
};

}  // namespace ontime::transport::fastdds
