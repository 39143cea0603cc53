// SPDX-License-Identifier: Apache-2.0
// The round trip's message as a type of Cyclone DDS: its CDR bytes and nothing else, in blocks made
// beforehand, so that Cyclone neither interprets the type nor allocates for a message.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

#include <dds/ddsi/ddsi_serdata.h>
#include <dds/ddsi/ddsi_sertype.h>

#include "transport/dds.hpp"

namespace ontime::transport::cyclonedds {

struct Message;

// Blocks for messages of up to so many bytes. Any thread, without locks. Messages beyond those made
// beforehand (Cyclone may hold many in a history) come from the heap. Must outlive the domain.
class Blocks {
 public:
  explicit Blocks(std::size_t max_cdr_bytes);

  void* take() noexcept;  // null if there is no memory
  void give(void* block) noexcept;
  std::size_t capacity() const noexcept { return capacity_; }
  // Received ones that were freed before they were taken.
  std::uint64_t overwritten() const noexcept { return overwritten_.load(std::memory_order_relaxed); }
  void count_overwritten() noexcept { overwritten_.fetch_add(1, std::memory_order_relaxed); }

 private:
  std::size_t capacity_;     // of CDR bytes
  std::size_t block_bytes_;  // with what stands before them
  std::size_t arena_bytes_;
  std::unique_ptr<std::byte[]> arena_;
  std::array<std::atomic<void*>, 64> spare_{};
  std::atomic<std::uint64_t> overwritten_{0};
};

// To be handed to dds_create_topic_sertype.
ddsi_sertype* new_type(Blocks& blocks);

// To be handed to dds_writecdr; null if it does not fit or there is no memory.
ddsi_serdata* new_message(const ddsi_sertype& type, std::uint64_t sequence,
                          std::span<const std::byte> payload) noexcept;

std::span<std::byte> cdr(ddsi_serdata& message) noexcept;

// Whose message it is and its number with that writer; it is then one that was taken. Null for what did not
// come by the network.
struct Origin {
  dds::Gaps::Writer writer;
  std::int64_t number;
};
const Origin* taken(ddsi_serdata& message) noexcept;

}  // namespace ontime::transport::cyclonedds
