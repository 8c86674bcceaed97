// A machine that walks on the page: what turns its crank, its score, and its last minute.

import { controllerNamed } from "./controllers.js";
import { Machine } from "./machine.js";
import { Random } from "./random_numbers.js";
import { TURN } from "./robot.js";

export const HAND = "hand"; // of data.controllers: the torque is the user's
export const APART = 25; // steps between two places to which time can go back
const KEPT = 60; // s of the past
const PLOTTED = [
  ({ crank_torque }) => crank_torque, // N m
  ({ slip }, step) => slip.reduce((total, path) => total + path, 0) / step, // m/s, of all toes
  ({ energy }, step) => energy.motor_work / step, // W
  ({ ground_load }) => ground_load, // weights
];
const NOTHING = {
  time: 0,
  speed: 0,
  x: 0,
  commanded: 0,
  free: 0,
  slipped: 0,
  lifted: 0,
  steps: 0,
  unsupported: 0,
};

/** A number as text, with a minus sign unless it is 0; a dash for null. */
export function shown(value, digits, unit = "") {
  const text = value?.toFixed(digits).replace(/^-0(\.0*)?$/, "0$1");
  return text ? text.replace("-", "−") + unit : "–";
}

/** The sums of a walk with one more step; `command`: m/s, null where the torque is given. */
function counted(sums, info, weight, command) {
  const way = info.x_position - sums.x;
  const next = { ...sums, x: info.x_position, time: info.time, speed: info.mean_speed };
  if (command) next.commanded += Math.sign(command) * way;
  else next.free += way;
  for (const slip of info.slip) next.slipped += slip;
  next.lifted += Math.abs(info.energy.motor_work) / weight;
  next.steps += 1;
  next.unsupported += info.unsupported; // share of the step's time
  return next;
}

export class Walker {
  controllers = {}; // those that have turned the crank, by name

  /** A promise of one. robot: of data.robots; ground: its points; control: of data.controllers. */
  static async create(engine, data, robot, ground, control) {
    const machine = await Machine.create(engine, robot, { points: ground });
    return new Walker(data, robot, ground, control, machine);
  }

  constructor(data, robot, ground, control, machine) {
    Object.assign(this, { data, robot, ground, machine });
    this.reach = machine.scene.reach; // m
    this.useController(control);
  }

  /** Let another controller turn the crank; throws where it does not fit the robot. */
  useController(control) {
    this.controllers[control] ??= controllerNamed(this.data, control, this.machine);
    this.controller = this.controllers[control];
    this.control = control;
    if (this.past) this.controller.begin();
  }

  get byHand() {
    return this.control === HAND;
  }

  /** Stand at rest with settings of `Machine.change`, as an environment that is reset with a seed. */
  start(seed, settings, command) {
    // The samples have the order of `World._plan_start` in jansen_env/world/world.py.
    const rng = new Random(this.machine.memory, seed);
    const crankAngle = rng.uniform(0, TURN);
    for (const _ of ["command", "crank speed"]) rng.random(); // which are given here
    this.machine.change(settings);
    this.machine.reset({ crankAngle, command, episodeSeed: rng.integer(2n ** 63n) });
    this.controller.begin();
    this.walk = { seed, crankAngle, command, settings, steps: [] };
    this.pending = {}; // what comes before the next step
    this.sums = NOTHING;
    this.fallen = this.stuck = false;
    this.past = []; // {count, pose, info, numbers for plots} of the start and of each step
    this.keep(0);
  }

  /**
   * Distance, m; slip per metre and cost of transport, or null; share of the time without support,
   * or null; mean speed, m/s; time, s.
   */
  get score() {
    const { time, speed, commanded, free, slipped, lifted, steps } = this.sums;
    const distance = Math.max(commanded, 0) + Math.abs(free);
    const ratio = (sum) => (distance > this.data.leastDistance ? sum / distance : null);
    const unsupported = steps > 0 ? this.sums.unsupported / steps : null;
    return { distance, slip: ratio(slipped), cost: ratio(lifted), unsupported, speed, time };
  }

  /** Change numbers of the machine from the next step on; throws if one cannot be. */
  change(changes) {
    this.machine.change(changes);
    this.pending.changes = { ...this.pending.changes, ...changes };
  }

  push(x, y) {
    this.machine.push(x, y);
    this.pending.pushes = [...(this.pending.pushes ?? []), [x, y]];
  }

  /** The walk since the start as a file, with which Python walks it again. */
  file(label) {
    const { seed, crankAngle: crank_angle, command, settings: changes, steps } = this.walk;
    const start = { seed, crank_angle, command, changes };
    const { data, robot, ground } = this;
    return { format: data.walkFormat, label, robot, ground, start, steps };
  }

  /** Take a step of a torque, -1 to 1, where it is given by hand, else for a command, m/s. */
  step(torque, command) {
    if (this.stuck) return;
    if (!this.byHand && command !== this.machine.command) this.machine.change({ command });
    const action = this.byHand ? torque : this.controller.act();
    this.machine.step(action);
    this.walk.steps.push({ action, command: this.machine.command, ...this.pending });
    this.pending = {};
    const { info, weight } = this.machine;
    this.stuck = info.diverged;
    if (!this.fallen) {
      this.sums = counted(this.sums, info, weight, this.byHand ? null : command);
      this.fallen = info.fallen;
    }
    this.keep(this.past.at(-1).count + 1);
  }

  keep(count) {
    const { machine, controller, control, sums, fallen } = this;
    const { info } = machine;
    const numbers = PLOTTED.map((of) => of(info, machine.layout.period));
    const place = { count, pose: machine.pose(), info, numbers };
    if (count % APART === 0) {
      const memory = structuredClone(controller.memory ?? null);
      place.snapshot = { state: machine.snapshot(), control, memory, sums, fallen };
    }
    this.past.push(place);
    if (this.past.length > KEPT / machine.layout.period + APART) this.past.splice(0, APART);
  }

  /** Go back to a step with a snapshot; what came after it is forgotten. */
  back(count) {
    // One that has diverged has stopped before.
    const index = this.past.findLastIndex((place) => place.snapshot && place.count <= count);
    const { state, control, memory, sums, fallen } = this.past[index].snapshot;
    this.machine.restore(state);
    if (control !== this.control) this.useController(control);
    if (memory !== null) this.controller.memory = structuredClone(memory);
    Object.assign(this, { sums, fallen, stuck: false });
    this.past.length = index + 1;
    this.walk.steps.length = this.past[index].count;
    this.pending = {};
  }

  /** Index in `past` of a step, or of the last one where it stopped before. */
  indexOf(count) {
    return Math.min(Math.max(count - this.past[0].count, 0), this.past.length - 1);
  }

  /** The pose at a share of the step that ends at an index; what touches is as at its end. */
  poseAt(index, share) {
    const [from, to] = [this.past[Math.max(index - 1, 0)].pose, this.past[index].pose];
    const between = (a, b) => a + share * (b - a);
    const [x, y, pitch] = ["x", "y", "pitch"].map((name) => between(from[name], to[name]));
    const places = to.joints.map((value, i) => between(from.joints[i], value));
    const { phases, joints: names } = this.machine.scene;
    const pointOf = (k) => [places[2 * k], places[2 * k + 1]];
    const joints = phases.map((_, leg) =>
      [...names].map((_name, joint) => pointOf(leg * names.length + joint)),
    );
    const toes = to.toes.map((toe, i) => {
      return { ...toe, point: toe.point.map((value, k) => between(from.toes[i].point[k], value)) };
    });
    return { x, y, pitch, joints, toes };
  }
}
