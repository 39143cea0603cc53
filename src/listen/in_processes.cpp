// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <iterator>
#include <numeric>
#include <set>
#include <system_error>
#include <thread>

#include <bpf/bpf.h>
#include <bpf/libbpf.h>
#include <cxxabi.h>
#include <fmt/format.h>
#include <poll.h>
#include <sys/resource.h>
#include <unistd.h>

#include "listen/clock_steps.hpp"
#include "listen/cost.hpp"
#include "listen/event.h"
#include "listen/library.hpp"
#include "listen/listen.hpp"
#include "listen/messages.hpp"
#include "listen/probes.skel.h"
#include "listen/processes.hpp"
#include "listen/wishes.hpp"
#include "machine/machine.hpp"

namespace ontime::listen {
namespace {

using namespace std::chrono_literals;

constexpr auto look_every = 1s;
constexpr std::size_t most_remarks = 32, most_handles = 1024;  // handles without a topic name, of a process
constexpr std::int64_t most_interrupted_ns = 1'000'000'000;
// A handle still without a name after this many messages never gets one.
constexpr std::uint64_t most_messages_without_name = 1000;
// Otherwise a process that publishes without end would keep this one reading.
constexpr std::int64_t longest_read_ns = 200'000'000;
constexpr std::uint64_t latest_stamp_ns = std::uint64_t{1} << 62U;  // later ones are invalid; the year 2116

std::string reason(int error) { return std::generic_category().message(error); }

using Link = std::unique_ptr<bpf_link, int (*)(bpf_link*)>;

// A readable name without arguments.
std::string plain(const std::string& function) {
  const std::unique_ptr<char, void (*)(void*)> text(
      abi::__cxa_demangle(function.c_str(), nullptr, nullptr, nullptr), std::free);
  const std::string name = text ? text.get() : function;
  return name.substr(0, name.find('('));
}

class InProcesses final : public Sensor {
 public:
  InProcesses(const Limits& limits, std::vector<ChainWish> chains)
      : limits_(limits),
        with_turns_(!chains.empty()),
        messages_(limits, std::move(chains)),
        probes_(nullptr, probes_bpf__destroy) {
    libbpf_set_print(nullptr);
    // Each probe is a file, and each library while probes are set.
    rlimit files{};
    if (getrlimit(RLIMIT_NOFILE, &files) == 0) {
      files.rlim_cur = files.rlim_max;
      setrlimit(RLIMIT_NOFILE, &files);
    }
    probes_.reset(probes_bpf__open_and_load());
    if (!probes_) {
      const int error = errno;
      if (error == EPERM || error == EACCES) throw Denied("listen: the kernel denied probes");
      throw Error(
          fmt::format("listen: the kernel cannot load the probes: {}. They need Linux 5.15 or newer with "
                      "CONFIG_BPF_EVENTS and CONFIG_UPROBES. Without probes: --packets or --pcap",
                      reason(error)));
    }
    ring_.reset(ring_buffer__new(
        bpf_map__fd(probes_->maps.events),
        [](void* self, void* data, std::size_t size) {
          auto& sensor = *static_cast<InProcesses*>(self);
          sensor.take(data, size);
          return now_ns() < sensor.read_until_ns_ ? 0 : -1;
        },
        this, nullptr));
    if (!ring_) throw Error(fmt::format("listen: cannot create a BPF ring buffer: {}", reason(errno)));
    const auto& programs = probes_->progs;
    costs_ = measure_probe_costs(programs.publish, programs.rmw_take, programs.rmw_taken);
    read();
    counted_before_ = calls();
  }

  bool listen_for(std::chrono::milliseconds most) override {
    const auto until = std::chrono::steady_clock::now() + most;
    if (is_paused_) std::this_thread::sleep_until(until);
    if (is_paused_) return true;
    do {
      const auto now = std::chrono::steady_clock::now();
      // Read the last events of a process before noting its end.
      std::optional<Processes::Change> change;
      if (now >= look_at_) {
        look_at_ = now + look_every;
        change = processes_.look();
      }
      read();
      if (change) follow(*change, now_ns());
      // The probes wake no reader: that would cost the thread that publishes.
      std::this_thread::sleep_until(std::min(until, std::chrono::steady_clock::now() + 20ms));
    } while (std::chrono::steady_clock::now() < until);
    read();  // setting probes takes up to a second
    return true;
  }

