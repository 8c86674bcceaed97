// Computes and measures a leg over a turn of its crank with the engine's kernels.
//
// bench.py writes a design: {robot: content of its robot file, names: names of the lengths of each body,
// lengths: {name: value}, parts: which built part each body is, or null, cutting: how they are cut}.
// `prepare` adds its arrays. In the chassis frame, the crank axis is at the origin, and the robot walks
// towards +x. Units are metres and radians.

import { resizer } from "./lengths.js";
import { Leg, TURN, walkOf } from "./robot.js";

export const SAMPLES = 720; // crank angles of a turn
const NUMBERS = ["standing", "heave", "lift", "advance", "stance"]; // as measure_level puts them

/** Create the arrays of designs, given by name, in the engine's memory. */
export function prepare({ work }, designs) {
  for (const design of Object.values(designs)) {
    const leg = new Leg(work, design.robot);
    const { linkage } = design.robot;
    const shared = { leg, memory: work, resizer: resizer(work, leg, design) };
    Object.assign(design, shared, { joints: linkage.joints, toes: linkage.toes, loaded: null });
  }
}

/** Return a linkage with some lengths; `fault` names a body whose sides form no triangle. */
export function assemble(design, lengths) {
  const bodies = design.robot.linkage.bodies.map(([name, joints]) => ({ name, joints }));
  const linkage = { design, lengths, bodies, fault: undefined };
  linkage.fault = bodies[load(linkage)]?.name;
  return linkage;
}

/** Put a linkage into its design's arrays, unless it is there; return the body at fault, or -1. */
function load(linkage) {
  const { design, lengths } = linkage;
  const { leg, memory } = design;
  if (design.loaded === linkage) return design.fault;
  Object.assign(design, { loaded: linkage, fault: design.resizer.resize(lengths) });
  leg.closing[0] = lengths.frame_angle;
  const { links, points } = design.resizer;
  const { members, dyads, corners, bars, spans } = leg;
  memory.call("link_shapes_assemble", links, points, members, dyads, corners, bars, spans);
  return design.fault;
}

/** Return a fore leg at crank angles, an array in the memory: [{at: {joint: [x, y]}, open} ...]. */
function placeAt(linkage, psi) {
  const { leg, memory, joints, robot } = linkage.design;
  load(linkage);
  const places = memory.array("f8", psi.length, joints.length, 2);
  const [dyads, fault] = [memory.array("i8", psi.length), memory.array("f8", 2)];
  const spans = memory.array("f8", psi.length);
  memory.call("closure_put_open_joints", psi, leg.closing, places, dyads, spans, fault);
  const { view } = places;
  return Array.from(psi.view, (angle, i) => {
    const first = 2 * joints.length * i;
    const pairs = [...joints].map((joint, k) => {
      return [joint, [view[first + 2 * k], view[first + 2 * k + 1]]];
    });
    const at = Object.fromEntries(pairs.filter(([, [x]]) => !Number.isNaN(x)));
    const dyad = Number(dyads.view[i]);
    if (dyad < 0) return { at, open: null };
    const [open, start, end] = robot.linkage.dyads[dyad];
    const [reach, other] = leg.spans.at(dyad).view;
    const numbers = { first: reach, second: other, span: spans.view[i], psi: angle };
    return { at, open: { joint: open, start, end, ...numbers } };
  });
}

/**
 * Places of the joints of a fore leg whose crank stands at `psi`: {at: {joint: [x, y]}, open}.
 * `open`: the dyad that does not close, with the `span` that its links cannot reach, or null.
 */
export function place(linkage, psi) {
  const { memory } = linkage.design;
  return memory.scratch(() => placeAt(linkage, memory.filled("f8", [psi]))[0]);
}

/** Places of leg number `k` of the robot at crank angle `psi`; a back leg is mirrored. */
export function placeLeg(linkage, k, psi) {
  const { leg, memory } = linkage.design;
  load(linkage);
  const [side, phase] = leg.legs.at(k).view;
  const own = memory.scratch(() => {
    const given = memory.filled("f8", [side, phase], 1, 2);
    const [angles, out] = [memory.array("f8", 1, 1), memory.array("f8", NUMBERS.length)];
    const places = memory.array("f8", 1, 1, leg.joints, 2);
    const crank = memory.filled("f8", [psi]);
    memory.call("closure_put_legs", crank, given, leg.closing, angles, places, out);
    return angles.view[0]; // of a fore leg of the same shape
  });
  const { at, open } = place(linkage, own);
  for (const joint of Object.keys(at)) at[joint] = [side * at[joint][0], at[joint][1]];
  return { at, open };
}

/** Crank angle of a sample. */
export const angleOf = (k) => -Math.PI + (TURN * k) / SAMPLES;

