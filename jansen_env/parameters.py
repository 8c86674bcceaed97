"""The table of parameters, numbers that may differ between robots and episodes, and their draws.

Types, checks, ``randomize``, reset options, ``set_parameters``, ``info["parameters"]`` and the
documentation are made from it; :mod:`jansen_env.plants.robot_parameters` and the world apply it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple, Protocol, TypeAlias, runtime_checkable

import numpy as np

from jansen_env.arrays import Array, Rows
from jansen_env.checks import invalid, listed, number_range, shown, within
from jansen_env.engine.records import PARAMETERS as ENGINE_PARAMETERS
from jansen_env.robot import Payload, Robot
from jansen_env.terrain import MAX_SLOPE, Ground
from jansen_env.terrain.generators import HIGHEST
from jansen_env.uniform import uniform

LARGEST = 1e6  # of a coefficient of friction, a mass in kg, a place in m
LONGEST_DELAY = 1.0  # s, of an action
LOUDEST = 1e3  # times noise and pushes
SCALE, FROM_0 = (0.01, 100.0), (0.0, 100.0)  # factors


class Parameter(NamedTuple):
    """A row of the table.

    Attributes:
        name, unit: of the number. least, most: its limits. meaning: what it does.
        nominal: its value where nothing is drawn: a number, or the place of one, such as
            ``"robot.payload.mass"`` or ``"terrain.friction"``.
        idle: where it has no effect, in words, and is_idle: whether that holds for a robot.
        zero_where: flag of ``PARAMS`` (:mod:`jansen_env.engine.records`) with which it must be 0.
        of_robot: whether it changes robot or ground, not what surrounds them.
        settable: whether ``set_parameters`` changes it by name.
        argument: whether the constructor has an argument of its name. whole: no fractions.
        slider: lowest and highest value of its slider on the page that walks; None for no slider.
        label: beside the slider; empty for the name in words.
    """

    name: str
    unit: str
    least: float
    most: float
    meaning: str
    nominal: float | str = 1.0
    idle: str = ""
    is_idle: Callable[[Robot], bool] = lambda robot: False
    zero_where: str = ""
    of_robot: bool = True
    settable: bool = True
    argument: bool = False
    whole: bool = False
    slider: tuple[float, float] | None = None
    label: str = ""


TABLE = (
    Parameter("friction", "1", 0.0, LARGEST, "Coulomb coefficient between toes and ground",
              "terrain.friction", argument=True, slider=(0.0, 1.2)),
    Parameter("restitution", "1", 0.0, 1.0, "Newton's coefficient between toes and ground",
              "terrain.restitution", "compliant feet",
              lambda robot: not robot.pad_compliance.rigid, "compliant", argument=True,
              slider=(0.0, 0.9)),
    Parameter("payload", "kg", 0.0, LARGEST, "mass of the payload; its own inertia stays",
              "robot.payload.mass", argument=True, slider=(0.0, 6.0)),
    Parameter("payload_x", "m", -LARGEST, LARGEST, "place of the payload ahead of the crank axis",
              "robot.payload.position.0", settable=False),
    Parameter("payload_y", "m", -LARGEST, LARGEST, "place of the payload above the crank axis",
              "robot.payload.position.1", settable=False),
    Parameter("mass_scale", "1", *SCALE, "times the links' masses and inertias",
              slider=(0.5, 2.0), label="mass of links"),
    Parameter("inertia_scale", "1", *FROM_0,
              "times the links' inertias about their own centres, on top",
              idle="links without inertia",
              is_idle=lambda robot: not any(body.inertia for body in robot.bodies)),
    Parameter("damping_scale", "1", *FROM_0, "times the joints' viscous damping",
              idle="joints without damping", is_idle=lambda robot: not any(robot.damping)),
    Parameter("foot_stiffness_scale", "1", *SCALE, "times the stiffness of the feet",
              idle="rigid feet", is_idle=lambda robot: robot.pad_compliance.rigid),
    Parameter("foot_damping_scale", "1", *FROM_0, "times the damping of the feet",
              idle="feet without damping",
              is_idle=lambda robot: not any((robot.pad_compliance.damping,
                                             robot.pad_compliance.tangential_damping))),
    Parameter("motor_strength", "1", *SCALE,
              "times the torque of an action and all limits of the motor's torque",
              slider=(0.1, 1.5)),
    Parameter("rotor_inertia_scale", "1", *FROM_0, "times the inertia of the motor's rotor",
              idle="motors without rotor", is_idle=lambda robot: robot.motor.rotor_inertia == 0.0),
    Parameter("tilt", "rad", -MAX_SLOPE, MAX_SLOPE,
              "turns gravity, so that the floor rises towards +x above 0",
              0.0, slider=(-0.25, 0.25), label="slope"),
    Parameter("delay", "s", 0.0, LONGEST_DELAY, "time by which torques come late",
              0.0, of_robot=False, argument=True),
    Parameter("noise_level", "1", 0.0, LOUDEST, "times the sensors' noise",
              idle="environments without noise", of_robot=False, slider=(0.0, 3.0),
              label="sensor noise"),
    Parameter("push_strength", "1", 0.0, LOUDEST, "times the impulses of random pushes",
              idle="environments without random pushes", of_robot=False, settable=False),
    Parameter("terrain_level", "1", 0.0, HIGHEST, "level of a drawn terrain, a whole number",
              0.0, "terrains that are not drawn", of_robot=False,
              argument=True, whole=True),
    Parameter("gravity_scale", "1", *SCALE, "times gravity, and so the weight",
              slider=(0.1, 2.0), label="gravity"),
)  # fmt: skip
"""All rows. Random numbers are drawn in this order: a new row goes to the end, so that seeds keep
their meaning. Nothing else depends on it."""

PARAMETERS = {row.name: row for row in TABLE}
"""The rows by name."""
EPISODE: np.dtype[np.void] = np.dtype(ENGINE_PARAMETERS)
"""The parameters of one episode: part of a robot's record."""
if EPISODE.names != (*PARAMETERS,):
    raise TypeError(
        f"PARAMETERS of jansen_env/engine/records.py must name the parameters of TABLE in its "
        f"order, {[*PARAMETERS]}, got {EPISODE.names}"
    )
