// SPDX-License-Identifier: Apache-2.0
#include "transport/cyclonedds/configuration.hpp"

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <regex>
#include <sstream>
#include <system_error>
#include <vector>

#include <boost/algorithm/string/predicate.hpp>
#include <boost/property_tree/ptree.hpp>
#include <boost/property_tree/xml_parser.hpp>
#include <sched.h>

#include "transport/dds.hpp"

namespace ontime::transport::cyclonedds {
namespace {

using boost::algorithm::iequals;
using boost::property_tree::ptree;

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

struct Document {
  std::string origin;
  ptree tree;
};

Document parse(std::istream& in, const std::string& origin) {
  try {
    Document document{origin, {}};
    read_xml(in, document.tree, boost::property_tree::xml_parser::no_comments);
    return document;
  } catch (const boost::property_tree::xml_parser_error& e) {
    throw Error("cyclonedds: " + origin + ", line " + std::to_string(e.line()) + ": " + e.message());
  }
}

Document parse_file(const std::string& uri) {
  const std::string path = uri.starts_with("file://") ? uri.substr(7) : uri;
  std::ifstream in(path);
  if (!in) throw Error("cyclonedds: cannot open the configuration " + path);
  return parse(in, path);
}

// Cyclone's own form: files separated by commas, and XML in place.
std::vector<Document> parse_uri(const std::string& uri, const std::string& origin) {
  std::vector<Document> documents;
  for (std::size_t at = uri.find_first_not_of(" ,\t\n"); at != std::string::npos;) {
    if (uri[at] == '<') {
      static const std::regex between_documents(">\\s*,\\s*<");
      std::istringstream rest(std::regex_replace(uri.substr(at), between_documents, "><"));
      documents.push_back(parse(rest, origin));
      break;
    }
    const std::size_t end = std::min(uri.find(',', at), uri.size());
    documents.push_back(parse_file(uri.substr(at, end - at)));
    at = uri.find_first_not_of(" ,\t\n", end);
  }
  return documents;
}

std::vector<Document> users_documents(const Config& config) {
  std::vector<Document> documents;
  const auto add = [&](const std::string& uri, const std::string& origin) {
    for (Document& document : parse_uri(uri, origin)) documents.push_back(std::move(document));
  };
  // Nothing else of this process changes its environment.
  const char* const uri = std::getenv("CYCLONEDDS_URI");  // NOLINT(concurrency-mt-unsafe)
  if (uri != nullptr) add(uri, "CYCLONEDDS_URI");
  if (const auto option = config.options.find("config"); option != config.options.end())
    add(option->second, "option config");
  return documents;
}

template <typename Visit>
void for_each_element(const ptree& tree, const Visit& visit) {
  for (const auto& [name, child] : tree) {
    visit(name, child);
    for_each_element(child, visit);
  }
}

bool erase_elements(ptree& tree, const char* unwanted) {
  bool erased = false;
  for (auto it = tree.begin(); it != tree.end();) {
    if (iequals(it->first, unwanted)) {
      it = tree.erase(it);
      erased = true;
    } else {
      erased |= erase_elements(it->second, unwanted);
      ++it;
    }
  }
  return erased;
}

bool erase_interfaces(ptree& tree) {
  const bool erased = erase_elements(tree, "Interfaces");
  return erase_elements(tree, "NetworkInterfaceAddress") || erased;
}

std::string child_text(const ptree& tree, const char* wanted) {
  for (const auto& [name, child] : tree)
    if (iequals(name, wanted)) return child.data();
  return {};
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
  for_each_element(document.tree, [&](const std::string& name, const ptree& element) {
    if (!iequals(name, "Scheduling") || !iequals(child_text(element, "Class"), "realtime")) return;
    const std::string text = child_text(element, "Priority");
    int priority = 0;
    if (std::from_chars(text.data(), text.data() + text.size(), priority).ec != std::errc{}) return;
    if (const std::error_code refused = try_fifo(priority))
      throw Error("cyclonedds: " + document.origin + " asks for threads of real-time priority " + text +
                  ", which the kernel refuses (" + refused.message() +
                  "); grant CAP_SYS_NICE, raise the limit \"rtprio\" or lower the priority");
  });
}

std::string text_of(const ptree& tree) {
  std::ostringstream out;
  write_xml(out, tree);
  return out.str();
}

ptree defaults() {
  ptree tree;
  ptree& discovery = tree.add_child("CycloneDDS.Domain.Discovery", ptree{});
  // Ports that a peer can guess, so that it can find us where multicast does not reach.
  discovery.put("ParticipantIndex", "auto");
  discovery.put("MaxAutoParticipantIndex", dds::participants_per_host - 1);
  return tree;
}

ptree interface_of(const Config& config) {
  ptree interface;
  interface.put("<xmlattr>.address", config.address);
  if (dds::is_loopback(config.address)) interface.put("<xmlattr>.multicast", "false");
  return interface;
}

ptree peers_of(const Config& config) {
  ptree peers;
  for (const std::string& text : config.peers) {
    const dds::Peer peer = dds::resolve(text, "cyclonedds");
    peers.add("Peer", "")
        .put("<xmlattr>.Address", peer.address + (peer.port == 0 ? "" : ":" + std::to_string(peer.port)));
  }
  return peers;
}

ptree threads_of(const Config& config) {
  ptree threads;
  for (const NamedThread& thread : named_threads) {
    const auto priority = config.fifo_priority.find(thread.role);
    if (!thread.configurable || priority == config.fifo_priority.end()) continue;
    ptree& element = threads.add("Thread", "");
    element.put("<xmlattr>.Name", thread.name);
    element.put("Scheduling.Class", "realtime");
    element.put("Scheduling.Priority", priority->second);
  }
  return threads;
}

ptree of_the_run(const Config& config) {
  ptree tree;
  ptree& domain = tree.add_child("CycloneDDS.Domain", ptree{});
  if (!config.interface.empty())
    domain.put_child("General.Interfaces.NetworkInterface", interface_of(config));
  domain.put_child("Discovery.Peers", peers_of(config));
  domain.put_child("Threads", threads_of(config));
  domain.put("SharedMemory.Enable", "false");
  return tree;
}

}  // namespace

Configuration configuration(const Config& config) {
  Configuration result{text_of(defaults()), "ontime", "UDPv4"};
  for (Document& document : users_documents(config)) {
    check_scheduling(document);
    result.source += ", " + document.origin;
    if (!config.interface.empty() && erase_interfaces(document.tree))
      result.source += " without its interfaces";
    for_each_element(document.tree, [&](const std::string& name, const ptree& element) {
      if (iequals(name, "Transport")) result.carrier = element.data();
    });
    result.xml += "," + text_of(document.tree);
  }
  // Last, so that shared memory stays off. Of threads that both of us name, Cyclone takes the first: the
  // user's.
  result.xml += "," + text_of(of_the_run(config));
  return result;
}

const NamedThread* named_thread(const std::string& name) {
  const auto* const found = std::find_if(std::begin(named_threads), std::end(named_threads),
                                         [&](const NamedThread& thread) { return name == thread.name; });
  return found == std::end(named_threads) ? nullptr : found;
}

}  // namespace ontime::transport::cyclonedds
