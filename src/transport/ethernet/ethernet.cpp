// SPDX-License-Identifier: Apache-2.0
// Raw Ethernet, by a socket of AF_PACKET: no IP, no UDP. What arrives is in a ring that the kernel shares
// with us; what goes out takes the link's queueing discipline, as all that the kernel sends.
#include <bit>
#include <cerrno>

#include <fmt/format.h>
#include <linux/filter.h>
#include <linux/if_packet.h>
#include <sys/mman.h>
#include <sys/socket.h>

#include "transport/frames.hpp"
#include "transport/shipped.hpp"

namespace ontime::transport {
namespace {

constexpr const char* who = "ethernet";

struct PacketSocket : Descriptor {
  PacketSocket() : Descriptor(socket(AF_PACKET, SOCK_RAW | SOCK_CLOEXEC, 0)) {
    if (*this >= 0) return;
    if (errno == EPERM || errno == EACCES)
      throw Error(
          "ethernet: no permission for a raw socket. Fix: run as root, or start it with CAP_NET_RAW: "
          "sudo setpriv --reuid=$USER --regid=$(id -g) --init-groups --inh-caps=+net_raw "
          "--ambient-caps=+net_raw ontime ...");
    throw Error("ethernet: no raw socket (AF_PACKET): " + errno_text());
  }

  template <typename Value>
  void set(int level, int option, const Value& value, const char* what) const {
    if (setsockopt(*this, level, option, &value, sizeof value) != 0)
      throw Error(fmt::format("ethernet: {}: {}", what, errno_text()));
  }
};

// A ring that the kernel writes and this process reads, slot by slot; each slot belongs to one of the two.
class Ring {
 public:
  Ring(const PacketSocket& socket, std::size_t frame_bytes) {
    constexpr std::size_t head_bytes = 128;  // TPACKET2_HDRLEN and its alignment, and more
    constexpr std::size_t usual_bytes = 1 << 19, least_block_bytes = 1 << 16, least_slots = 16;
    slot_bytes_ = std::bit_ceil(head_bytes + frame_bytes);
    const std::size_t block_bytes = std::max(least_block_bytes, slot_bytes_);
    bytes_ = std::max(usual_bytes, least_slots * slot_bytes_);
    slots_ = bytes_ / slot_bytes_;
    const tpacket_req request{.tp_block_size = static_cast<unsigned>(block_bytes),
                              .tp_block_nr = static_cast<unsigned>(bytes_ / block_bytes),
                              .tp_frame_size = static_cast<unsigned>(slot_bytes_),
                              .tp_frame_nr = static_cast<unsigned>(slots_)};
    socket.set(SOL_PACKET, PACKET_VERSION, static_cast<int>(TPACKET_V2), "no ring of version 2");
    socket.set(SOL_PACKET, PACKET_RX_RING, request, "no room for a ring");
    memory_ = mmap(nullptr, bytes_, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_POPULATE, socket, 0);
    if (memory_ == MAP_FAILED)
      throw Error(fmt::format("ethernet: cannot map its ring of {} bytes: {}", bytes_, errno_text()));
  }
  ~Ring() { munmap(memory_, bytes_); }
  Ring(const Ring&) = delete;
  Ring& operator=(const Ring&) = delete;

  bool has_frame() const noexcept {
    return (__atomic_load_n(&slot()->tp_status, __ATOMIC_ACQUIRE) & TP_STATUS_USER) != 0;
  }
  template <typename Take>
  void hand_over(const Take& take) noexcept {
    auto* const head = slot();
    if (head->tp_snaplen == head->tp_len)  // else it is longer than any of ours
      take(std::span(reinterpret_cast<std::byte*>(head) + head->tp_mac, head->tp_snaplen));
    __atomic_store_n(&head->tp_status, TP_STATUS_KERNEL, __ATOMIC_RELEASE);
    next_ = next_ + 1 == slots_ ? 0 : next_ + 1;
  }

 private:
  tpacket2_hdr* slot() const noexcept {
    return reinterpret_cast<tpacket2_hdr*>(static_cast<std::byte*>(memory_) + next_ * slot_bytes_);
  }

