// SPDX-License-Identifier: Apache-2.0
#include "machine/proc.hpp"

#include <algorithm>
#include <numeric>
#include <sstream>

namespace ontime::machine {

void parse_ticks(const std::string& text, Activity& activity) {
  std::istringstream fields(text);
  std::string cpu;
  // user nice system idle iowait irq softirq steal; guests are counted in user and nice already.
  std::vector<std::uint64_t> ticks(8);
  fields >> cpu;
  for (auto& count : ticks) fields >> count;
  if (!fields || cpu != "cpu") return;
  activity.total_ticks = std::accumulate(ticks.begin(), ticks.end(), std::uint64_t{0});
  activity.stolen_ticks = ticks[7];
  activity.busy_ticks = activity.total_ticks - ticks[3] - ticks[4];
}

std::int64_t parse_stall(const std::string& text) {
  const auto line = text.substr(0, text.find('\n'));
  const auto total = line.rfind("total=");
  if (!line.starts_with("some ") || total == line.npos) return -1;
  return number(line.substr(total + 6)).value_or(-1);
}

std::optional<std::string> preemption(const std::optional<std::string>& realtime,
                                      const std::optional<std::string>& debug,
                                      const std::string& command_line, const std::string& version) {
  const auto says = [](const std::string& text, const std::string& what) {
    std::istringstream words(text);
    return std::find(std::istream_iterator<std::string>(words), {}, what) !=
           std::istream_iterator<std::string>();
  };
  if (number(realtime) == 1 || says(version, "PREEMPT_RT")) return "rt";
  if (debug) {  // "none (voluntary) full"
    const auto open = debug->find('('), close = debug->find(')');
    if (open != debug->npos && close != debug->npos && open < close)
      return debug->substr(open + 1, close - open - 1);
  }
  if (says(version, "PREEMPT_DYNAMIC")) {
    std::string chosen = "dynamic";  // a loader adds words of its own: the kernel takes the last one
    std::istringstream words(command_line);
    for (std::string word; words >> word;)
      for (const auto* model : {"none", "voluntary", "full", "lazy"})
        if (word == std::string("preempt=") + model) chosen = model;
    return chosen;
  }
  if (says(version, "PREEMPT")) return "full";
  if (says(version, "PREEMPT_LAZY")) return "lazy";
  if (version.empty()) return {};
  return "none or voluntary";
}

std::vector<std::string> cgroups_of(const std::string& text, const std::string& controller) {
  std::istringstream lines(text);
  for (std::string number, controllers, path; std::getline(lines, number, ':') &&
                                              std::getline(lines, controllers, ':') &&
                                              std::getline(lines, path);) {
    const bool listed = ("," + controllers + ",").find("," + controller + ",") != std::string::npos;
    if (controller.empty() ? !controllers.empty() : !listed) continue;
    std::vector<std::string> groups;
    for (; path.size() > 1; path.resize(path.rfind('/'))) groups.push_back(path);
    groups.emplace_back();
    return groups;
  }
  return {};
}

std::uint64_t parse_file_pages(const std::string& text) {
  std::istringstream lines(text);
  std::uint64_t own = 0, total = 0, bytes = 0;
  for (std::string name; lines >> name >> bytes;)
    if (name == "inactive_file" || name == "active_file")
      own += bytes;
    else if (name == "total_inactive_file" || name == "total_active_file")
      total += bytes;
  return std::max(own, total);  // version 1 has both, version 2 the first
}

void parse_throttled(const std::string& text, GroupQuota& quota) {
  std::istringstream lines(text);
  std::uint64_t count = 0;
  for (std::string name; lines >> name >> count;)
    if (name == "nr_throttled")
      quota.throttled_periods = count;
    else if (name == "throttled_time")  // version 1
      quota.throttled_ns = count;
    else if (name == "throttled_usec")
      quota.throttled_ns = count * 1000;
}

std::optional<Traffic> parse_traffic(const std::string& text, const std::string& interface) {
  const auto counts = field(text, interface);
  if (!counts) return {};
  std::istringstream fields(*counts);
  // Eight counts of what was received, bytes and packets first; then the same of what was sent.
  std::vector<std::uint64_t> all(10);
  for (auto& count : all) fields >> count;
  if (!fields) return {};
  return Traffic{
      .sent_bytes = all[8], .sent_packets = all[9], .received_bytes = all[0], .received_packets = all[1]};
}

std::vector<std::string> parse_segments(const std::string& text) {
  const std::string folder = "/dev/shm/", deleted = " (deleted)";
  std::set<std::string> names;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    const auto found = line.find(folder);
    if (found == line.npos) continue;
    auto name = line.substr(found + folder.size());
    if (name.ends_with(deleted)) name.resize(name.size() - deleted.size());
    for (const auto* prefix : {"fastrtps_", "fastdds_", "iox_", "iceoryx_"})
      if (name.starts_with(prefix)) names.insert(name);
  }
  return {names.begin(), names.end()};
}

}  // namespace ontime::machine
