// SPDX-License-Identifier: Apache-2.0
// Fast DDS, by its DDS API, over UDPv4 alone: shared memory and shortcuts within a process would bypass
// the link.
#include <algorithm>
#include <cstring>
#include <mutex>
#include <set>

#include <fastdds/dds/core/condition/GuardCondition.hpp>
#include <fastdds/dds/core/condition/WaitSet.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/DataWriterListener.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/DataReaderListener.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <sys/mman.h>
#include <unistd.h>

#include "message/message.hpp"
#include "transport/clock.hpp"
#include "transport/dds.hpp"
#include "transport/fastdds/hearing.hpp"
#include "transport/fastdds/log.hpp"
#include "transport/fastdds/profiles.hpp"
#include "transport/fastdds/threads.hpp"
#include "transport/fastdds/vendor.hpp"
#include "transport/shipped.hpp"
#include "transport/sockets.hpp"
#include "transport/transport.hpp"

namespace ontime::transport::fastdds {
namespace {

using vendor::DomainParticipantFactory;
using vendor::StatusMask;

constexpr std::size_t preallocated_bytes = std::size_t{4} << 20;

// The sample that is written …
struct Outgoing {
  std::uint64_t sequence;
  std::span<const std::byte> payload;
};
// … and the one that is taken: into room made beforehand.
struct Incoming {
  std::span<std::byte> room;
  std::span<std::byte> cdr{};  // what of it was used
};

// The round trip's message as a type of Fast DDS: it copies CDR bytes, and allocates nothing for a message.
class CdrType final : public Type<CdrType> {
 public:
  explicit CdrType(std::size_t max_cdr_bytes) : Type(message::type_name, max_cdr_bytes, false) {}

