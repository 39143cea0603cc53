// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <system_error>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <unistd.h>

#include "background/background.hpp"
#include "background/child.hpp"
#include "process/process.hpp"

namespace ontime::background {
namespace {

using namespace std::chrono_literals;

constexpr auto longest_start = 20s;  // 32 workers on one busy core need a second or two
// Files of up to that size are written in less time than it takes to look at them twice during a run.
constexpr std::uint64_t small_file_bytes = std::uint64_t{64} << 20U;
constexpr auto longest_look = 3s;

void add(std::vector<std::string>& command, const char* kind, int workers, std::uint64_t bytes = 0) {
  if (workers < 0)
    throw Error(fmt::format("load: {} {} workers requested; the number must be 0 or more", workers, kind));
  if (workers == 0) return;
  command.insert(command.end(), {fmt::format("--{}", kind), std::to_string(workers)});
  if (bytes == 0) return;
  // stress-ng divides what it is told among the workers of a kind; `stress` gave it to each.
  std::uint64_t of_all = 0;
  if (__builtin_mul_overflow(bytes, static_cast<std::uint64_t>(workers), &of_all))
    throw Error(
        fmt::format("load: {} {} workers of {} bytes each are more than 2^64 bytes", workers, kind, bytes));
  command.insert(command.end(), {fmt::format("--{}-bytes", kind), std::to_string(of_all)});
}

// Its files lie in its working directory, so the user nobody needs no access to the folders above.
std::vector<std::string> command_for(const Workers& workers, const std::vector<std::string>& prefix,
                                     const std::string& directory) {
  constexpr const char* for_ever = "0";  // without it, stress-ng ends after a day
  std::vector<std::string> command = {"env", "--chdir=" + directory};
  command.insert(command.end(), prefix.begin(), prefix.end());
  // A worker that is killed because memory ran out is missed at the end; stress-ng would start another.
  command.insert(command.end(), {"stress-ng", "--temp-path", ".", "--timeout", for_ever, "--oomable"});
  add(command, "cpu", workers.cpu);
  add(command, "vm", workers.vm, workers.vm_bytes);
  add(command, "io", workers.io);
  add(command, "hdd", workers.hdd, workers.hdd_bytes);
  return command;
}

long children_of(pid_t pid) {
  const auto all = processes();
  return std::ranges::count_if(
      all, [pid](const auto& process) { return process.parent == pid && !process.has_ended(); });
}

Error missing() {
  return Error("load needs stress-ng, which is not installed. Fix: sudo apt install stress-ng");
}

// The most that a process has had mapped; 0: it has ended.
std::uint64_t peak_of(pid_t pid) {
  const auto status = process::text_of(fmt::format("/proc/{}/status", pid)).value_or("");
  const auto peak = process::field(status, "VmPeak");  // "4711 kB"
  return peak ? std::stoull(*peak) * 1024 : 0;
}

// What each vm worker has had mapped beside what stress-ng itself has: it works in a child of its own, which
// maps and unmaps.
std::vector<std::uint64_t> mapped_by_vm_workers(pid_t leader) {
  const auto all = processes();
  std::vector<std::uint64_t> mapped;
  for (const auto& parent : all) {
    if (parent.parent != leader || !parent.name.starts_with("stress-ng-vm")) continue;
    for (const auto& worker : all) {
      const auto itself = peak_of(parent.pid), with_memory = peak_of(worker.pid);
      if (worker.parent == parent.pid && with_memory > itself) mapped.push_back(with_memory - itself);
    }
  }
  return mapped;
}

// The sizes of the files of hdd workers: stress-ng removes their names at once, so only /proc shows them.
class HddFiles {
 public:
  HddFiles() = default;
  explicit HddFiles(pid_t leader) {
    for (const auto& process : processes())
      if (process.parent == leader && process.name.starts_with("stress-ng-hdd")) largest_[process.pid] = 0;
  }
  std::optional<std::uint64_t> look() {
    namespace fs = std::filesystem;
    std::error_code none;
    for (auto& [pid, largest] : largest_) {
      fs::directory_iterator entry(fmt::format("/proc/{}/fd", pid), none);
      // A worker may end meanwhile: `++` would throw then.
      for (; entry != fs::directory_iterator(); entry.increment(none)) {
        const auto file = fs::read_symlink(entry->path(), none).string();
        if (none == std::errc::permission_denied) return {};
        if (file.find("/stress-ng-hdd") != std::string::npos)
          if (const auto size = fs::file_size(entry->path(), none); !none) largest = std::max(largest, size);
      }
      if (none == std::errc::permission_denied) return {};
    }
    const auto smallest = std::ranges::min_element(largest_, {}, &decltype(largest_)::value_type::second);
    return smallest == largest_.end() ? 0 : smallest->second;
  }

