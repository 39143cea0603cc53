// SPDX-License-Identifier: Apache-2.0
// Figures of distributions, payloads and layers, and what all figures have in common.
"use strict";

const data = JSON.parse(document.getElementById("data").textContent);

function fail(error) {
  d3.select("main").insert("p", ":first-child").attr("class", "note fault").attr("role", "alert")
    .text(`The figures cannot be drawn: ${error}. The tables are complete. Fix: use a browser of 2023 or later.`);
}

// "1.23 ms": three figures, as much as a page's codes carry.
function time(ns) {
  const [unit, size] = ns >= 1e9 ? ["s", 1e9] : ns >= 1e6 ? ["ms", 1e6] : ns >= 1e3 ? ["µs", 1e3] : ["ns", 1];
  return `${+(ns / size).toPrecision(3)} ${unit}`;
}
const number = d3.format(",");
const DASHES = ["", "6 3", "2 3", "8 3 2 3"];
const looks = i => ({ colour: `c${i % 7}`, dash: DASHES[Math.floor(i / 7) % 4] });

// Of runs of several conditions: a colour for each transport, a dash for each condition, where that tells them apart.
function looksOf(runs) {
  const labels = [...new Set(runs.map(run => run.label))], ids = [...new Set(runs.map(run => run.id))];
  if (labels.length > 7 || ids.length > DASHES.length) return runs.map((_, i) => looks(i));
  return runs.map(run => ({ colour: `c${labels.indexOf(run.label)}`, dash: DASHES[ids.indexOf(run.id)] }));
}

// On a logarithmic axis each doubling has a tick or each ten, whatever there is room for.
function timeAxis(scale, logarithmic, most, axis = d3.axisLeft) {
  if (!logarithmic) return axis(scale).ticks(most).tickFormat(time);
  const [least, greatest] = scale.domain(), ticks = [];
  for (let ten = 10 ** Math.floor(Math.log10(least)); ten <= greatest; ten *= 10)
    for (const factor of [1, 2, 5]) if (factor * ten >= least && factor * ten <= greatest) ticks.push(factor * ten);
  const values = ticks.length <= most + 2 ? ticks : ticks.filter(value => /^1(e|0*$)/.test(String(value)));
  return axis(scale).tickValues(values.length > 1 ? values : ticks).tickFormat(time);
}

// Read before the first figure is drawn: between figures, the browser would lay out the whole page for each.
const WIDTHS = new Map([...document.querySelectorAll("figure")].map(figure => [figure, figure.clientWidth]));

// An SVG with axes and tools, as wide as its figure. `runs` and `key`, which tells what its marks mean, are for a saved file.
class Frame {
  constructor(figure, { height, margin, runs, key = () => [] }) {
    Object.assign(this, { figure, margin, runs, key });
    this.height = height - margin.top - margin.bottom;
    this.tools = d3.select(figure).append("div").attr("class", "tools");
    this.svg = d3.select(figure).append("svg").attr("role", "img").attr("height", height);
    const inner = this.svg.append("g").attr("transform", `translate(${margin.left},${margin.top})`);
    this.grid = inner.append("g").attr("class", "grid");
    this.bottom = inner.append("g").attr("class", "axis").attr("transform", `translate(0,${this.height})`);
    this.left = inner.append("g").attr("class", "axis");
    const id = Frame.next = (Frame.next || 0) + 1;
    this.clip = this.svg.append("clipPath").attr("id", `clip-${id}`).append("rect");
    this.plot = inner.append("g").attr("clip-path", `url(#clip-${id})`);
    this.area = inner.append("rect").attr("class", "area").attr("height", this.height);
    const caption = figure.querySelector("figcaption"), section = figure.closest("section");
    this.name = caption ? caption.querySelector("b")?.textContent || "figure" : "figure";
    this.said = caption ? caption.querySelector("span")?.textContent || "" : "";
    this.of = section ? section.querySelector("h2").textContent : "";
    this.conditions = section && section.querySelector("h2 + p") ? section.querySelector("h2 + p").textContent : "";
    if (caption) this.svg.attr("aria-label", caption.textContent);
    for (const [text, save] of [["SVG", saveSvg], ["PNG", savePng]])
      this.tools.append("button").attr("type", "button").attr("class", "save").attr("title", `save as ${text}`).text(text)
        .on("click", () => save(this));
  }

