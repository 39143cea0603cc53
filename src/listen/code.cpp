// SPDX-License-Identifier: Apache-2.0
#include "listen/code.hpp"

#include <algorithm>
#include <map>

#include <capstone/capstone.h>

#include "listen/event.h"

namespace ontime::listen {
namespace {

constexpr Registers as_called{ontime_argument_1, ontime_argument_2, ontime_argument_3, ontime_argument_4};

#ifdef __x86_64__
constexpr std::size_t most_instructions = 16;  // that a place may be away from the first byte

// The register of 64 bits that this one is a part of, as event.h numbers it; 0: none of those.
std::uint8_t whole_register(unsigned reg) {
  static const std::map<unsigned, std::uint8_t> names = [] {
    std::map<unsigned, std::uint8_t> all;
    const auto add = [&](std::uint8_t number, std::initializer_list<unsigned> parts) {
      for (const auto part : parts) all[part] = number;
    };
    add(ontime_argument_1, {X86_REG_RDI, X86_REG_EDI, X86_REG_DI, X86_REG_DIL});
    add(ontime_argument_2, {X86_REG_RSI, X86_REG_ESI, X86_REG_SI, X86_REG_SIL});
    add(ontime_argument_3, {X86_REG_RDX, X86_REG_EDX, X86_REG_DX, X86_REG_DL, X86_REG_DH});
    add(ontime_argument_4, {X86_REG_RCX, X86_REG_ECX, X86_REG_CX, X86_REG_CL, X86_REG_CH});
    add(ontime_r8, {X86_REG_R8, X86_REG_R8D, X86_REG_R8W, X86_REG_R8B});
    add(ontime_r9, {X86_REG_R9, X86_REG_R9D, X86_REG_R9W, X86_REG_R9B});
    add(ontime_rax, {X86_REG_RAX, X86_REG_EAX, X86_REG_AX, X86_REG_AL, X86_REG_AH});
    add(ontime_rbx, {X86_REG_RBX, X86_REG_EBX, X86_REG_BX, X86_REG_BL, X86_REG_BH});
    add(ontime_rbp, {X86_REG_RBP, X86_REG_EBP, X86_REG_BP, X86_REG_BPL});
    add(ontime_r10, {X86_REG_R10, X86_REG_R10D, X86_REG_R10W, X86_REG_R10B});
    add(ontime_r11, {X86_REG_R11, X86_REG_R11D, X86_REG_R11W, X86_REG_R11B});
    add(ontime_r12, {X86_REG_R12, X86_REG_R12D, X86_REG_R12W, X86_REG_R12B});
    add(ontime_r13, {X86_REG_R13, X86_REG_R13D, X86_REG_R13W, X86_REG_R13B});
    add(ontime_r14, {X86_REG_R14, X86_REG_R14D, X86_REG_R14W, X86_REG_R14B});
    add(ontime_r15, {X86_REG_R15, X86_REG_R15D, X86_REG_R15W, X86_REG_R15B});
    return all;
  }();
  const auto found = names.find(reg);
  return found == names.end() ? 0 : found->second;
}

bool is_stack_pointer(unsigned reg) { return reg == X86_REG_RSP || reg == X86_REG_ESP || reg == X86_REG_SP; }

class Disassembly {
 public:
  explicit Disassembly(const Code& code) : code_(code) {
    if (cs_open(CS_ARCH_X86, CS_MODE_64, &handle_) != CS_ERR_OK) return;
    cs_option(handle_, CS_OPT_DETAIL, CS_OPT_ON);
    count_ = cs_disasm(handle_, code.bytes.data(), code.bytes.size(), code.address, 0, &instructions_);
  }
  ~Disassembly() {
    if (count_ > 0) cs_free(instructions_, count_);
    if (handle_ != 0) cs_close(&handle_);
  }
  Disassembly(const Disassembly&) = delete;
  Disassembly& operator=(const Disassembly&) = delete;

  std::span<const cs_insn> instructions() const { return {instructions_, count_}; }
  // Those among which a place is looked for. Where not all jumps are known, only the first byte is sure to be
  // passed once.
  std::span<const cs_insn> first() const {
    return instructions().first(std::min(count_, is_plain() ? most_instructions : 1));
  }
  std::uint64_t offset_of(const cs_insn& instruction) const { return instruction.address - code_.address; }

