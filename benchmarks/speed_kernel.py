"""The time step alone, without an environment around it.

One time step of a robot that stands on two toes: calls of 200 and of 400 time steps from the same
state, so that in their difference all that surrounds the loop cancels. Then a control step of a
walk against the number of legs and of the ground's segments: a walk is replayed from its torques.
"""

from __future__ import annotations

import time
from statistics import median
from typing import Any

import numpy as np

from benchmarks.rounds import Goal, table, take_turns
from benchmarks.speed_single import rough_ground
from jansen_env import Robot, Terrain, paper_robot
from jansen_env.plants.batch import TIME_STEP
from jansen_env.plants.projected import ProjectionPlant

NEEDS: tuple[str, ...] = ()
CONTROL_DT = 0.02  # s for which a torque is held
SHORT, LONG = 0.2, 0.4  # s, the two calls
PAIRS = 50  # of calls in a round
STILL = 1e-6  # m, rad, 1/s, by which what stands may move in a call
WALK_TIME = 5.0  # s
CRANK_SPEED, PUSH, GAIN = 2.7, 1.0, 2.5  # rad/s, N m a leg, N m s/rad a leg: these walk
FALLEN_PITCH = 1.2  # rad
PHASES = range(2, 13)  # crank pins, two legs on each
SEGMENTS = (10, 30, 100, 300, 1000, 3000, 10_000)
SPAN = 100.0  # m of rough ground
GROUNDS = 10  # of these, on some of which a robot falls


class Standing:
    """The paper's robot at rest on two toes on level ground."""

    def __init__(self) -> None:
        self.plant = ProjectionPlant(paper_robot(), Terrain.flat(), detection_interval=10.0)
        for angle in np.linspace(0.0, np.pi, 24, endpoint=False).tolist():
            self.state = self.plant.reset(0.0, angle)
            down = self.plant.step(0.0, LONG).contact_force[:, 1] > 0.0
            if down.sum() == 2 and np.abs(self.plant.state - self.state).max() < STILL:
                return
        raise RuntimeError("at no crank angle does the robot stand still on exactly two toes")

    def play(self) -> tuple[float, float]:
        """Seconds of one time step, and of what surrounds a call's loop."""
        calls = [(self._call(SHORT), self._call(LONG)) for _ in range(PAIRS)]
        step = median(b - a for a, b in calls) / round((LONG - SHORT) / TIME_STEP)
        return step, median(a for a, _ in calls) - step * round(SHORT / TIME_STEP)

    def _call(self, duration: float) -> float:
        self.plant.state = self.state
        start = time.perf_counter()
        self.plant.step(0.0, duration)
        return time.perf_counter() - start


class Replay:
    """A walk whose torques were recorded, so that a round times nothing but the plant.

    Args:
        plant: that walks. control_dt: s for which a torque is held. duration: of the walk, s.

    Attributes:
        toes_down: mean number of toes that carried at some time in a control step.
        distance: walked, m. fell: whether it fell, where the walk ends.
    """

    def __init__(
        self,
        plant: ProjectionPlant,
        control_dt: float = CONTROL_DT,
        duration: float = WALK_TIME,
    ) -> None:
        self.plant, self.control_dt = plant, control_dt
        self.start = plant.reset()
        self.torques: list[float] = []
        self.fell, down = False, 0
        while not self.fell and len(self.torques) < round(duration / control_dt):
            self.torques.append(walking_torque(plant.robot, float(plant.state[7])))
            result = plant.step(self.torques[-1], control_dt)
            down += int((result.contact_force[:, 1] > 0.0).sum())
            self.fell = result.bumped or abs(float(plant.state[2])) > FALLEN_PITCH
        self.toes_down = down / len(self.torques)
        self.distance = plant.x - float(self.start[0])

    def play(self) -> float:
        """Seconds of a control step."""
        step, control_dt = self.plant.step, self.control_dt
        self.plant.state = self.start
        start = time.perf_counter()
        for torque in self.torques:
            step(torque, control_dt)
        return (time.perf_counter() - start) / len(self.torques)


