// Calls the engine's kernels as they were called natively, and compares results and memory:
//     node replay.mjs engine.wasm calls.json data
// It prints the number of calls, or ends with 1 at the first that differs.
import { readFileSync } from "node:fs";

const [library, list, data] = process.argv.slice(2).map((path) => readFileSync(path));
const engine = new WebAssembly.Instance(new WebAssembly.Module(library)).exports;
const PAGE = 65536;
const rounded = (size) => Math.ceil(size / 16) * 16;
const calls = JSON.parse(list);

for (const [number, call] of calls.entries()) {
	let end = rounded(engine.__heap_base.value);
	const places = call.sizes.map((size) => {
		const place = end;
		end += rounded(size);
		return place;
	});
	const missing = end + 8 * call.words.length - engine.memory.buffer.byteLength;
	if (missing > 0) engine.memory.grow(Math.ceil(missing / PAGE));
	const memory = new Uint8Array(engine.memory.buffer);
	const slots = new BigInt64Array(engine.memory.buffer, end, call.words.length);
	for (const [i, place] of places.entries())
		memory.set(data.subarray(call.before[i], call.before[i] + call.sizes[i]), place);
	for (const [i, word] of call.words.entries()) slots[i] = BigInt(word);
	for (const [slot, range, offset] of call.pointers) slots[slot] = BigInt(places[range] + offset);
	const result = Number(engine[call.symbol](BigInt(end)));
	const differs = (place, i) => {
		const wanted = data.subarray(call.after[i], call.after[i] + call.sizes[i]);
		return Buffer.compare(wanted, memory.subarray(place, place + call.sizes[i])) !== 0;
	};
	if ((call.result !== null && !Object.is(result, call.result)) || places.some(differs)) {
		console.log(`call ${number}, of ${call.symbol}, differs: ${result}, ${call.result}`);
		for (const [i, place] of places.entries())
			for (let k = 0; k < call.sizes[i]; k++)
				if (memory[place + k] !== data[call.after[i] + k]) {
					console.log(`range ${i} of ${call.sizes[i]} bytes, at ${k}`);
					break;
				}
		process.exit(1);
	}
}
console.log(calls.length);
