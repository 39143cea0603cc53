// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cerrno>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <cstring>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <string_view>
#include <system_error>
#include <tuple>
#include <utility>

#include <arpa/inet.h>
#include <fmt/format.h>
#include <microhttpd.h>

#include "number.hpp"
#include "watch/watch.hpp"

namespace ontime::watch {
namespace {

constexpr unsigned most_at_once = 64, most_of_an_address = 8;
constexpr unsigned most_silent_s = 2;
constexpr std::size_t longest_request = 8192;  // without a body: GET has none

struct Endpoint {
  std::string host;  // as a URL has it
  std::uint16_t port = 0;
  sockaddr_storage address{};
};

Endpoint endpoint_of(const std::string& text) {
  const auto colon = text.rfind(':');
  Endpoint to{colon == text.npos ? "127.0.0.1" : text.substr(0, colon)};
  const auto port = number_in<std::uint16_t>(colon == text.npos ? text : text.substr(colon + 1));
  to.port = port.value_or(0);
  const bool is_v6 = to.host.starts_with('[') && to.host.ends_with(']');
  const auto host = is_v6 ? to.host.substr(1, to.host.size() - 2) : to.host;
  sockaddr_in6 v6{};
  sockaddr_in v4{};
  v6.sin6_family = AF_INET6;
  v4.sin_family = AF_INET;
  v6.sin6_port = v4.sin_port = htons(to.port);
  if (!port || ::inet_pton(is_v6 ? AF_INET6 : AF_INET, host.c_str(),
                           is_v6 ? static_cast<void*>(&v6.sin6_addr) : &v4.sin_addr) != 1)
    throw std::invalid_argument(fmt::format(
        "'{}' is not an address and port, such as 127.0.0.1:9464, [::1]:9464, or 9464 alone (loopback)",
        text));
  std::memcpy(&to.address, is_v6 ? static_cast<const void*>(&v6) : &v4, is_v6 ? sizeof v6 : sizeof v4);
  return to;
}

class Text {
 public:
  explicit Text(const Metrics::Times& times) : times_(times) {}
  // The text and its number, from 1; or 0, and why there is no valid text.
  std::pair<std::string, std::uint64_t> get() {
    std::unique_lock lock(mutex_);
    if (number_ == 0 || !is_younger(times_.fresh)) {
      is_wanted_ = true;
      is_set_.wait_for(lock, times_.patience, [&] { return !is_wanted_; });
    }
    if (number_ == 0) return {"nothing was counted yet\n", 0};
    if (is_younger(times_.valid)) return {text_, number_};
    const auto age = std::chrono::floor<std::chrono::seconds>(std::chrono::steady_clock::now() - set_at_);
    return {fmt::format(
                "the newest counts are {} s old: ontime hangs, for example at a disk that does not answer\n",
                age.count()),
            0};
  }
  void set(std::string text) {
    {
      const std::lock_guard lock(mutex_);
      text_ = std::move(text);
      ++number_;
      set_at_ = std::chrono::steady_clock::now();
      is_wanted_ = false;
    }
    is_set_.notify_all();
  }
  void end() {
    {
      const std::lock_guard lock(mutex_);
      has_ended_ = true;
      is_wanted_ = false;
    }
    is_set_.notify_all();
  }
  bool is_wanted() const {
    const std::lock_guard lock(mutex_);
    return is_wanted_;
  }
  void was_sent(std::uint64_t number) {
    const std::lock_guard lock(mutex_);
    sent_ = std::max(sent_, number);
  }
  bool is_awaited() const {
    const std::lock_guard lock(mutex_);
    return sent_ > 0 && sent_ < number_;
  }

