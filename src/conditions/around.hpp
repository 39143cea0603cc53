// SPDX-License-Identifier: Apache-2.0
// Conditions around a round trip: load, traffic, link faults, reserved CPUs, the wire. Plain data.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace ontime::conditions {

// Workers of stress-ng, as the paper's `stress`; 0: no worker of that kind.
struct Workers {
  int cpu = 0;                  // --cpu
  int vm = 0;                   // --vm
  int io = 0;                   // --io, which calls sync(2) over and over as stress's -i; not --iomix
  int hdd = 0;                  // --hdd
  std::uint64_t vm_bytes = 0;   // of each vm worker; 0: not stated, see background::fit()
  std::uint64_t hdd_bytes = 0;  // of each hdd worker; 0: not stated
  bool any() const { return cpu + vm + io + hdd > 0; }
};

// Concurrent UDP traffic over the link under test, by iperf3.
struct Traffic {
  enum class Direction { both, to_component, to_controller } direction = Direction::both;
  std::uint64_t bits_per_s = 0;         // of payload, each way; 0: no traffic
  std::uint64_t datagram_bytes = 1470;  // the choice of the paper's iperf: a frame of Ethernet is full then
  int priority = 0;                     // SCHED_FIFO, of iperf3 itself; 0: none
  bool any() const { return bits_per_s > 0; }
  bool operator==(const Traffic&) const = default;
};
const char* word_of(Traffic::Direction);

// Nothing arrives over the link, at either end.
struct Cut {
  std::chrono::nanoseconds at;  // after the first counted message was due
  std::chrono::milliseconds length;
};

// Faults and markings of the frames that an end receives and sends over its interface.
struct Faults {
  double loss = 0;                      // share of the arriving frames
  double duplicates = 0;                // share of the leaving frames that are sent twice
  std::chrono::microseconds delay{0};   // of leaving frames
  std::chrono::microseconds jitter{0};  // by how much the delay varies, either way
  double reordered = 0;                 // share of the leaving frames that skip the delay
  bool cut = false;                     // the link can be cut
  // The queueing discipline of leaving frames, in the words of tc: "prio bands 3"; and what is below one of
  // its classes: "prio bands 3 below 1 etf clockid CLOCK_TAI delta 300000"; "": the kernel's choice.
  std::string qdisc{};
  // SO_PRIORITY of the messages and of the traffic, by which a discipline tells them apart; nothing:
  // unchanged.
  std::optional<int> message_priority{}, traffic_priority{};
  std::optional<int> dscp{};  // of the messages' IP packets; nothing: unchanged
  // Markings, which a host applies to all links; and the rest, which applies to one link.
  Faults marks() const {
    Faults alone;
    alone.message_priority = message_priority, alone.traffic_priority = traffic_priority, alone.dscp = dscp;
    return alone;
  }
  Faults without_marks() const {
    auto rest = *this;
    rest.message_priority = rest.traffic_priority = rest.dscp = {};
    return rest;
  }
  bool any() const { return *this != Faults{}; }
  // Frames are lost, late or sent twice: faults alone, no markings and no queueing discipline.
  bool disturb() const {
    return loss > 0 || duplicates > 0 || delay.count() > 0 || jitter.count() > 0 || reordered > 0 || cut;
  }
  bool operator==(const Faults&) const = default;
};

// "prio bands 3 below 1 etf delta 9": {prio bands 3}, below no class, and {etf delta 9}, below the class 1.
struct Discipline {
  std::string below;
  std::vector<std::string> words;
};
std::vector<Discipline> disciplines_of(const std::string& words);
bool is_qdisc(const std::string& words);              // whether Faults::qdisc can be that
const std::vector<std::string>& known_disciplines();  // the first words that it can have
bool has_etf(const std::string& words);               // which keeps a frame until its launch time

// The robot's own messages, which are listened to on this machine while a run is measured.
struct Listening {
  std::vector<std::string> topics;                                // "/cmd_vel"; none: nothing is listened to
  std::optional<std::chrono::nanoseconds> deadline, period, age;  // listen::Limits
  bool any() const { return !topics.empty(); }
};

// CPUs that are reserved for the two ends, and a limit for what runs beside them.
struct Isolation {
  std::string cpus;         // reserved: "1", "2-3"; "": none
  bool interrupts = false;  // keep interrupts off them: settings::away_to(rest())
  // For load and traffic together.
  double load_quota = 0;  // time on CPUs in that time: 0.5 is half of one CPU; 0: no limit
  int load_weight = 0;    // 1 to 10000, where all others have 100; 0: as all others
  bool limits() const { return load_quota > 0 || load_weight > 0; }
  bool any() const { return !cpus.empty() || interrupts || limits(); }
  bool operator==(const Isolation&) const = default;
};

// Properties of the virtual cable between two namespaces.
struct Wire {
  // The rate at which the frames of each end leave it, one after the other, 64 of them waiting at most; 0: at
  // once.
  std::uint64_t bits_per_s = 0;
  // The VLAN of the ends' interfaces, which have eight queues then, and give frames of priority 0 to 7 that
  // class (PCP) in their tag; 0: none.
  int vlan = 0;
  bool any() const { return bits_per_s > 0 || vlan > 0; }
  // For record's structs.
  static void fields(auto& of, auto&& field) {
    field("bits_per_s", of.bits_per_s);
    field("vlan", of.vlan);
  }
};

// DDS Security: what becomes of each message, in the specification's words for its payload
// (data_protection_kind). From `authenticate` on, participants show each other who they are.
enum class Security { off, authenticate, sign, encrypt };
const char* word_of(Security);

}  // namespace ontime::conditions
