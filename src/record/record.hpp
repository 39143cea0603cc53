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
// hosts, conditions). A run that was cut off has samples, but no outcome.
struct Run {
  std::int64_t number = 0;  // from 1, in order of start
  Asked asked;
  Outcome outcome;
  // Hash of what was requested, without repetition, title, versions, command line …: the same conditions have
  // the same key, in every file and on every machine.
  std::string key;
};

// The input of the key, in one form for all versions.
nlohmann::json conditions_of(const nlohmann::json& asked);
std::string key_of(const nlohmann::json& asked);

// A member of a document that may be of another program: null where it is not there.
const nlohmann::json& at(const nlohmann::json& object, std::string_view key);

// Something that happened in a run: at a moment, or to one message, or both.
struct Note {
  std::string kind;                      // "peer-left", "second-pong" …: a word for programs
  std::string text;                      // for people
  std::optional<std::int64_t> at_ns;     // CLOCK_MONOTONIC of the client, ±2^60 at most
  std::optional<std::uint64_t> message;  // its index
};

// The kind of a note that says why a message was late, of a run of `ontime listen`.
inline constexpr const char* cause_of_late = "cause";

// What the kernel of a machine did around one of the messages.
struct Trace {
  std::string host;      // "controller", "component": whose machine; where both are one, the controller's
  trace::Window window;  // by the clock of that machine
  nlohmann::json way{};  // of a robot's own message: what `ontime listen` saw of its way; else null
};

// A run that keeps the worst of its messages only (Asked::keeps_worst()) has, for each with a trace, the
// samples of so many before it and after it.
inline constexpr std::int64_t samples_around = 16;

// What waits for the disk does so on a thread of the Writer's own. begin_run(), end_run(), flush(), reader()
// and the destructor wait for it; append() and note() of a run under way do not, however long the disk stalls
// (or until four million samples wait, or, in a file that is bounded, what takes a sixteenth of it). They
// throw what became of what was appended before.
class Writer {
 public:
  // Creates the file, or adds runs to one that is there; one of an older format becomes one of this. An empty
  // path: a temporary file that goes with the Writer. Throws if it is not a results file, is from a newer
  // version, cannot be written, or another Writer has it open.
  explicit Writer(const std::string& path);
  ~Writer();  // leaves one file, nothing beside it; and none, if it created it and there was no run
  Writer(Writer&&) noexcept;
  Writer& operator=(Writer&&) noexcept;

  std::int64_t begin_run(const nlohmann::json& asked);
  // In order of index; one that is there already is replaced (a message given up as lost, whose answer was in
  // time after all). Durable against kill -9 once flush() has returned, or a second has passed in which the
  // disk did not stall. Throws for a sample that cannot be: with times beyond ±2^60 ns, with an answer and
  // lost, answered before it was sent, or of no fate.
  void append(std::int64_t run, std::span<const roundtrip::Sample> samples);
  void note(std::int64_t run, const Note&);    // also of a run that has ended
  void trace(std::int64_t run, const Trace&);  // of ended runs, too; replaces the one that is there
  // What stands until the run ends, and if it is cut off. Does not wait for the disk.
  void note_outcome(std::int64_t run, const nlohmann::json& outcome);
  void end_run(std::int64_t run, const nlohmann::json& outcome);
  void forget_run(std::int64_t run);  // as if it had never begun; so goes a file made for it alone
  void flush();
  // From now on the file, with what lies beside it, takes no more than so many bytes. What goes for it are
  // messages with a trace, of runs that keep the worst only: the least bad first, each with its notes and the
  // samples around it. Also the oldest of these runs, where there are more than one for each 64 KiB.
  // Throws if all else in the file takes more.
  void keep_worst(std::uint64_t bytes);

  // Of what was appended before, which it flushes; for a temporary file the only way to it.
  class Reader reader();

 private:
  class Thread;
  std::unique_ptr<Thread> thread_;
};

// Whether another process has a Writer on the file. Not to be asked by one that has the file open itself,
// whose locks would be given up by it.
bool is_being_written(const std::string& path);

// Of files of all formats until now. One that is not what it says (of another program, damaged, or made
// to mislead) ends in WrongFile; texts are valid UTF-8, but may hold any character.
class Reader {
 public:
  explicit Reader(const std::string& path);                            // never changes the file
  std::vector<Run> runs(std::optional<std::int64_t> from = {}) const;  // from this number on; nothing: all
  std::vector<Note> notes(std::int64_t run) const;  // in the order in which they were written
  // Each trace of a run, in order of its message. Memory does not grow with their number.
  void each_trace(std::int64_t run, const std::function<void(const Trace&)>&) const;
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
// which it returns. A run without an outcome has none in the copy either, which began when it was copied.
std::int64_t copy_run(const Reader& from, const Run&, Writer& to);

}  // namespace ontime::record
