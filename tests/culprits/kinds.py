# SPDX-License-Identifier: Apache-2.0
"""What is made, and what `ontime explain` is to name."""
import dataclasses

import makers


@dataclasses.dataclass
class Kind:
    name: str
    make: object            # a context manager, which is given (end, chance): what is done in the midst of the run
    cause: str              # the word of `ontime explain --format json`; "": nothing is to be accused
    culprit: str = ""       # what its name has in it
    stages: tuple = ()      # (): any
    keys: str = ""          # of the scenario
    fault: str = ""         # of the end's own receiving thread: "WORD EVERY"
    named_at: str = ""      # where it is to be named, if it is not there
    also: str = ""          # a second cause, which is to be named second, or first
    via: str = ""           # whom the thread waited for
    lacks: object = lambda: ""  # why it cannot be made here
    over: str = ""          # the one transport that it is made over
    for_s: float = 1.0      # it is made


CPU_STAGES = ("woke", "sent", "left", "delivered", "answered")
OURS_FIFO = "realtime: on"
THREADED = "kernel: {gro: on, threaded-napi: on, napi-threads: 50}"
DELIVERED = ("delivered",)
KINDS = [
    Kind("none", makers.nothing, "", keys=OURS_FIFO),
    Kind("hog", makers.ordinary_hogs, "cpu", "culprit", CPU_STAGES, OURS_FIFO + ", deadline: 6 ms"),
    Kind("fifo-hog", makers.hog(1, "chrt", "-f", "90", burst_ms=25, pause_ms=100), "cpu", "culprit", CPU_STAGES, OURS_FIFO),
    Kind("fifo-over-other", makers.real_time_hog, "cpu", "culprit", CPU_STAGES, OURS_FIFO),
    Kind("stop", makers.stopped, "stopped", keys=OURS_FIFO),
    Kind("quota", makers.throttled, "throttled", keys=OURS_FIFO, lacks=makers.no_quotas),
    Kind("rt-throttling", makers.rt_throttled, "throttled", "", CPU_STAGES, OURS_FIFO + ", duration: 4 s", for_s=2.8),
    Kind("napi", makers.starved_napi, "cpu", "culprit", ("travelled",), OURS_FIFO + ", " + THREADED),
    Kind("drop-in", makers.dropped("input"), "dropped", "NETFILTER_DROP", DELIVERED, OURS_FIFO + ", deadline: 90 ms, duration: 4 s"),
    Kind("drop-out", makers.dropped("output"), "dropped", "NETFILTER_DROP", ("queued",), OURS_FIFO + ", deadline: 90 ms, duration: 4 s"),
    Kind("link-loss", makers.nothing, "dropped", "NETFILTER_DROP", (), OURS_FIFO + ", link.loss: 8 %", named_at="either"),
    Kind("link-cut", makers.nothing, "dropped", "NETFILTER_DROP", (), OURS_FIFO + ", link.cut: 1 s for 200 ms", named_at="either"),
    Kind("link-down", makers.link_down, "link-down", "was taken down", keys=OURS_FIFO),
    Kind("link-delay", makers.nothing, "queue", "to-co", ("queued",), OURS_FIFO + ", link.delay: 15 ms", named_at="either"),
    Kind("shaped", makers.shaped, "queue", "to-co", ("queued",), OURS_FIFO),
    Kind("crowded", makers.crowded, "queue", "to-co", ("queued",), OURS_FIFO),
    Kind("buffer", makers.small_buffer, "dropped", "SOCKET_RCVBUFF", DELIVERED, OURS_FIFO, fault="buffer 1"),
    Kind("sleep", makers.nothing, "waited", "", DELIVERED, OURS_FIFO, fault="sleep 30"),
    Kind("lock", makers.nothing, "waited", "culprit-lock", DELIVERED, OURS_FIFO, fault="lock 20"),
    Kind("busy", makers.nothing, "busy", "", DELIVERED, OURS_FIFO, fault="busy 30"),
    Kind("callback", makers.nothing, "busy", "", DELIVERED, OURS_FIFO + ", options.statistics: off, background: {topics: 1, rate: 5 Hz, "
         "callback: 30 ms, where: same-node, direction: to-END}", over="ros2", lacks=makers.no_ros2),
    Kind("pages", makers.nothing, "page-fault", "", DELIVERED, OURS_FIFO + ", realtime.lock-memory: off", fault="pages 30"),
    Kind("two", makers.stopped, "stopped", keys=OURS_FIFO, fault="sleep 30", also="waited"),
    Kind("slow-rules", makers.slow_rules, "busy", "", ("left",), OURS_FIFO + ", deadline: 5 ms, duration: 4 s", for_s=2.8),
    Kind("freeze", makers.frozen, "frozen|waited", keys=OURS_FIFO, lacks=makers.no_freezer),
    Kind("trace", makers.traced, "traced", keys=OURS_FIFO),
    Kind("fragment", makers.little_room, "dropped", "", ("queued",), OURS_FIFO + ", payload: 6000 B, duration: 4 s", over="udp", for_s=2.8),
    Kind("napi-loss", makers.starved_napi_for_long, "cpu", "culprit", ("travelled",), OURS_FIFO + ", timeout: 40 ms, " + THREADED),
    Kind("inversion", makers.inversion, "cpu", "culprit", DELIVERED, OURS_FIFO + ", duration: 5 s", fault="inversion 10", via="culprit-lock", for_s=2.8),
]
