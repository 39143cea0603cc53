// SPDX-License-Identifier: Apache-2.0
// OpenDDS 3.13, by its DCPS API, with discovery and data as RTPS over UDPv4 alone. Everything is set by the
// program: no file is read.
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstring>
#include <mutex>
#include <thread>
#include <utility>

#include <ace/Log_Msg.h>
#include <ace/Log_Msg_Callback.h>
#include <ace/Log_Record.h>
#include <arpa/inet.h>
#include <dds/DCPS/BuiltInTopicUtils.h>
#include <dds/DCPS/GuardCondition.h>
#include <dds/DCPS/Marked_Default_Qos.h>
#include <dds/DCPS/RTPS/RtpsDiscovery.h>
#include <dds/DCPS/Serializer.h>
#include <dds/DCPS/Service_Participant.h>
#include <dds/DCPS/WaitSet.h>
#include <dds/DCPS/transport/framework/TransportRegistry.h>
#include <dds/DCPS/transport/rtps_udp/RtpsUdpInst.h>
#include <dds/DCPS/transport/rtps_udp/RtpsUdpLoader.h>
#include <dds/DdsDcpsCoreTypeSupportImpl.h>
#include <dds/Version.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include "RoundTripTypeSupportImpl.h"
#include "message/message.hpp"
#include "transport/clock.hpp"
#include "transport/dds.hpp"
#include "transport/shipped.hpp"
#include "transport/transport.hpp"

namespace ontime::transport::opendds {
namespace {

namespace type = ontime_msgs::msg::dds_;
namespace dcps = OpenDDS::DCPS;

constexpr const char* ours = "ontime";         // what of the process's registries is ours
constexpr int receive_buffer_bytes = 1 << 20;  // as Cyclone DDS asks for; its own 64 KiB hold one message

// It prints by itself, and its threads have the callback of the one that started them. Now none
// prints, and what they say is kept as long as one of this lives: one at a time in a process.
class Log {
 public:
  Log() {
    static Keeper keeper;
    keeper_ = &keeper;
    ACE_LOG_MSG->clr_flags(ACE_Log_Msg::STDERR | ACE_Log_Msg::LOGGER);
    ACE_LOG_MSG->msg_callback(keeper_);
    ACE_LOG_MSG->set_flags(ACE_Log_Msg::MSG_CALLBACK);
    text();
    keeper_->keeps = true;
  }
  ~Log() { keeper_->keeps = false; }
  Log(const Log&) = delete;
  Log& operator=(const Log&) = delete;

  std::string text() {  // and then it is forgotten
    const std::lock_guard lock(keeper_->mutex);
    return std::exchange(keeper_->said, "");
  }

