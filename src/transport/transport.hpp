// SPDX-License-Identifier: Apache-2.0
// The interface for middlewares: bytes in, bytes out, everything created before the first message.
//
// A transport is a shared object that exports one `ontime_transport` of type Plugin. It is loaded at run
// time, and a process opens one only: a missing middleware costs nothing, and two vendors' libraries never
// run together. It may use the module `message` and its middleware, and nothing else of ontime.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include <sys/types.h>

namespace ontime::transport {

// What was requested, what was found, and the fix. Thrown by load() and Plugin::open, never later.
struct Error : std::runtime_error {
  using std::runtime_error::runtime_error;
};
// The request is impossible on any machine: an unknown word or invalid value (exit code 2; Error is 3).
struct WrongInput : Error {
  using Error::Error;
};

enum class Role { client, server };  // the client writes ping and reads pong, the server the other way
enum class Receive {
  listener,
  waitset
};  // on the middleware's thread, or on ours inside Endpoint::receive()
enum class Reliability { best_effort, reliable };
enum class History { keep_last, keep_all };
enum class Durability { volatile_, transient_local };

struct Qos {
  Reliability reliability = Reliability::best_effort;
  History history = History::keep_last;
  int depth = 1;  // of keep_last
  Durability durability = Durability::volatile_;
};

// The role of a thread: "send", "receive", "delivery", "discovery", "timer", "other"; "resend" for a thread
// that resends messages and spins on locks that other threads hold: with a real-time priority it could block
// them forever (seen: two of Fast DDS's threads, on two CPUs, for minutes), so it never gets one, whatever is
// requested; and "unknown" if the role cannot be found here, so that the caller can report that it got no
// priority.
struct Thread {
  pid_t tid;
  std::string role;
  std::string name;  // as the middleware calls it
};

// What DDS Security needs of a participant, by the names of its properties; never recorded.
struct Security {
  std::string level;                                           // "authenticate", "sign", "encrypt"
  std::string identity_ca, identity_certificate, private_key;  // PEM
  std::string permissions_ca, governance, permissions;         // PEM; signed, as S/MIME
};

struct Config {
  Role role = Role::client;
  Receive receive = Receive::listener;
  Qos qos;
  std::size_t max_payload_bytes = 0;  // no larger message will be sent or need be received
  std::string interface;              // the link under test, by name; empty: the middleware's own choice
  std::string address;                // this host's IPv4 address on that link; set whenever `interface` is
  std::vector<std::string> peers;     // HOST[:PORT]; for DDS, where to look beside multicast
  // The client's deadline: a longer round trip is late. For a transport that reports its messages live.
  std::int64_t deadline_ns = 10'000'000;
  // As ROS 2 names them, whole: "/ping", "/robot/ping". On the wire of DDS they are "rt/ping" …
  std::string ping_topic = "/ping", pong_topic = "/pong";
  int domain = 0;  // DDS domain; UDP: port 7900 + domain where none is given
  // Each packet carries a launch time, this long after it is sent; the queueing discipline etf keeps it until
  // then. 0: packets leave at once.
  std::int64_t launch_ns = 0;
  // SO_PRIORITY of frames without IP, for which no packet filter can set it. With an IP header: ignored.
  std::optional<int> priority;
  // SCHED_FIFO priority of new threads by role, if the middleware has such a setting. Contains only what this
  // process is permitted to set.
  std::map<std::string, int> fifo_priority;
  // For background topics: ordinary settings, whatever the options of the critical topic.
  bool background = false;
  std::optional<Security> security;            // only for a transport that has it
  std::map<std::string, std::string> options;  // the transport's own, named in Plugin::options
};

// Receives a transport's arrivals.
class Sink {
 public:
  // Real-time. `payload` is valid, and may be overwritten, until the call returns. `arrival_ns`: now_ns() at
  // the time when the application can read the bytes: after the take or copy, not at the notification. It is
  // the same moment for every transport.
  // Endpoint::send() may be called from here. May be called by several threads of the middleware at once.
  virtual void arrived(std::uint64_t sequence, std::span<std::byte> payload,
                       std::int64_t arrival_ns) noexcept = 0;

 protected:
  ~Sink() = default;
};

struct Matched {
  int readers = 0;              // others that read what we write
  int writers = 0;              // others that write what we read
  std::int64_t changed_ns = 0;  // when either number last changed; 0: never
  bool both() const noexcept { return readers > 0 && writers > 0; }
};

// Messages that the reader did not deliver since it was opened, as far as the middleware reports it. Both
// counts may lag until a later message of the same writer is taken.
struct Losses {
  // Never reached the reader: lost on the link, at a full socket buffer, or with missing fragments; from a
  // reliable writer: removed from its history.
  std::optional<std::uint64_t> on_the_way;
  // Reached the reader while ontime's thread was busy, and newer ones replaced them in its history before
  // they were taken. For a socket without history: its buffer was full.
  std::optional<std::uint64_t> overwritten;
};

// Where background topics are, by what they share with the critical topic's endpoint. Topics of one
// participant share its threads and sockets. The first four are ROS 2's.
enum class Where {
  same_callback_group,  // and so its node and executor
  same_node,            // and its executor; in a callback group of their own
  same_executor,        // in a node of their own
  own_executor,         // its node; in a callback group that a thread of their own runs
  same_participant,
  same_process,  // in another participant
  other_process
};
constexpr bool is_of_nodes(Where where) { return where < Where::same_participant; }

class Endpoint {
 public:
  virtual ~Endpoint() = default;  // the sink is not called after it

