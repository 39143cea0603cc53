// SPDX-License-Identifier: Apache-2.0
#include "machine/clock.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <sstream>
#include <vector>

#include <sys/timex.h>
#include <unistd.h>

#include "machine/machine.hpp"
#include "machine/proc.hpp"
#include "number.hpp"

namespace ontime::machine {
namespace {

using namespace std::chrono_literals;
using nlohmann::json;

constexpr auto patience = 500ms;

std::optional<double> decimal(const std::optional<std::string>& text) {
  const auto value = text ? number_in<double>(*text) : std::nullopt;
  return value && std::isfinite(*value) ? value : std::nullopt;
}

std::optional<std::int64_t> whole_ns(double ns) {
  constexpr double most = 9e18;
  if (std::abs(ns) > most) return {};
  return std::llround(ns);
}

// The word behind a name, as pmc writes them.
std::optional<std::string> behind(const std::string& text, const std::string& name) {
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    std::istringstream words(line);
    std::string first, second;
    if (words >> first >> second && first == name) return second;
  }
  return {};
}

// The program that sets the clock tells the kernel.
Synchronisation of_kernel() {
  timex now{};
  const bool known = ntp_adjtime(&now) >= 0;
  if (!known || (now.status & STA_UNSYNC) != 0) return {};
  return {true, std::int64_t{now.maxerror} * 1000, {}};
}

std::optional<Synchronisation> of_chrony() {
  const auto said = answer_of({"chronyc", "-c", "tracking"}, patience);
  return said ? parse_chrony(*said) : std::nullopt;
}

// Where there is no ptp4l, pmc waits for it.
std::optional<Synchronisation> of_ptp() {
  if (access("/var/run/ptp4l", F_OK) != 0) return {};
  const auto said =
      answer_of({"pmc", "-u", "-b", "0", "GET CURRENT_DATA_SET", "GET PARENT_DATA_SET"}, patience);
  return said ? parse_ptp(*said) : std::nullopt;
}

json told(const char* source, const Synchronisation& clock) {
  return {{"synchronised", clock.synchronised},
          {"source", clock.synchronised ? json(source) : json(nullptr)},
          {"error_ns", clock.error_ns ? json(*clock.error_ns) : json(nullptr)},
          {"reference", clock.reference ? json(*clock.reference) : json(nullptr)},
          {"realtime_offset_ns", realtime_offset_ns()}};
}

}  // namespace

Reading read_beside_monotonic(clockid_t other) {
  constexpr int readings = 100;
  Reading best;
  auto least_ns = std::numeric_limits<std::int64_t>::max();
  for (int reading = 0; reading < readings; ++reading) {
    const auto before_ns = read_ns(CLOCK_MONOTONIC);
    const auto other_ns = read_ns(other);
    const auto took_ns = read_ns(CLOCK_MONOTONIC) - before_ns;
    if (took_ns >= least_ns) continue;
    least_ns = took_ns;
    best = {before_ns + took_ns / 2, other_ns};
  }
  return best;
}

std::int64_t realtime_offset_ns() {
  const auto [monotonic_ns, realtime_ns] = read_beside_monotonic(CLOCK_REALTIME);
  return realtime_ns - monotonic_ns;
}

std::int64_t read_ns(clockid_t clock) {
  timespec time{};
  clock_gettime(clock, &time);
  return std::int64_t{time.tv_sec} * 1'000'000'000 + time.tv_nsec;
}

std::optional<Synchronisation> parse_chrony(const std::string& text) {
  std::vector<std::string> fields;
  std::istringstream line(text.substr(0, text.find('\n')));
  for (std::string field; std::getline(line, field, ',');) fields.push_back(field);
  constexpr std::size_t identity = 0, reference = 1, offset = 4, root_delay = 10, root_dispersion = 11,
                        leap = 13;
  if (fields.size() <= leap) return {};
  const auto off_s = decimal(fields[offset]), delay_s = decimal(fields[root_delay]),
             dispersion_s = decimal(fields[root_dispersion]);
  if (!off_s || !delay_s || !dispersion_s) return {};
  if (fields[leap] == "Not synchronised" || fields[identity] == "7F7F0101") return Synchronisation{};
  return Synchronisation{true, whole_ns((std::abs(*off_s) + *dispersion_s + *delay_s / 2) * 1e9),
                         fields[reference]};
}

std::optional<Synchronisation> parse_ptp(const std::string& text) {
  const auto steps = number(behind(text, "stepsRemoved"));
  const auto offset_ns = decimal(behind(text, "offsetFromMaster")),
             delay_ns = decimal(behind(text, "meanPathDelay"));
  auto grandmaster = behind(text, "grandmasterIdentity");
  if (!steps || !offset_ns || !delay_ns || !grandmaster) return {};
  // What the way there and the way back take is known by their sum alone.
  return Synchronisation{true, whole_ns(std::abs(*offset_ns) + *delay_ns), std::move(grandmaster)};
}

json clock_state() {
  const auto kernel = of_kernel();
  // ptp4l may set the network card's clock alone; the program that copies it from there tells the kernel.
  const auto ptp = kernel.synchronised ? of_ptp() : std::nullopt;
  if (ptp && ptp->synchronised) return told("ptp", *ptp);
  const auto chrony = of_chrony();
  if (chrony && chrony->synchronised) return told("chrony", *chrony);
  return told("kernel", kernel);
}

}  // namespace ontime::machine
