// SPDX-License-Identifier: Apache-2.0
// rmw_fastrtps opens its participant with the default QoS of Fast DDS's factory, so the link goes in there,
// on top of the user's own profiles. UDPv4 alone: shared memory and shortcuts within a process would bypass
// it.
#include <algorithm>
#include <filesystem>
#include <memory>
#include <vector>

#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/log/Log.hpp>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <fastrtps/utils/IPLocator.h>
#include <fastrtps/xmlparser/XMLProfileManager.h>

#include "environment.hpp"
#include "lead.hpp"
#include "transport/dds.hpp"

namespace ontime::transport::ros2 {
namespace {

namespace vendor = eprosima::fastdds::dds;
namespace rtps = eprosima::fastrtps::rtps;
using vendor::DomainParticipantFactory;

constexpr std::size_t unfragmented_bytes = 65'000;
constexpr const char* profiles_variable = "FASTRTPS_DEFAULT_PROFILES_FILE";
constexpr const char* profiles_in_this_folder = "DEFAULT_FASTRTPS_PROFILES.xml";

// Fast DDS prints by itself, which is kept while a node opens and not wanted later.
class Log {
 public:
  Log() {
    vendor::Log::SetVerbosity(vendor::Log::Kind::Error);
    vendor::Log::ClearConsumers();
    vendor::Log::RegisterConsumer(std::make_unique<Keeper>(text_));
  }
  ~Log() {
    vendor::Log::ClearConsumers();
    vendor::Log::KillThread();
  }
  Log(const Log&) = delete;
  Log& operator=(const Log&) = delete;

  std::string text() {
    vendor::Log::Flush();
    return text_;
  }

 private:
  struct Keeper : vendor::LogConsumer {
    explicit Keeper(std::string& to) : text(to) {}
    void Consume(const vendor::Log::Entry& entry) override {
      text += (text.empty() ? "" : "; ") + entry.message;
    }
    std::string& text;
  };

  std::string text_;
};

rtps::Locator_t locator(const std::string& address, int port) {
  rtps::Locator_t result(LOCATOR_KIND_UDPv4, static_cast<std::uint32_t>(port));
  rtps::IPLocator::setIPv4(result, address);
  return result;
}

class FastLead final : public Lead {
 public:
  explicit FastLead(const Config& config) {
    source = "ontime";
    carrier = "UDPv4";
    load_profiles();
    vendor::DomainParticipantQos qos = factory_.get_default_participant_qos();
    use_the_link(config, qos);
    name_peers(config, qos);
    factory_.set_default_participant_qos(qos);
    eprosima::fastrtps::LibrarySettingsAttributes library;
    library.intraprocess_delivery = eprosima::fastrtps::INTRAPROCESS_OFF;
    eprosima::fastrtps::xmlparser::XMLProfileManager::library_settings(library);
  }
  ~FastLead() override { factory_.set_default_participant_qos(vendor::PARTICIPANT_QOS_DEFAULT); }

  std::string said() override { return log_.text(); }

 private:
  // As Fast DDS does by itself at the first use, but not past a file that is not there or is wrong.
  void load_profiles() {
    if (const std::string file = environment(profiles_variable); !file.empty())
      load_profiles(file, std::string(profiles_variable) + ", ");
    if (environment("SKIP_DEFAULT_XML") != "1" && std::filesystem::exists(profiles_in_this_folder))
      load_profiles(profiles_in_this_folder, "");
    factory_.load_profiles();
    factory_.set_default_participant_qos(vendor::PARTICIPANT_QOS_DEFAULT);  // that is, the default profile
  }
  void load_profiles(const std::string& file, const std::string& named_by) {
    if (!std::filesystem::exists(file))
      throw Error("ros2: " + named_by + "the file " + file + " is not there; mend it or unset it");
    if (factory_.load_XML_profiles_file(file) != ReturnCode_t::RETCODE_OK || !log_.text().empty())
      throw Error("ros2: Fast DDS cannot use the profiles in " + file + ": " + log_.text() +
                  "; mend it or take it away");
    source += ", " + file;
  }

  void use_the_link(const Config& config, vendor::DomainParticipantQos& qos) {
    auto& transport = qos.transport();
    if (!transport.use_builtin_transports || !transport.user_transports.empty()) {
      if (!config.interface.empty())
        throw Error("ros2: the interface " + config.interface + " was asked for, and the profiles of " +
                    source + " bring transports of their own, which may take another way; take " +
                    "userTransports out of the default participant's profile, or name no interface");
      carrier = "the profile's transports";
      return;
    }
    const auto udp = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
    udp->maxInitialPeersRange = dds::participants_per_host;
    udp->sendBufferSize = transport.send_socket_buffer_size;
    udp->receiveBufferSize = transport.listen_socket_buffer_size;
    // All fragments of a message arrive at once. The kernel gives as much of this as net.core.rmem_max
    // allows.
    if (config.max_payload_bytes > unfragmented_bytes)
      udp->receiveBufferSize =
          std::max(udp->receiveBufferSize, static_cast<std::uint32_t>(4 * config.max_payload_bytes));
    if (!config.interface.empty()) udp->interfaceWhiteList = {config.address};
    transport.use_builtin_transports = false;
    transport.user_transports = {udp};
  }

  // Where peers are named Fast DDS looks nowhere else, hence the multicast group is named too.
  static void name_peers(const Config& config, vendor::DomainParticipantQos& qos) {
    auto& peers = qos.wire_protocol().builtin.initialPeersList;
    const bool loopback = dds::is_loopback(config.address);
    if (config.peers.empty() && !loopback) return;
    if (peers.empty())
      peers.push_back(locator("239.255.0.1", dds::base_port + dds::ports_per_domain * config.domain));
    if (loopback) peers.push_back(locator(config.address, 0));
    for (const std::string& name : config.peers) {
      const dds::Peer peer = dds::resolve(name, "ros2");
      peers.push_back(locator(peer.address, peer.port));
    }
  }

  Log log_;
  DomainParticipantFactory& factory_ = *DomainParticipantFactory::get_instance();
};

}  // namespace
}  // namespace ontime::transport::ros2

extern "C" __attribute__((visibility("default"))) std::unique_ptr<ontime::transport::ros2::Lead> ontime_lead(
    const ontime::transport::Config& config) {
  return std::make_unique<ontime::transport::ros2::FastLead>(config);
}
