// SPDX-License-Identifier: Apache-2.0
#include "journal/revert.hpp"

#include <algorithm>
#include <set>
#include <utility>

#include <fmt/format.h>

#include "journal/format.hpp"
#include "journal/kinds.hpp"
#include "journal/place.hpp"

namespace ontime::journal {
namespace {

enum class Fate {
  undone,
  nothing_there,   // it was never made, somebody was quicker, or a reboot took it
  somebody_elses,  // somebody has made something else of it since
  out_of_sight,    // which is not the same as not being there
};

bool is_ours(const Entry& entry, const Value& now) {
  return entry.after == to_be_made ? now.has_value() : now == entry.after;
}

Fate undo(const Entry& entry, const Kind& kind, const Header& header) {
  const bool rebooted = header.boot != boot_id();
  if (rebooted && !kind.on_disk) return Fate::nothing_there;
  const bool same_place = rebooted || entry.where == place(kind.scope);
  // The same name elsewhere is another thing; but an identity is the same from everywhere.
  if (!same_place && kind.scope != Scope::mount_namespace) return Fate::out_of_sight;
  const auto now = kind.read(entry.what);
  if (is_ours(entry, now) && (same_place || now)) {
    kind.write(entry.what, entry.before, entry.after);
    if (kind.read(entry.what) == entry.before) return Fate::undone;
    throw Error(fmt::format("{} {} cannot be brought back to what it was", kind.name, entry.what));
  }
  if (!same_place) return Fate::out_of_sight;
  return now == entry.before ? Fate::nothing_there : Fate::somebody_elses;
}

const Kind* acceptable_kind(const Entry& entry, std::span<const Kind> more) {
  const auto* const kind = find_kind(entry.kind, more);
  if (kind == nullptr || !kind->accepts(entry.what) || (kind->needs_root && geteuid() != 0)) return nullptr;
  return kind;
}

// One change of several of the same thing is told once: as it ended.
class Told {
 public:
  void say(const Entry& entry, std::string line) {
    const auto known = std::find_if(things_.begin(), things_.end(), [&](const auto& thing) {
      return thing.kind == entry.kind && thing.what == entry.what;
    });
    if (known == things_.end())
      things_.push_back({entry.kind, entry.what, std::move(line)});
    else
      known->line = std::move(line);
  }
  std::vector<std::string> lines() const {
    std::vector<std::string> lines;
    for (const auto& thing : things_) lines.push_back(thing.line);
    return lines;
  }

 private:
  struct Thing {
    std::string kind, what, line;
  };
  std::vector<Thing> things_;
};

std::string line_of_undone(const Entry& entry, const Header& header) {
  const auto whose = fmt::format("left by process {} ({})", header.pid, header.command);
  if (!entry.before) return fmt::format("removed {} {}, {}", entry.kind, entry.what, whose);
  return fmt::format("set {} {} back to {}, {}", entry.kind, entry.what, *entry.before, whose);
}

// An end that was never written is cut off: what follows it would be lost with it.
void mark_done(int fd, const std::string& text, const std::vector<std::size_t>& entries) {
  const auto whole = text.rfind('\n') + 1;
  if (whole < text.size() && ftruncate(fd, static_cast<off_t>(whole)) != 0) return;
  std::string lines;
  for (const auto index : entries) lines += line_of_done(index);
  try {
    append(fd, lines);
  } catch (const Error&) {  // the next one will find that there is nothing to do
  }
}

}  // namespace

Reverted revert(const Folder& folder, const std::string& name, int fd, std::span<const Kind> more) {
  const auto path = folder.path() + '/' + name;
  const auto by_hand = fmt::format("(from {}: remove this file when it has been undone by hand)", path);
  const auto text = text_of(fd);
  const auto contents = parse(text);
  if (!contents.not_understood.empty())
    return {{},
            {fmt::format("{} is nothing that this version of ontime knows how to undo {}",
                         contents.not_understood, by_hand)},
            {}};
  Told done, left;
  std::vector<std::size_t> settled;
  std::set<std::pair<std::string, std::string>> kept;
  for (auto index = contents.entries.size(); index-- > 0;) {
    const auto& entry = contents.entries[index];
    if (entry.done) continue;
    const auto* const kind = acceptable_kind(entry, more);
    // Of several changes of one thing, none is taken back before those after it are.
    if (kept.contains({entry.kind, entry.what})) continue;
    try {
      if (kind == nullptr)
        throw Error(fmt::format("{} is nothing that this version of ontime, or this user, may undo",
                                quoted(entry.kind + ' ' + entry.what)));
      switch (undo(entry, *kind, contents.header)) {
        case Fate::undone:
          done.say(entry, line_of_undone(entry, contents.header));
          break;
        case Fate::nothing_there:
          break;
        case Fate::somebody_elses:
          left.say(entry,
                   fmt::format("left {} {} as it is: somebody has changed it since process {} ({}) did",
                               entry.kind, entry.what, contents.header.pid, contents.header.command));
          break;
        case Fate::out_of_sight:
          throw Error(fmt::format("{} {}, of another {} namespace, is not to be seen from here", entry.kind,
                                  entry.what, kind->scope == Scope::mount_namespace ? "mount" : "network"));
      }
      settled.push_back(index);
    } catch (const Error& error) {
      kept.insert({entry.kind, entry.what});
      left.say(entry, fmt::format("{} {}", error.what(), by_hand));
    }
  }
  if (kept.empty())
    folder.remove(name);
  else if (!settled.empty())
    mark_done(fd, text, settled);
  return {done.lines(), left.lines(), {}};
}

Reverted revert_all(const Folder& folder, std::span<const Kind> more) {
  struct Abandoned {
    std::string name;
    Fd fd;
  };
  Reverted all;
  std::vector<Abandoned> abandoned;
  for (const auto& name : folder.journals()) {
    auto opened = folder.open(name);
    if (opened.alive) {
      const auto owner = parse(text_of(opened.fd.get())).header;
      return {{}, {}, fmt::format("process {} ({})", owner.pid, owner.command)};
    }
    if (opened.not_believed.empty())
      abandoned.push_back({name, std::move(opened.fd)});
    else
      all.left.push_back(
          fmt::format("{}/{} is not believed, as {}: remove it", folder.path(), name, opened.not_believed));
  }
  for (const auto& [name, fd] : abandoned) {
    auto one = revert(folder, name, fd.get(), more);
    all.done.insert(all.done.end(), one.done.begin(), one.done.end());
    all.left.insert(all.left.end(), one.left.begin(), one.left.end());
  }
  return all;
}

}  // namespace ontime::journal
