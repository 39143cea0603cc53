// SPDX-License-Identifier: Apache-2.0
#include "transport/cyclonedds/configuration.hpp"

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <iterator>
#include <regex>
#include <sstream>
#include <system_error>
#include <vector>

#include <boost/algorithm/string/predicate.hpp>
#include <sched.h>

#include "transport/dds.hpp"
#include "transport/xml.hpp"

namespace ontime::transport::cyclonedds {
namespace {

using boost::algorithm::iends_with;
using boost::algorithm::iequals;
using boost::algorithm::istarts_with;
using xml::Document;
using xml::Tree;

constexpr NamedThread named_threads[] = {
    {"recv", "receive", true},
    {"recvUC", "receive", false},
    {"recvMC", "receive", false},
    {"dq.user", "delivery", true},
    {"xmit.user", "send", true},
    {"sendq", "send", false},
    {"dq.builtins", "discovery", true},
    {"lease", "discovery", true},
    {"fsm", "discovery", true},
    {"tev", "timer", true},
    {"gc", "other", true},
    {"debmon", "other", true},
    {"listen", "other", false},
    {"threadmon", "other", false},
};

constexpr const char* who = "cyclonedds";

std::string attribute(const Tree& element, const char* name) {
  for (const auto& [kind, attributes] : element)
    if (kind == "<xmlattr>") return xml::child_text(attributes, name);
  return {};
}

// Cyclone's own form: files separated by commas, and XML in place.
std::vector<Document> parse_uri(const std::string& uri, const std::string& origin) {
  std::vector<Document> documents;
  for (std::size_t at = uri.find_first_not_of(" ,\t\n"); at != std::string::npos;) {
    if (uri[at] == '<') {
      static const std::regex between_documents(">\\s*,\\s*<");
      std::istringstream rest(std::regex_replace(uri.substr(at), between_documents, "><"));
      documents.push_back(xml::parse(rest, origin, who));
      break;
    }
    const std::size_t end = std::min(uri.find(',', at), uri.size());
    const std::string file = uri.substr(at, end - at);
    documents.push_back(xml::parse_file(file.starts_with("file://") ? file.substr(7) : file, origin, who));
    at = uri.find_first_not_of(" ,\t\n", end);
  }
  return documents;
}

std::vector<Document> users_documents(const Config& config, const std::string& uri) {
  std::vector<Document> documents = parse_uri(uri, "CYCLONEDDS_URI");
  const auto option = config.options.find("config");
  if (option == config.options.end()) return documents;
  try {
    for (Document& document : parse_uri(option->second, "option config")) {
      xml::refuse(document,
                  {{"Tracing", "writes files"},
                   {"Security", "loads libraries"},
                   {"DDSSecurity", "loads libraries"},
                   {"MonitorPort", "opens a port"}},
                  who, "your own CYCLONEDDS_URI");
      documents.push_back(std::move(document));
    }
  } catch (const Error& error) {
    throw WrongInput(error.what());
  }
  return documents;
}

// Interfaces, and what names addresses of them.
bool erase_ways_around_the_link(Tree& tree) {
  return xml::erase(tree, {"Interfaces", "NetworkInterfaceAddress", "MulticastRecvNetworkInterfaceAddresses",
                           "ExternalNetworkAddress", "ExternalNetworkMask", "Partitioning"});
}

// And its trace, which would have our private key in it.
bool erase_security(Tree& tree) { return xml::erase(tree, {"Security", "DDSSecurity", "Tracing"}); }

// Those of threads that have a priority of ours.
bool erase_threads(Tree& tree, const Config& config) {
  return xml::erase_if(tree, [&](const std::string& name, const Tree& element) {
    if (!iequals(name, "Thread")) return false;
    const NamedThread* const thread = named_thread(attribute(element, "Name"));
    return thread != nullptr && config.fifo_priority.contains(thread->role);
  });
}

std::string carrier_of(const std::vector<Document>& documents) {
  std::string transport = "default", ipv6, tcp;
  for (const Document& document : documents)
    xml::for_each_element(document.tree, [&](const std::string& name, const Tree& element) {
      if (iequals(name, "Transport")) transport = element.data();
      if (iequals(name, "UseIPv6")) ipv6 = element.data();
      if (iequals(name, "TCP") && xml::has(element, "Enable")) tcp = xml::child_text(element, "Enable");
    });
  const bool is_default = iequals(transport, "default");
  if (iequals(transport, "raweth")) return "raw Ethernet";
  if (iequals(transport, "none")) return "nothing";
  const bool is_tcp = is_default ? iequals(tcp, "true") : istarts_with(transport, "tcp");
  const bool is_ipv6 = is_default ? iequals(ipv6, "true") : iends_with(transport, "6");
  return std::string(is_tcp ? "TCP" : "UDP") + (is_ipv6 ? "v6" : "v4");
}

// The kernel's own answer: this thread asks for the priority and goes back to what it was.
std::error_code try_fifo(int priority) {
  const int policy = sched_getscheduler(0);
  sched_param before{};
  sched_getparam(0, &before);
  const sched_param wanted{.sched_priority = priority};
  if (sched_setscheduler(0, SCHED_FIFO, &wanted) != 0) return {errno, std::system_category()};
  sched_setscheduler(0, policy, &before);
  return {};
}

void check_scheduling(const Document& document) {
  xml::for_each_element(document.tree, [&](const std::string& name, const Tree& element) {
    if (!iequals(name, "Scheduling") || !iequals(xml::child_text(element, "Class"), "realtime")) return;
    const std::string text = xml::child_text(element, "Priority");
    int priority = 0;
    if (std::from_chars(text.data(), text.data() + text.size(), priority).ec != std::errc{}) return;
    if (const std::error_code refused = try_fifo(priority))
      throw Error("cyclonedds: " + document.origin + " sets real-time priority " + text +
                  " for threads, which the kernel denies (" + refused.message() +
                  "). Fix: grant CAP_SYS_NICE, raise the limit rtprio, or lower the priority");
  });
}

Tree defaults(const Config& config) {
  Tree tree;
  Tree& discovery = tree.add_child("CycloneDDS.Domain.Discovery", Tree{});
  // Predictable ports, so that a peer can find this end without multicast.
  discovery.put("ParticipantIndex", "auto");
  discovery.put("MaxAutoParticipantIndex", dds::participants_per_host - 1);
  // Others on this host are found there whether they use multicast on that interface or not.
  if (dds::is_loopback(config.address)) tree.put("CycloneDDS.Domain.General.AllowMulticast", "spdp");
  return tree;
}

Tree peers_of(const Config& config) {
  Tree peers;
  if (dds::is_loopback(config.address)) peers.add("Peer", "").put("<xmlattr>.Address", config.address);
  for (const std::string& text : config.peers) {
    const dds::Peer peer = dds::resolve(text, "cyclonedds");
    peers.add("Peer", "")
        .put("<xmlattr>.Address", peer.address + (peer.port == 0 ? "" : ":" + std::to_string(peer.port)));
  }
  return peers;
}

Tree threads_of(const Config& config) {
  Tree threads;
  for (const NamedThread& thread : named_threads) {
    const auto priority = config.fifo_priority.find(thread.role);
    if (!thread.configurable || priority == config.fifo_priority.end()) continue;
    Tree& element = threads.add("Thread", "");
    element.put("<xmlattr>.Name", thread.name);
    element.put("Scheduling.Class", "realtime");
    element.put("Scheduling.Priority", priority->second);
  }
  return threads;
}

Tree of_the_run(const Config& config) {
  Tree tree;
  Tree& domain = tree.add_child("CycloneDDS.Domain", Tree{});
  if (!config.interface.empty()) {
    Tree& interface = domain.put_child("General.Interfaces.NetworkInterface", Tree{});
    interface.put("<xmlattr>.address", config.address);
    if (dds::is_loopback(config.address)) interface.put("<xmlattr>.multicast", "true");
  }
  domain.put_child("Discovery.Peers", peers_of(config));
  domain.put_child("Threads", threads_of(config));
  domain.put("SharedMemory.Enable", "false");
  return tree;
}

}  // namespace

Configuration configuration(const Config& config) {
  const dds::Variable uri = dds::users_variable("CYCLONEDDS_URI");
  Configuration result{xml::text_of(defaults(config)), "ontime", "UDPv4"};
  if (!uri.ignored.empty()) result.source += ", " + uri.ignored;
  std::vector<Document> documents = users_documents(config, uri.value);
  result.carrier = carrier_of(documents);
  if (!config.interface.empty() && result.carrier != "UDPv4")
    throw WrongInput(
        "cyclonedds: your XML sets " + result.carrier +
        ", but ontime can bind only UDPv4 to an interface. Fix: name no interface, or remove the "
        "transport from the XML");
  for (Document& document : documents) {
    result.source += ", " + document.source();
    if (!config.interface.empty() && erase_ways_around_the_link(document.tree))
      result.source += " without its interfaces";
    if (config.security && erase_security(document.tree)) result.source += " without its security and trace";
    if (erase_threads(document.tree, config)) result.source += " without its thread priorities";
    check_scheduling(document);
    result.xml += "," + xml::text_of(document.tree);
  }
  result.xml += "," + xml::text_of(of_the_run(config));  // last, so that shared memory stays off
  return result;
}

std::string legible(std::string log) {
  static const std::regex position("\\s*\\([^()]*line \\d+\\)");
  static const std::regex unknown("config: \\S*/([^/\\s]+): (\\S+): unknown (element|attribute)");
  static const std::regex value("config: /*(\\S+?)(/#text)?: ");
  log = std::regex_replace(log, position, "");
  log = std::regex_replace(log, unknown, "<$1> has no $3 <$2>");
  return std::regex_replace(log, value, "$1: ");
}

const NamedThread* named_thread(const std::string& name) {
  const auto* const found = std::ranges::find(named_threads, name, &NamedThread::name);
  return found == std::end(named_threads) ? nullptr : found;
}

}  // namespace ontime::transport::cyclonedds
