// SPDX-License-Identifier: Apache-2.0
// Shared by the transports below IP (ethernet, xdp): how two ends find each other, and the frame format.
//
// A frame has an Ethernet header with the EtherType for local experiments, a kind, a topic and, if it carries
// a message, the message's CDR bytes. The topic is a hash of the domain and the topic's name, so that domains
// and components are separate on one link, as with DDS. The client calls by broadcast; the first server that
// answers is its peer, and from then on both send unicast frames only. No sender gets more bytes back than it
// sent.
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <cstring>
#include <string>
#include <thread>
#include <vector>

#include <netinet/in.h>
#include <pthread.h>
#include <unistd.h>

#include "message/message.hpp"
#include "transport/clock.hpp"
#include "transport/sockets.hpp"
#include "transport/transport.hpp"

namespace ontime::transport::frames {

inline constexpr std::uint16_t ether_type = 0x88B5;  // IEEE 802: local experiments
inline constexpr std::uint32_t magic = 0x6d746e6f;   // "ontm"
enum class Kind : std::uint32_t { call = 1, answer = 2, message = 3 };

using Mac = std::array<std::uint8_t, 6>;
inline constexpr Mac everybody{0xff, 0xff, 0xff, 0xff, 0xff, 0xff};

// All fields but `type` have the machine's byte order: two ends with different byte orders do not match.
struct [[gnu::packed]] Header {
  Mac to, from;
  std::uint16_t type;  // as on the wire
  std::uint32_t magic;
  Kind kind;
  std::uint64_t topic;
};
static_assert(sizeof(Header) == 30);
inline constexpr std::size_t ethernet_bytes = 14;  // not part of the MTU
inline constexpr std::size_t overhead = sizeof(Header) + message::cdr_overhead;

struct Link {
  std::string name;
  int index = 0;
  Mac mac{};
  bool loopback = false;
  std::vector<in_addr_t> addresses;  // IPv4: a client names its server by one of them
  std::size_t frame_bytes = 0;       // of the largest frame that this run needs
};
// The link under test. `most_bytes`: the largest frame that the transport carries. Throws WrongInput if no
// machine can do it, Error if this one cannot. A server without a stated payload accepts any that fits.
Link link_of(const Config& config, const std::string& who, std::size_t most_bytes);

std::uint64_t topic_written(const Config& config);
std::uint64_t topic_read(const Config& config);
// The IPv4 address of the pong that the client looks for; 0: any. Throws Error if there is no such host.
in_addr_t wanted(const Config& config, const std::string& who);
// Throws WrongInput for words other than on and off.
bool busy_polls(const Config& config, const std::string& who);
std::string text_of(const Mac& mac);

// With it another thread ends a wait.
class Bell {
 public:
  Bell();  // throws Error

  int fd() const noexcept { return fd_; }
  bool rung() const noexcept { return rung_.load(std::memory_order_relaxed); }
  void ring() noexcept;
  // Waits until `fd` has something to read, or the bell rings. Returns fd's error (once), or 0.
  int wait(int fd) const noexcept;

 private:
  const Descriptor fd_;
  std::atomic<bool> rung_{false};
};

// A Wire puts frames on a link and takes them off:
//   Wire(const Config&, const Link&, std::uint64_t topic)  takes in frames of that topic alone; throws Error
//   std::span<std::byte> room() noexcept                   for the next frame; empty: no frame is free now
//   int send(std::size_t bytes, at_ns) noexcept            the bytes of room(), with Config::launch_ns to
//                                                          leave then; 0, or why not
//   int receive(const Bell&, take) noexcept                 waits, and calls take(std::span<std::byte>) with
//                                                          each frame; 0, or what is wrong with the link
//   int fd() · Losses losses() · std::map facts() · const char* thread_name
// All but the constructor and the last two are real-time safe; room() and send() have one caller at a time.
template <typename Wire>
class End final : public Endpoint {
 public:
  End(const Config& config, Sink& sink, Link link, const std::string& who)
      : config_(config),
        sink_(sink),
        link_(std::move(link)),
        wanted_(wanted(config, who)),
        wire_(config_, link_, topic_read(config)) {
    if (config_.receive == Receive::waitset) return;
    listener_ = std::thread([this] {
      pthread_setname_np(pthread_self(), Wire::thread_name);
      const int wire = wire_.fd(), bell = bell_.fd();
      const bool own_table = keep_alone(wire, bell);
      listener_tid_ = gettid();
      while (!bell_.rung()) receive();
      if (!own_table) return;  // else the link stays in use until the thread has ended
      close_range(0, ~0U, 0);
    });
    while (listener_tid_ == 0) std::this_thread::yield();
  }

  ~End() override {
    interrupt();
    if (listener_.joinable()) listener_.join();
  }

  Matched matched() override {
    const std::int64_t known_ns = known_ns_, now = now_ns();
    if (config_.role == Role::client && known_ns == 0 && now >= next_call_ns_) {
      next_call_ns_ = now + between_calls_ns;
      put(Kind::call, everybody, launch_ns(), [&](std::span<std::byte> room) {
        std::memcpy(room.data(), &wanted_, sizeof wanted_);
        return sizeof wanted_;
      });
    }
    const int peers = known_ns == 0 ? 0 : 1;
    return {peers, peers, known_ns};
  }

