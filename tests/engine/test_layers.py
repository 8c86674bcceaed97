"""A network's kernel beside NumPy, and the same for one row as for many."""

import itertools

import numpy as np
import pytest

from jansen_env.policies.pretrained import Harmonics, Layer, Network

FUNCTIONS = {
    "tanh": np.tanh,
    "relu": lambda x: np.maximum(x, 0.0),
    "elu": lambda x: np.where(x > 0.0, x, np.expm1(np.minimum(x, 0.0))),
    None: lambda x: x,
}


@pytest.mark.parametrize("activation", FUNCTIONS)
@pytest.mark.parametrize("sizes", [(1, 1), (5, 7, 2), (28, 64, 64, 1)])
def test_a_network_is_its_layers_one_after_the_other(activation, sizes, rng):
    """They agree within 1e-14, and a row gives the same bits alone."""
    layers = [
        Layer(rng.normal(size=(units, width)) / width, rng.normal(size=units), activation)
        for width, units in itertools.pairwise(sizes)
    ]
    values = inputs = rng.normal(size=(9, sizes[0]))
    for layer in layers:
        values = FUNCTIONS[activation](values @ layer.weight.T + layer.bias)
    network = Network(layers, 0.5, "tanh")
    outputs = network(inputs)
    assert outputs == pytest.approx(np.tanh(np.clip(values, -0.5, 0.5)), abs=1e-14)
    for row in range(len(inputs)):
        assert (network(inputs[row : row + 1]) == outputs[row]).all()


@pytest.mark.parametrize("activation", FUNCTIONS)
@pytest.mark.parametrize("squash", ["clip", "tanh"])
@pytest.mark.parametrize("limit", [1.0, np.inf])
def test_what_is_no_number_does_not_become_a_limit(activation, squash, limit, rng):
    """NaN stays NaN through activations, limit and squash, in its own row alone."""
    layers = [
        Layer(rng.normal(size=(6, 4)), rng.normal(size=6), activation),
        Layer(rng.normal(size=(1, 6)), rng.normal(size=1), None),
    ]
    inputs = rng.normal(size=(3, 4))
    inputs[1, 2] = np.nan
    outputs = Network(layers, limit, squash)(inputs)
    assert np.isnan(outputs[1]).all() and np.isfinite(outputs[[0, 2]]).all()


def test_harmonics_are_of_multiples_of_the_angle(rng):
    angle = rng.uniform(0.0, 6.0, 5)
    multiples = (0, 1, 2, 7, 1000)
    harmonics = Harmonics(multiples)(np.stack([np.cos(angle), np.sin(angle)], axis=1))
    expected = np.exp(1j * angle[:, None] * multiples)
    assert harmonics[:, ::2] + 1j * harmonics[:, 1::2] == pytest.approx(expected, abs=1e-12)
