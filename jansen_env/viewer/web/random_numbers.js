// Random numbers of `numpy.random.default_rng(seed)`, from the kernels of jansen_env/engine/pcg64.py.

const WORDS = 6; // number of words of a generator

/** A generator in a memory of the engine. Its seed is a whole number from 0 to 2^63 - 1. */
export class Random {
  constructor(memory, seed) {
    Object.assign(this, { memory, state: memory.array("u8", WORDS) });
    memory.call("pcg64_seed_generator", seed, this.state);
  }

  /** Return an array of `count` numbers from 0 to 1, excluding 1. */
  uniforms(count) {
    const out = this.memory.array("f8", count);
    this.memory.call("pcg64_put_uniforms", this.state, out);
    return out;
  }

  /** Return a number from 0 to 1, excluding 1. */
  random() {
    return this.memory.scratch(() => this.uniforms(1).view[0]);
  }

  uniform(from, to) {
    return from + (to - from) * this.random();
  }

  /** Return a whole number from 0 to `count` - 1 as a BigInt; `count` may be a BigInt, too. */
  integer(count) {
    return this.memory.scratch(() => {
      const out = this.memory.array("i8", 1);
      this.memory.call("pcg64_put_integers", this.state, BigInt(count) - 1n, out);
      return out.view[0];
    });
  }
}
