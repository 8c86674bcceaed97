// Plots over time with a cursor. What does not move is painted once and kept.

import { css, digitsOf, line, mix } from "./scene.js";

const MARGIN = { left: 38, right: 6, top: 6, bottom: 16 }; // pixels around the curves

/** Steps of 1, 2 or 5 times a power of ten that cut a length into some `count` parts. */
function niceStep(length, count) {
  const rough = Math.max(length, 1e-9) / count;
  const power = 10 ** Math.floor(Math.log10(rough));
  return power * ([1, 2, 5].find((factor) => factor * power >= rough) ?? 10);
}

/** Least and most of some curves, with zero. */
function rangeOf(curves) {
  let [low, high] = [0, 0];
  for (const { values } of curves) {
    for (const value of values) {
      low = Math.min(low, value);
      high = Math.max(high, value);
    }
  }
  const pad = 0.06 * (high - low) || 1;
  return [low < 0 ? low - pad : 0, high > 0 ? high + pad : low < 0 ? 0 : pad];
}

/** Where times, s, and values of curves are on a plot of a size, pixels. */
function scalesOf(curves, duration, size) {
  const [low, high] = rangeOf(curves);
  const width = Math.max(size.width - MARGIN.left - MARGIN.right, 1);
  const height = Math.max(size.height - MARGIN.top - MARGIN.bottom, 1);
  const xOf = (time) => MARGIN.left + (time / duration) * width;
  const yOf = (value) => MARGIN.top + ((high - value) / (high - low)) * height;
  return { low, high, width, xOf, yOf };
}

/**
 * Draw curves over `duration`, s, on a context that is scaled to CSS pixels.
 *
 * curves: [{time, values, first, color: "first" or "second", dashed}], of values from the index
 * `first` on. colors: of these names.
 */
export function drawPlot(ctx, curves, duration, size, theme, colors) {
  const scales = scalesOf(curves, duration, size);
  ctx.font = "10px system-ui, sans-serif";
  ctx.lineJoin = "round";
  ctx.fillStyle = css(theme.muted);
  drawRows(ctx, scales, size, theme);
  drawTimes(ctx, scales, duration, size);
  for (const curve of curves) {
    ctx.strokeStyle = curve.dashed ? css(theme.muted) : colors[curve.color];
    drawCurve(ctx, scales, curve);
  }
}

/** Lines of values, with their numbers. */
function drawRows(ctx, { low, high, yOf }, size, theme) {
  ctx.textBaseline = "middle";
  ctx.textAlign = "right";
  ctx.lineWidth = 1;
  const rise = niceStep(high - low, 4);
  for (let i = Math.ceil(low / rise - 1e-9); i * rise <= high; i++) {
    const y = Math.round(yOf(i * rise)) + 0.5;
    ctx.strokeStyle = css(i === 0 ? mix(theme.muted, theme.sky, 0.4) : theme.grid);
    line(ctx, [MARGIN.left, y], [size.width - MARGIN.right, y]);
    ctx.fillText((i * rise).toFixed(digitsOf(rise)), MARGIN.left - 5, y);
  }
}

/** Times below the plot. */
function drawTimes(ctx, { width, xOf }, duration, size) {
  ctx.textBaseline = "alphabetic";
  const lapse = niceStep(duration, Math.max(2, width / 70));
  const count = Math.floor(duration / lapse + 1e-9);
  for (let i = 0; i <= count; i++) {
    ctx.textAlign = i === 0 ? "left" : "center";
    if (i === count) ctx.textAlign = "right";
    const text = (i * lapse).toFixed(digitsOf(lapse));
    ctx.fillText(i === count ? `${text} s` : text, xOf(i * lapse), size.height - 3);
  }
}

function drawCurve(ctx, { xOf, yOf }, { time, values, first, dashed }) {
  ctx.lineWidth = dashed ? 1.2 : 1.5;
  ctx.setLineDash(dashed ? [5, 4] : []);
  ctx.beginPath();
  for (let k = first; k < values.length; k++) ctx.lineTo(xOf(time[k]), yOf(values[k]));
  ctx.stroke();
}

/**
 * A plot on a canvas, of {@link drawPlot}'s curves, with a cursor.
 *
 * Returns {paint(theme, colors, size, ratio), draw(time), timeAt(x)}: the first when size or
 * colours change, the second at each frame; x in CSS pixels from the left.
 */
export function plotOn(canvas, curves, duration) {
  const ctx = canvas.getContext("2d");
  const still = document.createElement("canvas");
  let frame = { width: 0, height: 0, ratio: 1, theme: null };
  let scales = scalesOf(curves, duration, frame);

  function paint(theme, colors, size, ratio) {
    frame = { ...size, ratio, theme };
    scales = scalesOf(curves, duration, size);
    for (const layer of [canvas, still]) {
      layer.width = Math.round(size.width * ratio);
      layer.height = Math.round(size.height * ratio);
    }
    const to = still.getContext("2d");
    to.scale(ratio, ratio);
    drawPlot(to, curves, duration, size, theme, colors);
  }

  function draw(time, points, colors) {
    if (!still.width || !still.height) return; // not shown
    ctx.setTransform(1, 0, 0, 1, 0, 0);
    ctx.clearRect(0, 0, canvas.width, canvas.height);
    ctx.drawImage(still, 0, 0);
    ctx.scale(frame.ratio, frame.ratio);
    const x = scales.xOf(time);
    ctx.strokeStyle = css(frame.theme.ink, 0.55);
    ctx.lineWidth = 1;
    line(ctx, [x, MARGIN.top], [x, frame.height - MARGIN.bottom]);
    for (const { value, color } of points) {
      ctx.fillStyle = colors[color];
      ctx.beginPath();
      ctx.arc(x, scales.yOf(value), 3.2, 0, 2 * Math.PI);
      ctx.fill();
    }
  }

  const timeAt = (x) => Math.min(Math.max((x - MARGIN.left) / scales.width, 0), 1) * duration;
  return { paint, draw, timeAt };
}
