// SPDX-License-Identifier: Apache-2.0
// Which threads receive an interface's packets. Linux 6.8 and later report it by netlink's family "netdev"
// (Documentation/netlink/specs/netdev.yaml; Debian 12 has no header for it). Before, only their names tell.
#include <array>
#include <cerrno>
#include <functional>
#include <memory>
#include <set>

#include <fmt/format.h>
#include <libmnl/libmnl.h>
#include <linux/genetlink.h>
#include <net/if.h>
#include <sys/mount.h>

#include "settings/file.hpp"
#include "settings/kinds.hpp"

namespace ontime::settings {
namespace {

constexpr std::uint8_t get_napi = 11;
constexpr std::uint16_t interface_index = 1, thread_id = 4;

using Attribute = std::function<void(const nlattr&)>;
using Socket = std::unique_ptr<mnl_socket, decltype(&mnl_socket_close)>;

// Begins a request, in the form that libmnl puts it together, in these bytes.
nlmsghdr* request(std::array<char, 256>& bytes, std::uint16_t family, std::uint8_t command, int flags) {
  auto* const header = mnl_nlmsg_put_header(bytes.data());
  header->nlmsg_type = family;
  header->nlmsg_flags = static_cast<std::uint16_t>(NLM_F_REQUEST | flags);
  auto* const generic = static_cast<genlmsghdr*>(mnl_nlmsg_put_extra_header(header, sizeof(genlmsghdr)));
  generic->cmd = command;
  generic->version = 1;
  return header;
}

int on_attribute(const nlattr* attribute, void* each) {
  (*static_cast<const Attribute*>(each))(*attribute);
  return MNL_CB_OK;
}
int on_message(const nlmsghdr* header, void* each) {
  return mnl_attr_parse(header, sizeof(genlmsghdr), on_attribute, each);
}

// Calls `each` for every attribute of the answers. Returns 0 or an errno: EINTR, if what was asked for has
// changed meanwhile.
int ask(mnl_socket* socket, const nlmsghdr* asked, Attribute each) {
  if (mnl_socket_sendto(socket, asked, asked->nlmsg_len) < 0) return errno;
  std::vector<char> answer(static_cast<std::size_t>(MNL_SOCKET_BUFFER_SIZE));
  for (int more = MNL_CB_OK; more > MNL_CB_STOP;) {
    const auto bytes = mnl_socket_recvfrom(socket, answer.data(), answer.size());
    if (bytes < 0 && errno == EINTR) continue;
    if (bytes < 0) return errno;
    more = mnl_cb_run(answer.data(), static_cast<std::size_t>(bytes), 0, mnl_socket_get_portid(socket),
                      on_message, &each);
    if (more < 0) return errno;
    if ((asked->nlmsg_flags & NLM_F_DUMP) == 0) break;
  }
  return 0;
}

// Of this thread's network namespace, into `threads`. Returns 0 or an errno: EOPNOTSUPP, if this kernel does
// not say.
int ask_kernel(const std::string& interface, std::set<pid_t>& threads) {
  const Socket socket(mnl_socket_open2(NETLINK_GENERIC, SOCK_CLOEXEC), mnl_socket_close);
  if (!socket || mnl_socket_bind(socket.get(), 0, MNL_SOCKET_AUTOPID) < 0) return EOPNOTSUPP;
  alignas(nlmsghdr) std::array<char, 256> family_bytes{}, napi_bytes{};
  auto* const family = request(family_bytes, GENL_ID_CTRL, CTRL_CMD_GETFAMILY, 0);
  mnl_attr_put_strz(family, CTRL_ATTR_FAMILY_NAME, "netdev");
  std::uint16_t netdev = 0;
  const int unknown = ask(socket.get(), family, [&](const nlattr& attribute) {
    if (mnl_attr_get_type(&attribute) == CTRL_ATTR_FAMILY_ID) netdev = mnl_attr_get_u16(&attribute);
  });
  if (unknown != 0 || netdev == 0) return EOPNOTSUPP;
  auto* const napi = request(napi_bytes, netdev, get_napi, NLM_F_DUMP);
  mnl_attr_put_u32(napi, interface_index, if_nametoindex(interface.c_str()));
  return ask(socket.get(), napi, [&](const nlattr& attribute) {
    if (mnl_attr_get_type(&attribute) == thread_id)
      threads.insert(static_cast<pid_t>(mnl_attr_get_u32(&attribute)));
  });
}

// Nothing: this kernel does not say.
std::optional<std::set<pid_t>> threads_by_kernel(const std::string& interface) {
  constexpr int most_tries = 10;
  std::set<pid_t> threads;
  int error = EINTR;
  for (int tries = 0; error == EINTR && tries < most_tries; ++tries) {
    threads.clear();
    error = ask_kernel(interface, threads);
  }
  if (error == EOPNOTSUPP) return {};
  if (error != 0) throw trouble("the NAPI threads of " + interface, error);
  return threads;
}

// Whether the interface of that name has, or may have, such threads, in the namespace that this thread is in.
bool may_have_threads(const std::string& name) {
  if (if_nametoindex(name.c_str()) == 0) return false;
  if (mount("sysfs", "/sys", "sysfs", 0, nullptr) != 0) return true;  // which shows the namespace's own
  const auto is_threaded = read_file(fmt::format("/sys/class/net/{}/threaded", name));
  umount2("/sys", MNT_DETACH);
  return is_threaded != "0";
}

}  // namespace

bool is_napi_thread(const std::string& thread, const std::string& interface) {
  constexpr std::size_t short_name = 15;
  const auto name = fmt::format("napi/{}-", interface);
  if (thread.starts_with(name))  // and no thread of eth0-x is one of eth0
    return thread.find_first_not_of("0123456789", name.size()) == thread.npos;
  return name.size() > short_name && thread == name.substr(0, short_name);
}

std::vector<Thing> napi_threads_by_name(const std::string& interface) {
  auto found = threads_named("napi/");
  std::erase_if(found, [&](const Thing& one) { return !is_napi_thread(one.title(), interface); });
  if (!found.empty() && in_another_namespace([&] { return may_have_threads(interface); }))
    throw journal::Error(fmt::format(
        "another network namespace has an interface {0} with threads too; before Linux 6.8 ontime cannot "
        "distinguish them. Fix: ip link set {0} name NAME",
        interface));
  return found;
}

std::vector<Thing> napi_threads_of(const std::string& interface) {
  const auto told = threads_by_kernel(interface);
  if (!told) return napi_threads_by_name(interface);
  auto found = threads_named("napi/");
  std::erase_if(found, [&](const Thing& one) { return !told->contains(std::stoi(one.what)); });
  return found;
}

}  // namespace ontime::settings
