// SPDX-License-Identifier: Apache-2.0
#include "background/kinds.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <filesystem>
#include <system_error>

#include <fmt/format.h>
#include <net/if.h>
#include <sys/stat.h>

#include "background/background.hpp"
#include "background/child.hpp"
#include "json.hpp"

namespace ontime::background {
namespace {

using conditions::disciplines_of;
using journal::Value;
using nlohmann::json;

// "a/b/c" → a, b, c; the first may be empty.
std::vector<std::string> parts_of(const std::string& what) {
  std::vector<std::string> parts(1);
  for (const char c : what) {
    if (c == '/')
      parts.emplace_back();
    else
      parts.back() += c;
  }
  return parts;
}

bool is_namespace_name(const std::string& name) {
  return name.size() <= 100 && name != "." && name != ".." &&
         std::all_of(name.begin(), name.end(),
                     [](unsigned char c) { return c > ' ' && c < 0x7f && c != '/'; });
}

bool is_there(const std::string& netns) {
  std::error_code ignored;
  return netns.empty() || std::filesystem::exists("/run/netns/" + netns, ignored);
}

// Runs the job in the network namespace; its errors become journal errors.
template <class Job>
void inside(const std::string& netns, Job job) {
  try {
    journal::within_namespace(netns, job);
  } catch (const Error& error) {
    throw journal::Error(error.what());
  }
}

std::uint64_t own_namespace() {
  struct stat found {};
  if (stat("/proc/thread-self/ns/net", &found) != 0)
    throw Error("/proc/thread-self/ns/net: " + std::generic_category().message(errno));
  return found.st_ino;
}

bool accepts_table(const std::string& what) {
  const auto parts = parts_of(what);
  return parts.size() == 3 && is_namespace_name(parts[0]) && (parts[1] == "netdev" || parts[1] == "inet") &&
         journal::is_own_name(parts[2]);
}

Value read_table(const std::string& what) {
  const auto parts = parts_of(what);
  if (!is_there(parts[0])) return {};
  Value found;
  inside(parts[0], [&] {
    for (const auto& table : nft_list("table"))
      if (table.value("family", "") == parts[1] && table.value("name", "") == parts[2])
        found = fmt::format("{}:{}", own_namespace(), table.value("handle", 0));
  });
  return found;
}

void write_table(const std::string& what, const Value& value, const Value& present) {
  const auto parts = parts_of(what);
  if (!value && read_table(what) != present && present != journal::to_be_made)
    throw journal::Error(
        fmt::format("nftables table {} is not removed: another process has replaced it", what));
  inside(parts[0], [&] {
    try {
      nft(fmt::format("{} table {} {}", value ? "create" : "delete", parts[1], parts[2]));
    } catch (const Error& error) {
      if (std::string_view(error.what()).find("File exists") == std::string_view::npos) throw;
      throw journal::MadeByAnother(error.what());
    }
  });
}

constexpr unsigned our_qdisc_number = 0x6f74;  // and so on, for those below it

// "3:eth0"
bool is_numbered_interface(const std::string& text) {
  const auto colon = text.find_first_not_of("0123456789");
  return colon != text.npos && colon > 0 && colon < 10 && text[colon] == ':' &&
         journal::is_interface_name(text.substr(colon + 1));
}

bool accepts_qdisc(const std::string& what) {
  const auto parts = parts_of(what);
  return (parts.size() == 2 || (parts.size() == 3 && conditions::is_qdisc(parts[2]))) &&
         is_namespace_name(parts[0]) &&
         (journal::is_interface_name(parts[1]) || is_numbered_interface(parts[1]));
}

template <bool (*accepts)(const std::string&)>
bool accepts_local(const std::string& what) {
  return what.starts_with('/') && accepts(what);
}

// Its name now, in the caller's network namespace; nothing: the interface, and its qdisc, are gone, or it was
// moved to another namespace.
std::optional<std::string> name_now(const std::string& interface) {
  if (!is_numbered_interface(interface)) return interface;
  std::array<char, IF_NAMESIZE> name{};
  if (if_indextoname(static_cast<unsigned>(std::stoul(interface)), name.data()) == nullptr) return {};
  return name.data();
}

Value read_qdisc(const std::string& what) {
  const auto parts = parts_of(what);
  if (!is_there(parts[0])) return {};
  Value found;
  inside(parts[0], [&] {
    const auto name = name_now(parts[1]);
    if (!name) return;
    const auto answer = json_or_discarded(tc({"-json", "qdisc", "show", "dev", *name}));
    if (!answer.is_array()) throw Error("tc -json qdisc show: the output is not JSON");
    for (const auto& qdisc : answer) {
      // The kernel's own choice has no handle.
      if (!qdisc.value("root", false) || qdisc.value("handle", "0:") == "0:") continue;
      found = qdisc.value("kind", "") + " " + qdisc.value("handle", "");
    }
  });
  return found;
}

// After an error the journal removes the root, and all below it.
void make_qdisc(const std::string& interface, const std::string& words) {
  const auto all = disciplines_of(words);
  tc(make_root(interface, all.front().words));
  for (std::size_t i = 1; i < all.size(); ++i) try {
      std::vector<std::string> command = {"qdisc",  "add",
                                          "dev",    interface,
                                          "parent", our_qdisc_handle + all[i].below,
                                          "handle", fmt::format("{:x}:", our_qdisc_number + i)};
      command.insert(command.end(), all[i].words.begin(), all[i].words.end());
      tc(command);
    } catch (const Error& error) {
      throw Error(fmt::format("below {}: {}", all[i].below, error.what()));
    }
}

void write_qdisc(const std::string& what, const Value& value, const Value& present) {
  const auto parts = parts_of(what);
  if (value && present)
    throw journal::Error(fmt::format(
        "{0} already has a qdisc ({1}), which link.delay or link.qdisc would replace. Fix: tc qdisc "
        "del dev {0} root",
        parts[1].substr(parts[1].find(':') + 1), *present));
  inside(parts[0], [&] {
    const auto name = name_now(parts[1]);
    if (!name) throw Error(fmt::format("interface {} does not exist any more", parts[1]));
    if (!value)
      // The kernel refuses, if another program's root is there by now.
      tc({"qdisc", "del", "dev", *name, "root", "handle", our_qdisc_handle});
    else
      make_qdisc(*name, parts.size() == 3 ? parts[2] : "netem");
  });
}

}  // namespace

std::string nft(const std::string& commands) { return output_of({"nft", commands}, "nftables"); }

std::vector<json> nft_list(const std::string& kind) {
  const auto command = "list " + kind + "s";
  const auto answer = json_or_discarded(output_of({"nft", "--json", command}, "nftables"));
  if (!answer.is_object()) throw Error("nft --json " + command + ": the output is not JSON");
  std::vector<json> all;
  for (const auto& entry : answer.value("nftables", json::array()))
    all.push_back(entry.value(kind, json::object()));
  return all;
}

std::string tc(std::vector<std::string> arguments) {
  arguments.insert(arguments.begin(), "tc");
  return output_of(arguments, "iproute2");
}

const char* const our_qdisc_handle = "6f74:";

std::string our_qdisc_of(const std::string& words) {
  return fmt::format("{} {}", disciplines_of(words).front().words.front(), our_qdisc_handle);
}

std::vector<std::string> make_root(const std::string& interface, const std::vector<std::string>& words) {
  std::vector<std::string> command = {"qdisc", "add", "dev", interface, "root", "handle", our_qdisc_handle};
  command.insert(command.end(), words.begin(), words.end());
  return command;
}

const journal::Kind table_kind = {"nft-table", journal::Scope::mount_namespace, accepts_table, read_table,
                                  write_table};

const journal::Kind qdisc_kind = {"qdisc", journal::Scope::mount_namespace, accepts_qdisc, read_qdisc,
                                  write_qdisc};

const journal::Kind local_table_kind = {"local nft-table", journal::Scope::network_namespace,
                                        accepts_local<accepts_table>, read_table, write_table};

const journal::Kind local_qdisc_kind = {"local qdisc", journal::Scope::network_namespace,
                                        accepts_local<accepts_qdisc>, read_qdisc, write_qdisc};

const journal::Kind& kind_of_tables(const std::string& netns) {
  return netns.empty() ? local_table_kind : table_kind;
}
const journal::Kind& kind_of_qdiscs(const std::string& netns) {
  return netns.empty() ? local_qdisc_kind : qdisc_kind;
}

std::span<const journal::Kind> kinds() {
  static const std::array all{table_kind, qdisc_kind, local_table_kind, local_qdisc_kind};
  return all;
}

std::string table_what(const std::string& netns, const std::string& family, const std::string& name) {
  return fmt::format("{}/{}/{}{}", netns, family, journal::own_prefix, name);
}

std::string qdisc_what(const std::string& netns, const std::string& interface, const std::string& words) {
  return fmt::format("{}/{}:{}{}{}", netns, if_nametoindex(interface.c_str()), interface,
                     words.empty() ? "" : "/", words);
}

}  // namespace ontime::background
