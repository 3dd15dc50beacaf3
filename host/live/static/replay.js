// Moves the time of now through a log.

import {duration} from "./format.js";

const byId = id => document.getElementById(id);
const PLAYED_SPAN_S = "60";
const FRESH_S = 0.25;

export class Replay {
  // `main` gives the table whose times are those of the log.
  constructor(view, main) {
    this.view = view;
    this.main = main;
    this.isOn = false;
    this.isPlaying = false;
    this.before = null;
    byId("play").addEventListener("click", () => (this.isPlaying ? this.stop() : this.play()));
    byId("position").addEventListener("input", () => this.seek(this.first + Number(byId("position").value) * (this.last - this.first)));
  }

  get first() { return this.main()?.layout.first ?? 0; }
  get last() { return this.main()?.layout.last ?? 0; }
  get speed() { return Number(byId("speed").value); }

  begin({mode}) {
    this.isOn = mode === "log";
    byId("replay").hidden = !this.isOn;
    if (!this.isOn) return;
    byId("pause").hidden = true;
    this.select("Infinity");
  }

  select(span) {
    byId("span").value = span;
    this.view.span = Number(span);
  }

  play() {
    if (!this.main()) return;
    if (this.view.cursor === null || this.view.cursor >= this.last) this.seek(this.first);
    if (this.view.span === Infinity) this.select(PLAYED_SPAN_S);
    this.isPlaying = true;
    byId("play").textContent = "❚❚ Stop";
    this.view.live();
  }

  stop() {
    this.isPlaying = false;
    byId("play").textContent = "▶ Play";
    this.view.changed();
  }

  seek(time) {
    this.view.cursor = Math.min(Math.max(time, this.first), this.last);
    this.view.ahead = FRESH_S * (1 + 20 * this.speed);
    this.view.live();
  }

  // Lets time pass; true when something moved.
  advance(now, want, tables) {
    const passed = this.before === null ? 0 : (now - this.before) / 1000;
    this.before = now;
    if (!this.isOn || !this.main()) return false;
    this.view.clock = this.main().layout.timeTitle;
    this.view.cursor ??= this.last;
    byId("position").value = (this.view.cursor - this.first) / (this.last - this.first || 1);
    byId("now").textContent = `${duration(this.view.cursor)} of ${duration(this.last)}`;
    if (!this.isPlaying) return false;
    this.view.cursor = Math.min(this.view.cursor + passed * this.speed, this.last);
    this.view.ahead = FRESH_S * (1 + 20 * this.speed);
    for (const table of tables.values())
      if (!table.asked && (table.x.at(-1) ?? -Infinity) < Math.min(this.view.cursor + this.view.ahead / 2, table.layout.last)) want(table);
    if (this.view.cursor >= this.last) this.stop();
    return true;
  }
}
