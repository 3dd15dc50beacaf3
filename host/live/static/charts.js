// Curves of a table, one chart for each panel, drawn with uPlot.

import {number, ticks, wrapped} from "./format.js";
import {drawTrack} from "./map.js";

const HEIGHT = 205;
const LABEL_FONT = "12px system-ui, sans-serif";
const LANE_HEIGHT = 22;
const ON = 0.75;
const FLAT = 1e-6;
const MANY_POINTS = 30;
const UNWRAPPED = ["heading", "longitude"];

// What the charts need of their surroundings:
// range(table) -> [start, stop]; zoom(start, stop, clock); live(); marks(table) -> [{x, text}]; sessions -> [x].
export function chartsOf(table, room, surroundings) {
  const made = [];
  for (const plan of table.layout.plans) {
    const charts = plan.panels.map(panel => panel.lanes
      ? new Lanes(table, panel, plan, surroundings) : new Curves(table, panel, plan, surroundings));
    room.append(...charts.map(chart => chart.figure));
    made.push(...charts);
  }
  if (table.layout.isNavigation) {
    const track = new Track(table, surroundings);
    room.prepend(track.figure);
    made.unshift(track);
  }
  return made;
}

function figureOf(title, note) {
  const figure = document.createElement("figure"), caption = document.createElement("figcaption");
  caption.textContent = title;
  const small = document.createElement("small");
  small.textContent = note;
  caption.append(small);
  figure.append(caption);
  return figure;
}

const seen = new Set();
const watcher = new IntersectionObserver(entries => {
  for (const {target, isIntersecting} of entries) isIntersecting ? seen.add(target) : seen.delete(target);
}, {rootMargin: "150px"});

class Chart {
  constructor(table, figure, surroundings) {
    this.table = table;
    this.figure = figure;
    this.surroundings = surroundings;
    watcher.observe(figure);
  }

  get isSeen() { return seen.has(this.figure); }
}

function colours() {
  const style = getComputedStyle(document.documentElement), of = name => style.getPropertyValue(name).trim();
  return {curves: [0, 1, 2, 3, 4, 5].map(index => of(`--curve-${index}`)), text: of("--text"), soft: of("--soft"), grid: of("--grid"), bad: of("--bad"), accent: of("--accent")};
}

class Plotted extends Chart {
  constructor(table, panel, plan, surroundings) {
    super(table, figureOf(panel.title, plan.title), surroundings);
    this.panel = panel;
    this.figure.dataset.panel = `${table.layout.name}/${plan.name}/${panel.title}`;
    this.sizes = new ResizeObserver(() => this.plot?.setSize(this.size()));
    this.sizes.observe(this.figure);
  }

  size() { return {width: Math.max(200, this.figure.clientWidth - 24), height: this.height()}; }

  // Charts of one clock are looked at together.
  get clock() { return this.table.layout.timeTitle; }

  restyle() {
    this.plot?.destroy();
    this.plot = null;
  }

  make(series, yAxis, yScale) {
    const {text, grid, soft} = colours(), axis = {stroke: text, grid: {stroke: grid, width: 1}, ticks: {stroke: grid}};
    const options = {
      ...this.size(),
      legend: {live: true},
      cursor: {sync: {key: this.clock}, drag: {x: true, y: false, setScale: false}, focus: {prox: 24}},
      scales: {x: {time: false, range: () => this.surroundings.range(this.table)}, y: yScale},
      axes: [{...axis, size: 30, label: this.table.layout.timeTitle, labelSize: 16, labelFont: LABEL_FONT, labelGap: 0}, {...axis, size: 66, ...yAxis}],
      series: [{label: "time", value: (_plot, value) => number(value, "s")}, ...series],
      hooks: {
        setSelect: [plot => this.select(plot)],
        draw: [plot => this.annotate(plot, soft)],
      },
    };
    this.plot = new uPlot(options, this.data(), this.figure);
    this.plot.over.addEventListener("dblclick", () => this.surroundings.live());
  }

  select(plot) {
    if (plot.select.width < 3) return;
    const at = pixels => plot.posToVal(pixels, "x");
    this.surroundings.zoom(at(plot.select.left), at(plot.select.left + plot.select.width), this.clock);
    plot.setSelect({left: 0, top: 0, width: 0, height: 0}, false);
  }

  draw() {
    if (!this.plot) this.build();
    else this.plot.setData(this.data());
  }

  annotate(plot, colour) {
    const {ctx, bbox} = plot, [start, stop] = this.surroundings.range(this.table);
    const inside = x => x >= start && x <= stop, ratio = devicePixelRatio || 1;
    ctx.save();
    ctx.lineWidth = ratio;
    ctx.strokeStyle = ctx.fillStyle = colour;
    ctx.font = `${11 * ratio}px system-ui, sans-serif`;
    for (const x of this.surroundings.sessions().filter(inside)) upright(ctx, plot.valToPos(x, "x", true), bbox, [2, 4]);
    for (const {x, text} of this.surroundings.marks(this.table).filter(mark => inside(mark.x))) {
      const left = plot.valToPos(x, "x", true);
      upright(ctx, left, bbox, []);
      // Beside the line, where there is more room.
      const isRight = left > bbox.left + bbox.width / 2;
      ctx.textAlign = isRight ? "right" : "left";
      ctx.fillText(text, left + (isRight ? -3 : 3) * ratio, bbox.top + 10 * ratio);
    }
    this.limit(plot, ctx, bbox);
    ctx.restore();
  }

