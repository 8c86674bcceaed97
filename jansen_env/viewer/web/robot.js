// Turns a robot file into arrays for the engine's kernels, and compiles its leg to periodic tables.
//
// The arrays are those of jansen_env/robot/robot_arrays.py; the engine does all computation. In this
// file, a robot is the content of a robot file, see jansen_env/robot/robot_file.py.

import { numbersOf } from "./engine.js";

export const TURN = 2 * Math.PI;
const LONGEST = 60; // characters of a value in a message
const REACH = 2; // number of rows (c, p) and of columns (|c|, |c'|) of `farthest`
const SPRING_VALUES = 4; // stiffness, rest length, and an end on the chassis (x, y)
const OPEN = 3; // numbers that describe a dyad that does not close: index of the angle, span, leg

/** Return the fields of a part of a robot file, with the defaults of those that it leaves out. */
export function whole({ schema }, { is, ...given }) {
  const { fields } = schema[is];
  const numberOf = (name) => {
    const { default: value } = fields[name];
    if (name in given) return given[name];
    return value?.as ? numberOf(value.as) : (value ?? Number.POSITIVE_INFINITY);
  };
  return Object.fromEntries(Object.keys(fields).map((name) => [name, numberOf(name)]));
}

/**
 * Return the robot of a file, with the defaults of what the file leaves out. Throw an error if it is
 * not a robot that this page can compile. `layout.schema` has the limits: robot_file.py documents it.
 */
export function checkRobot(engine, content) {
  const { layout } = engine;
  for (const wrong of faultsOf(engine, content))
    if (wrong) throw new Error(`This page cannot use the robot file: ${wrong}.`);
  const { format, ...robot } = content;
  return { format, ...completed(layout, robot) };
}

/** Return a value of a robot file with all defaults; infinite ones stay left out. */
function completed(layout, value) {
  if (Array.isArray(value)) return value.map((each) => completed(layout, each));
  if (!value?.is) return value;
  const fields = Object.entries(whole(layout, value)).filter(
    ([, each]) => each !== Number.POSITIVE_INFINITY,
  );
  const all = fields.map(([name, each]) => [name, completed(layout, each)]);
  return { is: value.is, ...Object.fromEntries(all) };
}

/** Check the content of a file; for each check, yield what is wrong, or a falsy value. */
function* faultsOf({ work, layout }, content) {
  const { schema, numbers, format, tasks } = layout;
  yield content?.format !== format &&
    `the format of a robot file must be '${format}', got ${shown(content?.format)}`;
  const { format: _, ...robot } = content;
  yield robot.is !== "Robot" && `a robot file must contain a Robot, got ${shown(robot.is)}`;
  yield* faultsOfValue(schema, { parts: ["Robot"] }, robot, "");
  const complete = completed(layout, robot);
  const { linkage, legs, springs } = complete;
  yield faultOfBodies(layout, complete);
  yield work.scratch(() => faultOfLinkage(work, complete));
  for (const [k, spring] of springs.entries())
    yield work.scratch(() => faultOfSpring(work, linkage, spring, `springs[${k}]`));
  const { phase } = legs[0];
  const allowed = "0, because the crank of the first leg defines the crank angle";
  yield phase !== 0 && `legs[0].phase must be ${allowed}, got ${phase}`;
  const toes = legs.length * linkage.toes.length;
  const mostToes = Object.keys(tasks).length;
  yield toes > mostToes && `a robot on the page must have at most ${mostToes} toes, got ${toes}`;
  const pads = linkage.toes.length + linkage.pads.length;
  const most = numbers.MOST_PADS;
  const given = `${legs.length} legs of ${pads} pads each`;
  yield legs.length * pads > most && `legs must have at most ${most} pads in all, got ${given}`;
}

/** Check a value of a robot file by its kind; `name` is its path in the file. */
function* faultsOfValue(schema, kind, value, name) {
  const { parts, each, row } = kind;
  const allowed = refused(kind, value);
  yield allowed && `${name} must be ${allowed}, got ${shown(value)}`;
  if (parts) yield* faultsOfPart(schema, value, name);
  if (each ?? row)
    for (const [k, entry] of value.entries())
      yield* faultsOfValue(schema, each ?? row[k], entry, `${name}[${k}]`);
}

/** Return what is allowed instead of a value, leaving its own entries aside; "" if it is allowed. */
function refused(kind, value) {
  const [[name, given]] = Object.entries(kind);
  return CHECKS[name](given, value) ? "" : ALLOWED[name](given, value);
}

