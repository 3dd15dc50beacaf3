// The numbers of now: fields of each table with their units, and the line's books.

import {AMPLITUDE} from "./spectrum.js";
import {bytes, duration, grouped, number} from "./format.js";

// A narrow screen shows the curves first.
const WIDE = "(min-width: 52rem)";

export class Readouts {
  constructor(table, room) {
    this.table = table;
    const section = document.createElement("details"), title = document.createElement("summary"), list = document.createElement("dl");
    section.open = matchMedia(WIDE).matches;
    title.textContent = table.layout.name;
    this.cells = Object.entries(table.layout.fields).filter(isShown).map(([name, field]) => {
      const cell = row(list, name, field.unit, field.meaning);
      cell.dataset.field = `${table.layout.name}.${name}`;
      return [name, field.unit, cell];
    });
    section.append(title, list);
    room.append(section);
  }

  show(values) {
    for (const [name, unit, cell] of this.cells) {
      const text = number(this.table.value(name, values), unit, name);
      if (cell.textContent !== text) cell.textContent = text;
    }
  }
}

function row(list, name, unit, meaning = "") {
  const term = document.createElement("dt"), cell = document.createElement("dd"), after = document.createElement("dd");
  term.textContent = name;
  term.title = meaning;
  after.textContent = unit;
  after.className = "unit";
  list.append(term, cell, after);
  return cell;
}

const LINE_ROWS = {
  frames: ["frames", "", status => grouped(status.frames)],
  lost: ["lost", "", status => grouped(status.lost)],
  damaged: ["damaged", "", status => grouped(status.damaged)],
  skipped: ["bytes of no frame", "", status => grouped(status.skipped)],
  bytes: ["received", "", status => bytes(status.bytes)],
  rate: ["rate", "B/s", status => (status.ageS === null ? "–" : grouped(status.bytesPerS))],
  age: ["last frame", "s ago", status => status.ageS?.toFixed(1) ?? "–"],
  elapsed: ["recorded for", "", status => duration(status.elapsedS)],
  sessions: ["sessions", "", status => grouped(status.sessions)],
  log: ["log", "", status => status.log],
};

// The amplitudes of a spectrum are a curve.
function isShown([name, field]) {
  return field.kind === "quantity" && !AMPLITUDE.test(name);
}

export class LineBook {
  constructor(list) {
    this.cells = Object.entries(LINE_ROWS).map(([key, [name, unit, text]]) => {
      const cell = row(list, name, unit);
      cell.dataset.line = key;
      return [cell, text];
    });
  }

  show(status) {
    for (const [cell, text] of this.cells) cell.textContent = text(status);
  }
}

// The words of a field's value: the set flags, or the one word of an enumeration.
export function words(field, value) {
  if (value === null || value === undefined) return [];
  if (field.kind === "flags") return field.words.filter((_, bit) => Math.floor(value / 2 ** bit) % 2);
  return [field.words[value] || `value ${value}`];
}
