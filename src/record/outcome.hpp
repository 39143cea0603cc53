// SPDX-License-Identifier: Apache-2.0
// A run's record: what was requested, and the outcome without the samples. Parsed once, when a run is read. A
// record may be of another program or damaged: what is missing or of another kind is nothing, 0 or empty, and
// `misfit` names the first of another kind. Plain data. Each struct lists its fields once, by the names that
// records have for them: for reading and for writing. A struct that was read is written as its `document`.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <nlohmann/json.hpp>

#include "conditions/conditions.hpp"

namespace ontime::record {

template <typename Value>
using ByName = std::map<std::string, Value, std::less<>>;
// The value of that name; if it is missing, one with all fields unknown.
template <typename Value>
const Value& find(const ByName<Value>& all, std::string_view name) {
  static const Value unknown{};
  const auto found = all.find(name);
  return found == all.end() ? unknown : found->second;
}

// The names of the two ends' hosts and of the two directions, in the order in which they are shown.
inline constexpr const char* both_hosts[] = {"controller", "component"};
inline constexpr const char* both_ways[] = {"to_component", "to_controller"};

// How a member with its default value is written: as it is, as null, or not at all.
enum class Written { always, or_null, if_set };
using enum Written;

// Calls field(name, member, written) for each pair of these.
template <Written written = always, typename Field, typename... Rest>
void each(Field& field, const char* name, auto& member, Rest&... rest) {
  field(name, member, written);
  if constexpr (sizeof...(rest) > 0) each<written>(field, rest...);
}

struct Clock {
  std::string source, reference;
  bool synchronised = false;
  std::optional<std::int64_t> error_ns, realtime_offset_ns, moved_ns;

  static void fields(auto& of, auto&& field) {
    each(field, "source", of.source, "reference", of.reference, "synchronised", of.synchronised, "error_ns",
         of.error_ns, "realtime_offset_ns", of.realtime_offset_ns, "moved_ns", of.moved_ns);
  }
};

struct Machine {
  nlohmann::json document;  // everything that the host reported
  std::string boot_id, kernel_release;
  std::optional<std::string> simulated;  // by what
  std::optional<std::int64_t> cpu_count, rt_runtime_us, rt_period_us;
  Clock clock;

  static void fields(auto& of, auto&& field) {
    each(field, "boot_id", of.boot_id, "kernel_release", of.kernel_release, "simulated", of.simulated,
         "cpu_count", of.cpu_count, "rt_runtime_us", of.rt_runtime_us, "rt_period_us", of.rt_period_us,
         "clock", of.clock);
  }
};

struct Thread {
  std::string role, name;
  std::optional<std::int64_t> tid;
  std::string policy;
  std::optional<std::int64_t> priority;
  std::string cpus;
  std::optional<std::int64_t> minor_faults, major_faults, voluntary_switches, involuntary_switches;
  std::optional<double> cpu_time_us;
  std::optional<std::uint64_t> instructions;
  bool is_of_background_topics() const {
    return role.starts_with("background ") || role.starts_with("neighbours ");  // its earlier name
  }

  static void fields(auto& of, auto&& field) {
    each(field, "role", of.role, "name", of.name, "tid", of.tid, "policy", of.policy, "priority", of.priority,
         "cpus", of.cpus, "minor_faults", of.minor_faults, "major_faults", of.major_faults,
         "voluntary_switches", of.voluntary_switches, "involuntary_switches", of.involuntary_switches,
         "cpu_time_us", of.cpu_time_us, "instructions", of.instructions);
  }
};

// A setting that was requested, and denied.
struct Refusal {
  std::string asked, found, remedy;

  static void fields(auto& of, auto&& field) {
    each(field, "asked", of.asked, "found", of.found, "remedy", of.remedy);
  }
};

// A setting of a machine: as it was applied, and as it was at the end.
struct Applied {
  std::string setting, thing;
  nlohmann::json before, after, now;
  bool lasted() const { return now == after; }

