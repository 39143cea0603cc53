// SPDX-License-Identifier: Apache-2.0
#include "bag/judge.hpp"

#include <algorithm>
#include <cstdlib>
#include <limits>

#include <fmt/format.h>

namespace ontime::bag {
namespace {

// A writer that skips more numbers, or goes back further than the window, restarted.
constexpr std::uint64_t longest_leap = 1 << 20;
// A stamp further from the recording is by another clock, such as simulated time.
constexpr std::int64_t one_year_ns = std::int64_t{365} * 24 * 3600 * 1'000'000'000;
// Messages of a topic are out of order by less than this. A larger step back means that the recorder's clock
// was set back, or that this topic's times are odd. A topic of few messages, such as one that each file
// repeats, tells nothing.
constexpr std::int64_t set_back_ns = 1'000'000'000;
constexpr std::uint64_t enough_to_tell = 8;
constexpr std::size_t most_waiting = 128;  // messages of a topic, to be sorted
// So few, so little behind, were swapped by the recorder's threads.
constexpr std::size_t few = 4;
constexpr std::int64_t little_ns = 20'000'000;
// After 18 years of bag time, clocks that were set back extend it no further.
constexpr std::int64_t longest_time_ns = std::int64_t{1} << 59;
// No message of any topic for this long is worth a remark.
constexpr std::int64_t long_pause_ns = 10'000'000'000;

// The largest loss of a writer that returns to its old numbers; a larger one is rare.
constexpr std::uint64_t longest_loss = 16;
constexpr auto window = listen::Sequence::window;

// 0: unknown. If the writer gave no time, the recorder stores its own time.
std::int64_t written_of(const Message& message) {
  if (message.stamp_ns) return *message.stamp_ns;
  return message.published_ns == message.recorded_ns ? 0 : message.published_ns;
}

// A bag usually merges all publishers of a topic.
listen::Party party_of(unsigned writer) {
  return {0, writer == 0 ? "publishers" : fmt::format("publishers of channel {}", writer + 1)};
}

}  // namespace

Judge::Stream* Judge::stream_of(const Topic& topic) {
  const Key key{topic.name, topic.writer};
  if (const auto found = streams_.find(key); found != streams_.end()) return &found->second;
  if (streams_.size() == most_flows) {
    ++left_out_;
    return nullptr;
  }
  auto& stream = streams_[key];
  stream.id = streams_.size();  // none is ever erased
  stream.topic = topic.name;
  stream.writer = party_of(topic.writer);
  stream.reader = {0, "recorder"};
  stream.age_unknown = stream.stamp_ahead = 0;
  stream.written_ns.resize(window);
  return &stream;
}

void Judge::add(const Message& message) {
  const auto step_ns = message.recorded_ns - std::exchange(before_ns_, message.recorded_ns);
  // A robot without a battery for its clock starts in 1970, until the network tells the time.
  if (std::abs(step_ns) > one_year_ns) {
    doubt_.reset();
    origin_ns_ += step_ns;
    ++times_set_;
  }
  auto* const stream = stream_of(*message.topic);
  if (stream == nullptr || is_again(*stream, message)) return;
  watch_clock(*stream, message);
  if (const auto pause_ns = at_ns(message) - until_ns_;
      pause_ns > long_pause_ns && streams_.size() > 1 && !doubt_) {
    ++pauses_;
    longest_pause_ns_ = std::max(longest_pause_ns_, pause_ns);
  }
  until_ns_ = std::max(until_ns_, at_ns(message));
  if (stream->messages == 0) stream->first_ns = at_ns(message);
  judge_period(*stream, message, judge_age(*stream, message));
  ++stream->messages;
  ++stream->since_back;
  stream->before_last_ns = std::exchange(stream->last_ns, at_ns(message));
  stream->times_set = times_set_;
}

// If the clock was set back, the next message of every topic goes back. So the first one that goes back
// counts as a clock that was set, until an earlier topic, or this one, continues as before: then only its own
// times were odd.
void Judge::watch_clock(Stream& stream, const Message& message) {
  const bool is_known = stream.since_back >= enough_to_tell || streams_.size() == 1;
  if (doubt_) {
    const auto by_the_old_ns = at_ns(message) - doubt_->by_ns;
    const bool can_tell =
        is_known && stream.times_set + 1 == times_set_ && stream.last_ns > doubt_->from_ns + set_back_ns;
    const bool goes_back = by_the_old_ns < stream.last_ns - set_back_ns;
    if ((can_tell && !goes_back) ||
        (doubt_->stream == &stream && by_the_old_ns >= doubt_->from_ns + doubt_->by_ns))
      return end_doubt();
    if (can_tell) doubt_.reset();
  }
  if (stream.times_set != times_set_ || at_ns(message) >= stream.last_ns - set_back_ns) return;
  stream.since_back = 0;
  const auto from_ns = at_ns(message);
  if (const auto others_ns = latest_of_others(&stream); others_ns && *others_ns <= from_ns + set_back_ns) {
    until_ns_ = std::max(*others_ns, from_ns);  // it was ahead of all others
    return;
  }
  if (!is_known || until_ns_ > longest_time_ns) return;
  stream.latest_written_ns = 0;
  doubt_.reset();
  if (streams_.size() > 1) doubt_ = {.stream = &stream, .from_ns = from_ns, .by_ns = until_ns_ - from_ns};
  origin_ns_ -= until_ns_ - from_ns;  // time goes on from where it was
  ++times_set_;
}

// The clock was not set.
void Judge::end_doubt() {
  origin_ns_ += doubt_->by_ns;
  --times_set_;
  for (auto& [key, stream] : streams_)
    if (stream.times_set > times_set_) {
      stream.last_ns -= doubt_->by_ns;
      if (stream.judged_ns) *stream.judged_ns -= doubt_->by_ns;
      for (auto& one : stream.waiting) one.at_ns -= doubt_->by_ns;
      for (auto& one : stream.behind) one.at_ns -= doubt_->by_ns;
      stream.times_set = times_set_;
    }
  until_ns_ = latest_of_others(nullptr).value_or(until_ns_);
  doubt_.reset();
}

// Of streams with a message since the clock was set, without this one; nullptr: of all.
std::optional<std::int64_t> Judge::latest_of_others(const Stream* stream) const {
  std::optional<std::int64_t> latest_ns;
  for (const auto& [key, other] : streams_)
    if (&other != stream && other.messages > 0 && other.times_set == times_set_)
      latest_ns = std::max(latest_ns.value_or(other.last_ns), other.last_ns);
  return latest_ns;
}

void Judge::end_file() {
  file_ = {};
  for (auto& [key, stream] : streams_) {
    judge_all(stream);
    stream.in_file = 0;
    if (!stream.sequence.has_begun()) stream.rows.restart();
  }
}

void Judge::note(Oddity& oddity, const std::string& topic) const {
  if (!topics_.empty() && !topics_.contains(topic)) return;
  if (oddity.messages++ == 0) oddity.topic = topic;
}

bool Judge::Back::is_often() {
  constexpr std::uint64_t near = 8;
  times = since < near ? times + 1 : 1;
  since = 0;
  return times > 3;
}

// Whether one sequence may number all messages of this file, as `mcap convert` does.
bool Judge::is_of_file(const Stream& stream, std::uint64_t number) {
  file_.rises = file_.rises && (file_.first == nullptr || number > file_.number);
  file_.number = number;
  if (file_.first == nullptr) file_.first = &stream;
  file_.has_several = file_.has_several || file_.first != &stream;
  return file_.rises && file_.has_several;
}

// A recorder may count itself instead, from 0 or 1 in each file: such numbers tell nothing until one is
// missing. Then all that were seen since the count began are the writer's.
bool Judge::may_be_counted(Stream& stream, std::uint64_t number, std::uint64_t before, std::uint64_t index,
                           bool is_of_file) {
  const bool begins = index == 0 && number <= 1, goes_on = index > 0 && number == before + 1;
  if (is_of_file || begins || (goes_on && number <= index + 1)) {
    if (!goes_on) stream.counts_from = number;
    return true;
  }
  if (before != 0 || stream.has_zero)
    for (auto seen = std::max(stream.counts_from, before - std::min(before, window - 1)); seen <= before;
         ++seen)
      stream.sequence.see(seen);
  return false;
}

// Follows the writer's numbers, if the bag has them. 0 stands for none, unless the topic begins with it.
bool Judge::is_again(Stream& stream, const Message& message) {
  auto& sequence = stream.sequence;
  const std::uint64_t number = message.sequence, index = stream.in_file++;
  const bool is_of_file = this->is_of_file(stream, number);
  if (index == 1 && !sequence.has_begun() && (number == 0) != (stream.number_before == 0))
    stream.has_zero = stream.has_zero || std::max(number, stream.number_before) <= longest_loss;
  const bool may_be_number = number != 0 || stream.has_zero || (index == 0 && !sequence.has_begun());
  if (stream.is_mixed || !may_be_number) return false;
  const auto before = std::exchange(stream.number_before, number);
  if (!sequence.has_begun() && may_be_counted(stream, number, before, index, is_of_file)) {
    stream.written_ns[number % window] = written_of(message);
    return false;
  }
  const auto next = sequence.next();
  const auto written_ns = written_of(message);
  const auto latest_ns = stream.written_ns[(next - 1) % window];
  const auto known_ns = std::exchange(stream.written_ns[number % window], written_ns);
  bool begins_anew = number > next + longest_leap, is_mixed = false;
  if (sequence.has_begun() && number < next) {
    if (written_ns != 0 && written_ns == known_ns) {
      ++stream.duplicated;
      return true;
    }
    const bool has_times = written_ns != 0 && latest_ns != 0;
    begins_anew = has_times ? written_ns >= latest_ns : !sequence.is_missing(number);
    if (begins_anew || !has_times) is_mixed = stream.back.is_often();
  } else {
    // A restarted writer counts on from there; a second writer continues at its own number.
    is_mixed = next < stream.left_at && number > next + longest_loss && number >= stream.left_at &&
               number <= stream.left_at + window;
    ++stream.back.since;
  }
  if (is_mixed) {
    note(mixed_, message.topic->name);
    stream.is_mixed = true;
    stream.reordered = 0;
    sequence = {};
    stream.rows.restart();
    return false;
  }
  if (begins_anew && sequence.has_begun()) {
    stream.left_at = next;
    sequence.restart();
    stream.rows.restart();
  }
  using Fate = listen::Sequence::Fate;
  const auto fate = sequence.see(number);
  if (fate == Fate::too_old) stream.rows.restart();
  if (fate != Fate::in_order) ++stream.reordered;
  return false;
}

void Judge::insert(std::deque<Waiting>& sorted, const Waiting& one) {
  sorted.insert(std::ranges::upper_bound(sorted, one.at_ns, {}, &Waiting::at_ns), one);
}

// Judges periods in the order of the times of recording: messages wait to be sorted. Those behind the latest
// wait apart, until one goes on from there.
void Judge::judge_period(Stream& stream, const Message& message, bool was_old) {
  const Waiting one{.message = message, .at_ns = at_ns(message), .was_old = was_old};
  if (stream.messages > 0 && stream.times_set != times_set_) {
    judge_all(stream);
    stream.judged_ns.reset();
    note(was_set_, message.topic->name);
  }
  if (const auto latest_ns = stream.latest_ns(); latest_ns && one.at_ns < *latest_ns) {
    insert(stream.behind, one);
    if (stream.behind.size() > most_waiting) judge_behind(stream);
    return;
  }
  judge_behind(stream);
  insert(stream.waiting, one);
  judge_waiting(stream, one.at_ns - set_back_ns);
}

// Whether this message behind lies where one is missing, beside those behind before it.
bool Judge::fills_a_gap(const Stream& stream, std::size_t place) {
  const auto& waiting = stream.waiting;
  const auto at_ns = stream.behind[place].at_ns;
  if (at_ns < stream.judged_ns) return false;  // unknown
  const auto next = std::ranges::upper_bound(waiting, at_ns, {}, &Waiting::at_ns);
  auto before_ns = next != waiting.begin() ? std::prev(next)->at_ns : stream.judged_ns;
  if (place > 0) before_ns = std::max(before_ns, std::optional(stream.behind[place - 1].at_ns));
  return !before_ns || next->at_ns - *before_ns > stream.period.quantile_ns(0.9) * 3 / 2;
}

// A clock that was set back repeats times: messages lie among earlier ones. Late messages lie together, where
// some are missing, or apart, each where one is missing.
Judge::Behind Judge::why_behind(const Stream& stream) {
  const auto &behind = stream.behind, &waiting = stream.waiting;
  const auto judged_ns = stream.judged_ns;
  const auto latest_ns = *stream.latest_ns(), usual_ns = stream.period.quantile_ns(0.5) * 3 / 2;
  const bool are_few = behind.size() <= few;
  if (behind.size() > most_waiting) return Behind::clock;
  if (are_few && latest_ns - behind.front().at_ns < little_ns) return Behind::late;
  std::size_t steps = 0, among = 0;  // among: with an earlier message between
  for (std::size_t i = 1; i < behind.size(); ++i) {
    const auto from_ns = behind[i - 1].at_ns, to_ns = behind[i].at_ns;
    if (judged_ns && to_ns <= *judged_ns) continue;  // unknown
    const auto next = std::ranges::lower_bound(waiting, from_ns, {}, &Waiting::at_ns);
    ++steps;
    if ((judged_ns && from_ns <= *judged_ns) || (next != waiting.end() && next->at_ns < to_ns)) ++among;
  }
  if (4 * among < steps) return Behind::late;
  std::size_t filling = 0;
  if (behind.size() == 1 || stream.period.count() >= enough_to_tell)
    while (filling < behind.size() && fills_a_gap(stream, filling)) ++filling;
  if (filling == behind.size()) return Behind::late;
  // A clock that was set back reaches the latest time step by step.
  const bool goes_on = latest_ns - behind.back().at_ns <= usual_ns;
  return goes_on || (steps > 0 && !are_few) ? Behind::clock : Behind::unknown;
}

void Judge::judge_behind(Stream& stream) {
  if (stream.behind.empty()) return;
  const auto why = why_behind(stream);
  const auto behind = std::exchange(stream.behind, {});
  const auto& name = behind.front().message.topic->name;
  auto& waiting = stream.waiting;
  if (why == Behind::clock) {
    judge_all(stream);
    stream.judged_ns.reset();
    note(was_set_, name);
    waiting = behind;
    return;
  }
  for (const auto& one : behind) {
    // Numbers and times of writing tell the order better.
    if (!stream.sequence.has_begun() && stream.latest_written_ns == 0) ++stream.reordered;
    if (why == Behind::unknown || one.at_ns < stream.judged_ns) {  // no period, and it ends none
      note(was_set_, name);
      stream.late += one.was_old ? 1 : 0;
    } else {
      insert(waiting, one);
    }
  }
}

void Judge::judge_all(Stream& stream) {
  judge_behind(stream);
  judge_waiting(stream, std::numeric_limits<std::int64_t>::max());
}

void Judge::judge_waiting(Stream& stream, std::int64_t before_ns) {
  auto& waiting = stream.waiting;
  while (waiting.size() > most_waiting || (!waiting.empty() && waiting.front().at_ns < before_ns)) {
    const auto one = waiting.front();
    waiting.pop_front();
    const auto from_ns = std::exchange(stream.judged_ns, one.at_ns);
    const bool is_late = from_ns && limits_.is_gap(one.at_ns - *from_ns);
    if (is_late) miss(listen::Miss::Kind::gap, one.at_ns - *from_ns, one.message, stream);
    if (from_ns) listen::add_period(stream.period, keep_row_, stream.id, *from_ns, one.at_ns, is_late);
    stream.late += is_late || one.was_old ? 1 : 0;
  }
}

bool Judge::judge_age(Stream& stream, const Message& message) {
  const auto age = age_of(stream, message);
  if (!age) {
    ++*stream.age_unknown;
    return false;
  }
  if (!stream.age) stream.age.emplace();
  const bool is_late = limits_.is_too_old(*age);
  if (is_late) miss(listen::Miss::Kind::age, *age, message, stream);
  keep_age(stream, message, *age, is_late);
  stream.age->add(*age);
  return is_late;
}

void Judge::keep_age(Stream& stream, const Message& message, std::int64_t age_ns, bool is_late) {
  const std::uint64_t number =
      (message.sequence != 0 || stream.has_zero) && !stream.is_mixed ? message.sequence : stream.age->count();
  const auto before = std::exchange(stream.row_number, number);
  // Numbers that start again, as a recorder's own do in each file, belong to other messages.
  const bool begins_again = number <= before && !stream.sequence.has_begun();
  if (begins_again || number > before + longest_leap) stream.rows.restart();
  const auto to_ns = at_ns(message);
  stream.rows.age(keep_row_,
                  {.flow = stream.id, .from_ns = to_ns - age_ns, .to_ns = to_ns, .is_late = is_late}, number,
                  [&](std::uint64_t other) { return stream.sequence.is_missing(other) ? to_ns : 0; });
}

std::optional<std::int64_t> Judge::age_of(Stream& stream, const Message& message) {
  const auto& name = message.topic->name;
  const auto written_ns = written_of(message);
  if (written_ns == 0) {
    note(message.stamp_ns ? unset_ : timeless_, name);
    return {};
  }
  stream.age_from = message.stamp_ns ? listen::AgeFrom::stamp : listen::AgeFrom::publish;
  // Without numbers, the times of writing tell the order, if they are by one clock, which was not set.
  if (std::abs(written_ns - stream.latest_written_ns) > one_year_ns || stream.times_set != times_set_)
    stream.latest_written_ns = written_ns;
  if (!stream.sequence.has_begun() && written_ns < stream.latest_written_ns) ++stream.reordered;
  stream.latest_written_ns = std::max(stream.latest_written_ns, written_ns);
  const auto age = message.recorded_ns - written_ns;
  if (std::abs(age) > one_year_ns) {
    note(foreign_clock_, name);
    return {};
  }
  if (age < 0) {
    note(ahead_, name);
    ++*stream.stamp_ahead;
  }
  return age;
}

void Judge::miss(listen::Miss::Kind kind, std::int64_t value_ns, const Message& message,
                 const Stream& stream) {
  misses_.add({.kind = kind,
               .at_ns = message.recorded_ns,
               .value_ns = value_ns,
               .topic = stream.topic,
               .writer = stream.writer,
               .reader = stream.reader,
               .flow = stream.id});
}

listen::Flow Judge::flow_of(const Stream& stream) {
  listen::Flow flow = stream;
  // The last two may be swapped. A time far ahead is odd.
  const auto latest_ns = stream.latest_ns().value_or(stream.last_ns);
  if (latest_ns > stream.last_ns && latest_ns <= stream.last_ns + set_back_ns) flow.last_ns = latest_ns;
  if (stream.sequence.has_begun()) flow.lost = stream.sequence.lost();
  return flow;
}

// All topics but one count as silent until its last message. Empty: it is not far from the others, or not
// alone.
std::string Judge::remark_on_message_ahead() const {
  const auto latest =
      std::ranges::max_element(streams_, {}, [](const auto& one) { return one.second.last_ns; });
  if (latest == streams_.end()) return "";
  const auto others_ns = latest_of_others(&latest->second);
  if (!others_ns || latest->second.last_ns - *others_ns <= long_pause_ns ||
      latest->second.before_last_ns > *others_ns + set_back_ns)
    return "";
  return fmt::format(
      "the last message of {} is {:.0f} s later than all other topics: these count as silent for that time. "
      "Check the time of that message",
      latest->first.first, static_cast<double>(latest->second.last_ns - *others_ns) / 1e9);
}

listen::Findings Judge::findings() const {
  listen::Findings findings;
  findings.misses_left_out = misses_.left_out();
  for (const auto& [key, stream] : streams_) findings.flows.push_back(flow_of(stream));
  listen::judge_silence(findings.flows, limits_, until_ns_);
  const auto remark = [&](const Oddity& oddity, const char* what) {
    if (oddity.messages > 0)
      findings.remarks.push_back(fmt::format("{} message{} {} (first topic: {})", oddity.messages,
                                             oddity.messages == 1 ? "" : "s", what, oddity.topic));
  };
  // rosbag2 notes the time of recording as publish time where the middleware gives none: no age begins there.
  if (limits_.age)
    remark(timeless_,
           "without header.stamp and publish time, or with one equal to the recording: age unknown");
  remark(unset_, "with a header.stamp of 0: age unknown");
  remark(foreign_clock_,
         "with a stamp more than a year from the recording, by another clock, such as simulated time: age "
         "unknown");
  remark(ahead_, "with a stamp later than the recording: the writer's clock is ahead; age counted as 0");
  remark(
      was_set_,
      "out of order, or the first of a topic after the recorder's clock was set: no period is counted there");
  if (pauses_ > 0)
    findings.remarks.push_back(
        fmt::format("no topic was recorded for {:.0f} s{}: the recorder was paused, its clock was set "
                    "forward, or nothing was sent. These gaps count",
                    static_cast<double>(longest_pause_ns_) / 1e9,
                    pauses_ == 1 ? "" : fmt::format(", and {} more times for 10 s or longer", pauses_ - 1)));
  if (auto ahead = remark_on_message_ahead(); !ahead.empty() && limits_.is_gap(INT64_MAX))
    findings.remarks.push_back(std::move(ahead));
  if (mixed_.messages > 0)
    findings.remarks.push_back(fmt::format(
        "sequence numbers of several writers are mixed in {}{}: losses there are unknown", mixed_.topic,
        mixed_.messages == 1 ? "" : fmt::format(" and {} more topics", mixed_.messages - 1)));
  if (left_out_ > 0)
    findings.remarks.push_back(
        fmt::format("{} messages are not counted: the bag has more than {} topics", left_out_, most_flows));
  return findings;
}

}  // namespace ontime::bag
