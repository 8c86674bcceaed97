// One robot on a ground, as the environment JansenWalkerEnv moves it, bit for bit.
//
// The engine's kernels do the work; what is here stands in jansen_env/world/world.py and
// jansen_env/plants: batch.py, grounds.py, robot_parameters.py. Metres, radians, seconds, newtons.

import { Closure } from "./closure.js";
import { compileRobot, exactSum } from "./tables.js";
import { polyline } from "./terrain.js";

const FLAT = [[-1, 0], [1, 0]]; // biome-ignore format: points
const INFINITE = Number.POSITIVE_INFINITY;
const [AIR, GRIP, SLIP] = [0, 1, 2]; // what a toe does

const slope = ([x, y], [u, v]) => (v - y) / (u - x);
const numbered = (count, make) => Array.from({ length: count }, (_, i) => make(i));

export class Machine {
  /**
   * A promise of a machine. robot: of data.robots, or with other lengths (lengths.js). terrain:
   * {points, friction, restitution}, null for level ground. Rejects if the robot cannot turn its
   * crank.
   */
  static async create(engine, robot, terrain) {
    return new Machine(engine, robot, terrain, await engine.memory());
  }

  constructor(engine, robot, terrain, memory) {
    const { layout } = engine;
    const tables = compileRobot(engine, robot);
    Object.assign(this, { layout, numbers: layout.numbers, memory, robot, tables });
    this.line = polyline(terrain?.points ?? FLAT);
    const slopes = this.line.slice(1).map((to, i) => slope(this.line[i], to));
    this.steepest = slopes.reduce((a, b) => Math.max(a, Math.abs(b)), 0);
    this.stretches = stretchesOf(this.line, layout.numbers);
    const sumOf = (name) => robot.legs.length * exactSum(robot.bodies.map((link) => link[name]));
    Object.assign(this, { linksMass: sumOf("mass"), linksInertia: sumOf("inertia") });
    this.closure = new Closure(memory, robot);
    this.toes = robot.scene.toes.length;
    this.makeFixed();
    this.makeTask();
    this.makeState();
    const { mass: payload, position } = robot.payload;
    const [payload_x, payload_y] = position;
    const names = [layout.copied, layout.scaled].flatMap((part) => Object.keys(part));
    const unity = Object.fromEntries(names.map((name) => [name, 1]));
    const others = { payload, payload_x, payload_y, tilt: 0, gravity_scale: 1, noise_level: 0 };
    this.parameters = { ...unity, ...layout.ground, ...others };
    const { friction, restitution } = { ...layout.ground, ...terrain };
    this.apply(this.checked({ friction, restitution }));
    this.longest = this.numbers.TIME_STEP;
    this.reset();
  }

  /** The robot's tables and its ground, and work space. */
  makeFixed() {
    const { memory, layout, toes, line, robot } = this;
    const { INTERVALS, ORDER, TIME_STEP: time_step, PLANES_PER_PAD } = this.numbers;
    const { body, pads, bearings, depths } = this.tables;
    const filled = (values, ...shape) => memory.filled("f8", values, ...shape);
    this.body = filled(body, 1, INTERVALS, ORDER, body.length / (INTERVALS * ORDER));
    this.pads = filled(pads, 1, robot.pads.length, INTERVALS, ORDER, 3);
    const padCount = robot.layout.length;
    this.padLayout = memory.array("PAD", 1, padCount);
    for (const [k, [table, phase, mirror]] of robot.layout.entries())
      this.padLayout.write({ table, phase, mirror }, k);
    this.model = [this.body, this.pads, this.padLayout, filled(bearings, 1, bearings.length)];
    this.sides = memory.rows("i8", robot.sides);
    this.surface = memory.rows("f8", line);
    this.depths = filled(depths, 1, depths.length);
    const capacity = PLANES_PER_PAD * padCount;
    this.world = memory.array("WORLD", 1);
    this.world.write({ time_step, stride: layout.stride, toes, capacity });
    this.planes = memory.array("PLANE", capacity);
    const [empty, single] = layout.workSpace;
    this.work = empty.map(([type, ...shape], k) => {
      const lengths = shape.map(
        (length, axis) => length + (single[k][axis + 1] - length) * capacity,
      );
      return memory.array(type, ...lengths);
    });
    this.which = memory.array("i8", 1);
    this.active = memory.filled("b1", [1]);
    this.shares = memory.array("i8", 2, 2);
    this.moved = memory.array("i8", 1);
    this.flags = memory.array("b1", 2);
    this.centres = memory.array("f8", Math.max(padCount, toes + 1), 2);
    this.trace = memory.array("f8", 0, 0);
    this.still = [memory.array("f8", 1), memory.array("f8", 1), memory.array("i8", 1)];
  }

