// Closes a one-crank linkage for any crank angle, and measures its toes' paths.
//
// The closure is that of jansen_env/robot/kinematics.py, the lengths' names are those of
// jansen_env/robot/lengths.py; a test compares both with this file. Chassis frame: crank axis at the
// origin, +x the walking direction. Metres and radians.
//
// A design comes from bench.py: {joints, bodies: [[name, joints] ...], kinds: of each body "Bar",
// "Triangle" or "Plate", dyads: [[joint, start, end, branch] ...], toes, legs: [[side, phase] ...],
// turn: angle of the frame's first edge in the frame's own axes, lengths: {name: value}}.

export const SAMPLES = 720; // crank angles of a turn; the legs' phases are multiples of their step
const NEAR = 0.01; // of the standing height: so far above the ground a toe is in stance

const sub = ([a, b], [c, d]) => [a - c, b - d];
const add = ([a, b], [c, d]) => [a + c, b + d];
const times = ([a, b], [c, d]) => [a * c - b * d, a * d + b * c]; // of complex numbers
const unit = (angle) => [Math.cos(angle), Math.sin(angle)];

/** Names of a body's lengths. */
export function lengthNames(design, body) {
  const [name, joints] = design.bodies[body];
  if (design.kinds[body] === "Bar") return [name];
  if (design.kinds[body] === "Triangle")
    return [0, 1, 2].map((k) => `${name}_${joints[k]}${joints[(k + 1) % 3]}`);
  const others = [...joints.slice(2)].flatMap((j) => [`${name}_${j}_along`, `${name}_${j}_across`]);
  return [`${name}_${joints.slice(0, 2)}`, ...others];
}

/** Lengths of a body by name from its joints' places; of the frame its angle, too. */
export function lengthsOf(design, body, places) {
  const edge = sub(places[1], places[0]);
  const span = Math.hypot(...edge);
  let values = [span];
  if (design.kinds[body] === "Triangle") {
    values = [0, 1, 2].map((k) => Math.hypot(...sub(places[(k + 1) % 3], places[k])));
  } else if (design.kinds[body] === "Plate") {
    const along = [edge[0] / span, -edge[1] / span];
    for (const joint of places.slice(2)) values.push(...times(sub(joint, places[0]), along));
  }
  const lengths = Object.fromEntries(lengthNames(design, body).map((name, k) => [name, values[k]]));
  if (body === 0) lengths.frame_angle = Math.atan2(edge[1], edge[0]) - design.turn;
  return lengths;
}

/** Joints of a body in axes of its own: the first at the origin, the second on the x axis. */
function shapeOf(design, body, lengths) {
  const [a, ...rest] = lengthNames(design, body).map((name) => lengths[name]);
  const points = [[0, 0], [a, 0]]; // biome-ignore format: pairs
  if (design.kinds[body] === "Triangle") {
    const [b, c] = rest;
    const x = (a * a + c * c - b * b) / (2 * a);
    points.push([x, Math.sqrt(c * c - x * x)]);
  } else for (let k = 0; k < rest.length; k += 2) points.push([rest[k], rest[k + 1]]);
  return points;
}

/** A linkage of some lengths, ready for `place`; `fault`: a body whose sides form no triangle. */
export function assemble(design, lengths) {
  const bodies = design.bodies.map(([name, joints], body) => {
    const points = shapeOf(design, body, lengths);
    return { name, joints: [...joints], points: new Map(points.map((p, k) => [joints[k], p])) };
  });
  const between = (start, end) => {
    const body = bodies.find(({ points }) => points.has(start) && points.has(end));
    return { body, span: Math.hypot(...sub(body.points.get(start), body.points.get(end))) };
  };
  const dyads = design.dyads.map(([joint, start, end, branch]) => {
    const [first, second] = [between(joint, start), between(joint, end)];
    const plates = [first.body, second.body].filter((body) => body.joints.length > 2);
    return { joint, start, end, branch, first: first.span, second: second.span, plates };
  });
  const fault = bodies.find(({ points }) => [...points.values()].flat().some(Number.isNaN))?.name;
  return { design, bodies, dyads, heading: lengths.frame_angle + design.turn, fault };
}

/**
 * Places of the joints of a fore leg whose crank stands at `psi`: {at: {joint: [x, y]}, open}.
 * `open`: the dyad that does not close, with the `span` that its links cannot reach, or null.
 */
export function place(linkage, psi) {
  const { bodies, dyads, heading } = linkage;
  const at = { [bodies[1].joints[0]]: [0, 0] };
  addJoints(at, bodies[0], unit(heading));
  addJoints(at, bodies[1], unit(psi));
  for (const dyad of dyads) {
    const { joint, start, end, branch, first, second, plates } = dyad;
    const [dx, dy] = sub(at[end], at[start]);
    const span = Math.hypot(dx, dy);
    const along = (span ** 2 + first ** 2 - second ** 2) / (2 * span);
    const across2 = first ** 2 - along ** 2;
    if (!(across2 > 0)) return { at, open: { ...dyad, span, psi } };
    const leg = [along / span, (branch * Math.sqrt(across2)) / span];
    at[joint] = add(at[start], times([dx, dy], leg));
    for (const body of plates) {
      const [i, j] = body.joints.filter((name) => name in at);
      const [u, v] = sub(body.points.get(j), body.points.get(i));
      const length2 = u * u + v * v;
      addJoints(at, body, times(sub(at[j], at[i]), [u / length2, -v / length2]));
    }
  }
  return { at, open: null };
}

