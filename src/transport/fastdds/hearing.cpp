// SPDX-License-Identifier: Apache-2.0
// Reads topics of any type as an additional best-effort reader of each writer, which delays no writer.
#include "transport/fastdds/hearing.hpp"

#include <algorithm>
#include <map>
#include <mutex>

#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>

#include "transport/fastdds/log.hpp"
#include "transport/fastdds/vendor.hpp"

namespace ontime::transport::fastdds {
namespace {

using vendor::StatusMask;

constexpr std::size_t most_waiting = 1 << 20;  // messages between two calls of take()

// It reads no byte of a message: its arrival time and number are in the sample's information.
class AnyType final : public Type<AnyType> {
 public:
  // A message may be larger: its memory is had when it comes.
  AnyType(const std::string& name, bool has_key) : Type(name, 4096, has_key) {}

  static bool write(const void*, rtps::SerializedPayload_t&) { return false; }
  static bool read(const rtps::SerializedPayload_t&, void*) { return true; }
  static std::uint32_t bytes_of(const void*) { return 0; }
};

std::string ros_name(const std::string& topic) { return topic.starts_with("rt/") ? topic.substr(2) : topic; }

// One of another vendor shows by its addresses; one of Fast DDS by its GUID, if it has no more than shared
// memory.
bool is_of_this_machine(const rtps::RemoteLocatorList& locators) {
  std::vector<rtps::IPFinder::info_IP> own;
  rtps::IPFinder::getIPs(&own, true);
  return std::any_of(locators.unicast.begin(), locators.unicast.end(), [&](const rtps::Locator_t& locator) {
    return std::any_of(own.begin(), own.end(), [&](const auto& one) {
      return one.locator.kind == locator.kind && rtps::IPLocator::compareAddress(one.locator, locator, true);
    });
  });
}

class FastHearing final : public Hearing, Discovery {
 public:
  FastHearing(int domain, const std::set<std::string>& topics);
  ~FastHearing() override {
    participant_->delete_contained_entities();
    vendor::DomainParticipantFactory::get_instance()->delete_participant(participant_);
  }
  FastHearing(const FastHearing&) = delete;
  FastHearing& operator=(const FastHearing&) = delete;

  void take(const std::function<void(const Heard&)>&) override;
  std::vector<std::string> remarks() override;

 private:
  struct Message {
    Heard heard;
    std::string topic;
  };
  void note_participant(const vendor::DomainParticipant&, const rtps::GUID_t&, bool is_here,
                        const rtps::RemoteLocatorList& at) override;
  void note_writer(Described&&) override;
  void on_data_available(vendor::DataReader*) override;
  void open_reader(const Described&);