const CHECKS = {
  number: isWithin,
  whole: (most, value) => Number.isInteger(value) && Math.abs(value) <= most,
  type: (type, value) => typeof value === type,
  one: (values, value) => values.includes(value),
  parts: (names, value) => names.includes(value?.is),
  each: (_, value) => Array.isArray(value),
  row: (kinds, value) => Array.isArray(value) && value.length === kinds.length,
};
const ALLOWED = {
  number: ({ allowed }, value) => (Number.isFinite(value) ? allowed : "a finite number"),
  whole: (most) => `a whole number from ${-most} to ${most}`,
  type: (type) => `a ${type}`,
  one: (values) => `one of ${listed(values)}`,
  parts: (names) => `a ${names.join(" or a ")}`,
  each: () => "a list",
  row: (kinds) => `a list of ${kinds.length}`,
};

function shown(value) {
  const text = String(JSON.stringify(value));
  return text.length <= LONGEST ? text : `${text.slice(0, LONGEST)}...`;
}

/** Return a list of names as Python shows it in its messages. */
export const listed = (names) => `[${names.map((name) => `'${name}'`).join(", ")}]`;

/** Check the fields of a part of a robot file, and its rules; `path` is "" for the robot itself. */
function* faultsOfPart(schema, { is, ...given }, path) {
  const { fields, rules } = schema[is];
  const part = path || `a ${is}`;
  const start = path && `${path}.`;
  const known = Object.keys(fields);
  for (const name of Object.keys(given))
    yield !known.includes(name) &&
      `a key of ${part} must be one of ${listed(known)}, got ${shown(name)}`;
  for (const [name, { kind, default: value }] of Object.entries(fields))
    if (name in given) yield* faultsOfValue(schema, kind, given[name], start + name);
    else
      yield value === undefined &&
        `${part} must have the key '${name}', got one without it; write_robot writes all keys`;
  const values = whole({ schema }, { is, ...given });
  for (const rule of rules) yield faultOfRule(rule, values, start, part);
}

function faultOfRule(rule, values, start, part) {
  if (rule.field) return faultOfCount(rule, values, start);
  return rule.with ? faultOfPair(rule, values, start) : faultOfTotal(rule, values, part);
}

function faultOfCount({ field, least, other }, values, start) {
  const count = values[field].length;
  if (!other)
    return count < least && `${start}${field} must have ${least} or more entries, got ${count}`;
  const allowed = other.split(".").reduce((part, name) => part[name], values).length;
  return (
    count !== allowed &&
    `${start}${field} must have ${allowed} entries, the same number as ${other}, got ${count}`
  );
}

function faultOfPair({ with: field, finite: other }, numbers, start) {
  const value = numbers[field];
  return (
    Number.isFinite(value) &&
    value !== 0 &&
    numbers[other] === Number.POSITIVE_INFINITY &&
    `${start}${other} must be finite with a ${field} of ${value}, got infinity`
  );
}

function faultOfTotal({ sum, product, number }, numbers, part) {
  const names = sum ?? product;
  const total = names.map((name) => numbers[name]).reduce((a, b) => (sum ? a + b : a * b));
  const operation = `the ${sum ? "sum" : "product"} of ${names.join(", ")}`;
  const given = [...new Set(names)].map((name) => `${name} of ${numbers[name]}`).join(" and ");
  return (
    !isWithin(number, total) &&
    `${part}: ${operation} must be ${number.allowed}, got ${total}: ${given}`
  );
}

function isWithin({ least, most, above }, value) {
  if (!Number.isFinite(value)) return false;
  const isHigh = least === null || value > least || (!above && value === least);
  return isHigh && (most === null || value <= most);
}

/** Return the topology of a leg: joints, bodies and dyads as the indices that the kernels take. */
function topologyOf(memory, linkage) {
  const joints = [...linkage.joints];
  const indicesOf = (names) => [...names].map((joint) => joints.indexOf(joint));
  const most = Math.max(...linkage.bodies.map(([, letters]) => letters.length));
  const table = (width, rows, rowOf) =>
    memory.filled("i8", rows.flatMap(rowOf), rows.length, width);
  const pairs = (rows) => table(2, rows, ([first, second]) => [first - 1, second - 1]);
  const padOf = ([joint, body]) => [...indicesOf([joint]), body - 1];
  const memberOf = ([, letters]) => indicesOf(Array.from({ length: most }, (_, i) => letters[i]));
  const dyadOf = ([joint, start, end, branch]) => {
    return [...indicesOf([joint, start, end]), branch, 0, 0];
  };
  return {
    members: table(most, linkage.bodies, memberOf),
    toes: memory.filled("i8", indicesOf(linkage.toes)),
    others: table(2, linkage.pads, padOf),
    damped: pairs(linkage.damped),
    bearings: pairs(linkage.bearings),
    dyads: table(6, linkage.dyads, dyadOf),
  };
}

