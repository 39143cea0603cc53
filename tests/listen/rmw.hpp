// SPDX-License-Identifier: Apache-2.0
// The part of ROS 2's rmw (Humble) that the stand-in has.
#pragma once

#include <cstdint>

struct rmw_publisher {
  const char* implementation_identifier;
  void* data;  // here: not null: with duplicates
  const char* topic_name;
};
using rmw_subscription = rmw_publisher;

struct rmw_message_info {
  std::int64_t source_timestamp, received_timestamp;
  std::uint64_t publication_sequence_number, reception_sequence_number;
  struct {
    const char* implementation_identifier;
    std::uint8_t data[24];
  } publisher_gid;
  bool from_intra_process;
};

extern "C" {
void rmw_fake_init();
int rmw_publish(const rmw_publisher*, const void* message, void* allocation);
int rmw_take_with_info(const rmw_subscription*, void* message, bool* taken, rmw_message_info*,
                       void* allocation);
}
