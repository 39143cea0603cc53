// SPDX-License-Identifier: Apache-2.0
// The time stamp in a message: which types begin with a std_msgs/Header, and where the stamp lies in CDR.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>

namespace ontime::bag {

// By the definition of the type where it is in the .msg format ("ros2msg"), else by the type's name.
bool begins_with_header(std::string_view type, std::string_view encoding, const std::string& definition);

inline constexpr std::size_t stamp_end = 12;  // bytes of a message up to there are needed
// The stamp of a message that begins with a Header, in XCDR1 of either byte order; empty: other bytes.
std::optional<std::int64_t> stamp_of(std::span<const std::byte> message);

}  // namespace ontime::bag
