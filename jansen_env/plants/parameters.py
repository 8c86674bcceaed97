"""Table of the parameters that may differ between robots and episodes, and their distributions.

Types, checks, ``randomize``, reset options, ``set_parameters``, ``info["parameters"]`` and the
documentation are made from the table. :mod:`jansen_env.plants.robot_parameters` and
:mod:`jansen_env.world` apply the parameters.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple, Protocol, TypeAlias, runtime_checkable

import numpy as np

from jansen_env.arrays import Array, Rows
from jansen_env.checks import invalid, listed, number_range, within
from jansen_env.engine.records import PARAMETERS as ENGINE_PARAMETERS
from jansen_env.robot import Payload, Robot
from jansen_env.terrain import MAX_SLOPE, Ground
from jansen_env.terrain.generators import HIGHEST
from jansen_env.uniform import uniform

LARGEST = 1e6  # largest coefficient of friction, mass in kg and position in m
LONGEST_DELAY = 1.0  # longest delay of an action, in s
LOUDEST = 1e3  # largest factor of noise and pushes
SCALE = (0.01, 100.0)  # limits of factors that must be positive
FROM_0 = (0.0, 100.0)  # limits of factors that may be 0


class Parameter(NamedTuple):
    """A parameter, which is a row of the table.

    Attributes:
        name: Name of the parameter.
        unit: Unit of the parameter, "1" for a number without unit.
        least: Lowest allowed value.
        most: Highest allowed value.
        meaning: Description of the parameter.
        nominal: Value if the parameter is neither sampled nor specified by the user: a number, or
            the attribute that contains it, such as ``"robot.payload.mass"`` or
            ``"terrain.friction"``.
        idle: Description of the robots, terrains or environments for which the parameter has no
            effect.
        is_idle: Function that returns whether the parameter has no effect for a robot.
        zero_where: Name of a flag in ``PROPERTIES`` (:mod:`jansen_env.engine.records`). If the flag
            is set, the parameter must be 0.
        of_robot: Whether the parameter changes the robot or the terrain, rather than their
            environment.
        settable: Whether ``set_parameters`` can change the parameter by its name.
        argument: Whether constructors have an argument of this name.
        whole: Whether the value must be a whole number.
        slider: Lowest and highest value of the slider on the interactive web page. None for no
            slider.
        label: Label of the slider. If it is empty, the label is made from the name.
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
    Parameter("payload", "kg", 0.0, LARGEST,
              "mass of the payload, whose own inertia does not change",
              "robot.payload.mass", argument=True, slider=(0.0, 6.0)),
    Parameter("payload_x", "m", -LARGEST, LARGEST,
              "distance of the payload ahead of the crank axis",
              "robot.payload.position.0", settable=False),
    Parameter("payload_y", "m", -LARGEST, LARGEST, "height of the payload above the crank axis",
              "robot.payload.position.1", settable=False),
    Parameter("mass_scale", "1", *SCALE, "factor on the masses and inertias of the links",
              slider=(0.5, 2.0), label="mass of links"),
    Parameter("inertia_scale", "1", *FROM_0,
              "additional factor on the inertias of the links about their own centres",
              idle="links without inertia",
              is_idle=lambda robot: not any(body.inertia for body in robot.bodies)),
    Parameter("damping_scale", "1", *FROM_0, "factor on the viscous damping of the joints",
              idle="joints without damping", is_idle=lambda robot: not any(robot.damping)),
    Parameter("foot_stiffness_scale", "1", *SCALE, "factor on the stiffness of the feet",
              idle="rigid feet", is_idle=lambda robot: robot.pad_compliance.rigid),
    Parameter("foot_damping_scale", "1", *FROM_0, "factor on the damping of the feet",
              idle="feet without damping",
              is_idle=lambda robot: not any((robot.pad_compliance.damping,
                                             robot.pad_compliance.tangential_damping))),
    Parameter("motor_strength", "1", *SCALE,
              "factor on the torque of an action and on all limits of the motor torque",
              slider=(0.1, 1.5)),
    Parameter("rotor_inertia_scale", "1", *FROM_0, "factor on the inertia of the motor's rotor",
              idle="motors without rotor", is_idle=lambda robot: robot.motor.rotor_inertia == 0.0),
    Parameter("tilt", "rad", -MAX_SLOPE, MAX_SLOPE,
              "angle by which gravity turns; the floor rises towards +x if it is positive",
              0.0, slider=(-0.25, 0.25), label="slope"),
    Parameter("delay", "s", 0.0, LONGEST_DELAY, "time by which torques are delayed",
              0.0, of_robot=False, argument=True),
    Parameter("noise_level", "1", 0.0, LOUDEST, "factor on the sensor noise",
              idle="environments without noise", of_robot=False, slider=(0.0, 3.0),
              label="sensor noise"),
    Parameter("push_strength", "1", 0.0, LOUDEST, "factor on the impulses of random pushes",
              idle="environments without random pushes", of_robot=False, settable=False),
    Parameter("terrain_level", "1", 0.0, HIGHEST, "level of a generated terrain, a whole number",
              0.0, "terrains that are not generated", of_robot=False,
              argument=True, whole=True),
    Parameter("gravity_scale", "1", *SCALE, "factor on gravity, and therefore on the weight",
              slider=(0.1, 2.0), label="gravity"),
)  # fmt: skip
"""All parameters.

Random values are sampled in this order. Add new rows at the end, so that each seed still produces
the same values. Nothing else depends on the order.
"""

