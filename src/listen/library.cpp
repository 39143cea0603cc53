// SPDX-License-Identifier: Apache-2.0
#include "listen/library.hpp"

#include <algorithm>
#include <cerrno>
#include <memory>
#include <span>
#include <system_error>

#include <capstone/capstone.h>
#include <fcntl.h>
#include <fmt/format.h>
#include <gelf.h>
#include <unistd.h>

#include "listen/listen.hpp"

namespace ontime::listen {
namespace {

constexpr std::size_t most_code_bytes = 64 << 10;
constexpr std::size_t most_symbols = 1 << 20, most_functions = 1024;
constexpr std::uint64_t most_section_bytes = 64 << 20;
constexpr std::size_t most_instructions = 16;  // that a place may be away from the first byte

struct Descriptor {
  explicit Descriptor(const std::string& path) : fd(open(path.c_str(), O_RDONLY | O_CLOEXEC)) {}
  ~Descriptor() {
    if (fd >= 0) close(fd);
  }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  const int fd;
};

// Offset in the file of an address in memory; empty: no segment has it.
std::optional<std::uint64_t> offset_of(Elf* elf, std::uint64_t address) {
  std::size_t segments = 0;
  if (elf_getphdrnum(elf, &segments) != 0) return {};
  for (std::size_t i = 0; i < segments; ++i) {
    GElf_Phdr segment;
    if (gelf_getphdr(elf, static_cast<int>(i), &segment) == nullptr) continue;
    if (segment.p_type == PT_LOAD && address >= segment.p_vaddr &&
        address - segment.p_vaddr < segment.p_filesz)
      return address - segment.p_vaddr + segment.p_offset;
  }
  return {};
}

bool is_wanted(std::string_view name) {
  return name.starts_with("rmw_publish") || name.starts_with("rmw_take") || name.starts_with("dds_take") ||
         name.starts_with("dds_write") || name.starts_with("dds_entity_") || name == "dds_get_name";
}

class Disassembler {
 public:
  explicit Disassembler(std::span<const std::uint8_t> code, std::uint64_t address) {
    if (cs_open(CS_ARCH_X86, CS_MODE_64, &handle_) != CS_ERR_OK) return;
    cs_option(handle_, CS_OPT_DETAIL, CS_OPT_ON);
    count_ = cs_disasm(handle_, code.data(), code.size(), address, 0, &instructions_);
  }
  ~Disassembler() {
    if (count_ > 0) cs_free(instructions_, count_);
    if (handle_ != 0) cs_close(&handle_);
  }
  Disassembler(const Disassembler&) = delete;
  Disassembler& operator=(const Disassembler&) = delete;
  std::span<const cs_insn> instructions() const { return {instructions_, count_}; }
  bool is_in(const cs_insn& instruction, std::uint8_t group) const {
    return cs_insn_group(handle_, &instruction, group);
  }

  // The kernel emulates it (arch/x86/kernel/uprobes.c) and it passes control in one of few simple ways.
  bool is_emulated(const cs_insn& instruction) const {
    if (instruction.id == X86_INS_PUSH) return instruction.detail->x86.operands[0].type == X86_OP_REG;
    if (instruction.id == X86_INS_NOP) return instruction.size == 1;
    if (instruction.id == X86_INS_CALL || instruction.id == X86_INS_JMP)
      return instruction.detail->x86.operands[0].type == X86_OP_IMM;
    return is_in(instruction, CS_GRP_JUMP);
  }
  // All of these bytes are instructions, and each jump says where to.
  bool is_plain(std::size_t bytes) const {
    if (count_ == 0) return false;
    const auto& last = instructions_[count_ - 1];
    if (last.address + last.size - instructions_->address != bytes) return false;
    return std::all_of(instructions_, instructions_ + count_, [&](const auto& jump) {
      const auto& operand = jump.detail->x86.operands[0];
      // Through the table of imported functions it leaves this one.
      return !is_in(jump, CS_GRP_JUMP) || operand.type == X86_OP_IMM ||
             (operand.type == X86_OP_MEM && operand.mem.base == X86_REG_RIP);
    });
  }
  // The code jumps back to somewhere between its second instruction and this one: a call may pass it twice.
  bool is_passed_again(const cs_insn& place) const {
    return std::any_of(instructions_, instructions_ + count_, [&](const auto& jump) {
      const auto& operand = jump.detail->x86.operands[0];
      return is_in(jump, CS_GRP_JUMP) && operand.type == X86_OP_IMM && jump.address >= place.address &&
             static_cast<std::uint64_t>(operand.imm) > instructions_->address &&
             static_cast<std::uint64_t>(operand.imm) <= place.address;
    });
  }
  // Arguments, or the return address, may no longer be where a call puts them.
  bool ends_entry(const cs_insn& instruction) const {
    if (is_in(instruction, CS_GRP_JUMP) || is_in(instruction, CS_GRP_CALL) || is_in(instruction, CS_GRP_RET))
      return true;
    cs_regs read, written;
    std::uint8_t reads = 0, writes = 0;
    if (cs_regs_access(handle_, &instruction, read, &reads, written, &writes) != CS_ERR_OK) return true;
    return std::any_of(written, written + writes, [](auto reg) {
      constexpr std::uint16_t arguments[] = {X86_REG_RDI, X86_REG_EDI, X86_REG_DI,  X86_REG_DIL, X86_REG_RSI,
                                             X86_REG_ESI, X86_REG_SI,  X86_REG_SIL, X86_REG_RDX, X86_REG_EDX,
                                             X86_REG_DX,  X86_REG_DL,  X86_REG_RCX, X86_REG_ECX, X86_REG_CX,
                                             X86_REG_CL,  X86_REG_RSP};
      return std::find(std::begin(arguments), std::end(arguments), reg) != std::end(arguments);
    });
  }

