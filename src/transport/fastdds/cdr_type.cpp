// SPDX-License-Identifier: Apache-2.0
#include "transport/fastdds/cdr_type.hpp"

#include <cstring>

#include "message/message.hpp"

namespace ontime::transport::fastdds {

using eprosima::fastrtps::rtps::SerializedPayload_t;

CdrType::CdrType(std::size_t max_cdr_bytes) {
  setName(message::type_name);
  m_typeSize = static_cast<std::uint32_t>(max_cdr_bytes);
  // Like rclcpp's, it is matched by its name alone.
  auto_fill_type_object(false);
  auto_fill_type_information(false);
}

bool CdrType::serialize(void* outgoing, SerializedPayload_t* to) {
  const auto& sample = *static_cast<const Outgoing*>(outgoing);
  const std::size_t bytes = message::cdr_overhead + sample.payload.size();
  if (bytes > to->max_size) return false;
  message::encode(sample.sequence, sample.payload, {reinterpret_cast<std::byte*>(to->data), bytes});
  to->length = static_cast<std::uint32_t>(bytes);
  to->encapsulation = CDR_LE;
  return true;
}

bool CdrType::deserialize(SerializedPayload_t* from, void* incoming) {
  auto& sample = *static_cast<Incoming*>(incoming);
  if (from->length > sample.room.size()) return false;
  std::memcpy(sample.room.data(), from->data, from->length);
  sample.cdr = sample.room.first(from->length);
  return true;
}

std::function<std::uint32_t()> CdrType::getSerializedSizeProvider(void* outgoing) {
  return [sample = static_cast<const Outgoing*>(outgoing)] {
    return static_cast<std::uint32_t>(message::cdr_overhead + sample->payload.size());
  };
}

}  // namespace ontime::transport::fastdds
