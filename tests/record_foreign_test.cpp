// SPDX-License-Identifier: Apache-2.0
#include "record_fixture.hpp"

namespace ontime::record {
namespace {

TEST_F(RecordTest, ForeignFileIsRefusedAndLeftAlone) {
  { Writer(path_).begin_run({}); }
  const auto results = bytes_of(path_);
  const auto made = [&](const std::string& name, const std::string& bytes) {
    write_bytes((folder_ / name).string(), bytes);
    return (folder_ / name).string();
  };
  const auto text = made("text", std::string(5000, 'x') + "\n");
  const auto other = (folder_ / "other.db").string();
  query(other, "CREATE TABLE bookmark (url TEXT)");
  const auto newer = made("newer.db", results);
  query(newer, "PRAGMA user_version = 5");
  const auto cut = made("cut.db", results.substr(0, 5000));
  const struct {
    std::string path, found;
  } cases[] = {
      {text, "not a results file"}, {other, "another program's"}, {newer, "newer ontime"}, {cut, "damaged"}};
  for (const auto& one : cases) {
    const auto& path = one.path;
    const auto& found = one.found;
    const auto before = bytes_of(path);
    EXPECT_THAT(error_of([&] { Writer writer(path); }), AllOf(HasSubstr(path), HasSubstr(found)));
    EXPECT_THAT(error_of([&] { samples_of(Reader(path), 1); }), AllOf(HasSubstr(path), HasSubstr(found)));
    EXPECT_TRUE(bytes_of(path) == before) << path;
  }
  EXPECT_THAT(files(), ElementsAre("cut.db", "newer.db", "other.db", "results.db", "text"));
}

TEST_F(RecordTest, MissingFilesAndFolders) {
  const auto folder = folder_.string();
  const auto nowhere = (folder_ / "no" / "where.db").string();
  EXPECT_THAT(error_of([&] { Reader reader(path_); }), AllOf(HasSubstr(path_), HasSubstr("No such file")));
  EXPECT_THAT(error_of([&] { Writer writer(nowhere); }),
              AllOf(HasSubstr(nowhere), HasSubstr("No such file")));
  EXPECT_THAT(error_of([&] { Reader reader(folder); }), AllOf(HasSubstr(folder), HasSubstr("not a file")));
  EXPECT_THAT(error_of([&] { Writer writer(folder); }), AllOf(HasSubstr(folder), HasSubstr("not a file")));
  EXPECT_THAT(files(), IsEmpty());
}

// Any user who may write in the folder may put them there.
TEST_F(RecordTest, FifoBesideTheFileIsRefused) {
  { Writer(path_).begin_run({}); }
  write_bytes((folder_ / "other").string(), "x");
  for (const std::string suffix : {"-wal", "-shm", "-journal"})
    for (const bool fifo : {true, false}) {
      const auto beside = path_ + suffix;
      if (fifo)
        ASSERT_EQ(::mkfifo(beside.c_str(), 0666), 0);
      else
        fs::create_symlink("other", beside);
      const auto told = AllOf(HasSubstr(beside), HasSubstr("not a file"));
      EXPECT_FALSE(is_being_written(path_));
      EXPECT_THAT(error_of([&] { Reader(path_).runs(); }), told);
      EXPECT_THAT(error_of([&] { Writer writer(path_); }), told);
      fs::remove(beside);
    }
  EXPECT_EQ(bytes_of((folder_ / "other").string()), "x");
  EXPECT_THAT(Reader(path_).runs(), testing::SizeIs(1));
}

TEST_F(RecordTest, FileIsNotMadeWhereALinkLeads) {
  const auto elsewhere = folder_ / "elsewhere.db";
  fs::create_symlink(elsewhere, path_);
  EXPECT_THAT(error_of([&] { Writer writer(path_); }), AllOf(HasSubstr(path_), HasSubstr("not a file")));
  EXPECT_THAT(files(), ElementsAre("results.db"));
  { Writer(elsewhere.string()).begin_run({}); }
  EXPECT_EQ(Writer(path_).begin_run({}), 2) << "to a file that is there it may lead";
}

TEST_F(RecordTest, EmptyFileIsWrittenButNotRead) {
  write_bytes(path_, "");
  EXPECT_THAT(error_of([&] { Reader reader(path_); }), AllOf(HasSubstr(path_), HasSubstr("empty")));
  EXPECT_EQ(Writer(path_).begin_run({}), 1);
}

TEST_F(RecordTest, DamageIsSaidNotGuessed) {
  {
    Writer writer(path_);
    writer.append(writer.begin_run({}), usual(0, 1));
  }
  query(path_, "UPDATE sample SET fate = 7");
  EXPECT_THAT(error_of([&] { samples_of(Reader(path_), 1); }), AllOf(HasSubstr(path_), HasSubstr("fate 7")));
  query(path_, "UPDATE run SET outcome = '{'");
  EXPECT_THAT(error_of([&] { Reader(path_).runs(); }), AllOf(HasSubstr(path_), HasSubstr("JSON")));
}

// SQLite itself would refuse what is no JSON, for the columns that are taken out of it.
const std::string with_any_asked =
    "DROP VIEW message; ALTER TABLE run DROP COLUMN id; ALTER TABLE run DROP COLUMN transport; "
    "ALTER TABLE run DROP COLUMN repetition; ";

// Files that say they are ours, and are not.
class Foreign : public RecordTest {
 protected:
  Foreign() {
    Writer writer(path_);
    const auto run = writer.begin_run({{"id", "sound"}});
    writer.append(run, usual(0, 3));
    writer.note(run, {"kind", "text", 5, 1});
    writer.end_run(run, {{"sent", 3}});
  }

