// SPDX-License-Identifier: Apache-2.0
// A coordinator and its workers, agents and keepers: each a process of the same program at the other end of a
// pipe, here or (through ssh) on another machine. Ordinary threads only.
//
// An order is a frame with "order" in its message, an event one with "event". A worker's first event is hello
// {version, samples}; if it cannot go on it sends failed {exit, message, unanswered}; its last event is left
// {notes}, once it has restored what it changed. Both send "beat" every beat_period, a worker with what it is
// doing. After longest_silence the coordinator gives up a worker and reports its name; a worker without
// coordinator restores what it changed and leaves.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include <nlohmann/json.hpp>

#include "orders/frames.hpp"

namespace ontime::orders {

// What this machine, or another, could not do; `exit` is what ontime exits with: 2 wrong input, 3 this
// machine or a peer cannot.
struct Error : std::runtime_error {
  Error(int code, const std::string& message) : std::runtime_error(message), exit(code) {}
  int exit;
};
// The worker and its connection work, but its peer did not answer in time.
struct Unanswered : Error {
  explicit Unanswered(const std::string& message) : Error(3, message) {}
};

// What it says, for people; of a limit of threads or open files, which to raise.
std::string words_of(const std::exception&);

inline constexpr std::chrono::seconds longest_silence{10};
inline constexpr std::chrono::seconds beat_period{3};  // seldom, for each beat is felt by what is measured

// Calls `handler` on SIGINT, SIGTERM and SIGHUP; except those that the caller had ignored (nohup, a
// shell's &) stay ignored. Blocked ones do not stay blocked. SIGPIPE is ignored: a pipe's end shows where it
// is written.
void on_termination(void (*handler)(int));

// Counts interruptions: once, to stop and keep; twice, to leave at once.
using Interrupts = std::atomic<int>;
// For such a handler: counts the signal. A service that stops or a terminal that closes may send both SIGTERM
// and SIGHUP, at once to two threads; they count once. Only SIGINT, from a person, counts each time.
void count_termination(Interrupts&, int signal) noexcept;

// ── The worker's side

// A worker reports with this; safe from any thread.
class Events {
 public:
  virtual void tell(const char* event, nlohmann::json body = nlohmann::json::object(),
                    std::span<const std::uint8_t> bytes = {}) = 0;
  // What may take long, for people: "ending the load"; "": nothing. Every beat tells it.
  virtual void doing(const std::string& what) = 0;

 protected:
  ~Events() = default;
};

class Worker {
 public:
  virtual ~Worker() = default;
  // May throw; the coordinator is then told why, and the worker leaves.
  virtual void obey(const std::string& order, const nlohmann::json& body) = 0;
  // Called between orders: does what is due, and returns after how long to call it again.
  virtual std::chrono::milliseconds go_on() = 0;
  // Restores what it changed, before it leaves for any reason. Returns what remains changed, for people.
  virtual std::vector<std::string> give_back() noexcept = 0;
};

// Carries out orders from standard input until its end, a failure, or the coordinator's silence. A SIGTERM is
// told to the coordinator ("terminated"), which ends what is under way as long as it lives: what stops a
// service stops all its processes at once. A SIGINT after it ends this one. Returns the exit code.
int serve(const std::string& samples, const std::function<std::unique_ptr<Worker>(Events&)>& make);

// ── The coordinator's side

struct Interrupted {};  // more often than was tolerated

// For a worker that is started through another program (a shell, ssh).
struct Between {
  std::vector<std::uint8_t> ahead;  // what that program reads before the worker reads its orders
  // Why the worker did not start, for people, from the exit code (-1: it was killed, or still runs) and from
  // output that is not an event ("": none). Returns "" if unknown.
  std::function<std::string(int code, const std::string& said)> reason;
  std::string shown{};  // the command as the user knows it; "": as it is
};

class Process;

// One loop over all workers: every event is awaited, handled, or an error; none is dropped.
class Coordinator {
 public:
  explicit Coordinator(Interrupts&);  // a worker that was terminated counts as an interruption
  Coordinator(const Coordinator&) = delete;
  Coordinator& operator=(const Coordinator&) = delete;

