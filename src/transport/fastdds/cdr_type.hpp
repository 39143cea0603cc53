// SPDX-License-Identifier: Apache-2.0
// The round trip's message as a type of Fast DDS: it copies CDR bytes, and allocates nothing for a message.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>

#include <fastdds/dds/topic/TopicDataType.hpp>

namespace ontime::transport::fastdds {

// The sample that is written …
struct Outgoing {
  std::uint64_t sequence;
  std::span<const std::byte> payload;
};
// … and the one that is taken: into room made beforehand.
struct Incoming {
  std::span<std::byte> room;
  std::span<std::byte> cdr{};  // what of it was used
};

class CdrType final : public eprosima::fastdds::dds::TopicDataType {
 public:
  explicit CdrType(std::size_t max_cdr_bytes);

  bool serialize(void* outgoing, eprosima::fastrtps::rtps::SerializedPayload_t* to) override;
  bool deserialize(eprosima::fastrtps::rtps::SerializedPayload_t* from, void* incoming) override;
  std::function<std::uint32_t()> getSerializedSizeProvider(void* outgoing) override;
  // Samples are ours, never Fast DDS's, and have no key.
  void* createData() override { return nullptr; }
  void deleteData(void*) override {}
  bool getKey(void*, eprosima::fastrtps::rtps::InstanceHandle_t*, bool) override { return false; }
};

}  // namespace ontime::transport::fastdds