  // The figure takes the focus, and its keys do what `actions` says; `keys` tells which.
  onKeys(keys, actions) {
    this.svg.attr("tabindex", 0).attr("role", "application").attr("aria-label", `${this.svg.attr("aria-label")}. ${keys}`)
      .on("keydown", () => {
        const event = d3.event, action = actions[event.key];
        if (!action || event.altKey || event.metaKey || event.ctrlKey) return;
        event.preventDefault();
        action(event);
      });
  }

  onResize(draw) {
    const resize = whole => {
      if (whole === this.whole || whole <= 0) return;
      this.whole = whole;
      this.width = Math.max(whole - this.margin.left - this.margin.right, 60);
      this.svg.attr("width", whole).attr("viewBox", `0 0 ${whole} ${this.height + this.margin.top + this.margin.bottom}`);
      this.area.attr("width", this.width);
      this.clip.attr("x", -1).attr("y", -this.margin.top).attr("width", this.width + 2)
        .attr("height", this.height + this.margin.top + 1);
      draw();
    };
    new ResizeObserver(() => resize(this.figure.clientWidth)).observe(this.figure);
    resize(WIDTHS.get(this.figure));
  }

  // A line where the figure is read, and below it what is read there: `read` is told where the mouse is.
  addReadout(read) {
    this.cursor = this.plot.append("line").attr("class", "cursor").attr("visibility", "hidden");
    this.readout = d3.select(this.figure).append("output").attr("class", "readout").attr("aria-live", "polite");
    this.area.on("mousemove", () => read(...d3.mouse(this.area.node())))
      .on("mouseleave", () => this.cursor.attr("visibility", "hidden"));
  }
  setCursor(px, height = this.height) {
    this.cursor.attr("visibility", null).attr("x1", px).attr("x2", px).attr("y1", 0).attr("y2", height);
  }

  axes(bottom, left) {
    this.bottom.call(bottom.tickSizeOuter(0));
    this.left.call(left.tickSizeOuter(0));
    const scale = left.scale();
    this.grid.selectAll("line").data(left.tickValues() || scale.ticks(...left.tickArguments())).join("line")
      .attr("x2", this.width).attr("y1", scale).attr("y2", scale);
  }

  labels(bottom, left) {
    this.svg.append("text").attr("class", "label").attr("text-anchor", "end").attr("y", this.height + this.margin.top + 30)
      .attr("data-place", "bottom").text(bottom);
    this.svg.append("text").attr("class", "label").attr("x", 4).attr("y", 11).text(left);
  }
  place() { this.svg.select("[data-place=bottom]").attr("x", this.margin.left + this.width); }
}

const LOOKS = ["fill", "stroke", "stroke-width", "stroke-linecap", "stroke-dasharray", "opacity", "fill-opacity", "font-size",
  "font-weight", "text-anchor", "visibility", "paint-order"];

// Lines of text that are no wider than that.
function wrapped(text, font, width) {
  const measure = wrapped.canvas = wrapped.canvas || document.createElement("canvas").getContext("2d"), lines = [];
  measure.font = font;
  for (const word of text.split(/\s+/).filter(Boolean)) {
    const longer = lines.length > 0 ? `${lines[lines.length - 1]} ${word}` : word;
    if (lines.length > 0 && measure.measureText(longer).width <= width) lines[lines.length - 1] = longer; else lines.push(word);
  }
  return lines;
}

