// SPDX-License-Identifier: Apache-2.0
#include "background/network.hpp"

#include "background/background.hpp"
#include "background/child.hpp"

namespace ontime::background {

using nlohmann::json;

std::string nft(const std::string& commands) { return output_of({"nft", commands}, "nftables"); }

std::vector<json> nft_list(const std::string& kind) {
  const auto command = "list " + kind + "s";
  const auto answer = json::parse(output_of({"nft", "--json", command}, "nftables"), nullptr, false);
  if (!answer.is_object()) throw Error("nft --json " + command + ": that is no JSON");
  std::vector<json> all;
  for (const auto& entry : answer.value("nftables", json::array()))
    all.push_back(entry.value(kind, json::object()));
  return all;
}

std::string tc(const std::vector<std::string>& arguments) {
  std::vector<std::string> command = {"tc"};
  command.insert(command.end(), arguments.begin(), arguments.end());
  return output_of(command, "iproute2");
}

}  // namespace ontime::background
