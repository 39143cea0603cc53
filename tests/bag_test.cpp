// SPDX-License-Identifier: Apache-2.0
#include "bag/bag.hpp"

#include <array>
#include <filesystem>
#include <fstream>
#include <numeric>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sqlite3.h>
#include <sys/stat.h>

#include "bag_fixture.hpp"

namespace ontime::bag {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

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
  EXPECT_THAT(error_of_mcap(mcap(head + message(1, {-1}))), HasSubstr("invalid time"));
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
      ASSERT_EQ(findings.incomplete, findings.remarks);
      const auto messages = findings.flows.empty() ? 0 : findings.flows[0].messages;
      ASSERT_GE(messages, before);
      before = messages;
    }
    EXPECT_EQ(before, 3U);
  }
}

TEST_F(Bags, CutBetweenTwoRecordsIsNotWithinOne) {
  for (const auto& last : {message(1, {start}), chunk(message(1, {start}))}) {
    const auto whole = mcap_begin() + channel(1, 0, "/a") + last;
    EXPECT_THAT(judged_mcap(whole).remarks, ElementsAre(Not(HasSubstr("within a record"))));
    EXPECT_THAT(judged_mcap(whole + '\5').remarks, ElementsAre(HasSubstr("within a record")));
    EXPECT_THAT(judged_mcap(whole.substr(0, whole.size() - 1)).remarks,
                ElementsAre(HasSubstr("within a record")));
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
  EXPECT_THAT(error_of(sqlite("2.db3", topic + message_row(1, -1))), HasSubstr("invalid time"));
  EXPECT_THAT(error_of(sqlite("3.db3",
                              topic + "INSERT INTO messages(topic_id, timestamp, data) VALUES(1, 'x', '');")),
              HasSubstr("timestamp"));
  const auto other = (folder_ / "4.db3").string();
  execute(other, "CREATE TABLE x(y);");
  EXPECT_THAT(error_of(other), HasSubstr("rosbag2"));
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

// SQLite opens what lies beside the file that the link leads to.
TEST_F(Bags, SqliteBesideAFifoIsRefusedAlsoByALink) {
  const auto path = sqlite("a.db3", topic_row(1, "/a", "x/msg/X") + message_row(1, start));
  const auto link = (folder_ / "link.db3").string();
  fs::create_symlink("a.db3", link);
  EXPECT_EQ(judged(link).flows.at(0).messages, 1U);
  ASSERT_EQ(::mkfifo((path + "-wal").c_str(), 0600), 0);
  EXPECT_THAT(error_of(path), HasSubstr("a.db3-wal is not a regular file"));
  EXPECT_THAT(error_of(link), HasSubstr("a.db3-wal is not a regular file"));
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

TEST_F(Bags, SilentTopicsAndCompressionInMetadataAreRemarked) {
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

TEST_F(Bags, OtherFilesAreRefusedWithTheFix) {
  EXPECT_THAT(error_of(write("a.db3.zstd", "\x28\xb5\x2f\xfd....")), HasSubstr("zstd -d"));
  EXPECT_THAT(error_of(write("a.bag", "#ROSBAG V2.0\n")), HasSubstr("mcap convert"));
  EXPECT_THAT(error_of(write("a.mcap", "\x89MCAP1\r\n")), HasSubstr("version"));
  EXPECT_THAT(error_of(write("a.ontime", std::string("SQLite format 3\0", 16) + std::string(52, '.') +
                                             "ontm" + std::string(28, '.'))),
              HasSubstr("ontime report"));
  EXPECT_THAT(error_of(write("nothing", "")), HasSubstr("empty"));
  EXPECT_THAT(error_of(write("text", "x")), HasSubstr("--from"));
  EXPECT_THAT(error_of((folder_ / "missing").string()), HasSubstr("missing"));
  fs::create_directory(folder_ / "folder");
  EXPECT_THAT(error_of((folder_ / "folder").string()), HasSubstr("not a bag"));
  for (const auto* metadata :
       {"", "x", "[", "rosbag2_bagfile_information: 3", "rosbag2_bagfile_information: {}",
        "rosbag2_bagfile_information: {relative_file_paths: [[]]}"}) {
    write("folder/metadata.yaml", metadata);
    EXPECT_THAT(error_of((folder_ / "folder").string()), HasSubstr("metadata.yaml")) << metadata;
  }
  write("folder/metadata.yaml", "rosbag2_bagfile_information: {relative_file_paths: [../../gone.db3]}");
  EXPECT_THAT(error_of((folder_ / "folder").string()), HasSubstr("folder/gone.db3"));
  ASSERT_EQ(::mkfifo((folder_ / "fifo").c_str(), 0600), 0);
  EXPECT_THAT(error_of((folder_ / "fifo").string()), HasSubstr("regular file"));
}

}  // namespace
}  // namespace ontime::bag
