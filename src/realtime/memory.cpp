// SPDX-License-Identifier: Apache-2.0
#include <cerrno>
#include <cstdlib>

#include <fmt/format.h>
#include <linux/capability.h>
#include <malloc.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <unistd.h>

#include "realtime/privileges.hpp"
#include "realtime/realtime.hpp"

namespace ontime::realtime {
namespace {

Refusal refused(std::string found, std::string remedy) {
  return {"locked memory (mlockall)", std::move(found), std::move(remedy)};
}

std::optional<Refusal> lock_all() {
  if (!may_lock_all())
    return refused(fmt::format("RLIMIT_MEMLOCK is {} bytes, {}", limit_of(RLIMIT_MEMLOCK),
                               privileges().lack_of("CAP_IPC_LOCK")),
                   how_to_permit());
  if (mlockall(MCL_CURRENT | MCL_FUTURE) == 0) return {};
  return refused(message_of(errno), "free memory: all pages of this process must fit at once");
}

// Freed memory stays in the heap and comes from nowhere else. M_ARENA_MAX is left alone: with one arena for
// all, a real-time thread would wait for whichever ordinary thread holds its lock. A locked arena faults in
// as it grows.
void keep_heap() {
  mallopt(M_TRIM_THRESHOLD, -1);  // NOLINT(concurrency-mt-unsafe): takes the heap's lock itself
  mallopt(M_MMAP_MAX, 0);         // NOLINT(concurrency-mt-unsafe)
}

bool touch_heap(std::size_t bytes) {
  auto* const heap = static_cast<volatile char*>(std::malloc(bytes));
  if (heap == nullptr) return bytes == 0;
  const auto page_bytes = static_cast<std::size_t>(sysconf(_SC_PAGESIZE));
  for (std::size_t at = 0; at < bytes; at += page_bytes) heap[at] = 0;
  if (bytes > 0) heap[bytes - 1] = 0;
  std::free(const_cast<char*>(heap));
  return true;
}

}  // namespace

// Under a finite limit, MCL_FUTURE would make a later allocation fail, in any library.
bool may_lock_all() {
  rlimit limit{};
  if (privileges().has(CAP_IPC_LOCK)) return true;
  if (getrlimit(RLIMIT_MEMLOCK, &limit) != 0) return false;
  limit.rlim_cur = limit.rlim_max;
  return limit.rlim_max == RLIM_INFINITY && setrlimit(RLIMIT_MEMLOCK, &limit) == 0;
}

std::vector<Refusal> lock_memory(std::size_t heap_bytes) {
  std::vector<Refusal> refusals;
  keep_heap();
  if (auto refusal = lock_all()) refusals.push_back(std::move(*refusal));
  if (!touch_heap(heap_bytes))
    refusals.push_back({fmt::format("{} bytes of heap", heap_bytes), message_of(ENOMEM), "request less"});
  return refusals;
}

}  // namespace ontime::realtime
