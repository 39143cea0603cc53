// SPDX-License-Identifier: Apache-2.0
// A message's way: its stages, our threads, its packets, and who had the CPUs. page/parts.hpp says what a drawing holds.
"use strict";

const BAR_LOOKS = ["other", "ours", "interrupt", "soft", "several", "ready", "runs", "stopped", "blocked", "queued", "travels",
  "dropped", "sleeps"];
const WHOSE = { controller: "ping", component: "pong" };
const LETTER = 6.4, STAGE = 22, HEADING = 20;
const LANE = { thread: 16, packet: 16, cpu: 22 };

class WayPlot {
  constructor(figure, drawing) {
    this.drawing = drawing;
    this.due = (drawing.marks.find(([name]) => name === "due") || ["", 0])[1];
    const height = this.arrange();
    this.frame = new Frame(figure, { height: height + 66, margin: { top: 32, right: 12, bottom: 34, left: 92 }, runs: [] });
    this.hatch = `hatch-${WayPlot.next = (WayPlot.next || 0) + 1}`;
    const patterns = this.frame.svg.insert("defs", ":first-child");
    for (const look of ["ready", "culprit"]) {
      const pattern = patterns.append("pattern").attr("id", `${this.hatch}-${look}`).attr("width", 6).attr("height", 6)
        .attr("patternUnits", "userSpaceOnUse").attr("patternTransform", "rotate(45)");
      pattern.append("rect").attr("class", `hatched ${look}`).attr("width", 6).attr("height", 6);
      pattern.append("path").attr("class", `hatch ${look}`).attr("d", "M0,0V6");
    }
    this.shown = this.frame.plot.append("g");
    this.names = this.frame.svg.append("g").attr("transform", `translate(${this.frame.margin.left},${this.frame.margin.top})`);
    this.frame.addReadout((px, py) => this.tell(px, py));
    if (drawing.uncertainty_ns > 0)
      d3.select(figure).append("p").attr("class", "note").text("The clocks of the two machines are aligned by the run’s answers: " +
        `times of pong’s machine may be off by ±${time(drawing.uncertainty_ns)}.`);
    const step = by => {
      const at = (this.place === undefined ? this.x(this.due) : this.place) + by * this.frame.width / 50;
      this.tell(this.place = Math.min(Math.max(at, 0), this.frame.width));
    };
    this.frame.onKeys("Left and right arrow keys go through its time; a table below has each part.",
      { ArrowLeft: () => step(-1), ArrowRight: () => step(1) });
    this.frame.onResize(() => this.draw());
  }

  // Where each lane lies; how high they are together.
  arrange() {
    let y = STAGE + 8, before = "";
    this.headings = [];
    for (const lane of this.drawing.lanes) {
      const heading = lane.of === "packet" ? "network" : lane.of === "cpu" && this.drawing.one_machine ? "machine" : lane.end;
      if (heading !== before) {
        const text = { network: "packets", machine: "CPUs of the machine" }[heading] ||
          (this.drawing.one_machine ? `${WHOSE[heading]}’s threads` : `${WHOSE[heading]}’s machine`);
        this.headings.push({ y: y + HEADING - 6, text });
        y += HEADING;
        before = heading;
      }
      lane.y = y;
      lane.height = LANE[lane.of];
      y += lane.height + 3;
    }
    return this.height = y;
  }

  draw() {
    const { frame, drawing, shown } = this;
    const x = this.x = d3.scaleLinear([0, drawing.span_ns], [0, frame.width]);
    const since = d3.scaleLinear([-this.due, drawing.span_ns - this.due], [0, frame.width]);
    frame.bottom.call(d3.axisBottom(since).ticks(Math.max(2, frame.width / 90)).tickFormat(signed).tickSizeOuter(0));
    shown.selectAll("*").remove();
    this.names.selectAll("*").remove();
    this.band();
    this.stages();
    for (const { y, text } of this.headings) this.names.append("text").attr("class", "heading").attr("x", -88).attr("y", y).text(text);
    for (const lane of drawing.lanes) this.lane(lane);
    this.marks();
    this.names.append("text").attr("class", "label").attr("text-anchor", "end").attr("x", frame.width).attr("y", frame.height + 31)
      .text("since it was due");
  }

  // Through all lanes, while the culprit held it up.
  band() {
    const held = [];
    for (const lane of this.drawing.lanes)
      for (const [from, to, look, , culprit] of lane.bars) if (culprit && lane.of !== "cpu") held.push([from, to, look]);
    if (held.length === 0) return;
    const from = this.x(d3.min(held, one => one[0])), to = this.x(d3.max(held, one => one[1]));
    this.shown.append("rect").attr("class", "band").attr("x", from).attr("width", Math.max(to - from, 1)).attr("height", this.height);
  }

  stages() {
    for (const [name, from, to, culprit] of this.drawing.stages) {
      const left = this.x(from), width = Math.max(this.x(to) - left, 1);
      const group = this.shown.append("g").attr("class", culprit ? "stage culprit" : "stage");
      group.append("rect").attr("x", left).attr("y", 0.5).attr("width", width).attr("height", STAGE - 1);
      this.inside(group, `${name} ${time(to - from)}`, left, width, 15) || this.inside(group, name, left, width, 15);
    }
    this.names.append("text").attr("class", "label").attr("text-anchor", "end").attr("x", -8).attr("y", 15).text("the message");
  }