  /** The walking task's settings and the columns of its observation, and pushes. */
  makeTask() {
    const { memory, layout } = this;
    const { steps, scan } = layout;
    const task = layout.tasks[this.toes];
    const filled = (type, name) =>
      Array.isArray(task[name][0])
        ? memory.rows(type, task[name])
        : memory.filled(type, task[name]);
    this.observed = task.observed;
    for (const name of ["places", "taskPlaces", "speeds", "angles", "measuredPlaces"])
      this[name] = filled("i8", name);
    this.deviation = filled("f8", "deviation");
    this.limits = [filled("f4", "low"), filled("f4", "high")];
    this.scan = memory.filled("f8", scan);
    this.settings = memory.array("SETTINGS", 1);
    this.settings.write(layout.settings);
    this.exact = [memory.array("f8", 0, 2), memory.array("ACCOUNTS", 0)]; // without noise
    const push = memory.array("PUSHES", 1);
    push.write(layout.push);
    this.unplanned = [memory.array("i8", 1), memory.array("f8", 1), push, memory.array("b1", 1)];
    this.schedule = memory.array("f8", 1, this.numbers.MOST_PUSHES, 3);
    this.scheduled = memory.array("i8", 1);
    this.impulse = memory.array("f8", 1, steps, 2);
    this.noPushes = memory.array("f8", 0, 0, 2);
  }

  /** Arrays that change from step to step: in one piece, for snapshots. */
  makeState() {
    const { memory, toes, padLayout, observed } = this;
    const begin = memory.end;
    const state = {
      states: ["f8", 1, 8],
      robots: ["ROBOT", 1],
      statistics: ["STATISTICS", 1, padLayout.length],
      slip: ["f8", 1, toes],
      force: ["f8", 1, toes, 2],
      readings: ["READINGS", 1],
      walk: ["WALK", 1],
      loads: ["f8", 1, toes],
      actions: ["f8", 1, 1],
      elapsed: ["i8", 1],
      fullTorque: ["f8", 1],
      asked: ["f8", 1, 2],
      delay: ["i8", 1, 2],
      torque: ["f8", 1],
      earlier: ["f8", 1],
      switch: ["i8", 1],
      reward: ["f8", 1],
      ended: ["b1", 1],
      out: ["f4", 1, observed.length],
      seed: ["i8", 1], // of the sensors' noise, as all to the end
      level: ["f8", 1],
      drawn: ["i8", 1],
      bias: ["f8", 1, observed.length],
      error: ["f8", 1, observed.length],
      meanError: ["f8", 1, 2],
      measured: ["ACCOUNTS", 1],
      truth: ["f4", 1, observed.length],
    };
    for (const [name, [type, ...shape]] of Object.entries(state))
      this[name] = memory.array(type, ...shape);
    const { end } = memory;
    this.state = () => new Uint8Array(memory.buffer, begin, end - begin);
    const status = { margin: this.numbers.SPECULATIVE_MARGIN, end_vertex: this.line.length };
    this.robots.write({ status: { ...status, asked_x: INFINITE } });
  }

  // Parameters.

