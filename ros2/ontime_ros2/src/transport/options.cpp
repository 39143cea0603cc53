// SPDX-License-Identifier: Apache-2.0
#include "options.hpp"

namespace ontime::transport::ros2 {
namespace {

template <typename Value>
struct Word {
  const char* word;
  Value value;
};

constexpr Word<Executor> executors[] = {{"single", Executor::single},
                                        {"multi", Executor::multi},
                                        {"events", Executor::events},
                                        {"waitset", Executor::waitset},
                                        {"wait", Executor::wait}};
constexpr Word<Allocator> allocators[] = {
    {"default", Allocator::standard}, {"tlsf", Allocator::tlsf}, {"pmr", Allocator::pmr}};
constexpr Word<bool> switches[] = {{"off", false}, {"on", true}};

std::string text_of(const Config& config, const std::string& name, const std::string& otherwise) {
  const auto found = config.options.find(name);
  return found == config.options.end() ? otherwise : found->second;
}

template <typename Value, std::size_t N>
Value choice(const Config& config, const char* name, const Word<Value> (&words)[N], const char* otherwise) {
  const std::string text = text_of(config, name, otherwise);
  std::string known;
  for (const auto& [word, value] : words) {
    if (text == word) return value;
    known += std::string(known.empty() ? "" : ", ") + word;
  }
  throw WrongInput("ros2: option " + std::string(name) + ": '" + text + "' is not one of " + known);
}

template <typename Value, std::size_t N>
const char* word_in(const Word<Value> (&words)[N], Value wanted) {
  for (const auto& [word, value] : words)
    if (value == wanted) return word;
  return "";
}

// Who waits is chosen by Config::receive; an executor that does not wait there would measure something else.
void check_who_waits(const Config& config, Executor executor) {
  const bool on_our_thread = executor == Executor::waitset || executor == Executor::wait;
  if (on_our_thread == (config.receive == Receive::waitset)) return;
  throw WrongInput("ros2: executor " + std::string(word_of(executor)) + " needs --receive " +
                   (on_our_thread ? "waitset" : "listener"));
}

}  // namespace

const char* word_of(Executor executor) { return word_in(executors, executor); }
const char* word_of(Allocator allocator) { return word_in(allocators, allocator); }

Options options_of(const Config& config) {
  Options options;
  options.executor =
      choice(config, "executor", executors, config.receive == Receive::waitset ? "waitset" : "single");
  check_who_waits(config, options.executor);
  options.allocator = choice(config, "allocator", allocators, "default");
  options.rmw = text_of(config, "rmw", "");
  options.intra_process = choice(config, "intra-process", switches, "off");
  if (options.intra_process && config.receive == Receive::waitset)
    throw WrongInput(
        "ros2: intra-process needs --receive listener: within a process rclcpp delivers by its executors");
  options.loaned = choice(config, "loaned", switches, "off");
  if (options.loaned && options.allocator != Allocator::standard)
    throw WrongInput("ros2: loaned messages need allocator default: they are in the middleware's memory");
  options.statistics = choice(config, "statistics", switches, "on");
  options.node = text_of(config, "node", config.role == Role::client ? "ontime_ping" : "ontime_pong");
  return options;
}

Options options_beside(Options options) {
  if (options.executor != Executor::waitset && options.executor != Executor::wait)
    options.executor = Executor::single;
  options.allocator = Allocator::standard;
  options.intra_process = options.loaned = options.statistics = false;
  return options;
}

}  // namespace ontime::transport::ros2