/** Return a fore leg at all samples of a turn. */
export function turnOf(linkage) {
  const { memory } = linkage.design;
  return memory.scratch(() => placeAt(linkage, samples(memory)));
}

function samples(memory) {
  const psi = memory.array("f8", SAMPLES);
  memory.call("closure_put_turn_angles", -Math.PI, psi);
  return psi;
}

/**
 * Return the joints of a fore leg at crank angles evenly over a turn: numbers (count, joints, 2).
 * Return null if the leg does not close, or if the sine of the angle between two links that meet is
 * not above `leastSine`.
 */
export function pathsOf(linkage, count, leastSine) {
  const { memory, leg } = linkage.design;
  return memory.scratch(() => {
    const psi = leg.turn(count);
    const [places, out] = [memory.array("f8", count, leg.joints, 2), memory.array("f8", 3)];
    if (load(linkage) >= 0) return null;
    if (memory.call("closure_put_joints", psi, leg.closing, places, out) >= 0) return null;
    memory.call("closure_nearest_dead_point", places, leg.dyads, out);
    return out.view[0] > leastSine ? places.view.slice() : null;
  });
}

/** Return the lengths of a body by name, from its joints' places; for the frame also its angle. */
export function lengthsOf(design, body, places) {
  const { memory, names, robot, lengths } = design;
  const given = memory.scratch(() => {
    const values = memory.array("f8", names[body].length);
    const kind = memory.layout.links.indexOf(robot.bodies[body].is);
    memory.call("link_shapes_put_lengths_between", kind, memory.rows("f8", places), values);
    return Object.fromEntries(names[body].map((name, k) => [name, values.view[k]]));
  });
  if (body > 0) return given;
  load({ design, lengths: { ...lengths, ...given } });
  const frame = memory.scratch(() =>
    memory.call("link_shapes_frame_angle_of", memory.rows("f8", places), design.leg.corners.at(0)),
  );
  return { ...given, frame_angle: frame };
}

/**
 * Where a turn does not close: the widest gap of the first dyad that does not, and angles `from`
 * and `to` around it, or null.
 */
export function gapOf(linkage, turn) {
  const { memory, leg } = linkage.design;
  const open = turn.map((sample) => sample.open);
  if (!open.some(Boolean)) return null;
  load(linkage);
  const at = memory.scratch(() => {
    const places = memory.array("f8", SAMPLES, leg.joints, 2);
    const out = memory.array("f8", NUMBERS.length);
    memory.call("closure_put_joints", samples(memory), leg.closing, places, out);
    return out.view[0];
  });
  const worst = open[at];
  const reach = (way) => {
    let k = at;
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
export function measure(linkage) {
  const { memory, leg, robot } = linkage.design;
  load(linkage);
  return memory.scratch(() => {
    const [count, toes] = [robot.legs.length, leg.toes.length];
    const places = memory.array("f8", count, SAMPLES, leg.joints, 2);
    const [angles, out] = [memory.array("f8", count, SAMPLES), memory.array("f8", NUMBERS.length)];
    memory.call("closure_put_legs", samples(memory), leg.legs, leg.closing, angles, places, out);
    const [heights, grounded] = [memory.array("f8", SAMPLES), memory.array("i8", toes, SAMPLES)];
    const { STANCE } = memory.layout.numbers;
    memory.call("closure_measure_level", places, leg.toes, STANCE, heights, grounded, out);
    const numbers = Object.fromEntries(NUMBERS.map((name, i) => [name, out.view[i]]));
    const dyad = memory.call("closure_nearest_dead_point", places.at(0), leg.dyads, out);
    const [sine, k] = out.view;
    const dead = { sine, joint: robot.linkage.dyads[dyad][0], psi: angleOf(k) };
    const stands = Array.from({ length: toes }, (_, i) => Array.from(grounded.at(i).view, Boolean));
    const { advance, height: standing } = walkOf(leg);
    return { ...numbers, advance, standing, grounded: stands, dead };
  });
}

/** Return the name of a body of a design that cannot be cut with some lengths; "" if all can. */
export function uncut(design, lengths) {
  const linkage = assemble(design, lengths);
  if (linkage.fault) return linkage.fault;
  const { leg, memory, resizer: resized, cutting } = design;
  const body = memory.scratch(() => {
    const radii = memory.rows("f8", cutting.radii);
    const feet = memory.rows("b1", cutting.feet);
    const sizes = memory.array("CUTTING", 1);
    sizes.write(cutting.sizes);
    const most = leg.members.shape[1];
    const work = [memory.array("f8", most + 1, 2), memory.array("f8", 3 * most + 2, 3)];
    const ofParts = [leg.members, leg.corners, radii, feet, sizes];
    return memory.call("cutting_find_uncut", resized.links, ofParts, work);
  });
  return linkage.bodies[body]?.name ?? "";
}