  /** Changes as numbers for `parameters`; throws if one is out of range. */
  checked(changes) {
    const { layout, robot } = this;
    for (const [name, value] of Object.entries(changes)) {
      const limits = layout.limits[name];
      if (!limits) throw new Error(`${name} cannot be changed`);
      const [least, most] = limits;
      if (!(value >= least && value <= most))
        throw new Error(`${name} is ${value}, must be between ${least} and ${most}`);
    }
    const numbers = { ...changes };
    if ("payload" in numbers) Object.assign(numbers, { payload_x: 0, payload_y: 0 });
    const wanted = { ...this.parameters, ...numbers };
    const { stiffness = INFINITE } = robot.pad_compliance;
    if (wanted.restitution > 0 && stiffness < INFINITE)
      throw new Error(`restitution is ${wanted.restitution}, must be 0 with compliant pads`);
    const mass = wanted.mass_scale * this.linksMass + wanted.payload;
    const upright = this.memory.directions([wanted.tilt])[0][0];
    const gravity = this.numbers.GRAVITY * wanted.gravity_scale * upright;
    const depth = (0.5 * mass * gravity) / (wanted.foot_stiffness_scale * stiffness); // at rest
    if (depth > this.numbers.DEEPEST)
      throw new Error(`payload is ${wanted.payload} kg, which these feet are too soft to carry`);
    return numbers;
  }

  /** Put checked numbers in force: robot_parameters.py, apply_to_kernels. */
  apply(numbers) {
    const { layout, tables, memory, parameters } = this;
    const { GRAVITY, BOUND } = this.numbers;
    Object.assign(parameters, numbers);
    this.level.view[0] = parameters.noise_level;
    if ("payload" in numbers) {
      const payload = { mass: numbers.payload, inertia: 0, position: [0, 0] };
      this.robot = { ...this.robot, payload };
    }
    const nominal = Object.entries(this.robot.params).map(([name, value]) => [
      name,
      withInfinity(value),
    ]);
    const row = { ...Object.fromEntries(nominal), load_inertia: this.robot.payload.inertia };
    for (const [name, copied] of Object.entries(layout.copied)) row[copied] = parameters[name];
    for (const [name, fields] of Object.entries(layout.scaled))
      for (const field of fields) {
        const scaled = [row[field]].flat().map((value) => value * parameters[name]);
        row[field] = scaled.length > 1 ? scaled : scaled[0];
      }
    const mass = parameters.mass_scale * this.linksMass + parameters.payload;
    const [pitchArm, crankArm] = tables.farthest.map(
      ([centre, pad]) => BOUND * ((row.mass_scale * centre) / mass + pad),
    );
    const reach = Math.sqrt(row.load_x * row.load_x + row.load_y * row.load_y);
    const [[cos], [sin]] = memory.directions([parameters.tilt]);
    const down = parameters.gravity_scale * -GRAVITY;
    const params = {
      ...row,
      mass,
      own_inertia: this.linksInertia,
      pitch_arm: pitchArm + (row.load_mass * reach) / mass,
      crank_arm: crankArm,
      winding: row.winding / parameters.motor_strength,
      gravity_x: cos * 0 + sin * down,
      gravity_y: cos * down - sin * 0,
      steepest: this.steepest,
    };
    this.robots.write({ params, status: { pad_radius: row.pad_radius } });
    const direction = tables.advance < 0 ? -1 : 1;
    this.weight = GRAVITY * mass * parameters.gravity_scale;
    this.readings.write({ direction, weight: this.weight });
    this.fullTorque.view[0] = direction * this.torqueLimit * parameters.motor_strength;
  }

  /** Change parameters, and the command, m/s, from now on; throws, and then changes nothing. */
  change({ command, ...changes }) {
    const most = this.numbers.FASTEST_COMMAND;
    if (command !== undefined && !(Math.abs(command) <= most))
      throw new Error(`command is ${command}, must be between ${-most} and ${most}`);
    const numbers = this.checked(changes);
    if (Object.keys(numbers).length > 0) this.apply(numbers);
    if (["friction", "restitution", "payload"].some((name) => name in numbers)) {
      this.robots.write({ status: { asked_x: INFINITE } }); // as for a new ground or robot
      this.askGround();
    }
    if (numbers.noise_level > 0 && !this.noisy) this.measure();
    if (command === undefined) return;
    this.walk.write({ next_command: command, info: { speed_command: command } });
    this.describe();
  }

  /** Let sensors err from now on until the next start: what they have measured so far is exact. */
  measure() {
    const { lag, mean_speed, mean_power, rms_torque } = this.walk.read().info;
    this.measured.write({ lag, mean_speed, mean_slip: 0, mean_power, rms_torque });
    this.noisy = true;
  }

