// SPDX-License-Identifier: Apache-2.0
// A plain Fast DDS program with its own account of each message, as listen_node is for Cyclone DDS:
//   listen_fastdds_node publish TOPIC COUNT PERIOD_US LOG
//   listen_fastdds_node take TOPIC DEPTH PERIOD_US LOG       by take(), 32 at most
//   listen_fastdds_node next TOPIC DEPTH PERIOD_US LOG       by take_next_sample()
//   listen_fastdds_node relay TOPIC EVERY 0 LOG TO           by take_next_sample(), publishes on topic TO
// What it does wrong meanwhile: fault.hpp.
// It uses the DDS domain that the environment names (LISTEN_NODE_DOMAIN), on the loopback interface and in
// shared memory.
#include <cstddef>
#include <cstdlib>
#include <cstring>
#include <string>

#include <fastdds/dds/core/LoanableSequence.hpp>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <fastdds/rtps/transport/shared_mem/SharedMemTransportDescriptor.h>
#include <fastrtps/utils/IPLocator.h>

#include "account.hpp"
#include "listen/event.h"

namespace {

namespace vendor = eprosima::fastdds::dds;
namespace rtps = eprosima::fastrtps::rtps;

// What the probes expect of this version.
static_assert(sizeof(vendor::SampleInfo::sample_state) == 2);
static_assert(offsetof(ontime_fastdds_info, seconds) == offsetof(vendor::SampleInfo, source_timestamp));
static_assert(offsetof(ontime_fastdds_info, is_valid) == offsetof(vendor::SampleInfo, valid_data));
static_assert(offsetof(ontime_fastdds_info, writer) == offsetof(vendor::SampleInfo, sample_identity));

struct Message {
  std::uint64_t number = 0;
  std::uint8_t payload[56] = {};
};

class Type final : public vendor::TopicDataType {
 public:
  Type() {
    setName("listen_test::Message");
    m_typeSize = sizeof(Message) + 4;
  }
  bool serialize(void* from, rtps::SerializedPayload_t* to) override {
    to->encapsulation = CDR_LE;
    std::memcpy(to->data, "\0\1\0\0", 4);
    std::memcpy(to->data + 4, from, sizeof(Message));
    to->length = sizeof(Message) + 4;
    return true;
  }
  bool deserialize(rtps::SerializedPayload_t* from, void* to) override {
    if (from->length != sizeof(Message) + 4) return false;
    std::memcpy(to, from->data + 4, sizeof(Message));
    return true;
  }
  std::function<std::uint32_t()> getSerializedSizeProvider(void*) override {
    return [] { return static_cast<std::uint32_t>(sizeof(Message) + 4); };
  }
  void* createData() override { return new Message; }
  void deleteData(void* message) override { delete static_cast<Message*>(message); }
  bool getKey(void*, rtps::InstanceHandle_t*, bool) override { return false; }
};

template <class Entity>
Entity& checked(Entity* entity, const char* what) {
  if (entity != nullptr) return *entity;
  std::fprintf(stderr, "listen_fastdds_node: no %s\n", what);
  std::exit(3);
}

vendor::DomainParticipant& make_participant() {
  auto qos = vendor::PARTICIPANT_QOS_DEFAULT;
  const auto loopback = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
  loopback->interfaceWhiteList.emplace_back("127.0.0.1");
  qos.transport().use_builtin_transports = false;
  qos.transport().user_transports = {
      loopback, std::make_shared<eprosima::fastdds::rtps::SharedMemTransportDescriptor>()};
  rtps::Locator_t peer;
  rtps::IPLocator::setIPv4(peer, "127.0.0.1");
  qos.wire_protocol().builtin.initialPeersList.push_back(peer);
  const char* const domain =
      std::getenv("LISTEN_NODE_DOMAIN");  // NOLINT(concurrency-mt-unsafe): before any thread
  return checked(
      vendor::DomainParticipantFactory::get_instance()->create_participant(
          domain == nullptr ? 0 : static_cast<std::uint32_t>(std::strtoul(domain, nullptr, 10)), qos),
      "participant");
}

vendor::DataWriter& make_writer(vendor::DomainParticipant& participant, const char* topic) {
  auto& publisher = checked(participant.create_publisher(vendor::PUBLISHER_QOS_DEFAULT), "publisher");
  auto qos = vendor::DATAWRITER_QOS_DEFAULT;
  qos.history().depth = 1000;
  return checked(publisher.create_datawriter(&checked(participant.create_topic(topic, "listen_test::Message",
                                                                               vendor::TOPIC_QOS_DEFAULT),
                                                      "topic"),
                                             qos),
                 "writer");
}

void take(vendor::DataReader& reader, bool takes_many, std::chrono::microseconds period,
          std::vector<Line>& lines, vendor::DataWriter* onwards = nullptr, std::uint64_t every = 1) {
  const auto note = [&](Message message, const vendor::SampleInfo& info, std::int64_t at_ns) {
    if (!info.valid_data) return;
    lines.push_back({message.number, at_ns, info.source_timestamp.to_ns()});
    if (onwards != nullptr && message.number % every == 0) onwards->write(&message);
  };
  take_each(
      period, lines,
      [&] {
        reader.wait_for_unread_message({0, 100'000'000});
      },
      [&] {
        vendor::SampleInfo info;
        Message message;
        if (!takes_many) {
          // A relay takes one at a time, as an executor does.
          do {
            if (reader.take_next_sample(&message, &info) != ReturnCode_t::RETCODE_OK) return;
            note(message, info, now_ns());
          } while (onwards == nullptr);
          return;
        }
        vendor::LoanableSequence<Message> messages;
        vendor::SampleInfoSeq infos;
        if (reader.take(messages, infos, 32) != ReturnCode_t::RETCODE_OK) return;
        const auto at_ns = now_ns();
        for (vendor::LoanableCollection::size_type i = 0; i < messages.length(); ++i)
          note(messages[i], infos[i], at_ns);
        reader.return_loan(messages, infos);
      });
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 6 && argc != 7) return 2;
  catch_signals();
  auto& participant = make_participant();
  vendor::TypeSupport(new Type).register_type(&participant);
  const std::string way = argv[1];
  const auto number = std::strtoull(argv[3], nullptr, 10);
  const std::chrono::microseconds period(std::strtoll(argv[4], nullptr, 10));
  std::vector<Line> lines;
  if (way == "publish") {
    auto& writer = make_writer(participant, argv[2]);
    const auto has_reader = [&] {
      vendor::PublicationMatchedStatus matched;
      writer.get_publication_matched_status(matched);
      return matched.current_count > 0;
    };
    publish_each(number, period, lines, has_reader, [&, message = Message()](auto of) mutable {
      message.number = of;
      writer.write(&message);
    });
    writer.wait_for_acknowledgments({10, 0});  // it takes with it what the reader does not have yet
  } else {
    auto* const onwards = argc == 7 ? &make_writer(participant, argv[6]) : nullptr;
    auto qos = vendor::DATAREADER_QOS_DEFAULT;
    qos.reliability().kind = vendor::RELIABLE_RELIABILITY_QOS;
    // The writer may know of the reader before the reader knows of the writer.
    qos.durability().kind = vendor::TRANSIENT_LOCAL_DURABILITY_QOS;
    qos.history().depth = onwards != nullptr ? 1000 : static_cast<std::int32_t>(number);
    auto& subscriber = checked(participant.create_subscriber(vendor::SUBSCRIBER_QOS_DEFAULT), "subscriber");
    auto& topic = checked(
        participant.create_topic(argv[2], "listen_test::Message", vendor::TOPIC_QOS_DEFAULT), "topic");
    take(checked(subscriber.create_datareader(&topic, qos), "reader"), way == "take", period, lines, onwards,
         number);
  }
  write_log(argv[5], lines);
  participant.delete_contained_entities();
  vendor::DomainParticipantFactory::get_instance()->delete_participant(&participant);
  return 0;
}