  Findings findings() const override {
    auto findings = messages_.findings();
    judge_silence(findings.flows, limits_, is_paused_ ? paused_ns_ : read_ns_ - unread_ns, resumed_ns_);
    findings.sensor_lost = probes_->bss->lost;
    findings.cost = cost();
    findings.remarks.insert(findings.remarks.end(), remarks_.begin(), remarks_.end());
    if (findings.cost && findings.cost->stepped > 0)
      findings.remarks.push_back(
          fmt::format("no cheap place for a probe in {}: {} calls took about {:.0f} µs more each",
                      fmt::join(costly_, ", "), findings.cost->stepped, findings.cost->step_ns / 1e3));
    clock_.remark(findings.remarks, "Ages and losses");
    return findings;
  }

  std::vector<Miss> take_misses() override {
    auto misses = messages_.take_misses(now_ns());
    for (auto& miss : misses) miss.at_ns += realtime_ahead_ns_;
    return misses;
  }

  void keep_rows(KeepRow keep) override { messages_.keep_rows(std::move(keep)); }

  std::optional<Cost> cost() const override {
    if (!costs_) return {};
    const auto now = calls();
    return Cost{.publishes = now[ontime_publish_calls] - counted_before_[ontime_publish_calls],
                .takes = now[ontime_take_calls] - counted_before_[ontime_take_calls],
                .turns = now[ontime_turn_calls] - counted_before_[ontime_turn_calls],
                .stepped = now[ontime_stepped_calls] - counted_before_[ontime_stepped_calls],
                .publish_ns = costs_->publish_ns,
                .take_ns = costs_->take_ns,
                .step_ns = costs_->step_ns};
  }

  void pause() override {
    read();
    is_paused_ = true;
    paused_ns_ = read_ns_ - unread_ns;
    shared_.clear();
    everywhere_.clear();
    for (auto& [id, own] : of_process_) {
      own.links.clear();
      own.finder.clear();
      own.unnamed.clear();  // their next messages look for them again
    }
    read();
  }

  void resume() override {
    for (const auto& flow : findings().flows)
      if (flow.silent_ns > 0)
        messages_.count_silence(flow.id, std::max(flow.last_ns, resumed_ns_), flow.silent_ns);
    processes_.look_again();
    follow(processes_.look(), now_ns());
    read();  // seen while some probes were not set yet
    is_paused_ = false;
    resumed_ns_ = now_ns();
    messages_.interrupt(resumed_ns_);
  }

 private:
  void read() {
    follow_clock();
    const auto from_ns = now_ns();
    read_until_ns_ = from_ns + longest_read_ns;
    ring_buffer__consume(ring_.get());
    // More is there: it came too fast, or the kernel holds back one event that is not complete.
    pollfd ring{.fd = bpf_map__fd(probes_->maps.events), .events = POLLIN, .revents = 0};
    read_ns_ = poll(&ring, 1, 0) > 0 ? std::max(read_ns_, latest_ns_) : from_ns;
  }

  // When the clock is set, the stamps of messages under way are useless.
  void follow_clock() {
    const auto at_ns = now_ns();
    realtime_ahead_ns_ = machine::realtime_offset_ns();
    // If the clock is set back, an earlier stamp looks later.
    if (const auto set_by_ns = clock_.look(realtime_ahead_ns_, at_ns); set_by_ns != 0)
      messages_.forget_stamps(at_ns + std::clamp<std::int64_t>(-set_by_ns, 0, most_interrupted_ns));
  }

  using Calls = std::array<std::uint64_t, ontime_calls>;
  Calls calls() const {
    Calls sums{};
    std::vector<std::uint64_t> by_cpu(static_cast<std::size_t>(libbpf_num_possible_cpus()));
    for (std::uint32_t call = 0; call < sums.size(); ++call)
      if (bpf_map_lookup_elem(bpf_map__fd(probes_->maps.counts), &call, by_cpu.data()) == 0)
        sums[call] = std::accumulate(by_cpu.begin(), by_cpu.end(), std::uint64_t{0});
    return sums;
  }

