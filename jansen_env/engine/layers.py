"""Layers of a policy's network: sums in the order of the inputs, one row at a time or many."""

from __future__ import annotations

from jansen_env.engine.kernel import Floats1, Floats2, Ints1, Ints2, kernel, stage
from jansen_env.engine.mathematics import expm1, tanh

LINEAR, TANH, RELU, ELU = range(4)


@stage
def _activate(values, count, activation):
    """Put the function of each of ``count`` values in its place."""
    if activation == TANH:
        for i in range(count):
            values[i] = tanh(values[i])
    elif activation == RELU:
        for i in range(count):
            values[i] = 0.0 if values[i] < 0.0 else values[i]
    elif activation == ELU:
        for i in range(count):
            values[i] = expm1(values[i]) if values[i] < 0.0 else values[i]


@stage
def _limited(value, limit):
    """Clip a value to -limit .. limit; NaN stays NaN, where min and max would give a limit."""
    if value > limit:
        return limit
    if value < -limit:
        return -limit
    return value


@kernel
def put_actions(
    inputs: Floats2, layers: Ints2, weights: Floats1, limit: float, squash: int, work: Floats2,
    out: Floats2,
) -> None:  # fmt: skip
    """Put what a network makes of inputs (n, width) into (n, units of the last layer).

    Args:
        layers: (k, 3) inputs, units and activation of each. weights: for each layer (inputs, units)
            weights, a row for each input, and (units,) of bias, one after the other.
        limit: the most that the last layer may give. squash: activation of what is left.
            NaN stays NaN: it must not become the largest action.
        work: (2, width of the widest layer or more).
    """
    for row in range(len(inputs)):
        start, values, sums = 0, work[0], work[1]
        for i in range(inputs.shape[1]):
            values[i] = inputs[row, i]
        for layer in range(len(layers)):
            width, units, activation = layers[layer]
            bias = weights[start + width * units :]
            for unit in range(units):
                sums[unit] = bias[unit]
            for i in range(0, width - 3, 4):  # four inputs at once, which is faster
                a, b, c, d = values[i], values[i + 1], values[i + 2], values[i + 3]
                of_a = weights[start + i * units :]
                of_b, of_c, of_d = of_a[units:], of_a[2 * units :], of_a[3 * units :]
                for unit in range(units):
                    partial = sums[unit] + a * of_a[unit] + b * of_b[unit]
                    sums[unit] = partial + c * of_c[unit] + d * of_d[unit]
            for i in range(width - width % 4, width):
                last = weights[start + i * units :]
                for unit in range(units):
                    sums[unit] += values[i] * last[unit]
            _activate(sums, units, activation)
            start += (width + 1) * units
            values, sums = sums, values
        for unit in range(out.shape[1]):
            values[unit] = _limited(values[unit], limit)
        _activate(values, out.shape[1], squash)
        for unit in range(out.shape[1]):
            out[row, unit] = values[unit]


@kernel
def put_harmonics(directions: Floats2, multiples: Ints1, out: Floats2) -> None:
    """Put cos k a, sin k a of multiples k >= 0 into (n, 2 k) from (n, 2) cosines and sines of a."""
    for row in range(len(directions)):
        for column in range(len(multiples)):
            x, y, c, s, left = 1.0, 0.0, directions[row, 0], directions[row, 1], multiples[column]
            while left > 0:
                if left % 2 == 1:
                    x, y = x * c - y * s, x * s + y * c
                c, s, left = c * c - s * s, 2.0 * c * s, left // 2
            out[row, 2 * column], out[row, 2 * column + 1] = x, y