const KINDS = { 2: "a Bar", 3: "a Triangle" }; // by the number of joints

/** Return what is wrong with the number of joints of a body, or "". */
function faultOfBodies({ jointsOf }, { linkage, bodies }) {
  for (const [k, [, joints]] of linkage.bodies.entries()) {
    const { is, points } = bodies[k];
    if ((jointsOf[is] ?? points.length) === joints.length) continue;
    const allowed = `${KINDS[joints.length] ?? "a Plate"} or a Plate with joints ${joints}`;
    return `bodies[${k}] must be ${allowed}, got ${shown(bodies[k])}`;
  }
  return "";
}

/** Return what is wrong with a linkage, or ""; jansen_env/engine/topology.py has the rules. */
function faultOfLinkage(memory, { linkage, bodies }) {
  const { jointsOf, linkageFaults } = memory.layout;
  const { members, toes, others, damped, bearings, dyads } = topologyOf(memory, linkage);
  const sizes = bodies.map(({ is, points }) => jointsOf[is] ?? points.length);
  const where = memory.array("i8", 1);
  const fault = memory.call("topology_find_linkage_fault", [
    memory.filled("i8", sizes), members, toes, others, damped, bearings, dyads,
    memory.array("i8", linkage.joints.length), where,
  ]); // biome-ignore format: in the kernel's order
  if (fault < 0) return "";
  const [field, allowed] = linkageFaults[fault];
  const k = where.view[0];
  return `linkage.${field}[${k}] must be ${allowed}, got ${shown(linkage[field][k])}`;
}

/** Return what is wrong with a spring, or "". */
function faultOfSpring(memory, linkage, spring, name) {
  const { springFaults, numbers } = memory.layout;
  const { members } = topologyOf(memory, linkage);
  const { start, end, first, second } = spring;
  const joints = [...linkage.joints];
  const links = linkage.bodies.map(([each]) => each);
  const jointOf = (joint) => joints.indexOf(joint);
  const bodyOf = (link) => links.indexOf(link);
  const ends = spring.is === "TorsionSpring" ? { first, second } : { start, ...(end && { end }) };
  for (const [field, value] of Object.entries(ends)) {
    const known = spring.is === "TorsionSpring" ? links : joints;
    if (!known.includes(value))
      return `${name}.${field} must be one of ${listed(known)}, got ${shown(value)}`;
  }
  const [kernel, ...indices] =
    spring.is === "TorsionSpring"
      ? ["find_torsion_fault", bodyOf(first), bodyOf(second)]
      : ["find_spring_fault", jointOf(start), end ? jointOf(end) : numbers.CHASSIS];
  const fault = memory.call(`topology_${kernel}`, members, indices);
  return fault < 0 ? "" : `${name} must be ${springFaults[fault]}, got ${shown(spring)}`;
}

/** Return the links of a leg in a memory: [links, points]; `most`: joints of a link, at most. */
function linksOf(memory, { bodies }, most) {
  const { layout } = memory;
  const links = memory.array("LINK", bodies.length);
  const points = memory.array("f8", bodies.length, most, 2);
  for (const [k, link] of bodies.entries()) {
    const { points: places = [], ...numbers } = whole(layout, link);
    links.write({ kind: layout.links.indexOf(link.is), ...numbers }, k);
    points.at(k).view.set(places.flat());
  }
  return [links, points];
}

/** Return a link of a robot file from its row in the kernels' arrays. */
export function linkOf(links, points, k, { is, points: places }) {
  const row = links.read(k);
  const { fields } = links.memory.layout.schema[is];
  const names = Object.keys(fields).filter((name) => name in row);
  const numbers = Object.fromEntries(names.map((name) => [name, row[name]]));
  if ("outward" in numbers) numbers.outward = row.outward === 1;
  if (!places) return { is, ...numbers };
  const { view } = points.at(k);
  return { is, points: places.map((_, i) => [...view.slice(2 * i, 2 * i + 2)]), ...numbers };
}