  // A worker that runs as long as this object lives. The destructor closes the pipe, waits until the worker
  // has left, and kills it if it does not (after longest_silence; at once if it is silent).
  class Hand {
   public:
    Hand(Coordinator&, std::string name, const std::vector<std::string>& command, const std::string& samples,
         Between = {});
    ~Hand();
    Hand(const Hand&) = delete;
    Hand& operator=(const Hand&) = delete;
    const std::string& name() const { return name_; }  // for people: "the agent of the controller"
    void order(const std::string& order, nlohmann::json body = nlohmann::json::object());
    // An order, and the event that answers it; throws as await().
    nlohmann::json ask(const std::string& order, nlohmann::json body, const std::string& answer,
                       std::chrono::milliseconds patience, int tolerated = 0);
    // `handle` is called for each event of that name from this worker, until it is set again. From another
    // worker that event is an error.
    using Handle = std::function<void(const Frame&)>;
    void on(const std::string& event, Handle handle) { handles_[event] = std::move(handle); }
    // It failed, is gone, or was given up: no order reaches it any more, and the loop goes on without it.
    bool lost() const { return lost_; }
    const std::string& doing() const { return doing_; }  // as Events::doing() last said

    // Breaks the pipe and waits until the worker has left, as long as it beats and `wait_on` (called about
    // twice a second) returns true. Nothing kills a worker that still beats.
    struct Left {
      bool gave_back = false;  // it reported that it restored everything
      bool waits = false;      // it still restores: `wait_on` returned false
      std::vector<std::string> notes{};
    };
    Left leave(const std::function<bool()>& wait_on);

   private:
    friend class Coordinator;
    void check_build(const nlohmann::json& hello) const;
    bool hear(const nlohmann::json& message);  // whether it is about the worker's state only
    Coordinator& coordinator_;
    std::string name_, samples_;
    std::unique_ptr<Process> process_;
    bool there_ = false;  // it has said hello
    std::map<std::string, Handle> handles_;
    std::vector<std::string> owed_;  // answers that are no longer awaited
    std::chrono::steady_clock::time_point heard_;
    std::string doing_;
    Left left_;
    bool lost_ = false;
  };

  // The next event of that name by that worker; meanwhile all others are handled. Throws Error for `failed`,
  // when a worker is gone, silent, or does not come to it within `patience`; Interrupted once there are more
  // interruptions than are tolerated.
  nlohmann::json await(Hand&, const std::string& event, std::chrono::milliseconds patience,
                       int tolerated = 0);
  // As above, but waits as long as the worker beats; `meanwhile` is called about twice a second.
  nlohmann::json await(Hand&, const std::string& event, const std::function<void()>& meanwhile,
                       int tolerated);
  // From now on one more interruption than before is tolerated: what is left to do must not be cut short.
  void tolerate_one_more() { ++more_tolerated_; }
  bool interrupted(int tolerated) const { return interrupts_ > tolerated + more_tolerated_; }
  // Handles events until `done`; throws as await().
  void until(const std::function<bool()>& done, int tolerated = 0);
  // Handles what has come already, whatever state its senders are in. Throws nothing.
  void drain() noexcept;

 private:
  friend class Hand;
  using Clock = std::chrono::steady_clock;
  void turn();
  void listen(Hand&);
  void dispatch(Hand&, const Frame&);
  void check_silence();
  void lose(Hand&);
  void beat(const std::stop_token&);

  Interrupts& interrupts_;
  int more_tolerated_ = 0;
  std::mutex mutex_;  // of hands_, which the beating thread reads
  std::vector<Hand*> hands_;
  Hand* awaited_ = nullptr;
  std::string awaited_event_;
  std::optional<nlohmann::json> answer_;
  std::condition_variable_any wake_;
  std::jthread beating_;  // last: it uses the rest
};

// The path of this program, with which workers on this machine are started.
std::string this_program();

}  // namespace ontime::orders