  static bool write(const void* outgoing, rtps::SerializedPayload_t& to) {
    const auto& sample = *static_cast<const Outgoing*>(outgoing);
    const std::uint32_t bytes = bytes_of(outgoing);
    if (bytes > to.max_size) return false;
    message::encode(sample.sequence, sample.payload, {reinterpret_cast<std::byte*>(to.data), bytes});
    to.length = bytes;
    to.encapsulation = CDR_LE;
    return true;
  }
  static bool read(const rtps::SerializedPayload_t& from, void* incoming) {
    auto& sample = *static_cast<Incoming*>(incoming);
    if (from.length > sample.room.size()) return false;
    std::memcpy(sample.room.data(), from.data, from.length);
    sample.cdr = sample.room.first(from.length);
    return true;
  }
  static std::uint32_t bytes_of(const void* outgoing) {
    const auto& sample = *static_cast<const Outgoing*>(outgoing);
    return static_cast<std::uint32_t>(message::cdr_overhead + sample.payload.size());
  }
};

template <typename Entity>
Entity* opened(Entity* entity, const std::string& what, Log& log) {
  if (entity != nullptr) return entity;
  const std::string why = log.text();
  throw Error("fastdds: cannot open " + what + (why.empty() ? "" : ": " + why));
}

vendor::DomainParticipantQos participant_qos(const Profiles& profiles, Log& log) {
  XmlProfiles::DeleteInstance();  // of an earlier end of this process
  auto* const factory = DomainParticipantFactory::get_instance();
  factory->load_profiles();  // that is, none: it does so once, and takes heed of no others before
  const auto loaded = factory->load_XML_profiles_string(profiles.xml.data(), profiles.xml.size());
  // A participant that is open already may say something meanwhile.
  const std::string faults = log.text("XML");
  if (loaded != done || !faults.empty())
    throw Error("fastdds: cannot use the profiles of " + profiles.source + ": " + faults);
  factory->set_default_participant_qos(vendor::PARTICIPANT_QOS_DEFAULT);  // that is, the default profile
  auto qos = factory->get_default_participant_qos();
  qos.name("ontime");
  return qos;
}

// A file in this process's memory, for a middleware that reads only files.
Descriptor memory_file(const std::string& text) {
  Descriptor file(memfd_create("ontime", MFD_CLOEXEC));
  if (file < 0 || write(file, text.data(), text.size()) != static_cast<ssize_t>(text.size()))
    throw Error("fastdds: cannot make a file in memory: " + errno_text());
  return file;
}

// It reads them while the participant is created.
std::vector<Descriptor> demand_security(vendor::DomainParticipantQos& qos, const Security& security) {
  // The first of a name counts: those of the user's own profile would.
  const auto is_security = [](const auto& property) { return property.name().starts_with("dds.sec."); };
  auto& properties = qos.properties().properties();
  std::erase_if(properties, is_security);
  std::erase_if(qos.properties().binary_properties(), is_security);
  properties.emplace_back("dds.sec.auth.plugin", "builtin.PKI-DH");
  properties.emplace_back("dds.sec.access.plugin", "builtin.Access-Permissions");
  properties.emplace_back("dds.sec.crypto.plugin", "builtin.AES-GCM-GMAC");
  std::vector<Descriptor> files;
  const auto give = [&](const char* what, const std::string& text) {
    files.push_back(memory_file(text));
    properties.emplace_back(what, "file:///proc/self/fd/" + std::to_string(files.back()));
  };
  give("dds.sec.auth.builtin.PKI-DH.identity_ca", security.identity_ca);
  give("dds.sec.auth.builtin.PKI-DH.identity_certificate", security.identity_certificate);
  give("dds.sec.auth.builtin.PKI-DH.private_key", security.private_key);
  give("dds.sec.access.builtin.Access-Permissions.permissions_ca", security.permissions_ca);
  give("dds.sec.access.builtin.Access-Permissions.governance", security.governance);
  give("dds.sec.access.builtin.Access-Permissions.permissions", security.permissions);
  return files;
}

// Settings that readers and writers share.
template <typename EndpointQos>
void set_qos(EndpointQos& to, const Qos& qos, std::size_t cdr_bytes, rtps::MemoryManagementPolicy_t memory) {
  to.reliability().kind = qos.reliability == Reliability::reliable ? vendor::RELIABLE_RELIABILITY_QOS
                                                                   : vendor::BEST_EFFORT_RELIABILITY_QOS;
  to.reliability().max_blocking_time = {0, 100'000'000};
  to.durability().kind = qos.durability == Durability::transient_local
                             ? vendor::TRANSIENT_LOCAL_DURABILITY_QOS
                             : vendor::VOLATILE_DURABILITY_QOS;
  to.history().kind =
      qos.history == History::keep_all ? vendor::KEEP_ALL_HISTORY_QOS : vendor::KEEP_LAST_HISTORY_QOS;
  to.history().depth = qos.depth;
  to.endpoint().history_memory_policy = memory;
  auto& limits = to.resource_limits();
  limits.max_samples = std::max(limits.max_samples, qos.depth);
  limits.max_samples_per_instance = std::max(limits.max_samples_per_instance, qos.depth);
  limits.allocated_samples =
      static_cast<int>(std::clamp<std::size_t>(preallocated_bytes / cdr_bytes, 8, 100));
  to.data_sharing().off();
}

// Keeps what was discovered about other participants, for people.
class Discovered final : public Discovery {
 public:
  explicit Discovered(const Config& config) : ours_{dds::topic_read(config), dds::topic_written(config)} {}
  std::size_t participants() {
    const std::lock_guard lock(mutex_);
    return participants_.size();
  }
  std::string other_type() {
    const std::lock_guard lock(mutex_);
    return other_type_;
  }

 private:
  void note_participant(const vendor::DomainParticipant&, const rtps::GUID_t& guid, bool is_here,
                        const rtps::RemoteLocatorList&) override {
    const std::lock_guard lock(mutex_);
    if (is_here)
      participants_.insert(guid);
    else
      participants_.erase(guid);
  }
  void note_reader(Described&& reader) override { note(reader); }
  void note_writer(Described&& writer) override { note(writer); }
  void note(const Described& end) {
    if (!ours_.contains(end.topic) || end.type == message::type_name) return;
    const std::lock_guard lock(mutex_);
    other_type_ = dds::other_type(end.topic, end.type);
  }

