// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

namespace ontime::listen {

inline constexpr std::int64_t us = 1'000, ms = 1'000'000;  // in ns

}  // namespace ontime::listen
