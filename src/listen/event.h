/* SPDX-License-Identifier: Apache-2.0 OR GPL-2.0-only
 * What the probes in the kernel (probes.bpf.c) tell this program. Plain C, compiled for both. */
#ifndef ONTIME_LISTEN_EVENT_H
#define ONTIME_LISTEN_EVENT_H

#include <linux/types.h>

enum { ontime_longest_topic = 256, ontime_most_samples = 64 };

enum ontime_event_kind {
  ontime_published,
  ontime_taken,
  ontime_named, /* `topic` is the topic of `endpoint` */
  ontime_turned /* the thread waits, or begins a callback that takes no message */
};

/* Calls that met a probe, by CPU; the key of a map. */
enum ontime_call {
  ontime_publish_calls,
  ontime_take_calls,
  ontime_turn_calls,
  ontime_stepped_calls,
  ontime_calls
};

/* Registers, in four bits each: a probe's cookie says which of them hold the arguments of a call. A number is
 * one more than that of the register's 64 bits in pt_regs. */
enum ontime_register {
  ontime_no_register,
#ifdef __aarch64__
  ontime_argument_1,
  ontime_argument_2,
  ontime_argument_3,
  ontime_argument_4
#else
  ontime_r15,
  ontime_r14,
  ontime_r13,
  ontime_r12,
  ontime_rbp,
  ontime_rbx,
  ontime_r11,
  ontime_r10,
  ontime_r9,
  ontime_r8,
  ontime_rax,
  ontime_argument_4, /* rcx */
  ontime_argument_3, /* rdx */
  ontime_argument_2, /* rsi */
  ontime_argument_1  /* rdi */
#endif
};
/* In a cookie: where the registers' numbers are, of the endpoint, of rmw's `bool* taken`, and of where the
 * call writes what is read at its return; whether the kernel steps over an instruction under the call's
 * probes; whether a ROS 2 middleware may have made the call; and the way from an endpoint's object to its
 * topic's name, two offsets of 16 bits: of a pointer in the endpoint (0: the way is unknown), and of a
 * pointer in what that points to (0: that is the name). */
enum {
  ontime_cookie_endpoint = 0,
  ontime_cookie_taken = 4,
  ontime_cookie_info = 8,
  ontime_cookie_is_stepped = 1 << 12,
  ontime_cookie_is_below_rmw = 1 << 13,
  ontime_cookie_topic = 16,
  ontime_cookie_name = 32
};

struct ontime_event {
  __u32 kind;
  __u32 lost;      /* until now: events that found the buffer full, samples beyond ontime_most_samples */
  __u64 at_ns;     /* CLOCK_MONOTONIC: a publish begins, a take has returned */
  __u64 endpoint;  /* rmw, Fast DDS: address of the publisher or subscription; Cyclone DDS: its handle */
  __u64 stamp_ns;  /* the writer's source time stamp, CLOCK_REALTIME of its machine; 0: unknown */
  __u8 writer[16]; /* which writer, as this reader's middleware names it; zero: unknown */
  __u32 process;
  __u32 thread;
  __u16 is_handle;    /* `endpoint` is a DDS handle, which has 32 bits */
  __u16 is_below_rmw; /* of a DDS implementation's own function, which a ROS 2 middleware may have called */
};

struct ontime_name_event {
  struct ontime_event event;
  char topic[ontime_longest_topic];
};

/* SampleInfo of Fast DDS 2, as far as it is read. */
struct ontime_fastdds_info {
  __u16 states[3];
  __s32 counts[5];
  __s32 seconds;               /* the source time stamp … */
  __u32 fraction, nanoseconds; /* … whose second part is there in two units */
  __u8 between[46];            /* when it was received, and two instance handles */
  __u8 is_valid;
  __u8 writer[16] __attribute__((aligned(4)));
};

#endif
