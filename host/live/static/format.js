// Numbers as people read them.

const DECIMALS = {deg: 3, "m/s": 3, m: 2, s: 3, "deg/s": 4, cycles: 0, Hz: 2};
const POSITION_DECIMALS = 7;
const MOST_DECIMALS = 5;
const MOST_PLAIN = 1e7;

export function number(value, unit = "", name = "") {
  if (value === null || value === undefined || Number.isNaN(value)) return "–";
  if (name === "heading") value = wrapped(value, 0);
  if (name === "longitude") value = wrapped(value, -180);
  if (name === "latitude" || name === "longitude") return value.toFixed(POSITION_DECIMALS);
  if (name.includes("_sum_")) return value.toExponential(4);
  if (unit in DECIMALS && DECIMALS[unit]) return value.toFixed(DECIMALS[unit]);
  return Number.isInteger(value) ? grouped(value) : String(Number(value.toPrecision(6)));
}

// A number of any size in three digits.
export function magnitude(value) {
  return value === null || value === undefined ? "–" : String(Number(value.toPrecision(3)));
}

// Labels of an axis, with the decimals that its step needs.
export function ticks(values, step) {
  const largest = Math.max(...values.map(Math.abs)), decimals = decimalsOf(step);
  if (largest < MOST_PLAIN && decimals <= MOST_DECIMALS) return values.map(value => grouped(value, decimals));
  const digits = Math.max(0, Math.ceil(Math.log10(largest / step)));
  return values.map(value => (value ? value.toExponential(digits) : "0"));
}

function decimalsOf(step) {
  const isWhole = decimals => Math.abs(step * 10 ** decimals - Math.round(step * 10 ** decimals)) < 1e-6;
  for (let decimals = 0; decimals <= MOST_DECIMALS; decimals++) if (step * 10 ** decimals >= 0.999 && isWhole(decimals)) return decimals;
  return Infinity;
}

// An angle in [least, least + 360).
export function wrapped(value, least) {
  return value - 360 * Math.floor((value - least) / 360);
}

export function grouped(value, decimals = 0) {
  return value.toLocaleString("en-GB", {minimumFractionDigits: decimals, maximumFractionDigits: decimals}).replace(/^-(?=[0.]+$)/, "");
}

export function bytes(count) {
  return count < 1e4 ? `${count} B` : count < 1e7 ? `${(count / 1e3).toFixed(1)} kB` : `${(count / 1e6).toFixed(1)} MB`;
}

export function duration(seconds) {
  if (seconds < 60) return `${seconds.toFixed(1)} s`;
  const whole = Math.floor(seconds), two = value => String(value).padStart(2, "0");
  const minutes = Math.floor(whole / 60) % 60;
  if (whole < 3600) return `${minutes}:${two(whole % 60)} min`;
  return `${Math.floor(whole / 3600)}:${two(minutes)}:${two(whole % 60)} h`;
}
