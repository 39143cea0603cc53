// SPDX-License-Identifier: Apache-2.0
// Turns recorded messages into flows, one per topic and writer, if the bag separates writers. Pure; memory is
// bounded by most_flows.
#pragma once

#include <deque>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "bag/reader.hpp"
#include "listen/listen.hpp"
#include "listen/misses.hpp"
#include "listen/rows.hpp"
#include "listen/sequence.hpp"

namespace ontime::bag {

class Judge {
 public:
  static constexpr std::size_t most_flows = 1024;
  static constexpr std::int64_t rows_begin_ns = 1'000'000'000;  // the first message, by the rows' clock

  explicit Judge(const listen::Limits& limits, std::set<std::string> topics = {})
      : limits_(limits), topics_(std::move(topics)) {}
  void add(const Message&);
  void end_file();  // of the bag
  listen::Findings findings() const;
  std::vector<listen::Miss> take_misses() { return misses_.take(); }
  void keep_rows(listen::KeepRow keep) { keep_row_ = std::move(keep); }

 private:
  using Key = std::pair<std::string, unsigned>;  // topic and writer
  // Numbers that repeatedly go back after few messages belong to several writers.
  struct Back {
    std::uint64_t since = 0, times = 0;  // messages since the last time; how often in a row
    bool is_often();                     // it happens now
  };
  // A message whose period is not judged yet: one that was written after it may be earlier.
  struct Waiting {
    Message message;  // of the file that is read
    std::int64_t at_ns = 0;
    bool was_old = false;
  };
  struct Stream : listen::Flow {            // its times are as at_ns()
    std::int64_t before_last_ns = 0;        // of the message before the last; 0: no such message
    std::deque<Waiting> waiting;            // by time, after judged_ns
    std::deque<Waiting> behind;             // by time, before the latest: late, or the clock was set back
    std::optional<std::int64_t> judged_ns;  // until then its periods are judged; none: the next has none
    std::uint64_t times_set = 0;            // until its last message
    std::uint64_t since_back = 0;           // messages since its times went back
    std::int64_t latest_written_ns = 0;     // by stamp or publish time
    std::uint64_t in_file = 0;              // messages, of the file that is read
    std::uint64_t number_before = 0;        // of the message before that has one
    std::uint64_t counts_from = 0;          // from this number on, the numbers until now have no hole
    bool has_zero = false;                  // the writer numbers from 0: 0 is a number
    listen::Sequence sequence;              // begun once the numbers are known to be the writer's
    std::vector<std::int64_t> written_ns;   // of the latest numbers, by number modulo window; 0: unknown
    Back back;
    std::uint64_t left_at = 0;  // the next number when the numbers last began anew; 0: they did not
    bool is_mixed = false;      // of several writers: the numbers tell nothing
    listen::Rows rows;
    std::uint64_t row_number = 0;  // of the last age in `rows`
    std::optional<std::int64_t> latest_ns() const {
      return waiting.empty() ? judged_ns : waiting.back().at_ns;
    }
  };
  // Why messages have earlier times than one before them: they are late, or the recorder's clock was set
  // back.
  enum class Behind { late, clock, unknown };
  // Odd times, by the clocks of writers or of the recorder.
  struct Oddity {
    std::uint64_t messages = 0;
    std::string topic;  // of the first of them
  };
  void note(Oddity&, const std::string& topic) const;
  // The time of recording, without the steps of the recorder's clock.
  std::int64_t at_ns(const Message& message) const { return message.recorded_ns - origin_ns_; }
  Stream* stream_of(const Topic&);
  void watch_clock(Stream&, const Message&);
  void end_doubt();
  std::optional<std::int64_t> latest_of_others(const Stream*) const;
  bool is_of_file(const Stream&, std::uint64_t number);
  static bool may_be_counted(Stream&, std::uint64_t number, std::uint64_t before, std::uint64_t index,
                             bool is_of_file);
  bool is_again(Stream&, const Message&);
  void keep_age(Stream&, const Message&, std::int64_t age_ns, bool is_late);
  void judge_period(Stream&, const Message&, bool was_old);
  static void insert(std::deque<Waiting>& sorted, const Waiting&);
  static bool fills_a_gap(const Stream&, std::size_t place);  // in behind
  static Behind why_behind(const Stream&);
  void judge_behind(Stream&);
  void judge_all(Stream&);
  void judge_waiting(Stream&, std::int64_t before_ns);  // and those of which too many wait
  bool judge_age(Stream&, const Message&);              // whether it was too old
  std::optional<std::int64_t> age_of(Stream&, const Message&);
  void miss(listen::Miss::Kind, std::int64_t value_ns, const Message&, const Stream&);
  static listen::Flow flow_of(const Stream&);
  std::string remark_on_message_ahead() const;

  // The numbers of all messages of the file that is read.
  struct File {
    std::uint64_t number = 0;       // the last
    const Stream* first = nullptr;  // that it began with
    bool has_several = false, rises = true;
  };

  // One topic went back in time. at_ns() assumes that the recorder's clock was set, until a message shows
  // otherwise.
  struct Doubt {
    const Stream* stream;
    std::int64_t from_ns, by_ns;  // of its first message, by the clock before; by how much time went back
  };

  const listen::Limits limits_;
  const std::set<std::string> topics_;  // with remarks; empty: all
  File file_;
  std::map<Key, Stream> streams_;
  listen::Misses misses_;
  listen::KeepRow keep_row_;
  std::int64_t before_ns_ = rows_begin_ns;  // when the message before was recorded
  std::int64_t origin_ns_ = 0;              // of at_ns()
  std::int64_t until_ns_ = 0;               // the latest at_ns()
  std::uint64_t times_set_ = 0;             // the recorder's clock
  std::optional<Doubt> doubt_;
  std::uint64_t pauses_ = 0;  // of all topics
  std::int64_t longest_pause_ns_ = 0;
  std::uint64_t left_out_ = 0;
  Oddity timeless_, unset_, foreign_clock_, ahead_, was_set_, mixed_;
};

}  // namespace ontime::bag
