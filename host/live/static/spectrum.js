// A spectrum that comes in pieces: each frame says its axis, its first frequency and the amplitudes from there on.

import {magnitude, number} from "./format.js";

export const AMPLITUDE = /^amplitude_\d+$/;

const LOGARITHMIC = 3;

export function isSpectrum(layout) {
  return "first_frequency" in layout.fields && layout.names.some(name => AMPLITUDE.test(name));
}

export class Spectrum {
  constructor(table, room, surroundings) {
    this.table = table;
    this.surroundings = surroundings;
    this.names = table.layout.names.filter(name => AMPLITUDE.test(name));
    this.width = table.layout.fields.first_frequency.scale;
    this.axes = table.layout.fields.axis?.words ?? [""];
    this.curves = this.axes.map(() => []);
    this.figure = document.createElement("figure");
    this.figure.dataset.panel = "spectrum";
    const unit = table.layout.fields[this.names[0]].unit;
    const caption = document.createElement("figcaption");
    caption.textContent = `gyro spectrum [${unit}] over frequency [Hz]`;
    this.figure.append(caption);
    room.append(this.figure);
    this.unit = unit;
    new ResizeObserver(() => this.plot?.setSize(this.size())).observe(this.figure);
  }

  get isSeen() { return true; }

  size() { return {width: Math.max(200, this.figure.clientWidth - 24), height: 220}; }

  // The newest of each piece.
  take() {
    const [from, behind] = this.table.between(...this.surroundings.recent(this.table));
    const first = this.table.column("first_frequency"), axis = this.table.column("axis");
    for (let row = from; row < behind; row++) {
      const bin = Math.round(first[row] / this.width), curve = this.curves[axis?.[row] ?? 0];
      if (curve) this.names.forEach((name, index) => { curve[bin + index] = this.table.column(name)[row]; });
    }
  }

  data() {
    this.take();
    const count = Math.max(...this.curves.map(curve => curve.length));
    const frequencies = Array.from({length: count}, (_, bin) => bin * this.width);
    return [frequencies, ...this.curves.map(curve => Array.from({length: count}, (_, bin) => curve[bin] || null))];
  }

  restyle() {
    this.plot?.destroy();
    this.plot = null;
  }

  draw() {
    if (this.plot) return this.plot.setData(this.data());
    const style = getComputedStyle(document.documentElement), of = name => style.getPropertyValue(name).trim();
    const axis = {stroke: of("--text"), grid: {stroke: of("--grid"), width: 1}, ticks: {stroke: of("--grid")}};
    const series = this.axes.map((label, index) => ({
      label, stroke: of(`--curve-${index}`), width: 1.5, points: {show: false}, value: (_plot, value) => magnitude(value)}));
    this.plot = new uPlot({
      ...this.size(), scales: {x: {time: false}, y: {distr: LOGARITHMIC}}, axes: [{...axis, size: 34}, {...axis, size: 66, values: (_plot, values) => values.map(value => (value === null ? null : magnitude(value)))}], cursor: {drag: {x: true, y: false}},
      series: [{label: "f", value: (_plot, value) => number(value, "Hz")}, ...series],
    }, this.data(), this.figure);
  }
}