// What a reader of the file needs who has not the page: of what it is, what it shows, what its marks mean, where it is from.
// It is light, for it is printed.
function standalone(frame) {
  const { width, height } = frame.svg.node().getBoundingClientRect(), left = 8, room = width - 2 * left;
  const root = document.documentElement;
  root.classList.add("print");
  const all = d3.select(document.body).append("svg").attr("xmlns", "http://www.w3.org/2000/svg").attr("class", "saved");
  all.append("title").text(`${frame.of} ${frame.name}`);
  all.append("desc").text(`${frame.said}. ${frame.conditions}. ${source(frame.runs)}`);
  let y = 6;
  const say = (text, size, className, weight = 400) => {
    for (const line of wrapped(text, `${weight} ${size}px Arial`, room)) {
      y += size * 1.35;
      all.append("text").attr("class", className).attr("font-weight", weight).attr("x", left).attr("y", y - size * 0.3).text(line);
    }
  };
  say(frame.of, 15, "saved-title", 600);
  say(frame.name, 13, "saved-name", 600);
  say(frame.said, 12, "saved-text");
  say(frame.conditions, 12, "saved-text");
  y += 6;
  const copy = frame.svg.node().cloneNode(true);
  for (const [name, value] of Object.entries({ x: 0, y, width, height })) copy.setAttribute(name, value);
  copy.querySelectorAll(".cursor, .area").forEach(one => one.remove());
  for (const name of ["tabindex", "role", "aria-label"]) copy.removeAttribute(name);
  all.node().append(copy);
  y += height + 4;
  let x = left;
  for (const { className, dash, d, text } of frame.key()) {
    const lines = wrapped(text, "400 12px Arial", room - 28), wide = 28 + 7.2 * d3.max(lines, line => line.length) + 14;
    if (x > left && x + wide > width) { x = left; y += 18; }
    const one = all.append("g").attr("transform", `translate(${x},${y + 8})`);
    one.append("path").attr("class", className).attr("stroke-dasharray", dash || null).attr("d", d || "M0,0H22");
    lines.forEach((line, i) => one.append("text").attr("class", "saved-key").attr("x", 28).attr("y", 4 + i * 16).text(line));
    x += wide;
    if (lines.length > 1) { x = left; y += 16 * lines.length + 2; }
  }
  y += x > left ? 18 : 0;
  say(source(frame.runs), 10, "saved-source");
  y += 8;
  all.attr("width", width).attr("height", y).attr("viewBox", `0 0 ${width} ${y}`);
  all.insert("rect", ":first-child").attr("width", width).attr("height", y).attr("fill", "#fff");
  for (const element of all.node().querySelectorAll("*")) {
    const style = getComputedStyle(element);
    if (["path", "line", "rect", "text"].includes(element.localName)) for (const look of LOOKS) element.setAttribute(look, style.getPropertyValue(look));
    if (element.localName === "text") element.setAttribute("font-family", "Arial, Helvetica, DejaVu Sans, sans-serif");
    element.removeAttribute("class");
  }
  all.attr("class", null);
  const text = new XMLSerializer().serializeToString(all.node());
  all.remove();
  root.classList.remove("print");
  return { width, height: y, blob: new Blob([text], { type: "image/svg+xml" }) };
}

// "demo.ontime, runs 4, 10; measured by ontime 1.2"
function source(runs) {
  const numbers = runs.map(run => run.run), versions = [...new Set(runs.map(run => run.ontime))].filter(Boolean);
  const of = numbers.length === 0 ? "" : numbers.length > 12 ? `, ${numbers.length} runs`
    : `, ${numbers.length > 1 ? "runs" : "run"} ${numbers.join(", ")}`;
  return data.source.file + of + (versions.length > 0 ? `; measured by ontime ${versions.join(", ")}` : "") +
    `; drawn by ontime ${data.source.ontime}`;
}

function download(blob, name) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name.replace(/[^\w.-]+/g, "-").replace(/-+(?=\.\w+$)|^-+/g, "");
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

const fileName = (frame, form) => `${data.source.file.replace(/\.ontime$/, "")}-${frame.of.split(" · ")[0]}-${frame.name}.${form}`;

function saveSvg(frame) { download(standalone(frame).blob, fileName(frame, "svg")); }

function savePng(frame) {
  const { blob, width, height } = standalone(frame), url = URL.createObjectURL(blob), image = new Image();
  image.onload = () => {
    const canvas = document.createElement("canvas"), finer = 3;
    canvas.width = width * finer;
    canvas.height = height * finer;
    canvas.getContext("2d").drawImage(image, 0, 0, canvas.width, canvas.height);
    URL.revokeObjectURL(url);
    canvas.toBlob(png => download(png, fileName(frame, "png")));
  };
  image.src = url;
}