PARAMETERS = {row.name: row for row in TABLE}
"""The parameters by name."""
EPISODE: np.dtype[np.void] = np.dtype(ENGINE_PARAMETERS)
"""Data type of the values of all parameters in an episode, which are part of a robot's record."""
if EPISODE.names != (*PARAMETERS,):
    raise TypeError(
        f"PARAMETERS of jansen_env/engine/records.py must name the parameters of TABLE in its "
        f"order, {[*PARAMETERS]}, got {EPISODE.names}"
    )
OF_ROBOTS = tuple(row.name for row in TABLE if row.of_robot)
"""Names of the parameters that simulation backends apply."""
SETTABLE = tuple(row.name for row in TABLE if row.settable)
"""Names of the parameters that ``set_parameters`` can change."""
CHANGES = tuple(name for name in SETTABLE if not PARAMETERS[name].argument)
"""Names of the parameters in :data:`SETTABLE` that are not arguments of constructors."""
ARGUMENTS = tuple(row.name for row in TABLE if row.argument)
"""Names of the parameters that are arguments of constructors."""


def nominal(robot: Robot, terrain: Ground) -> np.void:
    """Return the parameters with which a robot and a terrain are unchanged.

    Returns:
        Record of the type :data:`EPISODE`.
    """
    values = tuple(_nominal_value(row.nominal, robot, terrain) for row in TABLE)
    return np.array([values], EPISODE)[0]


def _nominal_value(value: float | str, robot: Robot, terrain: Ground) -> float:
    """Return a nominal value as a number.

    Args:
        value: The number, or the attribute of the robot or the terrain that contains it.
        robot: The robot.
        terrain: The terrain.
    """
    if not isinstance(value, str):
        return value
    whole, *names = value.split(".")
    found: Any = robot if whole == "robot" else terrain
    for name in names:
        found = found[int(name)] if name.isdigit() else getattr(found, name)
    return float(found)


def set_payload(row: np.void | dict[str, Any], load: Payload) -> None:
    """Store the mass and the position of a payload in a record, or in a dictionary by name."""
    row["payload"] = load.mass
    row["payload_x"], row["payload_y"] = load.position


def argument_values(name: str, value: Any) -> dict[str, tuple[float, float]]:
    """Return the parameters that a checked argument sets, each with its lowest and highest value.

    Args:
        name: One of :data:`ARGUMENTS`.
        value: A number, a range (low, high), or a payload, which also has a position.
    """
    if isinstance(value, Payload):
        row: dict[str, float] = {}
        set_payload(row, value)
        return {parameter: (number, number) for parameter, number in row.items()}
    low, high = value if isinstance(value, tuple) else (value, value)
    return {name: (low, high)}