  static void fields(auto& of, auto&& field) {
    each(field, "setting", of.setting, "thing", of.thing, "before", of.before, "after", of.after, "now",
         of.now);
  }
};

// What an end's own reader lost; nothing: its middleware does not count it.
struct Losses {
  std::optional<std::uint64_t> on_the_way, overwritten;

  static void fields(auto& of, auto&& field) {
    each(field, "on_the_way", of.on_the_way, "overwritten", of.overwritten);
  }
};

// Where the kernel dropped packets.
struct Drops {
  nlohmann::json document;
  std::uint64_t own_sockets = 0, udp_receive = 0, udp_send = 0, fragments = 0, interface_received = 0,
                interface_sent = 0, backlog = 0;

  static void fields(auto& of, auto&& field) {
    each(field, "own_sockets", of.own_sockets, "udp_receive", of.udp_receive, "udp_send", of.udp_send,
         "fragments", of.fragments, "interface_received", of.interface_received, "interface_sent",
         of.interface_sent, "backlog", of.backlog);
  }
};

struct LinkFaults {
  std::uint64_t lost_frames = 0, cut_off_frames = 0, duplicated_frames = 0;

  static void fields(auto& of, auto&& field) {
    each(field, "lost_frames", of.lost_frames, "cut_off_frames", of.cut_off_frames, "duplicated_frames",
         of.duplicated_frames);
  }
};

// The queueing discipline that keeps a frame until its launch time.
struct Etf {
  std::uint64_t launched_frames = 0, dropped_frames = 0;

  static void fields(auto& of, auto&& field) {
    each(field, "launched_frames", of.launched_frames, "dropped_frames", of.dropped_frames);
  }
};

// What an interface carried, with all headers.
struct Carried {
  std::optional<std::uint64_t> sent_bytes, received_bytes;

  static void fields(auto& of, auto&& field) {
    each(field, "sent_bytes", of.sent_bytes, "received_bytes", of.received_bytes);
  }
};

// The interface was down, or taken away, from then on, until then.
struct LinkDown {
  std::optional<std::int64_t> from_ns, to_ns;
  bool taken = false;

  static void fields(auto& of, auto&& field) {
    each(field, "from_ns", of.from_ns, "to_ns", of.to_ns, "taken", of.taken);
  }
};

struct Link {
  std::string interface;  // empty: none was requested
  std::optional<std::uint64_t> sent_bytes, received_bytes, sent_packets, received_packets;
  std::uint64_t bytes() const { return sent_bytes.value_or(0) + received_bytes.value_or(0); }
  std::optional<std::string> gone;  // why its faults are not verified
  // Of links that the keeper prepared:
  std::optional<LinkFaults> faults;
  std::optional<Etf> etf;
  std::optional<Carried> beside_traffic;  // without ontime's own traffic
  std::vector<LinkDown> down;

  static void fields(auto& of, auto&& field) {
    each(field, "interface", of.interface, "down", of.down);
    each<if_set>(field, "sent_bytes", of.sent_bytes, "received_bytes", of.received_bytes, "sent_packets",
                 of.sent_packets, "received_packets", of.received_packets, "gone", of.gone, "faults",
                 of.faults, "etf", of.etf, "beside_traffic", of.beside_traffic);
  }
};

// The interface of ssh at an end, and whether the messages use it too, or may.
struct SshLink {
  std::optional<std::string> interface;  // nothing: unknown
  bool shared = false;

  static void fields(auto& of, auto&& field) { each(field, "interface", of.interface, "shared", of.shared); }
};

struct Transport {
  std::string name, version;
  ByName<std::string> facts;  // those that are texts
  // As it declares itself; earlier records lack it.
  std::optional<bool> below_ip, past_the_kernel, nodes, shares_threads;

  static void fields(auto& of, auto&& field) {
    each(field, "name", of.name, "version", of.version, "facts", of.facts);
    each<if_set>(field, "below_ip", of.below_ip, "past_the_kernel", of.past_the_kernel, "nodes", of.nodes,
                 "shares_threads", of.shares_threads);
  }
};

// What an end counted on the background topics.
struct BackgroundSent : roundtrip::BackgroundCounters {
  std::uint64_t payload_bytes = 0;

