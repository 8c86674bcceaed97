// Which legs can be cut in a material: holes have a wall between them, as in drawings/outlines.py.
//
// `cutting` of a design comes from bench.py: {material, holes: of each body {joint: radius}, feet: of
// each body the toes that it carries, hub: {away, radius} of the two screws beside the crank's axis,
// foot: {radius, away: [[first, second] ...], parallel} of the screws of a tread, which are behind one
// another where its sides meet at less than `parallel`, wall: least material between two holes, rim: a
// plate's rim beyond the joints is no wider than this share of its height, sheet: longer and shorter
// side of the sheet that parts are cut from, widths: widths of the frame's bar and of other bars}. All
// lengths are in metres.

import { assemble, isTooHeavy, pointsOf } from "./linkage.js";

const away = ([x, y], [u, v]) => Math.hypot(u - x, v - y);
const towards = ([x, y], [dx, dy], way) => [x + way * dx, y + way * dy];

function direction(from, to) {
  const span = away(from, to);
  return [(to[0] - from[0]) / span, (to[1] - from[1]) / span];
}

/** Name of a body of a design that cannot be cut with these lengths; "" if all can. */
export function uncut(design, lengths) {
  const linkage = assemble(design, lengths);
  if (linkage.fault) return linkage.fault;
  const { wall } = design.cutting;
  const tooNear = (holes) =>
    holes.some((hole, k) =>
      holes
        .slice(k + 1)
        .some((other) => away(hole.at, other.at) < hole.radius + other.radius + wall),
    );
  const wrong = (_, k) => {
    const points = pointsOf(linkage, k);
    const isNear = holesOf(design, points, k).some(tooNear);
    return isNear || isTooHeavy(linkage, k) || isTooLarge(design.cutting, points, k);
  };
  return linkage.bodies.find(wrong)?.name ?? "";
}

/** Whether a part does not fit its sheet, lying as low as it can. */
function isTooLarge({ sheet, widths, hub, rim: share }, points, k) {
  const joints = [...points.values()];
  let [length, height] = [0, Number.POSITIVE_INFINITY];
  for (const [i, from] of joints.entries())
    for (const to of joints.slice(i + 1)) {
      const [c, s] = direction(from, to);
      const across = rangeOf(joints.map(([x, y]) => c * y - s * x));
      if (across < height)
        [length, height] = [rangeOf(joints.map(([x, y]) => c * x + s * y)), across];
    }
  const rim = 2 * Math.max(widths[k === 0 ? 0 : 1] / 2, share * height);
  const more = k === 1 ? hub.away : 0;
  return length + more + rim > sheet[0] || height + rim > sheet[1];
}

const rangeOf = (values) => Math.max(...values) - Math.min(...values);

/** Holes {at, radius} of a body: of each order that a tread's screws may have. */
function holesOf({ cutting }, points, k) {
  const { holes, feet, hub } = cutting;
  const joints = Object.entries(holes[k]).map(([joint, radius]) => ({
    at: points.get(joint),
    radius,
  }));
  if (k === 1) {
    const [axis, pin] = points.values();
    for (const way of [hub.away, -hub.away])
      joints.push({ at: towards(axis, direction(axis, pin), way), radius: hub.radius });
  }
  const others = feet[k].map((toe) => screwsOf(cutting.foot, toe, points));
  return [0, 1].map((order) => [...joints, ...others.flatMap((screws) => screws[order])]);
}

/** Holes of the screws of a toe's tread, in both orders. */
function screwsOf({ radius, away: reaches, parallel }, toe, points) {
  const at = points.get(toe);
  if (reaches.length === 0) return [0, 1].map(() => [{ at, radius }]);
  const ways = [...points].filter(([joint]) => joint !== toe).map(([, to]) => direction(at, to));
  const [first, second, angle] = widest(ways);
  const [near, far] = reaches[angle > parallel ? 0 : 1];
  return [
    [first, second],
    [second, first],
  ].map(([way, other]) => [
    { at: towards(at, way, near), radius },
    { at: towards(at, other, far), radius },
  ]);
}

/** The two directions that are furthest from one another, and the angle between them. */
function widest(ways) {
  let most = [ways[0], ways[0], 0];
  for (const [i, a] of ways.entries())
    for (const b of ways.slice(i + 1)) {
      const angle = Math.abs(Math.atan2(a[0] * b[1] - a[1] * b[0], a[0] * b[0] + a[1] * b[1]));
      if (angle > most[2]) most = [a, b, angle];
    }
  return most;
}
