// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <condition_variable>
#include <csignal>
#include <latch>
#include <utility>

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <sched.h>
#include <unistd.h>

#include "orders/orders.hpp"

namespace ontime::orders {
namespace {

using namespace std::chrono_literals;
using nlohmann::json;
using Clock = std::chrono::steady_clock;

// A middleware may hang at exit when its link is gone: then the process ends after this time.
constexpr unsigned patience_to_leave_s = 3;

Interrupts terminations = 0;

class EventPipe final : public Events {
 public:
  EventPipe(int in, int out) : frames_(in, out) {}

  void tell(const char* event, json body, std::span<const std::uint8_t> bytes) override {
    body["event"] = event;
    frames_.send(body, bytes);
  }
  void doing(const std::string& what) override {
    const std::lock_guard lock(mutex_);
    doing_ = what;
  }
  Frames& frames() { return frames_; }

  // Returns after the first beat: with it the thread gets its arena of the heap (128 MiB of addresses), which
  // is no work for a measurement.
  void start_beating() {
    std::latch begun{1};
    beating_ = std::jthread([&](const std::stop_token& stop) { beat(begun, stop); });
    begun.wait();
  }

 private:
  void beat(std::latch& begun, const std::stop_token& stop) {
    const sched_param none{};
    // SCHED_BATCH: this thread must not pre-empt a measuring thread.
    sched_setscheduler(0, SCHED_BATCH, &none);
    std::unique_lock lock(mutex_);
    bool goes_on = tell_beat();
    begun.count_down();
    while (goes_on && !wake_.wait_for(lock, stop, beat_period, [&] { return stop.stop_requested(); }))
      goes_on = tell_beat();
  }

  bool tell_beat() {  // with the lock
    try {
      tell("beat", {{"doing", doing_}}, {});
      return true;
    } catch (const Broken&) {
      return false;  // the thread that reads finds the same
    }
  }

  Frames frames_;
  std::mutex mutex_;
  std::condition_variable_any wake_;
  std::string doing_;
  std::jthread beating_;  // last: it uses the rest
};

// Reads orders and has them obeyed, until there is a reason to leave.
void obey_all(EventPipe& pipe, Worker& worker) {
  auto& frames = pipe.frames();
  auto heard = Clock::now();
  bool told = false;
  while (true) {
    const auto alone = std::min(worker.go_on(), std::chrono::milliseconds(1000));
    pollfd waiting{frames.in(), POLLIN, 0};
    poll(&waiting, 1, static_cast<int>(alone.count()));
    while (frames.fill()) heard = Clock::now();
    // Checked after reading: an order may take longer than this, and beats have arrived meanwhile.
    if (Clock::now() - heard > longest_silence)
      throw Error(3, fmt::format("the coordinator (the ontime command that you started) was silent for {} s: "
                                 "it is stopped, or the connection to it is lost",
                                 longest_silence.count()));
    while (const auto frame = frames.take()) {
      const std::string order = frame->message.value("order", "");
      if (order != "beat") worker.obey(order, frame->message);
    }
    if (terminations > 0 && !std::exchange(told, true)) pipe.tell("terminated", json::object(), {});
    if (terminations > 1) return;
  }
}

}  // namespace

int serve(const std::string& samples, const std::function<std::unique_ptr<Worker>(Events&)>& make) {
  on_termination([](int signal) { count_termination(terminations, signal); });
  // Where the caller has closed standard error, the next file that is opened would be it.
  if (fcntl(STDERR_FILENO, F_GETFD) < 0) open("/dev/null", O_WRONLY);
  // Whatever a middleware prints must not get between the frames.
  const int out = fcntl(STDOUT_FILENO, F_DUPFD_CLOEXEC, 3);
  dup2(STDERR_FILENO, STDOUT_FILENO);

  static std::atomic<int> code{0};
  std::signal(SIGALRM, [](int) { _exit(code); });
  {
    EventPipe pipe(STDIN_FILENO, out);
    const auto fail = [&](int exit, const std::string& message, bool unanswered = false) {
      code = exit;
      try {
        pipe.tell("failed", {{"exit", exit}, {"message", message}, {"unanswered", unanswered}}, {});
      } catch (const Broken&) {  // the coordinator is gone
      }
    };
    std::unique_ptr<Worker> worker;
    try {
      pipe.tell("hello", {{"version", ONTIME_VERSION}, {"samples", samples}}, {});
      pipe.start_beating();
      worker = make(pipe);
      obey_all(pipe, *worker);
    } catch (const Broken&) {
      // The coordinator is gone. What we changed is taken back as for any end.
    } catch (const Unanswered& error) {
      fail(error.exit, error.what(), true);
    } catch (const Error& error) {
      fail(error.exit, error.what());
    } catch (const std::exception& error) {
      fail(3, words_of(error));
    }
    try {
      pipe.tell("left", {{"notes", worker ? worker->give_back() : std::vector<std::string>()}}, {});
    } catch (const Broken&) {  // no process reads it any more
    }
    alarm(patience_to_leave_s);
  }
  return code;
}

}  // namespace ontime::orders
