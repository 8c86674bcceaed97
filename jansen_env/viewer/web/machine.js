// One robot on a ground, as the environment JansenWalkerEnv moves it, bit for bit.
//
// The engine's kernels own the episode, on the same record as in Python (jansen_env/engine/episode.py).
// What is here makes their arguments. Metres, radians, seconds, newtons.

import { lineOf } from "./ground.js";
import { compileRobot, Leg, listed, padsOf, putMachine, whole } from "./robot.js";
import { sceneOf } from "./scene.js";

const INFINITE = Number.POSITIVE_INFINITY;

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
    this.makeDesigns();
    this.makeRecord();
    this.makeMachine();
    this.makeEpisode();
    this.parameters = this.nominal({ ...layout.ground, ...terrain });
    const { friction, restitution } = this.parameters;
    this.change({ friction, restitution });
    this.reset();
  }

  /** Return the parameters that change nothing: numbers, or where robot or terrain have them. */
  nominal(terrain) {
    const { layout, robot } = this;
    const parts = Object.entries(robot).map(([name, part]) => {
      return [name, part?.is ? whole(layout, part) : part];
    });
    const given = { robot: Object.fromEntries(parts), terrain };
    const found = (path) => path.split(".").reduce((part, name) => part[name], given);
    return Object.fromEntries(
      Object.entries(layout.nominal).map(([name, value]) => {
        return [name, typeof value === "string" ? found(value) : value];
      }),
    );
  }

  /** The robot's tables and its ground: `Designs` of engine/records.py. */
  makeDesigns() {
    const { memory, layout, toes, line, leg } = this;
    const { INTERVALS, ORDER, BODY_SUMS, PAD_FUNCTIONS } = this.numbers;
    const { body, pads, bearings, springs, depths } = this.tables;
    const filled = (values, ...shape) => memory.filled("f8", values, ...shape);
    this.pads = filled(pads, 1, leg.pads.shape[0], INTERVALS, ORDER, PAD_FUNCTIONS);
    const [rows, sides] = padsOf(memory, leg);
    const padCount = rows.length;
    const sizeOf = ([base, perPad]) => base + perPad * padCount;
    this.padLayout = memory.array("PAD", 1, padCount);
    for (const [k, row] of rows.entries()) this.padLayout.write(row, k);
    this.surface = memory.rows("f8", line);
    const capacity = sizeOf(layout.capacity);
    this.world = memory.array("WORLD", 1);
    this.world.write({ ...layout.world, toes, capacity });
    this.designs = [
      this.world,
      filled(body, 1, INTERVALS, ORDER, BODY_SUMS),
      this.pads,
      this.padLayout,
      filled(bearings, 1, bearings.length),
      filled(springs, 1, INTERVALS, ORDER, 1),
      memory.filled("i8", sides, sides.length / 2, 2),
      filled(depths, 1, depths.length),
      this.surface,
    ];
    this.planes = memory.array("PLANE", capacity);
    this.centres = memory.array("f8", Math.max(padCount, toes + 1), 2);
    this.flags = memory.array("b1", 2);
    const at = layout.workSpace.map(({ type, shape }) => memory.array(type, ...shape.map(sizeOf)));
    this.scratch = [...at, this.flags];
    this.rows = memory.array("i8", 1);
    this.queues = memory.array("i8", 2, 2);
    this.trace = memory.array("f8", 0, 0);
    this.still = [memory.array("f8", 1), memory.array("f8", 1), memory.array("i8", 1)];
    this.noPushes = memory.array("f8", 0, 0, 2);
  }

  /** The robot's record: `record_dtype` of engine/records.py. */
  makeRecord() {
    const { memory, layout, toes, padLayout, numbers } = this;
    const parts = {
      robots: ["ROBOT", 1],
      slip: ["f8", 1, toes],
      force: ["f8", 1, toes, 2],
      loads: ["f8", 1, toes],
      statistics: ["STATISTICS", 1, padLayout.length],
      torques: ["f8", 1, layout.delayed],
      schedule: ["f8", 1, numbers.MOST_PUSHES, 3],
      walk: ["WALK", 1],
    };
    const begin = memory.end;
    for (const [name, [type, ...shape]] of Object.entries(parts))
      this[name] = memory.array(type, ...shape);
    this.record = () => new Uint8Array(memory.buffer, begin, this.recordEnd - begin);
    this.recordEnd = memory.end;
    this.states = this.robots.field("state");
    const { length } = this.line; // the robot may be anywhere on its ground
    const ground = { first_near: 0, end_near: length, end_vertex: length, room: layout.room };
    this.robots.write({ status: { ...ground, margin: numbers.SPECULATIVE_MARGIN } });
    this.motions = [this.robots, this.statistics, this.slip, this.force];
  }

  /** What the robot is without parameters: `MACHINE` of engine/records.py. */
  makeMachine() {
    const { memory, tables } = this;
    const { advance, farthest } = tables;
    this.machine = memory.array("MACHINE", 1);
    this.machine.write({ advance, centre: farthest.slice(0, 2), pad: farthest.slice(2) });
    this.putRobot();
    const { links_mass, torque_limit } = this.machine.read();
    Object.assign(this, { linksMass: links_mass, torqueLimit: torque_limit });
  }

  putRobot() {
    const { memory, layout, leg, robot, machine, steepest } = this;
    putMachine(memory, leg, robot, machine);
    const [gravity_x, gravity_y] = layout.gravity;
    const { nominal } = machine.read();
    machine.write({ nominal: { ...nominal, gravity_x, gravity_y, steepest } });
  }

  /** Change the robot's payload to another one of a mass, kg. */
  load(mass) {
    const payload = { is: "Payload", mass };
    this.robot = { ...this.robot, payload: { ...payload, ...whole(this.layout, payload) } };
    this.putRobot();
  }

  /** Task and observation: `Episodes` and `Observing` of engine/episode.py. */
  makeEpisode() {
    const { memory, layout, walk, loads, torques, schedule } = this;
    const task = layout.tasks[this.toes];
    this.observed = task.observed;
    const [settings, push] = [memory.array("SETTINGS", 1), memory.array("PUSHES", 1)];
    settings.write(layout.settings);
    push.write(layout.push);
    this.pushSettings = push;
    this.episodes = [walk, loads, torques, schedule, push, settings];
    const made = Object.entries(task.observing).map(([name, { type, shape, values }]) => [
      name,
      values ? memory.filled(type, values, ...shape) : memory.array(type, ...shape),
    ]);
    this.observing = made.map(([, array]) => array);
    const { observation, known } = Object.fromEntries(made);
    Object.assign(this, { out: observation, known });
    this.actions = memory.array("f8", 1, 1);
    this.angles = memory.array("f8", 1);
  }

  // Parameters.

  /** Return changes with what follows from them; throw an error if one is out of its limits. */
  checked(changes) {
    const { layout } = this;
    for (const [name, value] of Object.entries(changes)) {
      const row = layout.parameters[name];
      if (!row) {
        const known = listed(Object.keys(layout.parameters));
        throw new Error(`a parameter to change must be one of ${known}, got '${name}'`);
      }
      if (!(value >= row.least && value <= row.most))
        throw new Error(`${name} must be between ${row.least} and ${row.most}, got ${value}`);
    }
    const following = Object.keys(changes).map((name) => layout.parameters[name].sets);
    return Object.assign({}, ...following, changes);
  }

  /** Throw an error if the robot cannot have its present parameters. */
  checkFeet() {
    const { layout, parameters } = this;
    const { nominal } = this.machine.read();
    for (const [name, { zeroWhere, onlyZero }] of Object.entries(layout.parameters))
      if (nominal[zeroWhere] && parameters[name] !== 0)
        throw new Error(`${name} must be ${onlyZero}, got ${parameters[name]}`);
    const before = this.record().slice();
    const tooSoft = this.stand() >= 0;
    this.record().set(before);
    if (tooSoft) throw new Error(this.faultOfFeet());
  }

  /** Return why the feet are too soft, in one sentence. */
  faultOfFeet() {
    const { properties } = this.robots.read();
    const { mass, stiffness, gravity_y } = properties;
    // `resting_depth` of jansen_env/engine/placement.py must be at most DEEPEST.
    const least = (0.5 * mass * -gravity_y) / this.numbers.DEEPEST;
    return (
      `pad_compliance.stiffness must be at least ${Number(least.toPrecision(3))} N/m to carry a ` +
      `robot of ${Number(mass.toPrecision(3))} kg, got ${stiffness[0]} N/m`
    );
  }

  /** Apply checked parameters. */
  apply(changes) {
    const { memory, layout, parameters, rows, world, machine, robots } = this;
    Object.assign(parameters, changes);
    if ("payload" in changes) this.load(changes.payload);
    robots.write({ parameters });
    const { gravity } = layout;
    memory.call("episode_apply_parameters", rows, gravity, INFINITE, world, machine, robots);
  }

  /** Change parameters, and the command, m/s, from now on; throws, and then changes nothing. */
  change({ command, ...changes }) {
    const most = this.numbers.FASTEST_COMMAND;
    if (command !== undefined && !(Math.abs(command) <= most))
      throw new Error(`command must be between ${-most} and ${most}, got ${command}`);
    const numbers = this.checked(changes);
    if (Object.keys(numbers).length > 0) {
      const before = this.snapshot();
      try {
        this.apply(numbers);
        this.checkFeet();
      } catch (error) {
        this.restore(before);
        throw error;
      }
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
   * Begin at rest at x = 0 on the lowest toes, with a crank angle in rad and a crank speed in rad/s.
   * `episodeSeed` is the seed of everything that is sampled during the episode, as in `World.seeds`.
   */
  reset({ crankAngle = 0, crankSpeed = 0, command = 0, episodeSeed = 0 } = {}) {
    const { memory, rows, world, machine, motions, episodes, states, robots, walk } = this;
    this.place(crankAngle);
    states.view[7] = crankSpeed;
    this.noisy = this.parameters.noise_level > 0;
    robots.write({ seed: BigInt(episodeSeed), scheduled: 0 });
    walk.write({ info: { speed_command: command } });
    this.known.view[0] = -1n;
    memory.call("episode_begin_episode", rows, world, machine, motions, episodes);
    this.observe();
  }

  /** Lower it onto the ground, and look one time step ahead. */
  place(crankAngle) {
    const { memory, rows } = this;
    this.angles.view[0] = crankAngle;
    this.stand();
    this.noteGround();
    this.queues.view.set([0n, 1n, 0n, 0n]);
    const queued = [0, this.queues, 1, rows, 1, 1];
    const kernelArguments = [queued, this.still, this.noPushes, this.trace, this.scratch];
    memory.call("integrator_advance", kernelArguments.flat(2), this.designs, this.motions);
  }

  /** Put it at x = 0 on its lowest toes; return -1, or do nothing where its feet are too soft. */
  stand() {
    const { memory, rows, angles, designs, motions, centres, planes } = this;
    const where = [rows, angles, 0, Number.NaN];
    return memory.call("placement_place", where, designs, motions, centres, planes);
  }

  /** Hold an action, -1 to 1, for a control step. */
  step(action) {
    if (!Number.isFinite(action))
      throw new Error(`action must be one finite number, got ${action}`);
    const { memory, rows, episodes, observing } = this;
    this.actions.view[0] = action;
    this.queues.view.set([0n, 1n, 0n, 0n]);
    const queued = [0, this.queues, 1, rows, this.actions, this.trace, this.scratch];
    const records = [this.designs, this.motions, episodes, observing];
    memory.call("episode_control_step", queued.flat(), records.flat());
    const [far] = this.flags.view;
    if (far) this.noteGround();
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

  /** Push the chassis at the crank axis from now on by an impulse, N s; throw if there are too many. */
  push(x, y) {
    for (const [name, value] of Object.entries({ Jx: x, Jy: y }))
      if (!Number.isFinite(value))
        throw new Error(`${name} of the impulse must be a finite number, got ${value}`);
    const { memory, robots, schedule, pushSettings, time } = this;
    const before = robots.read(0, "scheduled");
    const given = [time, x, y, pushSettings, before, schedule.at(0)];
    const scheduled = memory.call("pushes_add_push", given);
    if (scheduled < 0)
      throw new Error(
        `a robot must have at most ${before} pushes that are not over, got ${before + 1}`,
      );
    robots.write({ scheduled });
  }

  /** Note where the robot is: the kernels allow it a certain way from there in a step. */
  noteGround() {
    this.robots.write({ status: { ground_x: this.states.view[0] } });
  }

  /** Return all that steps, pushes and changes of parameters change. */
  snapshot() {
    const { parameters, robot, noisy, machine } = this;
    const kept = { parameters: { ...parameters }, robot, noisy };
    const bytes = [this.record(), this.out.bytes, machine.bytes].map((each) => each.slice());
    return { ...kept, bytes };
  }

  /** Continue from a snapshot of this machine. */
  restore({ bytes: [record, out, machine], parameters, ...kept }) {
    this.record().set(record);
    this.out.bytes.set(out);
    this.machine.bytes.set(machine);
    Object.assign(this, kept, { parameters: { ...parameters } });
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
    const { memory, leg, motions, toes: count, layout } = this;
    const [x, y, pitch] = this.states.view;
    const joints = leg.pose(this.states.view);
    const toes = memory.scratch(() => {
      const { points, tangents } = this.contactFrames();
      const [contacts, forces] = [memory.array("i8", count), memory.array("f8", count, 2)];
      const given = [0, layout.period, motions, tangents, contacts, forces];
      memory.call("contact_frames_put_contacts", given.flat());
      const [places, pairs] = [points.pairs(), forces.pairs()];
      return numbered(count, (toe) => {
        return { contact: Number(contacts.view[toe]), point: places[toe], force: pairs[toe] };
      });
    });
    return { x, y, pitch, joints, toes };
  }

  /** Nearest points of the ground to toes, and its tangents there, as arrays (toes, 2). */
  contactFrames() {
    const { memory, robots, planes, toes, surface, world } = this;
    const [centres, points, tangents] = numbered(3, () => memory.array("f8", toes, 2));
    centres.view.set(this.toeCentres());
    robots.write({ status: { margin: this.numbers.SPECULATIVE_MARGIN } });
    memory.call("collision_planes_near", 0, centres, robots, surface, world, planes);
    const { first_plane, end_plane } = robots.read(0, "status");
    const given = [0, first_plane, end_plane, planes, robots, centres, points, tangents];
    memory.call("contact_frames_put_contact_frames", given);
    return { points, tangents };
  }

  /** Centres of the toes' pads, in m: numbers (toes, 2). */
  toeCentres() {
    const { memory, centres, toes } = this;
    const design = [this.states, this.pads.at(0), this.padLayout.at(0), centres];
    memory.call("collision_pad_centres", design);
    return centres.view.slice(0, 2 * toes);
  }

  /** What stays the same while it walks: geometry.py, scene_of_robot. */
  get scene() {
    const { robot, weight, line, tables } = this;
    return {
      ...sceneOf(robot, tables.extent, this.layout.style),
      weight,
      terrain: line,
      speedUnit: "m/s",
    };
  }
}
