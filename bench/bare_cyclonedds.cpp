// SPDX-License-Identifier: Apache-2.0
// A hand-written round trip over Cyclone DDS: a listener that takes CDR and writes CDR, with ontime's own
// type.
//   bare_cyclonedds pong DOMAIN PAYLOAD [reliable]
//   bare_cyclonedds ping DOMAIN PAYLOAD SECONDS [reliable]     round trips, a line of JSON
#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include <dds/dds.h>

#include "bare.hpp"
#include "message/message.hpp"
#include "transport/cyclonedds/cdr_type.hpp"

namespace {

namespace cyclonedds = ontime::transport::cyclonedds;
namespace message = ontime::message;
using namespace std::chrono_literals;

dds_entity_t opened(dds_entity_t entity, const char* what) {
  if (entity >= 0) return entity;
  std::fprintf(stderr, "%s: %s\n", what, dds_strretcode(entity));
  std::_Exit(3);
}

class End {
 public:
  End(dds_domainid_t domain, std::size_t payload_bytes, bool reliable)
      : blocks_(message::cdr_overhead + payload_bytes), qos_(dds_create_qos(), dds_delete_qos) {
    participant_ = opened(dds_create_participant(domain, nullptr, nullptr), "participant");
    dds_qset_reliability(qos_.get(), reliable ? DDS_RELIABILITY_RELIABLE : DDS_RELIABILITY_BEST_EFFORT,
                         DDS_MSECS(100));
    dds_qset_history(qos_.get(), DDS_HISTORY_KEEP_LAST, 1);
  }
  virtual ~End() = default;
  End(const End&) = delete;
  End& operator=(const End&) = delete;

 protected:
  void open(const char* read, const char* written) {
    writer_ = opened(dds_create_writer(participant_, topic(written), qos_.get(), nullptr), "writer");
    dds_listener_t* const listener = dds_create_listener(this);
    dds_lset_data_available(listener, [](dds_entity_t reader, void* self) {
      ddsi_serdata* taken = nullptr;
      dds_sample_info_t info;
      while (dds_takecdr(reader, &taken, 1, &info, DDS_ANY_STATE) == 1) {
        if (info.valid_data)
          if (const auto view = message::decode(cyclonedds::cdr(*taken)))
            static_cast<End*>(self)->arrived(*view, bare::now_ns());
        ddsi_serdata_unref(taken);
      }
    });
    opened(dds_create_reader(participant_, topic(read), qos_.get(), listener), "reader");
    dds_delete_listener(listener);
  }

  virtual void arrived(const message::View& view, std::int64_t at_ns) = 0;

  void write(std::uint64_t sequence, std::span<const std::byte> payload) {
    dds_writecdr(writer_, cyclonedds::new_message(*type_, sequence, payload));
  }

 private:
  dds_entity_t topic(const char* name) {
    type_ = cyclonedds::new_type(blocks_);
    return opened(dds_create_topic_sertype(participant_, name, &type_, nullptr, nullptr, nullptr), name);
  }

  cyclonedds::Blocks blocks_;
  std::unique_ptr<dds_qos_t, decltype(&dds_delete_qos)> qos_;
  ddsi_sertype* type_ = nullptr;
  dds_entity_t participant_ = 0, writer_ = 0;
};

class Pong final : public End {
 public:
  Pong(dds_domainid_t domain, std::size_t payload_bytes, bool reliable)
      : End(domain, payload_bytes, reliable) {
    open("rt/ping", "rt/pong");
  }

 private:
  void arrived(const message::View& view, std::int64_t) override { write(view.sequence, view.payload); }
};

class Ping final : public End {
 public:
  Ping(dds_domainid_t domain, std::size_t payload_bytes, bool reliable, double seconds)
      : End(domain, payload_bytes, reliable), payload_(payload_bytes), round_trips_(seconds) {
    open("rt/pong", "rt/ping");
  }

  int run() {
    // The listener sends upon an answer; this thread starts it, also where a message was lost.
    for (auto seen = answers_.load(); !done_; seen = answers_) {
      std::this_thread::sleep_for(500ms);
      if (answers_ == seen && !done_) go_on(false, bare::now_ns());
    }
    return round_trips_.print();
  }

 private:
  void arrived(const message::View& view, std::int64_t at_ns) override {
    if (view.sequence != sequence_) return;
    ++answers_;
    go_on(true, at_ns);
  }

  void go_on(bool answered, std::int64_t at_ns) {
    round_trips_.add(answered, sent_ns_, at_ns);
    if (round_trips_.done()) {
      done_ = true;
      return;
    }
    const auto sequence = ++sequence_;
    sent_ns_ = bare::now_ns();
    write(sequence, payload_);
  }

  std::vector<std::byte> payload_;
  bare::RoundTrips round_trips_;
  std::int64_t sent_ns_ = 0;
  std::atomic<std::uint64_t> sequence_{0}, answers_{0};
  std::atomic<bool> done_{false};
};

}  // namespace

int main(int argc, char** argv) {
  std::vector<std::string> arguments(argv + 1, argv + argc);
  const bool reliable = !arguments.empty() && arguments.back() == "reliable";
  if (reliable) arguments.pop_back();
  if (arguments.size() == 3 && arguments[0] == "pong") {
    const Pong pong(static_cast<dds_domainid_t>(std::stoul(arguments[1])), std::stoul(arguments[2]),
                    reliable);
    while (true) std::this_thread::sleep_for(1h);
  }
  if (arguments.size() == 4 && arguments[0] == "ping") {
    // Ends with the process: Cyclone's threads may still be in the listener.
    auto* const ping = new Ping(static_cast<dds_domainid_t>(std::stoul(arguments[1])),
                                std::stoul(arguments[2]), reliable, std::stod(arguments[3]));
    return ping->run();
  }
  std::fputs(
      "usage: bare_cyclonedds pong DOMAIN PAYLOAD [reliable] | ping DOMAIN PAYLOAD SECONDS [reliable]\n",
      stderr);
  return 2;
}
