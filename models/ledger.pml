// SPDX-License-Identifier: Apache-2.0
// The ledger of a round trip (src/roundtrip/ledger.cpp): one owner, two receivers, one watcher that expires
// messages. ledger.md has the laws. Each step names the function that it stands for; steps that one
// atomic instruction does are `atomic` here, and nothing else is.
//
// Time is one choice for each answer: its stamp is within the time-out or not. A message may expire at any
// moment after it was sent. That allows more orders than a clock would, so what holds here holds there.
//
// -DFAULT=N plants a fault that the checks must find (N from 1).
#ifndef FAULT
#define FAULT 0
#endif
#ifndef SLOTS
#define SLOTS 2
#define MESSAGES 3
#define ANSWERS 1  // copies of each answer at most
#endif
#ifndef INDEXES
#define INDEXES 4  // the index wraps around after so many messages; a multiple of SLOTS
#endif
#define NONE 255
#define slot_of(i) ((i) % SLOTS)
// The index as the wire and the slot's word have it. In the program both have 40 bits.
#if FAULT == 5
#define wire_of(i) ((i) % SLOTS)  // too few bits
#else
#define wire_of(i) ((i) % INDEXES)
#endif
#if FAULT == 6
#define word_of(i) (i)  // the word has more bits than the wire
#else
#define word_of(i) wire_of(i)
#endif

mtype = {vacant, in_flight, arriving, answered, lost, settled};

// The slot: `index` and `state` are one 64-bit word in the program.
byte index[SLOTS] = NONE;        // word_of() a message
mtype state[SLOTS] = vacant;
byte sample[SLOTS] = NONE;       // the owner's: which message it is
byte answer[SLOTS] = NONE;       // of the receiver that claimed the slot: which message it answers
byte next_belated[SLOTS] = NONE;
byte belated = NONE;             // head of the list of answers in time to messages given up

byte next = 0, oldest = 0;       // the owner's
byte copies[MESSAGES] = 0;       // answers under way; the network holds, doubles, drops and reorders them
#if MESSAGES > INDEXES
byte held[MESSAGES] = 0;         // answers that a receiver has in its hands
// The assumption: no answer is under way for so long that another message has its index.
#define index_is_free(i) ((i) < INDEXES || held[(i) - INDEXES] == 0)
#define free_index(i) if :: (i) >= INDEXES -> copies[(i) - INDEXES] = 0 :: else fi
#define take(m) held[m]++
#define leave(m) if :: m < MESSAGES -> held[m]-- :: else fi
#else
#define index_is_free(i) true
#define free_index(i) skip
#define take(m) skip
#define leave(m) skip
#endif
bool foreign = true;             // an answer of an earlier session: the client was started again

// The counters that people see, and what the laws are about.
byte sent = 0, given_up = 0, in_time = 0;
bool judged_answered[MESSAGES], judged_lost[MESSAGES];
bool owner_done = false;

// Ledger::judge: the fate of one message, its sample, its counter.
inline judge_answered(s) {
  assert(answer[s] == sample[s]);  // an answer is judged with its own message
  d_step { state[s] = settled; judged_answered[sample[s]] = true; judged_lost[sample[s]] = false };
  in_time++;
  assert(in_time + given_up <= sent)
}
inline judge_lost(s) {
  judged_lost[sample[s]] = true;
  given_up++;
  assert(in_time + given_up <= sent)
}

// Ledger::take_belated
inline take_belated() {
  d_step { entry = belated; belated = NONE }
  do
  :: entry == NONE -> break
  :: else ->
    following = next_belated[entry];
    if
    :: sample[entry] >= oldest -> state[entry] = answered  // given up, but not yet judged
    :: else ->
#if FAULT != 2
      given_up--;  // before its other fate, so that it never has two
#endif
      judge_answered(entry)
    fi;
    d_step { entry = following; following = NONE }
  od
}

// Ledger::expire, of the owner and of any thread
inline expire(i) {
  atomic {
    if
    :: index[slot_of(i)] == word_of(i) && state[slot_of(i)] == in_flight -> state[slot_of(i)] = lost
    :: else
    fi
  }
}

// Ledger::settle
inline settle() {
  if :: belated != NONE -> take_belated() :: else fi;
  do
  :: oldest == next -> break
  :: else ->
    if :: expire(oldest) :: skip fi;  // its time-out has passed, or has not
    if  // the word, read once
    :: index[slot_of(oldest)] == word_of(oldest) && state[slot_of(oldest)] == answered -> judge_answered(slot_of(oldest)); oldest++
    :: index[slot_of(oldest)] == word_of(oldest) && state[slot_of(oldest)] == lost -> judge_lost(slot_of(oldest)); oldest++
    :: else -> break
    fi
  od
}

