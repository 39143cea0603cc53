// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <fstream>
#include <string>

#include <fmt/format.h>

#include "journal/journal.hpp"
#include "listen/listen.hpp"
#include "listen/processes.hpp"
#include "listen/why.hpp"
#include "trace/trace.hpp"

namespace ontime::listen {
namespace {

constexpr trace::Room room{.bytes = std::size_t{24} << 20, .events = 50'000};

Party owner_of(std::int32_t thread) {
  Party owner;
  if (thread <= 0) return owner;
  std::ifstream status(fmt::format("/proc/{}/status", thread));
  constexpr std::string_view word = "Tgid:";
  for (std::string line; std::getline(status, line);)
    if (line.starts_with(word))
      owner.process = static_cast<std::uint32_t>(std::strtoul(line.c_str() + word.size(), nullptr, 10));
  if (owner.process == 0) return owner;
  owner.name = process_name(owner.process);
  return owner;
}

}  // namespace

class Explainer::Record {
 public:
  Record() {
    journal_.hold();
    recorder_.emplace(journal_, room);
  }

  void explain(std::vector<Miss>& misses) {
    std::vector<Miss*> seen;
    for (auto& miss : misses)
      if (miss.course.taken_ns != 0 && seen.size() < most_explained) seen.push_back(&miss);
    const auto from_ns = [](const Miss* miss) { return span_of(*miss).from_ns; };
    std::stable_sort(seen.begin(), seen.end(),
                     [&](const auto* one, const auto* other) { return from_ns(one) < from_ns(other); });
    std::vector<trace::Span> spans;
    spans.reserve(seen.size());
    for (const auto* miss : seen) spans.push_back(span_of(*miss));
    // In the order of their beginnings, as they are given.
    const auto windows = recorder_->cut(std::move(spans));
    for (std::size_t i = 0; i < windows.size(); ++i) seen[i]->why = why(*seen[i], windows[i], owner_of);
  }

 private:
  journal::Journal journal_{trace::kinds()};
  std::optional<trace::Recorder> recorder_;
};

Explainer::Explainer() try : record_(std::make_unique<Record>()) {
} catch (const trace::Error& error) {
  throw Error(error.what());
} catch (const journal::Error& error) {
  throw Error(error.what());
}
Explainer::~Explainer() = default;
void Explainer::explain(std::vector<Miss>& misses) { record_->explain(misses); }

}  // namespace ontime::listen
