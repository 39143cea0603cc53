// SPDX-License-Identifier: Apache-2.0
// RTPS datagrams of one capture become flows: a writer's messages as they pass the point of capture. Pure;
// memory is bounded by most_writers.
#pragma once

#include <deque>
#include <map>
#include <set>
#include <string>
#include <tuple>
#include <vector>

#include "listen/listen.hpp"
#include "listen/misses.hpp"
#include "listen/packets.hpp"
#include "listen/rows.hpp"
#include "listen/rtps.hpp"
#include "listen/sequence.hpp"

namespace ontime::listen {

class Wire {
 public:
  static constexpr std::size_t most_writers = 1024, most_names = 16384, most_ways = 16;

  // `sees_gaps`: of numbers that a writer leaves out, a GAP or a HEARTBEAT tells. Else they are lost at once.
  explicit Wire(const Limits& limits, bool sees_gaps = true) : limits_(limits), sees_gaps_(sees_gaps) {}
  // at_ns: CLOCK_REALTIME of the capture. In order of capture.
  void add(std::int64_t at_ns, const Datagram&);
  // One message, of any source.
  void add(std::int64_t at_ns, const Datagram&, const rtps::Data&);
  void name_topic(const rtps::Guid& writer, const std::string& dds_topic);
  // Packets before the next one are missing: no loss and no period is counted across the gap.
  void interrupt();
  // The same where the clock was set, which has shown these times since: silence counts from then on.
  void set_clock(std::int64_t from_ns, std::int64_t until_ns);
  // No packet follows: what is missing now is lost, and has its row.
  void end();
  Findings findings() const;
  void keep_rows(KeepRow keep) { keep_row_ = std::move(keep); }
  std::vector<Miss> take_misses() { return misses_.take(); }

 private:
  struct Partial {  // a message with missing fragments
    std::uint64_t sequence = 0;
    std::vector<bool> seen;
    std::uint32_t count = 0;
  };
  using Way = std::tuple<std::string, std::string, std::uint32_t>;  // destination, source, interface
  struct Hole {  // numbers without a message, between the stamps of two messages
    std::uint64_t first, last;
    std::int64_t before_ns, after_ns;
  };
  struct Stream : Flow {  // of a writer
    Rows rows;
    std::deque<Hole> holes;  // whose losses have no rows yet: it is not decided which of them are lost
    std::uint64_t last_stamped = 0;  // the largest number of a message with an age, and its stamp
    std::int64_t last_stamp_ns = 0;
    std::int64_t latest_stamp_ns = 0;  // of all; 0: unknown
    bool is_broken = false;
    // A reader was announced since the latest number: numbers until the next one may have had no reader.
    bool has_new_reader = false;
    std::uint64_t before_reader = 0;  // the next number when that reader was announced
    Sequence sequence;
    std::uint64_t last_seen = 0;  // the largest number of a message that arrived
    std::map<Way, Sequence> ways;
    bool is_one_host = false;
    std::deque<Partial> partial;  // in order of arrival
  };
  void note(const rtps::Endpoint&);
  static void expect_reader(Stream&);
  Stream* stream_of(const rtps::Guid&);
  static bool began_again(const Stream&, const rtps::Data&);
  void restart(Stream&);
  void resume(Stream&, std::uint64_t number);
  static void pass_over_before(Stream&, std::uint64_t number);
  static bool completes(Stream&, const rtps::Data&);
  static bool is_under_way(const Stream&);
  static Partial& partial_of(Stream&, std::uint64_t sequence, std::uint32_t fragments);
  void judge(Stream&, std::int64_t at_ns, const rtps::Data&);
  // Of those holes for which is_decided() is true, the oldest first.
  template <class IsDecided>
  void keep_losses(Stream&, IsDecided);
  void keep_all_losses(Stream&);
  void miss(Miss::Kind, std::int64_t at_ns, std::int64_t value_ns, const rtps::Guid&, const Stream&);
  std::string topic_of(const rtps::Guid&) const;

  const Limits limits_;
  const bool sees_gaps_;
  std::map<rtps::Guid, std::string> topics_;
  std::set<rtps::Guid> readers_;  // announced
  std::map<rtps::Guid, Stream> streams_;
  Misses misses_;
  KeepRow keep_row_;
  std::uint64_t cut_ = 0, left_out_ = 0;
};

}  // namespace ontime::listen
