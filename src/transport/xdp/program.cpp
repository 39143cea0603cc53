// SPDX-License-Identifier: Apache-2.0
#include "transport/xdp/program.hpp"

#include <cerrno>
#include <system_error>

#include <bpf/bpf.h>
#include <bpf/libbpf.h>
#include <fmt/format.h>
#include <linux/bpf.h>
#include <linux/if_link.h>

namespace ontime::transport::xdp {
namespace {

using frames::Header;

constexpr std::uint8_t r0 = 0, r1 = 1, r2 = 2, r3 = 3, r4 = 4, r5 = 5, r6 = 6;

constexpr bpf_insn insn(int code, std::uint8_t to, std::uint8_t from, std::size_t offset,
                        std::int32_t value) {
  bpf_insn made{};
  made.code = static_cast<std::uint8_t>(code);
  made.dst_reg = to & 0xfU;
  made.src_reg = from & 0xfU;
  made.off = static_cast<std::int16_t>(offset);
  made.imm = value;
  return made;
}
constexpr bpf_insn load(int size, std::uint8_t to, std::uint8_t from, std::size_t offset) {
  return insn(BPF_LDX | BPF_MEM | size, to, from, offset, 0);
}
constexpr bpf_insn set(std::uint8_t to, std::int32_t value) {
  return insn(BPF_ALU64 | BPF_MOV | BPF_K, to, 0, 0, value);
}
constexpr bpf_insn low_half(std::uint8_t to, std::uint8_t kind, std::uint64_t value) {
  return insn(BPF_LD | BPF_IMM | BPF_DW, to, kind, 0, static_cast<std::int32_t>(value & 0xffffffff));
}
constexpr bpf_insn high_half(std::uint64_t value) {
  return insn(0, 0, 0, 0, static_cast<std::int32_t>(value >> 32U));
}

// if (frame is of the topic) return bpf_redirect_map(map, queue, XDP_PASS); return XDP_PASS;
int load_program(int map, std::uint64_t topic) {
  constexpr int unless_equal = BPF_JMP | BPF_JNE | BPF_K;
  const std::int32_t type = htons(frames::ether_type);  // as it is in the frame
  const bpf_insn code[] = {
      load(BPF_W, r6, r1, offsetof(xdp_md, data)),
      load(BPF_W, r3, r1, offsetof(xdp_md, data_end)),
      load(BPF_W, r2, r1, offsetof(xdp_md, rx_queue_index)),
      insn(BPF_ALU64 | BPF_MOV | BPF_X, r4, r6, 0, 0),
      insn(BPF_ALU64 | BPF_ADD | BPF_K, r4, 0, 0, sizeof(Header)),
      insn(BPF_JMP | BPF_JGT | BPF_X, r4, r3, 13, 0),  // to the end: so many are between
      load(BPF_H, r4, r6, offsetof(Header, type)),
      insn(unless_equal, r4, 0, 11, type),
      load(BPF_W, r4, r6, offsetof(Header, magic)),
      insn(unless_equal, r4, 0, 9, frames::magic),
      load(BPF_DW, r4, r6, offsetof(Header, topic)),
      low_half(r5, 0, topic),
      high_half(topic),
      insn(BPF_JMP | BPF_JNE | BPF_X, r4, r5, 5, 0),
      low_half(r1, BPF_PSEUDO_MAP_FD, static_cast<std::uint64_t>(map)),
      high_half(0),
      set(r3, XDP_PASS),
      insn(BPF_JMP | BPF_CALL, 0, 0, 0, BPF_FUNC_redirect_map),
      insn(BPF_JMP | BPF_EXIT, 0, 0, 0, 0),
      set(r0, XDP_PASS),
      insn(BPF_JMP | BPF_EXIT, 0, 0, 0, 0),
  };
  return bpf_prog_load(BPF_PROG_TYPE_XDP, "ontime", "Apache-2.0", code, std::size(code), nullptr);
}

[[noreturn]] void fail(const std::string& what, int error) {
  if (error == EPERM || error == EACCES)
    throw Error(fmt::format("xdp: no permission for {}. Fix: {}", what, wants_permission));
  throw Error(fmt::format("xdp: no {}: {}", what, std::generic_category().message(error)));
}

[[noreturn]] void is_taken(const std::string& interface, std::uint32_t program) {
  throw Error(fmt::format(
      "xdp: {0} already has an XDP program{1} of another program or run (see bpftool net); ontime "
      "does not replace it. Fix: end that run, or sudo ip link set {0} xdp off, or name another "
      "interface",
      interface, program == 0 ? "" : fmt::format(" (number {})", program)));
}

}  // namespace

Program::Program(const frames::Link& link, std::uint64_t topic, std::uint32_t queue, int socket) {
  map_ = Descriptor(bpf_map_create(BPF_MAP_TYPE_XSKMAP, "ontime", sizeof(std::uint32_t), sizeof socket,
                                   queue + 1, nullptr));
  if (map_ < 0) fail("map of sockets", errno);
  if (bpf_map_update_elem(map_, &queue, &socket, BPF_ANY) != 0) fail("entry in its map of sockets", errno);
  program_ = Descriptor(load_program(map_, topic));
  if (program_ < 0) fail("XDP program", errno);
  attach(link);
}

void Program::refuse_another(const frames::Link& link) {
  bpf_xdp_query_opts there{};
  there.sz = sizeof there;
  if (bpf_xdp_query(link.index, 0, &there) != 0) return;
  for (const auto program : {there.prog_id, there.drv_prog_id, there.hw_prog_id, there.skb_prog_id})
    if (program != 0) is_taken(link.name, program);
}

void Program::attach(const frames::Link& link) {
  int error = 0;
  for (const auto& [flag, name] :
       {std::pair(XDP_FLAGS_DRV_MODE, "native"), std::pair(XDP_FLAGS_SKB_MODE, "generic")}) {
    bpf_link_create_opts how{};
    how.sz = sizeof how;
    how.flags = flag;
    mode_ = name;
    attached_ = Descriptor(bpf_link_create(program_, link.index, BPF_XDP, &how));
    if (attached_ >= 0) return;
    error = errno;
    if (error == EBUSY || error == EEXIST) is_taken(link.name, 0);
  }
  fail(fmt::format("XDP at {}", link.name), error);
}

}  // namespace ontime::transport::xdp
