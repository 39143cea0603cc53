// SPDX-License-Identifier: Apache-2.0
#include "background/network.hpp"

#include <algorithm>

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

bool is_interface_name(const std::string& name) {
  constexpr std::size_t longest = 15;
  return !name.empty() && name.size() <= longest && name != "." && name != ".." &&
         std::all_of(name.begin(), name.end(), [](char c) {
           return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-' ||
                  c == '_' || c == '.' || c == '@';
         });
}

}  // namespace ontime::background
