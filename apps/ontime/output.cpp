// SPDX-License-Identifier: Apache-2.0
#include "output.hpp"

#include <cerrno>
#include <filesystem>
#include <system_error>
#include <utility>

#include <fmt/format.h>
#include <unistd.h>

#include "campaign/campaign.hpp"

namespace ontime::app {

namespace fs = std::filesystem;

Output::Output(std::string path) : path_(std::move(path)) {
  std::error_code ignored;
  const bool to_stdout = path_.empty();
  if (!to_stdout && (!fs::exists(path_, ignored) || fs::is_regular_file(path_, ignored)))
    part_ = fmt::format("{}.part-{}", path_, ::getpid());
  const auto* mode = part_.empty() ? "we" : "wxe";
  file_.reset(to_stdout ? ::fdopen(::dup(STDOUT_FILENO), "w")
                        : std::fopen((part_.empty() ? path_ : part_).c_str(), mode));
  if (!file_) {
    part_.clear();
    fail(errno);
  }
}

Output::~Output() {
  std::error_code ignored;
  if (!part_.empty()) fs::remove(part_, ignored);
}

void Output::write(std::string_view text) {
  if (std::fwrite(text.data(), 1, text.size(), file_.get()) != text.size()) fail(errno);
}

void Output::finish() {
  if (std::fflush(file_.get()) != 0) fail(errno);
  if (part_.empty()) return;
  if (std::rename(part_.c_str(), path_.c_str()) != 0) fail(errno);
  part_.clear();
}

void Output::fail(int error) const {
  throw campaign::Error(
      3, fmt::format("{} cannot be written: {}. Choose another file, or make room.",
                     path_.empty() ? "standard output" : path_, std::generic_category().message(error)));
}

}  // namespace ontime::app
