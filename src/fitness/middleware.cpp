// SPDX-License-Identifier: Apache-2.0
// The installed DDS libraries, by their file names, and the known faults of their versions.
#include <algorithm>

#include <fmt/format.h>

#include "fitness/look.hpp"

namespace ontime::fitness {
namespace {

struct Library {
  const char* file;
  const char* name;
};
constexpr Library libraries[] = {
    {"libddsc.so.", "Cyclone DDS"}, {"libfastrtps.so.", "Fast DDS"}, {"libfastdds.so.", "Fast DDS"}};

struct Fault {
  const char* name;
  const char* version;  // a prefix
  const char* what;
  const char* remedy;
};
// Faults that this project found and works around.
constexpr Fault faults[] = {
    {"Cyclone DDS", "0.10.",
     "it does not count packets lost to a full socket buffer, and cannot set the priority of its receive "
     "threads",
     "set the priorities of its other threads in CYCLONEDDS_URI (Threads); ontime counts losses itself"},
    {"Fast DDS", "2.9.", "it cannot set priorities of its threads (2.13 can) and gives them no names",
     "start the robot's program as SCHED_FIFO, which its threads inherit: chrt --fifo 70 PROGRAM (for "
     "ontime: "
     "realtime on)"}};

Finding finding_of(const Library& library, const std::string& version, const std::string& folder) {
  const auto is = fmt::format("{} {} ({})", library.name, version, folder);
  for (const auto& fault : faults)
    if (fault.name == std::string_view(library.name) && version.starts_with(fault.version))
      return {Severity::hint, is, "", fault.what, fault.remedy};
  return fine(is);
}

}  // namespace

Findings middlewares(const Look& look) {
  std::vector<std::string> folders{"/usr/lib", "/usr/local/lib"};
  for (const auto& name : look.names("/usr/lib"))
    if (name.find("-linux-gnu") != name.npos) folders.push_back("/usr/lib/" + name);
  for (const auto& distribution : look.names("/opt/ros"))
    for (const auto* lib : {"/lib", "/lib/x86_64-linux-gnu", "/lib/aarch64-linux-gnu"})
      folders.push_back("/opt/ros/" + distribution + lib);
  Findings findings;
  for (const auto& folder : folders) {
    const auto files = look.names(folder);
    for (const auto& file : files)
      for (const auto& library : libraries) {
        if (!file.starts_with(library.file)) continue;
        const auto version = file.substr(std::string_view(library.file).size());
        // libfastrtps.so.2.9 is a link to libfastrtps.so.2.9.1.
        const bool is_link =
            std::ranges::any_of(files, [&](const auto& other) { return other.starts_with(file + "."); });
        if (!is_link && version.find('.') != version.npos)
          findings.push_back(finding_of(library, version, folder));
      }
  }
  return findings;
}

}  // namespace ontime::fitness
