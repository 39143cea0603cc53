// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include <netdb.h>
#include <netinet/in.h>

namespace ontime::transport {

// The first IPv4 address of a host. Returns 0, or an error for gai_strerror().
inline int look_up(const std::string& host, in_addr& address) {
  addrinfo hints{};
  hints.ai_family = AF_INET;
  hints.ai_socktype = SOCK_DGRAM;
  addrinfo* found = nullptr;
  const int error = getaddrinfo(host.c_str(), nullptr, &hints, &found);
  if (error != 0) return error;
  address = reinterpret_cast<const sockaddr_in*>(found->ai_addr)->sin_addr;
  freeaddrinfo(found);
  return 0;
}

}  // namespace ontime::transport