  void follow(const Processes::Change& change, std::int64_t now_ns) {
    messages_.retire_ended(now_ns);
    for (const auto id : change.gone) {
      messages_.end_process(id, now_ns);
      forget(id);
      ros_.erase(id);
    }
    for (const auto& process : change.came) {
      messages_.begin_process(process.id, process.name);
      // Each message of a ROS 2 node passes rmw and the DDS library. Probe rmw, which may be loaded later: it
      // tells more.
      if (std::ranges::count(process.libraries, Middleware::rmw, &Mapping::middleware) > 0 &&
          ros_.insert(process.id).second)
        forget(process.id);
      for (const auto& library : process.libraries) {
        if (library.middleware == Middleware::rmw)
          probe(process, library, rmw_wishes(*probes_));
        else if (library.middleware == Middleware::rcl)
          probe(process, library, rcl_wishes());
        else if (ros_.contains(process.id))
          continue;
        else if (library.middleware == Middleware::fastdds)
          probe_fastdds(process, library);
        else
          probe_cyclonedds(process, library);
      }
    }
    for (auto& [id, own] : of_process_) {
      const auto is_waited_for = [](const auto& one) { return one.second < most_messages_without_name; };
      if (std::ranges::none_of(own.unnamed, is_waited_for)) remove(own.finder);
    }
  }

  void forget(std::uint32_t process) {
    const auto own = of_process_.extract(process);
    if (!own) return;
    remove(own.mapped().links);
    remove(own.mapped().finder);
  }

  void remove(std::vector<Link>& links) {
    if (links.empty()) return;
    const auto from_ns = now_ns();
    links.clear();
    messages_.add_probing(from_ns, now_ns());
  }

  // Probes apply to all processes of a file: the kernel would switch the events of a single process with each
  // of its threads, which costs more than the probes. On an overlay they apply to one process, because other
  // containers share the file below it.
  void probe(const Process& process, const Mapping& library, Wishes wishes) {
    // Only chains need the end of a callback.
    if (with_turns_)
      for (const auto& function : wishes.turns)
        wishes.messages.push_back({function, probes_->progs.turn, nullptr, {.endpoint = Wish::none}});
    if (library.is_on_overlay)
      set(library, static_cast<pid_t>(process.id), of_process_[process.id].links, wishes.messages);
    else if (!everywhere_.contains(library.use()) && set(library, -1, shared_, wishes.messages))
      everywhere_.insert(library.use());
  }

  void probe_fastdds(const Process& process, const Mapping& library) {
    if (!library.is_on_overlay && everywhere_.contains(library.use())) return;
    const auto wishes = fastdds_wishes(*probes_, library.path);
    if (!wishes) {
      remark(fmt::format(
          "{} of process {} is not Fast DDS 2: probes cannot see its messages. Fix: --packets any",
          library.name, process.id));
      return;
    }
    if (!wishes->knows_topics) remark_unnamed(process.id, library);
    probe(process, library, *wishes);
  }

  void probe_cyclonedds(const Process& process, const Mapping& library) {
    auto& own = of_process_[process.id];
    own.library = library;
    probe(process, library, cyclonedds_wishes(*probes_));
    const std::string get_name = "dds_get_name";
    try {
      own.offset_of_name = offset_of_topic_name(Library(library.path, {get_name}).code(get_name));
      if (!own.offset_of_name) remark_unnamed(process.id, library);
    } catch (const Error&) {  // reported where probes are set
    }
  }

  void remark_unnamed(std::uint32_t process, const Mapping& library) {
    remark(fmt::format("{} of process {} has an unknown layout: its topics have no names", library.name,
                       process));
  }

  static std::int64_t now_ns() {
    return std::chrono::nanoseconds(std::chrono::steady_clock::now().time_since_epoch()).count();
  }

  static std::uint64_t cookie_of(const Wish& wish, const Registers& registers, bool is_cheap) {
    std::uint64_t cookie = wish.cookie | (is_cheap ? 0 : ontime_cookie_is_stepped);
    const auto add = [&](std::size_t argument, unsigned shift) {
      if (argument != Wish::none) cookie |= std::uint64_t{registers[argument]} << shift;
    };
    add(wish.arguments.endpoint, ontime_cookie_endpoint);
    add(wish.arguments.taken, ontime_cookie_taken);
    add(wish.arguments.info, ontime_cookie_info);
    return cookie;
  }