def plain(rows: Rows) -> Array:
    """Return k records of numbers as an array of shape (k, numbers).

    The array is a view, unless the records are not contiguous in memory.
    """
    together = np.ascontiguousarray(rows)
    return together.view(float).reshape(len(rows), rows.dtype.itemsize // 8)


def effective(robot: Robot) -> tuple[str, ...]:
    """Return the names of the parameters in :data:`OF_ROBOTS` that affect how a robot moves."""
    return tuple(name for name in OF_ROBOTS if not PARAMETERS[name].is_idle(robot))


def check(label: str, name: str, value: object) -> float:
    """Return the value of a parameter as a float.

    Args:
        label: Name of the value, for the error message.
        name: Name of the parameter.
        value: The value.

    Raises:
        ValueError: If the value is not a number within the limits of the parameter.
    """
    row = PARAMETERS[name]
    number = within(label, value, row.least, row.most)
    if row.whole and number != round(number):
        raise invalid(label, value, f"a whole number up to {row.most}")
    return number


@runtime_checkable
class Distribution(Protocol):
    """Protocol of a distribution from which a number can be sampled."""

    def sample(self, rng: np.random.Generator) -> float:
        """Return a sample, for which ``rng`` is the only source of random numbers."""
        ...


class Uniform(NamedTuple):
    """A uniform distribution.

    Attributes:
        low: Lower limit.
        high: Upper limit.
        whole: Whether the samples are whole numbers, including both limits.
    """

    low: float
    high: float
    whole: bool = False

    def sample(self, rng: np.random.Generator) -> float:
        """Return a sample."""
        if self.whole:
            return float(rng.integers(int(self.low), int(self.high), endpoint=True))
        return float(uniform(rng, self.low, self.high))


Randomization: TypeAlias = dict[str, Distribution]
"""Distributions of parameters by name, in the order of :data:`TABLE`."""

EVERY = "*"  # key that stands for all lengths
WIDEST = 0.9  # largest fraction by which a length may be shorter


def load_randomization(
    name: str, value: object, parameters: Iterable[str] | None = None
) -> dict[str, Any]:
    """Return the distributions that the argument ``randomize`` describes.

    Args:
        name: Name of the argument, for error messages.
        value: Distributions by the name of the parameter: a number, a pair (low, high) for a
            uniform distribution, or a :class:`Distribution`. The uniform distribution is one of
            whole numbers if the parameter is a whole number. The key "lengths" contains factors of
            link lengths: a dictionary by the name of the length, or a single entry for all lengths.
            There, a number s stands for (1 - s, 1 + s). None for no distributions.
        parameters: Allowed names of parameters. None for all.

    Returns:
        A :data:`Randomization`, and "lengths" with a distribution for each length if ``value`` has
        this key.

    Raises:
        ValueError: If a name is unknown or a range is not valid.
    """
    given = {} if value is None else value
    if not isinstance(given, Mapping):
        raise invalid(name, given, f"a mapping of some of {[*PARAMETERS]} to ranges")
    parameters = [*(PARAMETERS if parameters is None else parameters)]
    known = [*parameters, "lengths"]
    if unknown := sorted(map(str, {*given} - {*known})):
        raise invalid(f"a key of {name}", unknown[0], f"one of {listed(known, unknown[0])}")
    drawn: dict[str, Any] = {k: _distribution(k, given[k]) for k in parameters if k in given}
    if "lengths" in given:
        given_factors = given["lengths"]
        factors = given_factors if isinstance(given_factors, Mapping) else {EVERY: given_factors}
        drawn["lengths"] = {str(name): _factor(str(name), f) for name, f in factors.items()}
    return drawn


def _factor(name: str, value: object) -> Distribution:
    """Return the distribution of the factor of a length, or of all lengths (:data:`EVERY`)."""
    if isinstance(value, Distribution):
        return value
    label = "randomize['lengths']" + ("" if name == EVERY else f"[{name!r}]")
    if isinstance(value, (tuple, list, np.ndarray)):
        return Uniform(*number_range(label, value, *SCALE))
    spread = within(label, value, 0.0, WIDEST)
    return Uniform(1.0 - spread, 1.0 + spread)


def _distribution(name: str, value: object) -> Distribution:
    """Return the distribution of a parameter."""
    if isinstance(value, Distribution):
        return value
    row = PARAMETERS[name]
    label = f"randomize[{name!r}]"
    low, high = number_range(label, value, row.least, row.most)
    return Uniform(check(label, name, low), check(label, name, high), row.whole)