/** Add the joints of a body whose direction is known, and one of its joints. */
function addJoints(at, { joints, points }, direction) {
  const known = joints.find((joint) => joint in at);
  for (const joint of joints) {
    if (joint in at) continue;
    at[joint] = add(at[known], times(sub(points.get(joint), points.get(known)), direction));
  }
}

/** Places of a leg of the robot at crank angle `psi`; a back leg is mirrored. */
export function placeLeg(linkage, [side, phase], psi) {
  if (side === "fore") return place(linkage, psi + phase);
  const { at, open } = place(linkage, Math.PI - psi - phase);
  for (const joint of Object.keys(at)) at[joint] = [-at[joint][0], at[joint][1]];
  return { at, open };
}

/** Crank angle of a sample. */
export const angleOf = (k) => -Math.PI + (2 * Math.PI * k) / SAMPLES;

/** A fore leg at all samples of a turn. */
export const turnOf = (linkage) =>
  Array.from({ length: SAMPLES }, (_, k) => place(linkage, angleOf(k)));

/** Where a turn does not close: its worst opening, and angles `from` and `to` around it, or null. */
export function openingOf(turn) {
  const lack = ({ span, first, second }) =>
    Math.abs(span ** 2 - first ** 2 - second ** 2) / (first * second);
  const open = turn.map((sample) => sample.open);
  if (!open.some(Boolean)) return null;
  const worst = open.filter(Boolean).reduce((a, b) => (lack(b) > lack(a) ? b : a));
  const reach = (way) => {
    let k = open.indexOf(worst);
    for (let n = 0; n < SAMPLES && open[(k + way + SAMPLES) % SAMPLES]; n++) k += way;
    return angleOf(k);
  };
  return { ...worst, whole: open.every(Boolean), from: reach(-1), to: reach(1) };
}

/**
 * Numbers of a robot that is kept level and stands on its lowest toe, over a turn that closes.
 *
 * {standing: mean height of the crank axis; heave: range of this height; lift: the most that a toe
 * comes above the lowest one; advance: in a counter-clockwise turn; stance: share of the turn in
 * which a toe is on the ground, mean of all toes; grounded: for each toe of the first leg, whether
 * it is at each sample; dead: {sine, joint, psi} where two links come nearest to one line}.
 */
export function measure(design, turn) {
  const toes = pathsOf(design, turn);
  const lowest = turn.map((_, k) => Math.min(...toes.map((toe) => toe[k][1])));
  const highest = turn.map((_, k) => Math.max(...toes.map((toe) => toe[k][1])));
  const sampled = lowest.filter((_, k) => k % 2 === 0); // those of zoo.py: standing_height
  const standing = -sampled.reduce((sum, y) => sum + y, 0) / sampled.length;
  const grounded = toes.map((toe) => toe.map(([, y], k) => y - lowest[k] <= NEAR * standing));
  let advance = 0;
  for (let k = 0; k < SAMPLES; k++) {
    const next = (k + 1) % SAMPLES;
    const height = (toe) => toe[k][1] + toe[next][1];
    const foot = toes.reduce((a, b) => (height(b) < height(a) ? b : a));
    advance -= foot[next][0] - foot[k][0];
  }
  return {
    standing,
    heave: Math.max(...lowest) - Math.min(...lowest),
    lift: Math.max(...highest.map((y, k) => y - lowest[k])),
    advance,
    stance: grounded.flat().filter(Boolean).length / (SAMPLES * toes.length),
    grounded: grounded.slice(0, design.toes.length),
    dead: deadPoint(design, turn),
  };
}

/** Paths of all toes, leg by leg: at each sample [x, y]. */
function pathsOf({ legs, toes }, turn) {
  return legs.flatMap(([side, phase]) => {
    const ahead = Math.round((phase / (2 * Math.PI)) * SAMPLES);
    const fore = side === "fore";
    const sample = (k) => ((fore ? k + ahead : 1.5 * SAMPLES - k - ahead) + 2 * SAMPLES) % SAMPLES;
    return [...toes].map((toe) =>
      turn.map((_, k) => {
        const [x, y] = turn[sample(k)].at[toe];
        return [fore ? x : -x, y];
      }),
    );
  });
}

function deadPoint(design, turn) {
  let nearest = { sine: Number.POSITIVE_INFINITY };
  for (const [joint, start, end] of design.dyads)
    turn.forEach(({ at }, k) => {
      const [[a, b], [c, d]] = [sub(at[joint], at[start]), sub(at[joint], at[end])];
      const sine = Math.abs(a * d - b * c) / (Math.hypot(a, b) * Math.hypot(c, d));
      if (sine < nearest.sine) nearest = { sine, joint, psi: angleOf(k) };
    });
  return nearest;
}
