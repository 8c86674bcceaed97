// Random numbers of `numpy.random.default_rng(seed)`, bit for bit: SeedSequence and PCG64 (O'Neill,
// "PCG: A Family of Simple Fast Space-Efficient Statistically Good Algorithms for Random Number
// Generation", 2014), and NumPy's ways from bits to numbers (Lemire, "Fast Random Integer Generation
// in an Interval", 2019).

const POOL = 4; // words of a seed sequence
const MULTIPLIER = 0x2360ed051fc65da44385df649fccf645n;

const word = (value) => BigInt.asUintN(32, value);
const mixed = (value) => value ^ (value >> 16n);

/** 64-bit numbers (count) of a seed sequence whose entropy is a whole number. */
function seedsOf(seed, count) {
  const entropy = [];
  let rest = BigInt(seed);
  do {
    entropy.push(word(rest));
    rest >>= 32n;
  } while (rest > 0n);
  let hash = 0x43b0d7e5n;
  const hashed = (value) => {
    const before = word(value ^ hash);
    hash = word(hash * 0x931e8875n);
    return mixed(word(before * hash));
  };
  const join = (x, y) => mixed(word(word(0xca01f9ddn * x) - word(0x4973f715n * y)));
  const pool = [];
  for (let i = 0; i < POOL; i += 1) pool.push(hashed(entropy[i] ?? 0n));
  for (let from = 0; from < POOL; from += 1)
    for (let to = 0; to < POOL; to += 1)
      if (from !== to) pool[to] = join(pool[to], hashed(pool[from]));
  for (const more of entropy.slice(POOL))
    for (let to = 0; to < POOL; to += 1) pool[to] = join(pool[to], hashed(more));
  let factor = 0x8b51f9ddn;
  const words = [];
  for (let i = 0; i < 2 * count; i += 1) {
    const value = word(pool[i % POOL] ^ factor);
    factor = word(factor * 0x58f38dedn);
    words.push(mixed(word(value * factor)));
  }
  return Array.from({ length: count }, (_, i) => words[2 * i] | (words[2 * i + 1] << 32n));
}

/** The generator of a seed, a whole number >= 0. */
export function generatorOf(seed) {
  const [high, low, highStream, lowStream] = seedsOf(seed, 4);
  const increment = BigInt.asUintN(128, (((highStream << 64n) | lowStream) << 1n) | 1n);
  const next = (value) => BigInt.asUintN(128, value * MULTIPLIER + increment);
  let state = next(BigInt.asUintN(128, increment + ((high << 64n) | low)));
  let half = null; // the upper 32 bits of the last 64, while only the lower ones are used

  function bits64() {
    state = next(state);
    const value = BigInt.asUintN(64, (state >> 64n) ^ state);
    const turn = state >> 122n;
    return BigInt.asUintN(64, (value >> turn) | (value << (64n - turn)));
  }

  function bits32() {
    const [value, upper] = half === null ? [bits64(), true] : [half, false];
    half = upper ? value >> 32n : null;
    return word(value);
  }

  /** A number from 0 to 1, without 1. */
  const random = () => Number(bits64() >> 11n) * 2 ** -53;

  /** A whole number from 0 to `count`, without `count`; a BigInt, if `count` is. */
  function integer(count) {
    const size = BigInt(count);
    const width = size <= 2n ** 32n ? 32n : 64n;
    const bits = width === 32n ? bits32 : bits64;
    let product = bits() * size;
    const least = (2n ** width - size) % size; // below it there would be more of some numbers
    while (BigInt.asUintN(Number(width), product) < least) product = bits() * size;
    const chosen = product >> width;
    return typeof count === "bigint" ? chosen : Number(chosen);
  }

  return { random, integer, uniform: (from, to) => from + (to - from) * random() };
}
