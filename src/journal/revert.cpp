// SPDX-License-Identifier: Apache-2.0
#include "journal/revert.hpp"

#include <algorithm>
#include <iterator>
#include <set>
#include <utility>

#include <fmt/format.h>

#include "journal/kinds.hpp"
#include "journal/place.hpp"

namespace ontime::journal {
namespace {

enum class Fate {
  undone,
  nothing_there,  // never made, or already undone by another program or a reboot
  not_ours,       // another program has changed it since
  out_of_sight,   // it may exist elsewhere
  out_of_reach,   // it may exist, but the names that led to it are gone
};

bool is_ours(const Entry& entry, const Value& now) {
  return entry.after == to_be_made ? now.has_value() : now == entry.after;
}

Fate undo_from(bool same_place, const Entry& entry, const Kind& kind) {
  if (entry.before == entry.after) return Fate::nothing_there;  // only recorded, not changed
  const auto now = kind.read(entry.what);
  if (is_ours(entry, now) && (same_place || now)) {
    kind.write(entry.what, entry.before, entry.after);
    if (kind.read(entry.what) == entry.before) return Fate::undone;
    throw Error(fmt::format("{} {} cannot be restored", kind.name, kind.title_of(entry.what)));
  }
  if (!same_place) return Fate::out_of_sight;
  return now == entry.before || !now ? Fate::nothing_there : Fate::not_ours;
}

// Without a boot id (a /proc without sys) no change counts as lost by a reboot.
bool of_another_boot(const Header& header) {
  const auto boot = boot_id();
  return !boot.empty() && !header.boot.empty() && header.boot != boot;
}

// Whether this journal's owner made the namespace: then everything in it was removed with it.
bool was_made(const std::string& network, const std::vector<Entry>& entries) {
  return std::any_of(entries.begin(), entries.end(), [&](const Entry& entry) {
    return entry.kind == namespace_kind.name && entry.after == network;
  });
}

Fate undo(const Entry& entry, const Kind& kind, const Contents& contents) {
  const bool rebooted = of_another_boot(contents.header);
  if (rebooted && !kind.on_disk) return Fate::nothing_there;
  const bool same_place = rebooted || entry.where == place(kind.scope);
  if (same_place) return undo_from(true, entry, kind);
  if (kind.scope == Scope::mount_namespace) {  // an identity is the same from everywhere
    const bool ended = mount_namespace_ended(entry.where);
    const auto fate = undo_from(ended, entry, kind);
    return ended && fate == Fate::nothing_there && kind.on_disk ? Fate::out_of_reach : fate;
  }
  // Elsewhere the same name is another thing.
  const auto name = namespace_name(entry.where);
  if (!name) return was_made(entry.where, contents.entries) ? Fate::nothing_there : Fate::out_of_sight;
  auto fate = Fate::out_of_sight;
  within_namespace(*name, [&] {
    if (entry.where == place(kind.scope)) fate = undo_from(true, entry, kind);
  });
  return fate;
}

const Kind* acceptable_kind(const Entry& entry, std::span<const Kind> more) {
  const auto* const kind = find_kind(entry.kind, more);
  if (kind == nullptr || !kind->accepts(entry.what) || (kind->needs_root && geteuid() != 0)) return nullptr;
  return kind;
}

template <class One>
bool is_of(const One& one, const Entry& entry) {
  return one.kind == entry.kind && one.where == entry.where && one.what == entry.what;
}

// Several changes of the same thing are reported once: with the last result.
struct Told {
  std::vector<std::pair<const Entry*, std::string>> all;

