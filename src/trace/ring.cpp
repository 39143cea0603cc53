// SPDX-License-Identifier: Apache-2.0
#include "trace/ring.hpp"

#include <algorithm>
#include <limits>

extern "C" {
#include <kbuffer.h>
}

namespace ontime::trace {
namespace {

std::int64_t signed_of(unsigned long long time) { return static_cast<std::int64_t>(time); }

}  // namespace

Ring::Ring(std::size_t cpus, std::size_t most_bytes)
    : most_bytes_(most_bytes),
      cpus_(cpus),
      page_(kbuffer_alloc(KBUFFER_LSIZE_SAME_AS_HOST, KBUFFER_ENDIAN_SAME_AS_HOST), kbuffer_free) {}

void Ring::add(std::int32_t cpu, std::span<const std::byte> from) {
  Page page{0, 0, false, {from.begin(), from.end()}};
  if (kbuffer_load_subbuffer(page_.get(), page.bytes.data()) != 0) return;
  page.lost_before = kbuffer_missed_events(page_.get()) != 0;
  unsigned long long at = 0;
  void* event = kbuffer_read_event(page_.get(), &at);
  page.begin_ns = page.end_ns = signed_of(at);
  for (; event != nullptr; event = kbuffer_next_event(page_.get(), &at)) page.end_ns = signed_of(at);
  auto& pages = cpus_[static_cast<std::size_t>(cpu)].pages;
  bytes_ += page.bytes.size();
  pages.push_back(std::move(page));
  while (bytes_ > most_bytes_) give_up_oldest();
}

void Ring::give_up_oldest() {
  auto& oldest = *std::ranges::min_element(cpus_, {}, [](const Cpu& cpu) {
    return cpu.pages.empty() ? std::numeric_limits<std::int64_t>::max() : cpu.pages.front().begin_ns;
  });
  oldest.gone_ns = oldest.pages.front().end_ns;
  bytes_ -= oldest.pages.front().bytes.size();
  oldest.pages.pop_front();
}

std::vector<RawEvent> Ring::between(std::int64_t from_ns, std::int64_t to_ns) {
  std::vector<RawEvent> events;
  for (std::size_t cpu = 0; cpu < cpus_.size(); ++cpu)
    for (auto& page : cpus_[cpu].pages) {
      if (page.end_ns < from_ns || page.begin_ns > to_ns) continue;
      if (kbuffer_load_subbuffer(page_.get(), page.bytes.data()) != 0) continue;
      unsigned long long at = 0;
      for (void* event = kbuffer_read_event(page_.get(), &at); event != nullptr;
           event = kbuffer_next_event(page_.get(), &at))
        if (signed_of(at) >= from_ns && signed_of(at) <= to_ns)
          events.push_back(
              {signed_of(at),
               static_cast<std::int32_t>(cpu),
               {static_cast<std::byte*>(event), static_cast<std::size_t>(kbuffer_event_size(page_.get()))}});
    }
  std::ranges::stable_sort(events, {}, &RawEvent::at_ns);
  return events;
}

bool Ring::has_all(std::int64_t from_ns, std::int64_t to_ns) const {
  return std::all_of(cpus_.begin(), cpus_.end(), [&](const Cpu& cpu) {
    if (cpu.gone_ns >= from_ns) return false;
    auto before_ns = std::numeric_limits<std::int64_t>::min();
    for (const auto& page : cpu.pages) {  // what was lost before a page was after the page before it
      if (page.lost_before && page.begin_ns >= from_ns && before_ns <= to_ns) return false;
      before_ns = page.end_ns;
    }
    return true;
  });
}

}  // namespace ontime::trace