/** A robot's leg, with the arrays in a memory of the engine that close it. */
export class Leg {
  constructor(memory, robot) {
    const { linkage, frame_angle: frameAngle } = robot;
    const { members, toes, others, damped, bearings, dyads } = topologyOf(memory, linkage);
    const [links, points] = linksOf(memory, robot, members.shape[1]);
    const corners = memory.array("f8", ...points.shape);
    const bars = memory.array("b1", links.shape[0]);
    const spans = memory.array("f8", dyads.shape[0], 2);
    memory.call("link_shapes_assemble", links, points, members, dyads, corners, bars, spans);
    const sides = robot.legs.map(({ side, phase }) => [side === "fore" ? 1 : -1, phase]);
    Object.assign(this, { memory, robot, links, points, members, corners, bars, dyads, spans });
    this.closing = [frameAngle, members, corners, dyads, spans];
    this.legs = memory.rows("f8", sides);
    this.pads = memory.array("i8", toes.length + others.shape[0], 2);
    memory.call("topology_put_pads", members, toes, others, this.pads);
    Object.assign(this, { toes, damped, bearings });
    this.joints = linkage.joints.length;
  }

  /** Throw an error if a dyad does not close at a crank angle, rad. */
  check(dyad, angle, span) {
    if (dyad < 0) return;
    const { joints, bodies } = this.robot.linkage;
    const row = this.dyads.at(dyad).view;
    const spans = this.spans.at(dyad).view;
    const [first, second] = [0, 1].map(
      (end) => `${bodies[Number(row[4 + end])][0]} of ${spans[end].toFixed(5)} m`,
    );
    throw new Error(
      `joint ${joints[Number(row[0])]} does not close at crank angle ${angle.toFixed(4)} rad: ` +
        `${first} and ${second} cannot span ${span.toFixed(5)} m`,
    );
  }

  /** Return crank angles evenly over a turn, without its end, rad. */
  turn(samples) {
    const angles = this.memory.array("f8", samples);
    this.memory.call("closure_put_turn_angles", 0, angles);
    return angles;
  }

  /** Return the joints of a fore leg at crank angles (n,): (n, joints, 2). */
  place(psi) {
    const { memory } = this;
    const [places, fault] = [
      memory.array("f8", psi.length, this.joints, 2),
      memory.array("f8", OPEN),
    ];
    const dyad = memory.call("closure_put_joints", psi, this.closing, places, fault);
    const [k, span] = fault.view;
    this.check(dyad, psi.view[k], span);
    return places;
  }

  /** Return the joints of all legs at crank angles (n,): (legs, n, joints, 2). */
  placeLegs(psi) {
    const { memory, legs } = this;
    const [count] = legs.shape;
    const angles = memory.array("f8", count, psi.length);
    const places = memory.array("f8", count, psi.length, this.joints, 2);
    const fault = memory.array("f8", OPEN);
    const dyad = memory.call("closure_put_legs", psi, legs, this.closing, angles, places, fault);
    const [k, span, leg] = fault.view;
    this.check(dyad, angles.view[leg * psi.length + k], span);
    return places;
  }

  /** Return the joints of all legs for x and y in m, pitch and crank angle in rad. */
  pose([x, y, pitch, psi]) {
    const { memory } = this;
    return memory.scratch(() => {
      const places = this.placeLegs(memory.filled("f8", [psi]));
      memory.call("closure_turn_legs", memory.filled("f8", [x, y, pitch]), places);
      return places.view.slice();
    });
  }
}

/**
 * Return the tables and the reach of a robot for the kernels. Throw an error if the robot cannot turn
 * its crank or cannot stand.
 */
export function compileRobot({ work }, robot) {
  return work.scratch(() => compileIn(work, new Leg(work, robot)));
}

