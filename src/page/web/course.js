// SPDX-License-Identifier: Apache-2.0
// A run's messages, as course.hpp packs them, and what of them lies between any two.
"use strict";

const LOST = 0xffff, KEPT_BITS = 11;
const ON_TIME = 0, LATE = 1;  // fates; 2 is lost

// Of a code the time that it stands for, in ns: the middle of those that have it.
function timeOf(code) {
  const shift = Math.max((code >> KEPT_BITS) - 1, 0);
  const least = (code - shift * (1 << KEPT_BITS)) * 2 ** shift;
  return least + (2 ** shift - 1) / 2;
}

async function inflated(base64) {
  const text = atob(base64), bytes = new Uint8Array(text.length);
  for (let i = 0; i < bytes.length; ++i) bytes[i] = text.charCodeAt(i);
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

// Numbers of seven bits a byte, the lowest first.
function* numbers(bytes) {
  let value = 0, place = 1;
  for (const byte of bytes) {
    value += (byte & 0x7f) * place;
    place *= 128;
    if (byte >= 0x80) continue;
    yield value;
    value = 0;
    place = 1;
  }
}

// What lies in a stretch of messages. Codes are compared, for they are in the order of their times; 0 of
// fastest: there is no answer.
class Extremes {
  constructor() {
    this.count = this.late = this.lost = 0;
    this.fastest = LOST;
    this.onTime = this.slowestLate = -1;  // the slowest of either kind
  }
  add(code, fate) {
    ++this.count;
    if (code === LOST) return void ++this.lost;
    if (code < this.fastest) this.fastest = code;
    if (fate === LATE) {
      ++this.late;
      if (code > this.slowestLate) this.slowestLate = code;
    } else if (code > this.onTime) {
      this.onTime = code;
    }
  }
  addAll(blocks, i) {
    this.count += blocks.count[i];
    this.late += blocks.late[i];
    this.lost += blocks.lost[i];
    if (blocks.fastest[i] < this.fastest) this.fastest = blocks.fastest[i];
    if (blocks.onTime[i] > this.onTime) this.onTime = blocks.onTime[i];
    if (blocks.slowestLate[i] > this.slowestLate) this.slowestLate = blocks.slowestLate[i];
  }
  get slowest() { return Math.max(this.onTime, this.slowestLate); }
}

// Extremes of so many messages each, for every block of them that is whole.
class Blocks {
  constructor(size, of, extremesOf) {
    this.size = size;
    const number = Math.floor(of / size);
    for (const name of ["count", "late", "lost"]) this[name] = new Uint32Array(number);
    for (const name of ["fastest", "onTime", "slowestLate"]) this[name] = new Int32Array(number);
    for (let i = 0; i < number; ++i) {
      const extremes = extremesOf(i * size, (i + 1) * size);
      for (const name of ["count", "late", "lost", "fastest", "onTime", "slowestLate"]) this[name][i] = extremes[name];
    }
  }
}

class Course {
  static async unpack(packed) {
    const planes = await Promise.all(["high", "low", "steps", "messages"].map(name => inflated(packed[name])));
    return new Course(packed, ...planes);
  }

  constructor(packed, high, low, steps, messages) {
    const count = this.count = packed.count;
    this.of = packed.of;
    this.code = new Uint16Array(count);
    this.at = new Float64Array(count);  // when each was due, in s
    this.message = new Float64Array(count);
    this.fate = new Uint8Array(count);
    for (let i = 0; i < count; ++i) this.code[i] = high[i] << 8 | low[i];
    let due = -packed.period_us, i = 0;
    for (const step of numbers(steps)) {
      due += packed.period_us + (step % 2 === 0 ? step / 2 : -(step + 1) / 2);
      this.at[i] = Math.max(due / 1e6, i > 0 ? this.at[i - 1] : 0);  // of a damaged file, time too goes on
      ++i;
    }
    let next = 0;
    i = 0;
    for (const word of numbers(messages)) {
      this.message[i] = next + Math.floor(word / 4);
      this.fate[i] = word % 4;
      next = this.message[i++] + 1;
    }
    this.blocks = [];
    for (const size of [64, 4096])
      this.blocks.unshift(new Blocks(size, count, (from, to) => this.extremes(from, to)));
  }

  get end() { return this.count > 0 ? this.at[this.count - 1] : 0; }

  // The first message due at a time or after it.
  indexAt(s) { return d3.bisectLeft(this.at, s); }

  // Of messages from <= i < to: exactly what going through them one by one would find.
  extremes(from, to) {
    const found = new Extremes();
    let i = from;
    next: while (i < to) {
      for (const blocks of this.blocks) {
        if (i % blocks.size !== 0 || i + blocks.size > to) continue;
        found.addAll(blocks, i / blocks.size);
        i += blocks.size;
        continue next;
      }
      found.add(this.code[i], this.fate[i]);
      ++i;
    }
    return found;
  }

  // Of the slowest answered message.
  slowestIndex() {
    const { slowest } = this.extremes(0, this.count);
    return slowest < 0 ? -1 : this.code.indexOf(slowest);
  }

  // The next that was late or lost, round the end.
  nextFault(after) {
    for (let n = 1; n <= this.count; ++n) {
      const i = (after + n) % this.count;
      if (this.fate[i] !== ON_TIME) return i;
    }
    return -1;
  }
}
