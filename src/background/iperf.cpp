// SPDX-License-Identifier: Apache-2.0
// Concurrent traffic: iperf3.
#include "background/iperf.hpp"

#include <array>
#include <cerrno>
#include <chrono>
#include <regex>
#include <system_error>
#include <utility>

#include <fcntl.h>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <unistd.h>

#include "background/background.hpp"
#include "background/child.hpp"
#include "process/process.hpp"

namespace ontime::background {
namespace {

using namespace std::chrono_literals;

constexpr auto time_to_start = 20s;
constexpr const char* interval_s = "0.2";
constexpr std::size_t kept_for_people = 2000;

class Pipe {
 public:
  Pipe() {
    std::array<int, 2> ends;
    if (pipe2(ends.data(), O_CLOEXEC) != 0)
      throw Error("cannot create a pipe for iperf3: " + std::generic_category().message(errno));
    out_ = process::Fd(ends[0]);
    in_ = process::Fd(ends[1]);
    fcntl(out_.get(), F_SETFL, O_NONBLOCK);
  }
  int in() const { return in_.get(); }
  // What has been written and not been taken yet.
  std::string take() const {
    std::string text;
    std::array<char, 4096> some;
    for (ssize_t bytes = 0; (bytes = read(out_.get(), some.data(), some.size())) > 0;)
      text.append(some.data(), static_cast<std::size_t>(bytes));
    return text;
  }

 private:
  process::Fd out_, in_;
};

// A container, for example, may have neither setpriv nor the user nobody.
bool can_be_nobody(const std::vector<std::string>& place) { return place.empty() || place.front() == "ip"; }

std::vector<std::string> command_for(const Stream& stream) {
  auto command = stream.place;
  if (stream.priority > 0) command.insert(command.end(), {"chrt", "--fifo", std::to_string(stream.priority)});
  if (can_be_nobody(stream.place)) {
    for (auto& word : as_nobody()) command.push_back(std::move(word));
    command.insert(command.end(), {"env", "TMPDIR=/tmp"});  // the caller's own may be for root alone
  }
  command.insert(command.end(), {"iperf3", "--port", std::to_string(stream.port), "--interval", interval_s,
                                 "--format", "k", "--forceflush"});
  if (!stream.interface.empty()) command.insert(command.end(), {"--bind-dev", stream.interface});
  if (stream.serves) {
    command.insert(command.end(), {"--server", "--one-off", "--bind", stream.address});
    // The first client is served. Twice the rate, over a whole minute, lets ours catch up after starvation.
    if (stream.bits_per_s > 0)
      command.insert(command.end(), {"--server-bitrate-limit", fmt::format("{}/60", 2 * stream.bits_per_s)});
    return command;
  }
  constexpr const char* for_ever = "0";
  command.insert(command.end(),
                 {"--client", stream.address, "--udp", "--bitrate", std::to_string(stream.bits_per_s),
                  "--length", std::to_string(stream.datagram_bytes), "--time", for_ever});
  if (stream.receives) command.emplace_back("--reverse");
  return command;
}

class Iperf final : public Traffic {
 public:
  explicit Iperf(const Stream& stream) : serves_(stream.serves), command_(command_for(stream)) {
    const auto started = start(command_, output_.in(), stream.groups);
    if (started.pid < 0)
      fail(fmt::format("cannot be started: {}", std::generic_category().message(started.error)),
           started.error == ENOENT);
    child_ = std::make_unique<Child>(started.pid);
    wait_until([this] { return child_->ended() || (read(), ready()); }, time_to_start);
    if (child_->ended() || !ready()) {
      const char* const what = child_->ended() ? "ended at once" : "did not start in time";
      const auto code = child_->exit_code();
      child_.reset();
      read();
      fail(fmt::format("{}; its output:\n{}", what, said_), is_of_missing_program(code, said_));
    }
  }

  bool running() override { return !child_->ended(); }
  Moved moved() override {
    read();
    return moved_;
  }

 private:
  [[noreturn]] void fail(const std::string& what, bool is_missing) const {
    if (is_missing) throw Error("traffic needs iperf3, which is not installed. Fix: sudo apt install iperf3");
    throw Error(fmt::format("{} {}", fmt::join(command_, " "), what));
  }

  bool ready() const { return serves_ ? said_.find("listening") != said_.npos : moved_.seconds > 0; }

  void read() {
    const auto text = output_.take();
    if (said_.size() < kept_for_people) said_ += text.substr(0, kept_for_people - said_.size());
    line_ += text;
    std::size_t begin = 0;
    for (auto end = line_.find('\n'); end != line_.npos; begin = end + 1, end = line_.find('\n', begin)) {
      const auto interval = parse_interval(line_.substr(begin, end - begin));
      if (!interval) continue;
      moved_.seconds = interval->to_s;
      moved_.bits += interval->bits;
    }
    line_.erase(0, begin);
  }

  const bool serves_;
  const std::vector<std::string> command_;
  const Pipe output_;
  std::string said_, line_;
  Moved moved_;
  std::unique_ptr<Child> child_;
};

}  // namespace

std::optional<Interval> parse_interval(const std::string& line) {
  static const std::regex report(
      R"(\[ *\d+\] +(\d+\.\d+)-(\d+\.\d+) +sec +\S+ +[KMGT]?Bytes +(\d+(?:\.\d+)?) Kbits/sec( .*)?)");
  std::smatch found;
  if (line.size() > 200 || !std::regex_match(line, found, report)) return {};
  if (line.find("sender") != line.npos || line.find("receiver") != line.npos) return {};
  const double from = std::stod(found[1]), to = std::stod(found[2]), kbit_s = std::stod(found[3]);
  if (to < from) return {};
  return Interval{from, to, kbit_s * 1000 * (to - from)};
}

std::unique_ptr<Traffic> traffic(const Stream& stream) { return std::make_unique<Iperf>(stream); }

}  // namespace ontime::background
