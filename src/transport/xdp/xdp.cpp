// SPDX-License-Identifier: Apache-2.0
// Raw Ethernet past the kernel's network stack, by a socket of AF_XDP: frames lie in memory that we share
// with the kernel, or, where the driver can (zero-copy), with the device. No queueing discipline, no packet
// filter.
#include <cerrno>
#include <memory>
#include <optional>
#include <system_error>

#include <bpf/libbpf.h>
#include <fmt/format.h>
#include <linux/if_xdp.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <xdp/libxdp.h>
#include <xdp/xsk.h>

#include "number.hpp"
#include "transport/frames.hpp"
#include "transport/shipped.hpp"
#include "transport/xdp/program.hpp"

namespace ontime::transport::xdp {
namespace {

constexpr const char* who = "xdp";
constexpr std::uint32_t chunk_bytes = 4096;
constexpr std::size_t largest_frame = chunk_bytes - 256;  // XDP_PACKET_HEADROOM is the kernel's
static_assert(shipped(who)->can.max_payload_bytes + frames::overhead == largest_frame);
constexpr std::uint32_t to_receive = 256, to_send = 64;  // chunks, and the slots of the rings

class Memory {
 public:
  Memory()
      : at_(mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_POPULATE, -1, 0)) {
    if (at_ == MAP_FAILED) throw Error("xdp: no memory for frames: " + errno_text());
  }
  ~Memory() { munmap(at_, bytes); }
  Memory(const Memory&) = delete;
  Memory& operator=(const Memory&) = delete;

  void* begin() const noexcept { return at_; }
  std::span<std::byte> at(std::uint64_t address, std::size_t length) const noexcept {
    return {static_cast<std::byte*>(at_) + address, length};
  }
  static constexpr std::size_t bytes = std::size_t{to_receive + to_send} * chunk_bytes;

 private:
  void* at_;
};

struct Umem {
  xsk_umem* handle = nullptr;
  ~Umem() {
    if (handle != nullptr) xsk_umem__delete(handle);
  }
};
struct Socket {
  xsk_socket* handle = nullptr;
  ~Socket() {
    if (handle != nullptr) xsk_socket__delete(handle);
  }
};

std::uint32_t queue_of(const Config& config) {
  const auto option = config.options.find("queue");
  if (option == config.options.end()) return 0;
  const auto& text = option->second;
  const auto queue = number_in<std::uint16_t>(text);
  if (!queue || *queue > 4095)
    throw WrongInput(fmt::format("xdp: option queue: '{}' is not a queue number (0 to 4095)", text));
  return *queue;
}

class Queue {
 public:
  static constexpr const char* thread_name = "ontime-xdp-recv";

  Queue(const Config& config, const frames::Link& link, std::uint64_t topic)
      : busy_(frames::busy_polls(config, who)), number_(queue_of(config)), frame_bytes_(link.frame_bytes) {
    libbpf_set_print(nullptr);  // they would print by themselves
    libxdp_set_print(nullptr);
    Program::refuse_another(link);
    share_memory();
    open_socket(link);
    fill();
    if (busy_) poll_busily();
    program_ = std::make_unique<Program>(link, topic, number_, fd());
  }

  int fd() const noexcept { return xsk_socket__fd(socket_.handle); }

  std::span<std::byte> room() noexcept {
    std::uint32_t at = 0;
    const auto done = xsk_ring_cons__peek(&completed_, to_send, &at);
    for (std::uint32_t i = 0; i < done; ++i)
      free_[free_count_++] = *xsk_ring_cons__comp_addr(&completed_, at + i);
    if (done > 0) xsk_ring_cons__release(&completed_, done);
    if (free_count_ == 0) return {};
    return memory_.at(free_[free_count_ - 1], frame_bytes_);
  }

  int send(std::size_t bytes, std::int64_t /*at_ns*/) noexcept {
    std::uint32_t at = 0;
    if (xsk_ring_prod__reserve(&sending_, 1, &at) == 0) return ENOBUFS;
    *xsk_ring_prod__tx_desc(&sending_, at) = {free_[--free_count_], static_cast<std::uint32_t>(bytes), 0};
    xsk_ring_prod__submit(&sending_, 1);
    // It is the kernel's now, whatever that says, and goes at the latest with the next that the link takes.
    for (int attempt = 0; attempt <= attempts && xsk_ring_prod__needs_wakeup(&sending_); ++attempt) {
      if (sendto(fd(), nullptr, 0, MSG_DONTWAIT, nullptr, 0) >= 0) break;
      if (errno != EAGAIN && errno != EBUSY && errno != ENOBUFS) break;
    }
    return 0;
  }

  template <typename Take>
  int receive(const frames::Bell& bell, const Take& take) noexcept {
    std::uint32_t at = 0;
    while (xsk_ring_cons__peek(&received_, 1, &at) == 0) {
      if (bell.rung()) return 0;
      if (busy_)
        recvfrom(fd(), nullptr, 0, MSG_DONTWAIT, nullptr, nullptr);  // has the driver look for frames here
      else if (const int error = bell.wait(fd()); error != 0)
        return error;
    }
    do {
      const xdp_desc frame = *xsk_ring_cons__rx_desc(&received_, at);
      xsk_ring_cons__release(&received_, 1);
      take(memory_.at(frame.addr, frame.len));
      give_back(frame.addr - frame.addr % chunk_bytes);
    } while (!bell.rung() && xsk_ring_cons__peek(&received_, 1, &at) == 1);
    return 0;
  }

