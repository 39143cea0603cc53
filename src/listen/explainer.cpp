// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <chrono>

#include <fmt/format.h>

#include "listen/listen.hpp"
#include "listen/processes.hpp"
#include "listen/why.hpp"
#include "process/process.hpp"

namespace ontime::listen {
namespace {

constexpr trace::Room room{.bytes = std::size_t{24} << 20, .events = 50'000};
constexpr std::int64_t least_before_ns = 100'000'000;
constexpr std::size_t most_kept = 10'000;  // events of a window, some 130 bytes each in a file

Party owner_of(std::int32_t thread) {
  const auto status = process::text_of(fmt::format("/proc/{}/status", thread)).value_or("");
  const auto process =
      static_cast<std::uint32_t>(process::number(process::field(status, "Tgid")).value_or(0));
  return process == 0 ? Party{} : Party{process, process_name(process)};
}

}  // namespace

Explainer::Explainer(bool keeps_surroundings) try : keeps_surroundings_(keeps_surroundings) {
  journal_.hold();
  recorder_.emplace(journal_, room);
} catch (const trace::Error& error) {
  throw Error(error.what());
} catch (const journal::Error& error) {
  throw Error(error.what());
}

void Explainer::explain(std::vector<Miss>& misses) {
  std::vector<Miss*> seen;
  for (auto& miss : misses)
    if (miss.course.taken_ns != 0 && seen.size() < most_explained) seen.push_back(&miss);
  // Recorder::cut() expects spans in the order of their beginnings.
  std::ranges::stable_sort(seen, {}, [this](const Miss* miss) { return wanted(*miss).from_ns; });
  std::vector<trace::Span> spans;
  spans.reserve(seen.size());
  for (const auto* miss : seen) spans.push_back(wanted(*miss));
  auto windows = recorder_->cut(spans);
  for (std::size_t i = 0; i < windows.size(); ++i) explain(*seen[i], windows[i], spans[i]);
}

trace::Span Explainer::wanted(const Miss& miss) const {
  auto span = span_of(miss);
  if (!keeps_surroundings_) return span;
  const auto now_ns = std::chrono::nanoseconds(std::chrono::steady_clock::now().time_since_epoch()).count();
  span.from_ns = std::min(span.from_ns, miss.course.taken_ns - least_before_ns);
  span.to_ns = std::max(span.to_ns, std::min(now_ns, miss.course.taken_ns + window_after_ns));
  return span;
}

void Explainer::explain(Miss& miss, trace::Window& window, const trace::Span& asked) {
  if (!keeps_surroundings_) {
    miss.why = why(miss, window, owner_of);
    return;
  }
  auto around = std::make_shared<Surroundings>();
  const OwnerOf noted = [&](std::int32_t thread) { return around->owners[thread] = owner_of(thread); };
  // The span has more events than a window holds: the delay alone may fit.
  const bool is_cut_short = !window.whole && window.span.to_ns < asked.to_ns;
  miss.why = why(miss, is_cut_short ? recorder_->cut({span_of(miss)}).front() : window, noted);
  if (window.events.size() > most_kept) {
    window.events.resize(most_kept);
    window.span.to_ns = std::max(window.events.back().at_ns, window.span.from_ns);
    window.whole = false;
  }
  around->window = std::move(window);
  miss.surroundings = std::move(around);
}

}  // namespace ontime::listen