 private:
  struct Keeper final : ACE_Log_Msg_Callback {
    void log(ACE_Log_Record& record) override {
      if (!keeps) return;
      std::string text = record.msg_data();
      while (text.ends_with('\n')) text.pop_back();
      if (text.starts_with('(')) text.erase(0, text.find(')') + 2);  // of which process and thread
      const std::lock_guard lock(mutex);
      said += (said.empty() ? "" : "; ") + text;
    }
    std::atomic<bool> keeps{false};
    std::mutex mutex;
    std::string said;
  };
  Keeper* keeper_;
};

template <typename Entity>
Entity* opened(Entity* entity, const std::string& what, Log& log) {
  if (entity != nullptr) return entity;
  const std::string why = log.text();
  throw Error("opendds: cannot open " + what + (why.empty() ? "" : ": " + why));
}

constexpr int first_unicast = 10;

int port_of(const Config& config, int offset) {
  return dds::base_port + dds::ports_per_domain * config.domain + offset;
}

std::string locator(const std::string& address, int port) { return address + ":" + std::to_string(port); }

// One for the life of the process: it numbers its participants, and the next may not be taken for the last.
dcps::RcHandle<OpenDDS::RTPS::RtpsDiscovery> discovery_of(const Config& config) {
  static const auto discovery = dcps::make_rch<OpenDDS::RTPS::RtpsDiscovery>(ours);
  discovery->resend_period(ACE_Time_Value(1));  // half a minute, its own, is long to wait where one was lost
  discovery->sedp_multicast(false);
  const bool everywhere = config.interface.empty();
  discovery->multicast_interface(config.interface);
  discovery->spdp_local_address(config.address);
  discovery->sedp_local_address(everywhere ? "" : locator(config.address, 0));
  discovery->spdp_send_addrs().clear();
  const auto look_at_all = [&](const std::string& address) {
    for (int participant = 0; participant < dds::participants_per_host; ++participant)
      discovery->spdp_send_addrs().push_back(
          locator(address, port_of(config, first_unicast + 2 * participant)));
  };
  if (dds::is_loopback(config.address)) look_at_all(config.address);
  for (const std::string& text : config.peers) {
    const dds::Peer peer = dds::resolve(text, "opendds");
    if (peer.port == 0)
      look_at_all(peer.address);
    else
      discovery->spdp_send_addrs().push_back(locator(peer.address, peer.port));
  }
  return discovery;
}

// It counts a host's participants, by which RTPS has their ports, from what a GUID happens to end with. The
// next one begins with 0, as any participant's that is found without multicast.
void count_participants_from_zero(OpenDDS::RTPS::RtpsDiscovery& discovery) {
  const auto last = discovery.generate_participant_guid();
  const int next = (last.guidPrefix[10] << 8 | last.guidPrefix[11]) + 1;
  discovery.d1(static_cast<std::uint16_t>(first_unicast - 2 * next));  // all of it modulo 2^16
}

// What this process has of OpenDDS as long as an endpoint lives, be it in several participants.
class Service {
 public:
  static std::shared_ptr<Service> instance(const Config& config) {
    static std::weak_ptr<Service> present;
    auto service = present.lock();
    if (!service) present = service = std::make_shared<Service>(config);
    return service;
  }
  explicit Service(const Config& config) : discovery(discovery_of(config)) {
    const auto before = dds::tasks();
    factory = TheServiceParticipant->get_domain_participant_factory();
    threads = dds::started_since(before);
    TheServiceParticipant->add_discovery(discovery);
    TheServiceParticipant->set_repo_domain(config.domain, ours);
    dcps::RtpsUdpLoader::load();
    // Left to itself it counts alignment from the encapsulation's header on, unlike all others.
    dcps::Serializer::set_use_rti_serialization(true);
  }
  ~Service() {
    factory = nullptr;
    TheServiceParticipant->shutdown();
  }
  Service(const Service&) = delete;
  Service& operator=(const Service&) = delete;

  const dcps::RcHandle<OpenDDS::RTPS::RtpsDiscovery> discovery;
  DDS::DomainParticipantFactory_var factory;
  std::vector<dds::Task> threads;
};

// Of a participant that was opened since: the port for its data, as RTPS has it, beside the one at which it
// hears of others. 0, and the kernel chooses, if it hears of them at another.
int data_port(const dds::Sockets& before, const Config& config) {
  for (const auto& [descriptor, number] : dds::sockets()) {
    if (const auto old = before.find(descriptor); old != before.end() && old->second == number) continue;
    sockaddr_in address{};
    socklen_t bytes = sizeof address;
    if (getsockname(descriptor, reinterpret_cast<sockaddr*>(&address), &bytes) != 0) continue;
    const int offset = ntohs(address.sin_port) - port_of(config, 0);
    if (offset >= first_unicast && offset < dds::ports_per_domain && offset % 2 == 0)
      return ntohs(address.sin_port) + 1;
  }
  return 0;
}

// Of all endpoints that share it, with the socket for their data.
class SharedParticipant {
 public:
  SharedParticipant(const Config& config, Log& log);
  ~SharedParticipant();
  SharedParticipant(const SharedParticipant&) = delete;
  SharedParticipant& operator=(const SharedParticipant&) = delete;

