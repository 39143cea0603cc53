// SPDX-License-Identifier: Apache-2.0
#include "journal/kinds.hpp"

#include <algorithm>

#include <net/if.h>

namespace ontime::journal {

const Kind* find_kind(std::string_view name, std::span<const Kind> more) {
  for (const auto* kind : {&namespace_kind, &directory_kind})
    if (name == kind->name) return kind;
  const auto found = std::ranges::find(more, name, &Kind::name);
  return found == more.end() ? nullptr : &*found;
}

bool is_plain_name(std::string_view name) {
  const auto plain = [](char c) { return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '-'; };
  return !name.empty() && name.size() <= 200 && name[0] != '-' &&
         std::all_of(name.begin(), name.end(), plain);
}

bool is_own_name(std::string_view name) {
  const std::string_view prefix = own_prefix;
  return is_plain_name(name) && name.starts_with(prefix) && name.size() > prefix.size();
}

bool is_interface_name(std::string_view name) {
  constexpr std::string_view plain = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-.@";
  return !name.empty() && name.size() < IFNAMSIZ && name != "." && name != ".." &&
         name.find_first_not_of(plain) == name.npos;
}

}  // namespace ontime::journal
