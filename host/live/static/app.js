// The page: messages in, curves and numbers out.

import {chartsOf} from "./charts.js";
import {buildCommands} from "./commands.js";
import {drawHorizon} from "./horizon.js";
import {Link} from "./link.js";
import {LineBook, Readouts, words} from "./readouts.js";
import {Replay} from "./replay.js";
import {isSpectrum, Spectrum} from "./spectrum.js";
import {Table} from "./table.js";
import {View} from "./view.js";

const DRAW_PERIOD_MS = 50;
const POINTS = 4000;
const LEAST_STOPPED_MS = 600;
const STOPPED_PERIODS = 4;
const NOTICE_MS = 8000;
const SHOWN_EVENTS = 100;

const byId = id => document.getElementById(id);
const tables = new Map(), shows = new Map(), marks = [];
const view = new View(() => renew());
const book = new LineBook(byId("link"));
let hello = {mode: "line", title: "", log: ""}, status = null, heardAt = null, statusAt = 0, dirty = true, drawnAt = 0;
let framePeriodMs = 0, noticeTimer = 0;

const link = new Link(hear, () => { dirty = true; });
const replay = new Replay(view, () => navigation() ?? tables.values().next().value);

const surroundings = {
  range: table => view.range(table),
  zoom: (start, stop, clock) => view.zoom(start, stop, clock),
  live: () => view.live(),
  recent: table => view.recent(table),
  marks: table => marks.filter(mark => table.layout.table in mark.times).map(({times, text}) => ({x: times[table.layout.table], text})),
  sessions: () => status?.sessionStarts ?? [],
  value: (table, name) => table.value(name, rowOfNow(table)),
};

const heard = {
  hello(message) {
    hello = message;
    tables.clear();
    shows.clear();
    byId("charts").replaceChildren();
    byId("readouts").replaceChildren();
    byId("events").replaceChildren();
    byId("exported").replaceChildren();
    marks.length = 0;
    byId("title").textContent = hello.title;
    document.title = `${hello.title} – nav-host`;
    byId("commanding").hidden = !hello.commands?.length;
    byId("marking").hidden = hello.mode === "log";
    buildCommands(byId("commands"), hello.commands ?? [], message => ask(message));
    replay.begin(hello);
  },
  layout(message) {
    const table = new Table(message);
    tables.set(message.table, table);
    const room = document.createElement("div");
    room.style.display = "contents";
    byId("charts").append(room);
    const show = {readouts: new Readouts(table, byId("readouts")), charts: [], spectrum: null};
    if (isSpectrum(message)) show.charts.push(show.spectrum = new Spectrum(table, room, surroundings));
    else show.charts = chartsOf(table, room, surroundings);
    shows.set(table, show);
    byId("exported").add(new Option(message.name, message.table, false, message.isNavigation));
    byId("exported").hidden = tables.size < 2;
  },
  ready() { renew(); },
  rows(message) {
    const table = tables.get(message.table);
    if (!table) return;
    table.heardAt = performance.now();
    if (table === (navigation() ?? table)) {
      if (heardAt) framePeriodMs = 0.9 * framePeriodMs + 0.1 * (table.heardAt - heardAt) / message.rows;
      heardAt = table.heardAt;
    }
    table.append(message.columns, !view.isFixed(table));
    if (!view.isFixed(table)) table.trim(view.range(table)[0]);
    // A thinned window that has grown long is asked for anew.
    if (table.isStale && !view.isFixed(table)) want(table);
    dirty = true;
  },
  window(message) {
    const table = tables.get(message.table);
    if (!table) return;
    table.asked = false;
    table.replace(message.columns, !view.isFixed(table) && hello.mode === "line");
    if (table.wanted) want(table);
    dirty = true;
  },
  status(message) {
    status = message;
    statusAt = performance.now();
    dirty = true;
  },
  event(message) { showEvent(message); },
  answer(message) { notice(message.text, message.isDone); },
  refused(message) { notice(message.text); },
};

function hear(message) {
  heard[message.kind]?.(message);
}

// A line that describes its frames anew gets another table: the one that was heard last counts.
function navigation() {
  return [...tables.values()].filter(table => table.layout.isNavigation).reduce((best, table) => (best?.heardAt > table.heardAt ? best : table), undefined);
}

function renew() {
  for (const table of tables.values()) want(table);
  dirty = true;
}

// Asks for the window of now, once the answer before has come.
function want(table) {
  table.wanted = shows.get(table)?.spectrum ? view.recent(table) : view.fetched(table);
  if (table.asked) return;
  const [start, stop] = table.wanted;
  table.asked = link.send({kind: "window", id: 0, table: table.layout.table, start, stop, points: POINTS});
  table.wanted = null;
}

function ask(message) {
  if (!link.send(message)) notice("not sent: no connection to the host");
}