  DDS::DomainParticipant* operator->() const { return entity_.in(); }
  const std::vector<Thread>& threads() const { return threads_; }
  // The first writer or reader has it open the socket for data. Another program may have its port by then
  // (Fast DDS takes its own two as it finds them); where this has not yet been tried, it is left to the
  // kernel.
  bool leave_data_port_to_kernel();
  // And it starts the threads of the transport: what receives, then what cleans up.
  void note_transport_threads(const std::vector<dds::Task>& before);

 private:
  std::shared_ptr<Service> service_;
  DDS::DomainParticipant_var entity_;
  std::string address_;
  dcps::RcHandle<dcps::RtpsUdpInst> transport_;
  dcps::TransportConfig_rch transport_config_;
  std::vector<Thread> threads_;
};

SharedParticipant::SharedParticipant(const Config& config, Log& log)
    : service_(Service::instance(config)), address_(config.address) {
  static std::atomic<int> number{0};
  const std::string name = ours + std::to_string(++number);
  for (const auto& task : service_->threads) threads_.push_back({task.tid, "timer", "timers"});
  auto* const registry = dcps::TransportRegistry::instance();
  transport_ = dcps::static_rchandle_cast<dcps::RtpsUdpInst>(registry->create_inst(name, "rtps_udp"));
  transport_->use_multicast_ = false;
  transport_->rcv_buffer_size_ = receive_buffer_bytes;
  transport_config_ = registry->create_config(name);
  transport_config_->instances_.push_back(transport_);

  count_participants_from_zero(*service_->discovery);
  const auto before = dds::tasks();
  const auto sockets_before = dds::sockets();
  std::string where = "domain " + std::to_string(config.domain);
  where += config.interface.empty() ? " where the default route goes"
                                    : " on " + config.interface + " (" + config.address + ")";
  entity_ = opened(service_->factory->create_participant(config.domain, PARTICIPANT_QOS_DEFAULT, nullptr, 0),
                   where, log);
  for (const auto& task : dds::started_since(before))
    threads_.push_back({task.tid, "discovery", "discovery"});
  transport_->local_address(static_cast<std::uint16_t>(data_port(sockets_before, config)), address_.c_str());
  registry->bind_config(transport_config_, entity_);
}

SharedParticipant::~SharedParticipant() {
  if (entity_ != nullptr) {
    entity_->delete_contained_entities();
    service_->factory->delete_participant(entity_);
  }
  auto* const registry = dcps::TransportRegistry::instance();
  registry->remove_config(transport_config_);
  registry->remove_inst(transport_);
}

bool SharedParticipant::leave_data_port_to_kernel() {
  if (transport_->local_address().get_port_number() == 0) return false;
  transport_->local_address(0, address_.c_str());
  return true;
}

void SharedParticipant::note_transport_threads(const std::vector<dds::Task>& before) {
  const char* role = "receive";
  for (const auto& task : dds::started_since(before))
    threads_.push_back({task.tid, std::exchange(role, "other"), "rtps_udp"});
}

template <typename EndQos>
void set_qos(EndQos& to, const Qos& qos) {
  to.reliability.kind = qos.reliability == Reliability::reliable ? DDS::RELIABLE_RELIABILITY_QOS
                                                                 : DDS::BEST_EFFORT_RELIABILITY_QOS;
  to.reliability.max_blocking_time = {0, 100'000'000};
  to.durability.kind = qos.durability == Durability::transient_local ? DDS::TRANSIENT_LOCAL_DURABILITY_QOS
                                                                     : DDS::VOLATILE_DURABILITY_QOS;
  to.history.kind = qos.history == History::keep_all ? DDS::KEEP_ALL_HISTORY_QOS : DDS::KEEP_LAST_HISTORY_QOS;
  to.history.depth = qos.depth;
}

class OpenEndpoint final : public Endpoint {
 public:
  OpenEndpoint(const Config& config, Sink& sink);
  OpenEndpoint(const Config& config, Sink& sink, const OpenEndpoint& first);  // in its participant
  ~OpenEndpoint() override;

