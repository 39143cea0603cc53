// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cerrno>
#include <chrono>
#include <condition_variable>
#include <csignal>
#include <exception>
#include <filesystem>
#include <functional>
#include <future>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <system_error>
#include <thread>
#include <utility>

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include "record/database.hpp"
#include "record/document.hpp"
#include "record/format.hpp"
#include "record/record.hpp"

namespace ontime::record {
namespace {

// Half of what a kill -9 may cost, so that a commit that takes its time is still within it.
constexpr std::chrono::milliseconds commit_interval{500};

// 350 MB: of 100 Hz half a day.
constexpr std::size_t most_waiting = 4'000'000;
// What a file that is bounded takes for one. What waits is written at once, before there is room for it, to
// the log and to the file: so no more waits than a thirty-second of such a file.
constexpr std::uint64_t bytes_a_sample = 40, file_to_waiting = 32;

}  // namespace

// The thread that waits for the disk, and what waits for it.
class Writer::Thread {
 public:
  Thread(const std::string& path, const std::optional<struct stat>& made)
      : database_(path, made), thread_([this] { work(); }) {}
  ~Thread() {
    {
      const std::lock_guard lock(mutex_);
      ends_ = true;
    }
    changed_.notify_all();
    thread_.join();
  }
  Thread(const Thread&) = delete;
  Thread& operator=(const Thread&) = delete;

  // Hands over what `add` adds to the batch. Throws what failed of what was handed over before.
  template <class Add>
  void hand_over(std::size_t samples, Add add) {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [this] { return waiting_ < most_waiting_ || failure_; });
    throw_failure();
    const bool is_first = !batch_;
    add(batch_ ? *batch_ : batch_.emplace());
    waiting_ += samples;
    if (is_first || is_much()) changed_.notify_all();
  }

  // What `job` makes of the database, once all that was handed over is in it.
  template <class Job>
  auto ask(Job job) {
    const auto task = std::make_shared<std::packaged_task<decltype(job(database_))()>>([&] {
      write_batch();
      return job(database_);
    });
    auto answer = task->get_future();
    {
      const std::lock_guard lock(mutex_);
      question_ = [task] { (*task)(); };
    }
    changed_.notify_all();
    return answer.get();
  }

  void keep_worst(std::uint64_t bytes) {
    ask([bytes](Database& database) { database.keep_worst(bytes); });
    const std::lock_guard lock(mutex_);
    most_waiting_ = std::clamp<std::uint64_t>(bytes / file_to_waiting / bytes_a_sample, 2, most_waiting);
  }

  [[noreturn]] void refuse(const std::string& what) const {
    throw Error(fmt::format("{}: {}.", database_.connection()->name(), what));
  }
  void require_open(std::int64_t run, const char* purpose) const {
    if (!open_runs.contains(run)) refuse(fmt::format("cannot {}: run {} is not open", purpose, run));
  }
  void require(std::int64_t run, const char* purpose) {
    if (!open_runs.contains(run) && !ask([&](Database& database) { return database.has_run(run); }))
      refuse(fmt::format("cannot {}: it has no run {}", purpose, run));
  }
  std::string checked_text_of(const nlohmann::json& value) const {
    auto text = text_of(value);
    if (json_of(text)) return text;
    refuse("the record of a run is too long or too deeply nested to be read back");
  }

  Reader reader() const { return Reader(database_.connection()); }
  bool has_moved() const { return database_.has_moved(); }

  std::set<std::int64_t> open_runs;  // the caller's

 private:
  void work() {
    sigset_t all;  // signals are for the threads that were there before
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, nullptr);
    std::unique_lock lock(mutex_);
    for (bool last = false; !last;) {
      const auto wanted = [this] { return ends_ || question_; };
      changed_.wait(lock, [&] { return wanted() || batch_; });
      changed_.wait_until(lock, written_at_ + commit_interval, [&] { return wanted() || is_much(); });
      const auto question = std::exchange(question_, nullptr);
      last = ends_;
      lock.unlock();
      std::exception_ptr failure;
      try {
        question ? question() : write_batch();
      } catch (...) {
        failure = std::current_exception();
      }
      lock.lock();
      if (failure) {  // and what was handed over since is given up with it: no gap in the middle
        take_batch();
        failure_ = failure;
      }
      changed_.notify_all();
    }
  }

  void write_batch() {
    std::unique_lock lock(mutex_);
    throw_failure();
    const auto batch = take_batch();
    lock.unlock();
    if (batch) database_.add(*batch);
    written_at_ = std::chrono::steady_clock::now();
  }

  bool is_much() const { return waiting_ >= most_waiting_ / 2; }

  std::optional<Batch> take_batch() {
    waiting_ = 0;
    return std::exchange(batch_, std::nullopt);
  }

  void throw_failure() {
    if (failure_) std::rethrow_exception(std::exchange(failure_, nullptr));
  }

  Database database_;                                                                    // of the thread
  std::chrono::steady_clock::time_point written_at_ = std::chrono::steady_clock::now();  // the same
  std::mutex mutex_;
  std::condition_variable changed_;
  std::optional<Batch> batch_;
  // Size of the batch, in samples: a note or an outcome counts as the samples that need as much memory.
  std::size_t waiting_ = 0;
  std::size_t most_waiting_ = most_waiting;
  std::function<void()> question_;
  std::exception_ptr failure_;
  bool ends_ = false;
  std::thread thread_;
};

std::string lone_log(const std::string& path) {
  std::error_code ignored;
  auto log = path + "-wal";
  const bool is_lone = !path.empty() && !std::filesystem::exists(path, ignored) &&
                       std::filesystem::is_regular_file(log, ignored) &&
                       std::filesystem::file_size(log, ignored) > 0;
  return is_lone ? log : "";
}

