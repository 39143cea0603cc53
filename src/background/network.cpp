// SPDX-License-Identifier: Apache-2.0
#include "background/network.hpp"

#include <algorithm>
#include <cerrno>
#include <exception>
#include <system_error>
#include <thread>

#include <fcntl.h>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <sched.h>
#include <unistd.h>

#include "background/background.hpp"
#include "background/child.hpp"

namespace ontime::background {
namespace {

std::string errno_text() { return std::generic_category().message(errno); }

void in_thread(const std::function<void()>& job) {
  std::exception_ptr thrown;
  std::thread([&] {
    try {
      job();
    } catch (...) {
      thrown = std::current_exception();
    }
  }).join();
  if (thrown) std::rethrow_exception(thrown);
}

void enter(const std::string& name) {
  const auto path = "/run/netns/" + name;
  const int fd = open(path.c_str(), O_RDONLY | O_CLOEXEC);
  const bool entered = fd >= 0 && setns(fd, CLONE_NEWNET) == 0;
  const auto why = errno_text();
  if (fd >= 0) close(fd);
  if (!entered) throw Error(fmt::format("network namespace {} cannot be entered: {}", name, why));
}

}  // namespace

void in_namespace(const std::string& name, const std::function<void()>& job) {
  in_thread([&] {
    if (!name.empty()) enter(name);
    job();
  });
}

void in_new_namespace(const std::function<void()>& job) {
  in_thread([&] {
    if (unshare(CLONE_NEWNET) != 0)
      throw Error("a network namespace to try it in cannot be made: " + errno_text());
    job();
  });
}

std::string nft(const std::string& commands) { return output_of({"nft", commands}, "nftables"); }

std::string nft_json(const std::string& commands) {
  return output_of({"nft", "--json", commands}, "nftables");
}

std::string tc(const std::vector<std::string>& arguments) {
  std::vector<std::string> command = {"tc"};
  command.insert(command.end(), arguments.begin(), arguments.end());
  return output_of(command, "iproute2");
}

bool is_interface_name(const std::string& name) {
  constexpr std::size_t longest = 15;
  return !name.empty() && name.size() <= longest && name != "." && name != ".." &&
         std::all_of(name.begin(), name.end(), [](char c) {
           return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-' ||
                  c == '_' || c == '.' || c == '@';
         });
}

}  // namespace ontime::background