  bool is_jump(const cs_insn& one) const { return cs_insn_group(handle_, &one, CS_GRP_JUMP); }
  bool is_call(const cs_insn& one) const { return cs_insn_group(handle_, &one, CS_GRP_CALL); }
  bool is_return(const cs_insn& one) const { return cs_insn_group(handle_, &one, CS_GRP_RET); }
  bool passes_control(const cs_insn& one) const { return is_jump(one) || is_call(one) || is_return(one); }
  static bool is_direct(const cs_insn& one) { return one.detail->x86.operands[0].type == X86_OP_IMM; }
  static std::uint64_t target_of(const cs_insn& one) {
    return static_cast<std::uint64_t>(one.detail->x86.operands[0].imm);
  }

  // The kernel emulates it (arch/x86/kernel/uprobes.c), and it is passed once a call.
  bool is_place(const cs_insn& one) const { return is_emulated(one) && !is_passed_again(one); }
  bool is_emulated(const cs_insn& one) const {
    if (one.id == X86_INS_PUSH) return one.detail->x86.operands[0].type == X86_OP_REG;
    if (one.id == X86_INS_NOP) return one.size == 1;
    if (one.id == X86_INS_CALL || one.id == X86_INS_JMP) return is_direct(one);
    return is_jump(one);
  }

  // Calls use(register, as it is named there) for each that it writes; false: they are not known.
  bool each_written(const cs_insn& one, const auto& use) const {
    cs_regs read, written;
    std::uint8_t reads = 0, writes = 0;
    if (cs_regs_access(handle_, &one, read, &reads, written, &writes) != CS_ERR_OK) return false;
    std::for_each(written, written + writes, use);
    return true;
  }

 private:
  // All of the bytes are instructions, and each jump says where to.
  bool is_plain() const {
    if (count_ == 0 || !code_.is_whole) return false;
    const auto& last = instructions_[count_ - 1];
    if (offset_of(last) + last.size != code_.bytes.size()) return false;
    return std::all_of(instructions_, instructions_ + count_, [&](const auto& one) {
      const auto& operand = one.detail->x86.operands[0];
      // Through the table of imported functions it leaves this one.
      return !is_jump(one) || is_direct(one) ||
             (operand.type == X86_OP_MEM && operand.mem.base == X86_REG_RIP);
    });
  }
  // The code jumps back to somewhere between its second instruction and this one.
  bool is_passed_again(const cs_insn& place) const {
    return std::any_of(instructions_, instructions_ + count_, [&](const auto& one) {
      return is_jump(one) && is_direct(one) && one.address >= place.address &&
             target_of(one) > code_.address && target_of(one) <= place.address;
    });
  }

  const Code& code_;
  csh handle_ = 0;
  cs_insn* instructions_ = nullptr;
  std::size_t count_ = 0;
};

// Which registers hold an argument, instruction by instruction.
class Arguments {
 public:
  explicit Arguments(const Disassembly& code) : code_(code) {
    for (std::size_t i = 0; i < as_called.size(); ++i) held_[as_called[i]] = i;
  }
  // The one that it came in, where it still is there.
  std::uint8_t register_of(std::size_t argument) const {
    if (const auto own = held_.find(as_called[argument]); own != held_.end() && own->second == argument)
      return own->first;
    for (const auto& [reg, held] : held_)
      if (held == argument) return reg;
    return 0;
  }
  void pass(const cs_insn& one) {
    const auto& x86 = one.detail->x86;
    std::optional<std::size_t> copied;
    // 32 bits of an argument are copied where it has no more.
    if (one.id == X86_INS_MOV && x86.operands[1].type == X86_OP_REG && x86.operands[1].size >= 4)
      if (const auto from = held_.find(whole_register(x86.operands[1].reg)); from != held_.end())
        copied = from->second;
    if (!code_.each_written(one, [&](auto reg) { held_.erase(whole_register(reg)); })) held_.clear();
    if (copied && x86.operands[0].type == X86_OP_REG)
      if (const auto to = whole_register(x86.operands[0].reg); to != 0) held_[to] = *copied;
  }