  void say(const Entry& entry, std::string line) {
    const auto known = std::ranges::find_if(all, [&](const auto& one) { return is_of(*one.first, entry); });
    (known == all.end() ? all.emplace_back(&entry, "") : *known).second = std::move(line);
  }
  void forget(const Entry& entry) {
    std::erase_if(all, [&](const auto& one) { return is_of(*one.first, entry); });
  }
  std::vector<std::string> lines() const {
    std::vector<std::string> lines;
    for (const auto& [entry, line] : all) lines.push_back(line);
    return lines;
  }
};

std::string by_hand(const std::string& path) {
  return fmt::format("(from {}: undo it by hand, then remove this file)", path);
}

// The last change first. Undone changes are marked as done.
Reverted undo(Contents& contents, const std::string& path, std::span<const Kind> more, const Wanted& wanted) {
  Told done, left;
  std::set<std::pair<std::string, std::string>> kept;
  for (auto index = contents.entries.size(); index-- > 0;) {
    auto& entry = contents.entries[index];
    if (entry.done || (wanted && !wanted(entry))) continue;
    // Several changes of one thing are undone in reverse order: not before the later ones.
    if (kept.contains({entry.kind, entry.where + entry.what})) continue;
    const auto whose =
        fmt::format("process {} ({})", contents.header.pid, in_quotes(contents.header.command));
    try {
      const auto* const kind = acceptable_kind(entry, more);
      if (kind == nullptr)
        throw Error(fmt::format("this version of ontime, or this user, cannot undo {}",
                                in_quotes(entry.kind + ' ' + entry.what)));
      const auto title = kind->title_of(entry.what);
      switch (undo(entry, *kind, contents)) {
        case Fate::undone:
          done.say(entry, entry.before ? fmt::format("set {} {} back to {}, left by {}", entry.kind, title,
                                                     *entry.before, whose)
                                       : fmt::format("removed {} {}, left by {}", entry.kind, title, whose));
          break;
        case Fate::nothing_there:
          left.forget(entry);  // as it was before all changes: a revert was killed before it noted that
          break;
        case Fate::not_ours:
          left.say(entry, fmt::format("left {} {} as it is: another program has changed it since {} did{}",
                                      entry.kind, title, whose,
                                      entry.before && !entry.before->empty()
                                          ? "; before that it was " + *entry.before
                                          : ""));
          break;
        case Fate::out_of_reach:
          left.say(entry,
                   fmt::format("{} {} of {} is not visible here: its mount namespace has ended. Fix: if "
                               "it is on a disk, remove it there",
                               entry.kind, title, whose));
          break;
        case Fate::out_of_sight:
          throw Error(fmt::format("{} {} of another {} namespace, which is not visible here or was deleted",
                                  entry.kind, title,
                                  kind->scope == Scope::mount_namespace ? "mount" : "network"));
      }
      entry.done = true;
    } catch (const std::exception& error) {  // one that cannot be undone stops none of the others
      kept.insert({entry.kind, entry.where + entry.what});
      left.say(entry, fmt::format("{} {}", error.what(), by_hand(path)));
    }
  }
  return {.done = done.lines(), .left = left.lines()};
}

// Removes undone entries at its end, and an incomplete last line, which would spoil the next line. Returns
// the number of remaining entries.
std::size_t rewrite(int fd, const std::string& text, const Contents& contents) {
  const auto& entries = contents.entries;
  const auto last = std::find_if_not(entries.rbegin(), entries.rend(), std::mem_fn(&Entry::done));
  const auto remaining = static_cast<std::size_t>(std::distance(last, entries.rend()));
  std::string lines;
  for (std::size_t index = 0; index < remaining; ++index)
    if (entries[index].done) lines += line_of_done(index);
  try {
    cut(fd, remaining < entries.size() ? contents.begins[remaining] : text.rfind('\n') + 1);
  } catch (const Error&) {
    return entries.size();
  }
  try {
    append(fd, lines);
  } catch (const Error&) {  // the next one finds that there is nothing to do
  }
  return remaining;
}

}  // namespace

Reverted revert(int fd, const std::string& path, std::span<const Kind> more, const Wanted& wanted) {
  const auto text = text_of(fd);
  auto contents = parse(text);
  if (!contents.not_understood.empty())
    return {.done = {},
            .left = {fmt::format("this version of ontime cannot undo {} {}", contents.not_understood,
                                 by_hand(path))}};
  auto reverted = undo(contents, path, more, wanted);
  reverted.finished = std::ranges::all_of(contents.entries, &Entry::done);
  reverted.entries = contents.entries.empty() ? 0 : rewrite(fd, text, contents);
  return reverted;
}

void look_at(int fd, const std::string& path, std::span<const Kind> more, std::vector<Kept>& all) {
  const auto contents = parse(text_of(fd));
  if (!contents.not_understood.empty())
    throw Error(fmt::format("{}: this version of ontime does not know {}", path, contents.not_understood));
  if (of_another_boot(contents.header)) return;
  for (const auto& entry : contents.entries) {
    if (entry.done) continue;
    const auto known = std::ranges::find_if(all, [&](const Kept& one) { return is_of(one, entry); });
    const bool first = known == all.end();
    auto& one = first ? all.emplace_back() : *known;
    const auto before = first ? entry.before : one.before;
    one = {entry.kind, entry.where, entry.what, entry.what, before, entry.after, {}, ""};
    try {
      const auto* const kind = acceptable_kind(entry, more);
      if (kind == nullptr) throw Error("this version of ontime, or this user, cannot read it");
      one.title = kind->title_of(entry.what);
      const auto look = [&] { one.now = kind->read(entry.what); };
      if (entry.where == place(kind->scope)) {
        look();
      } else {
        const auto name = namespace_name(entry.where);
        if (!name) throw Error("its network namespace is not visible here");
        within_namespace(*name, look);
      }
    } catch (const std::exception& error) {
      one.unseen = error.what();
    }
  }
}

void revert_file(const Folder& folder, const std::string& name, const Folder::Opened& opened,
                 std::span<const Kind> more, Journal::GivenBack& all) {
  const auto path = folder.path() + '/' + name;
  Reverted one;
  if (opened.not_used.empty())
    one = revert(opened.fd.get(), path, more);
  else
    one.left.push_back(fmt::format("{} {}", path, opened.not_used));
  if (one.finished) folder.remove(name);
  all.finished = all.finished && one.finished;
  std::ranges::move(one.done, std::back_inserter(all.done));
  std::ranges::move(one.left, std::back_inserter(all.left));
}

Cleared clear(const Folder& folder, std::span<const Kind> more) {
  std::vector<std::pair<std::string, Folder::Opened>> abandoned;
  for (const auto& name : folder.journals()) {
    auto opened = folder.open(name);
    if (opened.alive) {
      const auto owner = parse(text_of(opened.fd.get())).header;
      return {{}, fmt::format("process {} ({})", owner.pid, in_quotes(owner.command))};
    }
    abandoned.emplace_back(name, std::move(opened));
  }
  Cleared all;
  for (const auto& [name, opened] : abandoned) revert_file(folder, name, opened, more, all.given_back);
  return all;
}

}  // namespace ontime::journal
