// SPDX-License-Identifier: Apache-2.0
// Things that tests of the journal set: each is a file.
#pragma once

#include <system_error>

#include "journal_fixture.hpp"

namespace ontime::journal {

// A thing that can be set: what stands in a file. Where it can be seen from and whether a reboot takes it is
// the kind's; so is what it makes of a value.
inline Value read_setting(const std::string& path) {
  if (!fs::exists(path)) return {};
  return read_file(path);
}
inline void write_setting(const std::string& path, const Value& value, const Value&) {
  if (value == "impossible") throw Error("no such value");
  if (value == "another is quicker") {
    write_file(path, "another's");
    throw MadeByAnother("it exists");
  }
  if (value == "no thread")
    throw std::system_error(std::make_error_code(std::errc::resource_unavailable_try_again));
  if (value)
    write_file(path, *value == "9000" ? "4096" : *value);
  else
    fs::remove(path);
}
inline bool is_setting(const std::string& path) { return path.find("/ontime-setting") != path.npos; }

inline std::string title_of_setting(const std::string& path) { return "titled " + path; }

constexpr Kind setting(const char* name, Scope scope, bool on_disk = false, bool needs_root = false) {
  return {name, scope, is_setting, read_setting, write_setting, on_disk, needs_root, title_of_setting};
}
inline const std::vector<Kind> settings = {
    setting("governor", Scope::machine), setting("qdisc", Scope::network_namespace),
    setting("file", Scope::machine, true), setting("privilege", Scope::machine, false, true)};
inline const Kind& governor = settings[0];
inline const Kind& qdisc = settings[1];

class Settings : public Journals {
 protected:
  void SetUp() override {
    fs::create_directory(folder_);
    write_file(one_, "powersave");
  }
  void TearDown() override {
    fs::remove_all(folder_);
    Journals::TearDown();
  }

  const fs::path folder_ = fs::temp_directory_path() / ("ontime-journal-test-" + std::to_string(getpid()));
  const std::string one_ = folder_ / "ontime-setting-1", two_ = folder_ / "ontime-setting-2";
};

}  // namespace ontime::journal
