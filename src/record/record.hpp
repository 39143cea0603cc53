// SPDX-License-Identifier: Apache-2.0
// The results file: one SQLite database that holds every sample of every run and where it came from.
// sqlite3 reads it, too; docs/reference/results-file.md describes its tables. Ordinary thread only. Every
// failure throws Error, which names the file, what was found and what to do.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include <nlohmann/json.hpp>

#include "record/outcome.hpp"
#include "roundtrip/sample.hpp"
#include "trace/trace.hpp"

namespace ontime::record {

struct Error : std::runtime_error {
  using std::runtime_error::runtime_error;
};
// The file is unusable (not a results file, a newer version, damaged); the machine is fine.
struct WrongFile : Error {
  using Error::Error;
};

// A run: what was requested, and, once it has ended, its outcome without the samples (counters, threads,
// hosts, conditions). A run that was cut off has samples, but no outcome, or a preliminary one.
struct Run {
  std::int64_t number = 0;  // from 1, in order of start
  Asked asked;
  Outcome outcome;
  // Hash of what was requested, without repetition, title, versions, command line …: the same conditions have
  // the same key, in every file and on every machine.
  std::string key;
  // When its first message was due: the client's clock, as of the samples, which may begin later. Nothing: no
  // message was sent.
  std::optional<std::int64_t> start_ns{};
  std::string started_at{};  // UTC: "2026-11-21T02:07:38.181Z", as the file has it
};

// The input of the key, in one form for all versions.
nlohmann::json conditions_of(const nlohmann::json& asked);
std::string key_of(const nlohmann::json& asked);

// A member of a document that may come from another program; null if it is missing.
const nlohmann::json& at(const nlohmann::json& object, std::string_view key);

// Something that happened in a run: at a moment, or to one message, or both.
struct Note {
  std::string kind;                      // "peer-left", "second-pong" …: a word for programs
  std::string text;                      // for people
  std::optional<std::int64_t> at_ns;     // CLOCK_MONOTONIC of the client, ±2^60 at most
  std::optional<std::uint64_t> message;  // its index
  std::optional<LateCause> cause{};      // of kinds that tell of late, but for notes of an older ontime
};

// The kind of a note that says why a message was late, of a run of `ontime listen`.
inline constexpr const char* cause_of_late = "cause";
// No cause was seen.
inline constexpr const char* cause_not_seen = "cause-not-seen";
inline bool tells_of_late(const Note& note) {
  return note.kind == cause_of_late || note.kind == cause_not_seen;
}

// A machine's kernel events around one message.
struct Trace {
  std::string host;      // "controller", "component"; on one machine for both: "controller"
  trace::Window window;  // in that machine's clock
  nlohmann::json way{};  // for `ontime listen`: the observed stages of the message; else null
};

// A run that keeps only its worst messages (Asked::keeps_worst()) has, for each message with a trace, this
// many samples before it and after it.
inline constexpr std::int64_t samples_around = 16;

// A thread of the Writer writes to the disk. begin_run(), end_run(), flush(), reader() and the destructor
// wait for it. append() and note() of a current run do not wait, however long the disk stalls, until four
// million samples are queued (in a bounded file: a thirty-second of its size). They throw the errors of
// earlier writes.
class Writer {
 public:
  // Creates the file, or adds runs to an existing one; converts an older format to the current one. An empty
  // path: a temporary file that is removed with the Writer. Throws if it is not a results file, is from a
  // newer version, cannot be written, or another Writer has it open.
  explicit Writer(const std::string& path);
  ~Writer();  // leaves one file without side files; removes a file that it created if it has no run
  Writer(Writer&&) noexcept;
  Writer& operator=(Writer&&) noexcept;

  std::int64_t begin_run(const nlohmann::json& asked);
  // In order of index. A sample with an existing index replaces it (an answer to a message counted as lost
  // was in time after all). Durable against kill -9 once flush() has returned, or a second has passed in
  // which the disk did not stall. Throws for an impossible sample: with times beyond ±2^60 ns, with an answer
  // and lost, answered before it was sent, or of no fate.
  void append(std::int64_t run, std::span<const roundtrip::Sample> samples);
  void note(std::int64_t run, const Note&);    // also of a run that has ended
  void trace(std::int64_t run, const Trace&);  // also of ended runs; replaces an earlier one
  // A preliminary outcome (with `counted_until_s`), valid until the run ends or if it is cut off. Does not
  // wait for the disk.
  void note_outcome(std::int64_t run, const nlohmann::json& outcome);
  void end_run(std::int64_t run, const nlohmann::json& outcome);
  void forget_run(std::int64_t run);  // as if it had never begun; also removes a file made only for it
  void flush();
  // From now on the file with its side files takes at most `bytes`. To fit, it removes messages with a trace
  // from runs that keep only the worst: the least bad first, each with its notes and the samples around it.
  // It also removes the oldest of these runs, if there is more than one for each 64 KiB. Throws if the rest
  // of the file is larger.
  void keep_worst(std::uint64_t bytes);

  const std::string& path() const { return path_; }
  // The file was renamed, replaced or removed: its path no longer leads to it.
  bool has_moved() const;
  // Closes the file, and goes on in a new one at its path, with the same bound. No run is open then. If that
  // throws, nothing else may be called until it was called again and did not.
  void begin_anew();

  // Flushes, and reads everything appended before. The only way to read a temporary file.
  class Reader reader();

 private:
  class Thread;
  std::string path_;
  std::uint64_t most_bytes_ = 0;  // 0: no bound
  std::unique_ptr<Thread> thread_;
};

// The log of a results file that is not at this path any more: no Writer opens the path. Empty: not there.
std::string lone_log(const std::string& path);

// Whether another process has a Writer on the file, or on one that was there. Do not call it in a process
// that has the file open: it would release that process's locks.
bool is_being_written(const std::string& path);

// Reads files of all formats so far. Invalid contents (of another program, damaged, or malicious) throw
// WrongFile; texts are valid UTF-8, but may hold any character.
class Reader {
 public:
  explicit Reader(const std::string& path);                            // never changes the file
  std::vector<Run> runs(std::optional<std::int64_t> from = {}) const;  // from this number on; nothing: all
  std::vector<Note> notes(std::int64_t run) const;  // in the order in which they were written
  // Each trace of a run, in order of its message. Memory use does not depend on their number.
  void each_trace(std::int64_t run, const std::function<void(const Trace&)>&) const;
  std::int64_t number_of_samples(std::int64_t run) const;
  // Each sample of a run, in order of index. Memory does not grow with their number. Its times are as
  // append() has them, so that no difference of two overflows.
  void each_sample(std::int64_t run, const std::function<void(const roundtrip::Sample&)>& use) const {
    each_sample(run, 0, use);
  }
  // Those from this message on.
  void each_sample(std::int64_t run, std::uint64_t from,
                   const std::function<void(const roundtrip::Sample&)>&) const;

 private:
  friend class Writer;
  friend class Database;
  explicit Reader(std::shared_ptr<class Connection>);
  std::shared_ptr<class Connection> connection_;
};

// Adds a run of one results file to another: samples, notes, traces and outcome, under the next number there,
// which it returns. A run without an outcome has none in the copy either. The copy's start is the time of
// copying.
std::int64_t copy_run(const Reader& from, const Run&, Writer& to);

}  // namespace ontime::record
