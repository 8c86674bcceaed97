"""Random numbers of ``numpy.random.default_rng(seed)``, bit for bit, for web pages.

This module implements SeedSequence and PCG64 (O'Neill, "PCG: A Family of Simple Fast
Space-Efficient Statistically Good Algorithms for Random Number Generation", 2014), and NumPy's
conversion of bits to numbers (Lemire, "Fast Random Integer Generation in an Interval", 2019).

A generator is an array of shape (6,). It holds the state and the increment, each with its upper
half first, then a flag that is 1 if the upper half of the last 64 bits is still unused, and this
upper half. The arithmetic relies on overflows, of which NumPy warns if the kernels are not
compiled.
"""

from __future__ import annotations

import numpy as np

from jansen_env.engine.kernel import Floats1, Ints1, Words1, kernel, stage

# Numba converts to float when it combines signed and unsigned integers, so all are unsigned here.
STATE_HIGH, STATE_LOW, STEP_HIGH, STEP_LOW, HAS_HALF, HALF = range(6)
ZERO, ONE, POOL = np.uint64(0), np.uint64(1), 4  # POOL: number of words of a seed sequence
W16, W32, W58, W63, W64 = (np.uint64(bits) for bits in (16, 32, 58, 63, 64))
UNUSED_BITS = np.uint64(11)
MASK = np.uint64(0xFFFFFFFF)
MULTIPLIER_HIGH, MULTIPLIER_LOW = np.uint64(0x2360ED051FC65DA4), np.uint64(0x4385DF649FCCF645)
FIRST_HASH, HASH_FACTOR = np.uint64(0x43B0D7E5), np.uint64(0x931E8875)
FIRST_OUT, OUT_FACTOR = np.uint64(0x8B51F9DD), np.uint64(0x58F38DED)
MIX_LEFT, MIX_RIGHT = np.uint64(0xCA01F9DD), np.uint64(0x4973F715)
SPACING = 2.0**-53


@stage
def _product(a, b):
    """Return the upper and the lower half of the product of two 64-bit words."""
    a_low, a_high, b_low, b_high = a & MASK, a >> W32, b & MASK, b >> W32
    low = a_low * b_low
    left, right = a_high * b_low, a_low * b_high
    middle = (low >> W32) + (left & MASK) + (right & MASK)
    high = a_high * b_high + (left >> W32) + (right >> W32) + (middle >> W32)
    return high, (low & MASK) | (middle << W32)


@stage(inline=False)
def _advance(state):
    """Advance the generator by one step."""
    high, low = _product(state[STATE_LOW], MULTIPLIER_LOW)
    high += state[STATE_HIGH] * MULTIPLIER_LOW + state[STATE_LOW] * MULTIPLIER_HIGH
    total = low + state[STEP_LOW]
    state[STATE_HIGH] = high + state[STEP_HIGH] + (ONE if total < low else ZERO)
    state[STATE_LOW] = total


@stage(inline=False)
def _bits64(state):
    """Return the next 64 random bits."""
    _advance(state)
    mixed, turn = state[STATE_HIGH] ^ state[STATE_LOW], state[STATE_HIGH] >> W58
    return (mixed >> turn) | (mixed << ((W64 - turn) & W63))


@stage
def _bits32(state):
    """Return the next 32 random bits: the lower half of 64 bits first, then the upper half."""
    if state[HAS_HALF] != ZERO:
        state[HAS_HALF] = ZERO
        return state[HALF]
    bits = _bits64(state)
    state[HAS_HALF], state[HALF] = ONE, bits >> W32
    return bits & MASK


@stage
def _shifted(value):
    """Return a word combined with its upper half by exclusive or."""
    return value ^ (value >> W16)


@stage
def _mixed(x, y):
    """Return the mix of two 32-bit words of a seed sequence."""
    return _shifted((((MIX_LEFT * x) & MASK) - ((MIX_RIGHT * y) & MASK)) & MASK)


@kernel
def seed_generator(seed: int, state: Words1) -> None:
    """Seed a generator with a whole number from 0 to 2^63 - 1.

    Args:
        seed: The number.
        state: Output, the generator, shape (6,). Before that, it serves as work space for the words
            of the seed sequence and its hash.
    """
    whole = np.uint64(seed)
    factor = FIRST_HASH
    for k in range(POOL):
        word = whole & MASK if k == 0 else whole >> W32 if k == 1 else ZERO
        word = word ^ factor
        factor = (factor * HASH_FACTOR) & MASK
        state[k] = _shifted((word * factor) & MASK)
    for source in range(POOL):
        for target in range(POOL):
            if source != target:
                word = state[source] ^ factor
                factor = (factor * HASH_FACTOR) & MASK
                state[target] = _mixed(state[target], _shifted((word * factor) & MASK))
    factor = FIRST_OUT
    w0, w1, w2, w3 = state[0], state[1], state[2], state[3]
    for k in range(POOL):  # four 64-bit words, each made of two 32-bit words
        first, second = (w0, w1) if k % 2 == 0 else (w2, w3)
        first = first ^ factor
        factor = (factor * OUT_FACTOR) & MASK
        first = _shifted((first * factor) & MASK)
        second = second ^ factor
        factor = (factor * OUT_FACTOR) & MASK
        second = _shifted((second * factor) & MASK)
        state[k] = first | (second << W32)
    seed_high, seed_low = state[0], state[1]
    stream_high, stream_low = state[2], state[3]
    state[STEP_HIGH] = (stream_high << ONE) | (stream_low >> W63)
    state[STEP_LOW] = (stream_low << ONE) | ONE
    state[STATE_HIGH], state[STATE_LOW] = state[STEP_HIGH], state[STEP_LOW]
    total = state[STATE_LOW] + seed_low
    state[STATE_HIGH] += seed_high + (ONE if total < seed_low else ZERO)
    state[STATE_LOW] = total
    _advance(state)
    state[HAS_HALF] = state[HALF] = ZERO


@kernel
def put_uniforms(state: Words1, out: Floats1) -> None:
    """Generate random numbers from 0 to 1, excluding 1, as ``rng.random(n)`` does.

    Args:
        state: The generator, shape (6,).
        out: Output, shape (n,).
    """
    for k in range(len(out)):
        out[k] = float(_bits64(state) >> UNUSED_BITS) * SPACING


@kernel
def put_integers(state: Words1, most: int, out: Ints1) -> None:
    """Generate random whole numbers from 0 to ``most``, including ``most``.

    Args:
        state: The generator, shape (6,).
        most: Largest number.
        out: Output, shape (n,).
    """
    size = np.uint64(most) + ONE
    for k in range(len(out)):
        if size <= MASK + ONE:
            product = _bits32(state) * size
            # Reject products below this limit, or some numbers would be more likely than others.
            least = (MASK + ONE - size) % size
            while product & MASK < least:
                product = _bits32(state) * size
            out[k] = np.int64(product >> W32)
        else:
            high, low = _product(_bits64(state), size)
            least = (ZERO - size) % size
            while low < least:
                high, low = _product(_bits64(state), size)
            out[k] = np.int64(high)