  static void fields(auto& of, auto&& field) {
    each(field, "payload_bytes", of.payload_bytes, "sent", of.sent, "refused", of.refused, "skipped_cycles",
         of.skipped_cycles, "received", of.received, "strays", of.strays, "overruns", of.overruns);
  }
};

// What each worker of a host's load was given, and the largest file seen of the hdd worker with the smallest.
struct GivenLoad {
  std::optional<std::uint64_t> vm_bytes, vm_mapped_bytes, hdd_bytes, hdd_file_bytes;

  static void fields(auto& of, auto&& field) {
    each<if_set>(field, "vm_bytes", of.vm_bytes, "vm_mapped_bytes", of.vm_mapped_bytes, "hdd_bytes",
                 of.hdd_bytes, "hdd_file_bytes", of.hdd_file_bytes);
  }
};

// A CPU quota of a control group around an end, that stopped (throttled) the group's ordinary threads.
struct CpuQuota {
  double cpus = 0;
  std::uint64_t throttled_periods = 0;  // of the quota, with such a stop
  std::uint64_t throttled_ns = 0;       // added over the CPUs

  static void fields(auto& of, auto&& field) {
    each(field, "cpus", of.cpus, "throttled_periods", of.throttled_periods, "throttled_ns", of.throttled_ns);
  }
};

// One of the two ends, with its machine.
struct Host {
  Machine machine;
  Transport transport;
  std::vector<Thread> threads;
  std::vector<Refusal> refusals;
  std::vector<Applied> kernel, isolation;
  ByName<std::string> settings;      // of the machine, as the run ended: name, value
  std::optional<bool> load_running;  // nothing: no load was requested
  std::optional<GivenLoad> load;     // nothing: an older ontime, which did not note it
  Losses losses;
  Drops drops;
  Link link;
  std::optional<SshLink> ssh_link;         // nothing: the coordinator does not reach it by ssh
  std::vector<std::string> shared_memory;  // segments of its middleware
  std::optional<std::uint64_t> answered;   // messages, as the component counted
  bool started_again = false;              // counts since then
  BackgroundSent background;
  std::optional<CpuQuota> cpu_quota;  // nothing: none stopped it

  static void fields(auto& of, auto&& field) {
    each(field, "transport", of.transport, "threads", of.threads, "refusals", of.refusals, "load_running",
         of.load_running, "losses", of.losses, "drops", of.drops, "ssh_link", of.ssh_link, "shared_memory",
         of.shared_memory, "answered", of.answered);
    each<or_null>(field, "machine", of.machine, "link", of.link, "neighbours", of.background);
    each<if_set>(field, "kernel", of.kernel, "isolation", of.isolation, "settings", of.settings, "load",
                 of.load, "started_again", of.started_again, "cpu_quota", of.cpu_quota);
  }
};

// How busy a host was, and what became of its clock meanwhile.
struct Activity {
  nlohmann::json document;
  std::optional<double> cpu_busy, cpu_pressure, memory_pressure, io_pressure, cpu_stolen;  // shares
  std::optional<double> suspended_s, clock_moved_s, clock_slew_ppm;

  static void fields(auto& of, auto&& field) {
    each(field, "cpu_busy", of.cpu_busy, "cpu_pressure", of.cpu_pressure, "memory_pressure",
         of.memory_pressure, "io_pressure", of.io_pressure, "cpu_stolen", of.cpu_stolen, "suspended_s",
         of.suspended_s, "clock_moved_s", of.clock_moved_s, "clock_slew_ppm", of.clock_slew_ppm);
  }
};

// Of the requested traffic, messages of background topics, or cycles; less falls short.
inline constexpr double enough_of_request = 0.95;

// Concurrent traffic of one direction.
struct TrafficSeen {
  std::optional<std::uint64_t> asked_bit_s;
  std::optional<double> sent_bit_s, received_bit_s;
  bool running = false;  // its iperf3, to the end
  // Less than `enough_of_request` of the rate arrived, the rate is unknown, or iperf3 died.
  std::optional<bool> is_short;

