// SPDX-License-Identifier: Apache-2.0
// Plain UDP: the lower bound for every middleware.
//
// A datagram is a header (magic, kind, cookie) and, when it carries a message, the message's CDR bytes.
// The server answers only addresses that it has verified: a cookie is a keyed hash (SipHash-2-4) of the
// sender's address, which only a receiver at that address can know. The server keeps no state for
// it, so clients can come and go for days. It answers a datagram without the right cookie by the cookie,
// never with more bytes than it received, so that it cannot be used to flood a host.
#include <array>
#include <atomic>
#include <cerrno>
#include <cstring>
#include <system_error>
#include <thread>

#include <fmt/format.h>
#include <linux/sock_diag.h>
#include <netinet/in.h>
#include <sodium.h>
#include <sys/socket.h>

#include "message/message.hpp"
#include "number.hpp"
#include "transport/clock.hpp"
#include "transport/shipped.hpp"
#include "transport/sockets.hpp"
#include "transport/transport.hpp"

namespace ontime::transport {
namespace {

constexpr int default_port = 7900;
constexpr std::uint32_t magic = 0x6d746e6f;  // "ontm"
enum class Kind : std::uint32_t { hello = 1, cookie = 2, message = 3 };

struct Header {
  std::uint32_t magic;
  Kind kind;
  std::uint64_t cookie;
};
static_assert(sizeof(Header) == 16);

constexpr std::size_t overhead = sizeof(Header) + message::cdr_overhead;
constexpr std::size_t max_payload = shipped("udp")->can.max_payload_bytes;
static_assert(max_payload + overhead == 65507);  // 65535 less the headers of IPv4 and UDP

sockaddr_in ipv4(const std::string& host, int port) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  if (const int code = look_up(host, address.sin_addr); code != 0)
    throw Error(
        fmt::format("host '{}' not found: {}. Fix: state its address, or add the name to "
                    "/etc/hosts or DNS",
                    host, gai_strerror(code)));
  address.sin_port = htons(static_cast<std::uint16_t>(port));
  return address;
}

int port_of(const std::string& text) {
  const int port = number_in<int>(text).value_or(0);
  if (port < 1 || port > 65535) throw WrongInput(fmt::format("'{}' is not a UDP port (1 to 65535)", text));
  return port;
}

// The port of pong, unless the peer states another.
int port_of(const Config& config) {
  if (const auto option = config.options.find("port"); option != config.options.end())
    return port_of(option->second);
  if (config.domain < 0 || default_port + config.domain > 65535)
    throw WrongInput(
        fmt::format("udp has no domain {}; it has 0 to {}", config.domain, 65535 - default_port));
  return default_port + config.domain;
}

int new_socket() {
  const int fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (fd < 0) throw Error("no UDP socket: " + errno_text());
  return fd;
}

class Udp final : public Endpoint {
 public:
  Udp(const Config& config, Sink& sink)
      : config_(config),
        sink_(sink),
        received_(overhead + config.max_payload_bytes + 1),
        sending_(received_.size()) {
    // Room for a burst of the largest messages; the kernel gives what it allows.
    const int buffer_bytes = 1 << 20;
    setsockopt(socket_, SOL_SOCKET, SO_RCVBUF, &buffer_bytes, sizeof buffer_bytes);
    use_link();
    if (config_.launch_ns > 0) permit_launch_times(socket_);
    config_.role == Role::server ? be_server() : be_client();
    if (config_.receive == Receive::listener) {
      listener_ = std::thread([this] {
        listener_tid_ = gettid();
        pthread_setname_np(pthread_self(), "ontime-udp-recv");
        const bool own_table = keep_alone(socket_, socket_);
        while (!stopping_) receive();
        if (own_table) close(socket_);  // else the port stays in use until the thread has ended
      });
      while (listener_tid_ == 0) std::this_thread::yield();
    }
  }

  ~Udp() override {
    interrupt();
    if (listener_.joinable()) listener_.join();
  }

  Matched matched() override {
    if (config_.role == Role::client && known_ns_ == 0) {
      const Header hello{magic, Kind::hello, 0};
      send_bytes(std::as_bytes(std::span(&hello, 1)), soon);
    }
    const std::int64_t known_ns = known_ns_;
    const int peers = known_ns == 0 ? 0 : 1;
    return {peers, peers, known_ns};
  }

  // UDP has no sequence numbers, so it does not know what the link lost.
  Losses losses() override {
    std::array<std::uint32_t, SK_MEMINFO_VARS> memory{};
    socklen_t length = sizeof memory;
    if (getsockopt(socket_, SOL_SOCKET, SO_MEMINFO, memory.data(), &length) != 0) return {};
    return {.on_the_way = {}, .overwritten = memory[SK_MEMINFO_DROPS]};
  }

