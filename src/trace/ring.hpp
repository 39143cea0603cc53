// SPDX-License-Identifier: Apache-2.0
// The last seconds of what the kernel recorded, as it recorded them: pages of its ring, CPU by CPU. One
// thread at a time.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <memory>
#include <span>
#include <vector>

struct kbuffer;

namespace ontime::trace {

// Of a CPU: when, and its bytes as the kernel's `format` describes them.
struct RawEvent {
  std::int64_t at_ns;
  std::int32_t cpu;
  std::span<std::byte> bytes;  // as long as the ring is not changed
};

class Ring {
 public:
  Ring(std::size_t cpus, std::size_t most_bytes);

  // A page as `trace_pipe_raw` gives it. The oldest of all make room for it.
  void add(std::int32_t cpu, std::span<const std::byte> page);
  // In order of time.
  std::vector<RawEvent> between(std::int64_t from_ns, std::int64_t to_ns);
  // Whether nothing of that time was lost, in the kernel or here.
  bool has_all(std::int64_t from_ns, std::int64_t to_ns) const;

 private:
  struct Page {
    std::int64_t begin_ns, end_ns;  // of its first and last event
    bool lost_before;
    std::vector<std::byte> bytes;
  };
  struct Cpu {
    std::deque<Page> pages;
    std::int64_t gone_ns = 0;  // until then pages have been given up
  };
  void give_up_oldest();

  const std::size_t most_bytes_;
  std::vector<Cpu> cpus_;
  std::size_t bytes_ = 0;
  std::unique_ptr<kbuffer, void (*)(kbuffer*)> page_;  // the one that is looked at
};

}  // namespace ontime::trace
