"""Layers of a policy's network.

The sums are computed in the order of the inputs, so that a row of inputs gives the same result
alone and among others.
"""

from __future__ import annotations

import numpy as np

from jansen_env.engine.kernel import Floats1, Floats2, Ints1, Ints2, Singles1, kernel, stage
from jansen_env.engine.mathematics import expm1, tanh

LINEAR, TANH, RELU, ELU = range(4)


@stage
def _activate(values, count, activation):
    """Apply an activation function to the first ``count`` values, in place."""
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
    """Clip a value to the range from -limit to limit.

    NaN stays NaN, whereas ``min`` and ``max`` would replace it by a limit.
    """
    if value > limit:
        return limit
    if value < -limit:
        return -limit
    return value


@kernel
def put_actions(
    inputs: Floats2,
    layers: Ints2,
    weights: Floats1,
    limit: float,
    squash: int,
    work: Floats2,
    out: Floats2,
) -> None:
    """Compute the outputs of a network.

    NaN stays NaN: it must not become the largest action.

    Args:
        inputs: Inputs, shape (n, width).
        layers: Number of inputs, number of units and activation of each layer, shape (k, 3).
        weights: Weights and biases of all layers, one after the other. Each layer has its weights
            of shape (inputs, units) in C order, followed by its biases of shape (units,).
        limit: Largest magnitude of an output of the last layer; larger outputs are clipped.
        squash: Activation that is applied to the clipped outputs.
        work: Work space, shape (2, width of the widest layer or more).
        out: Output, shape (n, units of the last layer).
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
def put_commands(outputs: Floats1, largest: float, commands: Singles1) -> None:
    """Compute the actions -1 to 1 that stand for outputs of a policy; larger outputs are clipped.

    NaN stays NaN.

    Args:
        outputs: Outputs of the policy, shape (n,).
        largest: Output for which the action is 1, such as the torque limit.
        commands: Output, the actions, shape (n,).
    """
    for i in range(len(outputs)):
        commands[i] = np.float32(_limited(outputs[i] / largest, 1.0))


@kernel
def put_normalized(
    values: Floats2, mean: Floats1, deviation: Floats1, clip: float, out: Floats2
) -> None:
    """Compute normalised observations: clip((value - mean) / deviation, -clip, clip).

    NaN stays NaN.

    Args:
        values: Observations, shape (n, d).
        mean: Mean of each observation, shape (d,).
        deviation: Standard deviation of each observation, shape (d,).
        clip: Largest magnitude of a normalised observation.
        out: Output, shape (n, d).
    """
    for row in range(len(values)):
        for i in range(len(mean)):
            out[row, i] = _limited((values[row, i] - mean[i]) / deviation[i], clip)


@kernel
def put_harmonics(directions: Floats2, multiples: Ints1, out: Floats2) -> None:
    """Compute cosines and sines of multiples of angles.

    Args:
        directions: Cosine and sine of each angle a, shape (n, 2).
        multiples: Factors k >= 0, shape (m,).
        out: Output, cos(k a) and sin(k a) of each factor in turn, shape (n, 2 m).
    """
    for row in range(len(directions)):
        for column in range(len(multiples)):
            x, y, c, s, left = 1.0, 0.0, directions[row, 0], directions[row, 1], multiples[column]
            while left > 0:
                if left % 2 == 1:
                    x, y = x * c - y * s, x * s + y * c
                c, s, left = c * c - s * s, 2.0 * c * s, left // 2
            out[row, 2 * column], out[row, 2 * column + 1] = x, y
