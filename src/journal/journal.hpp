// SPDX-License-Identifier: Apache-2.0
// What we changed of this machine and the way back, in a file that outlives us: kill -9 or a power cut leave
// it to the next ontime. Ordinary thread only.
#pragma once

#include <ctime>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

namespace ontime::journal {

struct Error : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// What a thing is set to, as its kind writes it; nothing: there is no such thing. Of a thing that was made
// it is its identity, by which it is told from a later one of the same name.
using Value = std::optional<std::string>;
// Asked for of a thing that has an identity only once it is made.
extern const std::string to_be_made;

// From where a thing can be seen.
enum class Scope { machine, network_namespace, mount_namespace };

// What can be changed of a machine. A room that brings one says how it is read and written, and no more; all
// else is done here, alike for all. The functions throw Error that says why they could not.
struct Kind {
  const char* name;
  Scope scope;
  bool (*accepts)(const std::string& what);  // what this kind may ever touch, whatever a journal says
  Value (*read)(const std::string& what);    // as the kernel says it; what is set can be compared with it
  // `present` is what it must still be: a thing that was made is looked at again before it is removed.
  void (*write)(const std::string& what, const Value& value, const Value& present);
  bool on_disk = false;  // it is as before after a reboot; else it is gone with the kernel
  // Only root acts on entries of this kind: a program whose file has capabilities could else be made to use
  // them by any program that writes its own journal.
  bool needs_root = true;
};

// One process's changes: a file under /run/ontime (without root $XDG_RUNTIME_DIR/ontime, or /tmp/ontime-UID
// where there is none), locked as long as its owner lives. A living journal is a hold of the machine: the
// first change takes it, and another ontime (of this user, in this mount namespace) that wants to change
// something meanwhile is refused with the name of this one; who changes nothing takes no notice of it. A
// forked child owns none of it, but keeps it alive until it ends or becomes another program.
class Journal {
 public:
  // Kinds beside our own two, the namespace and the folder; they must outlive it.
  explicit Journal(std::span<const Kind> more = {});
  ~Journal();  // as revert()
  Journal(const Journal&) = delete;
  Journal& operator=(const Journal&) = delete;

  struct GivenBack {
    std::vector<std::string> done, left;  // for people, a line each
    bool finished = true;  // nothing stays to be given back: what is left has another owner by now
  };
  // Before the first change, to be refused early: what others left is taken back first, and what came of that
  // is returned. Waits some seconds for a holder that may be about to end. Throws Error that names the
  // holder.
  GivenBack hold();

  // Read, write to the journal (it is on the disk then), change, read back. Throws Error if it cannot, or if
  // what is read back is not what was wanted, and then nothing is changed.
  void change(const Kind&, const std::string& what, const Value& wanted);

  // Takes back, before all others, what was changed of one thing. Returns what could not be, for people; it
  // stays in the file.
  std::vector<std::string> take_back(const Kind&, const std::string& what);

  // Takes everything back, last change first, and leaves the hold. Returns what could not be, for people; it
  // stays in the file, for revert_abandoned().
  std::vector<std::string> revert() noexcept;

  // What a thing is is written down as if it had been changed to that, for kept() to be compared with.
  void remember(const Kind&, const std::string& what);
  // Leaves the hold, and everything as it has been changed: no ontime takes that for abandoned, and only
  // revert_kept() gives it back.
  void keep();
  // Gives back what was kept, by whatever process, the latest first. Takes the hold before: what others left
  // is part of what it returns.
  GivenBack revert_kept();

 private:
  struct File;
  std::span<const Kind> more_;
  std::unique_ptr<File> file_;
};

// A thing that was kept as it had been changed, before it was and after (the last time), and as it is now.
struct Kept {
  std::string kind, where, what;  // `where` is to be compared only
  Value before, after, now;
  std::string unseen;  // why it cannot be said what it is now; "" where it can
};
// Since this machine was started, in the order of the first change. Throws Error if it cannot be looked up.
std::vector<Kept> kept(std::span<const Kind>);

// Takes back what processes that are gone left behind: only what can be seen from here, and only if it still
// is what they made of it. What another program has changed since is left; what cannot be seen from
// here, or is not understood, is kept. Returns what it did and what it did not, a line each for people; the
// latter only once, if so asked: every later start finds it again. Does nothing while a living ontime holds
// the machine: that one did it before its first change.
// Cheap when nothing is there; called at every start and end of a keeper.
enum class Tell { once, always };
std::vector<std::string> revert_abandoned(std::span<const Kind> more = {}, Tell = Tell::once);

// Names of our own making: only they can be made, and only they are ever removed.
constexpr const char* own_prefix = "ontime-";
// "ontime-…", of lower case letters, digits and hyphens: one component of a path, so that nothing else can
// ever be meant.
bool is_own_name(std::string_view name);
// What an interface may be called whose name goes into a path, to nft, to tc and into a shell, and is the
// same in all of them. Linux permits more.
bool is_interface_name(std::string_view name);

// Calls `action`, in a thread that is in the network namespace that `ip netns` knows by that name and sees
// its interfaces under /sys; what it throws is passed on. "": in this thread, where it is. Throws Error.
void within_namespace(const std::string& name, const std::function<void()>& action);

// A network namespace that `ip netns` knows, removed with all that is in it. `name` begins with own_prefix.
// Throws Error that says what to do when there is one of that name already.
void add_namespace(Journal&, const std::string& name);
// A folder for this user alone under the temporary one, removed with its contents: "…/ontime-STEM-RANDOM".
std::string add_directory(Journal&, const std::string& stem);
// Before the journal's end. Returns as take_back() does.
std::vector<std::string> remove_directory(Journal&, const std::string& path);
// Such folders that were last changed before this moment. A power cut leaves folders on a disk and takes the
// journal, which is in memory. Nothing removes them: only their name says whose they are. A folder that a
// journal names is not forgotten: the clock may have been set since. Throws Error as hold() does.
std::vector<std::string> forgotten_directories(std::time_t before);
std::time_t time_of_boot();  // 0: the kernel does not say

}  // namespace ontime::journal
