// SPDX-License-Identifier: Apache-2.0
// Test identities for DDS Security, of one run and for nothing else: they are made when it begins, travel to
// its ends with their orders, are on no disk, and are forgotten with it. Ordinary thread.
#pragma once

#include <memory>
#include <string>

#include "conditions/around.hpp"
#include "transport/transport.hpp"

namespace ontime::security {

using Level = conditions::Security;
using conditions::word_of;

// Who signs for all ends of a run.
class Authority {
 public:
  Authority();  // with a new key; throws transport::Error
  ~Authority();
  Authority(const Authority&) = delete;
  Authority& operator=(const Authority&) = delete;

  // For an end of that name in that domain, and in no other.
  transport::Security identity(const std::string& name, Level, int domain) const;

 private:
  struct Signer;
  std::unique_ptr<Signer> signer_;
};

}  // namespace ontime::security
