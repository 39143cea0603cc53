/* SPDX-License-Identifier: Apache-2.0 OR GPL-2.0-only
 * What the probes in the kernel (probes.bpf.c) tell this program. Plain C, compiled for both. */
#ifndef ONTIME_LISTEN_EVENT_H
#define ONTIME_LISTEN_EVENT_H

#include <linux/types.h>

enum { ontime_longest_topic = 256, ontime_most_samples = 64 };

enum ontime_event_kind {
  ontime_published,
  ontime_taken,
  ontime_named,  /* `topic` is the topic of `endpoint`, its text is at address `stamp_ns` */
  ontime_found   /* `endpoint` is a DDS handle, its entity is at address `stamp_ns` of the process */
};

/* Calls that met a probe, by CPU; the key of a map. */
enum ontime_call { ontime_publish_calls, ontime_take_calls, ontime_calls };

struct ontime_event {
  __u32 kind;
  __u32 lost;     /* events that found the buffer full, until now */
  __u64 at_ns;    /* CLOCK_MONOTONIC: a publish begins, a take has returned */
  __u64 endpoint; /* rmw: address of the publisher or subscription; DDS: its handle */
  __u64 stamp_ns; /* the writer's source time stamp, CLOCK_REALTIME of its machine; 0: unknown */
  __u8 writer[16]; /* which writer, as this reader's middleware names it; zero: unknown */
  __u32 process;
  __u32 thread;
  __u32 cpu;
  __u32 reserved;
};

struct ontime_name_event {
  struct ontime_event event;
  char topic[ontime_longest_topic];
};

#endif
