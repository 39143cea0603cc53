// SPDX-License-Identifier: Apache-2.0
// Round trip over time: every message, or, where there are more than pixels, of each column its extremes.
"use strict";

const DOT = 3;  // px: as wide as one is in page.css

class TimePlot {
  constructor(figure, run, course, yDomain) {
    Object.assign(this, { run, course, yDomain, logarithmic: true });
    this.frame = new Frame(figure, { height: 230, margin: { top: 24, right: 12, bottom: 36, left: 56 }, runs: [run],
      key: () => this.key() });
    this.frame.labels("time since the start", quantityOf([run]));
    this.frame.name = `${run.label}: ${quantityOf([run])} over time`;
    this.end = Math.max(course.end, 1e-6);
    // A few messages due long after all others would leave these too little room.
    const { beyond, slice_ns, medians } = run.slices;
    this.first = beyond > 0 ? medians.length * slice_ns / 1e9 : this.end;
    this.domain = [0, this.first];
    const { plot } = this.frame;
    this.layers = {};
    for (const name of ["deadline", "columns", "alone", "late", "lost", "median", "stall"])
      this.layers[name] = plot.append("path").attr("class", name);
    this.notes = plot.append("g").attr("class", "notes");
    this.frame.addReadout(px => this.point(px));
    this.frame.svg.attr("aria-label", `${run.quantity} over time of ${run.id} ${run.label}`);
    const pan = by => this.frame.area.call(this.zoom.translateBy, by * this.frame.width / d3.zoomTransform(this.frame.area.node()).k, 0);
    this.frame.onKeys("Left and right arrow keys read its values, with Shift or Page up and down they move along, plus and minus zoom, " +
      "Home shows all.", {
      ArrowLeft: event => event.shiftKey ? pan(1 / 8) : this.step(-1), ArrowRight: event => event.shiftKey ? pan(-1 / 8) : this.step(1),
      PageUp: () => pan(1 / 2), PageDown: () => pan(-1 / 2), Home: () => this.show(0, this.end),
      "+": () => this.scaleAtCursor(2), "=": () => this.scaleAtCursor(2), "-": () => this.scaleAtCursor(0.5),
    });
    this.zoom = d3.zoom()
      .filter(() => !d3.event.button && (d3.event.type !== "wheel" || d3.event.ctrlKey || this.frame.svg.node() === document.activeElement))
      .on("zoom", () => this.zoomed(d3.event.transform));
    this.frame.area.call(this.zoom);
    const note = text => d3.select(figure).append("p").attr("class", "note").text(text);
    if (beyond > 0) note(`Messages due long after the others: ${number(beyond)}. To see them, zoom out.`);
    if (course.of > 1)
      note(`Too many messages for a page: of each ${number(2 * course.of)}, only the fastest, the slowest and one lost message are shown.`);
    this.buttons();
    this.frame.onResize(() => this.resize());
  }

  buttons() {
    const add = (text, title, action) => this.frame.tools.insert("button", ".save").attr("type", "button").attr("title", title)
      .attr("data-does", title).text(text).on("click", action);
    add("−", "zoom out", () => this.scale(1 / 3));
    add("+", "zoom in", () => this.scale(3));
    add("all", "show all", () => this.show(0, this.end));
    if (this.run.round_trip) add("slowest", "show the slowest message", () => this.showMessage(this.course.slowestIndex()));
    if (this.run.lost + this.run.late > 0) {
      let last = -1;
      add("next fault", "show the next late or lost message", () => {
        last = this.course.nextFault(last);
        this.showMessage(last);
      });
    }
    add("linear", "linear or logarithmic times", () => {
      this.logarithmic = !this.logarithmic;
      this.frame.tools.select("[data-does^=linear]").text(this.logarithmic ? "linear" : "log");
      this.draw();
    });
  }

  resize() {
    const { width, height } = this.frame;
    // Down to a hundred messages of the closest, however long it was.
    const closest = this.first / Math.max(this.course.count, 1) * 5;
    this.zoom.extent([[0, 0], [width, height]]).translateExtent([[0, 0], [width, height]])
      .scaleExtent([1, Math.max(this.end / closest, 1)]);
    this.base = d3.scaleLinear([0, this.end], [0, width]);
    this.show(...this.domain);
    this.draw();
  }

  zoomed(transform) {
    this.domain = transform.rescaleX(this.base).domain();
    if (this.drawing) return;
    this.drawing = requestAnimationFrame(() => { this.drawing = 0; this.draw(); });
  }

  // From these seconds to those.
  show(from, to) {
    const k = Math.min(this.end / Math.max(to - from, 1e-9), this.zoom.scaleExtent()[1]);
    this.frame.area.call(this.zoom.transform, d3.zoomIdentity.scale(k).translate(-this.base(Math.max(from, 0)), 0));
  }

  scale(by) { this.frame.area.call(this.zoom.scaleBy, by); }

