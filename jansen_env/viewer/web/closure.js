// Where the joints of a robot's legs are, bit for bit as jansen_env/robot/kinematics.py has it.
//
// A robot is an entry of data.robots, which walk_data.py writes (robot_data). Arrays are of many crank angles at once, as NumPy's there: the operations are
// the same in the same order. Chassis frame: crank axis at the origin, +x the walking direction.

import { each } from "./engine.js";

export const TURN = 2 * Math.PI;
const [FRAME, CRANK] = [0, 1]; // the bodies that all legs share

export const hypot = (x, y) => Math.sqrt(x * x + y * y); // Math.hypot rounds otherwise

/** x less whole periods, from 0 to `period`. */
export function modulo(x, period) {
  const rest = x % period;
  return rest < 0 ? rest + period : rest;
}

/** Sides of a triangle: first-second, second-third, third-first, m. */
export function sidesOf(memory, { d, l, h, alpha, gamma }) {
  const [cos] = memory.directions([alpha, TURN - alpha - gamma, gamma]);
  const opposite = (a, b, k) => Math.sqrt(a * a + b * b - 2 * a * b * cos[k]);
  return [opposite(d, l, 0), opposite(l, h, 1), opposite(h, d, 2)];
}

/** [c, o] of each joint of a link: it is at the centre + c (cos, sin)(theta + o), m, rad. */
export function cornersOf(memory, link) {
  if (link.is === "Bar") return [-0.5, 0.5].map((half) => [half * link.length, 0]);
  if (link.is === "Plate") {
    const angles = memory.angles(...[0, 1].map((axis) => link.points.map((point) => point[axis])));
    return link.points.map((point, k) => [hypot(...point), angles[k]]);
  }
  const { d, l, h, alpha, gamma } = link;
  return [[d, 0], [l, alpha], [h, -gamma]].map(([c, o]) => [link.outward ? c : -c, o]); // biome-ignore format: short
}

/** Distance between two joints of a link, by their places in it, m. */
export function distance(memory, link, i, k) {
  if (link.is === "Bar") return link.length;
  if (link.is === "Triangle") return sidesOf(memory, link)[[0, 2, 1][i + k - 1]];
  const [[x, y], [u, v]] = [link.points[i], link.points[k]];
  return hypot(u - x, v - y);
}

/** A robot's linkage, to be closed in some memory of the engine. */
export class Closure {
  constructor(memory, robot) {
    const { bodies, joints, dyads } = robot.linkage;
    const { members } = robot;
    this.corners = robot.bodies.map((link) => cornersOf(memory, link));
    const has = (body, joint) => members[body].indexOf(joint);
    this.dyads = dyads.map(([name, ...ends]) => {
      const joint = joints.indexOf(name);
      const sides = ends.slice(0, 2).map((end) => {
        const other = joints.indexOf(end);
        const body = bodies.findIndex((_, k) => has(k, joint) >= 0 && has(k, other) >= 0);
        const span = distance(memory, robot.bodies[body], has(body, other), has(body, joint));
        return { other, body, span };
      });
      return { name, joint, sides, branch: ends[2] };
    });
    Object.assign(this, { memory, robot, members });
  }

  /** [x, y] of each joint of a fore leg whose crank stands at `psi` (n,), in the linkage's order. */
  joints(psi) {
    const { members, memory, dyads, robot } = this;
    const places = [];
    places[members[CRANK][0]] = [each(psi.length, () => 0), each(psi.length, () => 0)];
    this.addJoints(
      places,
      FRAME,
      each(psi.length, () => robot.frame_angle),
    );
    this.addJoints(places, CRANK, psi);
    for (const dyad of dyads) {
      places[dyad.joint] = thirdCorner(psi, places, dyad);
      for (const { body } of dyad.sides) {
        if (members[body].length === 2) continue;
        const [i, j] = [...members[body].keys()].filter((k) => places[members[body][k]]);
        const [from, to] = [i, j].map((k) => places[members[body][k]]);
        const [half, turn] = this.edgeToAngle(body, i, j);
        const edge = memory.angles(...difference(to, from));
        this.addJoints(places, body, edge.map((angle) => angle + half + turn)); // biome-ignore format: short
      }
    }
    return places;
  }

