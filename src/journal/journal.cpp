// SPDX-License-Identifier: Apache-2.0
#include "journal/journal.hpp"

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <thread>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "journal/folder.hpp"
#include "journal/format.hpp"
#include "journal/kinds.hpp"
#include "journal/place.hpp"
#include "journal/revert.hpp"
#include "process/process.hpp"

namespace ontime::journal {
namespace {

using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;

constexpr auto holder_may_end_in = 3s;

struct Unheld {
  Folder folder;
  Journal::GivenBack given_back;
};
// The folder, once no other ontime holds the machine: while it is locked, none can. Restores what ended
// processes left. Nothing if there is no folder, and none is to be made.
std::optional<Unheld> enter_unheld(bool make, std::span<const Kind> more) {
  // A process that was signalled or killed may take some time to end.
  for (const auto until = Clock::now() + holder_may_end_in;; std::this_thread::sleep_for(50ms)) {
    auto folder = make ? std::optional(Folder::make()) : Folder::find();
    if (!folder) return {};
    auto others = clear(*folder, more);
    if (others.holder.empty()) return Unheld{std::move(*folder), std::move(others.given_back)};
    if (Clock::now() > until)
      throw Error(fmt::format(
          "another ontime changes this machine: {}. Fix: wait until it ends, or press Ctrl-C there",
          others.holder));
  }  // the holder needs the folder to end
}

// For people: no control characters.
std::string plain(std::string text) {
  std::replace_if(
      text.begin(), text.end(), [](unsigned char c) { return c < ' ' || c == 0x7f; }, ' ');
  return text.substr(0, 200);
}

}  // namespace

const std::string to_be_made = "to be made";

struct Journal::File {
  std::string name;
  Fd fd;
  pid_t owner;
  std::size_t entries = 0;
};

Journal::Journal(std::span<const Kind> more) : more_(more) {}

Journal::~Journal() { revert(); }

Journal::GivenBack Journal::hold() {
  if (file_ && file_->owner == getpid()) return {};
  file_.reset();
  auto entered = enter_unheld(true, more_);
  auto& folder = entered->folder;
  auto [name, fd] = folder.add_journal();
  try {
    const auto [pid, command] =
        holder_ ? *holder_ : Holder{getpid(), fmt::format("{}", fmt::join(process::command_line(), " "))};
    append(fd.get(), line_of(Header{boot_id(), pid, plain(command)}));
  } catch (const Error&) {
    folder.remove(name);
    throw;
  }
  file_ = std::make_unique<File>(File{std::move(name), std::move(fd), getpid()});
  return std::move(entered->given_back);
}

std::string Journal::other_holder() const try {
  const auto folder = Folder::find();
  if (!folder) return "";
  for (const auto& name : folder->journals()) {
    if (file_ && name == file_->name) continue;
    const auto opened = folder->open(name);
    if (!opened.alive) continue;
    const auto owner = parse(text_of(opened.fd.get())).header;
    // Another process may hold it for the same ontime.
    if (!holder_ || owner.pid != holder_->pid || owner.command != plain(holder_->command))
      return in_quotes(owner.command);
  }
  return "";
} catch (const Error&) {
  return "";
}

void Journal::change(const Kind& kind, const std::string& what, const Value& wanted) {
  if (find_kind(kind.name, more_) == nullptr)
    throw std::logic_error(fmt::format("{} was not named to the journal as a kind of change", kind.name));
  if (!kind.accepts(what))
    throw Error(fmt::format("{} is not a thing of kind '{}'", in_quotes(what), kind.name));
  if (kind.needs_root && geteuid() != 0)
    throw Error(fmt::format("{} {} needs root. Fix: run as root", kind.name, kind.title_of(what)));
  hold();
  const int fd = file_->fd.get();
  const auto before = kind.read(what);
  if (before == wanted) return;
  const auto length = lseek(fd, 0, SEEK_END);
  const auto line = line_of(Entry{kind.name, place(kind.scope), what, before, wanted});
  if (length < 0 || length + static_cast<off_t>(line.size()) > max_journal_bytes / 2)
    throw cannot("the journal", EFBIG);
  append(fd, line);
  const auto index = file_->entries++;
  try {
    kind.write(what, wanted, before);
    const auto now = kind.read(what);
    if (wanted == to_be_made && now)
      append(fd, line_of_identity(index, *now));
    else if (now != wanted)
      throw Error(fmt::format("{} {}: requested {}, is {}", kind.name, kind.title_of(what),
                              wanted.value_or("gone"), now.value_or("gone")));
  } catch (const MadeByAnother&) {
    cut(fd, static_cast<std::size_t>(length));
    --file_->entries;
    throw;
  } catch (const std::exception&) {  // also from the library: no thread, no memory
    // ontime made the present state: restore it. If that fails too, the change stays in the journal.
    try {
      if (kind.read(what) != before) kind.write(what, before, wanted);
      if (kind.read(what) == before) {
        cut(fd, static_cast<std::size_t>(length));
        --file_->entries;
      }
    } catch (const std::exception&) {  // the first error is reported
    }
    throw;
  }
}

std::vector<std::string> Journal::take_back(const Kind& kind, const std::string& what) {
  if (!file_ || file_->owner != getpid()) return {};
  const auto is_it = [&](const Entry& entry) { return entry.kind == kind.name && entry.what == what; };
  auto reverted = journal::revert(file_->fd.get(), folder_path() + '/' + file_->name, more_, is_it);
  file_->entries = reverted.entries;
  return std::move(reverted.left);
}

std::vector<std::string> Journal::revert() noexcept {
  if (!file_ || file_->owner != getpid()) return {};
  const auto file = std::move(file_);
  std::vector<std::string> left;
  try {
    // Without the folder: it may have been removed, or a stopped ontime locks it.
    auto reverted = journal::revert(file->fd.get(), folder_path() + '/' + file->name, more_);
    left = std::move(reverted.left);
    if (!reverted.finished) return left;
  } catch (const std::exception& error) {
    return {error.what()};  // the journal stays, for revert_abandoned()
  }
  try {
    if (const auto folder = Folder::find()) folder->remove(file->name);
  } catch (const std::exception&) {  // it stays with nothing to undo in it, and the next ontime removes it
  }
  return left;
}

void Journal::remember(const Kind& kind, const std::string& what) {
  hold();
  const auto now = kind.read(what);
  append(file_->fd.get(), line_of(Entry{kind.name, place(kind.scope), what, now, now}));
  ++file_->entries;
}

void Journal::keep() {
  if (!file_ || file_->owner != getpid()) return;
  const auto folder = Folder::make();
  if (file_->entries == 0)
    folder.remove(file_->name);
  else
    folder.keep(file_->name);
  file_.reset();
}

Journal::GivenBack Journal::revert_kept() {
  auto entered = enter_unheld(false, more_);
  if (!entered) return {};
  auto& [folder, all] = *entered;
  for (const auto& name : folder.kept()) revert_file(folder, name, folder.open(name), more_, all);
  return std::move(all);
}

std::vector<Kept> kept(std::span<const Kind> more) {
  std::vector<Kept> all;
  const auto folder = Folder::find();
  if (!folder) return all;
  auto names = folder->kept();
  std::reverse(names.begin(), names.end());
  for (const auto& name : names) {
    const auto path = folder->path() + '/' + name;
    const auto opened = folder->open(name);
    if (!opened.not_used.empty()) throw Error(fmt::format("{} {}", path, opened.not_used));
    look_at(opened.fd.get(), path, more, all);
  }
  return all;
}

std::vector<std::string> revert_abandoned(std::span<const Kind> more, Tell tell) {
  try {
    const auto folder = Folder::find();
    if (!folder) return {};
    auto [done, left, finished] = clear(*folder, more).given_back;
    if (tell == Tell::once) left = folder->not_yet_told(left);
    std::ranges::move(left, std::back_inserter(done));
    return std::move(done);
  } catch (const Error& error) {
    // On a full disk, only this process can remember that it reported this.
    static std::string told;
    if (told == error.what()) return {};
    told = error.what();
    return {told};
  }
}

}  // namespace ontime::journal