  std::unique_ptr<Endpoint> beside(const Config& config, Sink& sink, Where where) override;
  Matched matched() override { return matches_.now(); }
  Losses losses() override;
  std::string seen() override;
  bool send(std::uint64_t sequence, std::span<const std::byte> payload) noexcept override;
  void receive() noexcept override;
  void interrupt() noexcept override { interrupted_->set_trigger_value(true); }
  std::vector<Thread> threads() override { return participant_->threads(); }
  std::map<std::string, std::string> facts() override;

 private:
  class Calls;
  class ReaderListener;
  class WriterListener;

  // Before anything is opened, so that what is gets closed wherever a constructor fails.
  OpenEndpoint(const Config& config, Sink& sink, std::shared_ptr<SharedParticipant> participant);
  void open_ends(Log& log);
  void close_ends();
  void open_writer(Log& log);
  void open_reader(Log& log);
  void take_all(type::RoundTrip_DataReader& reader) noexcept;
  std::size_t other_participants();
  std::string endpoints_of_other_type();

  Config config_;
  Sink& sink_;
  dds::Matches matches_;
  dds::Gaps gaps_;
  std::shared_ptr<SharedParticipant> participant_;
  std::shared_ptr<Calls> calls_;
  DDS::Publisher_var publisher_;
  DDS::Subscriber_var subscriber_;
  type::RoundTrip_DataWriter_var writer_;
  type::RoundTrip_DataReader_var reader_;
  type::RoundTrip_ outgoing_;
  DDS::GuardCondition_var interrupted_ = new DDS::GuardCondition;
  DDS::ReadCondition_var data_;
  DDS::WaitSet_var waitset_ = new DDS::WaitSet;
};

// OpenDDS may be about to call an endpoint when that ends, and goes on with its listeners then.
class OpenEndpoint::Calls {
 public:
  explicit Calls(OpenEndpoint& to) : to_(&to) {}
  void end() {
    to_ = nullptr;
    while (within_ > 0) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  template <typename Call>
  void call(const Call& what) {
    ++within_;
    if (OpenEndpoint* const to = to_) what(*to);
    --within_;
  }

 private:
  std::atomic<OpenEndpoint*> to_;
  std::atomic<int> within_{0};
};

class OpenEndpoint::ReaderListener final : public virtual dcps::LocalObject<DDS::DataReaderListener> {
 public:
  explicit ReaderListener(std::shared_ptr<Calls> calls) : calls_(std::move(calls)) {}

 private:
  void on_data_available(DDS::DataReader* reader) override {
    calls_->call([&](OpenEndpoint& of) { of.take_all(dynamic_cast<type::RoundTrip_DataReader&>(*reader)); });
  }
  void on_subscription_matched(DDS::DataReader*, const DDS::SubscriptionMatchedStatus& status) override {
    calls_->call([&](OpenEndpoint& of) { of.matches_.set_writers(status.current_count); });
  }
  void on_requested_deadline_missed(DDS::DataReader*, const DDS::RequestedDeadlineMissedStatus&) override {}
  void on_requested_incompatible_qos(DDS::DataReader*, const DDS::RequestedIncompatibleQosStatus&) override {}
  void on_liveliness_changed(DDS::DataReader*, const DDS::LivelinessChangedStatus&) override {}
  void on_sample_rejected(DDS::DataReader*, const DDS::SampleRejectedStatus&) override {}
  void on_sample_lost(DDS::DataReader*, const DDS::SampleLostStatus&) override {}

  const std::shared_ptr<Calls> calls_;
};

class OpenEndpoint::WriterListener final : public virtual dcps::LocalObject<DDS::DataWriterListener> {
 public:
  explicit WriterListener(std::shared_ptr<Calls> calls) : calls_(std::move(calls)) {}

