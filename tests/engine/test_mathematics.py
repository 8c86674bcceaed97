"""Elementary functions of the engine: accurate, and the same bits in Python and compiled."""

import importlib.util
import math
import re

import numpy as np
import pytest
from mpmath import mp, mpf

from jansen_env.engine import kernel, mathematics

COUNT = 2000
RNG = np.random.default_rng(0)
QUARTERS = np.append(np.arange(-COUNT, COUNT), RNG.integers(-600_000, 600_000, COUNT)) * math.pi / 2
TURNS = np.concatenate(
    [
        RNG.uniform(-10.0, 10.0, COUNT),
        RNG.uniform(-1e6, 1e6, COUNT),
        QUARTERS,
        np.nextafter(QUARTERS, 0.0),
        10.0 ** RNG.uniform(-20.0, 0.0, COUNT),
        [0.0],
    ]
)
POSITIVE = np.concatenate(
    [
        10.0 ** RNG.uniform(-320.0, 308.0, COUNT),
        RNG.uniform(0.5, 2.0, COUNT),
        1.0 + RNG.uniform(-1e-5, 1e-5, COUNT),
        RNG.uniform(0.0, 1.0, COUNT),
        [1.0],
    ]
)
SIZES = RNG.normal(size=(2, COUNT)) * 10.0 ** RNG.uniform(-3.0, 3.0, (2, COUNT))
EXPONENTS = np.concatenate(
    [
        RNG.uniform(-708.0, 709.7, COUNT),
        RNG.uniform(-2.0, 2.0, COUNT),
        RNG.uniform(-1e-5, 1e-5, COUNT),
        [0.0],
    ]
)
BASES = np.append(10.0 ** RNG.uniform(-20.0, 20.0, COUNT), RNG.uniform(0.5, 2.0, COUNT))
POWERS = RNG.uniform(-20.0, 20.0, 2 * COUNT) / np.maximum(np.abs(np.log(BASES)), 0.05)
# Function, arguments, the largest error in units in the last place.
CASES = [
    ("sin", (TURNS,), 0.8),
    ("cos", (TURNS,), 0.8),
    ("atan2", SIZES, 1.5),
    ("hypot", SIZES, 1.3),
    ("log", (POSITIVE,), 1.0),
    ("exp", (EXPONENTS,), 1.0),
    ("expm1", (EXPONENTS,), 2.0),
    ("tan", (TURNS,), 3.0),
    ("acos", (np.sin(TURNS),), 3.0),
    ("tanh", (EXPONENTS,), 3.0),
    ("power", (BASES, POWERS), 2.0),
]
SPECIAL = (0.0, -0.0, math.inf, -math.inf, math.nan)


@pytest.mark.parametrize(("name", "arguments", "tolerance"), CASES, ids=lambda case: str(case)[:5])
def test_errors_are_a_few_units_in_the_last_place(name, arguments, tolerance):
    """Results are compared with those of 60 digits."""
    with mp.workdps(60):
        for values in zip(*np.asarray(arguments).tolist(), strict=True):
            exact = getattr(mp, name)(*map(mpf, values))
            error = abs(mpf(getattr(mathematics, name)(*values)) - exact)
            assert error <= tolerance * math.ulp(float(exact)), values


def test_whole_numbers():
    for x in (-2.5, -2.0, -0.5, -1e-9, 0.0, 0.5, 1.5, 2.0, 2.5, 1e15 + 0.5, -1e15 - 0.5):
        assert mathematics.floor(x) == math.floor(x) and mathematics.nearest(x) == round(x)


def test_special_values():
    """They are as in C, but for the sign of a zero."""
    for name in ("exp", "expm1", "tanh"):
        for x in (*SPECIAL, 709.9, -746.0):
            with np.errstate(over="ignore"):
                expected = float(getattr(np, name)(x))
            value = getattr(mathematics, name)(x)
            assert value == expected or (math.isnan(value) and math.isnan(expected)), (name, x)
    for x in (math.inf, -math.inf, math.nan):
        assert math.isnan(mathematics.sin(x)) and math.isnan(mathematics.cos(x))
    assert mathematics.log(0.0) == -math.inf and mathematics.log(math.inf) == math.inf
    assert math.isnan(mathematics.log(-1.0)) and math.isnan(mathematics.log(math.nan))
    assert mathematics.atan2(0.0, 0.0) == mathematics.atan2(0.0, 1.0) == 0.0
    assert mathematics.atan2(0.0, -1.0) == math.pi and mathematics.atan2(1.0, 0.0) == math.pi / 2


@pytest.fixture(scope="module")
def compiled():
    """The module once more, its stages compiled."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(kernel, "kernels", [])
        options = {"error_model": "numpy", "_nrt": False}
        numba = pytest.importorskip("numba", reason="the group 'engine' is not installed")
        patch.setattr(kernel, "lower", lambda f, inline: numba.njit(**options)(f))
        spec = importlib.util.spec_from_file_location("compiled", mathematics.__file__)
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        yield module


@pytest.mark.parametrize(("name", "arguments", "tolerance"), CASES, ids=lambda case: str(case)[:5])
def test_compiled_functions_give_the_same_bits_alone(compiled, name, arguments, tolerance):
    """They call no other library."""
    plain, machine_code = getattr(mathematics, name), getattr(compiled, name)
    for values in zip(*np.asarray(arguments).tolist(), strict=True):
        assert plain(*values).hex() == machine_code(*values).hex(), values
    code = machine_code.inspect_llvm(machine_code.signatures[0])
    called = re.findall(r"\bcall\b[^@\n]*@\"?(?:llvm\.|numba_)?(\w+)", code)
    others = "cos exp floor fma fmuladd frexp ldexp log pow rint round sin trunc"
    assert not {*others.split()} & {*called}


def test_modulo_is_that_of_numpy():
    """Bit for bit, also for large angles; NaN for what is not finite."""
    turn = 2.0 * math.pi
    angles = np.concatenate([TURNS, turn * np.arange(-20.0, 20.0), 10.0 ** np.arange(0.0, 308.0)])
    for values in (angles, -angles):
        rests = [mathematics.modulo(float(x), turn) for x in values]
        assert np.array_equal(rests, values % turn)
    assert all(math.isnan(mathematics.modulo(x, turn)) for x in (math.inf, -math.inf, math.nan))