// Lines of runs over each other, each of which a name switches on and off. `labels`: what is said of those that are shown.
class Lines {
  constructor(figure, { series, x, y, lines, labels = () => [], left, bottom, tell }) {
    Object.assign(this, { series, x, y, lines, labels, tell, hidden: new Set() });
    series.forEach((one, i) => { one.look = one.look || looks(i); });
    this.frame = new Frame(figure, { height: 300, margin: { top: 24, right: 14, bottom: 36, left: 56 }, runs: runsIn(series),
      key: () => this.key() });
    this.frame.labels(bottom, left);
    this.deadline = this.frame.plot.append("path").attr("class", "deadline");
    const names = d3.select(figure).append("div").attr("class", "names").attr("role", "group").attr("aria-label", "shown");
    names.selectAll("button").data(series).enter().append("button").attr("type", "button").attr("aria-pressed", "true")
      .on("click", (one, i, nodes) => {
        this.hidden.has(one) ? this.hidden.delete(one) : this.hidden.add(one);
        d3.select(nodes[i]).attr("aria-pressed", !this.hidden.has(one));
        this.draw();
      }).each(function (one) {
        const button = d3.select(this);
        button.append("svg").attr("width", 22).attr("height", 8).attr("aria-hidden", "true").append("path")
          .attr("class", `line ${one.look.colour}`).attr("stroke-dasharray", one.look.dash).attr("d", "M0,4H22");
        button.append("span").text(one.name);
      });
    this.frame.addReadout(px => this.point(px));
    this.paths = this.frame.plot.append("g");
    this.said = this.frame.plot.append("g");
    if (tell) {
      const step = by => this.point(Math.min(Math.max((this.at === undefined ? this.frame.width / 2 : this.at) + by, 0), this.frame.width));
      this.frame.onKeys("Left and right arrow keys read its values.", {
        ArrowLeft: () => step(-this.frame.width / 50), ArrowRight: () => step(this.frame.width / 50),
        Home: () => step(-this.frame.width), End: () => step(this.frame.width),
      });
    }
    this.frame.onResize(() => this.draw());
  }

  shown() { return this.series.filter(one => !this.hidden.has(one)); }

  draw() {
    const { frame } = this;
    const x = this.xScale = this.x.scale().range([0, frame.width]), y = this.y.scale().range([frame.height, 0]);
    frame.axes(this.x.axis(x, frame.width), this.y.axis(y));
    frame.place();
    const all = this.shown().flatMap(one => this.lines(one, x, y).map(line =>
      ({ ...line, class: `line ${one.look.colour} ${line.class || ""}`, dash: line.dash || one.look.dash })));
    this.paths.selectAll("path").data(all).join("path").attr("class", one => one.class)
      .attr("stroke-dasharray", one => one.dash || null).attr("d", one => one.d);
    this.said.selectAll("text").data(this.labels(this.shown(), x, y)).join("text").attr("class", "label").attr("text-anchor", "end")
      .attr("x", one => one.x).attr("y", one => one.y).text(one => one.text);
    const deadlines = new Set(this.series.map(one => one.deadline_ns));
    const [deadline] = deadlines;
    this.deadline.attr("d", deadlines.size === 1 && deadline && this.x.isTime ? `M${x(deadline)},0V${frame.height}` : null);
  }

  key() {
    const shown = this.shown(), { deadline } = this;
    return [...shown.map(one => ({ className: `line ${one.look.colour}`, dash: one.look.dash, text: one.name })),
      ...(deadline.attr("d") ? [{ className: "deadline", text: `deadline ${time(shown.length > 0 ? shown[0].deadline_ns : 0)}` }] : [])];
  }

  point(px) {
    if (!this.tell) return;
    this.at = px;
    this.frame.setCursor(px);
    this.frame.readout.text(this.tell(this.xScale.invert(px), this.shown()));
  }
}

// "round trip", or of a robot's own messages "age" or "period".
const quantityOf = runs => runs.every(run => run.quantity === runs[0].quantity) ? runs[0].quantity.toLowerCase() : "time";

const runsIn = series => series.reduce((all, one) => all.concat(one.values || [one]), []);
const allOf = figure => figure.dataset.figuresOf.split(" ").map(i => data.runs[i]);

// The runs that have round trips. A note names the runs that are not drawn.
function runsOf(figure) {
  const all = allOf(figure), lost = all.filter(run => !run.round_trip);
  if (lost.length > 0)
    d3.select(figure).append("p").attr("class", "note").text(`Not shown (no answers): ${lost.map(run => run.label).join(", ")}.`);
  return all.filter(run => run.round_trip);
}

function timesDomain(runs) {
  const answered = runs.filter(run => run.round_trip), deadline = d3.max(runs, run => run.deadline_ns) || 0;
  if (answered.length === 0) return [(deadline || 1e7) / 100, (deadline || 1e7) * 1.2];
  return [d3.min(answered, run => run.round_trip.min) * 0.9,
    Math.max(d3.max(answered, run => run.round_trip.max), deadline) * 1.2];
}
const timesAxis = domain => ({
  isTime: true,
  scale: () => d3.scaleLog().domain(domain).clamp(true),
  axis: (scale, width) => timeAxis(scale, true, width / 70, d3.axisBottom),
});

