// What turns the crank: a hand, the robot's own PID at a speed that walks at the command, or a policy.
//
// Each has begin(), act() -> action, -1 to 1, for the machine as it stands, topSpeed, m/s, the
// fastest command that makes sense, and memory: what it keeps between steps, to be saved and set. A
// hand has only begin() and topSpeed: its torque is given from outside.

import { numbersOf } from "./engine.js";
import { listed } from "./robot.js";

const same = (a, b) => JSON.stringify(a) === JSON.stringify(b);

/** The action that stands for a controller's output, which is at most `largest`. */
function actionFor(memory, outputs, largest) {
  const action = memory.array("f4", 1);
  memory.call("layers_put_commands", outputs, largest, action);
  return action.view[0];
}

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
      : rolling(machine);
    return new Steady(machine, topSpeed, gains, speedOf);
  }
  return new Policy(data.policies[name], machine);
}

/** The paper's gains for a robot's size, weight and motor. */
function scaledGains({ paper, mostLag }, { memory, linksMass, torqueLimit, tables }) {
  return memory.scratch(() => {
    const [scale, gains] = [memory.array("f8", 3), memory.array("f8", 3)];
    const given = memory.filled("f8", paper.gains);
    const robots = [tables.height, linksMass, torqueLimit, paper.height, paper.mass];
    memory.call("crank_control_put_scale", robots, paper.gains[0], mostLag, scale);
    memory.call("crank_control_put_scaled_gains", given, scale, gains);
    return [...gains.view];
  });
}

/** The crank speed at which a robot that does not slip walks at a command. */
function rolling({ memory, tables }) {
  return (command) =>
    memory.scratch(() => {
      const [commands, speeds] = [memory.filled("f8", [command]), memory.array("f8", 1)];
      memory.call("crank_control_put_rolling_speeds", tables.advance, commands, speeds);
      return speeds.view[0];
    });
}

/** The measured setting whose episodes' speeds came closest to a command. */
function nearest(memory, settings, speeds, command) {
  return memory.scratch(() => {
    const [rows, commands] = [memory.rows("f8", speeds), memory.filled("f8", [command])];
    const [work, out] = [memory.array("f8", speeds[0].length), memory.array("f8", 1)];
    const given = [memory.filled("f8", settings), rows, commands, work, out];
    memory.call("crank_control_put_nearest_settings", given);
    return out.view[0];
  });
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
    const { memory, observation, observed, torqueLimit, layout } = machine;
    const seen = (name) => observation[observed.indexOf(name)];
    const angle = memory.angles([seen("cos_crank_angle")], [seen("sin_crank_angle")])[0];
    const { turned, integral } = this.memory ?? { turned: [angle, angle], integral: 0 };
    const speed = speedOf(seen("speed_command"));
    return memory.scratch(() => {
      const filled = (...values) => memory.filled("f8", values);
      const [error, rate, torque] = [filled(0), filled(0), filled(0)];
      const [kept, sum] = [memory.filled("f8", turned, 1, 2), filled(integral)];
      const crank = [filled(angle), filled(seen("crank_speed")), filled(speed), layout.period];
      memory.call("crank_control_put_reference_errors", crank, kept, error, rate);
      const limits = [layout.period, torqueLimit];
      const given = [filled(...gains), error, rate, limits, sum, torque].flat();
      memory.call("crank_control_put_pid_torques", given);
      this.memory = { turned: [...kept.view], integral: sum.view[0] };
      return actionFor(memory, torque, torqueLimit);
    });
  }
}

/** A trained policy: policies/pretrained.py. It computes in the machine's memory, and stays there. */
class Policy {
  memory = null;

  constructor(policy, machine) {
    const { memory } = machine;
    Object.assign(this, { policy, machine, topSpeed: policy.fastest });
    this.columns = policy.observed.map((name) => machine.observed.indexOf(name));
    const { observed } = machine;
    const missing = policy.observed.find((name) => !observed.includes(name));
    if (missing)
      throw new Error(
        "the policy must observe only numbers of this environment, " +
          `${listed(observed.filter(Boolean))}, got ${missing}`,
      );
    const more = observed.find(
      (name) => name.startsWith("toe_load_") && !policy.observed.includes(name),
    );
    if (more)
      throw new Error(
        "the policy must observe all toe loads of this environment, got a policy without " +
          `${more}, which was trained on a robot with fewer toes`,
      );
    [this.mean, this.deviation] = ["mean", "deviation"].map((k) =>
      memory.filled("f8", numbersOf(policy[k], Float64Array)),
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
    return memory.scratch(() => {
      const values = policy.features.flatMap((feature) => this.feature(feature, seen));
      const inputs = memory.filled("f8", values, 1, values.length);
      const limit = policy.limit ?? Number.POSITIVE_INFINITY;
      const network = [this.layers, this.weights, limit, policy.squash, this.work, out];
      memory.call("layers_put_actions", inputs, network);
      return actionFor(memory, out.at(0), 1);
    });
  }

  feature({ multiples, clip }, seen) {
    const { mean, deviation } = this;
    const { memory } = this.machine;
    if (clip) {
      const normalized = memory.array("f8", 1, seen.length);
      const values = memory.filled("f8", seen, 1, seen.length);
      memory.call("layers_put_normalized", values, mean, deviation, clip, normalized);
      return [...normalized.view];
    }
    if (!multiples) return seen;
    const out = memory.array("f8", 1, 2 * multiples.length);
    const crank = memory.filled("f8", seen.slice(0, 2), 1, 2);
    memory.call("layers_put_harmonics", crank, memory.filled("i8", multiples), out);
    return [...out.view];
  }
}