  // Episodes and steps.

  /**
   * Begin at rest at x = 0 on the lowest toes, the crank at an angle, rad, with a speed, rad/s.
   * noiseSeed: of `world.seeds`, what sensors' noise is drawn from where there is some.
   */
  reset({ crankAngle = 0, crankSpeed = 0, command = 0, noiseSeed = 0 } = {}) {
    this.place(crankAngle);
    const { force, loads, states, weight, tables } = this;
    const { view: forces } = force;
    loads.view.set(loads.view.map((_, toe) => forces[2 * toe + 1] / weight));
    states.view[7] = crankSpeed;
    this.askGround();
    for (const block of [this.asked, this.torque, this.earlier, this.reward]) block.view.fill(0);
    const { direction } = this.readings.read();
    const [x, , , , x_velocity] = states.view;
    this.readings.bytes.fill(0);
    this.readings.write({ direction, weight, x_before: x, info: { x_velocity } });
    this.walk.bytes.fill(0);
    const mean_path = Math.abs(tables.advance) / this.numbers.STEPS_PER_TURN;
    this.walk.write({ mean_path, next_command: command, info: { speed_command: command } });
    Object.assign(this, { time: 0, pushes: [], noisy: this.parameters.noise_level > 0 });
    this.elapsed.view[0] = 0n;
    this.seed.view[0] = BigInt(noiseSeed);
    this.drawn.view[0] = -1n;
    this.measured.bytes.fill(0);
    this.describe();
  }

  /** Lower it onto the ground, and look one time step ahead. */
  place(crankAngle) {
    const { memory, states, robots, pads, planes, which } = this;
    states.view.fill(0);
    states.view.set([Number.NaN, crankAngle], 2);
    this.askGround();
    const ground = [this.surface, this.world, this.centres, planes];
    memory.call("placement_place", which, states, this.body, pads, this.padLayout, robots, ground);
    const forget = () => {
      for (let pad = 0; pad < this.statistics.length; pad += 1)
        this.statistics.write({ deflection: [INFINITE, 0] }, pad);
    };
    forget();
    const state = states.view.slice();
    this.run(1, [...this.still, this.noPushes]);
    states.view.set(state);
    forget();
  }

  /** Advance by time steps under `asked`: torque, the one before, when it ends, and pushes. */
  run(steps, asked) {
    const { memory, states, robots, statistics, flags, slip, force } = this;
    if (steps * this.numbers.TIME_STEP > this.longest) {
      this.longest = steps * this.numbers.TIME_STEP;
      robots.write({ status: { asked_x: INFINITE } });
      this.askGround();
    }
    const before = [states, statistics].map((block) => block.bytes.slice());
    this.shares.view.set([0n, 1n, 0n, 0n]);
    const split = [0, this.shares, 1, this.which, steps, asked, this.trace, this.work, this.moved];
    const shared = [states, this.model, this.sides, this.surface, this.depths, this.world, robots];
    const results = [this.planes, statistics, slip, force];
    memory.call("integrator_advance", split.flat(), flags, shared.flat(), results);
    const [far, diverged] = flags.view;
    if (diverged) {
      for (const [k, block] of [states, statistics].entries()) block.bytes.set(before[k]);
      for (let pad = 0; pad < statistics.length; pad += 1)
        statistics.write({ slip: 0, impulse: [0, 0] }, pad);
      const sums = Object.keys(robots.read().accumulators).map((name) => [name, 0]);
      robots.write({ accumulators: Object.fromEntries(sums) });
      for (const block of [slip, force]) block.view.fill(0);
    }
    if (far) this.askGround();
    return diverged;
  }

  /** Hold an action, -1 to 1, for a control step. */
  step(action) {
    if (!Number.isFinite(action)) throw new Error(`action is ${action}, must be finite`);
    const { memory, layout, readings } = this;
    const pushes = this.pushesOfStep();
    this.actions.view[0] = action;
    const torques = [this.torque, this.earlier, this.switch];
    const kernelArguments = [this.actions, this.active, this.elapsed, this.fullTorque, readings];
    memory.call("readings_take_actions", kernelArguments, this.asked, this.delay, torques);
    const diverged = this.run(layout.steps, [...torques, pushes]);
    if (this.noisy) this.drawErrors();
    const { which, settings, walk, reward, ended, taskPlaces, states, slip, force } = this;
    const sensed = this.noisy ? [this.meanError, this.measured] : this.exact;
    const task = [which, settings, walk, reward, ended, ...sensed, taskPlaces, layout.period];
    memory.call("walk_reward_finish_step", task, states, slip, force, this.read());
    if (this.noisy) this.addErrors();
    readings.write({ info: { diverged } });
    this.time = Number(this.elapsed.view[0]) * layout.period;
  }