  showMessage(i) {
    if (i < 0) return;
    const half = 12 * this.first / this.course.count;
    this.show(this.course.at[i] - half, this.course.at[i] + half);
    this.draw();
    this.tell(i);
  }

  isReadAtShown() { return this.readAt >= this.domain[0] && this.readAt <= this.domain[1]; }

  // What is read: of the messages that are shown one by one the next, else the next column of pixels.
  step(by) {
    const { course, frame } = this, [from, to] = this.domain;
    if (course.count === 0) return;
    const inside = this.isReadAtShown(), at = inside ? this.readAt : (from + to) / 2;
    if (!this.dots) return this.point(Math.min(Math.max(Math.floor(this.x(at)) + by, 0), frame.width - 1) + 0.5);
    const next = inside ? this.nearest(at) + by : this.nearest(at), i = Math.min(Math.max(next, 0), course.count - 1);
    const beyond = course.at[i] < from ? course.at[i] - from : course.at[i] > to ? course.at[i] - to : 0;
    if (beyond !== 0) {
      this.show(from + beyond * 2, to + beyond * 2);
      this.draw();
    }
    this.tell(i);
  }

  scaleAtCursor(by) {
    this.frame.area.call(this.zoom.scaleBy, by, [this.isReadAtShown() ? this.x(this.readAt) : this.frame.width / 2, 0]);
  }

  key() {
    const { run, layers } = this, is = name => layers[name].attr("d");
    return [{ className: this.dots ? "columns dots" : "columns key", d: this.dots ? "M11,0h0" : null,
      text: this.dots ? "a message" : "from the fastest to the slowest message" },
    ...(is("median") ? [{ className: "median", text: "median" }] : []),
    ...(run.late > 0 ? [{ className: "late", d: "M11,0h0", text: "late" }] : []),
    ...(run.lost > 0 ? [{ className: "lost", d: "M8,-3l6,6m0,-6l-6,6", text: "lost" }] : []),
    ...(is("stall") ? [{ className: "stall", text: "longest wait of cycles without a message" }] : []),
    ...(run.deadline_ns ? [{ className: "deadline", text: `deadline ${time(run.deadline_ns)}` }] : []),
    ...(run.notes.length > 0 ? [{ className: "flag", d: "M6,-6h10l-5,7z", text: "note" }] : [])];
  }

  draw() {
    const { frame, course, run } = this;
    if (!(frame.width > 0)) return;
    const x = this.x = d3.scaleLinear(this.domain, [0, frame.width]);
    const y = this.y = (this.logarithmic ? d3.scaleLog() : d3.scaleLinear())
      .domain(this.logarithmic ? this.yDomain : [0, this.yDomain[1]]).range([frame.height, 0]).clamp(true);
    const [unit, seconds] = this.domain[1] - this.domain[0] > 3 * 3600 ? ["h", 3600] : this.domain[1] - this.domain[0] > 600 ? ["min", 60] : ["s", 1];
    const units = d3.scaleLinear(this.domain.map(s => s / seconds), [0, frame.width]);
    frame.axes(d3.axisBottom(units).ticks(Math.max(2, frame.width / 90)).tickFormat(value => `${+value.toPrecision(12)} ${unit}`),
      timeAxis(y, this.logarithmic, 5));
    frame.place();
    this.layers.deadline.attr("d", run.deadline_ns ? `M0,${y(run.deadline_ns)}H${frame.width}` : null);
    const from = Math.max(course.indexAt(this.domain[0]) - 1, 0);
    const to = Math.min(course.indexAt(this.domain[1]) + 1, course.count);
    this.dots = to - from <= frame.width;
    const paths = this.dots ? this.single(from, to) : this.columns(from);
    for (const name of ["columns", "alone", "late", "lost"]) this.layers[name].attr("d", paths[name].join(""));
    this.layers.columns.classed("dots", this.dots);
    frame.svg.attr("data-shown", to - from).attr("data-mode", this.dots ? "messages" : "columns");
    this.drawSlices();
    this.drawNotes();
  }

  single(from, to) {
    const { x, y, course } = this, columns = [], late = [], lost = [];
    for (let i = from; i < to; ++i) {
      const at = x(course.at[i]).toFixed(1);
      if (course.code[i] === LOST) lost.push(cross(at));
      else (course.fate[i] === LATE ? late : columns).push(`M${at},${y(timeOf(course.code[i])).toFixed(1)}h0`);
    }
    return { columns, alone: [], late, lost };
  }

