// SPDX-License-Identifier: Apache-2.0
// Bags of any content, as MCAP's and rosbag2's formats say, and what the module makes of them. For tests.
#pragma once

#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include <archive.h>
#include <archive_entry.h>
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <sqlite3.h>
#include <unistd.h>
#include <zlib.h>

#include "bag/bag.hpp"

namespace ontime::bag {

using namespace std::chrono_literals;
namespace fs = std::filesystem;

inline constexpr std::int64_t ms = 1'000'000, start = 1'700'000'000'000 * ms;
inline constexpr const char* scan_definition =
    "# A scan\nuint8 KIND=1\nuint8 OTHER = 2 # x\n\nstd_msgs/Header header # first\nfloat32[] ranges\n"
    "================================================================================\n"
    "MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n";

inline std::string number(std::uint64_t value, std::size_t size, bool is_little = true) {
  std::string bytes(size, '\0');
  for (std::size_t i = 0; i < size; ++i)
    bytes[is_little ? i : size - 1 - i] = static_cast<char>(i < sizeof value ? value >> (8 * i) : 0);
  return bytes;
}

// A message that begins with a std_msgs/Header, in CDR.
inline std::string stamped(std::int64_t stamp_ns, bool is_little = true) {
  const auto of = [&](std::int64_t value) { return number(static_cast<std::uint64_t>(value), 4, is_little); };
  return std::string{'\0', is_little ? '\1' : '\0', '\0', '\0'} + of(stamp_ns / (1000 * ms)) +
         of(stamp_ns % (1000 * ms)) + of(4) + std::string("map", 4);
}

// --- MCAP, as its specification says ---

inline std::string text(const std::string& value) { return number(value.size(), 4) + value; }
inline std::string record(unsigned opcode, const std::string& body) {
  return static_cast<char>(opcode) + number(body.size(), 8) + body;
}
inline std::string schema(std::uint16_t id, const std::string& name, const std::string& definition = {}) {
  return record(3, number(id, 2) + text(name) + text(definition.empty() ? "" : "ros2msg") + text(definition));
}
inline std::string channel(std::uint16_t id, std::uint16_t schema, const std::string& topic,
                           const std::string& encoding = "cdr") {
  return record(4, number(id, 2) + number(schema, 2) + text(topic) + text(encoding) + number(0, 4));
}
struct At {
  std::int64_t recorded_ns = 0, published_ns = -1;  // -1: as recorded
  std::uint32_t sequence = 0;
};
inline std::string message(std::uint16_t channel, At at, const std::string& data = {}) {
  const auto published_ns = at.published_ns == -1 ? at.recorded_ns : at.published_ns;
  return record(5, number(channel, 2) + number(at.sequence, 4) +
                       number(static_cast<std::uint64_t>(at.recorded_ns), 8) +
                       number(static_cast<std::uint64_t>(published_ns), 8) + data);
}

// Of one topic, with these numbers, a millisecond apart. With times each was written after those of lower
// numbers.
inline std::string numbered(const std::vector<std::uint32_t>& numbers, bool has_times = false) {
  std::string records = channel(1, 0, "/a");
  std::int64_t at_ns = start;
  for (const auto number : numbers)
    records += message(1, {at_ns += ms, has_times ? start - 1000 * ms + number : -1, number});
  return records;
}

inline std::string compressed(const std::string& bytes, const std::string& how) {
  std::string result(bytes.size() + 4096, '\0');
  std::size_t used = 0;
  auto* writer = archive_write_new();
  archive_write_set_format_raw(writer);
  EXPECT_EQ(archive_write_add_filter_by_name(writer, how.c_str()), ARCHIVE_OK);
  archive_write_set_bytes_in_last_block(writer, 1);
  archive_write_open_memory(writer, result.data(), result.size(), &used);
  auto* entry = archive_entry_new();
  archive_entry_set_filetype(entry, AE_IFREG);
  archive_entry_set_size(entry, static_cast<la_int64_t>(bytes.size()));
  archive_write_header(writer, entry);
  archive_write_data(writer, bytes.data(), bytes.size());
  archive_entry_free(entry);
  archive_write_free(writer);
  result.resize(used);
  return result;
}

struct ChunkOf {
  std::string compression{};
  bool has_wrong_checksum = false;
};
inline std::string chunk(const std::string& records, const ChunkOf& of = {}) {
  const auto stored = of.compression.empty() ? records : compressed(records, of.compression);
  const auto sum = crc32_z(0, reinterpret_cast<const Bytef*>(records.data()), records.size()) +
                   (of.has_wrong_checksum ? 1U : 0U);
  return record(6, number(0, 16) + number(records.size(), 8) + number(sum, 4) + text(of.compression) +
                       number(stored.size(), 8) + stored);
}

inline const std::string magic = "\x89MCAP0\r\n";
inline const std::string mcap_end = record(15, number(0, 4)) + record(2, number(0, 20)) + magic;
inline std::string mcap_begin() { return magic + record(1, text("ros2") + text("test")); }
inline std::string mcap(const std::string& records) { return mcap_begin() + records + mcap_end; }

class Bags : public ::testing::Test {
 protected:
  Bags() {
    auto name = (fs::temp_directory_path() / "ontime-bag-test-XXXXXX").string();
    folder_ = ::mkdtemp(name.data());
  }
  ~Bags() override { fs::remove_all(folder_); }

