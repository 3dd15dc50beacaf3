// One table of the line: its description, and the rows that the curves need now.

const LONG_GAP_STEPS = 2.5;
// After so many rows behind a thinned window the window is asked for anew.
const MOST_APPENDED = 4000;

export class Table {
  constructor(layout) {
    this.layout = layout;
    this.index = new Map(layout.names.map((name, index) => [name, index]));
    this.columns = layout.names.map(() => []);
    this.last = null;
    this.heardAt = 0;
    this.step = Infinity;
    this.appended = 0;
    this.wanted = null;
    this.asked = false;
  }

  get x() { return this.columns[0]; }
  get lastX() { return this.last ? this.last[0] : undefined; }
  get isStale() { return this.appended > MOST_APPENDED; }

  column(name) { return this.columns[this.index.get(name)]; }

  // The newest row: name -> number.
  value(name, row = this.last) { return row?.[this.index.get(name)]; }

  // Takes new rows; the curves get them only where they follow the line.
  append(columns, isFollowed) {
    const count = columns[0].length;
    for (let row = 0; isFollowed && row < count; row++) this.appendRow(columns, row);
    this.appended += count;
    this.last = columns.map(values => values[count - 1]);
  }

  appendRow(columns, row) {
    const x = columns[0][row], x0 = this.x.at(-1), step = x - x0;
    if (step > 0) {
      if (step > LONG_GAP_STEPS * this.step) this.breakAt(x0 + this.step);
      else this.step = Math.min(this.step, step);
    }
    for (let index = 0; index < columns.length; index++) {
      const value = columns[index][row];
      this.columns[index].push(Number.isNaN(value) ? null : value);
    }
  }

  breakAt(x) {
    this.columns.forEach((values, index) => values.push(index ? null : x));
  }

  // Forgets rows before a time, now and then.
  trim(start) {
    const half = this.x.length >> 1;
    if (half > MOST_APPENDED && this.x[half] < start) for (const values of this.columns) values.splice(0, half);
  }

  // A window of the history takes the place of all rows up to its end, and of those behind unless they follow it.
  replace(columns, isFollowed) {
    const end = columns[0].at(-1);
    const after = !isFollowed ? Infinity : end === undefined ? 0 : this.x.findLastIndex(x => x <= end) + 1;
    this.columns = columns.map((values, index) => {
      const base = Array.from(values, value => (Number.isNaN(value) ? null : value));
      return base.concat(this.columns[index].slice(after));
    });
    // Curves break at rows of nothing; the time of such a row lies between its neighbours.
    this.columns[0].forEach((x, row, xs) => { if (x === null) xs[row] = xs[row - 1] ?? xs[row + 1]; });
    this.appended = 0;
    if (!this.last && isFollowed && end !== undefined) this.last = columns.map(values => values.at(-1));
  }

  // The rows between two times, as [first, behind the last].
  between(start, stop) {
    return [firstFrom(this.x, start), firstFrom(this.x, stop, true)];
  }

  row(number) { return this.columns.map(values => values[number]); }
}

// The first place of ascending numbers that is not below (or is above) a value.
export function firstFrom(xs, value, above = false) {
  let low = 0, high = xs.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (xs[middle] < value || (above && xs[middle] === value)) low = middle + 1;
    else high = middle;
  }
  return low;
}