  std::string seen() override {
    if (config_.role == Role::server) return "";
    if (answered_wrongly_)
      return fmt::format(
          "{} answers, but is no pong: another program, or another version of ontime, has that port", peer_);
    if (last_error_ == EPERM)
      return fmt::format(
          "{}: a packet filter of this machine forbids it (nft list ruleset, or a service's IPAddressDeny)",
          peer_);
    if (last_error_ == ECONNREFUSED)
      return fmt::format("{} refuses: the host is up, but no pong listens on that port", peer_);
    if (last_error_ != 0) return fmt::format("{}: {}", peer_, std::generic_category().message(last_error_));
    return fmt::format("{} sent no reply: check that the host is up and that its firewall permits UDP",
                       peer_);
  }

  bool send(std::uint64_t sequence, std::span<const std::byte> payload) noexcept override {
    return launch(sequence, payload, soon);
  }
  bool launch(std::uint64_t sequence, std::span<const std::byte> payload,
              std::int64_t at_ns) noexcept override {
    if (payload.size() > config_.max_payload_bytes) return false;
    const bool server = config_.role == Role::server;
    const Header header{magic, Kind::message,
                        server ? reply_cookie_ : cookie_.load(std::memory_order_relaxed)};
    std::memcpy(sending_.data(), &header, sizeof header);
    const auto bytes =
        sizeof header + message::encode(sequence, payload, std::span(sending_).subspan(sizeof header));
    return send_bytes(std::span(sending_).first(bytes), at_ns);
  }

  void receive() noexcept override {
    socklen_t length = sizeof from_;
    const bool server = config_.role == Role::server;
    const auto bytes =
        recvfrom(socket_, received_.data(), received_.size(), 0,
                 server ? reinterpret_cast<sockaddr*>(&from_) : nullptr, server ? &length : nullptr);
    const auto arrival_ns = now_ns();
    if (bytes < 0) last_error_ = errno;
    if (bytes < 0 || stopping_) return;
    Header header{};
    if (bytes >= static_cast<ssize_t>(sizeof header)) std::memcpy(&header, received_.data(), sizeof header);
    if (header.magic != magic) {
      answered_wrongly_ = true;
      return;
    }
    const auto rest =
        std::span(received_).subspan(sizeof header, static_cast<std::size_t>(bytes) - sizeof header);
    server ? serve(header, rest, arrival_ns) : take(header, rest, arrival_ns);
  }

  void interrupt() noexcept override {
    stopping_ = true;
    shutdown(socket_, SHUT_RDWR);  // wakes a blocked recvfrom, for a socket without a peer too
  }

  std::vector<Thread> threads() override {
    if (listener_tid_ == 0) return {};
    return {{listener_tid_, "receive", "ontime-udp-recv"}};
  }

  std::map<std::string, std::string> facts() override {
    sockaddr_in local{};
    socklen_t length = sizeof local;
    getsockname(socket_, reinterpret_cast<sockaddr*>(&local), &length);
    return {{"carrier", "UDPv4"},
            {"interface", config_.interface.empty() ? "any" : config_.interface},
            {"address", fmt::format("{}:{}", text_of(local.sin_addr), ntohs(local.sin_port))}};
  }

 private:
  void use_link() {
    if (config_.interface.empty()) return;
    if (setsockopt(socket_, SOL_SOCKET, SO_BINDTODEVICE, config_.interface.c_str(),
                   static_cast<socklen_t>(config_.interface.size())) != 0)
      throw Error(fmt::format("cannot bind to interface '{}': {}", config_.interface, errno_text()));
  }

  void be_server() {
    if (sodium_init() < 0)
      throw Error("libsodium does not start: this machine has no source of random numbers");
    crypto_shorthash_keygen(key_.data());
    const int port = port_of(config_);
    const auto local = ipv4(config_.address.empty() ? "0.0.0.0" : config_.address, port);
    if (bind(socket_, reinterpret_cast<const sockaddr*>(&local), sizeof local) != 0)
      throw Error(errno == EADDRINUSE ? fmt::format("UDP port {} is busy (another pong?). Fix: --domain N or "
                                                    "--option port=N; in a scenario domain: N or "
                                                    "options.port: N",
                                                    port)
                                      : fmt::format("cannot listen on UDP port {}: {}", port, errno_text()));
  }