  const int domain_;
  const std::set<std::string> topics_;
  vendor::DomainParticipant* participant_ = nullptr;
  std::map<std::string, std::string> types_;  // of topics that are read
  std::set<Described> read_;
  std::vector<std::string> remarks_;
  std::mutex mutex_;                                 // what follows, Fast DDS's threads write
  std::map<rtps::GuidPrefix_t, bool> participants_;  // whether they are of this machine
  std::set<Described> found_;
  std::vector<Message> messages_;
  std::uint64_t left_out_ = 0;
};

FastHearing::FastHearing(int domain, const std::set<std::string>& topics) : domain_(domain), topics_(topics) {
  Log log;
  auto qos = vendor::PARTICIPANT_QOS_DEFAULT;
  qos.name("ontime listen");
  participant_ = vendor::DomainParticipantFactory::get_instance()->create_participant(
      static_cast<vendor::DomainId_t>(domain), qos, this, StatusMask::none());
  if (participant_ == nullptr)
    throw Error("fastdds: cannot join domain " + std::to_string(domain) + ": " + log.text());
}

void FastHearing::note_participant(const vendor::DomainParticipant& self, const rtps::GUID_t& guid,
                                   bool is_here, const rtps::RemoteLocatorList& at) {
  if (!is_here) return;
  const bool is_ours = guid.is_on_same_host_as(self.guid()) || is_of_this_machine(at);
  const std::lock_guard lock(mutex_);
  participants_[guid.guidPrefix] = is_ours;
}

void FastHearing::note_writer(Described&& writer) {
  if (!topics_.contains(ros_name(writer.topic))) return;
  const std::lock_guard lock(mutex_);
  found_.insert(std::move(writer));
}

// On a thread of the caller's: Fast DDS holds its locks while it tells of a discovery.
void FastHearing::open_reader(const Described& kind) {
  const auto cannot = [&](const std::string& why) {
    remarks_.push_back(ros_name(kind.topic) + ": messages of type " + kind.type + " are not read: " + why);
  };
  const auto [known, is_new] = types_.try_emplace(kind.topic, kind.type);
  if (known->second != kind.type) return cannot("other writers of this topic have the type " + known->second);
  Log log;
  if (participant_->find_type(kind.type).empty())
    vendor::TypeSupport(new AnyType(kind.type, kind.has_key)).register_type(participant_);
  auto* topic = is_new ? participant_->create_topic(kind.topic, kind.type, vendor::TOPIC_QOS_DEFAULT)
                       : participant_->find_topic(kind.topic, {0, 0});
  vendor::SubscriberQos in = vendor::SUBSCRIBER_QOS_DEFAULT;
  for (const auto& partition : kind.partitions) in.partition().push_back(partition.c_str());
  auto* const subscriber = participant_->create_subscriber(in);
  if (topic == nullptr || subscriber == nullptr) return cannot(log.text());
  auto qos = vendor::DATAREADER_QOS_DEFAULT;
  qos.reliability().kind = vendor::BEST_EFFORT_RELIABILITY_QOS;
  qos.history().kind = vendor::KEEP_LAST_HISTORY_QOS;
  qos.history().depth = 1000;
  qos.resource_limits().max_samples_per_instance = 1000;
  qos.ownership().kind = kind.is_exclusive ? vendor::EXCLUSIVE_OWNERSHIP_QOS : vendor::SHARED_OWNERSHIP_QOS;
  qos.endpoint().history_memory_policy = rtps::DYNAMIC_RESERVE_MEMORY_MODE;
  representation_of(qos).m_value = {vendor::XCDR_DATA_REPRESENTATION, vendor::XCDR2_DATA_REPRESENTATION};
  qos.data_sharing().off();
  if (subscriber->create_datareader(topic, qos, this, StatusMask::data_available()) == nullptr)
    cannot(log.text());
}

void FastHearing::on_data_available(vendor::DataReader* reader) {
  char nothing = 0;
  vendor::SampleInfo info;
  const auto topic = reader->get_topicdescription()->get_name();
  while (reader->take_next_sample(&nothing, &info) == done) {
    if (!info.valid_data) continue;
    timespec now{};
    clock_gettime(CLOCK_REALTIME, &now);
    Message message{{.topic = {},
                     .sequence = info.sample_identity.sequence_number().to64long(),
                     .stamp_ns = info.source_timestamp.to_ns(),
                     .at_ns = std::int64_t{now.tv_sec} * 1'000'000'000 + now.tv_nsec},
                    topic};
    const rtps::GUID_t& writer = info.sample_identity.writer_guid();
    auto* const to = message.heard.writer.data();
    std::copy_n(writer.guidPrefix.value, rtps::GuidPrefix_t::size, to);
    std::copy_n(writer.entityId.value, rtps::EntityId_t::size, to + rtps::GuidPrefix_t::size);
    const std::lock_guard lock(mutex_);
    if (messages_.size() == most_waiting) {
      ++left_out_;
      continue;
    }
    const auto participant = participants_.find(writer.guidPrefix);
    message.heard.is_one_host = participant != participants_.end() && participant->second;
    messages_.push_back(std::move(message));
  }
}

void FastHearing::take(const std::function<void(const Heard&)>& hear) {
  std::vector<Message> messages;
  std::set<Described> found;
  {
    const std::lock_guard lock(mutex_);
    messages.swap(messages_);
    found.swap(found_);
  }
  for (const auto& kind : found)
    if (read_.insert(kind).second) open_reader(kind);
  for (auto& [heard, topic] : messages) {
    heard.topic = topic;
    hear(heard);
  }
}

std::vector<std::string> FastHearing::remarks() {
  auto remarks = remarks_;
  const std::lock_guard lock(mutex_);
  if (left_out_ > 0)
    remarks.push_back(std::to_string(left_out_) + " messages were not counted: they came too fast");
  if (participants_.empty())
    remarks.push_back("no other DDS participant found in domain " + std::to_string(domain_) +
                      ". Check: ROS_DOMAIN_ID of the robot, firewalls, multicast, DDS Security");
  return remarks;
}

}  // namespace

std::unique_ptr<Hearing> hear(int domain, const std::set<std::string>& topics) {
  return std::make_unique<FastHearing>(domain, topics);
}

}  // namespace ontime::transport::fastdds
