// SPDX-License-Identifier: Apache-2.0
// NOLINTBEGIN(concurrency-mt-unsafe): see the header
#include "environment.hpp"

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <filesystem>
#include <sstream>
#include <system_error>

#include <unistd.h>

#include "transport/cyclonedds/configuration.hpp"
#include "transport/dds.hpp"

namespace ontime::transport::ros2 {
namespace {

constexpr std::size_t unfragmented_bytes = 65'000;
constexpr const char* profiles_variable = "FASTRTPS_DEFAULT_PROFILES_FILE";
constexpr const char* profiles_in_this_folder = "DEFAULT_FASTRTPS_PROFILES.xml";

class CycloneSettings final : public MiddlewareSettings {
 public:
  explicit CycloneSettings(const cyclonedds::Configuration& configuration)
      : uri_("CYCLONEDDS_URI", configuration.xml) {
    source = configuration.source;
    carrier = configuration.carrier;
  }

 private:
  Variable uri_;
};

std::string locator(const std::string& address, int port) {
  std::string text = "<locator><udpv4><address>" + address + "</address>";
  if (port != 0) text += "<port>" + std::to_string(port) + "</port>";
  return text + "</udpv4></locator>";
}

// Where peers are named Fast DDS looks nowhere else, hence the multicast group is named too.
std::string peers_of(const Config& config) {
  const bool loopback = dds::is_loopback(config.address);
  if (config.peers.empty() && !loopback) return {};
  std::string text = locator("239.255.0.1", dds::base_port + dds::ports_per_domain * config.domain);
  if (loopback) text += locator(config.address, 0);
  for (const std::string& name : config.peers) {
    const dds::Peer peer = dds::resolve(name, "ros2");
    text += locator(peer.address, peer.port);
  }
  return "<builtin><initialPeersList>" + text + "</initialPeersList></builtin>";
}

// UDPv4 alone: shared memory and shortcuts within a process would bypass the link.
std::string profiles_of(const Config& config) {
  std::ostringstream xml;
  xml << R"(<?xml version="1.0" encoding="UTF-8"?>
<dds xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">
<library_settings><intraprocess_delivery>OFF</intraprocess_delivery></library_settings>
<profiles>
<transport_descriptors><transport_descriptor><transport_id>ontime</transport_id><type>UDPv4</type>)"
      << "<maxInitialPeersRange>" << dds::participants_per_host << "</maxInitialPeersRange>";
  // All fragments of a message arrive at once. The kernel gives as much of this as net.core.rmem_max allows.
  if (config.max_payload_bytes > unfragmented_bytes)
    xml << "<receiveBufferSize>" << 4 * config.max_payload_bytes << "</receiveBufferSize>";
  if (!config.interface.empty())
    xml << "<interfaceWhiteList><address>" << config.address << "</address></interfaceWhiteList>";
  xml << "</transport_descriptor></transport_descriptors>\n"
      << R"(<participant profile_name="ontime" is_default_profile="true"><rtps>)" << peers_of(config)
      << "<userTransports><transport_id>ontime</transport_id></userTransports>"
      << "<useBuiltinTransports>false</useBuiltinTransports>"
      << "</rtps></participant>\n</profiles></dds>\n";
  return xml.str();
}

class TemporaryFile {
 public:
  explicit TemporaryFile(const std::string& text)
      : path_(std::filesystem::temp_directory_path() / "ontime-profiles-XXXXXX") {
    const int file = mkstemp(path_.data());
    const bool written =
        file >= 0 && write(file, text.data(), text.size()) == static_cast<ssize_t>(text.size());
    const int error = errno;
    if (file >= 0) close(file);
    if (written) return;
    if (file >= 0) unlink(path_.c_str());
    throw Error("ros2: cannot write Fast DDS's profiles to " + path_ + ": " +
                std::system_category().message(error));
  }
  ~TemporaryFile() { unlink(path_.c_str()); }
  TemporaryFile(const TemporaryFile&) = delete;
  TemporaryFile& operator=(const TemporaryFile&) = delete;

  const std::string& path() const { return path_; }

 private:
  std::string path_;
};

class FastSettings final : public MiddlewareSettings {
 public:
  explicit FastSettings(const Config& config)
      : file_(profiles_of(config)),
        profiles_(profiles_variable, file_.path()),
        skip_("SKIP_DEFAULT_XML", "1") {
    source = "ontime";
    carrier = "UDPv4";
  }

 private:
  TemporaryFile file_;
  Variable profiles_;
  Variable skip_;
};

// Of Fast DDS, which loads them by itself.
std::string users_profiles() {
  std::string files = environment(profiles_variable);
  if (environment("SKIP_DEFAULT_XML") != "1" && std::filesystem::exists(profiles_in_this_folder))
    files += (files.empty() ? "" : ", ") + std::string(profiles_in_this_folder);
  return files;
}

std::unique_ptr<MiddlewareSettings> users_settings(const std::string& source, const std::string& carrier) {
  auto settings = std::make_unique<MiddlewareSettings>();
  settings->source = source;
  settings->carrier = carrier;
  return settings;
}

}  // namespace

std::string environment(const char* name) {
  const char* const value = std::getenv(name);
  return value == nullptr ? "" : value;
}

Variable::Variable(const char* name, const std::string& value) : name_(name) {
  if (const char* const before = std::getenv(name)) before_ = before;
  setenv(name, value.c_str(), 1);
}

Variable::~Variable() {
  if (before_)
    setenv(name_, before_->c_str(), 1);
  else
    unsetenv(name_);
}

Config without_localhost_only(Config config) {
  if (environment("ROS_LOCALHOST_ONLY") != "1") return config;
  if (config.interface.empty()) {
    config.interface = "lo";
    config.address = "127.0.0.1";
  } else if (!dds::is_loopback(config.address)) {
    throw Error("ros2: ROS_LOCALHOST_ONLY=1 keeps ROS 2 on this host, and the interface " + config.interface +
                " was asked for; unset ROS_LOCALHOST_ONLY, or name no interface");
  }
  return config;
}

std::unique_ptr<MiddlewareSettings> middleware_settings(const std::string& rmw, const Config& config) {
  if (rmw == "rmw_cyclonedds_cpp")
    return std::make_unique<CycloneSettings>(cyclonedds::configuration(config));
  if (rmw == "rmw_fastrtps_cpp" || rmw == "rmw_fastrtps_dynamic_cpp") {
    const std::string files = users_profiles();
    if (files.empty()) return std::make_unique<FastSettings>(config);
    return users_settings(files, "the profile's transports");
  }
  if (!config.interface.empty() || !config.peers.empty())
    throw Error("ros2: ontime cannot lead " + rmw +
                " to an interface or peer; configure it by its own means and name neither");
  return users_settings(rmw + "'s own", "unknown");
}

}  // namespace ontime::transport::ros2
// NOLINTEND(concurrency-mt-unsafe)