 private:
  void on_publication_matched(DDS::DataWriter*, const DDS::PublicationMatchedStatus& status) override {
    calls_->call([&](OpenEndpoint& of) { of.matches_.set_readers(status.current_count); });
  }
  void on_offered_deadline_missed(DDS::DataWriter*, const DDS::OfferedDeadlineMissedStatus&) override {}
  void on_offered_incompatible_qos(DDS::DataWriter*, const DDS::OfferedIncompatibleQosStatus&) override {}
  void on_liveliness_lost(DDS::DataWriter*, const DDS::LivelinessLostStatus&) override {}

  const std::shared_ptr<Calls> calls_;
};

OpenEndpoint::OpenEndpoint(const Config& config, Sink& sink, std::shared_ptr<SharedParticipant> participant)
    : config_(config),
      sink_(sink),
      participant_(std::move(participant)),
      calls_(std::make_shared<Calls>(*this)) {}

OpenEndpoint::OpenEndpoint(const Config& config, Sink& sink) : OpenEndpoint(config, sink, nullptr) {
  const auto sockets_before = dds::sockets();
  Log log;
  participant_ = std::make_shared<SharedParticipant>(config, log);
  const auto before = dds::tasks();
  try {
    open_ends(log);
  } catch (const Error&) {
    if (!participant_->leave_data_port_to_kernel()) throw;
    close_ends();
    open_ends(log);
  }
  participant_->note_transport_threads(before);
  dds::keep_to_link(sockets_before, config, "opendds");
}

OpenEndpoint::OpenEndpoint(const Config& config, Sink& sink, const OpenEndpoint& first)
    : OpenEndpoint(config, sink, first.participant_) {
  Log log;
  open_ends(log);
}

OpenEndpoint::~OpenEndpoint() {
  calls_->end();
  close_ends();
}

std::unique_ptr<Endpoint> OpenEndpoint::beside(const Config& config, Sink& sink, Where where) {
  dds::check(config, "opendds");
  if (where == Where::same_process) return std::make_unique<OpenEndpoint>(config, sink);
  return std::make_unique<OpenEndpoint>(config, sink, *this);
}

void OpenEndpoint::open_ends(Log& log) {
  type::RoundTrip_TypeSupport_var support = new type::RoundTrip_TypeSupportImpl;
  if (support->register_type((*participant_).operator->(), message::type_name) != DDS::RETCODE_OK)
    throw Error("opendds: cannot register the type " + std::string(message::type_name));
  open_writer(log);  // before the reader, whose listener may call send() at once
  open_reader(log);
}

void OpenEndpoint::close_ends() {
  if (reader_ != nullptr) {
    reader_->set_listener(nullptr, 0);
    if (data_ != nullptr) {
      waitset_->detach_condition(data_);
      reader_->delete_readcondition(data_);
    }
    subscriber_->delete_datareader(reader_);
    reader_ = nullptr;
  }
  if (writer_ != nullptr) {
    writer_->set_listener(nullptr, 0);
    publisher_->delete_datawriter(writer_);
    writer_ = nullptr;
  }
}

void OpenEndpoint::open_writer(Log& log) {
  auto& participant = *participant_;
  DDS::Topic_var topic = opened(participant->create_topic(dds::topic_written(config_).c_str(),
                                                          message::type_name, TOPIC_QOS_DEFAULT, nullptr, 0),
                                "the topic " + dds::topic_written(config_), log);
  publisher_ = opened(participant->create_publisher(PUBLISHER_QOS_DEFAULT, nullptr, 0), "a publisher", log);
  DDS::DataWriterQos qos;
  publisher_->get_default_datawriter_qos(qos);
  set_qos(qos, config_.qos);
  // What is kept for those who come late is as much as is kept for the others.
  qos.durability_service.history_kind = qos.history.kind;
  qos.durability_service.history_depth = qos.history.depth;
  // Of those who leave it tells by the reader's status.
  constexpr DDS::StatusMask heard = DDS::PUBLICATION_MATCHED_STATUS | DDS::SUBSCRIPTION_MATCHED_STATUS;
  DDS::DataWriterListener_var listener = new WriterListener(calls_);
  DDS::DataWriter_var writer =
      opened(publisher_->create_datawriter(topic, qos, listener, heard), "a writer", log);
  writer_ = type::RoundTrip_DataWriter::_narrow(writer);
}

void OpenEndpoint::open_reader(Log& log) {
  auto& participant = *participant_;
  DDS::Topic_var topic = opened(participant->create_topic(dds::topic_read(config_).c_str(),
                                                          message::type_name, TOPIC_QOS_DEFAULT, nullptr, 0),
                                "the topic " + dds::topic_read(config_), log);
  subscriber_ =
      opened(participant->create_subscriber(SUBSCRIBER_QOS_DEFAULT, nullptr, 0), "a subscriber", log);
  DDS::DataReaderQos qos;
  subscriber_->get_default_datareader_qos(qos);
  set_qos(qos, config_.qos);
  const bool listens = config_.receive == Receive::listener;
  DDS::StatusMask heard = DDS::SUBSCRIPTION_MATCHED_STATUS;
  if (listens) heard |= DDS::DATA_AVAILABLE_STATUS;
  DDS::DataReaderListener_var listener = new ReaderListener(calls_);
  DDS::DataReader_var reader =
      opened(subscriber_->create_datareader(topic, qos, listener, heard), "a reader", log);
  reader_ = type::RoundTrip_DataReader::_narrow(reader);
  if (listens) return;
  data_ = reader_->create_readcondition(DDS::ANY_SAMPLE_STATE, DDS::ANY_VIEW_STATE, DDS::ANY_INSTANCE_STATE);
  waitset_->attach_condition(data_);
  waitset_->attach_condition(interrupted_);
}

dds::Gaps::Writer writer_of(const DDS::SampleInfo& info) {
  dds::Gaps::Writer writer{};
  std::memcpy(writer.data(), &info.publication_handle, sizeof info.publication_handle);
  return writer;
}

void OpenEndpoint::take_all(type::RoundTrip_DataReader& reader) noexcept {
  constexpr int batch = 16;
  type::RoundTrip_Seq messages;
  DDS::SampleInfoSeq infos;
  while (reader.take(messages, infos, batch, DDS::ANY_SAMPLE_STATE, DDS::ANY_VIEW_STATE,
                     DDS::ANY_INSTANCE_STATE) == DDS::RETCODE_OK) {
    for (unsigned i = 0; i < messages.length(); ++i) {
      // The application reads one after the other, so each arrives when its turn comes.
      const std::int64_t arrival_ns = now_ns();
      if (!infos[i].valid_data) continue;
      gaps_.note(writer_of(infos[i]), infos[i].opendds_reserved_publication_seq);
      auto& bytes = messages[i].data;
      sink_.arrived(messages[i].seq, std::as_writable_bytes(std::span(bytes.get_buffer(), bytes.length())),
                    arrival_ns);
    }
    reader.return_loan(messages, infos);
  }
}

bool OpenEndpoint::send(std::uint64_t sequence, std::span<const std::byte> payload) noexcept {
  const auto length = static_cast<CORBA::ULong>(payload.size());
  // It only reads them; but a sequence is of bytes that may be written.
  auto* const bytes = const_cast<std::byte*>(payload.data());
  outgoing_.seq = sequence;
  outgoing_.data.replace(length, length, reinterpret_cast<CORBA::Octet*>(bytes), false);
  return writer_->write(outgoing_, DDS::HANDLE_NIL) == DDS::RETCODE_OK;
}

void OpenEndpoint::receive() noexcept {
  DDS::ConditionSeq active;
  waitset_->wait(active, {DDS::DURATION_INFINITE_SEC, DDS::DURATION_INFINITE_NSEC});
  take_all(*reader_);
}

// Its status "sample lost" counts what gave way in the history, and nothing that a link lost.
Losses OpenEndpoint::losses() {
  DDS::SampleLostStatus lost;
  reader_->get_sample_lost_status(lost);
  const auto overwritten = static_cast<std::uint64_t>(lost.total_count);
  const std::uint64_t missing = std::max(gaps_.missing(), overwritten);  // noticed with the next one taken
  return {.on_the_way = missing - overwritten, .overwritten = overwritten};
}

// Calls visit for each sample of a topic on which OpenDDS tells what it discovered of others.
template <typename Reader, typename Samples, typename Visit>
void for_each_discovered(SharedParticipant& participant, const char* topic, const Visit& visit) {
  DDS::Subscriber_var builtin = participant->get_builtin_subscriber();
  DDS::DataReader_var found = builtin->lookup_datareader(topic);
  const auto reader = Reader::_narrow(found);
  if (reader == nullptr) return;
  Samples samples;
  DDS::SampleInfoSeq infos;
  reader->read(samples, infos, DDS::LENGTH_UNLIMITED, DDS::ANY_SAMPLE_STATE, DDS::ANY_VIEW_STATE,
               DDS::ALIVE_INSTANCE_STATE);
  for (unsigned i = 0; i < samples.length(); ++i)
    if (infos[i].valid_data) visit(samples[i]);
  reader->return_loan(samples, infos);
  CORBA::release(reader);
}

std::size_t OpenEndpoint::other_participants() {
  std::size_t participants = 0;
  for_each_discovered<DDS::ParticipantBuiltinTopicDataDataReader, DDS::ParticipantBuiltinTopicDataSeq>(
      *participant_, dcps::BUILT_IN_PARTICIPANT_TOPIC, [&](const auto&) { ++participants; });
  return participants;
}

std::string OpenEndpoint::endpoints_of_other_type() {
  std::string found;
  const auto note = [&](const auto& end) {
    const std::string topic = end.topic_name.in();
    const std::string name = end.type_name.in();
    const bool is_ours = topic == dds::topic_read(config_) || topic == dds::topic_written(config_);
    if (is_ours && name != message::type_name) found = dds::other_type(topic, name);
  };
  for_each_discovered<DDS::PublicationBuiltinTopicDataDataReader, DDS::PublicationBuiltinTopicDataSeq>(
      *participant_, dcps::BUILT_IN_PUBLICATION_TOPIC, note);
  for_each_discovered<DDS::SubscriptionBuiltinTopicDataDataReader, DDS::SubscriptionBuiltinTopicDataSeq>(
      *participant_, dcps::BUILT_IN_SUBSCRIPTION_TOPIC, note);
  return found;
}

std::string OpenEndpoint::seen() {
  DDS::RequestedIncompatibleQosStatus requested;
  reader_->get_requested_incompatible_qos_status(requested);
  if (requested.total_count > 0)
    return dds::refused_writer(config_, static_cast<dds::Policy>(requested.last_policy_id));
  DDS::OfferedIncompatibleQosStatus offered;
  writer_->get_offered_incompatible_qos_status(offered);
  if (offered.total_count > 0)
    return dds::refused_reader(config_, static_cast<dds::Policy>(offered.last_policy_id));
  if (std::string found = endpoints_of_other_type(); !found.empty()) return found;
  return dds::others_without_our_topics(config_, other_participants(), matched());
}

std::map<std::string, std::string> OpenEndpoint::facts() {
  return dds::facts(config_, "OpenDDS " DDS_VERSION, "UDPv4", "ontime");
}

std::string version() { return DDS_VERSION; }

std::unique_ptr<Endpoint> open(const Config& config, Sink& sink) {
  dds::check(config, "opendds");
  return std::make_unique<OpenEndpoint>(config, sink);
}

}  // namespace
}  // namespace ontime::transport::opendds

extern "C" __attribute__((visibility("default")))
const ontime::transport::Plugin ontime_transport{.abi = ontime::transport::abi,
                                                 .name = "opendds",
                                                 .version = ontime::transport::opendds::version,
                                                 .capabilities = ontime::transport::shipped("opendds")->can,
                                                 .options = ontime::transport::shipped("opendds")->options,
                                                 .open = ontime::transport::opendds::open};
