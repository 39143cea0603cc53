// SPDX-License-Identifier: Apache-2.0
// The messages of one file of a bag, whatever its form.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

namespace ontime::bag {

struct Topic {
  std::string name;
  unsigned writer = 0;      // number of the writer, if the file separates writers of a topic; from 0
  bool has_header = false;  // its messages are CDR and begin with a std_msgs/Header
};

struct Message {
  const Topic* topic = nullptr;            // lives as long as the Reader
  std::int64_t recorded_ns = 0;            // of all times: from 0 to latest_ns
  std::int64_t published_ns = 0;           // 0: not noted
  std::uint32_t sequence = 0;              // 0: not noted
  std::optional<std::int64_t> stamp_ns{};  // of a Header; 0: its writer did not set it
};

inline constexpr std::int64_t latest_ns = std::int64_t{1} << 62U;  // in 2116
inline constexpr std::size_t longest_name = 4096;

class Reader {
 public:
  Reader() = default;
  virtual ~Reader() = default;
  Reader(const Reader&) = delete;
  Reader& operator=(const Reader&) = delete;
  // In the order of writing; empty: the end. Throws listen::WrongInput for damage.
  virtual std::optional<Message> next() = 0;
  // Where the file was truncated; "": it was not. Call it at the end.
  virtual std::string cut() const { return {}; }
};

// Each throws listen::WrongInput.
std::unique_ptr<Reader> read_mcap(const std::string& path);
std::unique_ptr<Reader> read_sqlite(const std::string& path);

}  // namespace ontime::bag
