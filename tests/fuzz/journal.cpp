// SPDX-License-Identifier: Apache-2.0
// A journal may hold anything: what is understood of it can be written again and is the same.
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "journal/format.hpp"

namespace journal = ontime::journal;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto contents = journal::parse({reinterpret_cast<const char*>(data), size});
  journal::in_quotes({reinterpret_cast<const char*>(data), size});
  if (!contents.not_understood.empty()) return 0;
  std::string again = journal::line_of(contents.header);
  for (const auto& entry : contents.entries) again += journal::line_of(entry);
  const auto same = journal::parse(again);
  if (!same.not_understood.empty() || !(same.header == contents.header)) std::abort();
  if (same.entries.size() != contents.entries.size()) std::abort();
  return 0;
}