active proctype owner() {
  byte entry = NONE, following = NONE;
  bool may_post;
  do
  :: next == MESSAGES && oldest == next -> break
  :: else ->
    settle();
    if
    :: next < MESSAGES && next - oldest < SLOTS ->
      // Ledger::claim
      atomic {
        may_post = false;
        free_index(next);
        if
        :: !index_is_free(next) -> skip
        :: else ->
        if
        :: state[slot_of(next)] == arriving ->
#if FAULT == 1
          may_post = true
#else
          skip
#endif
        :: state[slot_of(next)] == lost -> index[slot_of(next)] = word_of(next); state[slot_of(next)] = vacant; may_post = true
        :: else -> may_post = true
        fi
        fi
      }
      if
      :: may_post ->
        // Ledger::post, and Client::Measurement::post, which sends
        sample[slot_of(next)] = next;
        sent++;
        atomic { index[slot_of(next)] = word_of(next); state[slot_of(next)] = in_flight; }
        atomic {
          if  // the network: nothing arrives, one answer, or several
          :: copies[next] = 0
          :: copies[next] = 1
          :: copies[next] = ANSWERS
          fi;
          next++
        }
      :: else
      fi
    :: else
    fi
  od;
  owner_done = true
}

// Ledger::arrived, and before it Client::Measurement::arrived, which tells sessions apart.
active [2] proctype receiver() {
  byte i, whose, found_index;
  mtype found_state;
  bool counts, mine;
  do
  :: owner_done -> break
  :: atomic {  // any answer that is under way, in any order
      if
      :: copies[0] > 0 -> whose = 0
      :: MESSAGES > 1 && copies[1] > 0 -> whose = 1
      :: MESSAGES > 2 && copies[2] > 0 -> whose = 2
      :: foreign -> foreign = false; whose = NONE - 1;
#if FAULT != 4
        goto taken  // a stray: its session is not this one
#endif
      fi;
      if :: whose < MESSAGES -> copies[whose]--; take(whose); i = wire_of(whose) :: else -> i = 0 fi;
      if :: counts = true :: counts = false fi
    }
    d_step { found_index = index[slot_of(i)]; found_state = state[slot_of(i)] }
    atomic {  // the first compare-and-swap; what it finds otherwise is looked at again
      mine = false;
      if
      :: found_index == i && found_state == in_flight ->
        if
        :: index[slot_of(i)] == i && state[slot_of(i)] == in_flight ->
          if :: counts -> state[slot_of(i)] = arriving; mine = true :: else -> state[slot_of(i)] = lost; goto taken fi
        :: else -> found_index = index[slot_of(i)]; found_state = state[slot_of(i)]
        fi
      :: else
      fi;
      assert(mine || !counts || sample[slot_of(i)] != whose || state[slot_of(i)] != in_flight);
      if :: !counts -> goto taken :: else fi
    }
    if
    :: mine ->
      answer[slot_of(i)] = whose;
      state[slot_of(i)] = answered
    :: !mine && found_index == i && found_state == lost ->
      atomic {  // the second: an answer in time to a message that was given up
        if
        :: index[slot_of(i)] == i && state[slot_of(i)] == lost -> state[slot_of(i)] = arriving
        :: else -> goto taken
        fi
      }
      answer[slot_of(i)] = whose;
      // Ledger::hand_in
#if FAULT == 3
      next_belated[slot_of(i)] = belated;
      belated = slot_of(i)
#else
      d_step { next_belated[slot_of(i)] = belated; belated = slot_of(i) }
#endif
    :: else  // a duplicate or a stray: it changes no slot
    fi;
taken:
    leave(whose);
    d_step { i = 0; whose = 0; found_index = 0; found_state = 0; counts = false; mine = false }
  od
}

// Client's watching thread (back-to-back), which gives up what is beyond its time-out.
active proctype watcher() {
  do
  :: owner_done -> break
  :: atomic { next > 0 -> expire(next - 1) }
  od
}

// The laws at the end; those of every moment stand where the counters change.
active proctype laws() {
  byte m;
  owner_done;
  assert(in_time + given_up == sent);          // the ledger adds up
  assert(sent == MESSAGES);
  for (m : 0 .. MESSAGES - 1) {
    assert(judged_answered[m] != judged_lost[m])  // exactly one fate each
  }
}
