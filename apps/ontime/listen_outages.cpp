// SPDX-License-Identifier: Apache-2.0
// A results file of `ontime listen` that cannot be written for a while, or is not at its path any more.
#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <ctime>

#include <fcntl.h>
#include <fmt/chrono.h>
#include <fmt/format.h>

#include "listen_results.hpp"

namespace ontime::app {
namespace {

using namespace std::chrono_literals;

constexpr int most_gaps = 20;  // each is a note of each run
// A disk that is all but full fails again and again, each with two lines.
constexpr std::chrono::nanoseconds longest_until_tried_again = 10min;

std::string utc_time() { return fmt::format("{:%F %T} UTC", fmt::gmtime(std::time(nullptr))); }

// "F: the disk is full. Free space, …" has the name that the file has already, and what may have been done
// since: "the disk is full".
std::string reason_of(std::string error, const std::string& path) {
  if (error.starts_with(path + ": ")) error.erase(0, path.size() + 2);
  error.resize(std::min(error.find(". "), error.size()));
  if (error.ends_with('.')) error.pop_back();
  return error;
}

}  // namespace

std::string set_lone_log_aside(const std::string& results) {
  constexpr int most_aside = 5;
  const auto log = record::lone_log(results);
  if (log.empty() || record::is_being_written(results)) return "";
  for (int number = 1; number <= most_aside; ++number) {
    const auto aside = fmt::format("{}.old{}", log, number == 1 ? "" : std::to_string(number));
    if (::renameat2(AT_FDCWD, log.c_str(), AT_FDCWD, aside.c_str(), RENAME_NOREPLACE) == 0)
      return fmt::format(
          "results: {} has the newest samples of a file that was renamed or removed. It is "
          "{} now. To read it, rename it to NAME-wal beside that file NAME",
          log, aside);
    if (errno != EEXIST) break;
  }
  return "";
}

// A full disk ends neither listening nor printing, and may have space again later. A recording of a bag is
// not tried again: its messages do not come again.
void ListenResults::until_it_fails(const std::function<void()>& what) {
  if (failed_ && is_recording_) return;
  try {
    if (needs_file_) writer_.begin_anew();
    needs_file_ = false;
    what();
    if (!failed_) return;
    writer_.flush();
    go_on();
  } catch (const record::Error& error) {
    fail(error.what());
  }
}

void ListenResults::fail(const std::string& why) {
  waiting_ = 0;
  if (is_recording_) kept_.clear();
  for (auto& [key, kept] : kept_) {  // what was to be written may be lost
    kept.told_at.reset();
    kept.is_told = false;
  }
  if (!failed_) {
    const bool is_soon = went_on_at_ && Clock::now() - *went_on_at_ < longest_until_tried_again;
    until_tried_again_ =
        is_soon ? std::min(2 * until_tried_again_, longest_until_tried_again) : try_again_after;
    failed_.emplace(Failed{why, utc_time(), {}});
    if (!is_recording_) tell(fmt::format("results: recording stopped, and is tried again: {}", why));
  }
  failed_->why = why;
  failed_->again_at = Clock::now() + until_tried_again_;
}

void ListenResults::go_on() {
  const auto gap = fmt::format("not recorded from {} to {}", failed_->since, utc_time());
  if (++gaps_ <= most_gaps)
    for (const auto& [key, kept] : kept_)
      if (kept.run != 0)
        writer_.note(kept.run, {"not-recorded",
                                fmt::format("{}{}: {}{}", gap, gaps_ == most_gaps ? ", and maybe later" : "",
                                            reason_of(failed_->why, writer_.path()),
                                            keeps_worst_ ? " (counts are of all messages)" : ""),
                                std::nullopt, std::nullopt});
  failed_.reset();
  went_on_at_ = Clock::now();
  tell(fmt::format("results: recording goes on; {}", gap));
}

void ListenResults::tell(const std::string& news) { news_ += (news_.empty() ? "" : "; ") + news; }

void ListenResults::write(const std::vector<listen::Flow>& wanted) {
  const auto now = Clock::now();
  // Also while it cannot be written: a file that was removed to make space frees it only once it is closed.
  if (owns_file && !needs_file_ && now >= look_at_file_) {
    look_at_file_ = now + look_at_file_every;
    if (writer_.has_moved()) {
      begin_anew(wanted);
      if (failed_) failed_->again_at = now;
    }
  }
  if (failed_ && now < failed_->again_at) return;
  until_it_fails([&] { write(wanted, false); });
}

// What is counted until now is of the old file.
void ListenResults::begin_anew(const std::vector<listen::Flow>& wanted) {
  tell(fmt::format("results: {} was renamed or removed; recording goes on in a new file of this name",
                   writer_.path()));
  try {
    listen::Findings findings;
    findings.flows = wanted;
    end_runs(findings, false, "");
  } catch (const record::Error&) {  // no space; the file has no name any more
  }
  for (auto& [key, kept] : kept_) {
    Kept next;
    next.since = kept.since;
    next.last = kept.last;
    next.counted = next.counted_before = kept.counted;
    kept = std::move(next);
  }
  names_.clear();
  runs_ = 0;
  gaps_ = 0;
  before_ = machine::activity();
  about_at_.reset();
  needs_file_ = true;
}

void ListenResults::count_not_recorded() {
  if (keeps_worst_) return;
  const auto reader = writer_.reader();
  for (auto& [key, kept] : kept_) {
    if (kept.run == 0) continue;
    kept.not_recorded =
        static_cast<std::int64_t>(kept.values.count()) + kept.lost - reader.number_of_samples(kept.run);
  }
}

}  // namespace ontime::app