  void be_client() {
    if (config_.peers.empty()) throw WrongInput("udp needs the address of pong. Fix: --peer HOST[:PORT]");
    peer_ = config_.peers.front();
    const auto colon = peer_.rfind(':');
    const bool has_port = colon != std::string::npos;
    const int port = has_port ? port_of(peer_.substr(colon + 1)) : port_of(config_);
    const auto address = ipv4(peer_.substr(0, colon), port);
    if (!config_.address.empty()) {
      const auto local = ipv4(config_.address, 0);
      if (bind(socket_, reinterpret_cast<const sockaddr*>(&local), sizeof local) != 0)
        throw Error(fmt::format("cannot send from address {}: {}", config_.address, errno_text()));
    }
    if (connect(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0)
      throw Error(fmt::format("no route to {}: {}", peer_, errno_text()));
  }

  void know() noexcept {
    if (known_ns_.load(std::memory_order_relaxed) == 0) known_ns_ = now_ns();
  }

  // No launch time of its own: Config::launch_ns after now, or at once without it.
  static constexpr std::int64_t soon = 0;

  bool send_bytes(std::span<const std::byte> bytes, std::int64_t at_ns) noexcept {
    for (int attempt = 0; attempt < 2; ++attempt) {
      const bool server = config_.role == Role::server;
      const auto* const to = server ? reinterpret_cast<const sockaddr*>(&from_) : nullptr;
      const socklen_t to_bytes = server ? sizeof from_ : 0;
      ssize_t sent = 0;
      if (config_.launch_ns > 0) [[unlikely]]
        sent = send_to_leave_at(at_ns == soon ? now_ns() + config_.launch_ns : at_ns, socket_, bytes, to,
                                to_bytes);
      else
        sent = sendto(socket_, bytes.data(), bytes.size(), MSG_NOSIGNAL, to, to_bytes);
      if (sent == static_cast<ssize_t>(bytes.size())) return true;
      last_error_ = errno;
      if (errno != ECONNREFUSED) return false;  // else the error belongs to an earlier datagram
    }
    return false;
  }

  std::uint64_t cookie_of(const sockaddr_in& address) const noexcept {
    std::array<unsigned char, sizeof address.sin_addr + sizeof address.sin_port> who{};
    std::memcpy(who.data(), &address.sin_addr, sizeof address.sin_addr);
    std::memcpy(who.data() + sizeof address.sin_addr, &address.sin_port, sizeof address.sin_port);
    std::array<unsigned char, crypto_shorthash_BYTES> hash{};
    crypto_shorthash(hash.data(), who.data(), who.size(), key_.data());
    std::uint64_t cookie = 0;
    std::memcpy(&cookie, hash.data(), sizeof cookie);
    return cookie == 0 ? 1 : cookie;  // 0: a client that has none yet
  }

  void serve(const Header& header, std::span<std::byte> cdr, std::int64_t arrival_ns) noexcept {
    const auto cookie = cookie_of(from_);
    if (header.kind == Kind::message && header.cookie == cookie) {
      const auto view = message::decode(cdr);
      if (!view || view->payload.size() > config_.max_payload_bytes) return;
      know();
      reply_cookie_ = cookie;
      sink_.arrived(view->sequence, view->payload, arrival_ns);
    } else if (header.kind == Kind::hello || header.kind == Kind::message) {
      const Header answer{magic, Kind::cookie, cookie};
      send_bytes(std::as_bytes(std::span(&answer, 1)), soon);
    }
  }

  void take(const Header& header, std::span<std::byte> cdr, std::int64_t arrival_ns) noexcept {
    if (header.kind == Kind::cookie) {
      cookie_ = header.cookie;  // the first one, or that of a restarted pong
      know();
    } else if (header.kind == Kind::message && header.cookie == cookie_.load(std::memory_order_relaxed)) {
      if (const auto view = message::decode(cdr)) sink_.arrived(view->sequence, view->payload, arrival_ns);
    }
  }

  const Config config_;
  Sink& sink_;
  const Descriptor socket_{new_socket()};
  std::string peer_;
  std::vector<std::byte> received_, sending_;
  std::atomic<bool> stopping_{false};
  std::atomic<std::int64_t> known_ns_{0};  // since when: client: has its cookie; server: has served a client
  std::atomic<std::uint64_t> cookie_{0};   // the client's
  std::atomic<int> last_error_{0};
  std::atomic<bool> answered_wrongly_{false};
  std::array<unsigned char, crypto_shorthash_KEYBYTES> key_{};  // the server's
  sockaddr_in from_{};                                          // where the server's answer goes
  std::uint64_t reply_cookie_ = 0;
  std::atomic<pid_t> listener_tid_{0};
  std::thread listener_;
};

std::unique_ptr<Endpoint> open(const Config& config, Sink& sink) {
  if (config.max_payload_bytes > max_payload)
    throw WrongInput(fmt::format("udp carries at most {} bytes of payload, requested: {}", max_payload,
                                 config.max_payload_bytes));
  return std::make_unique<Udp>(config, sink);
}

}  // namespace
}  // namespace ontime::transport

extern "C" __attribute__((visibility("default")))
const ontime::transport::Plugin ontime_transport{.abi = ontime::transport::abi,
                                                 .name = "udp",
                                                 .version = ontime::transport::kernel_version,
                                                 .capabilities = ontime::transport::shipped("udp")->can,
                                                 .options = ontime::transport::shipped("udp")->options,
                                                 .open = ontime::transport::open};
