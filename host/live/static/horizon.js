// The attitude indicator: horizon, pitch ladder, roll scale, and the heading below.

import {wrapped} from "./format.js";

const RADIANS = Math.PI / 180;
const PIXELS_PER_DEG = 3;

export function fitted(canvas) {
  const ratio = devicePixelRatio || 1, {width, height} = canvas.getBoundingClientRect();
  canvas.width = Math.round(width * ratio);
  canvas.height = Math.round(height * ratio);
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  return [context, width, height];
}

export function drawHorizon(canvas, pitch, roll, heading) {
  const [context, width, height] = fitted(canvas), style = getComputedStyle(canvas);
  const colour = name => style.getPropertyValue(name);
  const tape = 26, middle = (height - tape) / 2;
  context.font = "11px system-ui, sans-serif";
  context.textAlign = "center";
  context.textBaseline = "middle";
  context.save();
  context.beginPath();
  context.roundRect(0, 0, width, height - tape, 8);
  context.clip();
  context.translate(width / 2, middle);
  context.rotate(-roll * RADIANS);
  const horizon = pitch * PIXELS_PER_DEG, far = 2 * (width + height);
  context.fillStyle = colour("--sky");
  context.fillRect(-far, -far, 2 * far, far + horizon);
  context.fillStyle = colour("--ground");
  context.fillRect(-far, horizon, 2 * far, far);
  context.strokeStyle = context.fillStyle = "#fff";
  stroke(context, [[-far, horizon], [far, horizon]], 1.5);
  for (let degrees = -90; degrees <= 90; degrees += 5) {
    const y = horizon - degrees * PIXELS_PER_DEG, half = degrees % 10 ? 14 : 28;
    if (!degrees || Math.abs(y) > middle - 22) continue;
    stroke(context, [[-half, y], [half, y]], 1);
    if (degrees % 10 === 0) {
      context.fillText(Math.abs(degrees), -half - 12, y);
      context.fillText(Math.abs(degrees), half + 12, y);
    }
  }
  context.rotate(roll * RADIANS);
  drawRoll(context, roll, middle - 8);
  context.strokeStyle = "#ffd34d";
  stroke(context, [[-60, 0], [-22, 0], [-11, 11], [0, 0], [11, 11], [22, 0], [60, 0]], 3);
  context.restore();
  drawTape(context, width, height, tape, heading, colour("--text"), colour("--soft"));
}

function drawRoll(context, roll, radius) {
  for (const degrees of [-60, -45, -30, -20, -10, 0, 10, 20, 30, 45, 60]) {
    const angle = (degrees - 90) * RADIANS, long = degrees % 30 ? 5 : 9;
    const at = distance => [distance * Math.cos(angle), distance * Math.sin(angle)];
    stroke(context, [at(radius), at(radius - long)], 1.2);
  }
  const angle = (-roll - 90) * RADIANS, along = (distance, side) => [
    distance * Math.cos(angle + side), distance * Math.sin(angle + side)];
  context.fillStyle = "#ffd34d";
  context.beginPath();
  for (const point of [along(radius - 10, 0), along(radius - 19, 0.07), along(radius - 19, -0.07)]) context.lineTo(...point);
  context.fill();
}

function drawTape(context, width, height, tape, heading, text, soft) {
  const scale = width / 90, y = height - tape / 2 + 3;
  for (let degrees = Math.ceil((heading - 45) / 10) * 10; degrees <= heading + 45; degrees += 10) {
    const whole = wrapped(degrees, 0), name = {0: "N", 90: "E", 180: "S", 270: "W"}[whole];
    if (Math.abs(degrees - heading) < 13) continue;
    context.fillStyle = name ? text : soft;
    context.fillText(name ?? String(whole).padStart(3, "0"), width / 2 + (degrees - heading) * scale, y);
  }
  context.font = "bold 13px system-ui, sans-serif";
  context.fillStyle = text;
  context.fillText(`${wrapped(heading, 0).toFixed(1).padStart(5, "0")}°`, width / 2, y);
}

function stroke(context, points, width) {
  context.lineWidth = width;
  context.beginPath();
  for (const point of points) context.lineTo(...point);
  context.stroke();
}
