// SPDX-License-Identifier: Apache-2.0 OR GPL-2.0-only
// The probes: they run in the kernel when a thread of a robot's node publishes or takes. They read arguments and
// results, write one event each, and change nothing. The kernel removes them when this program's process ends,
// however it ends.
#include "event.h"

#include <linux/bpf.h>
#include <linux/ptrace.h>

#include <bpf/bpf_helpers.h>
#include <bpf/bpf_tracing.h>

// The kernel lends reading of user memory and clocks only to programs under its own licence.
char LICENSE[] SEC("license") = "GPL";

struct {
  __uint(type, BPF_MAP_TYPE_RINGBUF);
  __uint(max_entries, 8 << 20);
} events SEC(".maps");

__u32 lost = 0;

struct {
  __uint(type, BPF_MAP_TYPE_PERCPU_ARRAY);
  __uint(max_entries, ontime_calls);
  __type(key, __u32);
  __type(value, __u64);
} counts SEC(".maps");

static __always_inline void count_one(__u32 call) {
  __u64* const calls = bpf_map_lookup_elem(&counts, &call);
  if (calls) ++*calls;
}

static __always_inline void count(__u32 call, __u64 cookie) {
  count_one(call);
  if (cookie & ontime_cookie_is_stepped) count_one(ontime_stepped_calls);
}

struct endpoint {
  __u64 address;
  __u64 process;
};

// Names of topics, as numbers by name_object(), of the endpoints that user space knows.
struct {
  __uint(type, BPF_MAP_TYPE_LRU_HASH);
  __uint(max_entries, 16384);
  __type(key, struct endpoint);
  __type(value, __u64);
} named SEC(".maps");

// The arguments of a call, until it returns. A take of rmw calls one of a DDS, which may call a third one.
struct call {
  __u64 endpoint;
  __u64 taken;  // rmw: bool*
  __u64 info;   // rmw_message_info_t*, dds_sample_info_t*, or Fast DDS's
  __u64 cookie;
};
struct {
  __uint(type, BPF_MAP_TYPE_TASK_STORAGE);
  __uint(map_flags, BPF_F_NO_PREALLOC);
  __type(key, int);
  __type(value, struct call);
} rmw_calls SEC(".maps"), dds_calls SEC(".maps");

static __always_inline void fill(struct ontime_event* event, __u32 kind, __u64 endpoint, __u64 cookie) {
  const __u64 who = bpf_get_current_pid_tgid();
  __builtin_memset(event, 0, sizeof *event);
  event->kind = kind;
  event->lost = lost;
  event->at_ns = bpf_ktime_get_ns();
  event->endpoint = endpoint;
  event->is_handle = endpoint >> 32 == 0;
  event->is_below_rmw = (cookie & ontime_cookie_is_below_rmw) != 0;
  event->process = who >> 32;
  event->thread = (__u32)who;
}

static __always_inline struct ontime_event* begin(__u32 kind, __u64 endpoint, __u64 cookie) {
  struct ontime_event* const event = bpf_ringbuf_reserve(&events, sizeof *event, 0);
  if (!event) {
    __sync_fetch_and_add(&lost, 1);
    return 0;
  }
  fill(event, kind, endpoint, cookie);
  return event;
}

// Follows the offsets in the cookie from the endpoint's object. A probe may not wait for memory that is paged
// out: the next message tries again. User space may not read it either, because the process decides when such
// a wait ends (userfaultfd, FUSE).
static __always_inline void name_object(__u64 object, __u64 endpoint, __u64 cookie) {
  const struct endpoint key = {.address = endpoint, .process = bpf_get_current_pid_tgid() >> 32};
  const __u64 in_endpoint = cookie >> ontime_cookie_topic & 0xffff;
  const __u64 in_topic = cookie >> ontime_cookie_name & 0xffff;
  __u64 topic = 0;
  if (!in_endpoint || bpf_probe_read_user(&topic, sizeof topic, (void*)(object + in_endpoint)) != 0) return;
  if (in_topic && bpf_probe_read_user(&topic, sizeof topic, (void*)(topic + in_topic)) != 0) return;
  // Another endpoint may get the same memory, and its topic's name too.
  __u64 begin[8] = {}, number = topic;
  if (bpf_probe_read_user_str(begin, sizeof begin, (void*)topic) <= 0) return;
#pragma unroll
  for (int i = 0; i < 8; ++i) number = number * 0x9e3779b97f4a7c15 + begin[i];
  const __u64* const known = bpf_map_lookup_elem(&named, &key);
  if (known && *known == number) return;
  struct ontime_name_event* const event = bpf_ringbuf_reserve(&events, sizeof *event, 0);
  if (!event) return;  // the next message tries again
  fill(&event->event, ontime_named, endpoint, cookie);
  if (bpf_probe_read_user_str(event->topic, sizeof event->topic, (void*)topic) <= 0) {
    bpf_ringbuf_discard(event, BPF_RB_NO_WAKEUP);
    return;
  }
  bpf_map_update_elem(&named, &key, &number, BPF_ANY);
  bpf_ringbuf_submit(event, BPF_RB_NO_WAKEUP);
}

