// SPDX-License-Identifier: Apache-2.0
// Functions of Fast DDS that a ROS 2 middleware calls, and that are probed in other programs.
#pragma once

namespace eprosima::fastdds::dds {

struct SampleInfo {
  unsigned char bytes[128];
};

class DataWriterImpl {
 public:
  bool write(void*);
};

class DataReaderImpl {
 public:
  int take_next_sample(void*, SampleInfo*);
};

}  // namespace eprosima::fastdds::dds