  // Sets the probes on all functions that the library has, or on none. False: none.
  bool set(const Mapping& mapping, pid_t process, std::vector<Link>& links, const std::vector<Wish>& wishes) {
    std::vector<Link> own;
    std::int64_t from_ns = 0;  // the first was set
    bool is_set = true;
    try {
      Library::Names functions;
      for (const auto& wish : wishes) functions.insert({wish.function, wish.returns_by});
      const Library library(mapping.path, functions);
      const auto attach = [&](const std::string& function, bpf_program* program, const Place& place,
                              bool on_return, std::uint64_t cookie) {
        if (from_ns == 0) from_ns = now_ns();
        bpf_uprobe_opts options{};
        options.sz = sizeof options;
        options.retprobe = on_return;
        options.bpf_cookie = cookie;
        auto* const link =
            bpf_program__attach_uprobe_opts(program, process, mapping.path.c_str(), place.offset, &options);
        if (link == nullptr) {
          const auto why = reason(errno);
          throw Error(fmt::format("cannot set a probe at {}: {}", plain(function), why));
        }
        own.emplace_back(link, bpf_link__destroy);
      };
      std::set<std::string> costly;
      std::set<std::uint64_t> exits;  // that functions share
      for (const auto& wish : wishes) {
        std::vector<std::size_t> arguments;
        for (const auto argument : {wish.arguments.endpoint, wish.arguments.taken, wish.arguments.info})
          if (argument != Wish::none) arguments.push_back(argument);
        const auto entry = library.entry(wish.function, arguments);
        if (!entry) continue;
        bool is_cheap = entry->is_cheap;
        // The return first: a call that is under way when probes are set has no entry, and is left out.
        if (wish.on_return != nullptr) {
          auto exit = library.exit(wish.returns_by);
          if (!exit) exit = library.exit(wish.function);
          is_cheap &= exit->is_cheap;
          if (exits.insert(exit->offset).second) attach(wish.function, wish.on_return, *exit, true, 0);
        }
        attach(wish.function, wish.on_call, *entry, false, cookie_of(wish, entry->registers, is_cheap));
        if (!is_cheap) costly.insert(plain(wish.function));
      }
      costly_.merge(costly);
    } catch (const Error& error) {
      own.clear();
      is_set = false;
      // A process that ended meanwhile needs no remark.
      if (process < 0 || kill(process, 0) == 0) remark(fmt::format("{}: {}", mapping.name, error.what()));
    }
    if (from_ns != 0) messages_.add_probing(from_ns, now_ns());
    std::move(own.begin(), own.end(), std::back_inserter(links));
    return is_set;
  }

  void take(const void* data, std::size_t size) {
    ontime_event event;
    if (size < sizeof event) return;
    std::memcpy(&event, data, sizeof event);
    latest_ns_ = std::max(latest_ns_, static_cast<std::int64_t>(event.at_ns));
    if (event.process == own_process_) return;
    if (event.is_below_rmw != 0 && ros_.contains(event.process)) return;  // its rmw reports the message
    if (event.kind == ontime_named) {
      const auto* const topic = static_cast<const char*>(data) + sizeof event;
      return name(event, std::string(topic, strnlen(topic, size - sizeof event)));
    }
    if (is_paused_) return;  // some of the probes are not set
    if (event.kind != ontime_turned && event.is_handle != 0) find_name(event);
    if (event.kind == ontime_taken && event.is_below_rmw != 0 && event.is_handle == 0 && event.stamp_ns == 0)
      remark(
          fmt::format("process {}: its messages have no known time stamp: their age and losses are unknown",
                      event.process));
    Observation seen{.kind = event.kind == ontime_published ? Observation::Kind::published
                             : event.kind == ontime_turned  ? Observation::Kind::turned
                                                            : Observation::Kind::taken,
                     .after_loss = event.lost > lost_,
                     .at_ns = static_cast<std::int64_t>(event.at_ns),
                     .stamp_ns = event.stamp_ns == 0 || event.stamp_ns > latest_stamp_ns
                                     ? 0
                                     : static_cast<std::int64_t>(event.stamp_ns) - realtime_ahead_ns_,
                     .endpoint = event.endpoint,
                     .process = event.process,
                     .thread = event.thread};
    lost_ = std::max(lost_, event.lost);
    std::copy(std::begin(event.writer), std::end(event.writer), seen.writer.begin());
    messages_.add(seen);
  }

