// SPDX-License-Identifier: Apache-2.0
// What comes from a network is a message or it is not; one that is, is the same again once it is encoded.
#include "message/message.hpp"

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <vector>

namespace message = ontime::message;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto* const begin = reinterpret_cast<const std::byte*>(data);
  std::vector<std::byte> cdr(begin, begin + size);
  const auto view = message::decode(cdr);
  if (!view) return 0;
  std::vector<std::byte> again(message::cdr_overhead + view->payload.size());
  if (message::encode(view->sequence, view->payload, again) != again.size()) std::abort();
  const auto same = message::decode(again);
  if (!same || same->sequence != view->sequence || !std::ranges::equal(same->payload, view->payload))
    std::abort();

  const auto times = message::server_times(view->payload);
  if (times.has_value() && view->payload.size() < message::server_times_bytes) std::abort();
  message::put_server_times(same->payload, times.value_or(message::ServerTimes{0, 0}));
  const auto times_again = message::server_times(same->payload);
  if (times_again.has_value() != times.has_value()) std::abort();
  if (times && (times_again->received_ns != times->received_ns || times_again->sent_ns != times->sent_ns))
    std::abort();
  return 0;
}
