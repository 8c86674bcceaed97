// Where the joints of a robot's legs are, bit for bit as jansen_env/robot/kinematics.py has it.
//
// A robot is an entry of data.robots, which walk_data.py writes (robot_data). Chassis frame: crank
// axis at the origin, +x the walking direction.

export const TURN = 2 * Math.PI;

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
    const { members, dyads } = robot.closing;
    const corners = robot.bodies.flatMap((link, k) => {
      const ends = cornersOf(memory, link);
      return members[k].map((_, i) => ends[i] ?? [0, 0]);
    });
    const spanOf = (body, ...joints) => {
      const places = joints.map((joint) => members[body].indexOf(joint));
      return distance(memory, robot.bodies[body], ...places);
    };
    const spans = dyads.map(([joint, start, end, , first, second]) => [
      spanOf(first, start, joint),
      spanOf(second, end, joint),
    ]);
    const shape = [members.length, members[0].length, 2];
    const bodies = [memory.rows("i8", members), memory.filled("f8", corners.flat(), ...shape)];
    this.closing = [robot.frame_angle, bodies, memory.rows("i8", dyads), memory.rows("f8", spans)];
    this.bodies = [bodies, memory.filled("b1", robot.bodies.map(({ is }) => is === "Bar"))]; // biome-ignore format: short
    Object.assign(this, { memory, robot, spans });
  }

  /** Joints of a fore leg whose crank stands at `psi` (n,): (n, joints, 2). */
  joints(psi) {
    const { memory, robot, spans } = this;
    const names = robot.linkage.joints;
    const places = memory.array("f8", psi.length, names.length, 2);
    const failed = memory.scratch(() => {
      const fault = memory.array("f8", 2);
      const kernelArguments = [memory.filled("f8", psi), ...this.closing.flat(), places, fault];
      const dyad = memory.call("closure_put_joints", kernelArguments);
      return dyad < 0 ? null : [dyad, ...fault.view];
    });
    if (failed) {
      const [dyad, k, span] = failed;
      const [joint, , , , ...bodies] = robot.closing.dyads[dyad];
      const [first, second] = bodies.map(
        (body, i) => `${robot.linkage.bodies[body][0]} of ${spans[dyad][i].toFixed(5)} m`,
      );
      throw new Error(
        `joint ${names[joint]} does not close at crank angle ${psi[k].toFixed(4)} rad: ${first} and ` +
          `${second} cannot span ${span.toFixed(5)} m`,
      );
    }
    return places;
  }

  /** Angle and centre of mass of each body of a fore leg with these `places`: (n, bodies, 3). */
  coordinates(psi, places) {
    const x = this.memory.array("f8", psi.length, this.robot.bodies.length, 3);
    const kernelArguments = [this.memory.filled("f8", psi), 1, ...this.bodies.flat()];
    this.memory.call("closure_put_coordinates", kernelArguments, places, x);
    return x;
  }

  /** Joints of each leg of the robot at crank angles `psi`: numbers (legs, n, joints, 2). */
  legs(psi) {
    const { memory, robot } = this;
    const ahead = ({ side, phase }) =>
      Array.from(psi, (angle) => (side === "fore" ? angle + phase : Math.PI - (angle + phase)));
    return memory.scratch(() => {
      const places = this.joints(robot.legs.flatMap(ahead)).view.slice();
      const size = places.length / robot.legs.length;
      for (const [leg, { side }] of robot.legs.entries())
        if (side === "back") for (let i = leg * size; i < (leg + 1) * size; i += 2) places[i] *= -1;
      return places;
    });
  }
}
