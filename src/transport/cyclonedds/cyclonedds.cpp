// SPDX-License-Identifier: Apache-2.0
// Cyclone DDS, by its C API. Messages go in and come out as CDR (see cdr_type.hpp).
#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <deque>
#include <filesystem>
#include <system_error>
#include <thread>

#include <dds/dds.h>
#include <dds/version.h>
#include <dlfcn.h>
#include <sched.h>
#include <unistd.h>

#include "message/message.hpp"
#include "transport/clock.hpp"
#include "transport/cyclonedds/cdr_type.hpp"
#include "transport/cyclonedds/configuration.hpp"
#include "transport/cyclonedds/log.hpp"
#include "transport/dds.hpp"
#include "transport/shipped.hpp"
#include "transport/transport.hpp"

namespace ontime::transport::cyclonedds {
namespace {

dds_entity_t opened(dds_entity_t entity, const std::string& what, Log& log) {
  if (entity >= 0) return entity;
  const std::string why = log.text();
  throw Error("cyclonedds: cannot open " + what + ": " + (why.empty() ? dds_strretcode(entity) : why));
}

// Debian has Cyclone's plug-ins for security in a folder of their own, where Cyclone itself does not look.
std::string plugin_for(const std::string& name) {
  Dl_info ours{};
  if (dladdr(reinterpret_cast<const void*>(&dds_create_domain), &ours) != 0) {
    const auto there = std::filesystem::path(ours.dli_fname).parent_path() / "libddsc0debian" /
                       ("libdds_security_" + name + ".so");
    if (std::error_code none; std::filesystem::exists(there, none)) return there;
  }
  return "dds_security_" + name;
}

void demand_security(dds_qos_t& qos, const Security& security) {
  const auto load = [&qos](const std::string& what, const std::string& plugin, const std::string& function) {
    dds_qset_prop(&qos, ("dds.sec." + what + ".library.path").c_str(), plugin_for(plugin).c_str());
    dds_qset_prop(&qos, ("dds.sec." + what + ".library.init").c_str(), ("init_" + function).c_str());
    dds_qset_prop(&qos, ("dds.sec." + what + ".library.finalize").c_str(), ("finalize_" + function).c_str());
  };
  load("auth", "auth", "authentication");
  load("crypto", "crypto", "crypto");
  load("access", "ac", "access_control");
  const auto give = [&qos](const char* what, const std::string& data) {
    dds_qset_prop(&qos, what, ("data:," + data).c_str());
  };
  give("dds.sec.auth.identity_ca", security.identity_ca);
  give("dds.sec.auth.identity_certificate", security.identity_certificate);
  give("dds.sec.auth.private_key", security.private_key);
  give("dds.sec.access.permissions_ca", security.permissions_ca);
  give("dds.sec.access.governance", security.governance);
  give("dds.sec.access.permissions", security.permissions);
}

// Shared by all endpoints of this process: Cyclone opens a domain once in a process.
struct Domain {
  std::deque<Blocks> blocks;  // of each endpoint, for messages may outlive it
  dds_entity_t entity = 0;
  ~Domain() {
    if (entity > 0) dds_delete(entity);
  }
};

std::unique_ptr<dds_listener_t, decltype(&dds_delete_listener)> new_listener(void* self) {
  return {dds_create_listener(self), dds_delete_listener};
}

std::unique_ptr<dds_qos_t, decltype(&dds_delete_qos)> new_qos() { return {dds_create_qos(), dds_delete_qos}; }

auto vendor_qos(const Qos& qos) {
  auto result = new_qos();
  const auto history = qos.history == History::keep_all ? DDS_HISTORY_KEEP_ALL : DDS_HISTORY_KEEP_LAST;
  const int depth = qos.history == History::keep_all ? 1 : qos.depth;
  dds_qset_reliability(
      result.get(),
      qos.reliability == Reliability::reliable ? DDS_RELIABILITY_RELIABLE : DDS_RELIABILITY_BEST_EFFORT,
      DDS_MSECS(100));
  dds_qset_history(result.get(), history, depth);
  dds_qset_durability(result.get(), qos.durability == Durability::transient_local
                                        ? DDS_DURABILITY_TRANSIENT_LOCAL
                                        : DDS_DURABILITY_VOLATILE);
  // Late readers get the same history as the others.
  dds_qset_durability_service(result.get(), 0, history, depth, DDS_LENGTH_UNLIMITED, DDS_LENGTH_UNLIMITED,
                              DDS_LENGTH_UNLIMITED);
  return result;
}

// A new thread has its parent's name, and sets its own a little later.
void await_names(const std::vector<dds::Task>& before) {
  const auto all = dds::tasks();
  const auto self = std::ranges::find(all, gettid(), &dds::Task::tid);
  const auto unnamed = [&](const dds::Task& task) { return self != all.end() && task.name == self->name; };
  const std::int64_t end_ns = now_ns() + 1'000'000'000;
  for (auto now = dds::started_since(before); std::any_of(now.begin(), now.end(), unnamed);
       now = dds::started_since(before)) {
    if (now_ns() > end_ns) return;  // threads that are not Cyclone's
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
}

class CycloneEndpoint final : public Endpoint {
 public:
  CycloneEndpoint(const Config& config, Sink& sink);
  CycloneEndpoint(const Config& config, Sink& sink, const CycloneEndpoint& first, Where where);
  ~CycloneEndpoint() override;

  std::unique_ptr<Endpoint> beside(const Config& config, Sink& sink, Where where) override;
  Matched matched() override { return matches_.now(); }
  Losses losses() override;
  std::string seen() override;
  bool send(std::uint64_t sequence, std::span<const std::byte> payload) noexcept override;
  void receive() noexcept override;
  void interrupt() noexcept override { dds_set_guardcondition(interrupted_, true); }
  std::vector<Thread> threads() override;
  std::map<std::string, std::string> facts() override;

 private:
  // Opens nothing yet, so that the destructor runs wherever a later constructor fails.
  CycloneEndpoint(const Config& config, Sink& sink, Configuration configuration,
                  std::shared_ptr<Domain> domain, dds_entity_t participant);
  void open_participant(Log& log);
  void open_ends(Log& log);
  void open_writer(dds_entity_t topic, const dds_qos_t& qos, Log& log);
  void open_reader(dds_entity_t topic, const dds_qos_t& qos, Log& log);
  void take_all(dds_entity_t reader) noexcept;
  void give_priorities_that_xml_cannot();
  std::size_t other_participants();
  std::string endpoints_of_other_type();

  Config config_;
  Sink& sink_;
  Configuration configuration_;
  dds::Matches matches_;
  dds::Gaps gaps_;
  std::shared_ptr<Domain> domain_;
  Blocks& blocks_;
  std::vector<dds_entity_t> own_;  // closed with this endpoint, if the domain stays
  ddsi_sertype* type_ = nullptr;
  dds_entity_t participant_ = 0;
  dds_entity_t writer_ = 0;
  dds_entity_t reader_ = 0;
  dds_entity_t waitset_ = 0;
  dds_entity_t interrupted_ = 0;
};

CycloneEndpoint::CycloneEndpoint(const Config& config, Sink& sink, Configuration configuration,
                                 std::shared_ptr<Domain> domain, dds_entity_t participant)
    : config_(config),
      sink_(sink),
      configuration_(std::move(configuration)),
      domain_(std::move(domain)),
      blocks_(domain_->blocks.emplace_back(message::cdr_overhead + config.max_payload_bytes)),
      participant_(participant) {}

CycloneEndpoint::CycloneEndpoint(const Config& config, Sink& sink)
    : CycloneEndpoint(config, sink, configuration(config), std::make_shared<Domain>(), 0) {
  Log log;
  const auto tasks_before = dds::tasks();
  const auto sockets_before = dds::sockets();
  std::string where = "domain " + std::to_string(config.domain);
  if (!config.interface.empty()) where += " on " + config.interface + " (" + config.address + ")";
  where += " as configured by " + configuration_.source;
  domain_->entity = opened(
      dds_create_domain(static_cast<dds_domainid_t>(config.domain), configuration_.xml.c_str()), where, log);
  open_participant(log);
  open_ends(log);
  dds::keep_to_link(sockets_before, config, "cyclonedds");
  await_names(tasks_before);
  give_priorities_that_xml_cannot();
}

CycloneEndpoint::CycloneEndpoint(const Config& config, Sink& sink, const CycloneEndpoint& first, Where where)
    : CycloneEndpoint(config, sink, first.configuration_, first.domain_, first.participant_) {
  Log log;
  const auto sockets_before = dds::sockets();
  if (where == Where::same_process) open_participant(log);
  open_ends(log);
  dds::keep_to_link(sockets_before, config, "cyclonedds");
}

CycloneEndpoint::~CycloneEndpoint() {
  // The threads that call the last endpoint end here, before its members are destroyed.
  if (domain_.use_count() == 1) {
    domain_.reset();
    return;
  }
  for (auto entity = own_.rbegin(); entity != own_.rend(); ++entity) dds_delete(*entity);
}

std::unique_ptr<Endpoint> CycloneEndpoint::beside(const Config& config, Sink& sink, Where where) {
  dds::check(config, "cyclonedds");
  return std::make_unique<CycloneEndpoint>(config, sink, *this, where);
}

void CycloneEndpoint::open_participant(Log& log) {
  const auto qos = new_qos();
  if (config_.security) demand_security(*qos, *config_.security);
  participant_ =
      opened(dds_create_participant(static_cast<dds_domainid_t>(config_.domain), qos.get(), nullptr),
             "a participant", log);
  own_.push_back(participant_);
}

void CycloneEndpoint::open_ends(Log& log) {
  const auto open_topic = [&](const std::string& name) {
    type_ = new_type(blocks_);
    const dds_entity_t topic =
        dds_create_topic_sertype(participant_, name.c_str(), &type_, nullptr, nullptr, nullptr);
    if (topic < 0) ddsi_sertype_unref(type_);
    own_.push_back(opened(topic, "the topic " + name, log));
    return topic;
  };
  const dds_entity_t read = open_topic(dds::topic_read(config_));
  const dds_entity_t written = open_topic(dds::topic_written(config_));

  const auto qos = vendor_qos(config_.qos);
  open_writer(written, *qos, log);  // before the reader, whose listener may call send() at once
  open_reader(read, *qos, log);
}

void CycloneEndpoint::open_writer(dds_entity_t topic, const dds_qos_t& qos, Log& log) {
  const auto listener = new_listener(this);
  dds_lset_publication_matched(
      listener.get(), [](dds_entity_t, dds_publication_matched_status_t status, void* self) {
        static_cast<CycloneEndpoint*>(self)->matches_.set_readers(static_cast<int>(status.current_count));
      });
  writer_ = opened(dds_create_writer(participant_, topic, &qos, listener.get()), "a writer", log);
  own_.push_back(writer_);
}

void CycloneEndpoint::open_reader(dds_entity_t topic, const dds_qos_t& qos, Log& log) {
  const auto listener = new_listener(this);
  dds_lset_subscription_matched(
      listener.get(), [](dds_entity_t, dds_subscription_matched_status_t status, void* self) {
        static_cast<CycloneEndpoint*>(self)->matches_.set_writers(static_cast<int>(status.current_count));
      });
  if (config_.receive == Receive::listener)
    dds_lset_data_available(listener.get(), [](dds_entity_t reader, void* self) {
      static_cast<CycloneEndpoint*>(self)->take_all(reader);
    });
  reader_ = opened(dds_create_reader(participant_, topic, &qos, listener.get()), "a reader", log);
  own_.push_back(reader_);
  if (config_.receive == Receive::listener) return;
  waitset_ = opened(dds_create_waitset(participant_), "a waitset", log);
  own_.push_back(waitset_);
  interrupted_ = opened(dds_create_guardcondition(participant_), "a guard condition", log);
  own_.push_back(interrupted_);
  const dds_entity_t data = opened(dds_create_readcondition(reader_, DDS_ANY_STATE), "a read condition", log);
  opened(dds_waitset_attach(waitset_, data, 0), "a waitset", log);
  opened(dds_waitset_attach(waitset_, interrupted_, 0), "a waitset", log);
}

void CycloneEndpoint::take_all(dds_entity_t reader) noexcept {
  constexpr std::uint32_t batch = 16;
  std::array<ddsi_serdata*, batch> messages;
  std::array<dds_sample_info_t, batch> infos;
  dds_return_t count = batch;
  while (count == static_cast<dds_return_t>(batch)) {
    count = dds_takecdr(reader, messages.data(), batch, infos.data(), DDS_ANY_STATE);
    for (std::size_t i = 0; i < static_cast<std::size_t>(std::max(count, 0)); ++i) {
      // The application reads them one by one, so each arrives at its turn.
      const std::int64_t arrival_ns = now_ns();
      if (const Origin* const origin = taken(*messages[i])) gaps_.note(origin->writer, origin->number);
      if (const auto view = message::decode(cdr(*messages[i])))
        sink_.arrived(view->sequence, view->payload, arrival_ns);
      ddsi_serdata_unref(messages[i]);
    }
  }
}

bool CycloneEndpoint::send(std::uint64_t sequence, std::span<const std::byte> payload) noexcept {
  ddsi_serdata* const message = new_message(*type_, sequence, payload);
  return message != nullptr && dds_writecdr(writer_, message) == DDS_RETCODE_OK;
}

void CycloneEndpoint::receive() noexcept {
  dds_waitset_wait(waitset_, nullptr, 0, DDS_INFINITY);
  take_all(reader_);
}

// Cyclone 0.10 reports neither: its status "sample lost" counts messages that came out of order.
Losses CycloneEndpoint::losses() {
  const std::uint64_t overwritten = blocks_.overwritten();
  const std::uint64_t missing = std::max(gaps_.missing(), overwritten);  // noticed with the next one taken
  return {.on_the_way = missing - overwritten, .overwritten = overwritten};
}

// Calls visit for each sample of one of Cyclone's discovery topics.
template <typename Sample, typename Visit>
void for_each_discovered(dds_entity_t participant, dds_entity_t builtin_topic, const Visit& visit) {
  const dds_entity_t reader = dds_create_reader(participant, builtin_topic, nullptr, nullptr);
  if (reader < 0) return;
  void* sample[] = {nullptr};
  dds_sample_info_t info;
  while (dds_take(reader, sample, &info, 1, 1) == 1) {
    if (info.valid_data) visit(*static_cast<const Sample*>(sample[0]));
    dds_return_loan(reader, sample, 1);
    sample[0] = nullptr;
  }
  dds_delete(reader);
}

std::size_t CycloneEndpoint::other_participants() {
  std::size_t participants = 0;
  for_each_discovered<dds_builtintopic_participant_t>(participant_, DDS_BUILTIN_TOPIC_DCPSPARTICIPANT,
                                                      [&](const auto&) { ++participants; });
  return participants == 0 ? 0 : participants - 1;  // we are one of them
}

std::string CycloneEndpoint::endpoints_of_other_type() {
  std::string found;
  for (const dds_entity_t builtin : {DDS_BUILTIN_TOPIC_DCPSPUBLICATION, DDS_BUILTIN_TOPIC_DCPSSUBSCRIPTION})
    for_each_discovered<dds_builtintopic_endpoint_t>(participant_, builtin, [&](const auto& endpoint) {
      const std::string topic = endpoint.topic_name;
      const std::string type = endpoint.type_name;
      const bool ours = topic == dds::topic_read(config_) || topic == dds::topic_written(config_);
      if (ours && type != message::type_name) found = dds::other_type(topic, type);
    });
  return found;
}

std::string CycloneEndpoint::seen() {
  dds_requested_incompatible_qos_status_t requested{};
  dds_get_requested_incompatible_qos_status(reader_, &requested);
  if (requested.total_count > 0) return dds::refused_writer(config_, dds::Policy{requested.last_policy_id});
  dds_offered_incompatible_qos_status_t offered{};
  dds_get_offered_incompatible_qos_status(writer_, &offered);
  if (offered.total_count > 0) return dds::refused_reader(config_, dds::Policy{offered.last_policy_id});
  if (std::string found = endpoints_of_other_type(); !found.empty()) return found;
  return dds::others_without_our_topics(config_, other_participants(), matched());
}

std::vector<Thread> CycloneEndpoint::threads() {
  std::vector<Thread> found;
  for (const auto& [tid, name] : dds::tasks())
    if (const NamedThread* const thread = named_thread(name)) found.push_back({tid, thread->role, name});
  return found;
}

void CycloneEndpoint::give_priorities_that_xml_cannot() {
  for (const Thread& thread : threads()) {
    const auto priority = config_.fifo_priority.find(thread.role);
    if (named_thread(thread.name)->configurable || priority == config_.fifo_priority.end()) continue;
    const sched_param wanted{.sched_priority = priority->second};
    if (sched_setscheduler(thread.tid, SCHED_FIFO, &wanted) != 0)
      throw Error("cyclonedds: cannot give its thread " + thread.name + " the real-time priority " +
                  std::to_string(priority->second) + ": " + std::system_category().message(errno));
  }
}

std::map<std::string, std::string> CycloneEndpoint::facts() {
  return dds::facts(config_, "Cyclone DDS " DDS_VERSION, configuration_.carrier, configuration_.source);
}

std::string version() { return DDS_VERSION; }

std::unique_ptr<Endpoint> open(const Config& config, Sink& sink) {
  dds::check(config, "cyclonedds");
  return std::make_unique<CycloneEndpoint>(config, sink);
}

}  // namespace
}  // namespace ontime::transport::cyclonedds

extern "C" __attribute__((visibility("default"))) const ontime::transport::Plugin ontime_transport{
    .abi = ontime::transport::abi,
    .name = "cyclonedds",
    .version = ontime::transport::cyclonedds::version,
    .capabilities = ontime::transport::shipped("cyclonedds")->can,
    .options = ontime::transport::shipped("cyclonedds")->options,
    .open = ontime::transport::cyclonedds::open};
