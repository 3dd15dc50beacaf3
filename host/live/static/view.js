// Which stretch of board time the curves show: the last seconds of a line, a chosen stretch, or a replay's place.

const byId = id => document.getElementById(id);
// Beside what is seen, so that the curves reach the edges.
const MARGIN = 0.02;
const LEAST_SPAN_S = 1;
const RECENT_S = 3;

export class View {
  constructor(changed) {
    this.changed = changed;
    this.span = 60;
    // Stretches that are looked at, by the titles of their clocks; none where the curves follow.
    this.fixed = new Map();
    // The replay's place, in times of the clock with this title.
    this.cursor = null;
    this.clock = null;
    this.ahead = 0;
    byId("span").addEventListener("change", () => {
      this.span = Number(byId("span").value);
      this.live();
    });
    byId("pause").addEventListener("click", () => this.toggle());
    addEventListener("keydown", event => {
      if (event.code !== "Space" || /INPUT|SELECT|BUTTON|SUMMARY/.test(event.target.tagName)) return;
      event.preventDefault();
      this.toggle();
    });
  }

  isFixed(table) { return this.fixed.has(table.layout.timeTitle); }

  // The board time that is now: the newest, or the replay's.
  now(table) { return this.cursorOf(table) ?? table.lastX ?? table.layout.last ?? 0; }

  cursorOf(table) { return table.layout.timeTitle === this.clock ? this.cursor : null; }

  range(table) {
    if (this.isFixed(table)) return this.fixed.get(table.layout.timeTitle);
    const now = this.now(table), first = table.x[0] ?? now;
    const start = Math.max(now - this.span, first);
    return [start, Math.max(now, start + LEAST_SPAN_S)];
  }

  // What to ask the host for; numbers of JSON are finite.
  fetched(table) {
    if (this.isFixed(table)) {
      const [start, stop] = this.range(table), margin = MARGIN * (stop - start);
      return [start - margin, stop + margin];
    }
    const now = this.now(table), start = Math.max(now - this.span * (1 + MARGIN), -Number.MAX_VALUE);
    return [start, this.cursorOf(table) === null || this.span === Infinity ? Number.MAX_VALUE : now + this.ahead];
  }

  // The last seconds before now.
  recent(table) {
    const now = this.isFixed(table) ? this.range(table)[1] : this.now(table);
    return [now - RECENT_S, now];
  }

  toggle() {
    if (this.fixed.size) this.live();
    else this.freeze();
  }

  freeze() {
    for (const table of window.navHost.tables.values()) this.fixed.set(table.layout.timeTitle, this.range(table));
    this.show();
  }

  // A stretch of one clock; tables of another clock go on.
  zoom(start, stop, clock) {
    this.fixed = new Map([[clock, [start, stop]]]);
    this.show();
  }

  live() {
    this.fixed.clear();
    this.show();
  }

  show() {
    byId("pause").textContent = this.fixed.size ? "Live" : "Pause";
    byId("held").hidden = !this.fixed.size;
    byId("pause").setAttribute("aria-pressed", String(this.fixed.size > 0));
    this.changed();
  }
}