  // Ordinary thread, before the first message; only with Capabilities::background. Opens another endpoint in
  // this process, with its own topics; this one must outlive it. A transport without nodes treats ROS 2's
  // values as `same_participant`. Throws Error.
  virtual std::unique_ptr<Endpoint> beside(const Config&, Sink&, Where) { return nullptr; }

  // Ordinary thread. Called every few milliseconds while ontime waits for a peer. A transport without
  // discovery does its handshake here. If discovery starts with a burst of packets, no peer is matched before
  // the burst ends, so that it does not disturb a round trip. Also called during the measurement: it takes no
  // lock that send() or an arrival takes.
  virtual Matched matched() = 0;
  // Ordinary thread, before the first counted message and after the last.
  virtual Losses losses() { return {}; }
  // Text about other participants while no peer matched, such as an incompatible QoS; "": nothing found.
  virtual std::string seen() { return {}; }

  // Real-time. False if the middleware refused the message. One caller at a time.
  virtual bool send(std::uint64_t sequence, std::span<const std::byte> payload) noexcept = 0;
  // Sends with a launch time: the message leaves when now_ns() is `at_ns`. Only with Config::launch_ns.
  virtual bool launch(std::uint64_t, std::span<const std::byte>, std::int64_t /*at_ns*/) noexcept {
    return false;
  }

  // Real-time, Receive::waitset only: waits for arrivals and hands them to the sink; returns after some, or
  // when interrupted. interrupt() ends the present and every later receive() at once; any thread.
  virtual void receive() noexcept {}
  virtual void interrupt() noexcept {}

  // Ordinary thread. The middleware's own threads as they are now (not those that call receive() or send()).
  virtual std::vector<Thread> threads() = 0;
  // Ordinary thread. What carries the data, for the record: e.g. {"interface", "veth0"}, {"carrier",
  // "UDPv4"}.
  virtual std::map<std::string, std::string> facts() = 0;
};

// A message of any topic, as an additional reader received it.
struct Heard {
  std::string_view topic;                 // "rt/cmd_vel"; valid until the call returns
  std::array<std::uint8_t, 16> writer{};  // its GUID
  std::uint64_t sequence = 0;             // the writer's sequence number
  std::int64_t stamp_ns = 0;              // source timestamp: CLOCK_REALTIME of the writer's host
  std::int64_t at_ns = 0;                 // when it could be taken here: CLOCK_REALTIME
  bool is_one_host = false;               // the writer is on this machine
};

// Reads topics of any type, as an additional reader of each writer. Ordinary thread.
class Hearing {
 public:
  virtual ~Hearing() = default;
  // Calls for each message that came since the last time, in the order of each writer.
  virtual void take(const std::function<void(const Heard&)>&) = 0;
  // For people: what could not be read and why, and notes about other participants.
  virtual std::vector<std::string> remarks() = 0;
};

// What a transport can do. Code above this interface uses only this, never a transport's name.
struct Capabilities {
  bool listener = true;
  bool waitset = true;
  std::size_t max_payload_bytes = 0;
  bool security = false;         // honours Config::security
  bool launch_time = false;      // honours Config::launch_ns
  bool topics = true;            // honours Config::ping_topic and pong_topic
  bool background = false;       // Endpoint::beside() opens another endpoint
  bool nodes = false;            // has ROS 2's nodes, callback groups and executors: the first four of Where
  bool below_ip = false;         // its messages have no IP header, and its Config::priority is its own to set
  bool past_the_kernel = false;  // bypasses packet filter, queueing disciplines and tracepoints
  bool hears = false;            // Plugin::hear() reads topics of any type
  bool shares_threads = false;   // all participants of a process receive on the same threads
  bool qos = true;               // honours Config::qos
};

struct Option {
  const char* name;
  const char* values;  // for people: "single|multi"
};

// The version of the interface, and the sizes of its structures, so that a forgotten rebuild is found.
inline constexpr int abi = 8 * 1'000'000 + static_cast<int>(sizeof(Config) * 10 + sizeof(Capabilities));

struct Plugin {
  int abi;
  const char* name;
  std::string (*version)();  // the middleware's, as it reports it itself
  Capabilities capabilities;
  std::span<const Option> options;
  // Its options are among these. Throws Error. Everything that the first message needs exists when it
  // returns, peers apart.
  std::unique_ptr<Endpoint> (*open)(const Config&, Sink&);
  // Only with Capabilities::hears. `topics`: as ROS 2 names them. Throws Error.
  std::unique_ptr<Hearing> (*hear)(int domain, const std::set<std::string>& topics) = nullptr;
};

// The transport of that name, from $ONTIME_TRANSPORT_PATH (folders, separated by ':'), beside the program
// (../lib/…/ontime), or the ament index. Throws Error with the searched folders and what to install. A
// program with file capabilities searches only beside itself: through the two variables any user could make
// it load code. The shared object stays loaded for the life of the process.
const Plugin& load(const std::string& name);
// The file that load() would load. Throws the Error of load() if it does not exist.
std::string find(const std::string& name);
// What it declares: one of ontime's own by the list in shipped.hpp, another by its plug-in, which this loads.
// Nothing if that is not installed here: the agent that opens it then asks it.
std::optional<Capabilities> declared(const std::string& name);
std::optional<std::span<const Option>> declared_options(const std::string& name);
// Which of these options the transport does not have, and which it has, for people; "": it has them all.
std::string unknown_option(const std::string& transport, std::span<const Option> its,
                           const std::map<std::string, std::string>& options);
// The names that load() would find, sorted.
std::vector<std::string> available();

}  // namespace ontime::transport