OF_ROBOTS = tuple(row.name for row in TABLE if row.of_robot)
"""Names of those that plants apply."""
SETTABLE = tuple(row.name for row in TABLE if row.settable)
"""Names of those that ``set_parameters`` changes."""
CHANGES = tuple(name for name in SETTABLE if not PARAMETERS[name].argument)
"""Names of those of them that no constructor has."""
ARGUMENTS = tuple(row.name for row in TABLE if row.argument)
"""Names of those that are arguments of constructors."""


def nominal(robot: Robot, terrain: Ground) -> np.void:
    """Return the parameters, a record of :data:`EPISODE`, that change nothing."""
    values = tuple(_nominal_value(row.nominal, robot, terrain) for row in TABLE)
    return np.array([values], EPISODE)[0]


def _nominal_value(value: float | str, robot: Robot, terrain: Ground) -> float:
    """Return a nominal value, which may be a number or its place in a robot or a terrain."""
    if not isinstance(value, str):
        return value
    whole, *names = value.split(".")
    found: Any = robot if whole == "robot" else terrain
    for name in names:
        found = found[int(name)] if name.isdigit() else getattr(found, name)
    return float(found)


def set_payload(row: np.void | dict[str, Any], load: Payload) -> None:
    """Put another payload into a record, or into values by name."""
    row["payload"], (row["payload_x"], row["payload_y"]) = load.mass, load.position


def argument_values(name: str, value: Any) -> dict[str, tuple[float, float]]:
    """Return the parameters that a checked argument sets, each with its lowest and highest value.

    Args:
        name: One of :data:`ARGUMENTS`.
        value: A number, a range (low, high), or a payload, which also has a place.
    """
    if isinstance(value, Payload):
        row: dict[str, float] = {}
        set_payload(row, value)
        return {parameter: (number, number) for parameter, number in row.items()}
    low, high = value if isinstance(value, tuple) else (value, value)
    return {name: (low, high)}


