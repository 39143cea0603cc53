// SPDX-License-Identifier: Apache-2.0
#include "listen/wire.hpp"

#include <algorithm>
#include <cstdlib>
#include <numeric>
#include <utility>

#include <fmt/format.h>

namespace ontime::listen {
namespace {

constexpr std::uint32_t most_fragments = 1 << 16;
// Messages of a writer that wait for fragments, and fragments of them all.
constexpr std::size_t most_partial = 64, most_partial_fragments = std::size_t{4} * most_fragments;
// A writer that leaves out more numbers than this began anew, or is not one.
constexpr std::uint64_t longest_leap = 1 << 20;
// So much later no GAP tells any more that a number was never sent.
constexpr std::uint64_t doubtful = 64;
constexpr std::int64_t doubtful_ns = 10'000'000'000;
constexpr std::int64_t soonest_restart_ns = 100'000'000;
// A stamp further from its arrival is by another clock, such as simulated time, or not set.
constexpr std::int64_t one_year_ns = std::int64_t{365} * 24 * 3600 * 1'000'000'000;

// Captures may have whole microseconds: so much earlier a packet of now may seem.
constexpr std::int64_t coarsest_ns = 1000;

}  // namespace

void Wire::add(std::int64_t at_ns, const Datagram& datagram) {
  // nullptr: the writer is unknown or restarts, or the number is too far ahead.
  const auto stream_with = [&](const rtps::Guid& writer, std::uint64_t last) -> Stream* {
    const auto found = streams_.find(writer);
    if (found == streams_.end() || found->second.is_broken) return nullptr;
    return last < found->second.sequence.next() + longest_leap ? &found->second : nullptr;
  };
  rtps::Visitor visitor;
  visitor.data = [&](const rtps::Data& data) {
    if (const auto endpoint = rtps::announced(data))
      note(*endpoint);
    else if (data.writer.is_user_endpoint())
      add(at_ns, datagram, data);
  };
  visitor.gap = [&](const rtps::Gap& gap) {
    auto* const stream = stream_with(gap.writer, gap.last);
    if (stream == nullptr) return;
    if (stream->has_new_reader) pass_over_before(*stream, gap.first);
    // From before a new reader on, it only tells that this reader does not get them. Its writer may know the
    // reader later than its announcement was seen.
    const bool is_history = !gap.is_end && gap.first < stream->before_reader;
    stream->sequence.pass_over(is_history ? stream->sequence.next() : gap.first, gap.last);
  };
  visitor.heartbeat = [&](const rtps::Heartbeat& heartbeat) {
    auto* const stream = stream_with(heartbeat.writer, heartbeat.last);
    if (stream == nullptr) return;
    if (stream->has_new_reader) pass_over_before(*stream, heartbeat.last + 1);
    stream->sequence.announce(heartbeat.last);
  };
  rtps::visit(datagram.payload, visitor, datagram.is_cut);
  if (datagram.is_cut) {
    ++cut_;
    interrupt();
  }
}

void Wire::note(const rtps::Endpoint& endpoint) {
  if (!endpoint.is_reader) return name_topic(endpoint.guid, endpoint.topic);
  if (readers_.contains(endpoint.guid)) return;
  if (readers_.size() < most_names) readers_.insert(endpoint.guid);
  const auto topic = ros_name(endpoint.topic);
  for (auto& [writer, stream] : streams_)
    if (topic_of(writer) == topic) expect_reader(stream);
}

void Wire::expect_reader(Stream& stream) {
  stream.has_new_reader = true;
  stream.before_reader = stream.sequence.next();
}

void Wire::name_topic(const rtps::Guid& writer, const std::string& dds_topic) {
  if (const auto known = topics_.find(writer); known != topics_.end()) {
    known->second = ros_name(dds_topic);
    return;
  }
  if (topics_.size() == most_names) return;
  topics_[writer] = ros_name(dds_topic);
  // Its reader may have been announced before.
  if (const auto found = streams_.find(writer); found != streams_.end()) expect_reader(found->second);
}

void Wire::interrupt() {
  for (auto& [guid, stream] : streams_) {
    if (stream.is_broken) continue;
    // What was announced after the latest message may be among the packets that are missing.
    stream.sequence.pass_over(stream.last_seen + 1, stream.sequence.next() - 1);
    stream.is_broken = true;
  }
}

void Wire::set_clock(std::int64_t from_ns, std::int64_t until_ns) {
  interrupt();
  for (auto& [guid, stream] : streams_) {
    restart(stream);  // later stamps are by another time
    stream.last_ns = std::clamp(stream.last_ns, from_ns, until_ns);
  }
}

Wire::Stream* Wire::stream_of(const rtps::Guid& writer) {
  if (const auto found = streams_.find(writer); found != streams_.end()) return &found->second;
  if (streams_.size() == most_writers) {
    ++left_out_;
    return nullptr;
  }
  auto& stream = streams_[writer];
  stream.id = streams_.size();  // none is ever erased
  return &stream;
}

// Whether this is the fragment that was still missing of its message.
bool Wire::completes(Stream& stream, const rtps::Data& data) {
  const auto& fragments = *data.fragments;
  if (fragments.total > most_fragments) return false;
  auto& partial = partial_of(stream, data.sequence, fragments.total);
  if (partial.seen.size() != fragments.total || partial.count == fragments.total) return false;
  for (auto i = fragments.first - 1; i < fragments.first - 1 + fragments.count; ++i) {
    partial.count += partial.seen[i] ? 0 : 1;
    partial.seen[i] = true;
  }
  return partial.count == fragments.total;
}

// Whether the latest number is of a message that lacks fragments: they may come.
bool Wire::is_under_way(const Stream& stream) {
  const auto latest = stream.sequence.next() - 1;
  return stream.sequence.is_missing(latest) &&
         std::ranges::find(stream.partial, latest, &Partial::sequence) != stream.partial.end();
}

// If it is full, the oldest complete message goes first: it only serves to recognize repeated fragments.
Wire::Partial& Wire::partial_of(Stream& stream, std::uint64_t sequence, std::uint32_t fragments) {
  auto& partial = stream.partial;
  const auto known = std::ranges::find(partial, sequence, &Partial::sequence);
  if (known != partial.end()) return *known;
  auto kept = std::accumulate(partial.begin(), partial.end(), std::size_t{fragments},
                              [](auto sum, const auto& one) { return sum + one.seen.size(); });
  while (partial.size() >= most_partial || (kept > most_partial_fragments && !partial.empty())) {
    auto oldest = std::find_if(partial.begin(), partial.end(),
                               [](const auto& one) { return one.count == one.seen.size(); });
    if (oldest == partial.end()) oldest = partial.begin();
    kept -= oldest->seen.size();
    partial.erase(oldest);
  }
  return partial.emplace_back(
      Partial{.sequence = sequence, .seen = std::vector<bool>(fragments), .count = 0});
}

// Whether a new message has a number of before: its writer restarted with its old GUID. A message that is
// repeated or overtaken has its old stamp, and threads that publish at once have almost the same.
bool Wire::began_again(const Stream& stream, const rtps::Data& data) {
  return data.sequence <= stream.last_seen && stream.latest_stamp_ns > 0 &&
         data.stamp_ns > stream.latest_stamp_ns + soonest_restart_ns;
}

// A writer without a reader sends nothing, and numbers its messages.
void Wire::pass_over_before(Stream& stream, std::uint64_t number) {
  auto& sequence = stream.sequence;
  if (sequence.has_begun() && number > sequence.next()) sequence.pass_over(sequence.next(), number - 1);
}

// The next message has any number. Losses until now stay.
void Wire::restart(Stream& stream) {
  keep_all_losses(stream);
  stream.sequence.restart();
  for (auto& [way, sequence] : stream.ways) sequence.restart();
  stream.rows.restart();
  stream.last_seen = stream.last_stamped = stream.before_reader = 0;
  stream.latest_stamp_ns = 0;
}

// With this number, after packets that are missing: the numbers between may have been among them. Losses
// until now stay.
void Wire::resume(Stream& stream, std::uint64_t number) {
  keep_all_losses(stream);
  stream.sequence.keep_losses();
  pass_over_before(stream, number);
  stream.rows.restart();
  stream.last_stamped = 0;
}

void Wire::add(std::int64_t at_ns, const Datagram& datagram, const rtps::Data& data) {
  auto* const stream = stream_of(data.writer);
  if (stream == nullptr) return;
  if (began_again(*stream, data)) {
    restart(*stream);
    stream->partial.clear();
  }
  if (stream->has_new_reader && data.sequence >= stream->sequence.next()) {
    pass_over_before(*stream, data.sequence);
    stream->has_new_reader = false;
  }
  // A copy to another destination is for another reader. On another interface it is the same packet, or one
  // for another network. Of one in fragments another copy may complete the message.
  const Way way{datagram.destination, datagram.source, datagram.interface};
  const bool has_room = stream->ways.size() < most_ways || stream->ways.contains(way);
  auto* const own = has_room ? &stream->ways[way] : nullptr;
  if (data.fragments && !completes(*stream, data)) {
    // Its writer has published it, and those before it.
    if (!stream->is_broken && data.sequence < stream->sequence.next() + longest_leap)
      stream->sequence.announce(data.sequence);
    return;
  }
  if (stream->sequence.has_begun() && data.sequence > stream->sequence.next() + longest_leap) {
    restart(*stream);
    stream->is_broken = true;
  } else if (stream->is_broken) {
    resume(*stream, data.sequence);
  }
  const auto fate = stream->sequence.see(data.sequence);
  if (own != nullptr && own->see(data.sequence) == Sequence::Fate::again && fate == Sequence::Fate::again)
    ++stream->duplicated;
  if (fate != Sequence::Fate::in_order && fate != Sequence::Fate::overtaken) return;
  // A heartbeat ahead of its message does not make it out of order.
  if (data.sequence < stream->last_seen) ++stream->reordered;
  stream->last_seen = std::max(stream->last_seen, data.sequence);
  if (stream->messages == 0) {
    stream->first_ns = at_ns;
    stream->writer.name = fmt::format("{} at {}", rtps::text_of(data.writer), datagram.source);
    stream->is_one_host = datagram.is_one_host;
    stream->is_broken = true;
  }
  judge(*stream, at_ns, data);
  stream->latest_stamp_ns = std::max(stream->latest_stamp_ns, data.stamp_ns.value_or(0));
  ++stream->messages;
  stream->last_ns = at_ns;
  stream->is_broken = false;
}

void Wire::judge(Stream& stream, std::int64_t at_ns, const rtps::Data& data) {
  bool is_late = false;
  if (!stream.is_broken) {
    const auto gap = at_ns - stream.last_ns;
    is_late = limits_.is_gap(gap);
    add_period(stream.period, keep_row_, stream.id, stream.last_ns, at_ns, is_late);
    if (is_late) miss(Miss::Kind::gap, at_ns, gap, data.writer, stream);
  }
  std::uint64_t ahead = 0;
  const bool has_age = stream.is_one_host && data.stamp_ns && std::abs(at_ns - *data.stamp_ns) <= one_year_ns;
  if (has_age) {
    const auto age = at_ns - *data.stamp_ns;
    ahead += age <= -coarsest_ns ? 1 : 0;
    if (!stream.age) stream.age.emplace();
    stream.age->add(age);
    const bool is_too_old = limits_.is_too_old(age);
    if (is_too_old) {
      is_late = true;
      miss(Miss::Kind::age, at_ns, age, data.writer, stream);
    }
    stream.rows.age(keep_row_,
                    {.flow = stream.id, .from_ns = *data.stamp_ns, .to_ns = at_ns, .is_late = is_too_old},
                    data.sequence, [](std::uint64_t) { return std::int64_t{0}; });
    if (stream.last_stamped > 0 && data.sequence > stream.last_stamped + 1)
      stream.holes.push_back(
          {stream.last_stamped + 1, data.sequence - 1, stream.last_stamp_ns, *data.stamp_ns});
    if (data.sequence > stream.last_stamped) {
      stream.last_stamped = data.sequence;
      stream.last_stamp_ns = *data.stamp_ns;
    }
    keep_losses(stream, [&](const Hole& hole) {
      return !sees_gaps_ || hole.last + doubtful < data.sequence ||
             hole.after_ns + doubtful_ns <= *data.stamp_ns;
    });
  }
  stream.late += is_late ? 1 : 0;
  if (!stream.is_one_host) return;
  stream.age_unknown = stream.age_unknown.value_or(0) + (has_age ? 0 : 1);
  stream.stamp_ahead = stream.stamp_ahead.value_or(0) + ahead;
}

// A lost message has no stamp: its writer is taken to have published evenly. Of a large hole only the latest
// have rows.
template <class IsDecided>
void Wire::keep_losses(Stream& stream, IsDecided is_decided) {
  constexpr auto most = Sequence::window / 2;
  auto& holes = stream.holes;
  for (; !holes.empty() && is_decided(holes.front()); holes.pop_front()) {
    const auto [first, last, before_ns, after_ns] = holes.front();
    const auto every_ns = (after_ns - before_ns) / static_cast<std::int64_t>(last - first + 2);
    const auto next = stream.sequence.next();
    for (auto number = std::max(first, next - std::min(next, most)); number <= last; ++number)
      if (stream.sequence.is_missing(number))
        stream.rows.lost(keep_row_, stream.id, number,
                         before_ns + every_ns * static_cast<std::int64_t>(number - first + 1));
  }
}

void Wire::keep_all_losses(Stream& stream) {
  keep_losses(stream, [](const Hole&) { return true; });
}

void Wire::end() {
  for (auto& [guid, stream] : streams_) {
    // A heartbeat may have announced more: published after the last one, nothing tells how much later.
    const auto last = std::max<std::uint64_t>(stream.sequence.next(), 1) - 1 - (is_under_way(stream) ? 1 : 0);
    if (!stream.is_broken && stream.last_stamped > 0 && last > stream.last_stamped) {
      const auto first = std::exchange(stream.last_stamped, last) + 1;
      stream.holes.push_back({first, last, stream.last_stamp_ns, stream.last_stamp_ns});
    }
    keep_all_losses(stream);
  }
}

std::string Wire::topic_of(const rtps::Guid& writer) const {
  const auto found = topics_.find(writer);
  return found == topics_.end() ? "" : found->second;
}

void Wire::miss(Miss::Kind kind, std::int64_t at_ns, std::int64_t value_ns, const rtps::Guid& writer,
                const Stream& stream) {
  misses_.add({kind, at_ns, value_ns, topic_of(writer), {0, rtps::text_of(writer)}, {}, {}, stream.id});
}

Findings Wire::findings() const {
  Findings findings;
  findings.misses_left_out = misses_.left_out();
  std::size_t never_whole = 0;
  std::uint64_t ahead = 0;
  for (const auto& [guid, stream] : streams_) {
    if (stream.messages == 0) {
      // The latest may be under way, and the capture may have begun amid the first.
      const auto seen =
          stream.partial.size() - (!stream.partial.empty() && !stream.partial.front().seen[0] ? 1 : 0);
      never_whole += seen > 1 ? 1 : 0;
      continue;
    }
    std::set<std::string> destinations;
    for (const auto& [way, sequence] : stream.ways) destinations.insert(std::get<0>(way));
    const auto count = destinations.size();
    Flow flow = stream;
    flow.topic = topic_of(guid);
    flow.reader = {0, *destinations.begin() + (count > 1 ? fmt::format(" and {} more", count - 1) : "")};
    flow.lost = stream.sequence.lost() - (is_under_way(stream) ? 1 : 0);
    ahead += flow.stamp_ahead.value_or(0);
    findings.flows.push_back(std::move(flow));
  }
  std::ranges::sort(findings.flows, {},
                    [](const Flow& flow) { return std::tie(flow.topic, flow.writer.name); });
  if (cut_ > 0)
    findings.add_incomplete(fmt::format(
        "{} datagrams were captured only in part: losses and periods across them are not counted", cut_));
  if (ahead > 0)
    findings.remarks.push_back(
        fmt::format("messages with a stamp later than their capture: {}. The writer's clock is ahead of the "
                    "capture's; age counted as 0",
                    ahead));
  if (never_whole > 0)
    findings.remarks.push_back(fmt::format(
        "writers of which no message was complete: {}. Each message lacked fragments", never_whole));
  findings.not_counted = left_out_;
  if (left_out_ > 0)
    findings.remarks.push_back(
        fmt::format("{} messages are not counted: there are more than {} writers", left_out_, most_writers));
  if (std::ranges::any_of(findings.flows, [](const auto& flow) { return flow.topic.empty(); }))
    findings.remarks.emplace_back(
        "some writers have no topic name, because their discovery was not captured. Start the capture before "
        "the nodes, or judge in the processes");
  return findings;
}

}  // namespace ontime::listen
