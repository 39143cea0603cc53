// SPDX-License-Identifier: Apache-2.0
// The journal (src/journal): two instances of ontime, two things of a machine, crashes at every step, a disk
// that may be full, a user who changes a value. journal.md has the laws.
//
// Values: 0 is what the user had, 1 and 2 are ours, 3 is what the user sets meanwhile.
// Reading a thing and writing it back is one step here; the kernel has no such step, and the program cannot
// see a user's change in the microseconds between the two. That is the one assumption.
//
// -DFAULT=N plants a fault that the checks must find (N from 1).
#ifndef FAULT
#define FAULT 0
#endif
#define THINGS 2
#define ENTRIES 3

// The machine.
byte value[THINGS] = 0;
bool users[THINGS] = false;       // the user has changed it: from then on it is the user's
// The journal file: entries that are on the disk. It outlives its writer.
bool exists = false;
byte used = 0;
byte what[ENTRIES], before[ENTRIES], after[ENTRIES];
bool done[ENTRIES];
bool locked = false;              // by a living owner; the kernel unlocks it when that one is gone
bool reported[THINGS] = false;    // what people were told is left
byte crashes = 0;
byte alive = 2;
bool disk_full = false;                // the disk takes nothing more

// A crash is a jump to the end of the process, at any step: the kernel gives the lock back, and nothing else happens.
#define may_crash if :: atomic { crashes < 2 -> crashes++; goto dead } :: true fi

// journal::revert: undo(), entry by entry, the last first. The caller has the lock.
inline revert_all() {
  e = used;
  barred[0] = false; barred[1] = false;
  do
  :: e == 0 -> break
  :: else ->
    e--;
    if
    :: done[e] || barred[what[e]]
    :: else ->
      may_crash;
      atomic {
        if
        :: value[what[e]] == after[e] && !users[what[e]] ->  // undo_from: it is ours
#if FAULT == 4
          skip  // forgets to write
#else
          if
          :: value[what[e]] = before[e]
          :: reported[what[e]] = true; barred[what[e]] = true  // the kernel refuses: told, and the entry stays
          fi
#endif
        :: value[what[e]] == before[e] && !users[what[e]]     // nothing_there
        :: else ->                                            // not_ours
#if FAULT == 1
          value[what[e]] = before[e]
#else
          reported[what[e]] = true
#endif
        fi
      }
      may_crash;
      if :: !barred[what[e]] -> done[e] = true :: else fi
    fi
  od;
  may_crash;
  atomic {  // rewrite() and Folder::remove: an empty journal goes
    if
    :: !barred[0] && !barred[1] -> exists = false; used = 0; done[0] = false; done[1] = false; done[2] = false
    :: else
    fi
  }
}

// Journal::change: read, write to the journal, change, read back.
inline change(thing, wanted) {
  was = value[thing];
  may_crash;
#if FAULT == 2
  value[thing] = wanted;  // changes first, and writes afterwards
  may_crash;
#endif
  if
  :: disk_full -> skip  // append() throws: nothing is changed
  :: else ->
    atomic { what[used] = thing; before[used] = was; after[used] = wanted; done[used] = false; used++ }
    may_crash;
    atomic {
      if
      :: users[thing] || value[thing] != was  // another program was quicker: what is read back is not what was wanted
      :: else -> value[thing] = wanted
      fi
    }
    may_crash
  fi
}

// An instance of ontime: hold (which first clears what others left), change, run, revert.
active [2] proctype instance() {
  byte e, was;
  bool barred[THINGS], mine = false;
  // Journal::hold, under the folder's lock
  atomic {
    if
    :: locked ->
#if FAULT == 3
      skip
#else
      goto refused
#endif
    :: else -> locked = true
    fi;
    mine = true
  }
  if :: exists -> revert_all() :: else fi;  // clear(): revert_abandoned
  if
  :: exists -> goto given_up  // what is left is told; nothing more is stacked on it in this model
  :: else
  fi;
  exists = true;
  change(0, 1);
  change(1, 1);
  change(0, 2);
  revert_all();  // Journal::revert, at the end and on any signal
given_up:
  locked = false;
  goto ended;
dead:
  if :: mine -> locked = false :: else fi;
  goto ended;
refused:
ended:
  alive--
}

// The user sets a thing, once, at any moment; and the disk may fill up at any moment.
active proctype user() {
  if :: atomic { value[0] = 3; users[0] = true } :: true fi;
  if :: disk_full = true :: true fi
}

// The next start, after all that: a keeper's begin, or `ontime tune revert`.
active proctype next_start() {
  byte e, t;
  bool barred[THINGS];
  alive == 0;
  crashes = 2;  // this one lives to its end
  if :: exists -> revert_all() :: else fi;
dead:
  // Whatever was changed is as it was, or is the user's, or was reported.
  for (t : 0 .. THINGS - 1) {
    assert(value[t] == 0 || (users[t] && value[t] == 3) || reported[t]);
    assert(!users[t] || value[t] == 3)  // what the user set is never undone
  }
}
