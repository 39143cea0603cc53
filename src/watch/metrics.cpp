// SPDX-License-Identifier: Apache-2.0
#include <charconv>
#include <functional>
#include <stdexcept>
#include <utility>

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <fmt/format.h>

#include "watch/watch.hpp"

namespace ontime::watch {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
using asio::ip::tcp;
using Text = std::shared_ptr<const std::string>;

constexpr std::size_t most_at_once = 4;
constexpr std::chrono::seconds patience{2};  // for all of a request, and for all of an answer
constexpr std::uint32_t longest_header = 8192;

// One request and its answer. It lives as long as something of it is under way.
class Session : public std::enable_shared_from_this<Session> {
 public:
  Session(tcp::socket socket, Text text, std::function<void()> over)
      : stream_(std::move(socket)), text_(std::move(text)), over_(std::move(over)) {}
  ~Session() { over_(); }
  Session(const Session&) = delete;
  Session& operator=(const Session&) = delete;

  void start() {
    parser_.header_limit(longest_header);
    parser_.body_limit(0);
    stream_.expires_after(patience);
    http::async_read(stream_, buffer_, parser_,
                     [self = shared_from_this()](beast::error_code error, std::size_t) {
                       if (error == http::error::end_of_stream || error == beast::error::timeout) return;
                       self->answer(error);
                     });
  }

 private:
  void answer(beast::error_code error) {
    const auto& request = parser_.get();
    const bool may = request.method() == http::verb::get || request.method() == http::verb::head;
    if (error)
      fill(http::status::bad_request, "this is no request that can be answered\n");
    else if (!may)
      fill(http::status::method_not_allowed, "GET /metrics\n");
    else if (request.target() != "/metrics")
      fill(http::status::not_found, "what there is, is at /metrics\n");
    else
      fill(http::status::ok, *text_);
    if (may && request.method() == http::verb::head) response_.body().clear();
    stream_.expires_after(patience);
    http::async_write(stream_, response_, [self = shared_from_this()](beast::error_code, std::size_t) {
      beast::error_code ignored;
      self->stream_.socket().shutdown(tcp::socket::shutdown_send, ignored);
    });
  }

  void fill(http::status status, std::string body) {
    response_.result(status);
    response_.set(http::field::content_type,
                  status == http::status::ok ? "text/plain; version=0.0.4; charset=utf-8" : "text/plain");
    if (status == http::status::method_not_allowed) response_.set(http::field::allow, "GET, HEAD");
    response_.keep_alive(false);
    response_.body() = std::move(body);
    response_.content_length(response_.body().size());
  }

  beast::tcp_stream stream_;
  beast::flat_buffer buffer_{std::size_t{2} * longest_header};
  http::request_parser<http::empty_body> parser_;
  http::response<http::string_body> response_;
  const Text text_;
  const std::function<void()> over_;
};

tcp::endpoint endpoint_of(const std::string& text) {
  const auto colon = text.rfind(':');
  auto host = colon == text.npos ? std::string("127.0.0.1") : text.substr(0, colon);
  const auto digits = colon == text.npos ? text : text.substr(colon + 1);
  std::uint16_t port = 0;
  const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), port);
  if (host.starts_with('[') && host.ends_with(']')) host = host.substr(1, host.size() - 2);
  beast::error_code no_address;
  const auto address = asio::ip::make_address(host, no_address);
  if (error != std::errc{} || end != digits.data() + digits.size() || no_address)
    throw std::invalid_argument(fmt::format(
        "'{}' is no address and port; write it as 127.0.0.1:9464, [::1]:9464, or 9464 alone, which is on "
        "loopback",
        text));
  return {address, port};
}

}  // namespace

class Metrics::Server {
 public:
  explicit Server(const tcp::endpoint& endpoint) : acceptor_(context_, endpoint) { accept(); }

  ~Server() { closing_ = true; }
  Server(const Server&) = delete;
  Server& operator=(const Server&) = delete;

  tcp::endpoint endpoint() const { return acceptor_.local_endpoint(); }
  void set(std::string text) { text_ = std::make_shared<const std::string>(std::move(text)); }
  void serve_for(std::chrono::milliseconds time) {
    context_.restart();
    context_.run_for(time);
  }

 private:
  // A connection beyond the most waits in the kernel's queue, which is short.
  void accept() {
    if (closing_ || accepting_ || sessions_ >= most_at_once) return;
    accepting_ = true;
    acceptor_.async_accept([this](beast::error_code error, tcp::socket socket) {
      accepting_ = false;
      if (!error) {
        ++sessions_;
        std::make_shared<Session>(std::move(socket), text_, [this] {
          --sessions_;
          accept();
        })->start();
      }
      accept();
    });
  }

  std::size_t sessions_ = 0;
  bool accepting_ = false, closing_ = false;
  Text text_ = std::make_shared<const std::string>();
  asio::io_context context_{1};
  tcp::acceptor acceptor_;
};

Metrics::Metrics(const std::string& address) {
  const auto endpoint = endpoint_of(address);
  try {
    server_ = std::make_unique<Server>(endpoint);
  } catch (const boost::system::system_error& error) {
    throw std::runtime_error(fmt::format("{} cannot be listened at: {}. Choose another address or port.",
                                         address, error.code().message()));
  }
}

Metrics::~Metrics() = default;

std::string Metrics::address() const {
  const auto endpoint = server_->endpoint();
  const auto host = endpoint.address().to_string();
  return fmt::format("{}:{}", endpoint.address().is_v6() ? "[" + host + "]" : host, endpoint.port());
}

void Metrics::set(std::string text) { server_->set(std::move(text)); }
void Metrics::serve_for(std::chrono::milliseconds time) { server_->serve_for(time); }

}  // namespace ontime::watch
