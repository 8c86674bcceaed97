// Lets robots walk as a page does: node walk.mjs FOLDER < {data, robots, walks, saved} > results
//
// Prints for each of `robots`, which is [name, lengths or null] or the content of a robot file, the robot,
// and its tables or why it has none; of each walk {robot: place in robots, terrain, control, actions by
// hand, settings, start, events: [step, method, arguments], names of info} the numbers of its start
// and of each step, all in base64, and its last pose; and walks as the page saves them, `saved`: [{robot, ground, control}]. In between each walk goes back
// ten steps, and comes again.
import { readFileSync } from "node:fs";

const folder = process.argv[2];
const load = (name) => import(`${folder}/${name}.js`);
const [{ loadEngine }, { robotWithLengths }, { checkRobot, compileRobot }, { Machine }, { controllerNamed }, { Walker }] =
	await Promise.all(["engine", "lengths", "robot", "machine", "controllers", "walker"].map(load));
const { data, robots, walks, saved } = JSON.parse(readFileSync(0, "utf8"));
const engine = await loadEngine(Buffer.from(data.engine, "base64"), data.layout);
const packed = (values) => Buffer.from(Float64Array.from(values).buffer).toString("base64");

function numbersOf(machine, names, action) {
	const { info, states, observation } = machine;
	const told = names.map(([group, name]) => Number((group ? info[group] : info)[name]));
	const seen = observation.filter((_, column) => machine.observed[column]);
	return [action, ...states.view, info.reward, ...seen, ...told, ...info.slip, ...info.contact_force];
}

async function walk({ robot, terrain, control, actions, settings, start, events, names }) {
	const machine = await Machine.create(engine, made[robot], terrain);
	const controller = controllerNamed(data, control, machine);
	machine.change(settings);
	machine.reset(start);
	controller.begin();
	const rows = [numbersOf(machine, names, 0)];
	let saved;
	for (let step = 0, again = 0; step < actions.length; step++) {
		if (step % 100 === 40) saved = [machine.snapshot(), structuredClone(controller.memory)];
		if (step % 100 === 50 && again < step) {
			again = step;
			step -= 10;
			machine.restore(saved[0]);
			controller.memory = saved[1];
			rows.length -= 10;
		}
		for (const [at, method, given] of events) if (at === step) attempt(machine, method, given);
		const action = control === "hand" ? actions[step] : controller.act();
		machine.step(action);
		rows.push(numbersOf(machine, names, action));
	}
	return { numbers: packed(rows.flat()), pose: { ...machine.pose(), joints: [...machine.pose().joints] }, scene: machine.scene };
}

function attempt(machine, method, given) {
	try {
		machine[method](...given);
	} catch {} // refused, as in Python, or the numbers differ
}

function make(asked) {
	if (!Array.isArray(asked)) return asked;
	const [name, lengths] = asked;
	return lengths ? robotWithLengths(engine, data, name, lengths) : data.robots[name];
}
const made = robots.map(make);
function tablesOf(robot) {
	try {
		const { name, ...content } = robot;
		const checked = checkRobot(engine, content);
		const { body, pads, bearings, springs, depths, extent, farthest, advance, height } = compileRobot(engine, checked);
		return [body, pads, bearings, springs, depths, farthest, [extent, advance, height]].map(packed);
	} catch (error) {
		return error.message;
	}
}
/** A walk as the page saves it, pushed and changed on its way. */
async function save({ robot, ground, control }) {
	const walker = await Walker.create(engine, data, made[robot], ground, control);
	for (const seed of [3, 7]) walker.start(seed, { friction: 0.6, payload: 0.5, gravity_scale: 0.8 }, 0.3);
	const states = [[...walker.machine.states.view]];
	for (let step = 0; step < 80; step++) {
		if (step % 30 === 10) walker.push(0.3, step / 100);
		if (step === 20) walker.change({ payload: 1.5, tilt: 0.02, noise_level: 1 });
		walker.step(0.3 * Math.sin(step), 0.3 + step / 1000);
		states.push([...walker.machine.states.view]);
	}
	return { file: walker.file("a walk"), states };
}

const walked = await Promise.all(walks.map(walk));
const files = await Promise.all(saved.map(save));
console.log(JSON.stringify({ robots: made, tables: made.map(tablesOf), walks: walked, saved: files }));
