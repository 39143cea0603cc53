// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <csignal>
#include <mutex>
#include <thread>

#include <fcntl.h>
#include <fmt/format.h>
#include <pthread.h>
#include <sched.h>
#include <sys/file.h>
#include <unistd.h>

#include "trace/decoder.hpp"
#include "trace/instance.hpp"
#include "trace/ring.hpp"
#include "trace/trace.hpp"
#include "trace/tracefs.hpp"

namespace ontime::trace {
namespace {

using namespace std::chrono_literals;

constexpr auto look = 100ms;
constexpr std::size_t kernel_kib = 8192;   // of each CPU: half a second of 250,000 events a second
constexpr std::size_t page_bytes = 65536;  // at least what the kernel makes its pages
constexpr std::int64_t look_back_ns = 2'000'000'000;

// The state of the CPUs and of the threads that do not sleep, after the last entered event.
class Now {
 public:
  explicit Now(const Decoder& decoder) : decoder_(decoder) {}
  void enter(const RawEvent& event, Kind kind) {
    if (kind == Kind::waking) {
      awake_[decoder_.woken(event)] = event;
      waits_.erase(decoder_.woken(event));
    }
    if (kind == Kind::waits) {
      waits_[decoder_.who_ran(event)] = event;
      return;  // its switch, which has come before it, says more
    }
    if (kind == Kind::moved && awake_.contains(decoder_.woken(event))) awake_[decoder_.woken(event)] = event;
    if (kind != Kind::switched) {
      const auto cpu = cpus_.find(event.cpu);
      if (cpu != cpus_.end()) cpu->second.enter(event, decoder_.who_ran(event));
      return;
    }
    const auto change = decoder_.switch_of(event);
    cpus_[event.cpu] = {event, change.came == 0, {}, {}};
    awake_.erase(change.came);
    if (change.left == 0) return;
    if (change.sleeps)
      awake_.erase(change.left);
    else
      awake_[change.left] = event;
  }
  std::vector<RawEvent> events() const {
    std::vector<RawEvent> all;
    all.reserve(3 * cpus_.size() + awake_.size() + waits_.size());
    for (const auto& [number, cpu] : cpus_) {
      all.push_back(cpu.last);
      if (cpu.idle) all.push_back(*cpu.idle);
      if (cpu.left_idle) all.push_back(*cpu.left_idle);
    }
    for (const auto* threads : {&awake_, &waits_})
      for (const auto& [thread, event] : *threads) all.push_back(event);
    const auto key = [](const RawEvent& event) { return std::pair(event.at_ns, event.bytes.data()); };
    std::ranges::sort(all, {}, key);
    // Not by std::ranges, whose pairs of iterators clang 14 does not compile.
    all.erase(std::unique(all.begin(), all.end(),
                          [&](const auto& one, const auto& other) { return key(one) == key(other); }),
              all.end());
    return all;
  }

 private:
  // Some kernels do not trace a CPU's switch from its idle thread: the next event of a thread on it shows it.
  struct Cpu {
    RawEvent last;  // switch
    bool to_idle;   // it was
    std::optional<RawEvent> idle,
        left_idle;  // what the idle thread did last since then; what another did first
    void enter(const RawEvent& event, std::int32_t running) {
      if (to_idle && !left_idle) (running == 0 ? idle : left_idle) = event;
    }
  };
  const Decoder& decoder_;
  std::map<std::int32_t, Cpu> cpus_;
  std::map<std::int32_t, RawEvent> awake_;  // by thread: since when it is ready, stopped …
  std::map<std::int32_t, RawEvent> waits_;  // by thread: for what
};

}  // namespace

class Recorder::Drain {
 public:
  Drain(journal::Journal& journal, const Room& room)
      : journal_(journal),
        most_events_(room.events),
        decoder_(tracefs_),
        ring_(static_cast<std::size_t>(sysconf(_SC_NPROCESSORS_CONF)), room.bytes) {
    journal_.hold();
    const auto alone = be_alone();
    remove_abandoned();
    journal_.change(instance_kind, instance_name, journal::to_be_made);
    try {
      start();
    } catch (...) {
      give_back();
      throw;
    }
  }
  ~Drain() {
    thread_ = {};  // stops it and waits
    give_back();
  }
  Drain(const Drain&) = delete;
  Drain& operator=(const Drain&) = delete;

  const std::vector<std::string>& missing() const { return decoder_.missing(); }

  std::vector<Window> cut(std::vector<Span> spans) {
    std::vector<Window> windows;
    windows.reserve(spans.size());
    if (spans.empty()) return windows;
    std::ranges::sort(spans, {}, &Span::from_ns);
    const auto last_ns = std::ranges::max(spans, {}, &Span::to_ns).to_ns;
    const std::lock_guard lock(mutex_);
    read();
    const auto events = ring_.between(spans.front().from_ns - look_back_ns, last_ns);
    Now now(decoder_);
    auto next = events.begin();
    for (const auto& span : spans) {
      for (; next != events.end() && next->at_ns < span.from_ns; ++next)
        if (const auto kind = decoder_.kind_of(*next)) now.enter(*next, *kind);
      windows.push_back(window(span, now.events(), {next, events.end()}));
    }
    return windows;
  }