// The share of messages that are slower than each bin's beginning: exact there, and up to the next bin no more than that.
// Lost ones are slower than whatever one asks for.
const NEVER = 1e18;
function worse(histogram, greatest, lost) {
  const points = [], all = d3.sum(histogram, bin => bin[2]) + lost;
  let slower = all;
  for (const [from, , count] of histogram) {
    points.push([from, slower / all]);
    slower -= count;
  }
  points.push([greatest, slower / all]);
  if (lost > 0) points.push([NEVER, slower / all]);
  return points;
}

// The extrapolated level that one answer in so many exceeds, with its confidence interval. The curve is of all messages:
// a share of lost ones lifts it, and the mark with it.
const liftedShare = run => run.lost / run.sent + (1 - run.lost / run.sent) * run.bound.exceedance;
function expected({ roundTrips, ...run }, x, y, edge) {
  const bound = run.bound;
  if (!bound) return [];
  const share = liftedShare(run), at = y(share), slowest = roundTrips[roundTrips.length - (run.lost > 0 ? 3 : 2)];
  const way = slowest[1] > share && slowest[0] < bound.level ? `M${x(slowest[0])},${y(slowest[1])}L${x(bound.level)},${at}` : "";
  return [{ d: way, class: "expected", dash: "1 4" },
    { d: `M${x(bound.low)},${at}H${bound.high === null ? edge : x(bound.high)}m0,-4v8M${x(bound.low)},${at - 4}v8`, class: "expected", dash: " " },
    { d: `M${x(bound.level)},${at}h0`, class: "dots expected", dash: " " }];
}

function drawCcdf(figure) {
  const runs = allOf(figure).filter(run => run.sent > 0), answered = runs.filter(run => run.round_trip);
  if (runs.length === 0) return;
  const whole = figure.dataset.names === "whole", domain = timesDomain(runs), bounds = answered.filter(run => run.bound);
  domain[1] = Math.max(domain[1], (d3.max(answered, run => run.response.max) || 0) * 1.2);
  domain[1] = Math.max(domain[1], Math.min(domain[1] * 10, (d3.max(bounds, run => run.bound.high || run.bound.level) || 0) * 1.2));
  const least = Math.min(d3.min(runs, run => 1 / run.sent), d3.min(answered, run => 1 / run.response.count) || 1,
    d3.min(bounds, run => run.bound.exceedance) || 1);
  const look = whole ? looksOf(runs) : [];
  const series = runs.map((run, i) => ({ ...run, look: look[i], name: whole ? `${run.id} ${run.label}` : run.label,
    roundTrips: worse(run.histogram, run.round_trip ? run.round_trip.max : domain[0], run.lost),
    responses: worse(run.responses, run.response ? run.response.max : domain[0], run.lost) }));
  const share = value => value >= 1e-4 ? `${+(value * 100).toPrecision(2)} %` : `${+(value * 1e6).toPrecision(2)} ppm`;
  let kind = "roundTrips";
  const lines = new Lines(figure, {
    series, left: "share of messages slower", bottom: quantityOf(runs), x: timesAxis(domain),
    y: { scale: () => d3.scaleLog().domain([least * 0.7, 1]).clamp(true),
      axis: scale => d3.axisLeft(scale).tickValues(d3.range(0, Math.ceil(-Math.log10(least)) + 1).map(i => 10 ** -i)
        .filter(value => value >= least * 0.7)).tickFormat(share) },
    lines: (one, x, y) => [
      { d: d3.line().x(p => x(p[0])).y(p => p[1] > 0 ? y(p[1]) : y(least * 0.7)).curve(d3.curveStepAfter)(one[kind]) },
      ...(kind === "roundTrips" ? expected(one, x, y, x.range()[1]) : []),
    ],
    labels: (shown, x, y) => kind === "roundTrips" && shown.some(one => one.bound)
      ? [{ x: x.range()[1], y: y(liftedShare(shown.find(one => one.bound))) - 8, text: "extrapolated worst case" }] : [],
    tell: (ns, shown) => `slower than ${time(ns)}: ` + shown.map(one => {
      const i = d3.bisector(p => p[0]).right(one[kind], ns) - 1, slower = i < 0 ? 1 : one[kind][i][1];
      return `${one.name} ${slower > 0 ? share(slower) : "none"}`;
    }).join(" · "),
  });
  const key = lines.frame.key;
  lines.frame.key = () => [...key(), ...(kind === "roundTrips" && series.some(one => one.bound && !lines.hidden.has(one))
    ? [{ className: "line expected key", dash: "1 4", text: "extrapolated worst case, with its interval" }] : [])];
  lines.frame.tools.insert("button", ".save").attr("type", "button").attr("aria-pressed", "false").text("response")
    .attr("title", "of each cycle from when it was due, not of each message from when it was sent")
    .on("click", (_, i, [button]) => {
      kind = kind === "roundTrips" ? "responses" : "roundTrips";
      d3.select(button).attr("aria-pressed", kind === "responses");
      lines.frame.svg.select("[data-place=bottom]").text(kind === "responses" ? "response time" : quantityOf(runs));
      lines.draw();
    });
}