static __always_inline void name(__u64 endpoint, __u64 cookie) { name_object(endpoint, endpoint, cookie); }

// The value of a register that the cookie names.
static __always_inline __u64 value(const struct pt_regs* regs, __u64 cookie, __u32 shift) {
  const __u64 which = cookie >> shift & 15;
  __u64 value = 0;
  if (which != ontime_no_register) bpf_probe_read_kernel(&value, sizeof value, (const __u64*)regs + which - 1);
  return value;
}

static __always_inline int published(__u64 endpoint, __u64 cookie) {
  count(ontime_publish_calls, cookie);
  struct ontime_event* const event = begin(ontime_published, endpoint, cookie);
  if (event) bpf_ringbuf_submit(event, BPF_RB_NO_WAKEUP);
  return 0;
}

// Notes the arguments of a call, in the registers that the probe's cookie names. A DDS handle has 32 bits.
static __always_inline int enter(void* under_way, struct pt_regs* regs, __u64 cookie, __u64 endpoint_bits) {
  struct call* const call =
      bpf_task_storage_get(under_way, bpf_get_current_task_btf(), 0, BPF_LOCAL_STORAGE_GET_F_CREATE);
  if (!call) return 0;
  call->endpoint = value(regs, cookie, ontime_cookie_endpoint) & endpoint_bits;
  call->taken = value(regs, cookie, ontime_cookie_taken);
  call->info = value(regs, cookie, ontime_cookie_info);
  call->cookie = cookie;
  return 0;
}

static __always_inline int take(void* under_way, struct pt_regs* regs, __u64 endpoint_bits) {
  const __u64 cookie = bpf_get_attach_cookie(regs);
  count(ontime_take_calls, cookie);
  return enter(under_way, regs, cookie, endpoint_bits);
}

static const __u64 pointer = ~0ULL, handle = 0xffffffff;

static __always_inline int leave(void* under_way, struct call* call) {
  struct call* const found = bpf_task_storage_get(under_way, bpf_get_current_task_btf(), 0, 0);
  if (!found || !found->endpoint) return 0;  // entered before the probe was set
  *call = *found;
  found->endpoint = 0;
  return 1;
}

// For rmw and Fast DDS.
SEC("uprobe")
int publish(struct pt_regs* regs) {
  const __u64 cookie = bpf_get_attach_cookie(regs), endpoint = value(regs, cookie, ontime_cookie_endpoint);
  name(endpoint, cookie);
  return published(endpoint, cookie);
}

SEC("uprobe")
int rmw_take(struct pt_regs* regs) { return take(&rmw_calls, regs, pointer); }

SEC("uretprobe")
int rmw_taken(struct pt_regs* regs) {
  struct call call;
  __u8 taken = 0;
  if (!leave(&rmw_calls, &call) || PT_REGS_RC(regs) != 0) return 0;
  if (bpf_probe_read_user(&taken, sizeof taken, (void*)call.taken) != 0 || taken != 1) return 0;
  name(call.endpoint, call.cookie);
  struct ontime_event* const event = begin(ontime_taken, call.endpoint, call.cookie);
  if (!event) return 0;
  if (call.info) {  // source_timestamp, received_timestamp, two sequence numbers, the gid's identifier and bytes
    bpf_probe_read_user(&event->stamp_ns, sizeof event->stamp_ns, (void*)call.info);
    bpf_probe_read_user(event->writer, sizeof event->writer, (void*)(call.info + 40));
  }
  bpf_ringbuf_submit(event, BPF_RB_NO_WAKEUP);
  return 0;
}

// A thread waits for messages, or begins a timer's or a service's callback: the callback of its last take ended.
SEC("uprobe")
int turn(struct pt_regs* regs) {
  count(ontime_turn_calls, bpf_get_attach_cookie(regs));
  struct ontime_event* const event = begin(ontime_turned, 0, 0);
  if (event) bpf_ringbuf_submit(event, BPF_RB_NO_WAKEUP);
  return 0;
}