  // All that can be read, of a copy of the file that was changed so.
  std::string error_after(const std::string& sql) const {
    const auto path = (folder_ / "changed.db").string();
    fs::copy_file(path_, path, fs::copy_options::overwrite_existing);
    EXPECT_THAT(query(path, sql), ::testing::AnyOf("", "delete", "2")) << sql;
    return error_of_reading(path);
  }
  static std::string error_of_reading(const std::string& path) {
    try {
      const Reader reader(path);
      for (const auto& run : reader.runs()) {
        reader.notes(run.number);
        samples_of(reader, run.number);
        reader.each_trace(run.number, [](const auto&) {});
      }
    } catch (const WrongFile& error) {
      return error.what();
    }
    return "";
  }
};

TEST_F(Foreign, UnknownFormatsAreRefused) {
  EXPECT_THAT(error_after("PRAGMA user_version = 0"), HasSubstr("format 0, which no ontime writes"));
  EXPECT_THAT(error_after("PRAGMA user_version = -1"), HasSubstr("format -1, which no ontime writes"));
  EXPECT_THAT(error_after("PRAGMA user_version = 2000000000"), HasSubstr("from a newer ontime"));
  const auto path = (folder_ / "changed.db").string();
  for (const auto* version : {"0", "-1", "5"}) {
    query(path, std::string("PRAGMA user_version = ") + version);
    const auto before = bytes_of(path);
    EXPECT_THAT(error_of([&] { Writer writer(path); }), HasSubstr(std::string("format ") + version));
    EXPECT_TRUE(bytes_of(path) == before);
  }
}

TEST_F(Foreign, OtherTables) {
  const std::string remake = "ALTER TABLE sample RENAME TO old; ";
  for (const auto& sql : {
           std::string("DROP TABLE run"),
           std::string("DROP TABLE sample"),
           std::string("DROP TABLE note"),
           std::string("ALTER TABLE note DROP COLUMN cause"),
           std::string("ALTER TABLE sample RENAME COLUMN fate TO fete"),
           std::string("ALTER TABLE run RENAME COLUMN key TO kee"),
           remake + "CREATE VIEW sample AS SELECT * FROM old",
           remake + "CREATE TABLE sample AS SELECT * FROM old",
           remake + "CREATE VIRTUAL TABLE sample USING fts5(run, message)",
           std::string("PRAGMA user_version = 1; ") + remake +
               "CREATE TABLE sample (run, message, intended_ns AS (zeroblob(1000000000)), due_after_ns, "
               "woke_after_ns, sent_after_ns, received_after_ns, server_received_ns, server_sent_after_ns, "
               "skipped_cycles, fate, PRIMARY KEY (run, message)) WITHOUT ROWID",
       })
    EXPECT_THAT(error_after(sql), AllOf(HasSubstr("changed.db"),
                                        AnyOf(HasSubstr("its table"), HasSubstr("tables are invalid"))))
        << sql;
}

TEST_F(Foreign, ColumnsBesideOursDoNotMatter) {
  const auto path = (folder_ / "changed.db").string();
  EXPECT_EQ(
      error_after("ALTER TABLE sample ADD COLUMN mine TEXT DEFAULT 'x'; ALTER TABLE run ADD COLUMN mine; "
                  "CREATE INDEX mine ON sample (run, fate); CREATE TABLE theirs (x); ANALYZE"),
      "");
  {
    Writer writer(path);
    writer.append(writer.begin_run({}), usual(0, 7));
  }
  expect_same(samples_of(Reader(path), 1), usual(0, 3));
  expect_same(samples_of(Reader(path), 2), usual(0, 7));
}

TEST_F(Foreign, ValuesOfOtherTypes) {
  for (const auto* column :
       {"intended_ns", "due_after_ns", "received_after_ns", "server_received_ns", "fate", "passed_wake_ns"})
    for (const auto* value : {"'many'", "0.5", "x'00'"})
      EXPECT_THAT(error_after(std::string("UPDATE sample SET ") + column + " = " + value),
                  AllOf(HasSubstr("damaged"), HasSubstr("whole number")))
          << column << value;
  EXPECT_THAT(error_after("UPDATE run SET asked = x'7b7d'"), HasSubstr("of asked is not a text"));
  EXPECT_THAT(error_after("UPDATE run SET start_ns = NULL"),
              AllOf(HasSubstr("start_ns"), HasSubstr("whole number")));
  EXPECT_THAT(error_after("UPDATE run SET number = -1"), HasSubstr("out of order"));
  EXPECT_THAT(error_after("UPDATE sample SET message = message - 1"), HasSubstr("out of order"));
  EXPECT_THAT(error_after("UPDATE note SET at_ns = 'then'"), HasSubstr("whole number"));
  EXPECT_THAT(error_after("UPDATE note SET message = -1"), HasSubstr("impossible"));
}

TEST_F(Foreign, NumbersThatCannotBe) {
  for (const auto* change :
       {"start_ns = 9223372036854775807", "start_ns = -9223372036854775807 - 1", "start_ns = 1 << 61"})
    EXPECT_THAT(error_after(std::string("UPDATE run SET ") + change), HasSubstr("impossible")) << change;
  for (const auto* change :
       {"due_after_ns = 9223372036854775807", "received_after_ns = NULL", "received_after_ns = -1",
        "fate = 2", "passed_wake_ns = -1", "server_sent_after_ns = 9223372036854775807",
        "server_received_ns = -9223372036854775807"})
    EXPECT_THAT(error_after(std::string("UPDATE sample SET ") + change), HasSubstr("impossible")) << change;
  EXPECT_THAT(error_after("UPDATE sample SET skipped_cycles = -1"), HasSubstr("skipped -1 cycles"));
  EXPECT_THAT(error_after("UPDATE sample SET skipped_cycles = 1 << 32"),
              HasSubstr("skipped 4294967296 cycles"));
  EXPECT_THAT(error_after("UPDATE sample SET fate = -1"), HasSubstr("fate -1"));
  EXPECT_THAT(error_after("UPDATE note SET at_ns = 9223372036854775807"), HasSubstr("impossible"));
}

TEST_F(Foreign, TextsThatAreNoJson) {
  const auto asked = [](const std::string& text) {
    return with_any_asked + "UPDATE run SET asked = " + text;
  };
  EXPECT_THAT(error_after(asked("''")), "") << "as if nothing had been asked";
  for (const auto* text :
       {"'{'", "'1e999'", "cast(x'22ff22' as text)", "replace(hex(zeroblob(500000)), '00', '[')",
        "replace(hex(zeroblob(500000)), '00', '[') || replace(hex(zeroblob(500000)), '00', ']')",
        "'\"' || hex(zeroblob(4500000)) || '\"'"})
    EXPECT_THAT(error_after(asked(text)), HasSubstr("run 1 is not JSON")) << text;
  EXPECT_THAT(error_after(asked("hex(zeroblob(13000000))")), HasSubstr("too big"));
  EXPECT_THAT(error_after("UPDATE run SET outcome = '[[]'"), HasSubstr("run 1 is not JSON"));
}

TEST_F(Foreign, TextIsPassedOnAsUtf8) {
  query(path_, "UPDATE note SET kind = cast(x'1b5b' as text), text = cast(x'ff0041' as text)");
  const auto notes = Reader(path_).notes(1);
  ASSERT_EQ(notes.size(), 1u);
  EXPECT_EQ(notes[0].kind, "\x1b[");
  EXPECT_EQ(notes[0].text, std::string("\xef\xbf\xbd\0A", 5));
}

TEST_F(Foreign, WordsOfTheirsDoNotReachTheTerminal) {
  const auto error = error_after(
      "PRAGMA writable_schema = ON; UPDATE sqlite_schema SET sql = sql || char(27) || '[31m' "
      "WHERE name = 'run'; UPDATE sqlite_schema SET sql = 'CREATE TABLE x\x1b[31m' WHERE name = 'note'");
  EXPECT_THAT(error, HasSubstr("changed.db"));
  EXPECT_THAT(error, Not(HasSubstr("\x1b")));
}

TEST_F(Foreign, NothingThatIsPlantedIsRun) {
  query(path_,
        "CREATE TABLE trace (x); CREATE TRIGGER on_run AFTER INSERT ON run BEGIN INSERT INTO trace VALUES "
        "(1); END; "
        "CREATE TRIGGER on_sample BEFORE INSERT ON sample BEGIN SELECT RAISE(ABORT, 'caught'); END; "
        "DROP VIEW message; CREATE VIEW message AS SELECT * FROM message");
  {
    Writer writer(path_);
    writer.append(writer.begin_run({}), usual(0, 7));
  }
  expect_same(samples_of(Reader(path_), 2), usual(0, 7));
  EXPECT_EQ(query(path_, "SELECT count(*) FROM trace"), "0");
}

// Pages of a file's tables, to be made what no program makes.
class Pages {
 public:
  explicit Pages(const std::string& path) : path_(path), bytes_(bytes_of(path)) {}
  void write() { write_bytes(path_, bytes_); }