  /** Add all joints of a body whose angle is known, and one of its joints, to `places`. */
  addJoints(places, body, heading) {
    const joints = this.members[body];
    const moved = ([x, y], way, [reach, offset]) => {
      const [cos, sin] = this.memory.directions(heading.map((angle) => angle + offset));
      return [
        x.map((u, i) => u + way * (reach * cos[i])),
        y.map((v, i) => v + way * (reach * sin[i])),
      ];
    };
    const first = joints.findIndex((joint) => places[joint]);
    const centre = moved(places[joints[first]], -1, this.corners[body][first]);
    for (const [k, joint] of joints.entries())
      places[joint] ??= moved(centre, 1, this.corners[body][k]);
  }

  /** Turn from the edge between two joints of a body to its angle: half a turn or none, and more. */
  edgeToAngle(body, i, j) {
    const [[r, a], [s, b]] = [this.corners[body][i], this.corners[body][j]];
    const way = r > 0 ? -1 : 1;
    const [x, y] = this.memory.directions([a, b]).map((part) => way * (s * part[1] - r * part[0]));
    return [r > 0 ? Math.PI : 0, -this.memory.angles([x], [y])[0]];
  }

  /** Angle and centre of mass [theta, x, y] of each body of a fore leg with these `joints`. */
  coordinates(psi, joints) {
    const { memory, members, corners } = this;
    return this.robot.bodies.map((link, body) => {
      const [from, to] = members[body].map((joint) => joints[joint]);
      let heading = memory.angles(...difference(to, from));
      let centre = from.map((axis, k) => axis.map((x, n) => (x + to[k][n]) / 2));
      if (link.is !== "Bar") {
        const [half, turn] = this.edgeToAngle(body, 0, 1);
        heading = heading.map((angle) => angle + half + turn);
        const [reach, offset] = corners[body][0];
        const way = memory.directions(heading.map((angle) => angle + offset));
        centre = from.map((axis, k) => axis.map((x, n) => x - reach * way[k][n]));
      }
      heading = heading.map((angle) => angle - TURN * Math.ceil(angle / TURN - 0.5));
      return [body === CRANK ? psi : heading, ...centre];
    });
  }

  /** [x, y] of each joint of each leg of the robot at crank angles `psi` (n,). */
  legs(psi) {
    return this.robot.legs.map(({ side, phase }) => {
      if (side === "fore") return this.joints(psi.map((angle) => angle + phase));
      const mirrored = this.joints(psi.map((angle) => Math.PI - (angle + phase)));
      return mirrored.map(([x, y]) => [x.map((value) => -value), y]);
    });
  }
}

/** The joint of a dyad, which lies left (branch 1) or right (-1) of the way from start to end. */
function thirdCorner(psi, places, { name, branch, sides }) {
  const [{ span: fromP }, { span: fromQ }] = sides;
  const [p, q] = sides.map(({ other }) => places[other]);
  const [x, y] = [p[0].slice(), p[1].slice()];
  let worst = null;
  for (let i = 0; i < psi.length; i += 1) {
    const [spanX, spanY] = [q[0][i] - p[0][i], q[1][i] - p[1][i]];
    const span = hypot(spanX, spanY);
    const along = (span * span + (fromP * fromP - fromQ * fromQ)) / (2 * span);
    const across2 = fromP * fromP - along * along;
    if (!(across2 > 0) && !(worst?.across2 <= across2)) worst = { across2, span, angle: psi[i] };
    const [unitX, unitY, across] = [spanX / span, spanY / span, branch * Math.sqrt(across2)];
    x[i] = p[0][i] + along * unitX + across * -unitY;
    y[i] = p[1][i] + along * unitY + across * unitX;
  }
  if (worst)
    throw new Error(
      `joint ${name} does not close at crank angle ${worst.angle.toFixed(4)} rad: its two links of ` +
        `${fromP.toFixed(5)} m and ${fromQ.toFixed(5)} m cannot span ${worst.span.toFixed(5)} m`,
    );
  return [x, y];
}

const difference = (to, from) => to.map((axis, k) => axis.map((x, n) => x - from[k][n]));
