// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <optional>
#include <thread>
#include <utility>

#include <fmt/format.h>
#include <linux/filter.h>
#include <net/if.h>
#include <pcap/pcap.h>
#include <sys/socket.h>

#include "listen/clock_steps.hpp"
#include "listen/listen.hpp"
#include "listen/packets.hpp"
#include "listen/wire.hpp"
#include "machine/machine.hpp"

namespace ontime::listen {
namespace {

// Over loopback a frame may be longer than 64 KiB: an IP packet of 65,535 bytes, and the headers before it.
constexpr int most_frame_bytes = 1 << 17, ring_bytes = 16 << 20;
// Per call: fewer than the ring holds, so that drops are noted before the packets behind them are read.
constexpr int most_packets = 64;
constexpr std::int64_t latest_s = 4'000'000'000;  // later times are invalid; the year 2096
// RTPS over IPv4, later fragments of anything, UDP over IPv6, and what has a VLAN tag: the kernel has taken
// one tag off before, but a frame may have two.
constexpr const char* wanted =
    "(udp and udp[8:4] = 0x52545053) or (ip[6:2] & 0x3fff != 0) or (ip6 and udp) or ether proto 0x8100 or "
    "ether proto 0x88a8";

using Handle = std::unique_ptr<pcap_t, void (*)(pcap_t*)>;

class Capture final : public Sensor {
 public:
  Capture(Handle handle, bool is_live, const Limits& limits)
      : handle_(std::move(handle)),
        is_live_(is_live),
        limits_(limits),
        packets_(pcap_datalink(handle_.get())),
        wire_(limits) {}

  bool listen_for(std::chrono::milliseconds most) override {
    const auto until = std::chrono::steady_clock::now() + most;
    do {
      const std::chrono::nanoseconds from = std::chrono::system_clock::now().time_since_epoch();
      if (is_live_) {
        note_drops();
        follow_clock(from);
      }
      const int count = pcap_dispatch(handle_.get(), most_packets, take, reinterpret_cast<u_char*>(this));
      if (count > 0) continue;
      if (!is_live_) {
        if (count < 0) damage_ = pcap_geterr(handle_.get());
        return false;
      }
      if (count < 0) throw Error(fmt::format("listen: the capture failed: {}", pcap_geterr(handle_.get())));
      read_ns_ = from.count();
      end_doubt();
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    } while (std::chrono::steady_clock::now() < until);
    return true;
  }

  Findings findings() const override {
    auto findings = wire_.findings();
    findings.sensor_lost = dropped_;
    judge_silence(findings.flows, limits_,
                  is_live_ ? std::max(read_ns_, latest_ns_) - unread_ns : latest_ns_);
    clock_.remark(findings.remarks, "Periods and losses");
    if (too_short_ > 0)  // `editcap -s 96 -L` leaves such ones of every large message
      findings.remarks.push_back(fmt::format(
          "datagrams shorter than they state: {}. No receiver takes them, and their messages may count as "
          "lost. If a tool cut the packets, judge the original capture",
          too_short_));
    if (!damage_.empty())
      findings.add_incomplete(
          fmt::format("the capture cannot be read to its end: {}. ontime judges the part before", damage_));
    return findings;
  }

  void end() override { wire_.end(); }

  std::vector<Miss> take_misses() override { return wire_.take_misses(); }

  void keep_rows(KeepRow keep) override { wire_.keep_rows(origin_.shifted(std::move(keep))); }

 private:
  static void take(u_char* self, const pcap_pkthdr* header, const u_char* bytes) {
    auto& capture = *reinterpret_cast<Capture*>(self);
    // The handle is set to nanoseconds: they are in tv_usec.
    const auto at_ns = std::clamp<std::int64_t>(header->ts.tv_sec, 0, latest_s) * 1'000'000'000 +
                       header->ts.tv_usec % 1'000'000'000;
    capture.origin_.begin(at_ns);
    capture.note_time(at_ns);
    const auto datagram =
        capture.packets_.datagram({reinterpret_cast<const std::byte*>(bytes), header->caplen}, at_ns);
    if (!datagram) return;
    // If it was captured whole and is shorter than it states, no receiver takes it.
    if (datagram->is_cut && header->caplen == header->len) {
      ++capture.too_short_;
      return;
    }
    if (capture.is_in_doubt_) capture.wire_.interrupt();
    capture.wire_.add(at_ns, *datagram);
  }

  // Packets of several interfaces are out of order by less than a second. Of a file only a step back is
  // known: a step forward looks as if nothing had come.
  void note_time(std::int64_t at_ns) {
    constexpr std::int64_t set_back_ns = 1'000'000'000;
    if (clock_set_ns_) return;
    const auto step_ns = at_ns - std::exchange(latest_ns_, at_ns);
    if (is_live_ || step_ns >= -set_back_ns) return;
    clock_.add(step_ns);
    wire_.set_clock(at_ns, at_ns);
  }

  // What is in the ring may be of both times.
  void follow_clock(std::chrono::nanoseconds now) {
    const std::chrono::nanoseconds steady = std::chrono::steady_clock::now().time_since_epoch();
    if (clock_.look((now - steady).count(), steady.count(), machine::realtime_offset_ns) == 0) return;
    clock_set_ns_ = read_ns_ = now.count();
    latest_ns_ = 0;
    wire_.set_clock(read_ns_, read_ns_);
    is_in_doubt_ = true;
  }