  // Of an interior page of an index, whose cells and whose header each begin with a page they refer to.
  void refer_to(std::size_t page, std::size_t other) {
    const auto begin = (page - 1) * 4096;
    ASSERT_EQ(bytes_[begin], 2);
    for (std::size_t cell = 0; cell < number(begin + 3, 2); ++cell)
      set(begin + number(begin + 12 + 2 * cell, 2), other);
    set(begin + 8, other);
  }
  std::size_t first_of(std::size_t page) const {
    const auto begin = (page - 1) * 4096;
    return number(begin + number(begin + 12, 2), 4);
  }
  std::size_t add_copy(std::size_t page) {
    bytes_ += bytes_.substr((page - 1) * 4096, 4096);
    set(28, bytes_.size() / 4096);
    return bytes_.size() / 4096;
  }

 private:
  std::size_t number(std::size_t at, std::size_t size) const {
    std::size_t value = 0;
    for (std::size_t i = 0; i < size; ++i) value = value << 8 | static_cast<unsigned char>(bytes_[at + i]);
    return value;
  }
  void set(std::size_t at, std::size_t value) {
    for (std::size_t i = 0; i < 4; ++i) bytes_[at + i] = static_cast<char>(value >> (24 - 8 * i));
  }
  std::string path_, bytes_;
};

TEST_F(Foreign, RowsWithoutEnd) {
  {
    Writer writer(path_);
    writer.append(writer.begin_run({}), usual(0, 2000));
  }
  const auto root = std::stoul(query(path_, "SELECT rootpage FROM sqlite_schema WHERE name = 'sample'"));
  Pages pages(path_);
  pages.refer_to(root, pages.first_of(root));
  pages.write();
  EXPECT_THAT(error_of_reading(path_), HasSubstr("out of order"));
}

TEST_F(Foreign, SortingWithoutEnd) {
  {
    Writer writer(path_);
    writer.append(writer.begin_run({}), usual(0, 2000));
  }
  // An index that SQLite is made to believe to be the better way, though what it gives must be sorted first.
  query(path_,
        "CREATE INDEX theirs ON sample (run, fate, message, intended_ns, due_after_ns, woke_after_ns, "
        "sent_after_ns, "
        "received_after_ns, server_received_ns, server_sent_after_ns, skipped_cycles, passed_wake_ns); "
        "ANALYZE; "
        "DELETE FROM sqlite_stat1; INSERT INTO sqlite_stat1 VALUES "
        "('sample', 'sample', '1000000 1000000 1000000'), ('sample', 'theirs', '1000000 1 1 1 1 1 1 1 1 1 1 "
        "1 1')");
  const auto root = std::stoul(query(path_, "SELECT rootpage FROM sqlite_schema WHERE name = 'theirs'"));
  Pages pages(path_);
  auto deeper = pages.first_of(root);
  for (int level = 0; level < 10; ++level) {
    const auto copy = pages.add_copy(root);
    pages.refer_to(copy, deeper);
    deeper = copy;
  }
  pages.refer_to(root, deeper);
  pages.write();
  EXPECT_THAT(error_of_reading(path_), HasSubstr("never end"));
}

}  // namespace
}  // namespace ontime::record