  /** Arguments of the kernels that read a robot's state. */
  read() {
    const { robots, readings, loads, surface, scan, places, out } = this;
    return [robots, readings, loads, surface, scan, places, out];
  }

  /** Fill observation and information as they are now. */
  describe() {
    const { memory, which, walk, taskPlaces, states } = this;
    memory.call("walk_reward_describe", which, walk, taskPlaces, states, this.read());
    if (!this.noisy) return;
    this.drawErrors();
    this.addErrors();
  }

  /** Draw what the sensors err by in this step: world/observations.py, NoisySensors. */
  drawErrors() {
    const { memory, which, elapsed, seed, level, deviation, speeds, drawn, bias } = this;
    const kernelArguments = [which, elapsed, seed, level, deviation, speeds, drawn];
    memory.call("sensors_draw_errors", kernelArguments, bias, this.error, this.meanError);
  }

  addErrors() {
    const { memory, which, error, angles, measured, measuredPlaces, limits, truth, out } = this;
    const accounts = measured.as("f8", 1, measuredPlaces.length);
    memory.call("sensors_add_noise", which, error, angles, accounts, measuredPlaces, limits, truth, out); // biome-ignore format: short
  }

  /** Push the chassis at the crank axis from now on by an impulse, N s: world/push.py. */
  push(x, y) {
    const { layout, numbers } = this;
    if (!Number.isFinite(x + y)) throw new Error(`impulse is ${x}, ${y}, must be finite`);
    const left = this.pushes.filter(([start]) => start + layout.push.duration > this.time);
    if (left.length === numbers.MOST_PUSHES) throw new Error("there are too many pushes");
    this.pushes = [...left, [this.time, x, y]];
  }

  pushesOfStep() {
    const { active, elapsed, unplanned, schedule, scheduled, impulse, pushes } = this;
    if (pushes.length === 0) return this.noPushes;
    schedule.view.set(pushes.flat());
    scheduled.view[0] = BigInt(pushes.length);
    const kernelArguments = [active, elapsed, unplanned, schedule, scheduled, impulse];
    return this.memory.call("pushes_fill_pushes", kernelArguments.flat()) ? impulse : this.noPushes;
  }

  /** Find the stretch of ground that can be reached, where it has moved by the margin. */
  askGround() {
    const { layout, line, states, robots } = this;
    const [x] = states.view;
    const { asked_x, pad_radius } = robots.read(0, "status");
    const { MARGIN, FASTEST, WAY_OUT, LARGEST_MARGIN } = layout.numbers;
    if (Math.abs(x - asked_x) <= MARGIN) return;
    const room = MARGIN + FASTEST * this.longest;
    const reach = room + this.tables.extent + pad_radius + Math.max(WAY_OUT, LARGEST_MARGIN);
    const [first, last] = [line[0][0], line.at(-1)[0]];
    const left = Math.min(Math.max(x - reach, first), last);
    const right = Math.max(Math.min(x + reach, last), first);
    const near = this.stretches.filter(([a, b]) => line[b][0] >= left && line[a][0] <= right);
    if (near.length === 0) throw new Error(`there is no ground at x = ${x} m`);
    const [first_near, end_near] = [near[0][0], near.at(-1)[1] + 1];
    robots.write({ status: { first_near, end_near, asked_x: x, room } });
  }

  /** All that the future depends on. */
  snapshot() {
    const { parameters, robot, pushes, time, longest, weight, noisy } = this;
    const kept = { parameters: { ...parameters }, robot, pushes, time, longest, weight, noisy };
    return { ...kept, bytes: this.state().slice() };
  }