function compileIn(memory, leg) {
  const { layout } = memory;
  const { SAMPLES, HARMONICS, INTERVALS, ORDER, BEARING_SAMPLES, TAIL_TOLERANCE } = layout.numbers;
  const { damping, bearing_friction: friction } = leg.robot;
  const turn = (count) => {
    const out = memory.array("f8", 2, count);
    memory.call("reduction_put_turn", out);
    return out;
  };
  const psi = leg.turn(SAMPLES);
  const places = leg.place(psi);
  const x = memory.array("f8", SAMPLES, leg.links.length, 3);
  memory.call("closure_put_coordinates", psi, 1, leg.members, leg.corners, leg.bars, places, x);
  const ofLeg = [
    leg.links, leg.damped, memory.filled("f8", damping), leg.bearings,
    memory.filled("f8", friction), ...springsOf(memory, leg.robot), leg.legs, leg.pads,
  ]; // biome-ignore format: in the kernel's order
  const expansion = numbersOf(layout.expansion, Float64Array);
  const constants = [
    memory.filled("f8", expansion, ORDER, HARMONICS), turn(SAMPLES), turn(INTERVALS),
    turn(2 * INTERVALS), turn(BEARING_SAMPLES),
  ]; // biome-ignore format: likewise
  const pads = leg.pads.shape[0];
  const body = memory.array("f8", 1, INTERVALS, ORDER, layout.numbers.BODY_SUMS);
  const tables = memory.array("f8", pads, INTERVALS, ORDER, layout.numbers.PAD_FUNCTIONS);
  const bearings = memory.array("f8", BEARING_SAMPLES);
  const springs = memory.array("f8", 1, INTERVALS, ORDER, 1);
  const out = [body, tables, bearings, springs];
  const work = workSpace(memory, leg.links.length, pads, friction.length);
  const tail = memory.call("reduction_compile_tables", psi, x, places, ofLeg, constants, work, out);
  if (tail === Number.POSITIVE_INFINITY)
    throw new Error(
      "springs must be between two links that do not make whole turns relative to each other",
    );
  if (!(tail <= TAIL_TOLERANCE)) throw new Error(faultOfTail(leg, tail));
  const walk = walkOf(leg);
  if (!walk.stands)
    throw new Error(
      "robot cannot stand: its lowest toe must lie below the crank axis over the whole turn, but " +
        `is ${walk.highest.toPrecision(3)} m above the axis at crank angle ` +
        `${walk.at.toFixed(3)} rad; the usual causes are dyads assembled on their other side ` +
        "(Dyad.branch), and a frame that is upside down (frame_angle, in radians)",
    );
  const numbers = out.map((table) => table.view.slice());
  const reach = reachOf(memory, leg, body.at(0), tables);
  const compiled = {
    body: numbers[0],
    pads: numbers[1],
    bearings: numbers[2],
    springs: numbers[3],
  };
  return { ...compiled, ...walk, ...reach };
}

/** Return why the tables of a leg have not converged, in one sentence. */
function faultOfTail({ memory, robot, dyads, closing, joints }, tail) {
  const { HARMONICS, TAIL_TOLERANCE, TURN_SAMPLES } = memory.layout.numbers;
  const psi = memory.array("f8", TURN_SAMPLES);
  memory.call("closure_put_turn_angles", -Math.PI, psi);
  const places = memory.array("f8", TURN_SAMPLES, joints, 2);
  const [fault, out] = [memory.array("f8", OPEN), memory.array("f8", 2)];
  memory.call("closure_put_joints", psi, closing, places, fault);
  const dyad = memory.call("closure_nearest_dead_point", places, dyads, out);
  const [sine, k] = out.view;
  return (
    `robot's tables have not converged: harmonics beyond ${Math.floor((HARMONICS * 7) / 8)} must ` +
    `be at most ${TAIL_TOLERANCE.toExponential(0)} of the largest, got ${tail.toExponential(1)}; ` +
    `the linkage passes too near a dead point: at crank angle ${psi.view[k].toFixed(3)} rad the ` +
    `links that meet in ${robot.linkage.dyads[dyad][0]} are within ` +
    `${Math.asin(Math.min(sine, 1)).toFixed(3)} rad of one line`
  );
}

/** Return the springs of a leg: `SpringRows` of robot_arrays.py. */
function springsOf(memory, { linkage, springs = [] }) {
  const { layout } = memory;
  const of = (kind) => springs.filter(({ is }) => is === kind).map((each) => whole(layout, each));
  const [linear, torsion] = [of("Spring"), of("TorsionSpring")];
  const bodyOf = (name) => linkage.bodies.findIndex(([each]) => each === name);
  const jointOf = (joint) => (joint ? linkage.joints.indexOf(joint) : -1);
  const ends = linear.flatMap(({ start, end }) => [start, end].map(jointOf));
  const values = linear.flatMap((each) => [each.stiffness, each.rest_length, ...each.anchor]);
  const links = torsion.flatMap(({ first, second }) => [first, second].map(bodyOf));
  const angles = torsion.flatMap((each) => [each.stiffness, each.rest_angle]);
  return [
    memory.filled("i8", ends, linear.length, 2),
    memory.filled("f8", values, linear.length, SPRING_VALUES),
    memory.filled("i8", links, torsion.length, 2),
    memory.filled("f8", angles, torsion.length, 2),
  ];
}

