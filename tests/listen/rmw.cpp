// SPDX-License-Identifier: Apache-2.0
// Stands in for a ROS 2 middleware where there is no ROS 2: the functions that `ontime listen` probes, by the
// layout that all distributions share. Messages go through a pipe; of each tenth, a duplicate follows.
#include "rmw.hpp"

#include <array>
#include <atomic>
#include <cstring>

#include <time.h>
#include <unistd.h>

#include "fastrtps.hpp"

namespace {

int pipe_ends[2];
eprosima::fastdds::dds::DataWriterImpl writer;
eprosima::fastdds::dds::DataReaderImpl reader;

struct Sent {
  std::int64_t stamp_ns;
  std::uint64_t number;
};

}  // namespace

extern "C" int dds_take(int, void**, void*, unsigned long, unsigned);

extern "C" void rmw_fake_init() {
  if (pipe(pipe_ends) != 0) _exit(3);
}

extern "C" int rmw_publish(const rmw_publisher* publisher, const void* message, void*) {
  timespec time{};
  writer.write(nullptr);
  clock_gettime(CLOCK_REALTIME, &time);
  Sent sent{std::int64_t{time.tv_sec} * 1'000'000'000 + time.tv_nsec, 0};
  std::memcpy(&sent.number, message, sizeof sent.number);
  const int copies = publisher->data != nullptr && sent.number % 10 == 9 ? 2 : 1;
  for (int i = 0; i < copies; ++i)
    if (write(pipe_ends[1], &sent, sizeof sent) != sizeof sent) return 1;
  return 0;
}

extern "C" int rmw_take_with_info(const rmw_subscription*, void* message, bool* taken, rmw_message_info* info,
                                  void*) {
  Sent sent{};
  std::array<std::uint64_t, 8> dds_info{};
  dds_take(1, nullptr, dds_info.data(), 1, 1);
  eprosima::fastdds::dds::SampleInfo fastdds_info{};
  reader.take_next_sample(nullptr, &fastdds_info);
  *taken =
      read(pipe_ends[0], &sent, sizeof sent) == sizeof sent && sent.number % 100 != 50;  // one is never taken
  if (!*taken) return 0;
  std::memcpy(message, &sent.number, sizeof sent.number);
  info->source_timestamp = sent.stamp_ns;
  std::memset(info->publisher_gid.data, 7, sizeof info->publisher_gid.data);
  return 0;
}
