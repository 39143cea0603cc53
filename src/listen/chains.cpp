// SPDX-License-Identifier: Apache-2.0
#include "listen/chains.hpp"

#include <algorithm>
#include <utility>

namespace ontime::listen {

std::string ChainWish::name() const {
  std::string name;
  for (const auto& step : steps) name += (name.empty() ? "" : " → ") + step.topic;
  return name;
}

ChainFollower::ChainFollower(ChainWish wish, std::function<Party(std::uint32_t)> party_of,
                             const Probing& probing, std::uint64_t first_id)
    : wish_(std::move(wish)),
      party_of_(std::move(party_of)),
      probing_(probing),
      latest_(wish_.steps.size()),
      publishing_(wish_.steps.size()),
      next_id_(first_id) {
  found_.wish = wish_;
  found_.ended.resize(last_stage());
  found_.without_take.resize(wish_.steps.size());
  found_.unknown_takes.resize(wish_.steps.size());
}

std::optional<std::size_t> ChainFollower::position_of(const std::string& topic) const {
  const auto found = std::ranges::find(wish_.steps, topic, &ChainWish::Step::topic);
  if (found == wish_.steps.end()) return {};
  return static_cast<std::size_t>(found - wish_.steps.begin());
}

// A recorder also takes messages, but publishes none.
bool ChainFollower::continues(std::size_t topic, std::uint32_t process) const {
  return topic + 1 == wish_.steps.size() || publishing_[topic + 1].contains(process);
}

void ChainFollower::published(const Message& message) {
  now_ns_ = std::max(now_ns_, message.at_ns);
  end_call(message.thread, message.at_ns);
  const auto topic = position_of(message.topic);
  if (!topic) return;
  if (publishing_[*topic].size() < most_threads) publishing_[*topic].insert(message.process);
  if (*topic == 0) return remember(message, begin(message));
  const auto* const hand = hand_of(*topic, message);
  // What a thread took while events were dropped is unknown.
  if (hand == nullptr && (!noted_ || noted_->contains(message.thread))) ++found_.without_take[*topic];
  note(message.thread);
  if (hand == nullptr || !hand->journey) return remember(message, {});
  auto journey = *hand->journey;
  journey.at_ns[2 * *topic] = message.at_ns;
  reach(journey, 2 * *topic);
  remember(message, journey);
}

ChainFollower::Journey ChainFollower::begin(const Message& message) {
  if (origins_.size() == most_begun) {
    const auto& oldest = origins_.front();
    const auto next =
        std::ranges::find_if(origins_, [&](const Origin& one) { return one.stage > oldest.stage; });
    const auto next_ns = next == origins_.end() ? now_ns_ : next->at_ns[oldest.stage + 1U];
    if (furthest_ > oldest.stage && is_clear(oldest, next_ns)) ++found_.ended[oldest.stage];
    furthest_ = std::max(furthest_, oldest.stage);
    origins_.pop_front();
    ++first_origin_;
  }
  ++found_.begun;
  if (waiting_since_ns_ == 0) waiting_since_ns_ = message.at_ns;
  origins_.push_back({.at_ns = {message.at_ns}});
  Journey journey;
  journey.origin = first_origin_ + origins_.size() - 1;
  journey.at_ns[0] = message.at_ns;
  journey.processes[0] = message.process;
  return journey;
}

const ChainFollower::Hand* ChainFollower::hand_of(std::size_t topic, const Message& message) const {
  const bool is_of_latest = wish_.steps[topic].is_of_latest;
  const auto& hands = is_of_latest ? latest_[topic - 1] : hands_;
  const auto hand = hands.find(is_of_latest ? message.process : message.thread);
  // Another process may have got the thread's number.
  const bool fits =
      hand != hands.end() && hand->second.topic == topic - 1 && hand->second.process == message.process;
  return fits ? &hand->second : nullptr;
}

void ChainFollower::remember(const Message& message, std::optional<Journey> journey) {
  if (publishers_.size() == most_publishers && !publishers_.contains(message.publisher))
    publishers_.erase(
        std::ranges::min_element(publishers_, {}, [](const auto& one) { return one.second.last_ns; }));
  auto& publisher = publishers_[message.publisher];
  publisher.process = message.process;
  publisher.last_ns = message.at_ns;
  if (publisher.messages.size() == most_remembered) publisher.messages.pop_front();
  const auto number = message.number.value_or(0);
  publisher.messages.push_back({number, message.thread, message.at_ns + stamped_ns, journey});
  // Threads that ended are among them. Without its call a message has its stamp the latest that is possible.
  if (calls_.size() == most_threads) calls_.clear();
  calls_[message.thread] = {message.publisher, number};
}

// A thread that does something else has published.
void ChainFollower::end_call(std::uint32_t thread, std::int64_t at_ns) {
  const auto call = calls_.find(thread);
  if (call == calls_.end()) return;
  if (const auto publisher = publishers_.find(call->second.first); publisher != publishers_.end()) {
    auto& messages = publisher->second.messages;
    const auto sent = std::find_if(messages.rbegin(), messages.rend(),
                                   [&](const auto& one) { return one.number <= call->second.second; });
    if (sent != messages.rend() && sent->number == call->second.second)
      sent->stamped_ns = std::min(sent->stamped_ns, at_ns);
  }
  calls_.erase(call);
}

void ChainFollower::turned(std::uint32_t thread, std::int64_t at_ns) {
  end_call(thread, at_ns);
  hands_.erase(thread);
  note(thread);
}

void ChainFollower::note(std::uint32_t thread) {
  if (noted_ && noted_->size() < most_threads) noted_->insert(thread);
}

// If another thread used the same publisher at that time, the message is unknown too: its stamp fits both.
ChainFollower::Origins ChainFollower::find(const Message& message, std::size_t topic) {
  if (!message.number) return {};
  const auto publisher = publishers_.find(message.publisher);
  if (publisher == publishers_.end()) return {.is_forgotten = true};
  auto& messages = publisher->second.messages;
  const auto found = std::ranges::lower_bound(messages, *message.number, {}, &Sent::number);
  if (found == messages.end() || found->number != *message.number) return {.is_forgotten = true};
  bool is_unclear = false;
  const auto blur = [&](const Sent& sent) {
    is_unclear = true;
    if (sent.journey && sent.journey->origin >= first_origin_)
      origins_[sent.journey->origin - first_origin_].is_unclear = true;
  };
  for (auto before = found; before != messages.begin();) {
    --before;
    if (found->stamped_ns - before->stamped_ns > 2 * stamped_ns) break;
    if (before->thread != found->thread && before->stamped_ns > message.stamp_ns) blur(*before);
  }
  if (is_unclear) {
    blur(*found);
    ++found_.unknown_takes[topic];
    return {};
  }
  found->stamped_ns = std::min(found->stamped_ns, message.stamp_ns);
  return {.journey = found->journey ? &*found->journey : nullptr};
}

void ChainFollower::taken(const Message& message) {
  now_ns_ = std::max(now_ns_, message.at_ns);
  turned(message.thread, message.at_ns);
  const auto topic = position_of(message.topic);
  if (!topic) return;
  Hand hand{.process = message.process, .topic = *topic, .journey = {}};
  const auto from = find(message, *topic);
  if (message.publisher == 0 || from.is_forgotten) {
    ++found_.unknown_takes[*topic];
    // This message may continue one that is under way.
    if (continues(*topic, message.process)) forget_under_way();
  } else if (from.journey != nullptr) {
    hand.journey = *from.journey;
    hand.journey->at_ns[2 * *topic + 1] = message.at_ns;
    hand.journey->processes[*topic + 1] = message.process;
    if (continues(*topic, message.process)) reach(*hand.journey, 2 * *topic + 1);
  }
  if (*topic + 1 == wish_.steps.size()) {
    if (hand.journey) arrive(*hand.journey);
    return;
  }
  if (wish_.steps[*topic + 1].is_of_latest) {
    // A duplicate, or a message too late to be known, changes nothing.
    if (message.publisher != 0 && !message.number) return;
    if (latest_[*topic].size() < most_threads || latest_[*topic].contains(message.process))
      latest_[*topic].insert_or_assign(message.process, hand);
  } else {
    if (hands_.size() == most_threads) hands_.erase(hands_.begin());
    hands_.insert_or_assign(message.thread, hand);
  }
}

void ChainFollower::reach(const Journey& journey, std::size_t stage) {
  if (journey.origin < first_origin_) return;
  auto& origin = origins_[journey.origin - first_origin_];
  if (stage <= origin.stage) return;
  origin.stage = static_cast<Stage>(stage);
  // On another path its first steps may differ.
  std::copy_n(journey.at_ns.begin(), stage + 1, origin.at_ns.begin());
}

void ChainFollower::arrive(const Journey& journey) {
  const auto from_ns = journey.at_ns[0], to_ns = journey.at_ns[last_stage()];
  const auto verdict = probing_.judge(
      from_ns, to_ns, [this](std::int64_t ns) { return wish_.age && ns > wish_.age->count(); });
  const bool is_late = verdict == Probing::Verdict::late;
  last_arrival_ns_ = to_ns;
  waiting_since_ns_ = 0;
  auto* const path = path_of(journey);
  if (path == nullptr) {
    found_.forgotten += verdict == Probing::Verdict::not_judged ? 0 : 1;
    found_.forgotten_late += is_late ? 1 : 0;
    return;
  }
  path->last_ns = to_ns;
  if (verdict == Probing::Verdict::not_judged) {
    ++path->not_judged;
    return;
  }
  for (std::size_t part = 0; part < path->parts.size(); ++part)
    path->parts[part].add(journey.at_ns[part + 1] - journey.at_ns[part]);
  if (keep_row_) keep_row_({path->id, Row::Quantity::age, path->age.count(), from_ns, to_ns, is_late});
  path->age.add(to_ns - from_ns);
  path->late += is_late ? 1 : 0;
}

// nullptr: most_paths are in use.
ChainPath* ChainFollower::path_of(const Journey& journey) {
  const std::vector<std::uint32_t> processes(
      journey.processes.begin(),
      journey.processes.begin() + static_cast<std::ptrdiff_t>(wish_.steps.size() + 1));
  if (const auto known = paths_.find(processes); known != paths_.end()) return &known->second;
  if (!make_room_for_path()) return nullptr;
  auto& path = paths_[processes];
  path.id = next_id_++;
  for (const auto process : processes) path.parties.push_back(party_of_(process));
  path.parts.resize(last_stage());
  return &path;
}

bool ChainFollower::make_room_for_path() {
  if (paths_.size() + ended_paths_.size() < most_paths) return true;
  const auto forget = [&](const ChainPath& path) {
    found_.forgotten += path.age.count();
    found_.forgotten_late += path.late;
  };
  if (!ended_paths_.empty()) {
    forget(ended_paths_.front());
    ended_paths_.erase(ended_paths_.begin());
    return true;
  }
  const auto oldest =
      std::ranges::min_element(paths_, {}, [](const auto& one) { return one.second.last_ns; });
  if (now_ns_ - oldest->second.last_ns < idle_ns) return false;
  forget(oldest->second);
  paths_.erase(oldest);
  return true;
}

void ChainFollower::interrupt() {
  hands_.clear();
  calls_.clear();
  noted_.emplace();
  for (auto& hands : latest_)
    for (auto& [process, hand] : hands) hand.journey.reset();
  waiting_since_ns_ = 0;
  forget_under_way();
}

// Counts those that ended; the fate of the others is unknown.
void ChainFollower::forget_under_way() {
  if (origins_.empty()) return;
  found_.ended = ended();
  first_origin_ += origins_.size();
  origins_.clear();
  furthest_ = 0;
}

// Another process may get the same number.
void ChainFollower::retire(std::uint32_t process) {
  const auto is_of_it = [&](const auto& one) { return one.second.process == process; };
  const auto has_it = [&](const auto& all) { return std::ranges::find(all, process) != all.end(); };
  std::erase_if(hands_, is_of_it);
  std::erase_if(publishers_, is_of_it);
  for (auto& hands : latest_) {
    hands.erase(process);
    for (auto& [id, hand] : hands)
      if (hand.journey && has_it(hand.journey->processes)) hand.journey.reset();
  }
  for (auto& processes : publishing_) processes.erase(process);
  std::erase_if(paths_, [&](auto& one) {
    if (!has_it(one.first)) return false;
    ended_paths_.push_back(one.second);
    return true;
  });
}

ChainFollower::Ended ChainFollower::ended() const {
  // How far any earlier one came.
  std::vector<Stage> before;
  for (auto furthest = furthest_; const auto& origin : origins_) {
    before.push_back(furthest);
    furthest = std::max(furthest, origin.stage);
  }
  auto ended = found_.ended;
  std::array<std::int64_t, most_stages> later_ns{};  // by stage: when a later one came further; 0: none did
  for (auto i = origins_.size(); i > 0; --i) {
    const auto& origin = origins_[i - 1];
    const auto stage = origin.stage;
    const auto next_ns = later_ns[stage];
    if (before[i - 1] > stage && (next_ns != 0 || now_ns_ - origin.at_ns[0] > under_way_ns) &&
        is_clear(origin, next_ns != 0 ? next_ns : now_ns_))
      ++ended[stage];
    std::copy_n(origin.at_ns.begin() + 1, stage, later_ns.begin());
  }
  return ended;
}

std::int64_t ChainFollower::silent_ns() const {
  if (last_arrival_ns_ == 0 || waiting_since_ns_ == 0 || now_ns_ - waiting_since_ns_ <= under_way_ns)
    return 0;
  return now_ns_ - last_arrival_ns_;
}

Chain ChainFollower::findings() const {
  auto chain = found_;
  chain.paths = ended_paths_;
  for (const auto& [processes, path] : paths_) chain.paths.push_back(path);
  chain.ended = ended();
  chain.silent_ns = silent_ns();
  return chain;
}

}  // namespace ontime::listen
