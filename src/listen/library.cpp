// SPDX-License-Identifier: Apache-2.0
#include "listen/library.hpp"

#include <algorithm>
#include <cerrno>
#include <memory>
#include <system_error>

#include <fcntl.h>
#include <fmt/format.h>
#include <gelf.h>
#include <unistd.h>

#include "listen/listen.hpp"
#include "process/process.hpp"

namespace ontime::listen {
namespace {

// A process may map any file under the name of a middleware.
constexpr std::size_t most_code_bytes = 64 << 10, most_symbols = 1 << 20;
constexpr std::uint64_t most_section_bytes = 64 << 20;
constexpr std::size_t longest_instruction = 15;

// Offset in the file of an address in memory; empty: no segment has it.
std::optional<std::uint64_t> file_offset(Elf* elf, std::uint64_t address) {
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

std::vector<std::uint8_t> bytes_at(int fd, std::uint64_t offset, std::size_t size) {
  std::vector<std::uint8_t> bytes(size);
  const auto read = pread(fd, bytes.data(), size, static_cast<off_t>(offset));
  bytes.resize(read < 0 ? 0 : static_cast<std::size_t>(read));
  return bytes;
}

#ifdef __x86_64__
constexpr GElf_Half machine = EM_X86_64;
#else
constexpr GElf_Half machine = EM_AARCH64;
#endif

}  // namespace

Library::Library(const std::string& path, const Names& functions) {
  const process::Fd file(open(path.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC));
  if (file.get() < 0) throw Error(fmt::format("cannot be read: {}", std::generic_category().message(errno)));
  elf_version(EV_CURRENT);
  const std::unique_ptr<Elf, int (*)(Elf*)> elf(elf_begin(file.get(), ELF_C_READ, nullptr), elf_end);
  GElf_Ehdr header;
  if (!elf || gelf_getehdr(elf.get(), &header) == nullptr || header.e_machine != machine)
    throw Error("not a library of this machine's architecture");
  for (Elf_Scn* section = nullptr; (section = elf_nextscn(elf.get(), section)) != nullptr;) {
    GElf_Shdr shape;
    if (gelf_getshdr(section, &shape) == nullptr || shape.sh_type != SHT_DYNSYM || shape.sh_entsize == 0 ||
        shape.sh_size > most_section_bytes)
      continue;
    GElf_Shdr names;
    if (gelf_getshdr(elf_getscn(elf.get(), shape.sh_link), &names) == nullptr ||
        names.sh_size > most_section_bytes)
      continue;
    Elf_Data* const data = elf_getdata(section, nullptr);
    const auto count = std::min<std::uint64_t>(shape.sh_size / shape.sh_entsize, most_symbols);
    for (std::size_t i = 0; data != nullptr && i < count; ++i) {
      GElf_Sym symbol;
      if (gelf_getsym(data, static_cast<int>(i), &symbol) == nullptr) break;
      if (GELF_ST_TYPE(symbol.st_info) != STT_FUNC || symbol.st_shndx == SHN_UNDEF) continue;
      const char* const name = elf_strptr(elf.get(), shape.sh_link, symbol.st_name);
      if (name == nullptr || !functions.contains(name) || functions_.contains(name)) continue;
      const auto offset = file_offset(elf.get(), symbol.st_value);
      if (!offset) continue;
      auto& function = functions_[name];
      function.address = symbol.st_value;
      function.offset = *offset;
      function.bytes = bytes_at(file.get(), *offset, std::min<std::size_t>(symbol.st_size, most_code_bytes));
      function.is_whole = function.bytes.size() == symbol.st_size;
      if (const auto callee = exit_of(function.code()).callee)
        if (const auto at = file_offset(elf.get(), *callee))
          if (begins_cheaply({bytes_at(file.get(), *at, longest_instruction), *callee, false}))
            function.cheap_callee = *at;
    }
    break;  // a library has one such table
  }
}

const Library::Function* Library::find(const std::string& function) const {
  const auto found = functions_.find(function);
  return found == functions_.end() ? nullptr : &found->second;
}

std::optional<Place> Library::entry(const std::string& function,
                                    std::span<const std::size_t> arguments) const {
  const auto* const found = find(function);
  if (found == nullptr) return {};
  const auto entry = entry_of(found->code(), arguments);
  return Place{found->offset + entry.offset, entry.is_cheap, entry.registers};
}

std::optional<Place> Library::exit(const std::string& function) const {
  const auto* const found = find(function);
  if (found == nullptr) return {};
  if (found->cheap_callee != 0) return Place{found->cheap_callee, true, {}};
  const auto exit = exit_of(found->code());
  return Place{found->offset + exit.offset, exit.is_cheap, {}};
}

Code Library::code(const std::string& function) const {
  const auto* const found = find(function);
  return found == nullptr ? Code{} : found->code();
}

}  // namespace ontime::listen
