// SPDX-License-Identifier: Apache-2.0
// What an interface may be called whose name goes into a path, to nft, to tc and into a shell, and is the
// same in all of them. Linux permits more.
#pragma once

#include <string_view>

namespace ontime::journal {

bool is_interface_name(std::string_view);

}  // namespace ontime::journal