def plain(rows: Rows) -> Array:
    """Return records (k,) of numbers as (k, numbers): a view unless their rows lie apart."""
    together = np.ascontiguousarray(rows)
    return together.view(float).reshape(len(rows), rows.dtype.itemsize // 8)


def effective(robot: Robot) -> tuple[str, ...]:
    """Return the names of the plants' parameters that change how a robot moves."""
    return tuple(name for name in OF_ROBOTS if not PARAMETERS[name].is_idle(robot))


def check(label: str, name: str, value: object) -> float:
    """Return a parameter's value as a float; ValueError: out of its limits, called ``label``."""
    row = PARAMETERS[name]
    number = within(label, value, row.least, row.most)
    if row.whole and number != round(number):
        raise invalid(label, value, f"a whole number up to {row.most}")
    return number


@runtime_checkable
class Distribution(Protocol):
    """Protocol of what draws a number."""

    def sample(self, rng: np.random.Generator) -> float:
        """Draw a number with ``rng`` alone."""
        ...


class Uniform(NamedTuple):
    """A uniform distribution from ``low`` to ``high``, ``whole``: of whole numbers, with both."""

    low: float
    high: float
    whole: bool = False

    def sample(self, rng: np.random.Generator) -> float:
        """Draw a number."""
        if self.whole:
            return float(rng.integers(int(self.low), int(self.high), endpoint=True))
        return float(uniform(rng, self.low, self.high))


Randomization: TypeAlias = dict[str, Distribution]
"""Distributions of parameters by name, in the order of :data:`TABLE`."""

EVERY = "*"  # stands for all lengths
WIDEST = 0.9  # by which a length may be shorter


def load_randomization(
    name: str, value: object, parameters: Iterable[str] | None = None
) -> dict[str, Any]:
    """Return the distributions of ``randomize``: a :data:`Randomization`, and "lengths".

    ``value``: by name a number, (low, high) for a uniform draw (of whole numbers where the
    parameter is one), or a :class:`Distribution`; None for none. "lengths" are factors by length,
    or of all; a number s stands for (1 - s, 1 + s). ``parameters``: allowed names; None for all.

    Raises:
        ValueError: an unknown name or invalid range.
    """
    given = {} if value is None else value
    if not isinstance(given, Mapping):
        raise ValueError(f"{name} is {shown(given)}, must map of {[*PARAMETERS]} to ranges")
    parameters = [*(PARAMETERS if parameters is None else parameters)]
    known = [*parameters, "lengths"]
    if unknown := sorted(map(str, {*given} - {*known})):
        raise ValueError(f"{name} has {unknown}, must be of {listed(known, unknown[0])}")
    drawn: dict[str, Any] = {k: _distribution(k, given[k]) for k in parameters if k in given}
    if "lengths" in given:
        given_factors = given["lengths"]
        factors = given_factors if isinstance(given_factors, Mapping) else {EVERY: given_factors}
        drawn["lengths"] = {str(name): _factor(str(name), f) for name, f in factors.items()}
    return drawn


def _factor(name: str, value: object) -> Distribution:
    if isinstance(value, Distribution):
        return value
    label = "randomize['lengths']" + ("" if name == EVERY else f"[{name!r}]")
    if isinstance(value, (tuple, list, np.ndarray)):
        return Uniform(*number_range(label, value, *SCALE))
    spread = within(label, value, 0.0, WIDEST)
    return Uniform(1.0 - spread, 1.0 + spread)


def _distribution(name: str, value: object) -> Distribution:
    if isinstance(value, Distribution):
        return value
    row, label = PARAMETERS[name], f"randomize[{name!r}]"
    low, high = number_range(label, value, row.least, row.most)
    return Uniform(check(label, name, low), check(label, name, high), row.whole)
