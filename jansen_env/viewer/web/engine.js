// The compiled engine in a page: memory for its arrays, and calls of its kernels.
//
// An entry point of the module has one argument, the address of its slots: 8 bytes for each number,
// and for each array its address and its lengths, with those of records also the distance between
// two rows in bytes (jansen_env/engine/kernel.py). Which arguments a
// kernel has, and where the fields of a row are, walk_data.py writes.

const PAGE = 65536; // bytes
const GROWTH = 64; // pages by which memory grows, at least
const WORD = 8; // bytes of a slot, and what arrays are aligned to
const MOST_SLOTS = 256;
const READERS = {
  f8: (reader, place) => reader.getFloat64(place, true),
  i8: (reader, place) => Number(reader.getBigInt64(place, true)),
  b1: (reader, place) => reader.getUint8(place),
};
const VIEWS = {
  f8: Float64Array,
  f4: Float32Array,
  i8: BigInt64Array,
  u8: BigUint64Array,
  b1: Uint8Array,
};

/** An array (count,) of numbers. */
export function tabulate(count, make) {
  const out = new Float64Array(count);
  for (let i = 0; i < count; i += 1) out[i] = make(i);
  return out;
}

/** Numbers, a typed array of class `Kind`, out of text in base64. */
export function numbersOf(text, Kind) {
  return new Kind(Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer);
}

/**
 * The engine of a module, `bytes`, a Uint8Array; `layout` is that of walk_data.py. Rejects with a
 * sentence for the user where the browser cannot run it.
 */
export async function loadEngine(bytes, layout) {
  if (typeof WebAssembly === "undefined")
    throw new Error(
      "This browser has no WebAssembly, in which the simulation runs. Lockdown Mode of iOS and macOS switches it off, for example.",
    );
  try {
    const engine = new Engine(await WebAssembly.compile(bytes), layout);
    engine.work = await engine.memory();
    return engine;
  } catch (error) {
    throw new Error(`This browser refused to run the simulation: ${error.message}`);
  }
}

/** A compiled module. `work` is memory to be used within its scratch(). */
class Engine {
  work = null;

  constructor(module, layout) {
    Object.assign(this, { module, layout });
  }

  /** A promise of new memory, which is gone when nothing refers to it any more. */
  async memory() {
    return new Memory(await WebAssembly.instantiate(this.module), this.layout);
  }
}

/** An instance of the module: arrays in its memory, and the kernels that work on them. */
export class Memory {
  constructor({ exports }, layout) {
    Object.assign(this, { exports, layout, end: exports.__heap_base.value });
    this.slots = this.array("i8", MOST_SLOTS);
  }

  get buffer() {
    return this.exports.memory.buffer;
  }

  /** A view of all memory; another one once it has grown. */
  get reader() {
    if (this.whole?.buffer !== this.buffer) this.whole = new DataView(this.buffer);
    return this.whole;
  }

  /** An array of zeros; `type`: "f8", "f4", "i8", "b1" or the name of a record. */
  array(type, ...shape) {
    const size = VIEWS[type]?.BYTES_PER_ELEMENT ?? this.layout.records[type].size;
    const address = Math.ceil(this.end / WORD) * WORD;
    const block = new Block(this, type, shape, address, size);
    this.end = address + block.length * size;
    const missing = this.end - this.buffer.byteLength;
    if (missing > 0) this.exports.memory.grow(Math.max(GROWTH, Math.ceil(missing / PAGE)));
    block.bytes.fill(0);
    return block;
  }

  /** An array with these values, in the order of its memory; without a shape it has one axis. */
  filled(type, values, ...shape) {
    const block = this.array(type, ...(shape.length > 0 ? shape : [values.length]));
    block.view.set(type === "i8" ? BigInt64Array.from(values, BigInt) : values);
    return block;
  }

  /** An array of rows of numbers, at least one. */
  rows(type, rows) {
    return this.filled(type, rows.flat(), rows.length, rows[0].length);
  }

  /** What `work` returns; arrays that it makes are gone afterwards. */
  scratch(work) {
    const { end } = this;
    try {
      return work();
    } finally {
      this.end = end;
    }
  }

