// SPDX-License-Identifier: Apache-2.0
#include "background/network.hpp"

#include "background/child.hpp"

namespace ontime::background {

std::string nft(const std::string& commands) { return output_of({"nft", commands}, "nftables"); }

std::string nft_json(const std::string& commands) {
  return output_of({"nft", "--json", commands}, "nftables");
}

std::string tc(const std::vector<std::string>& arguments) {
  std::vector<std::string> command = {"tc"};
  command.insert(command.end(), arguments.begin(), arguments.end());
  return output_of(command, "iproute2");
}

}  // namespace ontime::background
