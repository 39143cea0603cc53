// SPDX-License-Identifier: Apache-2.0
#include <array>
#include <cerrno>
#include <chrono>
#include <memory>
#include <mutex>
#include <optional>
#include <thread>

#include <fmt/format.h>
#include <libmnl/libmnl.h>
#include <linux/rtnetlink.h>
#include <net/if.h>
#include <poll.h>
#include <pthread.h>
#include <sched.h>
#include <sys/eventfd.h>

#include "machine/machine.hpp"
#include "process/process.hpp"

namespace ontime::machine {
namespace {

constexpr std::int64_t at_once_ns = 100'000'000;
constexpr unsigned lower_up = 1U << 16;  // IFF_LOWER_UP of linux/if.h, which does not go beside net/if.h

struct State {
  bool is_up, has_carrier;
};

// Of a message of the kernel's that may be of another interface, or of none.
std::optional<State> state_in(const nlmsghdr& header, unsigned interface) {
  if (header.nlmsg_type != RTM_NEWLINK && header.nlmsg_type != RTM_DELLINK) return {};
  if (header.nlmsg_len < mnl_nlmsg_size(sizeof(ifinfomsg))) return {};
  const auto& about = *static_cast<const ifinfomsg*>(mnl_nlmsg_get_payload(&header));
  if (about.ifi_family != AF_UNSPEC || static_cast<unsigned>(about.ifi_index) != interface) return {};
  if (header.nlmsg_type == RTM_DELLINK) return State{false, false};
  return State{(about.ifi_flags & IFF_UP) != 0, (about.ifi_flags & lower_up) != 0};
}

void ask(mnl_socket& socket, unsigned interface) {
  alignas(nlmsghdr) std::array<char, 128> bytes{};
  auto* const header = mnl_nlmsg_put_header(bytes.data());
  header->nlmsg_type = RTM_GETLINK;
  header->nlmsg_flags = NLM_F_REQUEST;
  auto* const about = static_cast<ifinfomsg*>(mnl_nlmsg_put_extra_header(header, sizeof(ifinfomsg)));
  about->ifi_index = static_cast<int>(interface);
  mnl_socket_sendto(&socket, header, header->nlmsg_len);
}

}  // namespace

class LinkWatch::Listener {
 public:
  explicit Listener(const std::string& interface)
      : interface_(if_nametoindex(interface.c_str())),
        socket_(mnl_socket_open2(NETLINK_ROUTE, SOCK_CLOEXEC | SOCK_NONBLOCK), mnl_socket_close),
        over_(eventfd(0, EFD_CLOEXEC)) {
    if (!socket_ || over_.get() < 0 || mnl_socket_bind(socket_.get(), RTMGRP_LINK, MNL_SOCKET_AUTOPID) != 0)
      throw Error(fmt::format("cannot watch interface {} (netlink)", interface));
    ask(*socket_, interface_);  // it may be down already
    thread_ = std::thread([this] { listen(); });
  }
  ~Listener() {
    eventfd_write(over_.get(), 1);
    thread_.join();
  }
  Listener(const Listener&) = delete;
  Listener& operator=(const Listener&) = delete;

  std::vector<Down> downs() const {
    const std::lock_guard lock(mutex_);
    return downs_;
  }

 private:
  void listen() {
    pthread_setname_np(pthread_self(), "ontime-link");
    const sched_param none{};
    sched_setscheduler(0, SCHED_BATCH, &none);  // it pre-empts nothing that is measured
    std::array<pollfd, 2> waits{{{mnl_socket_get_fd(socket_.get()), POLLIN, 0}, {over_.get(), POLLIN, 0}}};
    while (poll(waits.data(), waits.size(), -1) >= 0 || errno == EINTR) {
      read();  // first: what there is still was before the end
      if ((waits[1].revents & POLLIN) != 0) return;
    }
  }
  void read() {
    alignas(nlmsghdr) std::array<char, 32768> bytes{};
    while (true) {
      const auto size = mnl_socket_recvfrom(socket_.get(), bytes.data(), bytes.size());
      if (size < 0 && errno == ENOBUFS) ask(*socket_, interface_);  // some news was lost
      if (size <= 0) return;
      auto left = static_cast<int>(size);
      const auto* header = reinterpret_cast<const nlmsghdr*>(bytes.data());
      for (; mnl_nlmsg_ok(header, left); header = mnl_nlmsg_next(header, &left))
        if (const auto state = state_in(*header, interface_)) enter(*state);
    }
  }
  void enter(const State& state) {
    const bool carries = state.is_up && state.has_carrier;
    const std::lock_guard lock(mutex_);
    const std::int64_t at_ns = std::chrono::steady_clock::now().time_since_epoch().count();
    const bool goes_on = is_down_ && !downs_.empty() && downs_.back().to_ns == 0;
    const bool is_taken_since = !carries && goes_on && !state.is_up && !downs_.back().taken;
    if (is_taken_since && at_ns - downs_.back().from_ns <= at_once_ns) {
      downs_.back().taken = true;  // its carrier went with it
    } else if (is_taken_since || (carries && goes_on)) {
      downs_.back().to_ns = at_ns;
    }
    const bool begins = !carries && (!is_down_ || (is_taken_since && !downs_.back().taken));
    if (begins && downs_.size() < most) downs_.push_back({at_ns, 0, !state.is_up});
    is_down_ = !carries;
  }

  const unsigned interface_;
  const std::unique_ptr<mnl_socket, int (*)(mnl_socket*)> socket_;
  const process::Fd over_;  // an eventfd
  mutable std::mutex mutex_;
  std::vector<Down> downs_;
  bool is_down_ = false;
  std::thread thread_;
};

LinkWatch::LinkWatch(const std::string& interface) : listener_(std::make_unique<Listener>(interface)) {}
LinkWatch::~LinkWatch() = default;
std::vector<LinkWatch::Down> LinkWatch::downs() const { return listener_->downs(); }

}  // namespace ontime::machine
