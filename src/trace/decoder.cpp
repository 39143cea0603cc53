// SPDX-License-Identifier: Apache-2.0
#include "trace/decoder.hpp"

#include <algorithm>
#include <bit>
#include <cstring>
#include <fstream>
#include <sstream>
#include <string_view>

#include <event-parse.h>
#include <fmt/format.h>

namespace ontime::trace {
namespace {

constexpr const char* running = "common_pid";
constexpr const char* none = "";
constexpr const char* internet = "protocol == 0x800 || protocol == 0x86dd";
constexpr const char* by_no_table = "err != 0 && tb_id == 254";  // of the last of all tables, RT_TABLE_MAIN
constexpr const char* it_waits = "err != 0";
constexpr const char* stop_or_go = "sig >= 18 && sig <= 20";  // SIGCONT, SIGSTOP, SIGTSTP

// The kernel adds its stack to a switch only if the thread is going to wait in the kernel, which is rare.
constexpr const char *switches = "events/sched/sched_switch/trigger", *stack = "stacktrace",
                     *of_those_that_wait = "stacktrace if prev_state == 2";

// A tracepoint, what is unknown without it ("": another one replaces it), and the fields that are read.
// `common_pid` is the thread that ran.
struct Wanted {
  Kind kind;
  const char *system, *name, *tells = none, *what = none, *filter = none, *packet = none, *bytes = none;
  const char *thread = running, *thread_name = none, *thread_priority = none;
  const char *other = none, *other_name = none, *other_priority = none;
};
constexpr Wanted wanted[] = {
    {Kind::switched, "sched", "sched_switch", "which thread had the CPU", "prev_state", none, none, none,
     "prev_pid", "prev_comm", "prev_prio", "next_pid", "next_comm", "next_prio"},
    {Kind::waking, "sched", "sched_waking", "when a thread was woken", "target_cpu", none, none, none, "pid",
     "comm", "prio", running},
    {Kind::interrupt, "irq", "irq_handler_entry", "interrupts that took the CPU", "name"},
    {Kind::interrupt_end, "irq", "irq_handler_exit"},
    {Kind::soft_interrupt, "irq", "softirq_entry", "softirqs that took the CPU", "vec"},
    {Kind::soft_interrupt_end, "irq", "softirq_exit", none, "vec"},
    {Kind::timer, "irq_vectors", "local_timer_entry"},
    {Kind::timer_end, "irq_vectors", "local_timer_exit"},
    {Kind::queued, "net", "net_dev_queue", "when a packet was queued", "name", none, "skbaddr", "len"},
    {Kind::sent, "net", "net_dev_start_xmit", "when a packet left the queue", "name", none, "skbaddr", "len"},
    {Kind::received, "net", "netif_receive_skb", "when a packet arrived", "name", none, "skbaddr", "len"},
    {Kind::dropped, "skb", "kfree_skb", "dropped packets", "reason", internet, "skbaddr"},
    {Kind::signal, "signal", "signal_generate", "which process stopped a thread", "sig", stop_or_go, none,
     none, "pid", "comm", none, running},
    {Kind::waits, "ftrace", "kernel_stack", "what a thread waits for in the kernel", "caller"},
    {Kind::moved, "sched", "sched_migrate_task", "which CPU a thread was moved to", "dest_cpu", none, none,
     none, "pid", "comm", "prio", running},
    {Kind::reclaim, "vmscan", "mm_vmscan_direct_reclaim_begin"},
    {Kind::reclaim_end, "vmscan", "mm_vmscan_direct_reclaim_end"},
    {Kind::freeze, "cgroup", "cgroup_freeze", none, "path"},
    {Kind::thaw, "cgroup", "cgroup_unfreeze", none, "path"},
    {Kind::no_route, "fib", "fib_table_lookup", "packets without a route", none, by_no_table},
    {Kind::no_neighbour, "neigh", "neigh_event_send_done", "addresses that no host on the link answered for",
     none, it_waits}};

// The kernel's TASK_*; those above 0x80 are not exported to user space. The kernel may add a flag for
// preempted threads, which are also ready.
char state_of(std::int64_t bits) {
  constexpr std::string_view letters = "SDTtXZPI";
  for (std::size_t i = 0; i < letters.size(); ++i)
    if ((bits & (1 << i)) != 0) return letters[i];
  return 'R';
}

constexpr const char* soft_interrupts[] = {"HI",       "TIMER",   "NET_TX", "NET_RX",  "BLOCK",
                                           "IRQ_POLL", "TASKLET", "SCHED",  "HRTIMER", "RCU"};

// The kernel's functions by start address; none if it hides its addresses (kernel.kptr_restrict). Takes some
// tens of milliseconds.
std::vector<std::pair<std::uint64_t, std::string>> kernel_functions() {
  std::vector<std::pair<std::uint64_t, std::string>> functions{{0, ""}};
  std::ifstream file("/proc/kallsyms");
  for (std::string line; std::getline(file, line);) {
    std::istringstream words(line);
    std::uint64_t address = 0;
    std::string type, name;
    if (words >> std::hex >> address >> type >> name && address != 0 &&
        std::string_view("tTwW").find(type) != std::string_view::npos)
      functions.emplace_back(address, std::move(name));
  }
  std::ranges::sort(functions);
  return functions;
}

}  // namespace

Decoder::Decoder(const Tracefs& tracefs) : tep_(tep_alloc(), tep_free), functions_(kernel_functions()) {
  tep_set_loglevel(TEP_LOG_NONE);  // what it cannot read of a description is not the user's concern
  tep_set_long_size(tep_.get(), sizeof(long));
  tep_set_file_bigendian(tep_.get(),
                         std::endian::native == std::endian::big ? TEP_BIG_ENDIAN : TEP_LITTLE_ENDIAN);
  const auto understands = [&](const Wanted& one) {
    const auto path = fmt::format("events/{}/{}", one.system, one.name);
    const bool is_there = tracefs.has(path + "/format");
    const bool can_be = one.kind != Kind::waits || tracefs.read(switches).find(stack) != std::string::npos;
    if (!is_there || !can_be) return false;
    const auto format = tracefs.read(path + "/format");
    tep_parse_event(tep_.get(), format.data(), format.size(), one.system);
    auto* const event = tep_find_event_by_name(tep_.get(), one.system, one.name);
    if (event == nullptr) return false;
    bool whole = true;
    const auto field = [&](const char* name) -> Field {
      if (*name == '\0') return {};
      const auto* const found = tep_find_any_field(event, name);
      // An older kernel does not give the reason of a drop.
      if (found == nullptr) {
        whole = whole && one.kind == Kind::dropped && std::string_view(name) == "reason";
        return {};
      }
      return {found->offset, found->size, (found->flags & TEP_FIELD_IS_SIGNED) != 0,
              (found->flags & TEP_FIELD_IS_DYNAMIC) != 0};
    };
    const Shape shape{one.kind,
                      event,
                      field(running),
                      field(one.thread),
                      field(one.thread_name),
                      field(one.thread_priority),
                      field(one.other),
                      field(one.other_name),
                      field(one.other_priority),
                      field(one.what),
                      field(one.packet),
                      field(one.bytes),
                      field(one.kind == Kind::dropped ? "location" : none)};
    if (!whole) return false;
    shapes_.emplace(event->id, shape);
    if (one.kind == Kind::waits) {
      settings_.push_back({switches, of_those_that_wait});
      return true;
    }
    if (*one.filter != '\0') settings_.push_back({path + "/filter", one.filter});
    settings_.push_back({path + "/enable", "1"});
    return true;
  };
  for (const auto& one : wanted)
    if (!understands(one) && *one.tells != '\0')
      missing_.push_back(fmt::format("{}:{} ({})", one.system, one.name, one.tells));
  for (const auto kind : {Kind::switched, Kind::waking})
    if (std::ranges::none_of(shapes_, [&](const auto& shape) { return shape.second.kind == kind; }))
      throw Error(
          "explain needs the tracepoints sched:sched_switch and sched:sched_waking; this kernel lacks them "
          "or has an unknown format of them");
}

const Decoder::Shape* Decoder::shape_of(const RawEvent& event) const {
  std::uint16_t id = 0;
  if (event.bytes.size() < sizeof id) return nullptr;
  std::memcpy(&id, event.bytes.data(), sizeof id);
  const auto shape = shapes_.find(id);
  return shape == shapes_.end() ? nullptr : &shape->second;
}

std::int64_t Decoder::number(const Field& field, const RawEvent& event) {
  const auto offset = static_cast<std::size_t>(field.offset), size = static_cast<std::size_t>(field.size);
  if (field.offset < 0 || size > sizeof(std::int64_t) || offset + size > event.bytes.size()) return 0;
  std::int64_t value = 0;
  const std::size_t place = std::endian::native == std::endian::big ? sizeof value - size : 0;
  std::memcpy(reinterpret_cast<std::byte*>(&value) + place, event.bytes.data() + offset, size);
  const auto unused = 8 * (sizeof value - size);
  if (field.is_signed && unused > 0)
    value = static_cast<std::int64_t>(static_cast<std::uint64_t>(value) << unused) >> unused;
  return value;
}

std::string Decoder::text(const Field& field, const RawEvent& event) {
  if (field.offset < 0) return {};
  auto offset = static_cast<std::size_t>(field.offset), size = static_cast<std::size_t>(field.size);
  if (field.is_elsewhere) {  // the kernel's __data_loc
    const auto place = static_cast<std::uint32_t>(number({field.offset, 4, false, false}, event));
    offset = place & 0xffff;
    size = place >> 16;
  }
  if (offset + size > event.bytes.size()) return {};
  const auto* const begin = reinterpret_cast<const char*>(event.bytes.data()) + offset;
  return {begin, std::find(begin, begin + size, '\0')};
}

const std::string& Decoder::function_at(std::uint64_t address) const {
  const auto next =
      std::ranges::upper_bound(functions_, address, {}, [](const auto& function) { return function.first; });
  return std::prev(next)->second;
}

std::string Decoder::functions_of(const Shape& shape, const RawEvent& event) {
  constexpr std::string_view last_of_switching = "__schedule";
  std::string functions;
  const auto offset = shape.what.offset;
  for (Field one{offset, sizeof(long), false, false};
       static_cast<std::size_t>(one.offset) + sizeof(long) <= event.bytes.size(); one.offset += one.size) {
    const auto address = number(one, event);
    if (address == -1) break;  // older kernels end it so
    const auto& name = function_at(static_cast<std::uint64_t>(address));
    if (name == last_of_switching)
      functions.clear();
    else if (!name.empty())
      functions += (functions.empty() ? "" : " ") + name;
  }
  return functions;
}

// As the kernel's own description prints it: the numbers of reasons change from one version to the next.
std::string Decoder::what_of(const Shape& shape, const RawEvent& event) {
  switch (shape.kind) {
    case Kind::switched:
      return {state_of(number(shape.what, event))};
    case Kind::soft_interrupt:
    case Kind::soft_interrupt_end: {
      const auto which = static_cast<std::size_t>(number(shape.what, event));
      return which < std::size(soft_interrupts) ? soft_interrupts[which] : fmt::format("{}", which);
    }
    case Kind::waking:
    case Kind::signal:
    case Kind::moved:
      return fmt::format("{}", number(shape.what, event));
    case Kind::dropped: {
      tep_record record{};
      record.data = event.bytes.data();
      record.size = static_cast<int>(event.bytes.size());
      trace_seq printed;
      trace_seq_init(&printed);
      tep_print_event(tep_.get(), &printed, &record, "%s", TEP_PRINT_INFO);
      trace_seq_terminate(&printed);
      const std::string text(printed.buffer, printed.len);
      trace_seq_destroy(&printed);
      const std::string_view before = "reason: ";
      const auto begin = text.find(before);
      auto reason = begin == text.npos ? "" : text.substr(begin + before.size());
      if (!reason.empty() && reason != "NOT_SPECIFIED") return reason;
      return function_at(static_cast<std::uint64_t>(number(shape.place, event)));
    }
    case Kind::waits:
      return functions_of(shape, event);
    default:
      return text(shape.what, event);
  }
}

std::optional<Kind> Decoder::kind_of(const RawEvent& event) const {
  const auto* const shape = shape_of(event);
  return shape == nullptr ? std::nullopt : std::optional(shape->kind);
}

Event Decoder::decode(const RawEvent& raw, Packets& packets) {
  const auto& shape = *shape_of(raw);
  const auto whole = [&](const Field& field) { return static_cast<std::int32_t>(number(field, raw)); };
  Event event{.at_ns = raw.at_ns,
              .cpu = raw.cpu,
              .kind = shape.kind,
              .thread = {whole(shape.thread), text(shape.name, raw), whole(shape.priority)},
              .other = {whole(shape.other), text(shape.other_name, raw), whole(shape.other_priority)},
              .what = what_of(shape, raw),
              .packet = 0,
              .bytes = whole(shape.bytes)};
  // Not its address, which is the kernel's own affair.
  if (const auto address = static_cast<std::uint64_t>(number(shape.packet, raw)); address != 0)
    event.packet = packets.try_emplace(address, static_cast<std::int32_t>(packets.size()) + 1).first->second;
  return event;
}

Decoder::Switch Decoder::switch_of(const RawEvent& event) const {
  const auto& shape = *shape_of(event);
  return {static_cast<std::int32_t>(number(shape.thread, event)),
          static_cast<std::int32_t>(number(shape.other, event)),
          std::string_view("SIXZP").find(state_of(number(shape.what, event))) != std::string_view::npos};
}

std::int32_t Decoder::woken(const RawEvent& event) const {
  return static_cast<std::int32_t>(number(shape_of(event)->thread, event));
}

std::int32_t Decoder::who_ran(const RawEvent& event) const {
  return static_cast<std::int32_t>(number(shape_of(event)->running, event));
}

}  // namespace ontime::trace