function notice(text, isGood = false) {
  byId("notice").textContent = text;
  byId("notice").className = isGood ? "good" : "warn";
  byId("notice").hidden = false;
  clearTimeout(noticeTimer);
  noticeTimer = setTimeout(() => { byId("notice").hidden = true; }, NOTICE_MS);
}

function showEvent({timeMs, name, text, times}) {
  const item = document.createElement("li"), time = document.createElement("time");
  time.textContent = new Date(timeMs).toISOString().slice(11, 19);
  item.append(time, `${name} ${text}`);
  byId("events").prepend(item);
  while (byId("events").children.length > SHOWN_EVENTS) byId("events").lastChild.remove();
  if (name === "mark") marks.push({times, text});
  dirty = true;
}

// The row that the numbers show: the newest, or the one at the replay's place.
function rowOfNow(table) {
  if (hello.mode !== "log") return table.last;
  const [, behind] = table.between(-Infinity, view.now(table));
  return behind ? table.row(behind - 1) : table.row(0);
}

function stateOf() {
  if (!link.isOpen) return ["no connection to the host", "bad"];
  if (hello.mode === "log") return ["log", "good"];
  if (!status) return ["waiting", "warn"];
  if (!status.connected) return ["port away", "bad"];
  const ageS = age();
  if (ageS === null) return ["no frame yet", "warn"];
  const limitMs = Math.max(LEAST_STOPPED_MS, STOPPED_PERIODS * framePeriodMs);
  return 1000 * ageS > limitMs ? [`stopped: no frame for ${ageS.toFixed(1)} s`, "bad"] : ["live", "good"];
}

// Seconds since the last frame; null before any.
function age() {
  if (heardAt !== null) return (performance.now() - heardAt) / 1000;
  return tables.size && status ? status.silentS + (performance.now() - statusAt) / 1000 : null;
}

function showState() {
  const [text, kind] = stateOf(), pill = byId("state");
  pill.textContent = text;
  pill.className = `pill ${kind}`;
  document.body.classList.toggle("old", kind === "bad");
  byId("trouble").textContent = status?.trouble ?? "";
  if (status) book.show({...status, ageS: hello.mode === "log" ? null : age(), log: hello.log});
}

function showNavigation() {
  const table = navigation();
  byId("attitude").hidden = !table;
  if (!table) return;
  const row = rowOfNow(table), value = name => table.value(name, row) ?? 0;
  const {mode, flags} = table.layout.fields;
  if (mode) {
    byId("mode").hidden = false;
    byId("mode").textContent = words(mode, value("mode")).join();
  }
  const set = flags ? words(flags, value("flags")) : [];
  if (byId("flags").dataset.set !== set.join()) {
    byId("flags").dataset.set = set.join();
    byId("flags").replaceChildren(...set.map(word => Object.assign(document.createElement("span"), {className: "pill", textContent: word})));
  }
  if (row) drawHorizon(byId("horizon"), value("pitch"), value("roll"), value("heading"));
}

function draw(now) {
  requestAnimationFrame(draw);
  dirty = replay.advance(now, table => want(table), tables) || dirty;
  if (!dirty || now - drawnAt < DRAW_PERIOD_MS) return;
  drawnAt = now;
  dirty = false;
  showState();
  showNavigation();
  for (const [table, show] of shows) {
    show.readouts.show(rowOfNow(table));
    if (table.x.length) for (const chart of show.charts) if (chart.isSeen) chart.draw();
  }
}

function restyle(theme) {
  document.documentElement.dataset.theme = theme;
  for (const show of shows.values()) for (const chart of show.charts) chart.restyle();
  dirty = true;
}

const dark = matchMedia("(prefers-color-scheme: dark)");
const chosen = () => localStorage.getItem("theme") ?? (dark.matches ? "dark" : "light");
restyle(chosen());
dark.addEventListener("change", () => restyle(chosen()));
byId("theme").addEventListener("click", () => {
  localStorage.setItem("theme", document.documentElement.dataset.theme === "dark" ? "light" : "dark");
  restyle(chosen());
});
byId("marking").addEventListener("submit", event => {
  event.preventDefault();
  ask({kind: "mark", text: byId("remark").value.trim() || "mark"});
  byId("remark").value = "";
});
byId("export").addEventListener("click", () => {
  const table = tables.get(Number(byId("exported").value));
  if (!table) return notice("nothing to export: no frame yet");
  const [start, stop] = view.range(table);
  location.assign(`export.csv?${new URLSearchParams({table: table.layout.table, start, stop})}`);
});
addEventListener("scroll", () => { dirty = true; }, {passive: true});
addEventListener("resize", () => { dirty = true; });
setInterval(() => { dirty = true; }, 100);
requestAnimationFrame(draw);

// For those who look into the page with the browser's console.
window.navHost = {tables, shows, view, marks, link, surroundings};