  limit() {}
}

function upright(ctx, x, bbox, dashes) {
  ctx.setLineDash(dashes);
  ctx.beginPath();
  ctx.moveTo(x, bbox.top);
  ctx.lineTo(x, bbox.top + bbox.height);
  ctx.stroke();
}

class Curves extends Plotted {
  height() { return HEIGHT; }

  data() { return [this.table.x, ...this.panel.columns.map(name => this.table.column(name))]; }

  build() {
    const {curves} = colours(), fields = this.table.layout.fields;
    const series = this.panel.columns.map((name, index) => ({
      label: name, stroke: curves[index % curves.length], width: 1.5, points: {show: isSparse},
      value: (_plot, value) => number(value, fields[name]?.unit, name),
    }));
    const angle = this.panel.columns.some(name => UNWRAPPED.includes(name));
    const shown = angle ? values => values.map(value => Math.abs(wrapped(value + 1e-9, 0) - 1e-9)) : values => values;
    const yAxis = {values: (_plot, values, _axis, _space, step) => ticks(shown(values), step)};
    this.make(series, yAxis, {range: (_plot, low, high) => widened(low, high)});
  }

  // The limit is drawn where the curves come near it; elsewhere its value is said in words.
  draw() {
    super.draw();
    const {limit, columns} = this.panel;
    if (limit === null) return;
    const now = this.surroundings.value(this.table, columns[0]), tickMs = 1000 * this.table.layout.fields.tick.scale;
    if (now === undefined || now === null) return;
    const share = now / limit, used = `${(share * tickMs).toPrecision(2)} of ${Number(tickMs.toPrecision(6))} ms`;
    this.figure.querySelector("small").textContent = `${(100 * share).toFixed(2)} % of the tick: ${used}`;
  }

  limit(plot, ctx, bbox) {
    const {limit} = this.panel;
    if (limit === null || limit > plot.scales.y.max) return;
    const y = plot.valToPos(limit, "y", true);
    ctx.strokeStyle = colours().bad;
    ctx.beginPath();
    ctx.moveTo(bbox.left, y);
    ctx.lineTo(bbox.left + bbox.width, y);
    ctx.stroke();
  }
}

// Single frames show as points.
function isSparse(_plot, _series, first, last) {
  return last - first < MANY_POINTS;
}

// Some room around the curves, also around a flat one.
function widened(low, high) {
  if (low === null) return [-1, 1];
  const isFlat = high - low <= FLAT * Math.max(Math.abs(high), FLAT);
  const margin = isFlat ? 0.02 * Math.abs(high) || 1 : 0.08 * (high - low);
  return [low - margin, high + margin];
}

// Words as bars, one line for each that occurred.
class Lanes extends Plotted {
  constructor(...all) {
    super(...all);
    this.shown = [];
  }

  height() { return 60 + LANE_HEIGHT * Math.max(1, this.shown.length); }

  occurring() {
    return this.panel.columns.filter(name => this.table.column(name).some(value => value));
  }

  data() {
    return [this.table.x, ...this.shown.map((name, lane) =>
      this.table.column(name).map(value => (value === null ? null : lane + ON * value)))];
  }

  draw() {
    const shown = this.occurring();
    this.figure.querySelector("small").textContent = shown.length ? "" : "none occurs here";
    if (shown.join() !== this.shown.join()) {
      this.shown = shown;
      this.restyle();
    }
    super.draw();
  }

  build() {
    const {curves} = colours(), count = this.shown.length;
    const series = this.shown.map((name, lane) => ({
      label: word(name), stroke: curves[lane % curves.length], fill: curves[lane % curves.length] + "55", width: 1.5,
      fillTo: lane, paths: uPlot.paths.stepped({align: 1}), points: {show: false},
      value: (_plot, value) => (value === null ? "–" : value > lane ? "on" : "off"),
    }));
    const yAxis = {splits: () => this.shown.map((_, lane) => lane + ON / 2), values: () => this.shown.map(word), size: 120, grid: {show: false}, ticks: {show: false}};
    this.make(series, yAxis, {range: () => [-0.1, Math.max(1, count)]});
    this.figure.querySelector(".u-legend").hidden = true;
  }
}

function word(lane) {
  return lane.slice(lane.indexOf(": ") + 2);
}

class Track extends Chart {
  constructor(table, surroundings) {
    super(table, figureOf("track", "Position"), surroundings);
    this.canvas = document.createElement("canvas");
    this.canvas.className = "map";
    this.figure.append(this.canvas);
    this.figure.dataset.panel = "track";
  }

  restyle() {}

  draw() {
    const [start, stop] = this.table.between(...this.surroundings.range(this.table));
    const column = name => this.table.column(name).slice(start, stop);
    drawTrack(this.canvas, column("longitude"), column("latitude"), column("heading").at(-1));
  }
}