  /** Call a kernel by its symbol; an argument may be a list of several. Returns its number. */
  call(symbol, ...given) {
    const values = given.flat();
    const view = this.reader;
    let place = this.slots.address;
    const put = (type, value) => {
      if (type === "f8") view.setFloat64(place, value, true);
      else view.setBigInt64(place, BigInt(value), true);
      place += WORD;
    };
    for (const [i, [name, type, axes, apart]] of this.layout.kernels[symbol].entries()) {
      const value = values[i];
      if (axes > 0 && (value?.type !== type || value.shape.length !== axes))
        throw new Error(
          `${name} of ${symbol} must be an array of type ${type} with ${axes} axes, got ` +
            (value?.shape ? `type ${value.type} with ${value.shape.length} axes` : value),
        );
      if (axes === 0) put(type, value);
      else for (const word of [value.address, ...value.shape]) put("i8", word);
      if (apart) put("i8", value.rowSize);
    }
    return Number(this.exports[symbol](BigInt(this.slots.address)));
  }

  /** Angles of vectors, rad, in (-pi, pi]. */
  angles(x, y) {
    return this.scratch(() => {
      const out = this.array("f8", x.length);
      const vectors = tabulate(2 * x.length, (i) => (i % 2 === 0 ? x : y)[i >> 1]);
      const given = this.filled("f8", vectors, x.length, 2);
      this.call("mathematics__put_angles", given, out);
      return out.view.slice();
    });
  }
}

/** An array in a memory. */
class Block {
  constructor(memory, type, shape, address, size) {
    Object.assign(this, { memory, type, shape, address, size });
  }

  get length() {
    return this.shape.reduce((product, length) => product * length, 1);
  }

  get bytes() {
    return new Uint8Array(this.memory.buffer, this.address, this.length * this.size);
  }

  /** Its numbers as a typed array, good until the memory grows. */
  get view() {
    return new VIEWS[this.type](this.memory.buffer, this.address, this.length);
  }

  /** Bytes of an entry along the first axis. */
  get rowSize() {
    return this.shape.slice(1).reduce((product, length) => product * length, this.size);
  }

  /** The numbers of a field of the first record. */
  field(name) {
    const [offset, type, count] = this.memory.layout.records[this.type].fields[name];
    const size = VIEWS[type].BYTES_PER_ELEMENT;
    return new Block(this.memory, type, [count], this.address + offset, size);
  }

  /** Return the first `count` entries along the first axis. */
  first(count) {
    const shape = [count, ...this.shape.slice(1)];
    return new Block(this.memory, this.type, shape, this.address, this.size);
  }

  /** Return the numbers of an array (n, 2) as pairs. */
  pairs() {
    const { view } = this;
    return Array.from({ length: this.shape[0] }, (_, i) => [view[2 * i], view[2 * i + 1]]);
  }

  /** Entry `i` along the first axis. */
  at(i) {
    const part = new Block(this.memory, this.type, this.shape.slice(1), 0, this.size);
    part.address = this.address + i * part.length * this.size;
    return part;
  }

  /** Row `i` of a record as an object of numbers, lists and objects; or a part of it. */
  read(i = 0, part = null) {
    const record = this.memory.layout.records[this.type];
    const { reader } = this.memory;
    if (!part) return readRow(reader, record, this.address + i * this.size);
    const [offset, type] = record.fields[part];
    const place = this.address + i * this.size + offset;
    return typeof type === "string" ? READERS[type](reader, place) : readRow(reader, type, place);
  }

  /** Set some fields of row `i`. */
  write(values, i = 0) {
    const { records } = this.memory.layout;
    writeRow(this.memory.buffer, records[this.type], this.address + i * this.size, values);
  }
}

function readRow(reader, record, address) {
  const row = {};
  record.names ??= Object.keys(record.fields);
  for (const name of record.names) {
    const [offset, type, count] = record.fields[name];
    const place = address + offset;
    if (typeof type !== "string") row[name] = readRow(reader, type, place);
    else if (count === 1) row[name] = READERS[type](reader, place);
    else row[name] = Array.from(new VIEWS[type](reader.buffer, place, count), Number);
  }
  return row;
}

function writeRow(buffer, { fields }, address, values) {
  for (const [name, value] of Object.entries(values)) {
    const [offset, type, count] = fields[name];
    const place = address + offset;
    if (typeof type !== "string") writeRow(buffer, type, place, value);
    else
      new VIEWS[type](buffer, place, count).set(
        [value].flat().map(type === "i8" ? BigInt : Number),
      );
  }
}