  static void fields(auto& of, auto&& field) {
    each(field, "asked_bit_s", of.asked_bit_s, "sent_bit_s", of.sent_bit_s, "received_bit_s",
         of.received_bit_s, "running", of.running, "short", of.is_short);
  }
};

// Messages of the background topics of one direction.
struct BackgroundSeen {
  std::uint64_t sent = 0, received = 0, lost = 0, skipped_cycles = 0, refused = 0, overruns = 0, strays = 0;
  bool is_short = false;

  static void fields(auto& of, auto&& field) {
    each(field, "sent", of.sent, "received", of.received, "lost", of.lost, "skipped_cycles",
         of.skipped_cycles, "refused", of.refused, "overruns", of.overruns, "strays", of.strays, "short",
         of.is_short);
  }
};

// Whether the kernel of a host was traced.
struct Traced {
  std::string error;                 // empty: it was
  std::vector<std::string> missing;  // what it does not tell

  static void fields(auto& of, auto&& field) {
    each<if_set>(field, "error", of.error);
    if (of.error.empty()) each(field, "missing", of.missing);
  }
};

// Of an imported run: how often each value was seen.
struct Counts {
  nlohmann::json values;  // [[ns, count] …]
  std::optional<std::int64_t> beyond, beyond_from_ns, max_ns;
  std::optional<double> mean_ns, unit_ns;

  static void fields(auto& of, auto&& field) {
    each(field, "values", of.values, "beyond", of.beyond, "beyond_from_ns", of.beyond_from_ns, "max_ns",
         of.max_ns, "mean_ns", of.mean_ns, "unit_ns", of.unit_ns);
  }
};

// Of a robot's own messages: late ones that `ontime listen` examined. A file may have no space for all
// causes.
struct Causes {
  std::uint64_t seen = 0, not_seen = 0;

  static void fields(auto& of, auto&& field) { each(field, "seen", of.seen, "not_seen", of.not_seen); }
};

// Why a robot's own message was late, in a note of it.
struct LateCause {
  std::string measures{};  // as of its run: "age" or "period"
  std::string date{};      // local time, of a run of weeks; else empty
  std::int64_t value_ns = 0, limit_ns = 0;
  std::string sentence{}, fix{};  // no times; fix: "" if nothing helps
  // The same without details that messages of one cause differ in, such as the number of another process.
  std::string alike{}, alike_fix{};
  std::int64_t ns = 0;  // of the delay, by this cause; 0: not seen
  std::optional<std::int64_t> cpu{};

  static void fields(auto& of, auto&& field) {
    each(field, "measures", of.measures, "value_ns", of.value_ns, "limit_ns", of.limit_ns, "sentence",
         of.sentence, "fix", of.fix, "alike", of.alike, "alike_fix", of.alike_fix);
    each<if_set>(field, "date", of.date, "ns", of.ns, "cpu", of.cpu);
  }
};

struct Outcome {
  Outcome() = default;
  Outcome(nlohmann::json);  // what a record has; implicit, for that is what an outcome is before it is read

  nlohmann::json document;            // as it was recorded; null: the run was cut off
  std::optional<std::string> misfit;  // "hosts.component.drops.udp_send"; empty: the whole outcome
  // Preliminary, of a robot's own messages: the counts until then, by the recorder that began then. Unix
  // time.
  std::optional<std::int64_t> counted_until_s, recorder_began_s;
  bool has_ended() const { return !document.is_null() && !counted_until_s; }
  std::optional<std::string> error;
  bool interrupted = false;
  bool loss_unknown = false;                 // of a robot's own messages: nothing tells what was lost
  bool unanswered = false;                   // the server never answered
  std::string refused_setting;               // that a host cannot have: "kernel.governor"; else empty
  bool has_counters = false;                 // else they are unknown
  roundtrip::Counters counters;              // as the client counted
  std::uint64_t late_by_response_only = 0;   // answered within the deadline of the round trip
  ByName<Host> hosts;                        // "controller", "component"
  ByName<Activity> conditions;               // of the same
  ByName<TrafficSeen> traffic;               // "to_component", "to_controller"
  ByName<BackgroundSeen> background;         // of the same
  std::optional<std::string> link_unproved;  // why it is not proved that messages took the link under test
  std::optional<ByName<Traced>> trace;       // by host
  Counts histogram;
  std::optional<Causes> causes;  // empty: not counted