  // What is no higher than a dot is one: a line of a pixel cannot be seen.
  columns(from) {
    const { x, y, course, frame } = this, columns = [], alone = [], late = [], lost = [];
    for (let column = 0, i = from; column < frame.width; ++column) {
      const next = course.indexAt(x.invert(column + 1));
      const found = course.extremes(i, next), middle = column + 0.5;
      i = next;
      if (found.count === 0) continue;
      if (found.onTime >= 0) {
        const low = y(timeOf(found.fastest)), high = y(timeOf(found.onTime));
        if (low - high < DOT) alone.push(`M${middle},${((low + high) / 2).toFixed(1)}h0`);
        else columns.push(`M${middle},${(low + 0.5).toFixed(1)}V${(high - 0.5).toFixed(1)}`);
      }
      if (found.late > 0) late.push(`M${middle},${y(timeOf(found.slowestLate)).toFixed(1)}h0`);
      if (found.late > 0 && found.onTime < 0) late.push(`M${middle},${y(timeOf(found.fastest)).toFixed(1)}h0`);
      if (found.lost > 0) lost.push(cross(middle));
    }
    return { columns, alone, late, lost };
  }

  drawSlices() {
    const { x, y, course } = this, { slice_ns, medians, stalls } = this.run.slices;
    const slice_s = slice_ns / 1e9, wide = x(slice_s) - x(0);
    const line = d3.line().defined(value => value !== null).x((_, i) => x((i + 0.5) * slice_s)).y(value => y(value));
    // Of a handful of messages a median says no more than they do.
    const few = course.count * course.of < 10 * medians.length || medians.length < 3;
    this.layers.median.attr("d", this.dots || wide > 60 || few ? null : line(medians));
    this.layers.stall.attr("d", stalls.map(([i, , ns]) =>
      `M${(x((i + 0.5) * slice_s) - Math.max(wide / 2, 3)).toFixed(1)},${y(ns).toFixed(1)}h${Math.max(wide, 6).toFixed(1)}`).join(""));
  }

  drawNotes() {
    const { x, frame } = this, inside = this.run.notes.filter(note => note.at_s >= this.domain[0] && note.at_s <= this.domain[1]);
    const marks = this.notes.selectAll("g").data(inside.slice(0, 200));
    marks.exit().remove();
    const entered = marks.enter().append("g");
    entered.append("line");
    entered.append("path").attr("d", "M-5,-12h10l-5,7z");
    entered.append("title");
    const all = entered.merge(marks).attr("transform", note => `translate(${x(note.at_s)},0)`);
    all.select("line").attr("y1", -5).attr("y2", frame.height);
    all.select("title").text(note => `${note.at_s.toFixed(1)} s: ${note.text}`);
  }

  point(px) {
    const { x, course } = this;
    if (course.count === 0) return;
    const s = x.invert(px);
    if (this.dots) return this.tell(this.nearest(s));
    this.frame.setCursor(px);
    this.readAt = s;
    const left = x.invert(Math.floor(px)), right = x.invert(Math.floor(px) + 1);
    const found = course.extremes(course.indexAt(left), course.indexAt(right));
    // Of a long run two or three of so many messages are here: the fastest, the slowest, one that was lost.
    const about = course.of > 1 ? "about " : "", least = course.of > 1 ? "at least " : "";
    const parts = [`${left.toPrecision(5)} s`, `${about}${number(found.count * course.of)} messages`];
    if (found.slowest >= 0) parts.push(`${time(timeOf(found.fastest))} to ${time(timeOf(found.slowest))}`);
    if (found.late > 0) parts.push(`${least}${number(found.late)} late`);
    if (found.lost > 0) parts.push(`${least}${number(found.lost)} lost`);
    this.frame.readout.text(parts.join(" · "));
  }

  nearest(s) {
    const { course } = this, i = Math.min(course.indexAt(s), course.count - 1);
    return i > 0 && s - course.at[i - 1] < course.at[i] - s ? i - 1 : i;
  }

  tell(i) {
    const { course, x } = this, code = course.code[i];
    this.readAt = course.at[i];
    this.frame.setCursor(x(course.at[i]));
    this.frame.readout.text([`${course.at[i].toFixed(3)} s`, `message ${course.message[i]}`,
      code === LOST ? "lost" : time(timeOf(code)), ...(course.fate[i] === LATE ? ["late"] : [])].join(" · "));
  }
}

const cross = at => `M${at - 3},-9l6,6m0,-6l-6,6`;

// Each run's plot, the times of all on one scale, so that the eye may compare.
async function drawTimePlots(runs) {
  const least = d3.min(runs, run => run.round_trip && run.round_trip.min) || 1e3;
  const greatest = Math.max(d3.max(runs, run => run.response && run.response.max) || 1e6,
    d3.max(runs, run => run.deadline_ns) || 0);
  const yDomain = [Math.max(least, 1) * 0.8, greatest * 1.25];
  const figures = [...document.querySelectorAll("figure.time")], runOf = figure => runs[figure.dataset.figureOf];
  // All of them first: the browser would lay out and paint the page between two figures.
  const courses = await Promise.all(figures.map(figure => Course.unpack(runOf(figure).course)));
  for (const run of runs) run.course = null;  // the packed one is not needed any more
  return figures.map((figure, i) => new TimePlot(figure, runOf(figure), courses[i], yDomain));
}

const timePlots = drawTimePlots(data.runs);
timePlots.then(() => {
  document.documentElement.dataset.ready = "yes";
}, error => fail(error));