 private:
  static Error another(const std::string& found) {
    return Error(fmt::format(
        "another ontime traces on this machine, maybe in a container ({}). Fix: end it or wait", found));
  }

  // Excludes an ontime in a container, which has another journal: while this lock is held, no other ontime
  // makes an instance.
  process::Fd be_alone() const {
    auto folder = tracefs_.open("instances", O_RDONLY | O_DIRECTORY);
    for (const auto end = std::chrono::steady_clock::now() + 3s; flock(folder.get(), LOCK_EX | LOCK_NB) != 0;
         std::this_thread::sleep_for(2ms))
      if (std::chrono::steady_clock::now() > end) throw another("it holds the lock of tracefs");
    return folder;
  }

  // Removes the instance of a killed ontime whose journal is gone, as with a container. The kernel does not
  // remove an instance that is being read, and an ontime that records reads it all the time.
  void remove_abandoned() const {
    try {
      if (tracefs_.has(instance_path)) tracefs_.remove(instance_path);
    } catch (const Error& error) {
      if (tracefs_.has(instance_path)) throw another(error.what());  // else its owner was quicker
    }
  }

  void start() {
    const std::string root = std::string(instance_path) + '/';
    tracefs_.write(root + "trace_clock", "mono");
    tracefs_.write(root + "buffer_size_kb", fmt::format("{}", kernel_kib));
    for (std::size_t cpu = 0; tracefs_.has(fmt::format("{}per_cpu/cpu{}", root, cpu)); ++cpu)
      pipes_.push_back(
          tracefs_.open(fmt::format("{}per_cpu/cpu{}/trace_pipe_raw", root, cpu), O_RDONLY | O_NONBLOCK));
    for (const auto& [file, text] : decoder_.settings()) tracefs_.write(root + file, text);
    begun_ns_ = std::chrono::nanoseconds(std::chrono::steady_clock::now().time_since_epoch()).count();
    thread_ = std::jthread([this](const std::stop_token& stop) { work(stop); });
  }

  void work(const std::stop_token& stop) {
    sigset_t all;  // signals are for the threads that were there before
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, nullptr);
    pthread_setname_np(pthread_self(), "ontime-trace");
    const sched_param none{};
    sched_setscheduler(0, SCHED_BATCH, &none);  // it pre-empts nothing that is measured
    std::unique_lock lock(mutex_);
    while (!wake_.wait_for(lock, stop, look, [&] { return stop.stop_requested(); })) read();
  }

  void read() {
    for (std::size_t cpu = 0; cpu < pipes_.size(); ++cpu)
      while (true) {
        const auto bytes = ::read(pipes_[cpu].get(), page_.data(), page_.size());
        if (bytes <= 0) break;
        ring_.add(static_cast<std::int32_t>(cpu), std::span(page_).first(static_cast<std::size_t>(bytes)));
      }
  }

  Window window(const Span& span, const std::vector<RawEvent>& before, std::span<const RawEvent> rest) {
    Window window{span, span.from_ns >= begun_ns_ && ring_.has_all(span.from_ns, span.to_ns), {}};
    Decoder::Packets packets;
    for (const auto& event : before) window.events.push_back(decoder_.decode(event, packets));
    std::size_t kept = 0;
    for (const auto& event : rest) {
      if (event.at_ns > span.to_ns) break;
      if (!decoder_.kind_of(event)) continue;
      if (++kept > most_events_) {
        window.span.to_ns = event.at_ns;
        window.whole = false;
        break;
      }
      window.events.push_back(decoder_.decode(event, packets));
    }
    return window;
  }

  void give_back() {
    pipes_.clear();  // see remove_abandoned()
    journal_.take_back(instance_kind, instance_name);
  }

  journal::Journal& journal_;
  const std::size_t most_events_;
  const Tracefs tracefs_;
  Decoder decoder_;
  std::mutex mutex_;  // of what follows
  std::condition_variable_any wake_;
  std::int64_t begun_ns_ = 0;
  std::vector<process::Fd> pipes_;  // of each CPU
  std::vector<std::byte> page_ = std::vector<std::byte>(page_bytes);
  Ring ring_;
  std::jthread thread_;
};

Recorder::Recorder(journal::Journal& journal, Room room) : drain_(std::make_unique<Drain>(journal, room)) {}
Recorder::~Recorder() = default;
const std::vector<std::string>& Recorder::missing() const { return drain_->missing(); }
std::vector<Window> Recorder::cut(std::vector<Span> spans) { return drain_->cut(std::move(spans)); }

}  // namespace ontime::trace