  const std::set<std::string> ours_;
  std::mutex mutex_;
  std::set<rtps::GUID_t> participants_;
  std::string other_type_;
};

dds::Gaps::Writer writer_of(const vendor::SampleInfo& info) {
  const rtps::GUID_t& guid = info.sample_identity.writer_guid();
  dds::Gaps::Writer writer;
  std::copy_n(guid.guidPrefix.value, rtps::GuidPrefix_t::size, writer.begin());
  std::copy_n(guid.entityId.value, rtps::EntityId_t::size, writer.begin() + rtps::GuidPrefix_t::size);
  return writer;
}

// Shared by its endpoints.
struct SharedParticipant {
  explicit SharedParticipant(const Config& config) : discovered(config) {}
  ~SharedParticipant() {
    if (entity == nullptr) return;
    entity->delete_contained_entities();
    DomainParticipantFactory::get_instance()->delete_participant(entity);
  }
  SharedParticipant(const SharedParticipant&) = delete;
  SharedParticipant& operator=(const SharedParticipant&) = delete;

  Discovered discovered;
  vendor::DomainParticipant* entity = nullptr;
  std::int64_t quiet_from_ns = 0;  // its first announcements are over: a hundred packets of ours, or more
};

class FastEndpoint final : public Endpoint, vendor::DataReaderListener, vendor::DataWriterListener {
 public:
  // In the participant of `first`; nullptr: in one of its own.
  FastEndpoint(const Config& config, Sink& sink, const FastEndpoint* first);
  ~FastEndpoint() override;

  std::unique_ptr<Endpoint> beside(const Config& config, Sink& sink, Where where) override;
  Matched matched() override { return now_ns() < participant_->quiet_from_ns ? Matched{} : matches_.now(); }
  Losses losses() override;
  std::string seen() override;
  bool send(std::uint64_t sequence, std::span<const std::byte> payload) noexcept override;
  void receive() noexcept override;
  void interrupt() noexcept override { interrupted_.set_trigger_value(true); }
  std::vector<Thread> threads() override { return tell_apart(threads_, config_.domain); }
  std::map<std::string, std::string> facts() override;

 private:
  // Opens nothing yet, so that the destructor runs wherever a later constructor fails.
  FastEndpoint(const Config& config, Sink& sink, std::shared_ptr<SharedParticipant> participant);
  void open_participant(Log& log);
  void open_topics_and_ends(Log& log, rtps::MemoryManagementPolicy_t memory);
  void on_data_available(vendor::DataReader* reader) override { take_all(*reader); }
  void on_subscription_matched(vendor::DataReader*,
                               const vendor::SubscriptionMatchedStatus& status) override {
    matches_.set_writers(status.current_count);
  }
  void on_publication_matched(vendor::DataWriter*, const vendor::PublicationMatchedStatus& status) override {
    matches_.set_readers(status.current_count);
  }
  void take_all(vendor::DataReader& reader) noexcept;

