// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <utility>

#include <fmt/format.h>
#include <linux/capability.h>

#include "bag/bag.hpp"
#include "campaign/campaign.hpp"
#include "flags.hpp"
#include "listening.hpp"
#include "realtime/privileges.hpp"
#include "scenario/scenario.hpp"
#include "transport/shipped.hpp"

namespace ontime::app {
namespace {

// Uses the first installed transport that can read topics of any type.
std::unique_ptr<listen::Sensor> reader_of(const std::set<std::string>& topics, const listen::Limits& limits) {
  const auto names = transport::available();
  std::string missing;
  for (const auto& one : transport::all_shipped) {
    if (!one.can.hears) continue;
    missing += fmt::format("{}{}{}", missing.empty() ? "" : "; ", one.name, one.install);
    if (std::ranges::find(names, one.name) != names.end()) try {
        return listen::as_reader(
            transport::load(std::string(one.name)).hear(scenario::domain_of_environment(), topics), limits);
      } catch (const transport::Error& error) {
        throw campaign::Error(3, fmt::format("--reader: {}", error.what()));
      } catch (const std::invalid_argument& error) {
        throw wrong("{}", error.what());
      }
  }
  throw campaign::Error(
      3, fmt::format("--reader: no installed transport can read topics of any type. Needed: {}", missing));
}

}  // namespace

std::unique_ptr<listen::Sensor> sensor_in_processes(const listen::Limits& limits,
                                                    std::vector<listen::ChainWish> chains) try {
  return listen::in_processes(limits, std::move(chains));
} catch (const listen::Denied& denied) {
  const bool has_all = realtime::privileges().has(CAP_SYS_ADMIN);
  throw campaign::Error(3,
                        fmt::format("{}. Fix: {}", denied.what(),
                                    has_all ? "see /sys/kernel/security/lockdown, and filters of system calls"
                                            : campaign::as_root()));
}

std::unique_ptr<listen::Sensor> sensor_of(const ListenArguments& arguments, const listen::Limits& limits,
                                          const std::vector<listen::ChainWish>& chains,
                                          const std::set<std::string>& topics) {
  if (arguments.reader) return reader_of(topics, limits);
  if (!arguments.bag.empty()) return bag::open(arguments.bag, limits, topics);
  if (!arguments.packets.empty()) return listen::in_packets(arguments.packets, limits);
  if (!arguments.pcap.empty()) return listen::in_pcap_file(arguments.pcap, limits);
  return sensor_in_processes(limits, chains);
}

}  // namespace ontime::app