SEC("uprobe")
int dds_write(struct pt_regs* regs) {
  const __u64 cookie = bpf_get_attach_cookie(regs);
  return published(value(regs, cookie, ontime_cookie_endpoint) & handle, cookie);
}

SEC("uprobe")
int dds_take(struct pt_regs* regs) { return take(&dds_calls, regs, handle); }

// dds_sample_info_t, the same since 0.1: it has 64 bytes.
struct sample_info {
  __u32 states[3];
  __u8 valid;
  __u64 stamp_ns;
  __u64 instance;
  __u64 writer;
  __u32 counts[5];
};

// Samples beyond the bound of this loop are not seen; they count as lost events.
static __always_inline void leave_out(int samples) {
  if (samples > ontime_most_samples) __sync_fetch_and_add(&lost, samples - ontime_most_samples);
}

SEC("uretprobe")
int dds_taken(struct pt_regs* regs) {
  struct call call;
  const int count = (int)PT_REGS_RC(regs);
  if (!leave(&dds_calls, &call)) return 0;
  for (int i = 0; i < ontime_most_samples; ++i) {
    struct sample_info info;
    if (i >= count) break;
    if (bpf_probe_read_user(&info, sizeof info, (void*)(call.info + sizeof info * i)) != 0) break;
    if (info.valid != 1) continue;
    struct ontime_event* const event = begin(ontime_taken, call.endpoint, call.cookie);
    if (!event) continue;
    event->stamp_ns = info.stamp_ns;
    __builtin_memcpy(event->writer, &info.writer, sizeof info.writer);
    bpf_ringbuf_submit(event, BPF_RB_NO_WAKEUP);
  }
  leave_out(count);
  return 0;
}

// Cyclone DDS releases an entity, which begins with its handle: so its address is known. An entity other than
// a writer or reader may get a meaningless name, but no message has its handle.
SEC("uprobe")
int dds_entity_left(struct pt_regs* regs) {
  const __u64 cookie = bpf_get_attach_cookie(regs), entity = value(regs, cookie, ontime_cookie_endpoint);
  __u32 id = 0;
  count(ontime_turn_calls, cookie);
  if (bpf_probe_read_user(&id, sizeof id, (const void*)entity) == 0) name_object(entity, id, cookie);
  return 0;
}

SEC("uprobe")
int fastdds_take(struct pt_regs* regs) { return take(&dds_calls, regs, pointer); }

static __always_inline void fastdds_taken_one(const struct call* call, const void* at) {
  struct ontime_fastdds_info info;
  if (bpf_probe_read_user(&info, sizeof info, at) != 0) return;
  // Both units agree: the structure is the expected one. Otherwise the message has no stamp.
  const __u32 difference = info.nanoseconds - (__u32)((__u64)info.fraction * 1000000000 >> 32) + 2;
  const int is_known = info.seconds > 0 && info.nanoseconds < 1000000000 && difference <= 4;
  if (is_known && info.is_valid != 1) return;
  struct ontime_event* const event = begin(ontime_taken, call->endpoint, call->cookie);
  if (!event) return;
  if (is_known) {
    event->stamp_ns = (__u64)info.seconds * 1000000000 + info.nanoseconds;
    __builtin_memcpy(event->writer, info.writer, sizeof info.writer);
  }
  bpf_ringbuf_submit(event, BPF_RB_NO_WAKEUP);
}

SEC("uretprobe")
int fastdds_taken_next(struct pt_regs* regs) {
  struct call call;
  if (!leave(&dds_calls, &call) || (__u32)PT_REGS_RC(regs) != 0) return 0;
  name(call.endpoint, call.cookie);
  fastdds_taken_one(&call, (const void*)call.info);
  return 0;
}

// LoanableCollection, the same in all versions 2, as far as it is read.
struct infos {
  __u64 table;
  __s32 most, count;
  __u64 each;  // pointers
};

SEC("uretprobe")
int fastdds_taken(struct pt_regs* regs) {
  struct call call;
  struct infos infos;
  if (!leave(&dds_calls, &call) || (__u32)PT_REGS_RC(regs) != 0) return 0;
  if (bpf_probe_read_user(&infos, sizeof infos, (const void*)call.info) != 0) return 0;
  name(call.endpoint, call.cookie);
  for (int i = 0; i < ontime_most_samples; ++i) {
    const void* info = 0;
    if (i >= infos.count) break;
    if (bpf_probe_read_user(&info, sizeof info, (const void*)(infos.each + sizeof info * i)) != 0) break;
    fastdds_taken_one(&call, info);
  }
  leave_out(infos.count);
  return 0;
}