 private:
  std::map<pid_t, std::uintmax_t> largest_;  // that was seen, by worker
};

// The folder of the temporary files of stress-ng.
class Folder {
 public:
  Folder(const std::string& parent, bool is_nobodys) : path_(parent + "/stress-ng-XXXXXX") {
    const bool made = mkdtemp(path_.data()) != nullptr;
    if (!made || (is_nobodys && chown(path_.c_str(), nobody, nobody) != 0))
      throw Error(fmt::format("load: cannot create a folder for stress-ng in {}: {}",
                              std::filesystem::path(parent).parent_path().string(),
                              std::generic_category().message(errno)));
  }
  ~Folder() {
    std::error_code none;  // the journal removes the parent folder and reports what remains
    std::filesystem::remove_all(path_, none);
  }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;
  const std::string& path() const { return path_; }

 private:
  std::string path_;
};

class Stress final : public StressLoad {
 public:
  Stress(const Workers&, const std::string& directory, const Groups&);
  bool running() override { return !child_->ended() && children_of(child_->pid()) >= workers_; }
  std::uint64_t vm_bytes() const override { return vm_bytes_; }
  std::optional<std::uint64_t> hdd_bytes() override { return files_.look(); }
  bool end() override { return child_->end(); }
  std::string name() const override { return fmt::format("stress-ng (process {})", child_->pid()); }

 private:
  std::unique_ptr<Folder> folder_;  // longer than what is in it
  std::unique_ptr<Child> child_;
  const long workers_;
  std::uint64_t vm_bytes_ = 0;
  HddFiles files_;
};

Stress::Stress(const Workers& workers, const std::string& directory, const Groups& groups)
    : workers_(long{workers.cpu} + workers.vm + workers.io + workers.hdd) {
  if (workers_ == 0) throw Error("load has no workers. Fix: set cpu, vm, io or hdd to 1 or more");
  const auto prefix = as_nobody(true);  // names a missing capability, without which there is no folder either
  folder_ = std::make_unique<Folder>(directory, !prefix.empty());
  const auto command = command_for(workers, prefix, folder_->path());
  const process::Memory output;
  const auto started = start(command, output.fd(), groups);
  if (started.error == ENOENT) throw missing();
  if (started.pid < 0)
    throw Error(
        fmt::format("stress-ng cannot be started: {}", std::generic_category().message(started.error)));
  child_ = std::make_unique<Child>(started.pid);
  long running = 0;
  std::vector<std::uint64_t> mapped;
  const auto all_run = [&] {
    running = children_of(child_->pid());
    mapped = mapped_by_vm_workers(child_->pid());
    const auto is_whole = [&](auto bytes) { return bytes >= workers.vm_bytes; };
    return running >= workers_ && std::ranges::count_if(mapped, is_whole) >= workers.vm;
  };
  wait_until([&] { return child_->ended() || all_run(); }, longest_start);
  if (!child_->ended() && all_run()) {
    vm_bytes_ = mapped.empty() ? 0 : std::ranges::min(mapped);
    files_ = HddFiles(child_->pid());
    const auto written = [&] { return files_.look().value_or(workers.hdd_bytes) >= workers.hdd_bytes; };
    if (workers.hdd > 0 && workers.hdd_bytes <= small_file_bytes)
      wait_until([&] { return child_->ended() || written(); }, longest_look);
    return;
  }
  auto what = child_->ended()      ? "ended at once"
              : running < workers_ ? fmt::format("runs only {} of {} workers", running, workers_)
                                   : fmt::format("maps {} bytes in its vm workers, requested {} each",
                                                 fmt::join(mapped, ", "), workers.vm_bytes);
  const auto code = child_->exit_code();
  child_.reset();
  const auto said = output.text();
  if (is_of_missing_program(code, said)) throw missing();
  auto text = fmt::format("{} {}; its output:\n{}", fmt::join(command, " "), what, said);
  // Its name is another one in each run: then the same failure of all runs would not be told once.
  for (std::size_t at = 0; (at = text.find(folder_->path())) != text.npos;)
    text.replace(at, folder_->path().size(), "FOLDER");
  throw Error(text);
}

}  // namespace

std::unique_ptr<StressLoad> stress(const Workers& workers, const std::string& directory,
                                   const Groups& groups) {
  return std::make_unique<Stress>(workers, directory, groups);
}

}  // namespace ontime::background
