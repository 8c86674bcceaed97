"""Walks on either plant, measured the same way, for :mod:`benchmarks.plants`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from jansen_env import Payload, Terrain, paper_robot
from jansen_env.gravity import GRAVITY
from jansen_env.plants.base import Plant
from jansen_env.plants.make import PLANTS

Array = NDArray[np.float64]

CONTROL_DT = 0.02  # s for which the PID holds a torque
TORQUE_LIMIT = 20.0  # N m
GAINS = (10.0, 1.0, 1.0)  # the paper's, (13): N m / rad, N m / (rad s), N m s / rad
SETTLE = 2.0  # s of walking that are not measured
FALLEN = 1.2  # rad of pitch
STARTS = (0.0, 2.5e-4, 5e-4, 7.5e-4, 1e-3)  # rad, crank angles of an ensemble
OTHER_STARTS = tuple(math.pi * k / 12.0 for k in range(12))
"""rad, crank angles over half a turn, after which the machine looks the same."""


@dataclass(frozen=True)
class Walk:
    """What is walked: the crank held at a speed by the paper's PID.

    Attributes:
        speed: of the crank, rad/s. friction: Coulomb coefficient. slope: rad, uphill positive.
        payload: kg at the crank axis. duration: s, measured after :data:`SETTLE`; about, as
            :attr:`measured` is a whole number of half turns.
    """

    speed: float
    friction: float = 0.8
    slope: float = 0.0
    payload: float = 0.0
    duration: float = 6.0

    @property
    def measured(self) -> float:
        """s."""
        half_turn = math.pi / self.speed
        return max(1, round(self.duration / half_turn)) * half_turn

    @property
    def title(self) -> str:
        """How it is called in tables."""
        words = [f"{self.speed:g} rad/s, friction {self.friction:g}"]
        words += [f"slope {self.slope:+g}"] if self.slope else []
        words += [f"{self.payload:g} kg"] if self.payload else []
        return ", ".join(words)


class Way(NamedTuple):
    """What came out of a walk.

    Attributes:
        distance: m along x. cost_of_transport: |motor work| / (weight * distance).
        rms_torque: N m. heave: highest less lowest position of the crank axis over the ground, m.
        slip_per_metre: m/m. joint_gap: m. fell: whether it fell; the rest is until then.
    """

    distance: float
    cost_of_transport: float
    rms_torque: float
    heave: float
    slip_per_metre: float
    joint_gap: float
    fell: bool


class PID:
    """The paper's controller (13) on a crank that is to turn at constant speed from where it is."""

    def __init__(self, speed: float, start: float) -> None:
        self.speed, self.reference, self.integral = speed, start, 0.0

    def torque(self, angle: float, rate: float) -> float:
        """N m, and the reference one control step on."""
        error = self.reference - angle
        self.integral += error * CONTROL_DT
        self.reference += self.speed * CONTROL_DT
        kp, ki, kd = GAINS
        wanted = kp * error + ki * self.integral + kd * (self.speed - rate)
        return min(TORQUE_LIMIT, max(-TORQUE_LIMIT, wanted))


def make(walk: Walk, plant: str, halvings: int = 0, **arguments: Any) -> Plant:
    """A plant for a walk, its own time step halved so many times."""
    robot = paper_robot()
    if walk.payload:
        robot = type(robot)(payload=Payload(walk.payload))
    terrain = Terrain.slope(walk.slope, friction=walk.friction)
    kind, time_step = PLANTS[plant]
    made: Plant = kind(robot, terrain, time_step / 2**halvings, **arguments)
    return made


def measure(walk: Walk, plant: Plant, start: float = 0.0) -> Way:
    """Walk and measure; ``start`` is the crank angle at which the robot is set down, rad."""
    plant.reset(crank_angle=start)
    pid = PID(walk.speed, start)
    settle, steps = round(SETTLE / CONTROL_DT), round((SETTLE + walk.measured) / CONTROL_DT)
    work = slip = square = gap = from_x = 0.0
    heights, fell, done = [], False, 0
    for k in range(steps):
        if k == settle:
            from_x = plant.x
        state = plant.state
        torque = pid.torque(float(state[3]), float(state[7]))
        result = plant.step(torque, CONTROL_DT)
        gap = max(gap, result.joint_gap)
        fell = result.bumped or abs(float(plant.state[2])) > FALLEN
        if fell:
            break
        if k < settle:
            continue
        done += 1
        work += abs(result.motor_work)
        slip += float(result.slip.sum())
        square += torque**2
        x, y = plant.state[:2].tolist()
        heights.append(y - float(plant.terrain.height(x)))
    distance = plant.x - from_x if done else 0.0
    way = max(abs(distance), 1e-9)
    return Way(
        distance,
        work / (plant.robot.mass * GRAVITY * way),
        math.sqrt(square / max(done, 1)),
        float(np.ptp(heights)) if heights else 0.0,
        slip / way,
        gap,
        fell,
    )


class Comparison(NamedTuple):
    """One walk on both plants.

    Attributes:
        ensemble: on the projection plant, from each of :data:`STARTS`, then from the first with
            the time step halved. others: the same from each of :data:`OTHER_STARTS`.
        rigid: on the rigid-body plant, with its time step and half of it.
    """

    walk: Walk
    ensemble: list[Way]
    others: list[Way]
    rigid: list[Way]

    @property
    def projection(self) -> dict[str, float]:
        """Medians over the ensemble."""
        names = Way._fields[:-1]
        return {n: float(np.median([getattr(way, n) for way in self.ensemble])) for n in names}

    @property
    def spread(self) -> float:
        """Of the ensemble's distances: (largest - smallest) / median; infinite after a fall."""
        if any(way.fell for way in self.ensemble):
            return math.inf
        median = max(abs(self.projection["distance"]), 1e-9)
        return float(np.ptp([way.distance for way in self.ensemble])) / median

    def off(self, name: str) -> float:
        """The rigid-body plant's value (half the time step) over the projection plant's, less 1."""
        return getattr(self.rigid[-1], name) / self.projection[name] - 1.0

    def verdict(self, allowed: float) -> str:
        """How the plants compare: "agree" within ``allowed`` in distance and cost of transport.

        "chaotic": starts 1 mrad apart come apart by more on the projection plant alone. "other
        gait": a walk like the rigid-body plant's is found there from another crank angle.
        """
        falls = [all(w.fell for w in ways) for ways in (self.ensemble, self.rigid)]
        if all(falls):
            return "falls on both"
        if any(w.fell for ways in (self.ensemble, self.rigid) for w in ways):
            return "falls at times"
        if self.spread > allowed:
            return "chaotic"
        off = max(abs(self.off("distance")), abs(self.off("cost_of_transport")))
        if off <= allowed:
            return "agree"
        gaits = [way for way in (*self.ensemble, *self.others) if not way.fell]
        last = self.rigid[-1]
        like = any(
            abs(last.distance / way.distance - 1.0) <= allowed
            and abs(last.cost_of_transport / way.cost_of_transport - 1.0) <= allowed
            for way in gaits
        )
        return "other gait" if like else "differ"


def compare(walk: Walk) -> Comparison:
    """Run one walk on both plants."""
    ensemble = [measure(walk, make(walk, "projection"), start) for start in STARTS]
    ensemble.append(measure(walk, make(walk, "projection", 1)))
    others = [measure(walk, make(walk, "projection"), start) for start in OTHER_STARTS]
    rigid = [measure(walk, make(walk, "rigid_body", halvings)) for halvings in (0, 1)]
    return Comparison(walk, ensemble, others, rigid)