 private:
  csh handle_ = 0;
  cs_insn* instructions_ = nullptr;
  std::size_t count_ = 0;
};

#ifdef __x86_64__
constexpr GElf_Half machine = EM_X86_64;
#else
constexpr GElf_Half machine = EM_AARCH64;
#endif

}  // namespace

Library::Library(const std::string& path) {
  const Descriptor file(path);
  if (file.fd < 0)
    throw Error(fmt::format("{} cannot be read: {}", path, std::generic_category().message(errno)));
  elf_version(EV_CURRENT);
  const std::unique_ptr<Elf, int (*)(Elf*)> elf(elf_begin(file.fd, ELF_C_READ, nullptr), elf_end);
  GElf_Ehdr header;
  if (!elf || gelf_getehdr(elf.get(), &header) == nullptr || header.e_machine != machine)
    throw Error(fmt::format("{} is not a library of this machine's architecture", path));
  for (Elf_Scn* section = nullptr; (section = elf_nextscn(elf.get(), section)) != nullptr;) {
    GElf_Shdr shape;
    if (gelf_getshdr(section, &shape) == nullptr || shape.sh_type != SHT_DYNSYM || shape.sh_entsize == 0 ||
        shape.sh_size > most_section_bytes)
      continue;
    Elf_Data* const data = elf_getdata(section, nullptr);
    const auto count = std::min<std::uint64_t>(shape.sh_size / shape.sh_entsize, most_symbols);
    for (std::size_t i = 0; data != nullptr && i < count && functions_.size() < most_functions; ++i) {
      GElf_Sym symbol;
      if (gelf_getsym(data, static_cast<int>(i), &symbol) == nullptr) break;
      if (GELF_ST_TYPE(symbol.st_info) != STT_FUNC || symbol.st_shndx == SHN_UNDEF) continue;
      const char* const name = elf_strptr(elf.get(), shape.sh_link, symbol.st_name);
      const auto offset = offset_of(elf.get(), symbol.st_value);
      if (name == nullptr || !is_wanted(name) || !offset) continue;
      std::vector<std::uint8_t> code(std::min<std::size_t>(symbol.st_size, most_code_bytes));
      const auto bytes = pread(file.fd, code.data(), code.size(), static_cast<off_t>(*offset));
      code.resize(bytes < 0 ? 0 : static_cast<std::size_t>(bytes));
      const bool is_whole = code.size() == symbol.st_size;
      functions_.push_back({name, symbol.st_value, *offset, std::move(code), is_whole});
    }
  }
}

const Library::Function* Library::find(const std::string& function) const {
  const auto found = std::find_if(functions_.begin(), functions_.end(),
                                  [&](const auto& one) { return one.name == function; });
  return found == functions_.end() ? nullptr : &*found;
}

std::optional<Place> Library::place(const std::string& function) const {
  const auto* const found = find(function);
  if (found == nullptr) return {};
#ifdef __x86_64__
  const Disassembler code(found->code, found->address);
  const bool is_known = found->is_whole && code.is_plain(found->code.size());
  for (const auto& instruction :
       code.instructions().first(std::min(code.instructions().size(), most_instructions))) {
    // Where not all jumps are known, only the first byte is sure to be passed once.
    if (!is_known && instruction.address > found->address) break;
    if (code.is_emulated(instruction) && !code.is_passed_again(instruction))
      return Place{.offset = found->offset + instruction.address - found->address, .is_cheap = true};
    if (code.ends_entry(instruction)) break;
  }
#endif
  return Place{.offset = found->offset};
}

std::optional<std::uint64_t> Library::offset_of_topic_name() const {
#ifdef __x86_64__
  const auto* const found = find("dds_get_name");
  if (found == nullptr) return {};
  // It ends with strlcpy(name, topic->m_name, size): the load of the second argument from far within a
  // structure.
  const Disassembler code(found->code, found->address);
  for (const auto& instruction : code.instructions()) {
    const auto& x86 = instruction.detail->x86;
    if (instruction.id == X86_INS_MOV && x86.op_count == 2 && x86.operands[0].type == X86_OP_REG &&
        x86.operands[0].reg == X86_REG_RSI && x86.operands[1].type == X86_OP_MEM &&
        x86.operands[1].mem.base != X86_REG_RSP && x86.operands[1].mem.disp >= 64 &&
        x86.operands[1].mem.disp < 4096)
      return static_cast<std::uint64_t>(x86.operands[1].mem.disp);
  }
#endif
  return {};
}

}  // namespace ontime::listen
