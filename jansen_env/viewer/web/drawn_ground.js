// Grounds that are drawn with the pointer: level up to the robot, then as drawn, in whole centimetres.

const LEVEL = 60; // cm from the start, which stay level
const SPACING = 3; // cm between two points, at least
const MOST = 300; // points
const FARTHEST = 100_000; // cm

/**
 * Return the text of a link, such as "64,2,67,5", for a stroke [[x, y] ...] in m from the robot.
 * `steepest` is the largest slope that a ground may have.
 */
export function textOf(stroke, steepest) {
  const points = [[LEVEL, 0]];
  for (const [x, y] of stroke) {
    const [before, height] = points.at(-1);
    const step = Math.round(100 * x) - before;
    if (step < SPACING || points.length > MOST) continue;
    const most = Math.floor(steepest * step);
    const rise = Math.round(100 * y) - height;
    points.push([before + step, height + Math.min(Math.max(rise, -most), most)]);
  }
  return points.slice(1).flat().join(",");
}

/** Return the points of such a text, in m; throw an error if the text is not valid. */
export function pointsOf(text, steepest) {
  const numbers = text.split(",").map(Number);
  const points = [[-100, 0], [LEVEL, 0]]; // biome-ignore format: points
  for (let i = 0; i < numbers.length; i += 2) points.push([numbers[i], numbers[i + 1]]);
  const fits = points.slice(1).every(([x, y], i) => {
    const [before, height] = points[i];
    const whole = Number.isInteger(x) && Number.isInteger(y) && x > before && x <= FARTHEST;
    return whole && Math.abs(y - height) <= steepest * (x - before);
  });
  if (!fits || points.length > MOST + 2)
    throw new Error(
      `The ground in the link must consist of at most ${MOST} points x,y in whole centimetres, ` +
        `whose x increases from above ${LEVEL} to at most ${FARTHEST}, and whose slopes are at ` +
        `most ${steepest}, got "${text.slice(0, 40)}".`,
    );
  const [end, level] = points.at(-1);
  return [...points, [end + 100, level]].map((point) => point.map((value) => value / 100));
}