  std::size_t slot_bytes_ = 0, slots_ = 0, bytes_ = 0, next_ = 0;
  void* memory_ = MAP_FAILED;
};

// The kernel drops frames of other topics, so that they do not wake us.
void take_only(const PacketSocket& socket, std::uint64_t topic) {
  constexpr auto at = [](auto member) { return static_cast<std::uint32_t>(member); };
  std::array<std::uint32_t, 2> words{};
  std::memcpy(words.data(), &topic, sizeof topic);
  const auto load = [](std::uint32_t offset) {
    return sock_filter(BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offset));
  };
  const auto unless = [](std::uint32_t word, std::uint8_t to_end) {
    return sock_filter(BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, ntohl(word), 0, to_end));
  };
  using frames::Header;
  std::array<sock_filter, 8> code{
      load(at(offsetof(Header, magic))),           unless(frames::magic, 5),
      load(at(offsetof(Header, topic))),           unless(words[0], 3),
      load(at(offsetof(Header, topic) + 4)),       unless(words[1], 1),
      sock_filter(BPF_STMT(BPF_RET | BPF_K, ~0U)), sock_filter(BPF_STMT(BPF_RET | BPF_K, 0))};
  socket.set(SOL_SOCKET, SO_ATTACH_FILTER, sock_fprog{code.size(), code.data()}, "no filter of frames");
}

class Packets {
 public:
  static constexpr const char* thread_name = "ontime-eth-recv";

  Packets(const Config& config, const frames::Link& link, std::uint64_t topic)
      : busy_(frames::busy_polls(config, who)),
        launches_(config.launch_ns > 0),
        ring_(socket_, link.frame_bytes),
        sending_(link.frame_bytes) {
    take_only(socket_, topic);
    if (launches_) permit_launch_times(socket_);
    if (config.priority) socket_.set(SOL_SOCKET, SO_PRIORITY, *config.priority, "no priority");
    sockaddr_ll where{};
    where.sll_family = AF_PACKET;
    where.sll_protocol = htons(frames::ether_type);
    where.sll_ifindex = link.index;
    if (bind(socket_, reinterpret_cast<const sockaddr*>(&where), sizeof where) != 0)
      throw Error(fmt::format("ethernet: cannot listen on {}: {}", link.name, errno_text()));
  }

  int fd() const noexcept { return socket_; }
  std::span<std::byte> room() noexcept { return sending_; }
  int send(std::size_t bytes, std::int64_t at_ns) noexcept {
    const auto sent = launches_ ? send_to_leave_at(at_ns, socket_, std::span(sending_).first(bytes))
                                : ::send(socket_, sending_.data(), bytes, MSG_NOSIGNAL);
    return sent < 0 ? errno : 0;
  }

  template <typename Take>
  int receive(const frames::Bell& bell, const Take& take) noexcept {
    while (!ring_.has_frame()) {
      if (bell.rung()) return 0;
      if (busy_) continue;
      if (const int error = bell.wait(socket_); error != 0) return error;
    }
    while (ring_.has_frame() && !bell.rung()) ring_.hand_over(take);
    return 0;
  }

  // The kernel counts since the last call.
  Losses losses() {
    tpacket_stats since{};
    socklen_t length = sizeof since;
    if (getsockopt(socket_, SOL_PACKET, PACKET_STATISTICS, &since, &length) != 0) return {};
    dropped_ += since.tp_drops;
    return {.on_the_way = {}, .overwritten = dropped_};
  }

  std::map<std::string, std::string> facts() const { return {{"busy-poll", busy_ ? "on" : "off"}}; }

 private:
  const bool busy_, launches_;
  PacketSocket socket_;
  Ring ring_;
  std::vector<std::byte> sending_;
  std::uint64_t dropped_ = 0;
};

std::unique_ptr<Endpoint> open(const Config& config, Sink& sink) {
  constexpr std::size_t any_frame = ~std::size_t{0};
  return std::make_unique<frames::End<Packets>>(config, sink, frames::link_of(config, who, any_frame), who);
}

// The largest possible MTU; the link's own may be smaller.
static_assert(shipped("ethernet")->can.max_payload_bytes + frames::overhead ==
              65'535 + frames::ethernet_bytes);

}  // namespace
}  // namespace ontime::transport

extern "C" __attribute__((visibility("default")))
const ontime::transport::Plugin ontime_transport{ontime::transport::abi,
                                                 "ethernet",
                                                 ontime::transport::kernel_version,
                                                 ontime::transport::shipped("ethernet")->can,
                                                 ontime::transport::shipped("ethernet")->options,
                                                 ontime::transport::open};
