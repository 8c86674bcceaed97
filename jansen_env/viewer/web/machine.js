// One robot on a ground, as the environment JansenWalkerEnv moves it, bit for bit.
//
// The engine's kernels own the episode, on the same record as in Python (jansen_env/engine/episode.py).
// What is here makes their arguments. Metres, radians, seconds, newtons.

import { lineOf } from "./ground.js";
import { compileRobot, Leg, padsOf, putMachine } from "./robot.js";
import { sceneOf } from "./scene.js";

const INFINITE = Number.POSITIVE_INFINITY;
const [AIR, GRIP, SLIP] = [0, 1, 2]; // what a toe does
const DELAYED = 2; // torques that are kept

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
    [this.line, this.steepest] = lineOf(engine.work, terrain?.points ?? layout.flat);
    this.leg = new Leg(memory, robot);
    this.toes = robot.legs.length * this.leg.toes.length;
    this.pushes = [];
    this.makeDesigns();
    this.makeRecord();
    this.makeMachine();
    this.makeEpisode();
    const { mass: payload, position } = robot.payload;
    const [payload_x, payload_y] = position;
    const { friction, restitution } = { ...layout.ground, ...terrain };
    const nominal = { friction, restitution, payload, payload_x, payload_y, noise_level: 0 };
    this.parameters = { ...layout.nominal, ...nominal };
    this.apply(this.checked({ friction, restitution }));
    this.longest = this.numbers.TIME_STEP;
    this.reset();
  }

  /** The robot's tables and its ground: `Designs` of engine/records.py. */
  makeDesigns() {
    const { memory, layout, toes, line, leg } = this;
    const { INTERVALS, ORDER, TIME_STEP: time_step, PLANES_PER_PAD } = this.numbers;
    const { body, pads, bearings, depths } = this.tables;
    const filled = (values, ...shape) => memory.filled("f8", values, ...shape);
    this.pads = filled(pads, 1, leg.pads.shape[0], INTERVALS, ORDER, 3);
    const [rows, sides] = padsOf(memory, leg);
    const padCount = rows.length;
    this.padLayout = memory.array("PAD", 1, padCount);
    for (const [k, row] of rows.entries()) this.padLayout.write(row, k);
    this.surface = memory.rows("f8", line);
    const capacity = PLANES_PER_PAD * padCount;
    this.world = memory.array("WORLD", 1);
    const { stride, steps, period } = layout;
    const compiled = { is_walk: 1, is_whole: 1 };
    this.world.write({ time_step, stride, toes, capacity, steps, period, ...compiled });
    this.designs = [
      this.world,
      filled(body, 1, INTERVALS, ORDER, body.length / (INTERVALS * ORDER)),
      this.pads,
      this.padLayout,
      filled(bearings, 1, bearings.length),
      memory.filled("i8", sides, sides.length / 2, 2),
      filled(depths, 1, depths.length),
      this.surface,
    ];
    this.planes = memory.array("PLANE", capacity);
    this.centres = memory.array("f8", Math.max(padCount, toes + 1), 2);
    this.flags = memory.array("b1", 2);
    const at = layout.workSpace.map(({ type, shape }) =>
      memory.array(type, ...shape.map(([base, perPlane, perPad]) => base + perPlane * capacity + perPad * padCount)),
    ); // biome-ignore format: long
    this.scratch = [...at, this.flags];
    this.rows = memory.array("i8", 1);
    this.shares = memory.array("i8", 2, 2);
    this.trace = memory.array("f8", 0, 0);
    this.still = [memory.array("f8", 1), memory.array("f8", 1), memory.array("i8", 1)];
    this.noPushes = memory.array("f8", 0, 0, 2);
  }

  /** The record, all that the future depends on: `record_dtype` of engine/records.py. */
  makeRecord() {
    const { memory, toes, padLayout, numbers } = this;
    const parts = {
      robots: ["ROBOT", 1],
      slip: ["f8", 1, toes],
      force: ["f8", 1, toes, 2],
      loads: ["f8", 1, toes],
      statistics: ["STATISTICS", 1, padLayout.length],
      torques: ["f8", 1, DELAYED],
      schedule: ["f8", 1, numbers.MOST_PUSHES, 3],
      walk: ["WALK", 1],
    };
    const begin = memory.end;
    for (const [name, [type, ...shape]] of Object.entries(parts))
      this[name] = memory.array(type, ...shape);
    this.record = () => new Uint8Array(memory.buffer, begin, this.recordEnd - begin);
    this.recordEnd = memory.end;
    this.states = this.robots.field("state");
    const status = { margin: numbers.SPECULATIVE_MARGIN, end_vertex: this.line.length };
    this.robots.write({ status: { ...status, asked_x: INFINITE }, random_pushes: 0 });
    this.motions = [this.robots, this.statistics, this.slip, this.force];
  }

  /** What the robot is without parameters: `MACHINE` of engine/records.py. */
  makeMachine() {
    const { memory, tables, leg } = this;
    const { advance, farthest } = tables;
    this.machine = memory.array("MACHINE", 1);
    putMachine(memory, leg, this.machine);
    this.machine.write({ advance, centre: farthest.slice(0, 2), pad: farthest.slice(2) });
    const { links_mass, torque_limit, nominal } = this.machine.read();
    Object.assign(this, { linksMass: links_mass, torqueLimit: torque_limit });
    this.machine.write({
      nominal: { ...nominal, gravity_y: -this.numbers.GRAVITY, steepest: this.steepest },
    });
  }

  /** Change the robot's payload. */
  load(payload) {
    this.robot = { ...this.robot, payload: { ...this.robot.payload, ...payload } };
    const { nominal } = this.machine.read();
    this.machine.write({ nominal: { ...nominal, load_inertia: this.robot.payload.inertia } });
  }

  /** Task and observation: `Episodes` and `Observing` of engine/episode.py. */
  makeEpisode() {
    const { memory, layout, walk, loads, torques, schedule } = this;
    const task = layout.tasks[this.toes];
    this.observed = task.observed;
    const count = task.observed.length;
    const filled = (type, values, ...axes) =>
      Array.isArray(values[0]) ? memory.rows(type, values) : memory.filled(type, values, ...axes);
    const [settings, push] = [memory.array("SETTINGS", 1), memory.array("PUSHES", 1)];
    settings.write(layout.settings);
    push.write(layout.push);
    this.episodes = [walk, loads, torques, schedule, push, settings];
    this.out = memory.array("f4", 1, count);
    this.known = memory.filled("i8", [-1]);
    this.actions = memory.array("f8", 1, 1);
    this.angles = memory.array("f8", 1);
    this.observing = [
      this.out,
      memory.filled("f8", layout.scan),
      filled("i8", task.columns),
      filled("i8", task.taskColumns),
      filled("i8", task.onboardColumns),
      memory.array("f4", 0, 0, 0, 0),
      filled("f8", task.deviation),
      filled("i8", task.speeds),
      filled("i8", task.angles),
      filled("f4", task.low),
      filled("f4", task.high),
      this.known,
      memory.array("f8", 1, count),
      memory.array("f8", 1, count),
      memory.array("f8", 1, 2),
      memory.array("f4", 1, count),
    ];
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

  /** Apply checked parameters. */
  apply(changes) {
    const { memory, parameters, rows, world, machine, robots } = this;
    Object.assign(parameters, changes);
    if ("payload" in changes) {
      this.load({ mass: changes.payload, inertia: 0, position: [0, 0] });
    }
    robots.write({ parameters });
    const { GRAVITY } = this.numbers;
    const gravity = [0, -GRAVITY, GRAVITY];
    memory.call("episode_apply_parameters", rows, gravity, INFINITE, world, machine, robots);
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
    this.observe();
  }

  /** Let sensors err from now on until the next start: what they have measured so far is exact. */
  measure() {
    const { lag, mean_speed, mean_power, rms_torque } = this.walk.read().info;
    this.walk.write({ measured: { lag, mean_speed, mean_slip: 0, mean_power, rms_torque } });
    this.noisy = true;
  }

  /** Whether sensors err. */
  get noisy() {
    return this.world.read().noisy === 1;
  }

  set noisy(noisy) {
    this.world.write({ noisy: Number(noisy) });
  }

  // Episodes and steps.

  /**
   * Begin at rest at x = 0 on the lowest toes, the crank at an angle, rad, with a speed, rad/s.
   * noiseSeed: of `world.seeds`, what sensors' noise is drawn from where there is some.
   */
  reset({ crankAngle = 0, crankSpeed = 0, command = 0, noiseSeed = 0 } = {}) {
    const { memory, rows, world, machine, motions, episodes, states, robots, walk } = this;
    this.place(crankAngle);
    states.view[7] = crankSpeed;
    this.askGround();
    this.pushes = [];
    this.noisy = this.parameters.noise_level > 0;
    robots.write({ seed: BigInt(noiseSeed), scheduled: 0 });
    walk.write({ info: { speed_command: command } });
    this.known.view[0] = -1n;
    memory.call("episode_begin_episode", rows, world, machine, motions, episodes);
    this.observe();
  }

  /** Lower it onto the ground, and look one time step ahead. */
  place(crankAngle) {
    const { memory, states, planes, rows } = this;
    states.view[0] = 0;
    this.askGround();
    this.angles.view[0] = crankAngle;
    const where = [rows, this.angles, 0, Number.NaN];
    memory.call("placement_place", where, this.designs, this.motions, this.centres, planes);
    this.shares.view.set([0n, 1n, 0n, 0n]);
    const share = [0, this.shares, 1, rows, 1, 1];
    const kernelArguments = [share, this.still, this.noPushes, this.trace, this.scratch];
    memory.call("integrator_advance", kernelArguments.flat(2), this.designs, this.motions);
  }

  /** Hold an action, -1 to 1, for a control step. */
  step(action) {
    if (!Number.isFinite(action)) throw new Error(`action is ${action}, must be finite`);
    const { memory, layout, rows, episodes, observing, pushes } = this;
    if (layout.period > this.longest) {
      this.longest = layout.period;
      this.robots.write({ status: { asked_x: INFINITE } });
      this.askGround();
    }
    this.robots.write({ scheduled: pushes.length });
    this.schedule.view.set(pushes.flat());
    this.actions.view[0] = action;
    this.shares.view.set([0n, 1n, 0n, 0n]);
    const share = [0, this.shares, 1, rows, this.actions, this.trace, this.scratch];
    const records = [this.designs, this.motions, episodes, observing];
    memory.call("episode_control_step", share.flat(), records.flat());
    const [far] = this.flags.view;
    if (far) this.askGround();
  }

  /** Time since the start, s. */
  get time() {
    return this.robots.read(0, "elapsed") * this.layout.period;
  }

  /** Weight with the payload, N. */
  get weight() {
    return this.robots.read(0, "weight");
  }

  /** Fill observation and information as they are now. */
  observe() {
    const { memory, rows, world, surface, motions, episodes, observing } = this;
    const kernelArguments = [rows, 0, world, surface, motions, episodes, observing];
    memory.call("episode_observe", kernelArguments.flat());
  }

  /** Push the chassis at the crank axis from now on by an impulse, N s: world/push.py. */
  push(x, y) {
    const { layout, numbers } = this;
    if (!Number.isFinite(x + y)) throw new Error(`impulse is ${x}, ${y}, must be finite`);
    const left = this.pushes.filter(([start]) => start + layout.push.duration > this.time);
    if (left.length === numbers.MOST_PUSHES) throw new Error("there are too many pushes");
    this.pushes = [...left, [this.time, x, y]];
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
    const [first_near, last] = stretchAround(line, x - reach, x + reach);
    robots.write({ status: { first_near, end_near: last + 1, asked_x: x, room } });
  }

  /** All that the future depends on. */
  snapshot() {
    const { parameters, robot, pushes, longest, noisy } = this;
    const kept = { parameters: { ...parameters }, robot, pushes, longest, noisy };
    return { ...kept, record: this.record().slice(), out: this.out.bytes.slice() };
  }

  /** Continue from a snapshot of this machine. */
  restore({ record, out, parameters, ...kept }) {
    this.record().set(record);
    this.out.bytes.set(out);
    Object.assign(this, kept, { parameters: { ...parameters } });
    this.load(this.robot.payload);
  }

  // Questions.

  get observation() {
    return this.out.view.slice();
  }

  get command() {
    return this.walk.read(0, "info").speed_command;
  }

  /** The environment's `info`, with time and reward; flags are 0 or 1. */
  get info() {
    const [{ info, energy, reward }, walk] = [this.robots.read(), this.walk.read()];
    const arrays = { slip: [...this.slip.view], contact_force: [...this.force.view], energy };
    const rewards = { reward, rewards: walk.reward };
    return { ...info, ...walk.info, ...arrays, ...rewards, time: this.time };
  }

  /** Where legs and toes are: what scene.js draws, as World.frame has it. */
  pose() {
    const { layout, leg, weight, force, slip } = this;
    const [x, y, pitch] = this.states.view;
    const joints = leg.pose(this.states.view);
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
    const design = [this.states, this.pads.at(0), this.padLayout.at(0), centres];
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
    const { robot, weight, line, tables } = this;
    return { ...sceneOf(robot, tables.extent), weight, terrain: line, speedUnit: "m/s" };
  }
}

/** Return the first and last vertex of a height line around two x: find_stretch of grounds.py. */
function stretchAround(line, left, right) {
  const count = line.length;
  const beyond = line.findIndex(([x]) => x > left);
  const at = line.findIndex(([x]) => x >= right);
  const first = Math.min(Math.max((beyond < 0 ? count : beyond) - 1, 0), count - 2);
  const last = Math.max(Math.min(at < 0 ? count : at, count - 1), first + 1);
  return [first, last];
}