  /** Go on from a snapshot of this machine. */
  restore({ bytes, parameters, ...kept }) {
    this.state().set(bytes);
    Object.assign(this, kept, { parameters: { ...parameters } });
  }

  // Questions.

  get observation() {
    return this.out.view.slice();
  }

  get torqueLimit() {
    return this.robot.motor.torque_limit;
  }

  get command() {
    return this.walk.read(0, "info").speed_command;
  }

  /** The environment's `info`, with time and reward; flags are 0 or 1. */
  get info() {
    const [{ info, energy }, walk] = [this.readings.read(), this.walk.read()];
    const arrays = { slip: [...this.slip.view], contact_force: [...this.force.view], energy };
    const rewards = { reward: this.reward.view[0], rewards: walk.reward };
    return { ...info, ...walk.info, ...arrays, ...rewards, time: this.time };
  }

  /** Where legs and toes are: what scene.js draws, as World.frame has it. */
  pose() {
    const { layout, memory, closure, weight, force, slip } = this;
    const [x, y, pitch, psi] = this.states.view;
    const [[cos], [sin]] = memory.directions([pitch]);
    const places = closure.legs([psi]);
    const joints = places.map((u, i) =>
      i % 2 === 0 ? cos * u - sin * places[i + 1] + x : sin * places[i - 1] + cos * u + y,
    );
    const toes = this.contactFrames().map(({ point, tangent: [u, v] }, toe) => {
      const [along, across] = force.view.slice(2 * toe, 2 * toe + 2);
      const held = across > this.numbers.TOUCHING * weight ? GRIP : AIR;
      const contact = slip.view[toe] > this.numbers.SLIPPING * layout.period ? SLIP : held;
      return { contact, point, force: [along * u - across * v, along * v + across * u] };
    });
    return { x, y, pitch, joints, toes };
  }

  /** Nearest points of the ground to toes, and its tangents there: batch.py, contact_frames. */
  contactFrames() {
    const { memory, robots, planes, toes, robot, centres, surface, world } = this;
    const radius = robot.pad_radius;
    const design = [this.states.at(0), this.pads.at(0), this.padLayout.at(0), centres];
    memory.call("collision_pad_centres", design);
    const places = numbered(toes, (toe) => [...centres.view.slice(2 * toe, 2 * toe + 2)]);
    const frames = places.map(([x, y]) => ({ point: [x, y - radius], tangent: [1, 0] }));
    robots.write({ status: { margin: this.numbers.SPECULATIVE_MARGIN } });
    memory.scratch(() => {
      const points = memory.filled("f8", places.flat(), toes, 2);
      memory.call("collision_planes_near", 0, points, robots, surface, world, planes);
    });
    const { first_plane, end_plane } = robots.read(0, "status");
    for (let k = end_plane - 1; k >= first_plane; k -= 1) {
      const { pad, normal_x: u, normal_y: v } = planes.read(k); // a pad's nearest comes last
      const [x, y] = places[pad];
      frames[pad] = { point: [x - radius * u, y - radius * v], tangent: [v, -u] };
    }
    return frames;
  }

  /** What stays the same while it walks: geometry.py, scene_of_robot. */
  get scene() {
    const { robot, weight, line } = this;
    const { mass, position } = robot.payload;
    const payload = mass > 0 ? { mass, x: position[0], y: position[1] } : null;
    return { ...robot.scene, weight, payload, terrain: line, speedUnit: "m/s" };
  }
}

/** A number or a list of them, in which null is infinite. */
function withInfinity(value) {
  return Array.isArray(value) ? value.map(withInfinity) : (value ?? INFINITE);
}

/** A ground's stretches as pairs of vertices: grounds.py, make_shapes. */
function stretchesOf(line, { STRETCH, MOST_STRETCHES }) {
  const start = line[1][0];
  const length = Math.max(STRETCH, (line.at(-2)[0] - start) / MOST_STRETCHES);
  const place = line.map(([x]) => Math.floor((x - start) / length));
  const inside = (i) => i > 1 && i < line.length - 2;
  const cuts = [...line.keys()].filter((i) => !inside(i) || place[i] !== place[i - 1]);
  return cuts.slice(1).map((last, k) => [cuts[k], last]);
}
