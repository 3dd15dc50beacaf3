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
    this.fixed = null;
    this.cursor = null;
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

  get isFollowing() { return this.fixed === null; }

  // The board time that is now: the newest, or the replay's.
  now(table) { return this.cursor ?? table.lastX ?? table.layout.last ?? 0; }

  range(table) {
    if (this.fixed) return this.fixed;
    const now = this.now(table), first = table.x[0] ?? now;
    const start = Math.max(now - this.span, first);
    return [start, Math.max(now, start + LEAST_SPAN_S)];
  }

  // What to ask the host for; numbers of JSON are finite.
  fetched(table) {
    if (this.fixed) {
      const [start, stop] = this.fixed, margin = MARGIN * (stop - start);
      return [start - margin, stop + margin];
    }
    const now = this.now(table), start = Math.max(now - this.span * (1 + MARGIN), -Number.MAX_VALUE);
    return [start, this.cursor === null || this.span === Infinity ? Number.MAX_VALUE : now + this.ahead];
  }

  // The last seconds before now.
  recent(table) {
    const now = this.fixed ? this.fixed[1] : this.now(table);
    return [now - RECENT_S, now];
  }

  toggle() {
    if (this.fixed) this.live();
    else this.freeze();
  }

  freeze() {
    const [table] = window.navHost.tables.values();
    if (table) this.zoom(...this.range(table));
  }

  zoom(start, stop) {
    this.fixed = [start, stop];
    this.show();
  }

  live() {
    this.fixed = null;
    this.show();
  }

  show() {
    byId("pause").textContent = this.fixed ? "Live" : "Pause";
    byId("held").hidden = !this.fixed;
    byId("pause").setAttribute("aria-pressed", String(Boolean(this.fixed)));
    this.changed();
  }
}