  Losses losses() const {
    xdp_statistics count{};
    socklen_t length = sizeof count;
    if (getsockopt(fd(), SOL_XDP, XDP_STATISTICS, &count, &length) != 0) return {};
    if (is_zero_copy().value_or(true)) return {};  // there the device drops, and counts by itself
    return {.on_the_way = {}, .overwritten = count.rx_dropped + count.rx_ring_full};
  }

  std::map<std::string, std::string> facts() const {
    const auto zero_copy = is_zero_copy();
    return {{"xdp", std::string(program_->mode()) + (!zero_copy   ? ""
                                                     : *zero_copy ? " zero-copy"
                                                                  : " copy")},
            {"queue", std::to_string(number_)},
            {"busy-poll", busy_ ? "on" : "off"}};
  }

 private:
  static constexpr int attempts = 3;

  std::optional<bool> is_zero_copy() const {
    xdp_options options{};
    socklen_t length = sizeof options;
    if (getsockopt(fd(), SOL_XDP, XDP_OPTIONS, &options, &length) != 0) return {};
    return (options.flags & XDP_OPTIONS_ZEROCOPY) != 0;
  }

  void share_memory() {
    const xsk_umem_config config{.fill_size = to_receive,
                                 .comp_size = to_send,
                                 .frame_size = chunk_bytes,
                                 .frame_headroom = 0,
                                 .flags = 0};
    const int error =
        -xsk_umem__create(&umem_.handle, memory_.begin(), Memory::bytes, &to_fill_, &completed_, &config);
    if (error == 0) return;
    if (error == EPERM || error == EACCES)
      throw Error(fmt::format("xdp: no permission for an AF_XDP socket. Fix: {}", wants_permission));
    if (error == EAFNOSUPPORT)
      throw Error("xdp: this kernel has no AF_XDP (CONFIG_XDP_SOCKETS). Fix: use transport ethernet");
    throw Error(fmt::format("xdp: no memory shared with the kernel (the limit memlock must allow {} KiB): {}",
                            Memory::bytes / 1024, std::generic_category().message(error)));
  }

  void open_socket(const frames::Link& link) {
    xsk_socket_config config{};
    config.rx_size = to_receive;
    config.tx_size = to_send;
    config.libxdp_flags = XSK_LIBXDP_FLAGS__INHIBIT_PROG_LOAD;
    config.bind_flags = XDP_USE_NEED_WAKEUP;
    // The kernel frees a queue some time after its socket was closed.
    const std::int64_t end_ns = now_ns() + 1'000'000'000;
    int error = EBUSY;
    while (true) {
      error = -xsk_socket__create(&socket_.handle, link.name.c_str(), number_, umem_.handle, &received_,
                                  &sending_, &config);
      if (error != EBUSY || now_ns() > end_ns) break;
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    if (error == 0) return;
    const std::string what = fmt::format("xdp: queue {} of {}", number_, link.name);
    if (error == EBUSY)
      throw Error(what + " is in use by another AF_XDP socket (another run?); each end needs its own queue");
    if (error == EINVAL || error == ERANGE)
      throw Error(what +
                  " does not exist, or cannot both send and receive. Fix: option queue (see ethtool -l " +
                  link.name + ")");
    if (error == EOPNOTSUPP)
      throw Error(fmt::format("xdp: {} has no AF_XDP. Fix: use transport ethernet", link.name));
    throw Error(fmt::format("{}: {}", what, std::generic_category().message(error)));
  }

  void fill() {
    for (std::uint32_t i = 0; i < to_send; ++i)
      free_[free_count_++] = std::uint64_t{to_receive + i} * chunk_bytes;
    for (std::uint32_t i = 0; i < to_receive; ++i) give_back(std::uint64_t{i} * chunk_bytes);
  }

  void give_back(std::uint64_t chunk) noexcept {
    std::uint32_t at = 0;
    if (xsk_ring_prod__reserve(&to_fill_, 1, &at) == 0) return;  // never: the ring has a slot for each
    *xsk_ring_prod__fill_addr(&to_fill_, at) = chunk;
    xsk_ring_prod__submit(&to_fill_, 1);
  }

  void poll_busily() const {
    const int us = 20;
    if (setsockopt(fd(), SOL_SOCKET, SO_BUSY_POLL, &us, sizeof us) != 0)
      throw Error("xdp: no busy polling (SO_BUSY_POLL): " + errno_text());
  }

  const bool busy_;
  const std::uint32_t number_;
  const std::size_t frame_bytes_;
  Memory memory_;
  Umem umem_;
  xsk_ring_prod to_fill_{}, sending_{};
  xsk_ring_cons completed_{}, received_{};
  Socket socket_;
  std::unique_ptr<Program> program_;
  std::array<std::uint64_t, to_send> free_{};
  std::uint32_t free_count_ = 0;
};

std::unique_ptr<Endpoint> open(const Config& config, Sink& sink) {
  auto link = frames::link_of(config, who, largest_frame);
  if (link.loopback)
    throw Error(
        "xdp: lo has one queue, and each end needs its own. Fix: use two interfaces (two machines or network "
        "namespaces), or transport ethernet");
  return std::make_unique<frames::End<Queue>>(config, sink, std::move(link), who);
}

}  // namespace
}  // namespace ontime::transport::xdp

extern "C" __attribute__((visibility("default")))
const ontime::transport::Plugin ontime_transport{ontime::transport::abi,
                                                 "xdp",
                                                 ontime::transport::kernel_version,
                                                 ontime::transport::shipped("xdp")->can,
                                                 ontime::transport::shipped("xdp")->options,
                                                 ontime::transport::xdp::open};