  Losses losses() override { return wire_.losses(); }

  std::string seen() override {
    if (const int error = last_error_; error != 0)
      return link_.name + ": " + std::generic_category().message(error);
    if (config_.role == Role::server) return "";
    return "no pong" + (wanted_ == 0 ? "" : " with the address " + config_.peers.front()) +
           " answered on the link of " + link_.name +
           " (both interfaces must be in the same Ethernet segment, with no router between)";
  }

  bool send(std::uint64_t sequence, std::span<const std::byte> payload) noexcept override {
    return launch(sequence, payload, launch_ns());
  }

  bool launch(std::uint64_t sequence, std::span<const std::byte> payload,
              std::int64_t at_ns) noexcept override {
    const bool server = config_.role == Role::server;
    if (!server && known_ns_.load(std::memory_order_acquire) == 0) return false;
    return put(Kind::message, server ? answered_ : peer_, at_ns, [&](std::span<std::byte> room) {
      if (room.size() < message::cdr_overhead + payload.size()) return std::size_t{0};
      return message::encode(sequence, payload, room);
    });
  }

  void receive() noexcept override {
    const int error = wire_.receive(bell_, [this](std::span<std::byte> frame) {
      const std::int64_t arrival_ns = now_ns();
      if (frame.size() < sizeof(Header)) return;
      Header header;
      std::memcpy(&header, frame.data(), sizeof header);
      if (header.magic != magic || (header.to != link_.mac && header.to != everybody)) return;
      const auto rest = frame.subspan(sizeof header);
      config_.role == Role::server ? serve(header, rest, arrival_ns) : take(header, rest, arrival_ns);
    });
    if (error != 0) last_error_ = error;
  }

  void interrupt() noexcept override { bell_.ring(); }

  std::vector<Thread> threads() override {
    if (listener_tid_ == 0) return {};
    return {{listener_tid_, "receive", Wire::thread_name}};
  }

  std::map<std::string, std::string> facts() override {
    auto facts = wire_.facts();
    facts.insert({{"carrier", "Ethernet"}, {"interface", link_.name}, {"address", text_of(link_.mac)}});
    if (config_.role == Role::client && known_ns_ != 0) facts["peer"] = text_of(peer_);
    return facts;
  }

 private:
  static constexpr std::int64_t between_calls_ns = 20'000'000;

  // For a frame that is sent now.
  std::int64_t launch_ns() const noexcept { return config_.launch_ns > 0 ? now_ns() + config_.launch_ns : 0; }

  template <typename Fill>
  bool put(Kind kind, const Mac& to, std::int64_t at_ns, Fill fill) noexcept {
    const auto room = wire_.room();
    if (room.size() < sizeof(Header)) return false;
    const Header header{to, link_.mac, htons(ether_type), magic, kind, topic_written_};
    std::memcpy(room.data(), &header, sizeof header);
    const std::size_t bytes = fill(room.subspan(sizeof header));
    if (bytes == 0 && kind == Kind::message) return false;
    const int error = wire_.send(sizeof header + bytes, at_ns);
    if (error != 0) last_error_ = error;
    return error == 0;
  }

  void serve(const Header& header, std::span<std::byte> rest, std::int64_t arrival_ns) noexcept {
    if (header.kind == Kind::call && rest.size() >= sizeof(in_addr_t)) {
      in_addr_t asked = 0;
      std::memcpy(&asked, rest.data(), sizeof asked);
      const bool ours = asked == 0 || std::ranges::find(link_.addresses, asked) != link_.addresses.end();
      if (ours) put(Kind::answer, header.from, launch_ns(), [](auto) { return std::size_t{0}; });
    } else if (header.kind == Kind::message) {
      const auto view = message::decode(rest);
      if (!view) return;
      know();
      answered_ = header.from;
      sink_.arrived(view->sequence, view->payload, arrival_ns);
    }
  }

  void take(const Header& header, std::span<std::byte> rest, std::int64_t arrival_ns) noexcept {
    if (header.kind == Kind::answer && known_ns_.load(std::memory_order_relaxed) == 0) {
      peer_ = header.from;
      know();
    } else if (header.kind == Kind::message && known_ns_.load(std::memory_order_relaxed) != 0 &&
               header.from == peer_) {
      if (const auto view = message::decode(rest)) sink_.arrived(view->sequence, view->payload, arrival_ns);
    }
  }

  void know() noexcept {
    if (known_ns_.load(std::memory_order_relaxed) == 0) known_ns_.store(now_ns(), std::memory_order_release);
  }

  const Config config_;
  Sink& sink_;
  const Link link_;
  const in_addr_t wanted_;
  const std::uint64_t topic_written_ = frames::topic_written(config_);
  Bell bell_;
  Wire wire_;
  std::int64_t next_call_ns_ = 0;
  std::atomic<std::int64_t> known_ns_{0};  // since when: client: has its peer; server: has served a client
  Mac peer_{};                             // the client's, written once, before known_ns_
  Mac answered_{};                         // the server's peer now; only for the receiving thread
  std::atomic<int> last_error_{0};
  std::atomic<pid_t> listener_tid_{0};
  std::thread listener_;
};

}  // namespace ontime::transport::frames