Writer::Writer(const std::string& path) : path_(path) {
  std::error_code ignored;
  // Else SQLite removes it, and with it the whole run of a killed Writer.
  if (const auto log = lone_log(path); !log.empty())
    throw WrongFile(fmt::format(
        "{}: {} is the log of a results file that was renamed or removed, with its newest samples. "
        "Fix: rename it with that file (NAME-wal), or remove it",
        path, log));
  // Before SQLite does, which would make it wherever a link to nothing leads.
  const int file = path.empty() ? -1 : ::open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0644);
  std::optional<struct stat> made;
  if (file >= 0) {
    if (::fstat(file, &made.emplace()) != 0) made.reset();
    ::close(file);
  } else if (!path.empty() && errno == EEXIST && !std::filesystem::is_regular_file(path, ignored)) {
    throw WrongFile(fmt::format("{}: it exists, but is not a file. Choose another name.", path));
  }
  try {
    thread_ = std::make_unique<Thread>(path, made);
  } catch (const Error&) {
    if (made && is_at(path, *made) && std::filesystem::file_size(path, ignored) == 0)
      std::filesystem::remove(path, ignored);
    throw;
  }
}

Writer::~Writer() = default;
Writer::Writer(Writer&&) noexcept = default;
Writer& Writer::operator=(Writer&&) noexcept = default;

std::int64_t Writer::begin_run(const nlohmann::json& asked) {
  const auto text = thread_->checked_text_of(asked);
  const auto key = key_of(*json_of(text));
  const auto run = thread_->ask([&](Database& database) { return database.begin_run(text, key); });
  thread_->open_runs.insert(run);
  return run;
}

void Writer::append(std::int64_t run, std::span<const roundtrip::Sample> samples) {
  thread_->require_open(run, "add samples");
  for (const auto& sample : samples)
    if (!can_be(sample) || static_cast<std::int64_t>(sample.index) < 0)
      thread_->refuse(fmt::format("message {} of run {} has impossible times", sample.index, run));
  if (samples.empty()) return;
  thread_->hand_over(samples.size(),
                     [&](Batch& batch) { batch.samples[run].emplace_back(samples.begin(), samples.end()); });
}

void Writer::note(std::int64_t run, const Note& note) {
  thread_->require(run, "add a note");
  if (!can_be(note.at_ns.value_or(0)) || static_cast<std::int64_t>(note.message.value_or(0)) < 0)
    thread_->refuse(fmt::format("a note of run {} has an impossible time or message", run));
  // The words of a cause are its text again, with and without details.
  thread_->hand_over(1 + note.text.size() * (note.cause ? 3 : 1) / bytes_a_sample,
                     [&](Batch& batch) { batch.notes.emplace_back(run, note); });
}

void Writer::trace(std::int64_t run, const Trace& trace) {
  thread_->require(run, "add a trace");
  const auto& span = trace.window.span;
  if (static_cast<std::int64_t>(span.message) < 0 || !can_be(span.from_ns) || !can_be(span.to_ns))
    thread_->refuse(fmt::format("a trace of run {} has an impossible message", run));
  thread_->hand_over(0, [&](Batch& batch) { batch.traces.emplace_back(run, trace); });
}

void Writer::end_run(std::int64_t run, const nlohmann::json& outcome) {
  thread_->require_open(run, "end a run");
  const auto text = thread_->checked_text_of(outcome);
  thread_->ask([&](Database& database) { database.end_run(run, text); });
  thread_->open_runs.erase(run);
}

void Writer::note_outcome(std::int64_t run, const nlohmann::json& outcome) {
  thread_->require_open(run, "add an outcome");
  auto text = thread_->checked_text_of(outcome);
  thread_->hand_over(text.size() / bytes_a_sample,
                     [&](Batch& batch) { batch.outcomes[run] = std::move(text); });
}

void Writer::keep_worst(std::uint64_t bytes) {
  thread_->keep_worst(bytes);
  most_bytes_ = bytes;
}

bool Writer::has_moved() const { return thread_->has_moved(); }

// First closed, because what lies beside it has the names of what will lie beside the new one.
void Writer::begin_anew() {
  thread_.reset();
  struct stat there {};
  if (::lstat(path_.c_str(), &there) == 0 && (!S_ISREG(there.st_mode) || there.st_uid != ::geteuid()))
    throw WrongFile(fmt::format("{}: it is no file of this user. Remove it.", path_));
  Writer next(path_);
  if (most_bytes_ > 0) next.keep_worst(most_bytes_);
  *this = std::move(next);
}

void Writer::forget_run(std::int64_t run) {
  thread_->ask([&](Database& database) { database.forget_run(run); });
  thread_->open_runs.erase(run);
}

void Writer::flush() {
  thread_->ask([](Database&) {});
}

Reader Writer::reader() {
  flush();
  return thread_->reader();
}

std::int64_t copy_run(const Reader& from, const Run& run, Writer& to) {
  constexpr std::size_t at_once = 4096;
  const auto number = to.begin_run(run.asked.document);
  std::vector<roundtrip::Sample> samples;
  const auto hand_over = [&] {
    to.append(number, samples);
    samples.clear();
  };
  from.each_sample(run.number, [&](const roundtrip::Sample& sample) {
    samples.push_back(sample);
    if (samples.size() == at_once) hand_over();
  });
  hand_over();
  for (const auto& note : from.notes(run.number)) to.note(number, note);
  from.each_trace(run.number, [&](const Trace& trace) { to.trace(number, trace); });
  if (run.outcome.has_ended())
    to.end_run(number, run.outcome.document);
  else if (!run.outcome.document.is_null())
    to.note_outcome(number, run.outcome.document);
  return number;
}

}  // namespace ontime::record
