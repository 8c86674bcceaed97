// What turns the crank: a hand, the robot's own PID at a speed that walks at the command, or a policy.
//
// Each has begin(), act() -> action, -1 to 1, for the machine as it stands, topSpeed, m/s, the
// fastest command that makes sense, and memory: what it keeps between steps, to be saved and set. A
// hand has only begin() and topSpeed: its torque is given from outside.

import { numbersOf } from "./engine.js";
import { TURN } from "./robot.js";

const same = (a, b) => JSON.stringify(a) === JSON.stringify(b);
/** Return x modulo `period`, from 0 to `period`. */
function modulo(x, period) {
  const rest = x % period;
  return rest < 0 ? rest + period : rest;
}
const limited = (value, most) => Math.max(-most, Math.min(most, value));

/** The controller of a name in `data.controllers` for a machine. */
export function controllerNamed(data, name, machine) {
  const { topSpeed, baselines } = data.control;
  if (name === "hand") return { topSpeed: 1, begin() {} };
  if (name === "constant speed" || name === "pid") {
    const { linkage, bodies } = machine.robot;
    const isOf = (design) =>
      same(data.robots[design].linkage, linkage) && same(data.robots[design].bodies, bodies);
    const own = baselines[Object.keys(baselines).find(isOf)];
    const measured = name === "pid" && own;
    const gains = (measured ? own.gains : own?.steady) ?? scaledGains(data.control, machine);
    const speedOf = measured
      ? (command) => nearest(machine.memory, own.settings, own.speeds, command)
      : rolling(data.control, machine);
    return new Steady(machine, topSpeed, gains, speedOf);
  }
  return new Policy(data.policies[name], machine);
}

/** The paper's gains for a robot's size, weight and motor: tuned.py, scaled_gains. */
function scaledGains({ paper, mostLag }, { linksMass, torqueLimit, tables }) {
  const [kp, ki, kd] = paper.gains;
  const length = Math.max(tables.height / paper.height, 1e-3);
  const time = Math.sqrt(length);
  const torque = Math.min((linksMass / paper.mass) * length, torqueLimit / (kp * mostLag));
  return [kp * torque, (ki * torque) / time, kd * torque * time];
}

/** The crank speed at which a robot that does not slip walks at a command. */
function rolling({ shortestTurn }, { tables }) {
  const way = Math.max(Math.abs(tables.advance), shortestTurn);
  return (command) => (TURN / way) * command;
}

/** The measured setting whose episodes' speeds came closest to a command. */
function nearest(memory, settings, speeds, command) {
  const errors = speeds.map((row) => {
    const away = row.map((speed) => Math.abs(speed - Math.abs(command)));
    return memory.scratch(() => memory.call("closure_mean", memory.filled("f8", away)));
  });
  return Math.sign(command) * settings[errors.indexOf(Math.min(...errors))];
}

/** PID (13) behind a reference that turns with a speed for the command: walker_benchmark.py. */
class Steady {
  memory = null;

  constructor(machine, topSpeed, gains, speedOf) {
    Object.assign(this, { machine, topSpeed, gains, speedOf });
  }

  begin() {
    this.memory = null;
  }

  act() {
    const { machine, gains, speedOf } = this;
    const { observation, observed, torqueLimit, layout } = machine;
    const seen = (name) => observation[observed.indexOf(name)];
    const angle = machine.memory.angles([seen("cos_crank_angle")], [seen("sin_crank_angle")])[0];
    const { last, target, integral } = this.memory ?? { last: angle, target: angle, integral: 0 };
    const unwrapped = last + (modulo(angle - last + Math.PI, TURN) - Math.PI);
    const speed = speedOf(seen("speed_command"));
    const error = target - unwrapped;
    const summed = integral + error * layout.period;
    const rate = speed - seen("crank_speed");
    const torque = gains[0] * error + gains[1] * summed + gains[2] * rate;
    this.memory = {
      last: unwrapped,
      target: target + speed * layout.period,
      integral: Math.abs(torque) < torqueLimit ? summed : integral,
    };
    return Math.fround(limited(torque / torqueLimit, 1));
  }
}

/** A trained policy: policies/pretrained.py. It computes in the machine's memory, and stays there. */
class Policy {
  memory = null;

  constructor(policy, machine) {
    const { memory } = machine;
    Object.assign(this, { policy, machine, topSpeed: policy.fastest });
    this.columns = policy.observed.map((name) => machine.observed.indexOf(name));
    if (this.columns.includes(-1)) throw new Error("the policy observes what this machine lacks");
    const { observed } = machine;
    const more = observed.find(
      (name) => name.startsWith("toe_load_") && !policy.observed.includes(name),
    );
    if (more) throw new Error("the policy has learnt on a robot with fewer toes");
    [this.mean, this.deviation] = ["mean", "deviation"].map((k) =>
      numbersOf(policy[k], Float64Array),
    );
    this.layers = memory.filled("i8", policy.layers.flat(), policy.layers.length, 3);
    this.weights = memory.filled("f8", numbersOf(policy.weights, Float32Array));
    const widest = Math.max(...policy.layers.flatMap((layer) => layer.slice(0, 2)));
    this.work = memory.array("f8", 2, widest);
    this.out = memory.array("f8", 1, 1);
  }

  begin() {}

  act() {
    const { policy, out } = this;
    const { observation, memory } = this.machine;
    const seen = this.columns.map((column) => observation[column]);
    memory.scratch(() => {
      const values = policy.features.flatMap((feature) => this.feature(feature, seen));
      const inputs = memory.filled("f8", values, 1, values.length);
      const limit = policy.limit ?? Number.POSITIVE_INFINITY;
      const network = [this.layers, this.weights, limit, policy.squash, this.work, out];
      memory.call("layers_put_actions", inputs, network);
    });
    return Math.fround(limited(out.view[0], 1));
  }

  feature({ multiples, clip }, seen) {
    const { mean, deviation } = this;
    const { memory } = this.machine;
    if (clip) return seen.map((value, i) => limited((value - mean[i]) / deviation[i], clip));
    if (!multiples) return seen;
    const out = memory.array("f8", 1, 2 * multiples.length);
    const crank = memory.filled("f8", seen.slice(0, 2), 1, 2);
    memory.call("layers_put_harmonics", crank, memory.filled("i8", multiples), out);
    return [...out.view];
  }
}