  void note_drops() {
    pcap_stat counts{};
    if (pcap_stats(handle_.get(), &counts) != 0 || counts.ps_drop == dropped_) return;
    dropped_ = counts.ps_drop;
    is_in_doubt_ = true;
  }

  // The ring is empty: the dropped packets, and those of another time, were before the next one.
  void end_doubt() {
    if (is_in_doubt_) wire_.interrupt();
    if (clock_set_ns_) wire_.set_clock(*clock_set_ns_, std::max(*clock_set_ns_, read_ns_));
    is_in_doubt_ = false;
    clock_set_ns_.reset();
  }

  Handle handle_;
  const bool is_live_;
  const Limits limits_;
  std::int64_t latest_ns_ = 0;  // of the previous packet: the clock may be set back
  std::int64_t read_ns_ = 0;    // of a live source: all until then was read
  ClockSteps clock_;
  std::optional<std::int64_t>
      clock_set_ns_;  // what it then showed, as long as the ring may hold earlier ones
  Origin origin_;
  Packets packets_;
  std::uint64_t too_short_ = 0;  // datagrams
  Wire wire_;
  std::uint32_t dropped_ = 0;
  // Packets were dropped, or the clock was set, somewhere among those in the ring.
  bool is_in_doubt_ = false;
  std::string damage_;  // of a file
};

}  // namespace

std::unique_ptr<Sensor> in_packets(const std::string& interface, const Limits& limits) {
  std::array<char, PCAP_ERRBUF_SIZE> text{};
  Handle handle(pcap_create(interface.c_str(), text.data()), pcap_close);
  if (!handle) throw Error(fmt::format("listen: {}: {}", interface, text.data()));
  pcap_set_snaplen(handle.get(), most_frame_bytes);
  pcap_set_buffer_size(handle.get(), ring_bytes);
  pcap_set_timeout(handle.get(), 10);
  pcap_set_tstamp_precision(handle.get(), PCAP_TSTAMP_PRECISION_NANO);
  const int error = pcap_activate(handle.get());
  if (error == PCAP_ERROR_PERM_DENIED)
    throw Error(fmt::format(
        "listen: capturing on {} needs root or CAP_NET_RAW. Fix: run with sudo, or once: sudo setcap "
        "cap_net_raw+ep $(command -v ontime)",
        interface));
  if (error == PCAP_ERROR_NO_SUCH_DEVICE)
    throw WrongInput(fmt::format("{}: not an interface of this machine. List them: ip link", interface));
  if (error == PCAP_ERROR_IFACE_NOT_UP)
    throw Error(fmt::format("listen: interface '{0}' is down. Fix: sudo ip link set {0} up", interface));
  if (error < 0)
    throw Error(
        fmt::format("listen: {}: {}. List the interfaces: ip link", interface, pcap_geterr(handle.get())));
  // Of "any": the newer header names the interface. A bridged packet, or one of a VLAN, passes several.
  if (pcap_datalink(handle.get()) == DLT_LINUX_SLL) pcap_set_datalink(handle.get(), DLT_LINUX_SLL2);
  // Loopback shows each packet twice. libpcap takes one of them, but counts both among those dropped, unless
  // the kernel leaves one out.
  const auto filter = [&](const std::string& expression, auto&& set) {
    bpf_program program{};
    if (pcap_compile(handle.get(), &program, expression.c_str(), 1, PCAP_NETMASK_UNKNOWN) == 0) set(program);
    pcap_freecode(&program);
  };
  const auto set = [&](bpf_program& program) { pcap_setfilter(handle.get(), &program); };
  if (pcap_datalink(handle.get()) == DLT_LINUX_SLL2) {
    filter(fmt::format("({}) and not (outbound and ifindex {})", wanted, if_nametoindex("lo")), set);
  } else {
    filter(wanted, set);
    // Not by libpcap, which filters the first packets itself and does not know their direction.
    if (interface == "lo")
      filter(fmt::format("({}) and not outbound", wanted), [&](bpf_program& program) {
        const sock_fprog of_socket{static_cast<unsigned short>(program.bf_len),
                                   reinterpret_cast<sock_filter*>(program.bf_insns)};
        setsockopt(pcap_fileno(handle.get()), SOL_SOCKET, SO_ATTACH_FILTER, &of_socket, sizeof of_socket);
      });
  }
  pcap_setnonblock(handle.get(), 1, text.data());
  return std::make_unique<Capture>(std::move(handle), true, limits);
}

std::unique_ptr<Sensor> in_pcap_file(const std::string& path, const Limits& limits) {
  std::array<char, PCAP_ERRBUF_SIZE> text{};
  Handle handle(
      pcap_open_offline_with_tstamp_precision(path.c_str(), PCAP_TSTAMP_PRECISION_NANO, text.data()),
      pcap_close);
  const std::string why(text.data());  // with the path, or without it
  if (!handle)
    throw WrongInput(fmt::format("{}. Fix: name a capture of tcpdump or Wireshark (pcap, pcapng)",
                                 why.starts_with(path + ": ") ? why : fmt::format("{}: {}", path, why)));
  try {
    return std::make_unique<Capture>(std::move(handle), false, limits);
  } catch (const Error& error) {  // of another kind of link
    throw WrongInput(fmt::format("{}: {}", path, error.what()));
  }
}

}  // namespace ontime::listen
