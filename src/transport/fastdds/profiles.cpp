// SPDX-License-Identifier: Apache-2.0
#include "transport/fastdds/profiles.hpp"

#include <algorithm>
#include <filesystem>

#include "transport/xml.hpp"

namespace ontime::transport::fastdds {
namespace {

using xml::Document;
using xml::Tree;

constexpr const char* skip_variable = "SKIP_DEFAULT_XML_FILE";
constexpr const char* more_variables_variable = "FASTDDS_ENVIRONMENT_FILE";
constexpr std::size_t unfragmented_bytes = 65'000;

// The child of that name, created if missing.
Tree& child_of(Tree& tree, const char* name) {
  const auto found = tree.find(name);
  return found == tree.not_found() ? tree.push_back({name, Tree{}})->second : found->second;
}

std::vector<Document> users_documents(const Config& config, const std::string& who, const Names& names) {
  std::vector<Document> documents;
  if (const auto file = dds::users_variable(names.variable); !file.value.empty())
    documents.push_back(xml::parse_file(file.value, names.variable, who));
  const bool skips = dds::users_variable(skip_variable).value.starts_with('1');
  if (!skips && dds::follows_environment() && std::filesystem::exists(names.file))
    documents.push_back(xml::parse_file(names.file, "its presence here", who));
  const auto option = config.options.find("profiles");
  if (option == config.options.end()) return documents;
  try {
    documents.push_back(xml::parse_file(option->second, "option profiles", who));
    xml::refuse(documents.back(),
                {{"log", "writes files"},
                 {"rtps_dump_file", "writes files"},
                 {"propertiesPolicy", "can have plugins write files"},
                 {"discoveryProtocol", "writes files", "BACKUP"}},
                who, std::string("your own file, named by ") + names.variable);
  } catch (const Error& error) {
    throw WrongInput(error.what());
  }
  return documents;
}

// Elements that lead around a named link.
bool erase_ways_around_the_link(Tree& tree) {
  return xml::erase(tree, {"userTransports", "useBuiltinTransports", "defaultUnicastLocatorList",
                           "defaultMulticastLocatorList", "metatrafficUnicastLocatorList",
                           "metatrafficMulticastLocatorList", "unicastLocatorList", "multicastLocatorList",
                           "data_sharing"});
}

void append(Tree& to, const std::string& name, const Tree& content, Tree& profiles) {
  if (name == "profiles")
    std::copy_if(content.begin(), content.end(), std::back_inserter(profiles),
                 [](const auto& profile) { return profile.first != "<xmlattr>"; });
  else if (name != "<xmlattr>" && name != "library_settings")
    to.push_back({name, content});
}

// All documents as one: Fast DDS loads only the first of several <profiles> in a document.
Tree merged(const std::vector<Document>& documents) {
  Tree dds, profiles;
  for (const Document& document : documents)
    for (const auto& [root, content] : document.tree)
      if (root == "dds")
        for (const auto& [name, part] : content) append(dds, name, part, profiles);
      else
        append(dds, root, content, profiles);
  dds.push_back({"profiles", profiles});
  dds.put("library_settings.intraprocess_delivery", "OFF");
  return dds;
}

// The default profile for Fast DDS: the last one marked so, or else ontime's.
Tree& default_participant(Tree& profiles) {
  Tree* last = nullptr;
  for (auto& [name, profile] : profiles)
    if (name == "participant" && profile.get("<xmlattr>.is_default_profile", "") == "true") last = &profile;
  if (last != nullptr) return *last;
  Tree& ours = profiles.push_back({"participant", Tree{}})->second;
  ours.put("<xmlattr>.profile_name", "ontime");
  ours.put("<xmlattr>.is_default_profile", "true");
  return ours;
}

// Shared memory would bypass any link, and is built in.
Tree transport_of(const Config& config, const Tree& rtps) {
  Tree transport;
  transport.put("transport_id", "ontime");
  transport.put("type", "UDPv4");
  transport.put("maxInitialPeersRange", dds::participants_per_host);
  auto receive_bytes = rtps.get<std::size_t>("listenSocketBufferSize", 0);
  const auto send_bytes = rtps.get<std::size_t>("sendSocketBufferSize", 0);
  // All fragments of a message arrive at once. The kernel gives as much of this as net.core.rmem_max allows.
  if (config.max_payload_bytes > unfragmented_bytes)
    receive_bytes = std::max(receive_bytes, 4 * config.max_payload_bytes);
  if (send_bytes > 0) transport.put("sendBufferSize", send_bytes);
  if (receive_bytes > 0) transport.put("receiveBufferSize", receive_bytes);
  if (!config.interface.empty()) transport.put("interfaceWhiteList.address", config.address);
  return transport;
}

void use_transport(Tree& profiles, Tree& rtps, const Config& config) {
  rtps.put("userTransports.transport_id", "ontime");
  rtps.put("useBuiltinTransports", "false");
  Tree descriptors;
  descriptors.push_back({"transport_descriptor", transport_of(config, rtps)});
  profiles.push_front({"transport_descriptors", descriptors});  // before it is referred to
}

// Where peers are named Fast DDS looks nowhere else, hence the multicast group is named too.
void name_peers(Tree& rtps, const Config& config, const std::string& who) {
  const bool loopback = dds::is_loopback(config.address);
  if (config.peers.empty() && !loopback) return;
  Tree& peers = child_of(child_of(rtps, "builtin"), "initialPeersList");
  const auto add = [&](const std::string& address, int port) {
    Tree locator;
    locator.put("udpv4.address", address);
    if (port != 0) locator.put("udpv4.port", port);
    peers.push_back({"locator", locator});
  };
  if (peers.empty()) add(dds::multicast_group, dds::base_port + dds::ports_per_domain * config.domain);
  if (loopback) add(config.address, 0);
  for (const std::string& text : config.peers) {
    const dds::Peer peer = dds::resolve(text, who);
    add(peer.address, peer.port);
  }
}

}  // namespace

Profiles profiles(const Config& config, const std::string& who, const Names& names) {
  Profiles result{"", "ontime", "UDPv4"};
  for (const char* variable : {names.variable, skip_variable})
    if (const auto ignored = dds::users_variable(variable).ignored; !ignored.empty())
      result.source += ", " + ignored;
  std::vector<Document> documents = users_documents(config, who, names);
  for (Document& document : documents) {
    result.source += ", " + document.source();
    if (!config.interface.empty() && erase_ways_around_the_link(document.tree))
      result.source += " without its transports";
  }
  Tree dds = merged(documents);
  Tree& profiles = child_of(dds, "profiles");
  Tree& rtps = child_of(default_participant(profiles), "rtps");
  name_peers(rtps, config, who);
  if (xml::has(rtps, "userTransports") || xml::child_text(rtps, "useBuiltinTransports") == "false")
    result.carrier = "the profile's transports";
  else
    use_transport(profiles, rtps, config);
  Tree whole;
  whole.push_back({"dds", dds});
  result.xml = xml::text_of(whole);
  return result;
}

NoFile::NoFile(const Names& names) : file_(names.variable, {}), skip_(skip_variable, "1") {
  if (!dds::follows_environment()) more_variables_.emplace(more_variables_variable, std::nullopt);
}

}  // namespace ontime::transport::fastdds