  // A handle of Cyclone DDS has no topic name, but the memory of its entity has. The process's next call
  // tells where the entity is; then this probe is removed.
  void find_name(const ontime_event& event) {
    const auto found = of_process_.find(event.process);
    if (found == of_process_.end()) return;
    auto& own = found->second;
    if (const auto unnamed = own.unnamed.find(event.endpoint); unnamed != own.unnamed.end()) {
      const bool could_be_found = static_cast<std::int64_t>(event.at_ns) > own.finder_since_ns;
      if (could_be_found && ++unnamed->second == most_messages_without_name)
        remark_unnamed(event.process, own.library);
      return;
    }
    if (!own.offset_of_name || messages_.has_name(event.process, event.endpoint)) return;
    if (own.unnamed.size() == most_handles)
      return remark(
          fmt::format("process {}: more than {} topics have no known name", event.process, most_handles));
    own.unnamed.emplace(event.endpoint, 0);
    if (!own.finder.empty() || !own.can_find) return;
    // Each call with a handle ends with dds_handle_unpin(). In a writer or reader, the first member behind
    // the common part of all entities is the topic, and the topic has its name at the same offset.
    set(own.library, static_cast<pid_t>(event.process), own.finder,
        {{.function = "dds_handle_unpin",
          .on_call = probes_->progs.dds_entity_left,
          .cookie = ontime_cookie_is_below_rmw | *own.offset_of_name << ontime_cookie_topic |
                    *own.offset_of_name << ontime_cookie_name}});
    own.finder_since_ns = now_ns();
    own.can_find = !own.finder.empty();
    if (!own.can_find) remark_unnamed(event.process, own.library);
  }

  void name(const ontime_event& event, const std::string& topic) {
    if (const auto own = of_process_.find(event.process); own != of_process_.end())
      own->second.unnamed.erase(event.endpoint);
    if (!topic.empty() && std::all_of(topic.begin(), topic.end(), [](char c) { return c >= ' ' && c < 127; }))
      messages_.name_topic(event.process, event.endpoint, ros_name(topic));
  }

  void remark(const std::string& text) {
    if (remarks_.size() < most_remarks) remarks_.insert(text);
  }

  struct OfProcess {
    std::vector<Link> links;
    // Cyclone DDS without rmw: the probe that finds the names of topics.
    Mapping library;
    std::optional<std::uint64_t> offset_of_name;
    std::vector<Link> finder;
    bool can_find = true;  // false: the finder could not be set
    std::int64_t finder_since_ns = 0;
    std::map<std::uint64_t, std::uint64_t> unnamed;  // handles, and their messages since then
  };

  const Limits limits_;
  const bool with_turns_;
  Messages messages_;
  Processes processes_;
  std::unique_ptr<probes_bpf, void (*)(probes_bpf*)> probes_;
  std::unique_ptr<ring_buffer, void (*)(ring_buffer*)> ring_{nullptr, ring_buffer__free};
  const std::uint32_t own_process_ = static_cast<std::uint32_t>(getpid());
  std::optional<ProbeCosts> costs_;
  Calls counted_before_{};
  std::vector<Link> shared_;
  std::set<Mapping::Use> everywhere_;  // with probes for all processes
  std::map<std::uint32_t, OfProcess> of_process_;
  std::set<std::uint32_t> ros_;  // processes that have mapped an rmw
  std::set<std::string> remarks_;
  std::set<std::string> costly_;  // functions where the kernel steps over the instruction under the probe
  std::chrono::steady_clock::time_point look_at_;
  std::int64_t realtime_ahead_ns_ = machine::realtime_offset_ns();
  ClockSteps clock_;
  std::int64_t read_ns_ = now_ns();                 // all events until then were read
  std::int64_t read_until_ns_ = 0, latest_ns_ = 0;  // when to stop reading; time of the latest event
  std::uint32_t lost_ = 0;
  bool is_paused_ = false;
  std::int64_t paused_ns_ = 0, resumed_ns_ = 0;
};

}  // namespace

std::unique_ptr<Sensor> in_processes(const Limits& limits, std::vector<ChainWish> chains) {
  return std::make_unique<InProcesses>(limits, std::move(chains));
}

}  // namespace ontime::listen
