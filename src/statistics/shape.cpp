// SPDX-License-Identifier: Apache-2.0
#include "statistics/shape.hpp"

#include <algorithm>
#include <numeric>
#include <span>
#include <tuple>
#include <utility>

namespace ontime::statistics {
namespace {

using roundtrip::Fate;
using roundtrip::Sample;

constexpr std::int64_t slices_of_a_run = 1000;  // as long as it was to be
constexpr std::size_t most_slices = 2000;       // a run that is longer has longer ones
constexpr std::int64_t second_ns = 1'000'000'000;
// Of a run of no stated length: they become longer with it. 512 are a second.
constexpr std::int64_t short_slice_ns = second_ns / 512;
constexpr double far = 10;            // times as long as all before: slices so long would hide all before
constexpr std::size_t most_far = 20;  // more messages are no exception
constexpr std::size_t most_worst = 10;

bool is_longer(const Worst& one, const Worst& other) { return one.took_ns > other.took_ns; }

// When it was answered, or given up.
std::int64_t over_ns(const Sample& sample, std::int64_t timeout_ns) {
  return sample.fate == Fate::lost ? nth_after(sample.sent_ns, timeout_ns, 1) : sample.received_ns;
}

// Two stretches become one. Their times are gone, so its median is one of the two: that of far more messages,
// else the lower or the higher one. As that changes from one merger to the next, an outlier is not kept long.
void merge(Slice& all, const Slice& other, bool lower) {
  const auto answered = all.sent - all.lost, others = other.sent - other.lost;
  if (answered == 0) {
    all.min_ns = other.min_ns;
    all.p50_ns = other.p50_ns;
    all.max_ns = other.max_ns;
  } else if (others > 0) {
    all.min_ns = std::min(all.min_ns, other.min_ns);
    all.max_ns = std::max(all.max_ns, other.max_ns);
    const bool is_others =
        others / 2 > answered || (others >= answered / 2 && (other.p50_ns < all.p50_ns) == lower);
    if (is_others) all.p50_ns = other.p50_ns;
  }
  all.sent += other.sent;
  all.late += other.late;
  all.lost += other.lost;
  all.skipped_cycles += other.skipped_cycles;
  all.skipped_wait_max_ns = std::max(all.skipped_wait_max_ns, other.skipped_wait_max_ns);
}

}  // namespace

Timeline::Timeline(std::int64_t start_ns, std::optional<std::int64_t> duration_ns)
    : start_ns_(start_ns),
      slice_ns_(duration_ns ? (*duration_ns - 1) / slices_of_a_run + 1 : short_slice_ns),
      stated_ns_(static_cast<double>(duration_ns.value_or(second_ns))) {}

bool Timeline::is_far(const Sample& sample) const {
  const auto all_ns = static_cast<double>(slices_.size()) * static_cast<double>(slice_ns_);
  return static_cast<double>(sample.due_ns) - static_cast<double>(start_ns_) >
         far * std::max(all_ns, stated_ns_);
}

// A robot's own messages are listened to for no stated time, and a run may overrun. Slices are then made
// longer, for the last one would hold all that came later, and a figure would end there.
std::size_t Timeline::index_of(std::int64_t due_ns) {
  if (due_ns <= start_ns_) return 0;
  const auto after = static_cast<std::uint64_t>(due_ns) - static_cast<std::uint64_t>(start_ns_);
  while (after / static_cast<std::uint64_t>(slice_ns_) >= most_slices) double_slices();
  return static_cast<std::size_t>(after / static_cast<std::uint64_t>(slice_ns_));
}

void Timeline::double_slices() {
  close();
  for (std::size_t i = 0; i < slices_.size(); ++i) {
    const auto slice = std::exchange(slices_[i], {});
    merge(slices_[i / 2], slice, lower_);
  }
  slices_.resize((slices_.size() + 1) / 2);
  current_ /= 2;
  slice_ns_ *= 2;
  lower_ = !lower_;
}

Slice& Timeline::at(std::size_t index) {
  if (index >= slices_.size()) slices_.resize(index + 1);
  return slices_[index];
}

void Timeline::message(const Sample& sample) {
  if (!is_far(sample)) return add(sample);
  far_.push_back(sample);
  if (far_.size() <= most_far) return;
  // The run goes on after a long time, at least to the earliest of them.
  auto some = std::exchange(far_, {});
  std::ranges::sort(some, {}, &Sample::due_ns);
  add(some.front());
  for (const auto& one : std::span(some).subspan(1)) message(one);
}

void Timeline::add(const Sample& sample) {
  const auto index = index_of(sample.due_ns);  // it may change where the current slice is
  if (index != current_) close();
  current_ = index;
  auto& slice = at(index);
  ++slice.sent;
  if (sample.fate == Fate::lost) {
    ++slice.lost;
    return;
  }
  if (sample.fate == Fate::late) ++slice.late;
  round_trips_.push_back(between(sample.sent_ns, sample.received_ns));
}

void Timeline::close() {
  if (round_trips_.empty()) return;
  Slice open{.sent = round_trips_.size()};
  const auto [least, greatest] = std::minmax_element(round_trips_.begin(), round_trips_.end());
  open.min_ns = *least;
  open.max_ns = *greatest;
  const auto middle = round_trips_.begin() + static_cast<std::ptrdiff_t>((round_trips_.size() - 1) / 2);
  std::nth_element(round_trips_.begin(), middle, round_trips_.end());
  open.p50_ns = *middle;
  // It may have others from before slices became longer; these are in its count already.
  auto& slice = at(current_);
  slice.sent -= open.sent;
  merge(slice, open, lower_);
  round_trips_.clear();
}

template <class Use>
void Timeline::each_slice(const Series& cycles, Use use) {
  auto due_ns = cycles.least;
  for (auto left = cycles.count; left > 0;) {
    const auto index = index_of(due_ns);
    auto here = left;
    if (cycles.step > 0) {
      // To the next slice's beginning: more than nothing, for this cycle is due before it.
      const auto end_ns = nth_after(start_ns_, slice_ns_, index + 1);
      const auto cycles_to_end = (between(due_ns, end_ns) - 1) / cycles.step + 1;
      here = std::min(left, static_cast<std::uint64_t>(std::max<std::int64_t>(cycles_to_end, 1)));
    }
    use(at(index), here, due_ns);
    left -= here;
    due_ns = nth_after(due_ns, cycles.step, here);
  }
}

void Timeline::skipped(const Series& cycles) {
  each_slice(cycles, [](Slice& slice, std::uint64_t count, std::int64_t) { slice.skipped_cycles += count; });
}

void Timeline::answered(const Series& cycles, std::int64_t at_ns) {
  each_slice(cycles, [&](Slice& slice, std::uint64_t, std::int64_t due_ns) {
    slice.skipped_wait_max_ns = std::max(slice.skipped_wait_max_ns, between(due_ns, at_ns));
  });
}

void Timeline::into(Shape& shape) && {
  const auto near = std::accumulate(slices_.begin(), slices_.end(), std::uint64_t{0},
                                    [](auto sum, const Slice& slice) { return sum + slice.sent; });
  for (const auto& sample : far_)
    if (is_far(sample) && near >= static_cast<std::uint64_t>(far) * far_.size())
      shape.beyond.push_back(sample);
    else
      add(sample);
  close();
  shape.slice_ns = slice_ns_;
  shape.slices = std::move(slices_);
}

void WorstOnes::message(const Sample& sample) {
  if (last_is_kept_)
    for (auto& worst : worst_)
      if (worst.message.index == last_->index) worst.after = sample;
  last_is_kept_ = false;
  if (sample.fate != Fate::lost) {
    auto from_ns = sample.intended_ns;
    if (last_) from_ns = std::max(from_ns, std::min(sample.due_ns, over_ns(*last_, timeout_ns_)));
    const auto took_ns = between(from_ns, sample.received_ns);
    last_is_kept_ = worst_.size() < most_worst || took_ns > worst_.front().took_ns;
    if (last_is_kept_) keep({took_ns, last_, sample, {}});
  }
  last_ = sample;
}

void WorstOnes::keep(const Worst& worst) {
  if (worst_.size() == most_worst) {
    std::pop_heap(worst_.begin(), worst_.end(), is_longer);
    worst_.pop_back();
  }
  worst_.push_back(worst);
  std::push_heap(worst_.begin(), worst_.end(), is_longer);
}

std::vector<Worst> WorstOnes::longest_first() && {
  std::sort(worst_.begin(), worst_.end(), is_longer);
  return std::move(worst_);
}

void Misses::message(const Sample& sample) {
  late_.add(sample.fate == Fate::late);
  lost_.add(sample.fate == Fate::lost);
  missed_.add(sample.fate != Fate::on_time);
  if (sample.fate == Fate::on_time) return end_burst();
  if (in_a_row_++ == 0) from_ns_ = sample.due_ns;
  if (const auto ns = between(from_ns_, sample.due_ns);
      std::tie(bursts_.longest, bursts_.longest_ns) < std::tie(in_a_row_, ns)) {
    bursts_.longest = in_a_row_;
    bursts_.longest_ns = ns;
  }
}

void Misses::end_burst() {
  if (in_a_row_ > 1) ++bursts_.count;
  in_a_row_ = 0;
}

void Misses::into(Summary& summary, double effect) && {
  end_burst();
  const bool late = knows_late(summary.run), loss = knows_loss(summary.run);
  if (late) summary.late_probability = probability(late_.all(), effect);
  if (loss) summary.lost_probability = probability(lost_.all(), effect);
  if (late || loss) summary.missed_probability = probability(missed_.all(), effect);
  summary.bursts = bursts_;
}

}  // namespace ontime::statistics