def walking_torque(robot: Robot, crank_speed: float) -> float:
    """N m that hold about :data:`CRANK_SPEED`: every leg adds its own weight and friction."""
    return len(robot.legs) * (PUSH + GAIN * (CRANK_SPEED - crank_speed))


def on_rough_ground(segments: int, duration: float) -> Replay:
    """A walk over so many segments, on the first of some grounds on which the robot stays up."""
    for seed in range(GROUNDS):
        plant = ProjectionPlant(paper_robot(), rough_ground(segments, SPAN / segments, seed))
        walk = Replay(plant, duration=duration)
        if not walk.fell:
            return walk
    raise RuntimeError(f"a robot falls on each of {GROUNDS} grounds of {segments} segments")


def measure(rounds: int, quick: bool) -> dict[str, Any]:
    """Times of a time step and of control steps; ready for JSON."""
    standing = Standing()
    duration = 0.2 if quick else WALK_TIME
    legs = {
        str(2 * phases): Replay(
            ProjectionPlant(paper_robot(phases), Terrain.flat()), duration=duration
        )
        for phases in (PHASES[:: len(PHASES) - 1] if quick else PHASES)
    }
    segments = {
        str(count): on_rough_ground(count, duration)
        for count in (SEGMENTS[:3:2] if quick else SEGMENTS)
    }
    found = take_turns({"standing": standing.play}, rounds)["standing"]
    return {
        "time_step": {
            "seconds": median(step for step, _ in found),
            "rounds": [step for step, _ in found],
            "around": median(around for _, around in found),
            "crank_angle": float(standing.state[3]),
        },
        "legs": _sweep(legs, rounds),
        "segments": _sweep(segments, rounds),
    }


def _sweep(walks: dict[str, Replay], rounds: int) -> list[dict[str, Any]]:
    found = take_turns({name: walk.play for name, walk in walks.items()}, rounds)
    return [
        {
            "count": int(name),
            "seconds": median(found[name]),
            "rounds": found[name],
            "toes_down": walk.toes_down,
            "distance": walk.distance,
            "fell": walk.fell,
        }
        for name, walk in walks.items()
    ]


def report(result: dict[str, Any]) -> str:
    """The result as tables."""
    step = result["time_step"]
    low, high = 1e6 * min(step["rounds"]), 1e6 * max(step["rounds"])
    parts = [
        f"A time step of {1e3 * TIME_STEP:g} ms, at rest on two toes: "
        f"{1e6 * step['seconds']:.3f} us (by round {low:.3f} to {high:.3f}); what surrounds the "
        f"loop in a call: {1e6 * step['around']:.1f} us.",
        f"A control step of {1e3 * CONTROL_DT:g} ms of a walk:",
    ]
    for name in ("legs", "segments"):
        rows = [
            (
                str(row["count"]), f"{1e6 * row['seconds']:.1f}", f"{1e6 * min(row['rounds']):.1f}",
                f"{1e6 * max(row['rounds']):.1f}", f"{row['toes_down']:.2f}",
                f"{row['distance']:.2f}",
            )
            for row in result[name]
        ]  # fmt: skip
        parts.append(table((name, "us", "lowest", "highest", "toes down", "walked, m"), rows))
        first, last = result[name][0], result[name][-1]
        growth = last["seconds"] / first["seconds"]
        parts.append(f"{last['count']} {name} cost {growth:.2f} times as much as {first['count']}.")
    return "\n\n".join(parts)


def goals(result: dict[str, Any]) -> list[Goal]:
    """Where the time step's cost should be."""
    microseconds = 1e6 * result["time_step"]["seconds"]
    return [Goal("time step at rest on two toes, us", microseconds, "at most", 1.0)]