  std::string write(const std::string& name, const std::string& bytes) {
    std::ofstream(folder_ / name, std::ios::binary) << bytes;
    return (folder_ / name).string();
  }
  listen::Findings judged(const std::string& path, const listen::Limits& limits = {}) {
    const auto bag = open(path, limits);
    misses_.clear();
    rows_.clear();
    bag->keep_rows([&](const listen::Row& row) { rows_.push_back(row); });
    for (bool goes_on = true; goes_on;) {
      goes_on = bag->listen_for(0ms);
      for (auto& miss : bag->take_misses()) misses_.push_back(std::move(miss));
    }
    return bag->findings();
  }
  listen::Findings judged_mcap(const std::string& bytes, const listen::Limits& limits = {}) {
    return judged(write("a.mcap", bytes), limits);
  }
  std::string error_of(const std::string& path) {
    try {
      judged(path);
    } catch (const listen::WrongInput& error) {
      return error.what();
    }
    return "no error";
  }
  std::string error_of_mcap(const std::string& bytes) { return error_of(write("a.mcap", bytes)); }

  // rosbag2's tables; `newer`: with message definitions.
  std::string sqlite(const std::string& name, const std::string& more, bool newer = true) {
    const auto path = (folder_ / name).string();
    execute(
        path,
        "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,"
        " serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL);"
        "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL,"
        " timestamp INTEGER NOT NULL, data BLOB NOT NULL);"
        "CREATE INDEX timestamp_idx ON messages (timestamp ASC);" +
            (newer ? std::string("CREATE TABLE message_definitions(id INTEGER PRIMARY KEY, topic_type TEXT "
                                 "NOT NULL, encoding TEXT NOT NULL, encoded_message_definition TEXT NOT NULL,"
                                 " type_description_hash TEXT NOT NULL);")
                   : "") +
            more);
    return path;
  }
  static void execute(const std::string& path, const std::string& sql) {
    sqlite3* database = nullptr;
    ASSERT_EQ(sqlite3_open(path.c_str(), &database), SQLITE_OK);
    EXPECT_EQ(sqlite3_exec(database, sql.c_str(), nullptr, nullptr, nullptr), SQLITE_OK)
        << sqlite3_errmsg(database);
    sqlite3_close(database);
  }
  static std::string topic_row(int id, const std::string& name, const std::string& type) {
    return fmt::format("INSERT INTO topics VALUES({}, '{}', '{}', 'cdr', '');", id, name, type);
  }
  static std::string message_row(int topic, std::int64_t at_ns, const std::string& data = {}) {
    std::string hex;
    for (const auto byte : data) hex += fmt::format("{:02x}", static_cast<unsigned char>(byte));
    return fmt::format("INSERT INTO messages(topic_id, timestamp, data) VALUES({}, {}, x'{}');", topic, at_ns,
                       hex);
  }

  fs::path folder_;
  // Of an age its value, of a period the same; -1: the message was lost.
  std::vector<std::int64_t> values_of(listen::Row::Quantity quantity) const {
    std::vector<std::int64_t> values;
    for (const auto& row : rows_) {
      if (row.quantity != quantity) continue;
      if (row.index >= values.size()) values.resize(row.index + 1);
      values[row.index] = row.to_ns == 0 ? -1 : row.to_ns - row.from_ns;
    }
    return values;
  }

  std::vector<listen::Miss> misses_;
  std::vector<listen::Row> rows_;
};

inline constexpr auto age = listen::Row::Quantity::age, period = listen::Row::Quantity::period;

}  // namespace ontime::bag
