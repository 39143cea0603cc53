// SPDX-License-Identifier: Apache-2.0
#include "bag/bag.hpp"

#include <array>
#include <filesystem>
#include <fstream>
#include <numeric>

#include <archive.h>
#include <archive_entry.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sqlite3.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zlib.h>

namespace ontime::bag {
namespace {

using namespace std::chrono_literals;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
namespace fs = std::filesystem;

constexpr std::int64_t ms = 1'000'000, start = 1'700'000'000'000 * ms;
constexpr const char* scan_definition =
    "# A scan\nuint8 KIND=1\nuint8 OTHER = 2 # x\n\nstd_msgs/Header header # first\nfloat32[] ranges\n"
    "================================================================================\n"
    "MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n";

std::string number(std::uint64_t value, std::size_t size, bool is_little = true) {
  std::string bytes(size, '\0');
  for (std::size_t i = 0; i < size; ++i)
    bytes[is_little ? i : size - 1 - i] = static_cast<char>(value >> (8 * i));
  return bytes;
}

// A message that begins with a std_msgs/Header, in CDR.
std::string stamped(std::int64_t stamp_ns, bool is_little = true) {
  const auto of = [&](std::int64_t value) { return number(static_cast<std::uint64_t>(value), 4, is_little); };
  return std::string{'\0', is_little ? '\1' : '\0', '\0', '\0'} + of(stamp_ns / (1000 * ms)) +
         of(stamp_ns % (1000 * ms)) + of(4) + std::string("map", 4);
}

// --- MCAP, as its specification says ---

std::string text(const std::string& value) { return number(value.size(), 4) + value; }
std::string record(unsigned opcode, const std::string& body) {
  return static_cast<char>(opcode) + number(body.size(), 8) + body;
}
std::string schema(std::uint16_t id, const std::string& name, const std::string& definition = {}) {
  return record(3, number(id, 2) + text(name) + text(definition.empty() ? "" : "ros2msg") + text(definition));
}
std::string channel(std::uint16_t id, std::uint16_t schema, const std::string& topic,
                    const std::string& encoding = "cdr") {
  return record(4, number(id, 2) + number(schema, 2) + text(topic) + text(encoding) + number(0, 4));
}
struct At {
  std::int64_t recorded_ns = 0, published_ns = -1;  // -1: as recorded
  std::uint32_t sequence = 0;
};
std::string message(std::uint16_t channel, At at, const std::string& data = {}) {
  const auto published_ns = at.published_ns == -1 ? at.recorded_ns : at.published_ns;
  return record(5, number(channel, 2) + number(at.sequence, 4) +
                       number(static_cast<std::uint64_t>(at.recorded_ns), 8) +
                       number(static_cast<std::uint64_t>(published_ns), 8) + data);
}

// Of one topic, with these numbers, a millisecond apart. With times each was written after those of lower
// numbers.
std::string numbered(const std::vector<std::uint32_t>& numbers, bool has_times = false) {
  std::string records = channel(1, 0, "/a");
  std::int64_t at_ns = start;
  for (const auto number : numbers)
    records += message(1, {at_ns += ms, has_times ? start - 1000 * ms + number : -1, number});
  return records;
}

std::string compressed(const std::string& bytes, const std::string& how) {
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
std::string chunk(const std::string& records, const ChunkOf& of = {}) {
  const auto stored = of.compression.empty() ? records : compressed(records, of.compression);
  const auto sum = crc32_z(0, reinterpret_cast<const Bytef*>(records.data()), records.size()) +
                   (of.has_wrong_checksum ? 1U : 0U);
  return record(6, number(0, 16) + number(records.size(), 8) + number(sum, 4) + text(of.compression) +
                       number(stored.size(), 8) + stored);
}

const std::string magic = "\x89MCAP0\r\n";
const std::string mcap_end = record(15, number(0, 4)) + record(2, number(0, 20)) + magic;
std::string mcap_begin() { return magic + record(1, text("ros2") + text("test")); }
std::string mcap(const std::string& records) { return mcap_begin() + records + mcap_end; }

// --- the tests ---

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

constexpr auto age = listen::Row::Quantity::age, period = listen::Row::Quantity::period;

TEST_F(Bags, EachTopicHasItsPeriodsAndGaps) {
  const auto findings =
      judged_mcap(mcap(channel(1, 0, "/a") + channel(2, 0, "/b") + message(1, {start}) + message(2, {start}) +
                       message(1, {start + 10 * ms}) + message(1, {start + 20 * ms}) +
                       message(1, {start + 50 * ms}) + message(2, {start + 50 * ms})),
                  {.deadline = 20ms, .period = {}, .age = {}});
  ASSERT_EQ(findings.flows.size(), 2U);
  const auto& [a, b] = std::pair(findings.flows[0], findings.flows[1]);
  EXPECT_EQ(a.topic, "/a");
  EXPECT_EQ(a.messages, 4U);
  EXPECT_EQ(a.period.count(), 3U);
  EXPECT_EQ(a.period.max_ns(), 30 * ms);
  EXPECT_DOUBLE_EQ(a.rate_hz(), 60);
  EXPECT_EQ(a.late, 1U);
  EXPECT_EQ(b.messages, 2U);
  EXPECT_EQ(b.late, 1U);
  EXPECT_FALSE(a.age);
  EXPECT_FALSE(a.lost);  // the recorder noted no numbers
  ASSERT_EQ(misses_.size(), 2U);
  EXPECT_EQ(misses_[0].kind, listen::Miss::Kind::gap);
  EXPECT_EQ(misses_[0].value_ns, 30 * ms);
  EXPECT_EQ(misses_[0].at_ns, start + 50 * ms);
  EXPECT_THAT(findings.remarks, IsEmpty());
}

TEST_F(Bags, AgeRunsFromTheHeadersStampInEitherByteOrder) {
  for (const bool is_little : {true, false}) {
    const auto findings =
        judged_mcap(mcap(schema(1, "my_msgs/msg/Scan", scan_definition) + channel(1, 1, "/scan") +
                         message(1, {start + 7 * ms}, stamped(start, is_little)) +
                         message(1, {start + 50 * ms}, stamped(start + 20 * ms, is_little))),
                    {.deadline = {}, .period = {}, .age = 10ms});
    ASSERT_EQ(findings.flows.size(), 1U);
    const auto& flow = findings.flows[0];
    ASSERT_TRUE(flow.age);
    EXPECT_EQ(flow.age->count(), 2U);
    EXPECT_EQ(flow.age->max_ns(), 30 * ms);
    EXPECT_EQ(flow.age_from, listen::AgeFrom::stamp);
    EXPECT_EQ(flow.late, 1U);
    ASSERT_EQ(misses_.size(), 1U);
    EXPECT_EQ(misses_[0].kind, listen::Miss::Kind::age);
  }
}

TEST_F(Bags, OnlyTypesThatBeginWithAHeaderHaveAnAge) {
  const auto has_age = [&](const std::string& type, const std::string& definition,
                           const std::string& encoding = "cdr") {
    const auto findings = judged_mcap(mcap(schema(1, type, definition) + channel(1, 1, "/a", encoding) +
                                           message(1, {start + ms}, stamped(start))));
    return findings.flows.at(0).age.has_value();
  };
  EXPECT_TRUE(has_age("sensor_msgs/msg/Imu", ""));  // known by its name
  EXPECT_TRUE(has_age("x/msg/X", "Header header"));
  EXPECT_FALSE(has_age("x/msg/X", ""));
  EXPECT_FALSE(has_age("x/msg/X", "int32 number\nstd_msgs/Header header\n"));
  EXPECT_FALSE(has_age("x/msg/X", "std_msgs/Header[] headers\n"));
  EXPECT_FALSE(has_age("sensor_msgs/msg/Imu", "int32 number\n"));  // its definition is what counts
  EXPECT_FALSE(has_age("sensor_msgs/msg/Imu", "", "ros1"));
  // What begins after a line of "=" is another type.
  EXPECT_FALSE(has_age("x/msg/X", "# nothing\n=====\nMSG: y/Y\nstd_msgs/Header header\n"));
}

TEST_F(Bags, AgeIsUnknownWhereTheStampCannotBeRead) {
  for (const auto& data : {std::string(), std::string("\0\1\0\0\1\0\0", 7), std::string(40, '\xff'),
                           std::string("\0\3\0\0", 4) + std::string(20, '\1')}) {
    const auto findings =
        judged_mcap(mcap(schema(1, "sensor_msgs/msg/Imu") + channel(1, 1, "/a") + message(1, {start}, data)));
    EXPECT_EQ(findings.flows.at(0).messages, 1U);
    EXPECT_FALSE(findings.flows.at(0).age);
  }
}

TEST_F(Bags, PublishTimeGivesTheAgeOfMessagesWithoutHeader) {
  const auto findings = judged_mcap(mcap(channel(1, 0, "/a") + message(1, {start + 3 * ms, start}) +
                                         message(1, {start + 9 * ms, start + 8 * ms})));
  const auto& flow = findings.flows.at(0);
  ASSERT_TRUE(flow.age);
  EXPECT_EQ(flow.age_from, listen::AgeFrom::publish);
  EXPECT_EQ(flow.age->max_ns(), 3 * ms);
}

TEST_F(Bags, OddClocksAreRemarkedAndInventNoAge) {
  const auto scan = schema(1, "sensor_msgs/msg/Imu") + channel(1, 1, "/a");
  const auto findings_of = [&](std::int64_t stamp_ns) {
    return judged_mcap(mcap(scan + message(1, {start}, stamped(stamp_ns))),
                       {.deadline = {}, .period = {}, .age = 1ms});
  };
  const auto unset = findings_of(0);
  EXPECT_FALSE(unset.flows.at(0).age);
  EXPECT_THAT(unset.remarks, ElementsAre(HasSubstr("header.stamp of 0")));
  const auto simulated = findings_of(100 * 1000 * ms);
  EXPECT_FALSE(simulated.flows.at(0).age);
  EXPECT_EQ(simulated.flows.at(0).late, 0U);
  EXPECT_THAT(simulated.remarks, ElementsAre(HasSubstr("simulated")));
  const auto ahead = findings_of(start + ms);
  EXPECT_EQ(ahead.flows.at(0).age->max_ns(), 0);
  EXPECT_THAT(ahead.remarks, ElementsAre(HasSubstr("ahead")));
}

TEST_F(Bags, ClockThatWentBackMakesNoTopicSilent) {
  std::string records = channel(1, 0, "/a");
  for (int i = 0; i < 100; ++i) records += message(1, {start + (i < 50 ? 5000 + i : i) * 10 * ms});
  EXPECT_EQ(judged_mcap(mcap(records), {.deadline = 1s, .period = {}, .age = {}}).flows.at(0).silent_ns, 0);
}

TEST_F(Bags, ClockThatWentBackHidesNoTopicThatDied) {
  std::string records = channel(1, 0, "/a") + channel(2, 0, "/b");
  for (int i = 0; i < 300; ++i) {
    const auto at_ns = start + (i < 100 ? 360'000 + i : i) * 10 * ms;  // an hour
    if (i < 90) records += message(1, {at_ns});
    records += message(2, {at_ns});
  }
  const auto findings = judged_mcap(mcap(records), {.deadline = 1s, .period = {}, .age = {}});
  EXPECT_NEAR(static_cast<double>(findings.flows.at(0).silent_ns), 2.1e9, 0.02e9);
  EXPECT_EQ(findings.flows.at(1).silent_ns, 0);
  EXPECT_EQ(findings.flows.at(1).late, 0U);
  EXPECT_NEAR(findings.flows.at(1).rate_hz(), 100, 1e-6);
}

TEST_F(Bags, ClockThatWentBackLeavesMessagesInOrder) {
  std::string records = channel(1, 0, "/a");
  for (int i = 0; i < 300; ++i) {
    const auto at_ns = start + (i < 100 ? 360'000 + i : i) * 10 * ms;
    records += message(1, {at_ns, at_ns - 2 * ms});
  }
  EXPECT_LE(judged_mcap(mcap(records)).flows.at(0).reordered, 1U);
}

// Some writers keep a chunk for each topic: time goes back at each of them.
TEST_F(Bags, TopicsOneAfterTheOtherAreNoClockThatWasSet) {
  std::string records = channel(1, 0, "/a") + channel(2, 0, "/b");
  std::int64_t a = 0, b = 0;
  for (const auto topic : std::initializer_list<std::uint16_t>{1, 2, 1, 2})
    for (int i = 0; i < 200; ++i) records += message(topic, {start + ((topic == 1 ? a++ : b++) * 10) * ms});
  const auto findings = judged_mcap(mcap(records), {.deadline = 1s, .period = {}, .age = {}});
  for (const auto& flow : findings.flows) {
    EXPECT_EQ(flow.silent_ns, 0);
    EXPECT_EQ(flow.period.count(), 399U);
  }
  EXPECT_TRUE(findings.remarks.empty());
}

TEST_F(Bags, PauseOfAllTopicsIsSaid) {
  std::string records = channel(1, 0, "/a") + channel(2, 0, "/b");
  for (const std::int64_t at_s : {0, 1, 3601, 3602})
    for (const auto topic : std::initializer_list<std::uint16_t>{1, 2})
      records += message(topic, {start + at_s * 1000 * ms});
  const auto findings = judged_mcap(mcap(records), {.deadline = 2s, .period = {}, .age = {}});
  EXPECT_EQ(findings.flows.at(0).late, 1U);
  EXPECT_THAT(findings.remarks, ElementsAre(HasSubstr("no topic was recorded for 3600 s:")));
}

TEST_F(Bags, OneStampOfAnotherClockLeavesTheOrderOfTheOthers) {
  std::string records = schema(1, "sensor_msgs/msg/Imu") + channel(1, 1, "/a");
  for (int i = 0; i < 10; ++i)
    records += message(1, {start + i * ms}, stamped(start + i * ms + (i == 2 ? 40'000'000'000 * ms : 0)));
  EXPECT_LE(judged_mcap(mcap(records)).flows.at(0).reordered, 1U);
}

TEST_F(Bags, ClockThatWentBackGivesNoPeriod) {
  const auto findings = judged_mcap(mcap(channel(1, 0, "/a") + message(1, {start + 10 * ms}) +
                                         message(1, {start}) + message(1, {start + ms})));
  EXPECT_EQ(findings.flows.at(0).period.count(), 1U);
  EXPECT_THAT(findings.remarks, ElementsAre(HasSubstr("clock was set")));
}

TEST_F(Bags, NumbersOfTheWriterTellWhatIsLostRepeatedAndOutOfOrder) {
  const auto& flow = judged_mcap(mcap(numbered({7, 8, 11, 10, 11, 12}, true))).flows.at(0);
  EXPECT_EQ(flow.lost, 1U);  // 9
  EXPECT_EQ(flow.reordered, 1U);
  EXPECT_EQ(flow.duplicated, 1U);
  EXPECT_EQ(flow.messages, 5U);
}

// As an older rosbag2 did, from 0 in each file.
TEST_F(Bags, NumbersThatTheRecorderCountedTellNothing) {
  fs::create_directory(folder_ / "drive");
  for (const auto* name : {"drive/drive_0.mcap", "drive/drive_1.mcap"}) {
    std::string records = channel(1, 0, "/a");
    for (std::uint32_t sequence = 0; sequence < 4; ++sequence) records += message(1, {start, -1, sequence});
    write(name, mcap(records));
  }
  const auto& flow = judged((folder_ / "drive").string()).flows.at(0);
  EXPECT_EQ(flow.messages, 8U);
  EXPECT_FALSE(flow.lost);
  EXPECT_EQ(flow.duplicated, 0U);
}

// As `mcap convert` does.
TEST_F(Bags, NumbersThatAllTopicsShareTellNothing) {
  std::string records = channel(1, 0, "/imu") + channel(2, 0, "/scan");
  std::int64_t at_ns = start;
  for (std::uint32_t sequence = 0; sequence < 60; ++sequence)
    records += message(sequence % 6 == 5 ? 2 : 1, {at_ns += ms, -1, sequence});
  for (const auto& flow : judged_mcap(mcap(records)).flows) {
    EXPECT_FALSE(flow.lost) << flow.topic;
    EXPECT_EQ(flow.reordered, 0U);
  }
}

TEST_F(Bags, NumbersOfEachTopicTellWhatIsLost) {
  std::string records = channel(1, 0, "/imu") + channel(2, 0, "/scan");
  for (const auto& [topic, sequence] :
       {std::pair(1, 5), {2, 900}, {1, 6}, {1, 8}, {2, 901}, {1, 9}, {2, 903}})
    records += message(static_cast<std::uint16_t>(topic), {start, -1, static_cast<std::uint32_t>(sequence)});
  for (const auto& flow : judged_mcap(mcap(records)).flows) EXPECT_EQ(flow.lost, 1U) << flow.topic;
}

TEST_F(Bags, WritersThatNumberAlikeAreOneStreamOfUnknownLoss) {
  for (const std::uint32_t other : {0U, 500U, 100'000U}) {
    std::vector<std::uint32_t> numbers;
    for (std::uint32_t number = 1; number <= 100; ++number)
      numbers.insert(numbers.end(), {number, number + other});
    const auto findings = judged_mcap(mcap(numbered(numbers)));
    const auto& flow = findings.flows.at(0);
    EXPECT_EQ(flow.messages, 200U) << other;
    EXPECT_EQ(flow.period.count(), 199U);
    EXPECT_FALSE(flow.lost);
    EXPECT_EQ(flow.duplicated, 0U);
    EXPECT_EQ(flow.reordered, 0U);
    EXPECT_THAT(findings.remarks, Contains(HasSubstr("several writers")));
  }
}

TEST_F(Bags, SecondWriterThatIsSlowerLosesNothing) {
  for (const std::int64_t ahead : {0, 1}) {  // whether times of writing are known
    std::string records = channel(1, 0, "/a");
    std::int64_t at_ns = start;
    for (std::uint32_t sequence = 1; sequence <= 100; ++sequence) {
      records += message(1, {at_ns, at_ns - ahead, 6000 + sequence});
      if (sequence % 10 == 0) records += message(1, {at_ns, at_ns - ahead, 600 + sequence / 10});
      at_ns += ms;
    }
    const auto& flow = judged_mcap(mcap(records)).flows.at(0);
    EXPECT_EQ(flow.messages, 110U);
    EXPECT_FALSE(flow.lost) << *flow.lost;
  }
}

TEST_F(Bags, MessageThatOvertookSeveralLeavesTheLossesKnown) {
  const auto& flow = judged_mcap(mcap(numbered({105, 107, 108, 112, 109, 110, 111, 113}, true))).flows.at(0);
  EXPECT_EQ(flow.lost, 1U);
  EXPECT_EQ(flow.reordered, 3U);
}

TEST_F(Bags, WriterThatBeganAnewBeforeItsFirstNumberHereLosesNothing) {
  std::vector<std::uint32_t> numbers(200);
  std::iota(numbers.begin(), numbers.begin() + 100, 500U);
  std::iota(numbers.begin() + 100, numbers.end(), 3U);
  const auto& flow = judged_mcap(mcap(numbered(numbers))).flows.at(0);
  EXPECT_EQ(flow.lost, 0U);
  EXPECT_EQ(flow.reordered, 0U);
}

TEST_F(Bags, WriterThatBeganAnewSoonKeepsItsLosses) {
  std::vector<std::uint32_t> numbers;
  for (int begun = 0; begun < 2; ++begun)
    for (std::uint32_t number = 1; number <= 1000; ++number)
      if (number != 500) numbers.push_back(number);
  const auto& flow = judged_mcap(mcap(numbered(numbers))).flows.at(0);
  EXPECT_EQ(flow.messages, 1998U);
  EXPECT_EQ(flow.lost, 2U);
  EXPECT_EQ(flow.duplicated, 0U);
  EXPECT_EQ(flow.reordered, 0U);
}

TEST_F(Bags, FirstGapTellsThatNumbersAreTheWriters) {
  std::string records = channel(1, 0, "/a");
  for (const std::int64_t number : {0, 1, 2, 4, 5, 7})
    records += message(
        1, {start + number * 10 * ms, start + (number * 9 - 1) * ms, static_cast<std::uint32_t>(number)});
  EXPECT_EQ(judged_mcap(mcap(records)).flows.at(0).lost, 2U);
  EXPECT_THAT(values_of(age), ElementsAre(ms, 2 * ms, 3 * ms, -1, 5 * ms, 6 * ms, -1, 8 * ms));
}

TEST_F(Bags, EachMessageIsARowOfEachQuantity) {
  judged_mcap(
      mcap(schema(1, "sensor_msgs/msg/Imu") + channel(1, 1, "/a") + message(1, {start}, stamped(start - ms)) +
           message(1, {start + 10 * ms}, stamped(start)) + message(1, {start + 12 * ms}, stamped(0)) +
           message(1, {start + 15 * ms}, stamped(start + 15 * ms))),
      {.deadline = 5ms, .period = {}, .age = 5ms});
  EXPECT_THAT(values_of(period), ElementsAre(10 * ms, 2 * ms, 3 * ms));
  EXPECT_THAT(values_of(age), ElementsAre(ms, 10 * ms, 0));
  std::vector<bool> late;
  for (const auto& row : rows_) late.push_back(row.is_late);
  EXPECT_THAT(late, ElementsAre(false, true, true, false, false, false));
  // By a clock of their own, which begins with the bag.
  for (const auto& row : rows_) EXPECT_LT(std::abs(row.to_ns), 2000 * ms);
}

TEST_F(Bags, ClockThatIsSetDuringARecordingIsLeftOut) {
  judged_mcap(mcap(channel(1, 0, "/a") + message(1, {ms}) + message(1, {3 * ms}) + message(1, {start}) +
                   message(1, {start + ms})));
  EXPECT_THAT(values_of(period), ElementsAre(2 * ms, ms));
  EXPECT_LT(rows_.back().to_ns, 2000 * ms);
}

TEST_F(Bags, WriterThatBeginsAnewLosesNothing) {
  const auto findings =
      judged_mcap(mcap(channel(1, 0, "/a") + message(1, {start, -1, 100'000}) + message(1, {start, -1, 1}) +
                       message(1, {start, -1, 2}) + message(1, {start, -1, 4'000'000'000})));
  EXPECT_EQ(findings.flows.at(0).lost, 0U);
  EXPECT_EQ(findings.flows.at(0).messages, 4U);
}

TEST_F(Bags, NumberFarFromTheOneBeforeMakesNoRowsOfLoss) {
  judged_mcap(mcap(channel(1, 0, "/a") + message(1, {start + ms, start, 0}) +
                   message(1, {start + ms, start, 4'000'000'000}) +
                   message(1, {start + ms, 0, 4'000'000'001}) + message(1, {start + ms, start, 7})));
  EXPECT_THAT(values_of(age), ElementsAre(ms, ms, ms));
}

TEST_F(Bags, StampsTellTheOrderWithoutNumbers) {
  const auto findings = judged_mcap(mcap(schema(1, "sensor_msgs/msg/Imu") + channel(1, 1, "/a") +
                                         message(1, {start + 2 * ms}, stamped(start + ms)) +
                                         message(1, {start + 3 * ms}, stamped(start))));
  EXPECT_EQ(findings.flows.at(0).reordered, 1U);
}

TEST_F(Bags, ChannelsOfOneTopicAreJudgedApart) {
  const auto findings =
      judged_mcap(mcap(channel(4, 0, "/a") + channel(5, 0, "/a") + channel(4, 0, "/a") + message(4, {start}) +
                       message(5, {start + ms}) + message(4, {start + 10 * ms})));
  ASSERT_EQ(findings.flows.size(), 2U);
  EXPECT_EQ(findings.flows[0].period.max_ns(), 10 * ms);
  EXPECT_NE(findings.flows[0].writer, findings.flows[1].writer);
}

TEST_F(Bags, TopicThatFellSilentIsSaidSo) {
  const auto findings = judged_mcap(mcap(channel(1, 0, "/a") + channel(2, 0, "/b") + message(1, {start}) +
                                         message(2, {start}) + message(2, {start + 100 * ms})),
                                    {.deadline = 50ms, .period = {}, .age = {}});
  EXPECT_EQ(findings.flows.at(0).silent_ns, 100 * ms);
  EXPECT_EQ(findings.flows.at(1).silent_ns, 0);
}

TEST_F(Bags, ChunksOfEachCompressionAreRead) {
  for (const auto* how : {"", "lz4", "zstd"}) {
    std::string records = schema(1, "sensor_msgs/msg/Imu") + channel(1, 1, "/a");
    for (int i = 0; i < 1000; ++i)
      records += message(1, {start + i * ms}, stamped(start + (i - 2) * ms) + std::string(300, 'x'));
    const auto findings = judged_mcap(mcap(chunk(records, {how}) + record(7, number(1, 6)) +
                                           chunk(message(1, {start + 1000 * ms}), {how})));
    EXPECT_EQ(findings.flows.at(0).messages, 1001U) << how;
    EXPECT_EQ(findings.flows.at(0).age->max_ns(), 2 * ms) << how;
    EXPECT_THAT(findings.remarks, IsEmpty()) << how;
  }
}

TEST_F(Bags, DamageIsRefusedWithItsPlace) {
  const auto head = channel(1, 0, "/a");
  const auto place = fmt::format("at byte {}", mcap_begin().size());
  EXPECT_THAT(error_of_mcap(mcap(chunk(head, {"", true}))), AllOf(HasSubstr(place), HasSubstr("checksum")));
  EXPECT_THAT(error_of_mcap(mcap(message(1, {start}))), AllOf(HasSubstr(place), HasSubstr("channel 1")));
  EXPECT_THAT(error_of_mcap(mcap(record(0, "x"))), HasSubstr(place));
  EXPECT_THAT(error_of_mcap(mcap(record(5, "x"))), HasSubstr(place));
  EXPECT_THAT(error_of_mcap(mcap(record(6, "x"))), HasSubstr(place));
  EXPECT_THAT(error_of_mcap(mcap(record(3, number(1, 2) + number(0xffffffff, 4)))), HasSubstr(place));
  EXPECT_THAT(error_of_mcap(mcap(head + channel(1, 0, "/b"))), HasSubstr("another topic"));
  EXPECT_THAT(error_of_mcap(mcap(head + message(1, {-1}))), HasSubstr("no time"));
  EXPECT_THAT(error_of_mcap(mcap(record(
                  6, number(0, 16) + number(4, 8) + number(0, 4) + text("zstd") + number(4, 8) + "none"))),
              AllOf(HasSubstr(place), HasSubstr("decompressed")));
  EXPECT_THAT(error_of_mcap(mcap(record(
                  6, number(0, 16) + number(4, 8) + number(0, 4) + text("xz") + number(4, 8) + "none"))),
              HasSubstr("'xz'"));
}

TEST_F(Bags, FileCutAtAnyByteIsJudgedUpToThere) {
  for (const auto* how : {"", "zstd"}) {
    const auto whole = mcap_begin() + channel(1, 0, "/a") + message(1, {start}) +
                       chunk(message(1, {start + ms}), {how}) + message(1, {start + 2 * ms});
    std::uint64_t before = 0;
    for (std::size_t size = magic.size(); size <= whole.size(); ++size) {
      const auto findings = judged_mcap(whole.substr(0, size));
      ASSERT_THAT(findings.remarks, ElementsAre(HasSubstr(fmt::format("byte {}", size))));
      const auto messages = findings.flows.empty() ? 0 : findings.flows[0].messages;
      ASSERT_GE(messages, before);
      before = messages;
    }
    EXPECT_EQ(before, 3U);
  }
}

TEST_F(Bags, AnyWrongByteIsRefusedOrRead) {
  for (const auto* how : {"", "lz4", "zstd"}) {
    const auto whole = mcap(chunk(schema(1, "sensor_msgs/msg/Imu") + channel(1, 1, "/a") +
                                      message(1, {start}, stamped(start)) + message(1, {start + ms}),
                                  {how}) +
                            message(1, {start + 2 * ms}));
    for (std::size_t i = 0; i < whole.size(); ++i)
      for (const char wrong : {'\0', '\xff'}) {
        auto bytes = whole;
        bytes[i] = wrong;
        try {
          for (const auto& flow : judged_mcap(bytes).flows) EXPECT_LE(flow.messages, 3U);
        } catch (const listen::WrongInput&) {
        }
      }
  }
}

TEST_F(Bags, SqliteIsJudgedAsMcapIs) {
  for (const bool newer : {true, false}) {
    const auto path = sqlite(
        newer ? "new.db3" : "old.db3",
        topic_row(3, "/scan", "sensor_msgs/msg/LaserScan") + topic_row(5, "/mine", "my_msgs/msg/Mine") +
            (newer ? fmt::format("INSERT INTO message_definitions VALUES(1, 'my_msgs/msg/Mine', 'ros2msg', "
                                 "'{}', '');",
                                 scan_definition)
                   : "") +
            message_row(3, start + 2 * ms, stamped(start)) +
            message_row(5, start + 2 * ms, stamped(start + ms)) +
            message_row(3, start + 13 * ms, stamped(start + 10 * ms)),
        newer);
    const auto findings = judged(path, {.deadline = 10ms, .period = {}, .age = {}});
    ASSERT_EQ(findings.flows.size(), 2U);
    EXPECT_EQ(findings.flows[0].topic, "/mine");
    EXPECT_EQ(findings.flows[0].age.has_value(), newer);
    EXPECT_EQ(findings.flows[1].messages, 2U);
    EXPECT_EQ(findings.flows[1].late, 1U);
    EXPECT_EQ(findings.flows[1].age->max_ns(), 3 * ms);
    EXPECT_THAT(findings.remarks, IsEmpty());
  }
}

TEST_F(Bags, MessagesOfAnySizeAreRead) {
  const auto path =
      sqlite("a.db3", topic_row(1, "/image", "sensor_msgs/msg/Image") +
                          fmt::format("INSERT INTO messages(topic_id, timestamp, data) VALUES(1, {}, "
                                      "CAST(x'00010000' || zeroblob(20000000) AS BLOB));",
                                      start) +
                          message_row(1, start + ms, stamped(start)));
  const auto findings = judged(path);
  EXPECT_EQ(findings.flows.at(0).messages, 2U);
  EXPECT_EQ(findings.flows.at(0).age->max_ns(), ms);
}

TEST_F(Bags, DamagedSqliteIsRefused) {
  const auto topic = topic_row(1, "/a", "x/msg/X");
  EXPECT_THAT(error_of(sqlite("1.db3", message_row(1, start))), HasSubstr("no topic"));
  EXPECT_THAT(error_of(sqlite("2.db3", topic + message_row(1, -1))), HasSubstr("no time"));
  EXPECT_THAT(error_of(sqlite("3.db3",
                              topic + "INSERT INTO messages(topic_id, timestamp, data) VALUES(1, 'x', '');")),
              HasSubstr("timestamp"));
  const auto other = (folder_ / "4.db3").string();
  execute(other, "CREATE TABLE x(y);");
  EXPECT_THAT(error_of(other), HasSubstr("not as rosbag2 makes them"));
  const auto view = (folder_ / "5.db3").string();
  execute(view,
          "CREATE TABLE topics(id INTEGER PRIMARY KEY, name, type, serialization_format);"
          "CREATE VIEW messages AS WITH RECURSIVE n(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM n) "
          "SELECT x AS rowid, 1 AS topic_id, x AS timestamp, x'' AS data FROM n;");
  EXPECT_NE(error_of(view), "no error");
  auto bytes = std::string("SQLite format 3\0", 16) + std::string(4080, '\xff');
  EXPECT_THAT(error_of(write("6.db3", bytes)), HasSubstr("6.db3"));
}

// A recorder that was killed leaves its newest messages in the log beside the file.
TEST_F(Bags, MessagesInTheLogOfAKilledRecorderCount) {
  const auto live = (folder_ / "live.db3").string(), copy = (folder_ / "copy.db3").string();
  sqlite3* database = nullptr;
  sqlite("live.db3", "PRAGMA journal_mode = WAL;" + topic_row(1, "/a", "x/msg/X"));
  ASSERT_EQ(sqlite3_open(live.c_str(), &database), SQLITE_OK);
  sqlite3_exec(database, message_row(1, start).c_str(), nullptr, nullptr, nullptr);
  fs::copy(live, copy);
  fs::copy(live + "-wal", copy + "-wal");
  sqlite3_close(database);
  EXPECT_EQ(judged(copy).flows.at(0).messages, 1U);
}

TEST_F(Bags, FolderIsReadInTheOrderOfItsMetadata) {
  fs::create_directory(folder_ / "drive");
  write("drive/drive_0.mcap", mcap(channel(1, 0, "/a") + message(1, {start})));
  write("drive/drive_1.mcap", mcap(channel(9, 0, "/a") + message(9, {start + 10 * ms})));
  write("drive/other.mcap", "not named");
  write("drive/metadata.yaml",
        "rosbag2_bagfile_information:\n  version: 2\n  compression_mode: \"\"\n  relative_file_paths:\n"
        "    - drive/drive_0.mcap\n    - drive_1.mcap\n");
  const auto findings = judged((folder_ / "drive").string());
  EXPECT_EQ(findings.flows.at(0).messages, 2U);
  EXPECT_EQ(findings.flows.at(0).period.max_ns(), 10 * ms);
  EXPECT_THAT(findings.remarks, IsEmpty());
}

TEST_F(Bags, WhatMetadataSaysOfTopicsAndCompressionIsRemarked) {
  fs::create_directory(folder_ / "drive");
  write("drive/drive_0.mcap", mcap(channel(1, 0, "/a") + message(1, {start})));
  write("drive/metadata.yaml",
        "rosbag2_bagfile_information:\n  compression_mode: MESSAGE\n  relative_file_paths: [drive_0.mcap]\n"
        "  topics_with_message_count:\n"
        "    - {topic_metadata: {name: /a}, message_count: 1}\n"
        "    - {topic_metadata: {name: /dead}, message_count: 0}\n");
  EXPECT_THAT(judged((folder_ / "drive").string()).remarks,
              ElementsAre(AllOf(HasSubstr("/dead"), Not(HasSubstr("/a"))), HasSubstr("compressed")));
}

TEST_F(Bags, FolderWithoutMetadataIsReadByNumber) {
  fs::create_directory(folder_ / "drive");
  write("drive/drive_10.mcap", mcap_begin() + channel(1, 0, "/a") + message(1, {start + 10 * ms}));
  write("drive/drive_9.mcap", mcap(channel(1, 0, "/a") + message(1, {start})));
  const auto findings = judged((folder_ / "drive").string());
  EXPECT_EQ(findings.flows.at(0).period.max_ns(), 10 * ms);
  EXPECT_THAT(findings.remarks, ElementsAre(HasSubstr("metadata.yaml"), HasSubstr("drive_10.mcap")));
}

TEST_F(Bags, WhatIsNoBagIsRefusedWithWhatToDo) {
  EXPECT_THAT(error_of(write("a.db3.zstd", "\x28\xb5\x2f\xfd....")), HasSubstr("zstd -d"));
  EXPECT_THAT(error_of(write("a.bag", "#ROSBAG V2.0\n")), HasSubstr("mcap convert"));
  EXPECT_THAT(error_of(write("a.mcap", "\x89MCAP1\r\n")), HasSubstr("version"));
  EXPECT_THAT(error_of(write("a.ontime", std::string("SQLite format 3\0", 16) + std::string(52, '.') +
                                             "ontm" + std::string(28, '.'))),
              HasSubstr("ontime report"));
  EXPECT_THAT(error_of(write("empty", "")), HasSubstr("no bag"));
  EXPECT_THAT(error_of((folder_ / "missing").string()), HasSubstr("missing"));
  fs::create_directory(folder_ / "folder");
  EXPECT_THAT(error_of((folder_ / "folder").string()), HasSubstr("no bag"));
  for (const auto* metadata :
       {"", "x", "[", "rosbag2_bagfile_information: 3", "rosbag2_bagfile_information: {}",
        "rosbag2_bagfile_information: {relative_file_paths: [[]]}"}) {
    write("folder/metadata.yaml", metadata);
    EXPECT_THAT(error_of((folder_ / "folder").string()), HasSubstr("metadata.yaml")) << metadata;
  }
  write("folder/metadata.yaml", "rosbag2_bagfile_information: {relative_file_paths: [../../gone.db3]}");
  EXPECT_THAT(error_of((folder_ / "folder").string()), HasSubstr("folder/gone.db3"));
  ASSERT_EQ(::mkfifo((folder_ / "fifo").c_str(), 0600), 0);
  EXPECT_THAT(error_of((folder_ / "fifo").string()), HasSubstr("not a file"));
}

}  // namespace
}  // namespace ontime::bag