// Round bins that touch; between others it goes down to the ground.
function outline(histogram, x, y, ground) {
  let path = "", end = null;
  for (const [from, to, count] of histogram) {
    if (from !== end) path += `${end === null ? "" : `V${ground}`}M${x(from).toFixed(1)},${ground}`;
    path += `V${y(count).toFixed(1)}H${x(to).toFixed(1)}`;
    end = to;
  }
  return path + `V${ground}`;
}

function drawHistogram(figure) {
  const runs = runsOf(figure);
  if (runs.length === 0) return;
  const domain = timesDomain(runs), most = d3.max(runs, run => d3.max(run.histogram, bin => bin[2]));
  new Lines(figure, {
    series: runs.map(run => ({ ...run, name: run.label })), left: "messages per bin", bottom: quantityOf(runs), x: timesAxis(domain),
    y: { scale: () => d3.scaleLog().domain([0.7, most * 1.3]).clamp(true),
      axis: scale => d3.axisLeft(scale).tickValues(d3.range(0, 12).map(i => 10 ** i).filter(value => value <= most * 1.3)).tickFormat(number) },
    lines: (one, x, y) => [{ d: outline(one.histogram, x, y, y(0.7)), class: "bins" }],
    tell: (ns, shown) => `${time(ns)}: ` + shown.map(one => {
      const bin = one.histogram.find(([from, to]) => from <= ns && ns < to);
      return `${one.name} ${number(bin ? bin[2] : 0)}`;
    }).join(" · "),
  });
}

function drawPayload(figure) {
  const runs = runsOf(figure);
  if (runs.length === 0) return;
  const groups = d3.nest().key(run => run.line).entries(runs);
  const sizes = [...new Set(runs.map(run => Math.max(run.payload_bytes, 1)))].sort(d3.ascending);
  const times = [d3.min(runs, run => run.round_trip.p50) * 0.7, d3.max(runs, run => run.round_trip.p99) * 1.4];
  const line = (values, x, y, figureOf, dashes, wide) => {  // a dot, or a stroke so wide, where it was measured
    const points = d3.nest().key(run => Math.max(run.payload_bytes, 1)).rollup(of => d3.median(of, run => run.round_trip[figureOf]))
      .entries(values).map(entry => [+entry.key, entry.value]).sort((a, b) => a[0] - b[0]);
    return [{ d: d3.line().x(p => x(p[0])).y(p => y(p[1]))(points), dash: dashes },
      { d: points.map(p => `M${x(p[0]) - wide / 2},${y(p[1])}h${wide}`).join(""), class: wide ? "" : "dots", dash: " " }];
  };
  const bytes = value => value >= 1048576 ? `${value / 1048576} MiB` : value >= 1024 ? `${+(value / 1024).toPrecision(3)} KiB` : `${value} B`;
  new Lines(figure, {
    series: groups.map(group => ({ name: group.key, values: group.values })), left: "round trip", bottom: "payload; p50: ● and line, p99: – and dashes",
    x: { scale: () => d3.scaleLog().domain([sizes[0] / 1.3, sizes[sizes.length - 1] * 1.3]),
      axis: scale => d3.axisBottom(scale).tickValues(sizes).tickFormat(bytes) },
    y: { scale: () => d3.scaleLog().domain(times), axis: scale => timeAxis(scale, true, 6) },
    lines: (one, x, y) => [...line(one.values, x, y, "p50", " ", 0), ...line(one.values, x, y, "p99", "5 4", 10)],
    tell: (size, shown) => {
      const nearest = d3.scan(sizes, (a, b) => Math.abs(Math.log(a / size)) - Math.abs(Math.log(b / size)));
      const of = one => one.values.filter(run => Math.max(run.payload_bytes, 1) === sizes[nearest]);
      const median = (runs, figureOf) => time(d3.median(runs, run => run.round_trip[figureOf]));
      return `${bytes(sizes[nearest])}: ` + shown.filter(one => of(one).length > 0)
        .map(one => `${one.name} p50 ${median(of(one), "p50")}, p99 ${median(of(one), "p99")}`).join(" · ");
    },
  });
}

