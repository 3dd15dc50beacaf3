// The track: longitude and latitude at one scale in metres.

import {fitted} from "./horizon.js";

const METRES_PER_DEG = 111_320;
const MARGIN = 26;
const LEAST_SPAN_M = 2;

export function drawTrack(canvas, longitudes, latitudes, heading) {
  const [context, width, height] = fitted(canvas), style = getComputedStyle(canvas);
  const points = [];
  for (let row = 0; row < latitudes.length; row++)
    points.push(latitudes[row] === null || longitudes[row] === null ? null : [longitudes[row], latitudes[row]]);
  const known = points.filter(point => point);
  if (!known.length) return;
  const [west, east] = extent(known, 0), [south, north] = extent(known, 1);
  const shrink = Math.cos((south + north) / 2 * Math.PI / 180);
  const span = Math.max(LEAST_SPAN_M, Math.max((east - west) * shrink, north - south) * METRES_PER_DEG);
  const scale = (Math.min(width, height) - 2 * MARGIN) / span;
  const place = ([longitude, latitude]) => [
    width / 2 + (longitude - (west + east) / 2) * shrink * METRES_PER_DEG * scale,
    height / 2 - (latitude - (south + north) / 2) * METRES_PER_DEG * scale];
  drawScale(context, width, height, scale, style.getPropertyValue("--soft"));
  context.strokeStyle = style.getPropertyValue("--curve-0");
  context.lineWidth = 1.5;
  context.beginPath();
  let isDown = false;
  for (const point of points) {
    if (point) context[isDown ? "lineTo" : "moveTo"](...place(point));
    isDown = Boolean(point);
  }
  context.stroke();
  drawShip(context, place(known.at(-1)), heading, style.getPropertyValue("--bad"));
}

function extent(points, index) {
  let low = Infinity, high = -Infinity;
  for (const point of points) {
    low = Math.min(low, point[index]);
    high = Math.max(high, point[index]);
  }
  return [low, high];
}

function drawShip(context, [x, y], heading, colour) {
  context.save();
  context.translate(x, y);
  context.rotate((heading ?? 0) * Math.PI / 180);
  context.fillStyle = colour;
  context.beginPath();
  for (const point of [[0, -9], [5, 6], [0, 3], [-5, 6]]) context.lineTo(...point);
  context.fill();
  context.restore();
}

// A bar of a round length.
function drawScale(context, width, height, scale, colour) {
  const most = width / 3 / scale, power = 10 ** Math.floor(Math.log10(most));
  const length = [5, 2, 1].map(digit => digit * power).find(candidate => candidate <= most) ?? power;
  const left = 10, bottom = height - 8;
  context.strokeStyle = context.fillStyle = colour;
  context.lineWidth = 1;
  context.beginPath();
  for (const [x, y] of [[0, -5], [0, 0], [length * scale, 0], [length * scale, -5]]) context.lineTo(left + x, bottom + y);
  context.stroke();
  context.font = "11px system-ui, sans-serif";
  context.fillText(length >= 1000 ? `${length / 1000} km` : `${length >= 1 ? length : length.toPrecision(1)} m`, left, bottom - 9);
  context.fillText("N ↑", width - 28, 14);
}
