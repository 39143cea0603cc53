// SPDX-License-Identifier: Apache-2.0
#include <cerrno>
#include <chrono>
#include <condition_variable>
#include <cstring>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <string_view>
#include <system_error>
#include <utility>

#include <arpa/inet.h>
#include <fmt/format.h>
#include <microhttpd.h>

#include "number.hpp"
#include "watch/watch.hpp"

namespace ontime::watch {
namespace {

constexpr unsigned most_at_once = 64;
constexpr unsigned patience_s = 2;
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
  // A request before the first text waits for it; empty: it did not come in time.
  std::optional<std::string> get() {
    std::unique_lock lock(mutex_);
    is_set_.wait_for(lock, std::chrono::seconds(patience_s), [&] { return text_.has_value(); });
    return text_;
  }
  void set(std::string text) {
    {
      const std::lock_guard lock(mutex_);
      text_ = std::move(text);
    }
    is_set_.notify_all();
  }

 private:
  std::mutex mutex_;
  std::condition_variable is_set_;
  std::optional<std::string> text_;
};

MHD_Result answer(void* metrics, MHD_Connection* connection, const char* target, const char* method,
                  const char*, const char*, std::size_t*, void**) {
  const std::string_view asked = method;
  const bool may = asked == MHD_HTTP_METHOD_GET || asked == MHD_HTTP_METHOD_HEAD;
  const bool is_there = target == std::string_view("/metrics");
  const auto text = may && is_there ? static_cast<Text*>(metrics)->get() : std::nullopt;
  using Answer = std::pair<unsigned, std::string>;
  auto [status, body] = text       ? Answer(MHD_HTTP_OK, *text)
                        : !may     ? Answer(MHD_HTTP_METHOD_NOT_ALLOWED, "GET /metrics\n")
                        : is_there ? Answer(MHD_HTTP_SERVICE_UNAVAILABLE, "nothing was counted yet\n")
                                   : Answer(MHD_HTTP_NOT_FOUND, "not found. See /metrics\n");
  auto* response = MHD_create_response_from_buffer(body.size(), body.data(), MHD_RESPMEM_MUST_COPY);
  if (response == nullptr) return MHD_NO;
  MHD_add_response_header(response, MHD_HTTP_HEADER_CONTENT_TYPE,
                          text ? "text/plain; version=0.0.4; charset=utf-8" : "text/plain");
  MHD_add_response_header(response, MHD_HTTP_HEADER_CONNECTION, "close");
  if (!may) MHD_add_response_header(response, MHD_HTTP_HEADER_ALLOW, "GET, HEAD");
  const auto queued = MHD_queue_response(connection, status, response);
  MHD_destroy_response(response);
  return queued;
}

}  // namespace

struct Metrics::Server {
  std::string host;
  Text text;
  std::unique_ptr<MHD_Daemon, void (*)(MHD_Daemon*)> daemon{nullptr, MHD_stop_daemon};
};

Metrics::Metrics(const std::string& address) : server_(std::make_unique<Server>()) {
  const auto to = endpoint_of(address);
  server_->host = to.host;
  errno = 0;
  server_->daemon.reset(MHD_start_daemon(
      MHD_USE_POLL_INTERNAL_THREAD | (to.address.ss_family == AF_INET6 ? MHD_USE_IPv6 : MHD_NO_FLAG), to.port,
      nullptr, nullptr, answer, &server_->text, MHD_OPTION_SOCK_ADDR, &to.address,
      MHD_OPTION_CONNECTION_LIMIT, most_at_once, MHD_OPTION_CONNECTION_TIMEOUT, patience_s,
      MHD_OPTION_CONNECTION_MEMORY_LIMIT, longest_request, MHD_OPTION_END));
  if (!server_->daemon)
    throw std::runtime_error(fmt::format("cannot listen on {}: {}. Fix: choose another address or port",
                                         address, std::generic_category().message(errno)));
}

Metrics::~Metrics() = default;

std::string Metrics::address() const {
  return fmt::format("{}:{}", server_->host,
                     MHD_get_daemon_info(server_->daemon.get(), MHD_DAEMON_INFO_BIND_PORT)->port);
}
void Metrics::set(std::string text) { server_->text.set(std::move(text)); }

}  // namespace ontime::watch
