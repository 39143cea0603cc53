// SPDX-License-Identifier: Apache-2.0
#include "transport/cyclonedds/cdr_type.hpp"

#include <algorithm>
#include <cstring>
#include <new>

#include <dds/ddsi/q_protocol.h>
#include <dds/ddsi/q_radmin.h>

#include "message/message.hpp"

namespace ontime::transport::cyclonedds {

struct Type : ddsi_sertype {
  Blocks* blocks;
};

struct Message : ddsi_serdata {
  enum class State : std::uint8_t { local, received, taken };

  Blocks* blocks;
  Origin origin;
  std::uint32_t cdr_bytes;
  State state;

  std::byte* data() noexcept { return reinterpret_cast<std::byte*>(this + 1); }
  const std::byte* data() const noexcept { return reinterpret_cast<const std::byte*>(this + 1); }
};

namespace {

constexpr std::size_t arena_target_bytes = std::size_t{4} << 20;

Blocks& blocks_of(const ddsi_sertype& type) noexcept { return *static_cast<const Type&>(type).blocks; }
Message& as_message(ddsi_serdata* data) noexcept { return *static_cast<Message*>(data); }
const Message& as_message(const ddsi_serdata* data) noexcept { return *static_cast<const Message*>(data); }

Message* new_block(const ddsi_sertype* type, Blocks& blocks, ddsi_serdata_kind kind,
                   std::size_t cdr_bytes) noexcept {
  if (cdr_bytes > blocks.capacity()) return nullptr;
  void* const block = blocks.take();
  if (block == nullptr) return nullptr;
  auto* const message = new (block) Message;
  ddsi_serdata_init(message, type, kind);
  message->hash = type->serdata_basehash;  // without a key there is one instance, and one hash
  message->blocks = &blocks;
  message->cdr_bytes = static_cast<std::uint32_t>(cdr_bytes);
  message->state = Message::State::local;
  return message;
}

// Of the datagram in which it began, whose parts Cyclone has in the host's byte order by now.
Origin origin_of(const nn_rdata& fragment) noexcept {
  Header_t header;
  Data_DataFrag_common_t data;
  std::memcpy(&header, NN_RMSG_PAYLOAD(fragment.rmsg), sizeof header);
  std::memcpy(&data, NN_RMSG_PAYLOADOFF(fragment.rmsg, NN_RDATA_SUBMSG_OFF(&fragment)), sizeof data);
  Origin origin{};
  std::memcpy(origin.writer.data(), &header.guid_prefix, sizeof header.guid_prefix);
  std::memcpy(origin.writer.data() + sizeof header.guid_prefix, &data.writerId, sizeof data.writerId);
  origin.number = (std::int64_t{data.writerSN.high} << 32) | data.writerSN.low;
  return origin;
}

// What Cyclone asks of a message.

std::uint32_t get_size(const ddsi_serdata* data) { return as_message(data).cdr_bytes; }

void free_message(ddsi_serdata* data) {
  Message& message = as_message(data);
  if (message.state == Message::State::received) message.blocks->count_overwritten();
  message.blocks->give(data);
}

ddsi_serdata* from_ser(const ddsi_sertype* type, ddsi_serdata_kind kind, const nn_rdata* fragment,
                       std::size_t size) {
  Message* const message = new_block(type, blocks_of(*type), kind, size);
  if (message == nullptr) return nullptr;
  if (kind == SDK_DATA && fragment != nullptr) {
    message->origin = origin_of(*fragment);
    message->state = Message::State::received;
  }
  std::uint32_t done = 0;
  for (; fragment != nullptr; fragment = fragment->nextfrag) {
    // Cyclone leaves it to us to cut off what reaches beyond the size: the sender can claim anything.
    const auto end = std::min(fragment->maxp1, message->cdr_bytes);
    if (end <= done) continue;
    const auto* const bytes = NN_RMSG_PAYLOADOFF(fragment->rmsg, NN_RDATA_PAYLOAD_OFF(fragment));
    std::memcpy(message->data() + done, bytes + (done - fragment->min), end - done);
    done = end;
  }
  return message;
}

ddsi_serdata* from_ser_iov(const ddsi_sertype* type, ddsi_serdata_kind kind, ddsrt_msg_iovlen_t parts,
                           const ddsrt_iovec_t* part, std::size_t size) {
  Message* const message = new_block(type, blocks_of(*type), kind, size);
  if (message == nullptr) return nullptr;
  std::size_t done = 0;
  for (ddsrt_msg_iovlen_t i = 0; i < parts && done < size; ++i) {
    const std::size_t bytes = std::min(part[i].iov_len, size - done);
    std::memcpy(message->data() + done, part[i].iov_base, bytes);
    done += bytes;
  }
  return message;
}

ddsi_serdata* from_keyhash(const ddsi_sertype* type, const ddsi_keyhash*) {
  return new_block(type, blocks_of(*type), SDK_KEY, 0);
}

ddsi_serdata* to_untyped(const ddsi_serdata* data) {
  Message* const key = new_block(data->type, *as_message(data).blocks, SDK_KEY, 0);
  if (key != nullptr) key->type = nullptr;
  return key;
}

void to_ser(const ddsi_serdata* data, std::size_t offset, std::size_t size, void* to) {
  std::memcpy(to, as_message(data).data() + offset, size);
}

ddsi_serdata* to_ser_ref(const ddsi_serdata* data, std::size_t offset, std::size_t size,
                         ddsrt_iovec_t* part) {
  ddsi_serdata* const reference = ddsi_serdata_ref(data);
  part->iov_base = as_message(reference).data() + offset;
  part->iov_len = size;
  return reference;
}

void to_ser_unref(ddsi_serdata* data, const ddsrt_iovec_t*) { ddsi_serdata_unref(data); }

bool same_key(const ddsi_serdata*, const ddsi_serdata*) { return true; }

void get_keyhash(const ddsi_serdata*, ddsi_keyhash* hash, bool) { *hash = {}; }

std::size_t print(const ddsi_sertype*, const ddsi_serdata*, char* to, std::size_t) {
  to[0] = '\0';
  return 0;
}

// We only write and take CDR, so no sample of a C type ever is made.
ddsi_serdata* from_sample(const ddsi_sertype*, ddsi_serdata_kind, const void*) { return nullptr; }
bool to_sample(const ddsi_serdata*, void*, void**, void*) { return false; }
bool untyped_to_sample(const ddsi_sertype*, const ddsi_serdata*, void*, void**, void*) { return false; }

constexpr ddsi_serdata_ops message_operations = [] {
  ddsi_serdata_ops ops{};
  ops.eqkey = same_key;
  ops.get_size = get_size;
  ops.from_ser = from_ser;
  ops.from_ser_iov = from_ser_iov;
  ops.from_keyhash = from_keyhash;
  ops.from_sample = from_sample;
  ops.to_ser = to_ser;
  ops.to_ser_ref = to_ser_ref;
  ops.to_ser_unref = to_ser_unref;
  ops.to_sample = to_sample;
  ops.to_untyped = to_untyped;
  ops.untyped_to_sample = untyped_to_sample;
  ops.free = free_message;
  ops.print = print;
  ops.get_keyhash = get_keyhash;
  return ops;
}();

// What Cyclone asks of the type.

void free_type(ddsi_sertype* type) {
  ddsi_sertype_fini(type);
  delete static_cast<Type*>(type);
}
// Cyclone takes one of several alike for all of them, and endpoints have blocks of their own.
bool same_type(const ddsi_sertype* one, const ddsi_sertype* other) {
  return &blocks_of(*one) == &blocks_of(*other);
}
std::uint32_t hash_type(const ddsi_sertype*) { return 0; }
void zero_samples(const ddsi_sertype*, void*, std::size_t) {}
void realloc_samples(void**, const ddsi_sertype*, void*, std::size_t, std::size_t) {}
void free_samples(const ddsi_sertype*, void**, std::size_t, dds_free_op_t) {}

constexpr ddsi_sertype_ops type_operations = [] {
  ddsi_sertype_ops ops{};
  ops.version = ddsi_sertype_v0;
  ops.free = free_type;
  ops.zero_samples = zero_samples;
  ops.realloc_samples = realloc_samples;
  ops.free_samples = free_samples;
  ops.equal = same_type;
  ops.hash = hash_type;
  return ops;
}();

}  // namespace

Blocks::Blocks(std::size_t max_cdr_bytes)
    : capacity_((max_cdr_bytes + 7) / 8 * 8),
      block_bytes_((sizeof(Message) + capacity_ + alignof(Message) - 1) / alignof(Message) *
                   alignof(Message)) {
  const std::size_t count = std::clamp(arena_target_bytes / block_bytes_, std::size_t{8}, spare_.size());
  arena_bytes_ = count * block_bytes_;
  arena_ = std::make_unique<std::byte[]>(arena_bytes_);
  for (std::size_t i = 0; i < count; ++i) spare_[i] = arena_.get() + i * block_bytes_;
}

void* Blocks::take() noexcept {
  for (auto& slot : spare_) {
    if (slot.load(std::memory_order_relaxed) == nullptr) continue;
    if (void* const block = slot.exchange(nullptr, std::memory_order_acquire)) return block;
  }
  return ::operator new(block_bytes_, std::nothrow);
}

void Blocks::give(void* block) noexcept {
  const auto* const at = static_cast<std::byte*>(block);
  if (at < arena_.get() || at >= arena_.get() + arena_bytes_) return ::operator delete(block);
  for (auto& slot : spare_) {
    void* empty = nullptr;
    if (slot.compare_exchange_strong(empty, block, std::memory_order_release, std::memory_order_relaxed))
      return;
  }
}

ddsi_sertype* new_type(Blocks& blocks) {
  auto* const type = new Type{};
  ddsi_sertype_init(type, message::type_name, &type_operations, &message_operations, true);
  type->blocks = &blocks;
  return type;
}

ddsi_serdata* new_message(const ddsi_sertype& type, std::uint64_t sequence,
                          std::span<const std::byte> payload) noexcept {
  const std::size_t cdr_bytes = message::cdr_overhead + payload.size();
  Message* const message = new_block(&type, blocks_of(type), SDK_DATA, cdr_bytes);
  if (message != nullptr) message::encode(sequence, payload, {message->data(), cdr_bytes});
  return message;
}

std::span<std::byte> cdr(ddsi_serdata& message) noexcept {
  return {as_message(&message).data(), as_message(&message).cdr_bytes};
}

const Origin* taken(ddsi_serdata& message) noexcept {
  Message& ours = as_message(&message);
  if (ours.state == Message::State::local) return nullptr;
  ours.state = Message::State::taken;
  return &ours.origin;
}

}  // namespace ontime::transport::cyclonedds
