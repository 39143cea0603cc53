// SPDX-License-Identifier: Apache-2.0
#include "bag/files.hpp"

#include <algorithm>
#include <filesystem>
#include <string_view>
#include <utility>

#include <fmt/format.h>
#include <yaml-cpp/yaml.h>

#include "bag/bytes.hpp"
#include "listen/listen.hpp"

namespace ontime::bag {
namespace {

namespace fs = std::filesystem;
using namespace std::string_view_literals;

constexpr std::size_t most_metadata_bytes = 16 << 20;
constexpr std::size_t most_name_characters = 200;  // of the silent topics that are named
constexpr auto sqlite_magic = "SQLite format 3\0"sv, mcap_magic = "\x89MCAP0\r\n"sv;
constexpr auto results_magic = "ontm"sv;  // https://sqlite.org/fileformat.html: the application's number
constexpr std::size_t results_magic_at = 68;

// The first bytes of a file; fewer if the file is shorter.
std::string beginning_of(const std::string& path, std::size_t most) {
  std::string begin(most, '\0');
  File file(path);
  begin.resize(file.read(std::as_writable_bytes(std::span(begin))));
  if (!file.error().empty()) throw listen::WrongInput(fmt::format("{}: {}", path, file.error()));
  return begin;
}

[[noreturn]] void fail_form(const std::string& path, std::string_view begin) {
  const auto* what = "not a bag: neither rosbag2 SQLite nor MCAP. For output of cyclictest: --from";
  if (begin.empty())
    what = "the file is empty";
  else if (begin.starts_with(sqlite_magic))
    what = "a results file of ontime, not a bag. Fix: ontime report FILE";
  else if (begin.starts_with("\x28\xb5\x2f\xfd"sv))
    what = "the whole file is compressed. Fix: zstd -d FILE, then name the decompressed file";
  else if (begin.starts_with("\x89MCAP"sv))
    what = "MCAP of an unknown version";
  else if (begin.starts_with("#ROSBAG"sv))
    what = "a bag of ROS 1. Fix: mcap convert FILE OUT.mcap";
  throw listen::WrongInput(fmt::format("{}: {}", path, what));
}

std::string metadata_in(const std::string& path) {
  auto text = beginning_of(path, most_metadata_bytes);
  if (text.size() == most_metadata_bytes)
    throw listen::WrongInput(
        fmt::format("{}: {} bytes or more, too large for metadata of a bag", path, most_metadata_bytes));
  return text;
}

// Recorded topics without messages.
std::set<std::string> silent_in(const YAML::Node& topics) {
  std::set<std::string> silent;
  for (const auto& topic : topics)
    if (topic["message_count"].as<std::uint64_t>() == 0)
      silent.insert(topic["topic_metadata"]["name"].as<std::string>());
  return silent;
}
std::string text_of(const std::set<std::string>& topics) {
  std::string names;
  std::size_t more = 0;
  for (const auto& name : topics)
    if (names.size() > most_name_characters)
      ++more;
    else
      names += (names.empty() ? "" : ", ") + name;
  return more == 0 ? names : fmt::format("{} and {} more", names, more);
}

// Older versions name the files with their folder, newer ones without; they always lie beside metadata.yaml.
Files files_by(const fs::path& metadata) {
  Files files;
  try {
    const auto about = YAML::Load(metadata_in(metadata.string()))["rosbag2_bagfile_information"];
    for (const auto& file : about["relative_file_paths"])
      files.paths.push_back((metadata.parent_path() / fs::path(file.as<std::string>()).filename()).string());
    files.silent = silent_in(about["topics_with_message_count"]);
    if (!files.silent.empty())
      files.remarks.push_back(
          fmt::format("topics recorded without messages, and not judged: {}. To judge one: --topic TOPIC",
                      text_of(files.silent)));
    if (about["compression_mode"].as<std::string>("") == "MESSAGE")
      files.remarks.emplace_back("each message is compressed: ages from header.stamp are unknown");
  } catch (const YAML::Exception& error) {
    throw listen::WrongInput(
        fmt::format("{}: not metadata of rosbag2 ({})", metadata.string(), error.what()));
  }
  if (files.paths.empty())
    throw listen::WrongInput(fmt::format("{}: lists no file of the bag", metadata.string()));
  return files;
}

// The number of a file of a split bag: 12 of "drive_12.db3".
std::pair<std::size_t, std::string> order_of(const std::string& path) {
  const auto stem = fs::path(path).stem().string();
  const auto begin = stem.find_last_not_of("0123456789");
  const auto digits = stem.substr(begin == stem.npos ? 0 : begin + 1);
  return {digits.empty() || digits.size() > 9 ? 0 : std::stoul(digits), path};
}

// The recorder writes metadata.yaml when it ends: one that was killed left none.
Files files_in(const fs::path& folder) {
  Files files;
  std::error_code error;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end; entry.increment(error))
    if (const auto kind = entry->path().extension(); kind == ".db3" || kind == ".mcap")
      files.paths.push_back(entry->path().string());
  if (error) throw listen::WrongInput(fmt::format("{}: {}", folder.string(), error.message()));
  if (files.paths.empty())
    throw listen::WrongInput(
        fmt::format("{}: not a bag: no metadata.yaml, no .db3 and no .mcap file", folder.string()));
  std::ranges::sort(files.paths, {}, order_of);
  files.remarks.push_back(fmt::format(
      "{} has no metadata.yaml: its recorder was killed. ontime reads its {} files in order of their numbers",
      folder.string(), files.paths.size()));
  return files;
}

}  // namespace

Files files_of(const std::string& path) {
  std::error_code error;  // of a link to itself, for example: reading the file tells why
  if (!fs::is_directory(path, error)) return {{path}, {}};
  const auto metadata = fs::path(path) / "metadata.yaml";
  return fs::exists(metadata, error) ? files_by(metadata) : files_in(path);
}

std::unique_ptr<Reader> reader_of(const std::string& path) {
  const auto begin = beginning_of(path, results_magic_at + results_magic.size());
  const bool is_results = begin.find(results_magic, results_magic_at) == results_magic_at;
  if (begin.starts_with(sqlite_magic) && !is_results) return read_sqlite(path);
  if (begin.starts_with(mcap_magic)) return read_mcap(path);
  fail_form(path, begin);
}

}  // namespace ontime::bag