  inside(group, text, left, width, y) {
    const visible = Math.min(left + width, this.frame.width) - Math.max(left, 0);
    if (text.length * LETTER + 6 > visible) return false;
    group.append("text").attr("class", "inside").attr("x", Math.max(left, 0) + 4).attr("y", y).text(text);
    return true;
  }

  lane(lane) {
    const { x, shown, drawing } = this;
    const label = lane.of === "thread" ? `${WHOSE[lane.end]} ${drawing.names[lane.name]}` : drawing.names[lane.name];
    this.names.append("text").attr("class", "label").attr("text-anchor", "end").attr("x", -8).attr("y", lane.y + lane.height - 4)
      .text(label.length > 14 ? `${label.slice(0, 13)}…` : label).append("title").text(label);
    shown.append("rect").attr("class", "lane").attr("y", lane.y).attr("width", this.frame.width).attr("height", lane.height);
    const group = shown.append("g").attr("transform", `translate(0,${lane.y})`);
    const drops = lane.bars.some(bar => BAR_LOOKS[bar[2]] === "dropped");  // whose names need the room
    for (const [from, to, look, name, culprit] of lane.bars) {
      const left = x(from), width = Math.max(x(to) - left, culprit ? 2 : 0.7), kind = BAR_LOOKS[look];
      const one = group.append("g").attr("class", `bar ${kind}${culprit ? " culprit" : ""}`);
      if (kind === "dropped") {
        one.append("path").attr("d", `M${left - 5},${lane.height / 2 - 5}l10,10m0,-10l-10,10`);
        const text = drawing.names[name], before = left + 12 + text.length * LETTER * 1.25 > this.frame.width;
        one.append("text").attr("class", "inside").attr("x", before ? left - 10 : left + 10).attr("y", lane.height - 4)
          .attr("text-anchor", before ? "end" : "start").text(text);
        continue;
      }
      const thin = lane.of === "cpu" && (kind === "interrupt" || kind === "soft") ? lane.height / 3 : lane.height;
      const rect = one.append("rect").attr("x", left).attr("width", width).attr("height", thin);
      if (lane.of === "thread" && (culprit || kind === "ready"))
        rect.attr("fill", `url(#${this.hatch}-${culprit ? "culprit" : "ready"})`);
      if (thin === lane.height && !drops) this.inside(one, `${drawing.names[name]} ${time(to - from)}`, left, width, lane.height - 4) ||
        this.inside(one, drawing.names[name], left, width, lane.height - 4);
    }
  }

  // The names of those that have room, the ends first.
  marks() {
    const { x, shown, names, drawing } = this, taken = [];
    const rank = name => ["deadline", "due", "back"].indexOf(name) >= 0 ? 0 : 1;
    for (const [name, at] of [...drawing.marks].sort((a, b) => rank(a[0]) - rank(b[0]))) {
      const middle = x(at), half = name.length * LETTER / 2 + 3;
      shown.append("line").attr("class", name === "deadline" ? "deadline" : "mark").attr("x1", middle).attr("x2", middle)
        .attr("y1", -6).attr("y2", this.height);
      const place = Math.min(Math.max(middle, half - 6), this.frame.width - half + 6);
      if (taken.some(([from, to]) => place - half < to && place + half > from)) continue;
      taken.push([place - half, place + half]);
      names.append("text").attr("class", name === "deadline" ? "label limit" : "label").attr("text-anchor", "middle")
        .attr("x", place).attr("y", -10).text(name);
    }
  }

  at(lane, ns) {
    const found = lane.bars.filter(([from, to]) => from <= ns && ns <= to);
    return found.length > 0 ? found[found.length - 1] : null;
  }

  tell(px, py) {
    const { drawing } = this, ns = this.x.invert(px), parts = [`${signed(ns - this.due)} after it was due`];
    this.frame.setCursor(px, this.height);
    for (const lane of drawing.lanes) {
      if (py !== undefined && (py < lane.y || py > lane.y + lane.height + 3)) continue;
      const bar = this.at(lane, ns), whose = drawing.one_machine && lane.of === "cpu" ? "" : `${WHOSE[lane.end]} `;
      const label = (lane.of === "packet" ? "" : whose) + drawing.names[lane.name];
      if (bar) parts.push(`${label}: ${drawing.names[bar[3]]}, ${time(bar[1] - bar[0])}${bar[4] ? ", the culprit’s" : ""}`);
      else if (py !== undefined) parts.push(`${label}: ${lane.of === "cpu" ? "idle or unknown" : lane.of === "thread" ? "sleeps" : "none"}`);
    }
    this.frame.readout.text(parts.join(" · "));
  }
}

const signed = ns => ns < 0 ? `−${time(-ns)}` : ns === 0 ? "0" : time(ns);

try {
  for (const figure of document.querySelectorAll("figure.way")) new WayPlot(figure, data.drawings[figure.dataset.drawing]);
} catch (error) {
  fail(error);
}
