// SPDX-License-Identifier: Apache-2.0
#include "bag/bag.hpp"

#include <fmt/format.h>

#include "bag/files.hpp"
#include "bag/judge.hpp"

namespace ontime::bag {
namespace {

// Per call: no more misses than may wait to be taken, but for those that the end of a file brings.
constexpr std::size_t most_messages = listen::most_misses / 2;

class Bag final : public listen::Sensor {
 public:
  Bag(Files files, const listen::Limits& limits, std::set<std::string> topics)
      : files_(std::move(files)), judge_(limits, std::move(topics)) {
    reader_ = reader_of(files_.paths.front());
  }

  // Does not wait: the file is complete.
  bool listen_for(std::chrono::milliseconds) override {
    for (std::size_t i = 0; i < most_messages; ++i) {
      if (reader_ == nullptr) {
        if (next_ == files_.paths.size()) return false;
        reader_ = reader_of(files_.paths[next_]);
      }
      const auto message = reader_->next();
      if (!message) {
        end_file();
        break;
      }
      judge_.add(*message);
    }
    return true;
  }

  listen::Findings findings() const override {
    auto findings = judge_.findings();
    findings.silent = files_.silent;
    findings.remarks.insert(findings.remarks.begin(), files_.remarks.begin(), files_.remarks.end());
    for (const auto& cut : cuts_) findings.add_incomplete(cut);
    return findings;
  }

  std::vector<listen::Miss> take_misses() override { return judge_.take_misses(); }
  void keep_rows(listen::KeepRow keep) override { judge_.keep_rows(std::move(keep)); }

 private:
  void end_file() {
    if (const auto cut = reader_->cut(); !cut.empty())
      cuts_.push_back(fmt::format(
          "{}: {}: the recorder was killed, or the file was truncated. ontime judges the part before",
          files_.paths[next_], cut));
    judge_.end_file();
    reader_.reset();
    ++next_;
  }

  Files files_;
  std::vector<std::string> cuts_;  // remarks on truncated files
  Judge judge_;
  std::unique_ptr<Reader> reader_;
  std::size_t next_ = 0;  // the file of reader_, or the next one
};

}  // namespace

std::unique_ptr<listen::Sensor> open(const std::string& path, const listen::Limits& limits,
                                     std::set<std::string> topics) {
  return std::make_unique<Bag>(files_of(path), limits, std::move(topics));
}

}  // namespace ontime::bag