  static void fields(auto& of, auto&& field) {
    if (of.has_counters) {
      for (const auto& [name, member] : roundtrip::counter_names) field(name, of.counters.*member, always);
      each(field, "trailing_due_ns", of.counters.trailing_due_ns, "trailing_until_ns",
           of.counters.trailing_until_ns);
    }
    each(field, "interrupted", of.interrupted);
    each<if_set>(field, "late_by_response_only", of.late_by_response_only, "error", of.error, "unanswered",
                 of.unanswered, "loss_unknown", of.loss_unknown, "refused_setting", of.refused_setting,
                 "hosts", of.hosts, "conditions", of.conditions, "traffic", of.traffic, "neighbours",
                 of.background, "link_unproved", of.link_unproved, "trace", of.trace, "histogram",
                 of.histogram, "causes", of.causes, "counted_until_s", of.counted_until_s, "recorder_began_s",
                 of.recorder_began_s);
  }
};

// Whether both ends are known to have shared one kernel.
bool on_one_machine(const Outcome&);
// The quotas that may have stopped measuring threads (they do not hold for real-time threads), by whose
// group: "the controller's", "the component's". Both ends on one machine are in one group as a rule: if both
// were stopped, the longer stop only, as "ontime's".
std::vector<std::pair<std::string, CpuQuota>> throttled(const Outcome&);

// An imported run, as the other tool described it.
struct Source {
  std::string from, file;
  std::optional<std::string> cmdline, start_time;

  static void fields(auto& of, auto&& field) {
    each(field, "from", of.from, "file", of.file, "cmdline", of.cmdline, "start_time", of.start_time);
  }
};

// What a run requested. If the record does not state a value: times and payload are 0, others the default.
struct Asked : conditions::Run {
  Asked() : Asked(nlohmann::json()) {}
  Asked(nlohmann::json);  // what a record has; implicit as above

  nlohmann::json document;            // as it was recorded
  std::optional<std::string> misfit;  // as of an outcome; without the fields of conditions::Run
  // The stated value of that name, such as "qos.depth"; null if not stated.
  const nlohmann::json& stated(const std::string& name) const {
    return conditions::member_of(document, name);
  }
  std::string ontime;  // the version that measured it
  std::vector<std::string> command_line;
  std::string scenario, scenario_file;  // its text, and what it was called
  std::string component_interface;
  conditions::Wire wire;
  std::optional<Source> imported;
  std::string measures;  // "age" or "period": of a robot's own messages, which have no answer; else empty
  bool is_listened() const { return !imported && !measures.empty(); }
  // "worst": of a robot's own messages those around the worst have samples; the outcome counts all.
  std::string kept;
  // What other components requested that this one did not, while it was measured.
  struct Others {
    std::size_t components = 0;
    bool load = false, traffic = false, topics = false;
    bool messages = false;  // another payload or rate
  } others;
  bool keeps_worst() const { return is_listened() && kept == "worst"; }

  static void fields(auto& of, auto&& field) {
    each(field, "ontime", of.ontime, "command_line", of.command_line, "scenario", of.scenario,
         "scenario_file", of.scenario_file, "component_interface", of.component_interface, "wire", of.wire,
         "imported", of.imported, "measures", of.measures, "kept", of.kept);
  }
};

// The first member of a record with an invalid type: "outcome.late"; empty if all are valid.
std::string misfit_of(const Asked&, const Outcome&);

// The JSON form of each of these structs, in a record and in what agents and keepers report of them.
template <typename Value>
nlohmann::json to_json(const Value&);
template <typename Value>
Value read(const nlohmann::json&);

}  // namespace ontime::record
