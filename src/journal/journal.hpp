// SPDX-License-Identifier: Apache-2.0
// Changes of this machine and how to undo them, in a file that outlives this process: after kill -9 the next
// ontime undoes them. Ordinary thread only.
#pragma once

#include <ctime>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <sys/types.h>

namespace ontime::journal {

struct Error : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// Of Kind::write(): another program made the thing just before, so it is not ontime's to remove.
struct MadeByAnother : Error {
  using Error::Error;
};

// The value of a thing, in the format of its kind; nullopt: the thing does not exist. For a thing that ontime
// makes it is an identity, which differs from that of a later thing of the same name.
using Value = std::optional<std::string>;
// The value to request for a thing whose identity is known only once it is made.
extern const std::string to_be_made;

// Where a thing is visible.
enum class Scope { machine, network_namespace, mount_namespace };

// A kind of change. A module that defines one provides reading and writing only; the journal does the rest.
// The functions throw Error with the reason if they fail.
struct Kind {
  const char* name;
  Scope scope;
  bool (*accepts)(const std::string& what);  // limits this kind, whatever a (forged) journal contains
  Value (*read)(const std::string& what);    // as the kernel reports it; comparable with a written value
  // `present` is the expected present value: a made thing is checked again before it is removed.
  void (*write)(const std::string& what, const Value& value, const Value& present);
  bool on_disk = false;  // it survives a reboot; else it is gone with the kernel
  // Only root acts on entries of this kind. Otherwise any program that writes a journal could make an ontime
  // with file capabilities use them.
  bool needs_root = true;
  std::string (*title)(const std::string& what) = nullptr;  // for people; nullptr: `what` itself

  std::string title_of(const std::string& what) const { return title == nullptr ? what : title(what); }
};

// The changes of one process: a file under /run/ontime (without root $XDG_RUNTIME_DIR/ontime, or
// /tmp/ontime-UID), locked as long as its owner lives. A locked journal holds the machine from its first
// change on: another ontime of this user in this mount namespace that wants to change something is refused,
// with the name of this process. A process that changes nothing is not affected. A forked child owns no
// journal, but keeps the lock until it ends or executes another program.
class Journal {
 public:
  // Kinds in addition to namespace and folder; they must outlive the journal.
  explicit Journal(std::span<const Kind> more = {});
  ~Journal();  // as revert()
  Journal(const Journal&) = delete;
  Journal& operator=(const Journal&) = delete;

  // Whom those that are refused are told: people know `ontime run`, not its keeper.
  struct Holder {
    pid_t pid;
    std::string command;
  };
  void held_for(Holder holder) { holder_ = std::move(holder); }

  // The command of another ontime that holds the machine now, for people; "": none, or not visible here.
  std::string other_holder() const;

  struct GivenBack {
    std::vector<std::string> done, left;  // for people, a line each
    bool finished = true;  // nothing remains to be restored: another program has changed what is left
  };
  // Takes the hold before the first change, to be refused early. First restores what ended processes left,
  // and returns the result. Waits some seconds for a holder that may be about to end. Throws Error that names
  // the holder.
  GivenBack hold();

  // Reads the value, writes it to the journal (synced), changes it and reads it back. Throws Error if that
  // fails or the value read back differs; then nothing is changed.
  void change(const Kind&, const std::string& what, const Value& wanted);

  // Undoes the changes of one thing, before all others. Returns a line for each that could not be undone;
  // these stay in the file.
  std::vector<std::string> take_back(const Kind&, const std::string& what);

  // Undoes everything, last change first, and releases the hold. Returns a line for each change that could
  // not be undone; these stay in the file, for revert_abandoned().
  std::vector<std::string> revert() noexcept;

  // Records the present value of a thing as if it had been set, so that kept() can compare it.
  void remember(const Kind&, const std::string& what);
  // Releases the hold and keeps all changes in effect: they do not count as abandoned; only revert_kept()
  // undoes them.
  void keep();
  // Undoes kept changes of any process, the latest first. As hold(), but it needs no journal of its own, for
  // which a full disk has no room. Not for a process that holds the machine.
  GivenBack revert_kept();

 private:
  struct File;
  std::span<const Kind> more_;
  std::optional<Holder> holder_;
  std::unique_ptr<File> file_;
};

// A kept change: the value before it, after it (the last time), and now.
struct Kept {
  std::string kind, where, what, title;  // `where` is only for comparison, `title` for people
  Value before, after, now;
  std::string unseen;  // why the present value is unknown; "": it is known
};
// Since boot, in the order of the first change. Throws Error if the journals cannot be read.
std::vector<Kept> kept(std::span<const Kind>);

// Undoes changes of ended processes: only those visible here, and only if the thing still has the value that
// they set. What another program has changed since is left as it is. A change that is not visible here, or
// not understood, stays in its journal. Returns a line for each change, undone or not; with Tell::once those
// not undone are reported only once. Does nothing while a living ontime holds the machine: that one did it
// before its first change. Cheap without journals; called at every start and end of a keeper.
enum class Tell { once, always };
std::vector<std::string> revert_abandoned(std::span<const Kind> more = {}, Tell = Tell::once);

// Prefix of everything that ontime makes; nothing else is ever removed.
constexpr const char* own_prefix = "ontime-";
// "ontime-…" of lower case letters, digits and hyphens: a single path component, so it cannot name anything
// else.
bool is_own_name(std::string_view name);
// Interface names that are safe in a path, in nft, in tc and in a shell. Linux permits more.
bool is_interface_name(std::string_view name);

// Calls `action` in a thread in that network namespace (as `ip netns` names it), with its interfaces under
// /sys; passes exceptions on. "": in this thread, without a change. Throws Error.
void within_namespace(const std::string& name, const std::function<void()>& action);

// Makes a network namespace for `ip netns`, removed with everything in it. `name` starts with own_prefix.
// Throws Error with the fix if one of that name already exists.
void add_namespace(Journal&, const std::string& name);
// A folder for this user alone under the temporary one, removed with its contents: "…/ontime-STEM-RANDOM".
std::string add_directory(Journal&, const std::string& stem);
// Removes it before the journal's end. Returns as take_back() does.
std::vector<std::string> remove_directory(Journal&, const std::string& path);
// Such folders last changed before this time. After a power cut they remain on the disk, while the journal,
// in memory, is lost. They are not removed automatically: only their name shows that they are ontime's. A
// folder that a journal names is not forgotten: the clock may have been set since. Throws Error as hold()
// does.
std::vector<std::string> forgotten_directories(std::time_t before);
std::time_t time_of_boot();  // 0: the kernel does not say

}  // namespace ontime::journal