 private:
  bool is_younger(std::chrono::milliseconds time) const {
    return has_ended_ || std::chrono::steady_clock::now() - set_at_ <= time;
  }
  const Metrics::Times times_;
  mutable std::mutex mutex_;
  std::condition_variable is_set_;
  std::string text_;
  std::uint64_t number_ = 0, sent_ = 0;
  std::chrono::steady_clock::time_point set_at_;
  bool is_wanted_ = false, has_ended_ = false;
};

void completed(void* metrics, MHD_Connection*, void** request, MHD_RequestTerminationCode code) {
  const std::unique_ptr<const std::uint64_t> number(static_cast<const std::uint64_t*>(*request));
  if (number && code == MHD_REQUEST_TERMINATED_COMPLETED_OK) static_cast<Text*>(metrics)->was_sent(*number);
}

MHD_Result answer(void* metrics, MHD_Connection* connection, const char* target, const char* method,
                  const char*, const char*, std::size_t*, void** request) {
  const std::string_view asked = method;
  const bool may = asked == MHD_HTTP_METHOD_GET || asked == MHD_HTTP_METHOD_HEAD;
  const bool is_there = target == std::string_view("/metrics");
  std::string text;
  std::uint64_t of_text = 0;
  if (may && is_there) std::tie(text, of_text) = static_cast<Text*>(metrics)->get();
  *request = std::make_unique<std::uint64_t>(of_text).release();  // completed() has it
  using Answer = std::pair<unsigned, std::string>;
  auto [status, body] = of_text > 0 ? Answer(MHD_HTTP_OK, text)
                        : !may      ? Answer(MHD_HTTP_METHOD_NOT_ALLOWED, "GET /metrics\n")
                        : is_there  ? Answer(MHD_HTTP_SERVICE_UNAVAILABLE, text)
                                    : Answer(MHD_HTTP_NOT_FOUND, "not found. See /metrics\n");
  auto* response = MHD_create_response_from_buffer(body.size(), body.data(), MHD_RESPMEM_MUST_COPY);
  if (response == nullptr) return MHD_NO;
  MHD_add_response_header(response, MHD_HTTP_HEADER_CONTENT_TYPE,
                          of_text > 0 ? "text/plain; version=0.0.4; charset=utf-8" : "text/plain");
  MHD_add_response_header(response, MHD_HTTP_HEADER_CONNECTION, "close");
  if (!may) MHD_add_response_header(response, MHD_HTTP_HEADER_ALLOW, "GET, HEAD");
  const auto queued = MHD_queue_response(connection, status, response);
  MHD_destroy_response(response);
  return queued;
}

}  // namespace

struct Metrics::Server {
  explicit Server(const Times& times) : text(times) {}
  std::string host;
  Text text;
  std::unique_ptr<MHD_Daemon, void (*)(MHD_Daemon*)> daemon{nullptr, MHD_stop_daemon};
};

Metrics::Metrics(const std::string& address, const Times& times) : server_(std::make_unique<Server>(times)) {
  const auto to = endpoint_of(address);
  server_->host = to.host;
  errno = 0;
  server_->daemon.reset(MHD_start_daemon(
      MHD_USE_POLL_INTERNAL_THREAD | (to.address.ss_family == AF_INET6 ? MHD_USE_IPv6 : MHD_NO_FLAG), to.port,
      nullptr, nullptr, answer, &server_->text, MHD_OPTION_SOCK_ADDR, &to.address,
      MHD_OPTION_NOTIFY_COMPLETED, completed, &server_->text, MHD_OPTION_CONNECTION_LIMIT, most_at_once,
      MHD_OPTION_PER_IP_CONNECTION_LIMIT, most_of_an_address, MHD_OPTION_CONNECTION_TIMEOUT, most_silent_s,
      MHD_OPTION_CONNECTION_MEMORY_LIMIT, longest_request, MHD_OPTION_END));
  if (!server_->daemon)
    throw std::runtime_error(fmt::format("cannot listen on {}: {}. Fix: choose another address or port",
                                         address, std::generic_category().message(errno)));
}

Metrics::~Metrics() { end(); }  // a request may wait for a text

std::string Metrics::address() const {
  return fmt::format("{}:{}", server_->host,
                     MHD_get_daemon_info(server_->daemon.get(), MHD_DAEMON_INFO_BIND_PORT)->port);
}
void Metrics::set(std::string text) { server_->text.set(std::move(text)); }
void Metrics::end() { server_->text.end(); }
bool Metrics::is_wanted() const { return server_->text.is_wanted(); }
bool Metrics::is_awaited() const { return server_->text.is_awaited(); }

}  // namespace ontime::watch