 private:
  const Disassembly& code_;
  std::map<std::uint8_t, std::size_t> held_;  // register → argument
};

// The call that each call of this function makes, as its only one, and whose result it returns.
std::optional<std::uint64_t> callee_of(const Disassembly& code) {
  const auto all = code.instructions();
  const auto is_call = [&](const auto& one) { return code.is_call(one); };
  const auto call = std::find_if(all.begin(), all.end(), is_call);
  if (call == all.end() || !Disassembly::is_direct(*call)) return {};
  const bool reaches_it = std::none_of(all.begin(), call, [&](const auto& one) {
    return code.is_return(one) || (code.is_jump(one) && (!Disassembly::is_direct(one) ||
                                                         Disassembly::target_of(one) <= one.address ||
                                                         Disassembly::target_of(one) > call->address));
  });
  if (!reaches_it) return {};
  for (auto one = std::next(call); one != all.end(); ++one) {
    if (code.is_return(*one)) return Disassembly::target_of(*call);
    bool keeps_result = !code.passes_control(*one);
    keeps_result &=
        code.each_written(*one, [&](auto reg) { keeps_result &= whole_register(reg) != ontime_rax; });
    if (!keeps_result) return {};
  }
  return {};
}
#endif

}  // namespace

#ifdef __x86_64__
Entry entry_of(const Code& code, std::span<const std::size_t> arguments) {
  const Disassembly disassembly(code);
  Arguments held(disassembly);
  for (const auto& instruction : disassembly.first()) {
    const bool are_held = std::all_of(arguments.begin(), arguments.end(),
                                      [&](auto argument) { return held.register_of(argument) != 0; });
    if (!are_held) break;
    if (disassembly.is_place(instruction)) {
      Entry entry{.offset = disassembly.offset_of(instruction), .is_cheap = true, .registers = {}};
      for (const auto argument : arguments) entry.registers[argument] = held.register_of(argument);
      return entry;
    }
    if (disassembly.passes_control(instruction)) break;
    held.pass(instruction);
  }
  return {.registers = as_called};
}

Exit exit_of(const Code& code) {
  const Disassembly disassembly(code);
  for (const auto& instruction : disassembly.first()) {
    if (disassembly.is_place(instruction))
      return {.offset = disassembly.offset_of(instruction), .is_cheap = true, .callee = {}};
    bool keeps_stack = !disassembly.passes_control(instruction);
    keeps_stack &=
        disassembly.each_written(instruction, [&](auto reg) { keeps_stack &= !is_stack_pointer(reg); });
    if (!keeps_stack) break;
  }
  Exit exit;
  if (disassembly.first().size() > 1) exit.callee = callee_of(disassembly);
  return exit;
}

bool begins_cheaply(const Code& code) {
  const Disassembly disassembly(code);
  return !disassembly.instructions().empty() && disassembly.is_emulated(disassembly.instructions().front());
}

std::optional<std::uint64_t> offset_of_topic_name(const Code& code) {
  // It ends with strlcpy(name, topic->m_name, size): the load of the second argument from far within a
  // structure.
  const Disassembly disassembly(code);
  for (const auto& instruction : disassembly.instructions()) {
    const auto& x86 = instruction.detail->x86;
    if (instruction.id == X86_INS_MOV && x86.op_count == 2 && x86.operands[0].type == X86_OP_REG &&
        x86.operands[0].reg == X86_REG_RSI && x86.operands[1].type == X86_OP_MEM &&
        x86.operands[1].mem.base != X86_REG_RSP && x86.operands[1].mem.disp >= 64 &&
        x86.operands[1].mem.disp < 4096)
      return static_cast<std::uint64_t>(x86.operands[1].mem.disp);
  }
  return {};
}

std::optional<std::uint64_t> offset_of_member(const Code& code) {
  const Disassembly disassembly(code);
  auto all = disassembly.instructions();
  if (!all.empty() && all.front().id == X86_INS_ENDBR64) all = all.subspan(1);
  if (all.size() < 2 || all[0].id != X86_INS_MOV ||
      !(disassembly.is_return(all[1]) || disassembly.is_jump(all[1])))
    return {};
  const auto &to = all[0].detail->x86.operands[0], &from = all[0].detail->x86.operands[1];
  if (to.type != X86_OP_REG || from.type != X86_OP_MEM || from.mem.base != X86_REG_RDI ||
      from.mem.index != X86_REG_INVALID || from.mem.disp <= 0)
    return {};
  return static_cast<std::uint64_t>(from.mem.disp);
}
#else
Entry entry_of(const Code&, std::span<const std::size_t>) { return {.registers = as_called}; }
Exit exit_of(const Code&) { return {}; }
bool begins_cheaply(const Code&) { return false; }
std::optional<std::uint64_t> offset_of_topic_name(const Code&) { return {}; }
std::optional<std::uint64_t> offset_of_member(const Code&) { return {}; }
#endif

}  // namespace ontime::listen
