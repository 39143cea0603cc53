// SPDX-License-Identifier: Apache-2.0
// Any bytes as a file of a bag, SQLite or MCAP: refused in words, or judged.
#include "bag/bag.hpp"

#include <cstddef>
#include <cstdint>
#include <cstdlib>

#include "folder.hpp"

namespace listen = ontime::listen;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const ontime::fuzz::Folder folder;
  const auto file = folder.file("bag", data, size);
  try {
    const auto bag = ontime::bag::open(
        file, {.deadline = std::chrono::milliseconds(1), .period = {}, .age = std::chrono::milliseconds(1)});
    bag->keep_rows([](const listen::Row& row) {
      if (row.to_ns != 0 && row.quantity == listen::Row::Quantity::period && row.to_ns < row.from_ns)
        std::abort();
    });
    while (bag->listen_for({})) static_cast<void>(bag->take_misses());
    for (const auto& flow : bag->findings().flows)
      if (flow.period.count() > flow.messages || flow.late > flow.messages) std::abort();
  } catch (const listen::Error&) {
  }
  return 0;
}