  Config config_;
  Sink& sink_;
  Profiles profiles_;
  std::vector<pid_t> threads_;
  std::vector<std::byte>
      room_;  // one is enough: Fast DDS calls the listener of a reader with the reader locked
  vendor::WaitSet waitset_;
  vendor::GuardCondition interrupted_;
  vendor::ConditionSeq active_;
  dds::Matches matches_;
  dds::Gaps gaps_;
  std::shared_ptr<SharedParticipant> participant_;
  vendor::Publisher* publisher_ = nullptr;
  vendor::Subscriber* subscriber_ = nullptr;
  vendor::DataWriter* writer_ = nullptr;
  vendor::DataReader* reader_ = nullptr;
};

FastEndpoint::FastEndpoint(const Config& config, Sink& sink, std::shared_ptr<SharedParticipant> participant)
    : config_(config),
      sink_(sink),
      room_(message::cdr_overhead + config.max_payload_bytes + 3),  // DDS pads to a multiple of four
      participant_(std::move(participant)) {}

FastEndpoint::FastEndpoint(const Config& config, Sink& sink, const FastEndpoint* first)
    : FastEndpoint(config, sink,
                   first == nullptr ? std::make_shared<SharedParticipant>(config) : first->participant_) {
  if (first != nullptr) profiles_ = first->profiles_;
  const auto before = dds::tasks();
  const auto sockets_before = dds::sockets();
  {
    Log log;
    if (first == nullptr) open_participant(log);
    // A participant knows our type once, with the size that its first endpoint has.
    open_topics_and_ends(
        log, first == nullptr ? rtps::PREALLOCATED_MEMORY_MODE : rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE);
  }
  dds::keep_to_link(sockets_before, config, "fastdds");
  for (const auto& task : dds::started_since(before)) threads_.push_back(task.tid);
}

FastEndpoint::~FastEndpoint() {
  // The threads that call the last endpoint end here, before its members are destroyed.
  if (participant_.use_count() == 1) {
    participant_.reset();
    return;
  }
  if (reader_ != nullptr) subscriber_->delete_datareader(reader_);
  if (writer_ != nullptr) publisher_->delete_datawriter(writer_);
}

std::unique_ptr<Endpoint> FastEndpoint::beside(const Config& config, Sink& sink, Where where) {
  dds::check(config, "fastdds");
  return std::make_unique<FastEndpoint>(config, sink, where == Where::same_process ? nullptr : this);
}

void FastEndpoint::open_participant(Log& log) {
  profiles_ = profiles(config_, "fastdds", vendor_names);
  const NoFile none(vendor_names);
  auto qos = participant_qos(profiles_, log);
  std::vector<Descriptor> files;
  if (config_.security) files = demand_security(qos, *config_.security);
  std::string where = "domain " + std::to_string(config_.domain);
  if (!config_.interface.empty()) where += " on " + config_.interface + " (" + config_.address + ")";
  where += " as configured by " + profiles_.source;
  participant_->entity = opened(DomainParticipantFactory::get_instance()->create_participant(
                                    static_cast<vendor::DomainId_t>(config_.domain), qos,
                                    &participant_->discovered, StatusMask::none()),
                                where, log);
  const auto& first = qos.wire_protocol().builtin.discovery_config.initial_announcements;
  participant_->quiet_from_ns = now_ns() + (first.count + std::int64_t{1}) * first.period.to_ns();
}

void FastEndpoint::open_topics_and_ends(Log& log, rtps::MemoryManagementPolicy_t memory) {
  auto* const participant = participant_->entity;
  if (participant->find_type(message::type_name).empty())
    vendor::TypeSupport(new CdrType(room_.size())).register_type(participant);
  const auto open_topic = [&](const std::string& name) {
    return opened(participant->create_topic(name, message::type_name, vendor::TOPIC_QOS_DEFAULT),
                  "the topic " + name, log);
  };
  auto* const read = open_topic(dds::topic_read(config_));
  auto* const written = open_topic(dds::topic_written(config_));

  publisher_ = opened(participant->create_publisher(vendor::PUBLISHER_QOS_DEFAULT), "a publisher", log);
  vendor::DataWriterQos writer_qos = publisher_->get_default_datawriter_qos();
  set_qos(writer_qos, config_.qos, room_.size(), memory);
  writer_qos.publish_mode().kind = vendor::SYNCHRONOUS_PUBLISH_MODE;
  // Before the reader, whose listener may call send() at once.
  writer_ =
      opened(publisher_->create_datawriter(written, writer_qos, this, StatusMask::publication_matched()),
             "a writer", log);

  subscriber_ = opened(participant->create_subscriber(vendor::SUBSCRIBER_QOS_DEFAULT), "a subscriber", log);
  vendor::DataReaderQos reader_qos = subscriber_->get_default_datareader_qos();
  set_qos(reader_qos, config_.qos, room_.size(), memory);
  const bool listens = config_.receive == Receive::listener;
  StatusMask heard = StatusMask::subscription_matched();
  if (listens) heard << StatusMask::data_available();
  reader_ = opened(subscriber_->create_datareader(read, reader_qos, this, heard), "a reader", log);
  if (listens) return;
  reader_->get_statuscondition().set_enabled_statuses(StatusMask::data_available());
  waitset_.attach_condition(reader_->get_statuscondition());
  waitset_.attach_condition(interrupted_);
  active_.reserve(2);
}

void FastEndpoint::take_all(vendor::DataReader& reader) noexcept {
  Incoming sample{room_};
  vendor::SampleInfo info;
  while (reader.take_next_sample(&sample, &info) == done) {
    const std::int64_t arrival_ns = now_ns();
    if (!info.valid_data) continue;
    gaps_.note(writer_of(info), static_cast<std::int64_t>(info.sample_identity.sequence_number().to64long()));
    if (const auto view = message::decode(sample.cdr))
      sink_.arrived(view->sequence, view->payload, arrival_ns);
  }
}

bool FastEndpoint::send(std::uint64_t sequence, std::span<const std::byte> payload) noexcept {
  Outgoing sample{sequence, payload};
  return writer_->write(&sample, vendor::HANDLE_NIL) == done;
}

void FastEndpoint::receive() noexcept {
  waitset_.wait(active_, c_TimeInfinite);
  take_all(*reader_);
}

Losses FastEndpoint::losses() {
  vendor::SampleLostStatus lost;
  if (reader_->get_sample_lost_status(lost) != done) return {};
  const auto on_the_way = static_cast<std::uint64_t>(lost.total_count);
  const std::uint64_t missing = std::max(gaps_.missing(), on_the_way);  // noticed with the next one taken
  return {.on_the_way = on_the_way, .overwritten = missing - on_the_way};
}

std::string FastEndpoint::seen() {
  vendor::RequestedIncompatibleQosStatus requested;
  reader_->get_requested_incompatible_qos_status(requested);
  if (requested.total_count > 0) return dds::refused_writer(config_, dds::Policy{requested.last_policy_id});
  vendor::OfferedIncompatibleQosStatus offered;
  writer_->get_offered_incompatible_qos_status(offered);
  if (offered.total_count > 0) return dds::refused_reader(config_, dds::Policy{offered.last_policy_id});
  if (std::string found = participant_->discovered.other_type(); !found.empty()) return found;
  return dds::others_without_our_topics(config_, participant_->discovered.participants(), matched());
}

std::map<std::string, std::string> FastEndpoint::facts() {
  return dds::facts(config_, std::string("Fast DDS ") + vendor_version, profiles_.carrier, profiles_.source);
}

std::string version() { return vendor_version; }

std::unique_ptr<Endpoint> open(const Config& config, Sink& sink) {
  dds::check(config, "fastdds");
  return std::make_unique<FastEndpoint>(config, sink, nullptr);
}

constexpr Capabilities capabilities() {
  auto can = shipped("fastdds")->can;
  can.security = HAVE_SECURITY;  // how this Fast DDS was built
  return can;
}

}  // namespace
}  // namespace ontime::transport::fastdds

extern "C" __attribute__((visibility("default")))
const ontime::transport::Plugin ontime_transport{.abi = ontime::transport::abi,
                                                 .name = "fastdds",
                                                 .version = ontime::transport::fastdds::version,
                                                 .capabilities = ontime::transport::fastdds::capabilities(),
                                                 .options = ontime::transport::shipped("fastdds")->options,
                                                 .open = ontime::transport::fastdds::open,
                                                 .hear = ontime::transport::fastdds::hear};
