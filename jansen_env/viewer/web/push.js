// Pushes by the pointer: a drag, {x, y, toX, toY} in pixels, and a click, which is a short one.

export const CLICK_PUSH = 3; // N s
const PUSH_PER_PIXEL = 0.03; // N s of a drag
const CLICK = 6; // pixels, up to which a drag is a click

/** The impulse {x, y}, N s: along a drag, of a click towards the axis; null if it has no direction. */
export function impulseOf({ x, y, toX, toY }, axis, largest) {
  const isClick = Math.hypot(toX - x, toY - y) < CLICK;
  const [dx, dy] = isClick ? [axis[0] - x, axis[1] - y] : [toX - x, toY - y];
  const length = Math.hypot(dx, dy);
  if (length === 0) return null;
  const size = isClick ? CLICK_PUSH : Math.min(PUSH_PER_PIXEL * length, largest);
  return { x: (size * dx) / length, y: (-size * dy) / length };
}

/** Draw a drag as an arrow, with its impulse beside it. */
export function drawPush(ctx, { x, y, toX, toY }, largest, theme) {
  const length = Math.hypot(toX - x, toY - y);
  if (length < CLICK) return;
  ctx.strokeStyle = ctx.fillStyle = `rgb(${theme.crank.join(",")})`;
  ctx.lineWidth = 4;
  ctx.beginPath();
  ctx.moveTo(x, y);
  ctx.lineTo(toX, toY);
  ctx.stroke();
  const [ux, uy] = [(toX - x) / length, (toY - y) / length];
  ctx.beginPath();
  ctx.moveTo(toX + 12 * ux, toY + 12 * uy);
  ctx.lineTo(toX - 7 * uy, toY + 7 * ux);
  ctx.lineTo(toX + 7 * uy, toY - 7 * ux);
  ctx.fill();
  const size = Math.min(PUSH_PER_PIXEL * length, largest);
  ctx.fillStyle = `rgb(${theme.paper.join(",")})`;
  ctx.fillRect(x - 30, y + 10, 60, 22);
  ctx.fillStyle = `rgb(${theme.ink.join(",")})`;
  ctx.font = "14px system-ui, sans-serif";
  ctx.textAlign = "center";
  ctx.textBaseline = "middle";
  ctx.fillText(`${size.toFixed(1)} N s`, x, y + 21);
}