function workSpace(memory, ...counts) {
  const shapes = memory.array("i8", memory.layout.numbers.WORK_ARRAYS, 3);
  memory.call("reduction_put_work_shapes", ...counts, shapes);
  const rows = Array.from({ length: shapes.length / 3 }, (_, k) => [...shapes.at(k).view]);
  return rows.map((row) => memory.array("f8", ...row.map(Number).filter(Boolean)));
}

/** Return how far the pads and the centre of mass get from the crank axis. */
function reachOf(memory, leg, body, tables) {
  const { PITCHES } = memory.layout.numbers;
  const farthest = memory.array("f8", REACH, REACH);
  const depths = memory.array("f8", PITCHES + 1);
  const fore = memory.array("f8", PITCHES);
  const toes = leg.toes.length;
  const ofRobot = [body, tables, toes, leg.legs];
  const extent = memory.call("reaches_measure_reach", ofRobot, farthest, depths, fore);
  return { extent, farthest: [...farthest.view], depths: depths.view.slice() };
}

/**
 * Return advance per turn and mean height of the crank axis in m, and whether the robot can stand:
 * whether the lowest toe is always below the axis. `highest` is its largest height above the axis in
 * m, and `at` the crank angle there in rad.
 */
export function walkOf(leg) {
  const { memory, toes } = leg;
  const { TURN_SAMPLES, HEIGHT_SAMPLES } = memory.layout.numbers;
  return memory.scratch(() => {
    const heights = memory.array("f8", HEIGHT_SAMPLES);
    const angles = leg.turn(HEIGHT_SAMPLES);
    const places = leg.placeLegs(angles);
    memory.call("closure_put_lowest_toes", places, toes, heights);
    const height = -memory.call("closure_mean", heights);
    const highest = Math.max(...heights.view);
    const at = angles.view[heights.view.indexOf(highest)];
    const psi = memory.array("f8", TURN_SAMPLES + 1);
    memory.call("closure_put_angles_to_end", TURN, psi);
    const ways = memory.array("f8", TURN_SAMPLES);
    const advance = memory.call("closure_advance_over_turn", leg.placeLegs(psi), toes, ways);
    return { advance, height, stands: highest < 0, highest, at };
  });
}

/** Return the pads of a robot and the sides of links between pads: [layout, sides]. */
export function padsOf(memory, { legs, pads, toes, members }) {
  const most = legs.shape[0] * pads.shape[0];
  return memory.scratch(() => {
    const layout = memory.array("PAD", most);
    const legOf = memory.array("i8", most);
    const count = memory.call("foot_pads_put_layout", legs, pads, toes.length, layout, legOf);
    const rows = Array.from({ length: count }, (_, k) => layout.read(k));
    const sides = memory.array("i8", legs.shape[0] * members.length, 2);
    const [used, usedLegs] = [layout.first(count), legOf.first(count)];
    const found = memory.call("foot_pads_put_sides", legs, members, pads, used, usedLegs, sides);
    return [rows, [...sides.view.slice(0, 2 * found)].map(Number)];
  });
}

/** Store a robot without the parameters of an episode in a row of MACHINE; its legs are as `leg`. */
export function putMachine(memory, leg, robot, machine) {
  const { layout } = memory;
  const { frame_angle, pad_radius, payload, motor, pad_compliance, legs } = robot;
  memory.scratch(() => {
    const chassis = memory.array("CHASSIS", 1);
    const parts = { payload, motor, pad_compliance };
    const values = Object.entries(parts).map(([name, part]) => [name, whole(layout, part)]);
    chassis.write({ frame_angle, pad_radius, ...Object.fromEntries(values) });
    const friction = memory.filled("f8", robot.bearing_friction);
    const stiffness = memory.filled(
      "f8",
      (robot.springs ?? []).map((each) => each.stiffness ?? 0),
    );
    const work = memory.array("f8", 2, leg.links.length + 1);
    const given = [leg.links, legs.length, chassis, friction, stiffness, work];
    memory.call("machines_put_machine", ...given, machine);
  });
}
