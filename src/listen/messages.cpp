// SPDX-License-Identifier: Apache-2.0
#include "listen/messages.hpp"

#include <algorithm>

#include <fmt/format.h>

namespace ontime::listen {
namespace {

// A message usually gets its stamp within this time after its publish.
constexpr std::int64_t soonest_ns = 20'000, soon_ns = 200'000;
// A stamp later than the take: the clock was set back, or is of another machine.
constexpr std::int64_t most_ahead_ns = 1'000'000;
// If stamps fit only one publisher this often and this long, it is the writer; if as many in a row do not
// fit, it is not.
constexpr int enough_fits = 8;
constexpr std::int64_t long_enough_ns = 1'000'000'000;
// Ids of chains' paths differ from those of flows, which count from 1.
constexpr std::uint64_t first_path_id = std::uint64_t{1} << 62U, ids_of_a_chain = std::uint64_t{1} << 48U;

// The median; 0: of too few to tell.
std::int64_t usual_of(const Distribution& values) {
  return values.count() < enough_fits ? 0 : values.quantile_ns(0.5);
}

}  // namespace

Messages::Messages(const Limits& limits, std::vector<ChainWish> chains) : limits_(limits) {
  for (auto& wish : chains)
    chains_.emplace_back(
        std::move(wish), [this](std::uint32_t process) { return party(process); }, probing_,
        first_path_id + ids_of_a_chain * chains_.size());
}

void Messages::begin_process(std::uint32_t process, const std::string& name) {
  if (ended_at_.contains(process)) retire(process);  // another process had the same number
  ended_at_.erase(process);
  processes_[process] = name;
}

void Messages::end_process(std::uint32_t process, std::int64_t at_ns) {
  ended_at_.try_emplace(process, at_ns);
  for (auto& flow : ended_)  // its endpoint may have been replaced before
    if (flow.writer.process == process || flow.reader.process == process) flow.has_ended = true;
}

void Messages::retire_ended(std::int64_t now_ns) {
  std::erase_if(ended_at_, [&](const auto& one) {
    const bool is_long_ago = now_ns - one.second >= still_taken_ns;
    if (is_long_ago) retire(one.first);
    return is_long_ago;
  });
}

void Messages::retire(std::uint32_t process) {
  for (auto link = links_.begin(); link != links_.end();) {
    const auto one = link++;
    const auto& publisher = one->second.publisher;
    if (std::get<0>(one->first) == process || (publisher && publisher->first == process)) retire(one);
  }
  for (auto publisher = publishers_.lower_bound({process, 0});
       publisher != publishers_.end() && publisher->first.first == process;)
    retire(publisher++);
  std::erase_if(topics_, [&](const auto& one) { return one.first.first == process; });
  for (auto& chain : chains_) chain.retire(process);
  processes_.erase(process);
}

void Messages::retire(std::map<Writer, Link>::iterator link) {
  keep(flow_of(link->first, link->second));
  links_.erase(link);
}

void Messages::retire(std::map<Endpoint, Publisher>::iterator publisher) {
  if (!publisher->second.has_reader) keep(flow_of(publisher->first, publisher->second));
  publishers_.erase(publisher);
}

void Messages::keep(Flow&& flow) {
  ended_.push_back(std::move(flow));
  if (ended_.size() <= most_ended) return;
  const auto& oldest = ended_.front();
  const bool has_room = forgotten_.size() < Findings::most_topics || forgotten_.contains(oldest.topic);
  auto& [flows, messages, with_misses] = forgotten_[has_room ? oldest.topic : Findings::any_topic];
  ++flows;
  messages += oldest.messages;
  // If gaps have a limit, its silence exceeds it.
  with_misses += oldest.late > 0 || limits_.is_gap(INT64_MAX) ? 1 : 0;
  silent_.erase(oldest.id);
  ended_.pop_front();
}

// If most_live are in use, a new one replaces the longest silent one, or is left out.
template <class Key, class One>
One* Messages::one_of(std::map<Key, One>& all, const Key& key, std::int64_t now_ns) {
  if (const auto known = all.find(key); known != all.end()) return &known->second;
  if (all.size() >= most_live) {
    const auto oldest = std::ranges::min_element(all, {}, [](const auto& a) { return a.second.last_ns; });
    if (now_ns - oldest->second.last_ns < idle_ns) {
      ++left_out_;
      return nullptr;
    }
    retire(oldest);
  }
  auto& one = all[key];
  one.id = ++last_id_;
  return &one;
}

void Messages::name_topic(std::uint32_t process, std::uint64_t endpoint, const std::string& topic) {
  const Endpoint key{process, endpoint};
  if (topics_.size() >= most_names && !topics_.contains(key)) return;
  const auto [known, is_new] = topics_.try_emplace(key, topic);
  if (!is_new && known->second == topic) return;
  // The address now belongs to another endpoint: count for that one from here on.
  if (!is_new) {
    known->second = topic;
    for (auto link = links_.begin(); link != links_.end();) {
      const auto one = link++;
      if (one->second.publisher == key ||
          (std::get<0>(one->first) == process && std::get<1>(one->first) == endpoint))
        retire(one);
    }
    if (const auto found = publishers_.find(key); found != publishers_.end()) retire(found);
    return;
  }
  // Messages may be observed before the name.
  if (const auto found = publishers_.find(key); found != publishers_.end()) {
    found->second.topic = topic;
    misses_.name(found->second.id, topic);
  }
  for (auto& [writer, link] : links_) {
    if (std::get<0>(writer) != process || std::get<1>(writer) != endpoint) continue;
    link.topic = topic;
    misses_.name(link.id, topic);
  }
}

void Messages::interrupt(std::int64_t until_ns) {
  interrupted_until_ns_ = until_ns;
  begin_anew();
}

void Messages::count_silence(std::uint64_t flow, std::int64_t from_ns, std::int64_t ns) {
  if (!silent_.insert(flow).second) return;
  const auto count = [&](auto& one) {
    if (one.id != flow) return;
    add_period(one.period, keep_row_, flow, from_ns, from_ns + ns, true);
    ++one.late;
  };
  for (auto& [key, link] : links_) count(link);
  for (auto& [key, publisher] : publishers_) count(publisher);
  for (auto& one : ended_) count(one);
}

void Messages::begin_anew() {
  for (auto& [key, publisher] : publishers_) publisher.is_broken = true;
  for (auto& [key, link] : links_) link.is_broken = true;
  forget_stamps(interrupted_until_ns_);
}

void Messages::forget_stamps(std::int64_t until_ns) {
  interrupted_until_ns_ = until_ns;
  for (auto& [key, link] : links_) {
    link.sequence.restart();
    link.rows.restart();
  }
  for (auto& chain : chains_) chain.interrupt();
}

void Messages::add(Observation seen) {
  if (seen.after_loss) {
    begin_anew();
    lost_until_ns_ = seen.at_ns;
  }
  const bool is_ahead = seen.stamp_ns > seen.at_ns + most_ahead_ns;
  if (seen.stamp_ns < interrupted_until_ns_ || is_ahead) seen.stamp_ns = 0;
  switch (seen.kind) {
    case Observation::Kind::published:
      return published(seen);
    case Observation::Kind::taken:
      return taken(seen);
    case Observation::Kind::turned:
      for (auto& chain : chains_) chain.turned(seen.thread, seen.at_ns);
  }
}

void Messages::published(const Observation& seen) {
  auto* const one = one_of(publishers_, Endpoint{seen.process, seen.endpoint}, seen.at_ns);
  if (one == nullptr) return;
  auto& publisher = *one;
  silent_.erase(publisher.id);
  if (publisher.messages == 0) {
    publisher.first_ns = seen.at_ns;
    if (const auto name = topics_.find({seen.process, seen.endpoint}); name != topics_.end())
      publisher.topic = name->second;
  }
  if (!publisher.is_broken) {
    const auto verdict = judge_gap(publisher.last_ns, seen.at_ns);
    if (verdict == Verdict::not_judged) {
      publisher.not_judged += judges_gaps_ ? 1 : 0;
    } else {
      const bool is_late = verdict == Verdict::late;
      if (is_late) ++publisher.late;
      if (is_late && !publisher.has_reader && !is_taken(publisher)) miss(publisher, seen);
      add_period(publisher.period, keep_row_, publisher.id, publisher.last_ns, seen.at_ns, is_late);
    }
  }
  publisher.is_broken = false;
  publisher.threads[publisher.messages % remembered] = seen.thread;
  publisher.begun_ns[publisher.messages++ % remembered] = publisher.last_ns = seen.at_ns;
  for (auto& chain : chains_)
    chain.published(
        {publisher.topic, seen.process, seen.thread, publisher.id, publisher.messages - 1, seen.at_ns});
}

// Less at high rates: stamps of another writer are close to some publish by chance.
bool Messages::Publisher::fits(std::int64_t stamp_ns) const {
  const auto number = last_before(stamp_ns);
  return number && stamp_ns - begun(*number) <= std::clamp(period.quantile_ns(0.5) / 20, soonest_ns, soon_ns);
}

std::optional<std::uint64_t> Messages::Publisher::last_before(std::int64_t stamp_ns) const {
  for (auto number = messages; number > oldest(); --number)
    if (begun(number - 1) <= stamp_ns) return number - 1;
  return {};
}

void Messages::taken(const Observation& seen) {
  auto* const one = one_of(links_, Writer{seen.process, seen.endpoint, seen.writer}, seen.at_ns);
  if (one == nullptr) {
    for (auto& chain : chains_) chain.turned(seen.thread, seen.at_ns);
    return;
  }
  auto& link = *one;
  silent_.erase(link.id);
  if (link.messages == 0) {
    link.first_ns = seen.at_ns;
    link.is_broken = true;
    if (const auto name = topics_.find({seen.process, seen.endpoint}); name != topics_.end())
      link.topic = name->second;
  }
  std::optional<std::uint64_t> number;
  if (seen.stamp_ns != 0) {
    if (link.publisher) doubt(link, seen);
    if (!link.publisher) identify(link, seen);
    // No number: published before the sensor started, too long ago, or perhaps not the last publish before
    // that stamp.
    if (link.publisher && seen.stamp_ns >= lost_until_ns_ + soon_ns)
      number = publishers_.at(*link.publisher).last_before(seen.stamp_ns);
  }
  auto of_gap = Verdict::on_time, of_age = Verdict::on_time;
  bool is_new = false;
  if (!link.is_broken) {
    of_gap = judge_gap(link.last_ns, seen.at_ns);
    if (of_gap != Verdict::not_judged)
      add_period(link.period, keep_row_, link.id, link.last_ns, seen.at_ns, of_gap == Verdict::late);
    if (of_gap == Verdict::late) miss(Miss::Kind::gap, seen.at_ns - link.last_ns, link, seen, number);
  }
  if (link.publisher && seen.stamp_ns != 0) {
    // Stamp and take use the same clock: the age is exact.
    const auto age = seen.at_ns - seen.stamp_ns;
    of_age =
        probing_.judge(seen.stamp_ns, seen.at_ns, [this](std::int64_t ns) { return limits_.is_too_old(ns); });
    if (of_age != Verdict::not_judged) link.age->add(age);
    if (of_age == Verdict::late) miss(Miss::Kind::age, age, link, seen, number);
    if (number) is_new = place(link, *number, seen, of_age);
  }
  const auto writer = link.publisher ? publishers_.find(*link.publisher) : publishers_.end();
  for (auto& chain : chains_)
    chain.taken({.topic = link.topic,
                 .process = seen.process,
                 .thread = seen.thread,
                 .publisher = writer != publishers_.end() ? writer->second.id : 0,
                 // A take before the stamp: the clock was set back.
                 .number = is_new && seen.stamp_ns <= seen.at_ns ? number : std::nullopt,
                 .at_ns = seen.at_ns,
                 .stamp_ns = seen.stamp_ns});
  link.last_number = number;
  link.is_broken = false;
  if (of_gap == Verdict::late || of_age == Verdict::late)
    ++link.late;
  else if ((of_gap == Verdict::not_judged && judges_gaps_) || (of_age == Verdict::not_judged && judges_ages_))
    ++link.not_judged;
  ++link.messages;
  link.last_ns = seen.at_ns;
}

void Messages::identify(Link& link, const Observation& seen) {
  std::optional<Endpoint> only;
  for (const auto& [key, publisher] : publishers_) {
    if (publisher.topic != link.topic || link.topic.empty()) continue;
    if (!publisher.fits(seen.stamp_ns)) continue;
    if (only) return;  // two publishers fit: the writer stays unknown
    only = key;
  }
  if (only && only == link.candidate) {
    ++link.fits;
  } else if (++link.misfits * 4 > link.fits) {  // a busy machine delays a stamp now and then
    link.candidate = only;
    link.candidate_since_ns = seen.at_ns;
    link.fits = only ? 1 : 0;
    link.misfits = 0;
  }
  if (link.fits < enough_fits || seen.at_ns - link.candidate_since_ns < long_enough_ns) return;
  link.publisher = link.candidate;
  publishers_.at(*link.publisher).has_reader = true;  // whatever becomes of this one
  link.age.emplace();
  link.stamps.assign(remembered, 0);
  link.misfits = 0;
}

// The writer may be on another machine, or another one than before.
void Messages::doubt(Link& link, const Observation& seen) {
  const auto publisher = publishers_.find(*link.publisher);
  const bool fits =
      publisher != publishers_.end() && (link.is_broken || publisher->second.fits(seen.stamp_ns));
  link.misfits = fits ? 0 : link.misfits + 1;
  if (link.misfits == 1) link.misfits_since_ns = seen.at_ns;
  // A busy machine delays many stamps in a row, but not for so long.
  const bool is_accident = link.misfits < enough_fits || seen.at_ns - link.misfits_since_ns < long_enough_ns;
  if (publisher != publishers_.end() && is_accident) return;
  link.publisher.reset();
  link.candidate.reset();
  link.fits = link.misfits = 0;
  link.age.reset();
  link.sequence = {};
  link.lost_not_judged = 0;
  link.unjudged.reset();
  link.rows.restart();
}

Messages::Verdict Messages::judge_gap(std::int64_t from_ns, std::int64_t to_ns) const {
  return probing_.judge(from_ns, to_ns, [this](std::int64_t ns) { return limits_.is_gap(ns); });
}

bool Messages::place(Link& link, std::uint64_t number, const Observation& seen, Verdict of_age) {
  const auto stamp_ns = seen.stamp_ns;
  const auto& publisher = publishers_.at(*link.publisher);
  const auto keep = [&](std::uint64_t of) {
    if (link.unjudged.test(of % remembered)) --link.lost_not_judged;
    link.unjudged.reset(of % remembered);
    link.stamps[of % remembered] = stamp_ns;
    link.rows.age(
        keep_row_,
        {.flow = link.id, .from_ns = stamp_ns, .to_ns = seen.at_ns, .is_late = of_age == Verdict::late}, of,
        [&](std::uint64_t lost) {
          const auto known = std::max(lost, publisher.oldest());
          return known == lost && link.unjudged.test(lost % remembered) ? 0 : publisher.begun(known);
        },
        of_age != Verdict::not_judged);
    return true;
  };
  // Each may be lost because its reader was delayed, and may still arrive.
  if (const bool has_begun = link.sequence.has_begun(); !has_begun || number >= link.sequence.next()) {
    for (auto lost = std::max(link.sequence.next(), publisher.oldest()); has_begun && lost < number; ++lost) {
      const bool is_judged = !probing_.is_most_of(publisher.begun(lost), seen.at_ns);
      link.unjudged.set(lost % remembered, !is_judged);
      link.lost_not_judged += is_judged ? 0 : 1;
    }
    link.unjudged.reset(number % remembered);
  }
  const auto is_repeated = [&](std::uint64_t of) { return link.stamps[of % remembered] == stamp_ns; };
  switch (link.sequence.see(number)) {
    case Sequence::Fate::overtaken:
      ++link.reordered;
      break;
    case Sequence::Fate::again:
      if (is_repeated(number)) {
        ++link.duplicated;
      } else if (number > 0) {
        // Another stamp is another message: two threads published at once, and both stamps were made after
        // both publishes began.
        if (link.sequence.see(number - 1) == Sequence::Fate::overtaken) return keep(number - 1);
        if (is_repeated(number - 1)) ++link.duplicated;
      }
      return false;
    case Sequence::Fate::in_order:
      break;
    case Sequence::Fate::too_old:
      return false;
  }
  return keep(number);
}

void Messages::miss(Miss::Kind kind, std::int64_t value_ns, const Link& link, const Observation& seen,
                    std::optional<std::uint64_t> number) {
  misses_.add({kind, seen.at_ns, value_ns, link.topic,
               link.publisher ? party(link.publisher->first) : Party{}, party(seen.process),
               course_of(kind, link, seen, number), link.id});
}

// Until its writer is recognized, the reader's flow has the miss.
bool Messages::is_taken(const Publisher& publisher) const {
  return std::ranges::any_of(links_, [&](const auto& one) {
    const auto& link = one.second;
    return !link.publisher && link.topic == publisher.topic && link.last_ns >= publisher.last_ns;
  });
}

void Messages::miss(const Publisher& publisher, const Observation& seen) {
  const auto thread = static_cast<std::int32_t>(seen.thread);
  misses_.add({.kind = Miss::Kind::gap,
               .at_ns = seen.at_ns,
               .value_ns = seen.at_ns - publisher.last_ns,
               .topic = publisher.topic,
               .writer = party(seen.process),
               .reader = {},
               .course = {.before_ns = publisher.last_ns,
                          .since_ns = seen.at_ns,
                          .published_ns = seen.at_ns,
                          .taken_before_ns = publisher.last_ns,
                          .taken_ns = seen.at_ns,
                          .publisher = thread,
                          .taker = thread,
                          .usual_ns = usual_of(publisher.period)},
               .flow = publisher.id});
}

Course Messages::course_of(Miss::Kind kind, const Link& link, const Observation& seen,
                           std::optional<std::uint64_t> number) const {
  const auto& usual = kind == Miss::Kind::gap ? link.period : *link.age;
  Course course{.taken_before_ns = link.last_ns,
                .taken_ns = seen.at_ns,
                .taker = static_cast<std::int32_t>(seen.thread),
                .usual_ns = usual_of(usual)};
  if (!number) return course;
  const auto& publisher = publishers_.at(*link.publisher);
  course.publisher = static_cast<std::int32_t>(publisher.threads[*number % remembered]);
  course.since_ns = course.published_ns = publisher.begun(*number);
  if (kind == Miss::Kind::age || !link.last_number || *link.last_number >= *number) return course;
  const auto before = *link.last_number;
  if (publisher.messages - before > remembered) return course;
  course.before_ns = publisher.begun(before);
  course.since_ns = publisher.begun(before + 1);
  course.missing = *number - before - 1;
  return course;
}

Party Messages::party(std::uint32_t process) const {
  const auto found = processes_.find(process);
  return {process, found == processes_.end() ? "" : found->second};
}

Flow Messages::flow_of(const Writer& writer, const Link& link) const {
  Flow flow = link;
  flow.reader = party(std::get<0>(writer));
  flow.has_ended = ended_at_.contains(std::get<0>(writer));
  if (link.publisher) {
    flow.writer = party(link.publisher->first);
    flow.has_ended |= ended_at_.contains(link.publisher->first);
    flow.lost = link.sequence.lost() - link.lost_not_judged;
  }
  return flow;
}

Flow Messages::flow_of(const Endpoint& endpoint, const Publisher& publisher) const {
  Flow flow = publisher;
  flow.writer = party(endpoint.first);
  flow.has_ended = ended_at_.contains(endpoint.first);
  return flow;
}

Findings Messages::findings() const {
  Findings findings;
  findings.forgotten = forgotten_;
  findings.misses_left_out = misses_.left_out();
  findings.not_counted = left_out_;
  for (const auto& chain : chains_) findings.chains.push_back(chain.findings());
  auto& flows = findings.flows;
  flows.assign(ended_.begin(), ended_.end());
  for (const auto& [writer, link] : links_) flows.push_back(flow_of(writer, link));
  for (const auto& [key, publisher] : publishers_)
    if (!publisher.has_reader) flows.push_back(flow_of(key, publisher));
  std::ranges::sort(flows, {}, [](const Flow& flow) {
    return std::tie(flow.topic, flow.writer.process, flow.reader.process);
  });
  if (left_out_ > 0)
    findings.remarks.push_back(fmt::format(
        "{} messages are not counted: more than {} flows or publishers were active", left_out_, most_live));
  return findings;
}

}  // namespace ontime::listen