function drawLayers(figure) {
  const bars = data.layers, row = 26, margin = { top: 8, right: 125, bottom: 38, left: 105 };
  const frame = new Frame(figure, { height: bars.length * row + margin.top + margin.bottom, margin, runs: data.runs });
  frame.svg.append("text").attr("class", "label").attr("text-anchor", "end").attr("y", bars.length * row + margin.top + margin.bottom)
    .attr("data-place", "bottom").text("round trip of the median message");
  frame.onResize(() => {
    frame.place();
    const x = d3.scaleLinear([0, d3.max(bars, bar => bar.total) || 1], [0, frame.width]).nice();
    const y = d3.scaleBand(d3.range(bars.length), [0, frame.height]).paddingInner(0.35);
    frame.axes(d3.axisBottom(x).ticks(frame.width / 80).tickFormat(time), d3.axisLeft(y).tickFormat(i => bars[i].name).tickValues(d3.range(bars.length)));
    frame.grid.selectAll("line").remove();
    const groups = frame.plot.selectAll("g").data(bars), entered = groups.enter().append("g");
    for (const name of ["below", "added"]) entered.append("rect").attr("class", name).attr("height", y.bandwidth());
    entered.append("path").attr("class", "interval");
    entered.append("text").attr("class", "label").attr("dy", "0.35em");
    const all = entered.merge(groups).attr("transform", (_, i) => `translate(0,${y(i)})`);
    const added = bar => bar.added ? bar.added[0] : bar.total;
    all.select(".below").attr("width", bar => x(Math.max(bar.total - added(bar), 0)));
    all.select(".added").attr("x", bar => x(Math.max(bar.total - Math.max(added(bar), 0), 0)))
      .attr("width", bar => Math.max(x(Math.max(added(bar), 0)), 1));
    all.select(".interval").attr("d", bar => {
      if (!bar.added) return null;
      const base = bar.total - bar.added[0], middle = y.bandwidth() / 2;
      return `M${x(base + bar.added[1])},${middle}H${x(base + bar.added[2])}`;
    });
    frame.clip.attr("width", frame.width + margin.right);
    all.select("text").attr("x", bar => x(bar.total) + 6).attr("y", y.bandwidth() / 2)
      .text(bar => time(bar.total) + (bar.added ? ` (${bar.added[0] < 0 ? "−" : "+"}${time(Math.abs(bar.added[0]))})` : ""));
  });
}

// From the fastest to the slowest of each run on one scale, with its deadline: what the table says, for the eye.
function drawRanges() {
  const runs = data.runs.filter(run => run.round_trip);
  if (runs.length === 0) return;
  const width = 180, x = d3.scaleLog().domain(timesDomain(runs)).range([2, width - 2]).clamp(true);
  for (const cell of document.querySelectorAll("td.range")) {
    const run = data.runs[cell.dataset.figureOf], of = run.round_trip;
    if (!of) continue;
    const svg = d3.select(cell).append("svg").attr("width", width).attr("height", 16).attr("aria-hidden", "true");
    if (run.deadline_ns) svg.append("path").attr("class", "deadline").attr("d", `M${x(run.deadline_ns)},0V16`);
    svg.append("path").attr("class", "range").attr("d", `M${x(of.min)},8H${x(of.max)}`);
    if (run.deadline_ns && of.max > run.deadline_ns)
      svg.append("path").attr("class", "range beyond").attr("d", `M${x(run.deadline_ns)},8H${x(of.max)}`);
    svg.append("path").attr("class", "most").attr("d", `M${x(of.p50)},8H${x(of.p99)}`);
  }
}

try {
  drawRanges();
  for (const [name, draw] of [["ccdf", drawCcdf], ["histogram", drawHistogram], ["payload", drawPayload], ["layers", drawLayers]])
    document.querySelectorAll(`figure.${name}`).forEach(draw);
} catch (error) {
  fail(error);
}
