"""Measures of a search's candidates: on the ground, in the pins, on steps, of the shape."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from contextlib import suppress
from typing import NamedTuple, cast

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from agents.design.held_leg import held_leg_measures
from agents.design.pins import loads_of_walk
from agents.design.shape import Part, clearance, geometry_measures, shared_planes
from agents.design.variables import Candidate
from agents.tuning.profile_search import profiles
from jansen_env.baselines.policy import Array, Policy
from jansen_env.dynamics.projection import leg_sides
from jansen_env.gravity import GRAVITY
from jansen_env.plants.plant import ProjectionPlant
from jansen_env.robot.lengths import lengths, with_lengths
from jansen_env.scoring.metrics import SETTLING, Episodes, point_estimates
from jansen_env.scoring.rollout import (
    EnvKwargs,
    Options,
    VectorEnv,
    make_env,
    make_envs,
    run_episodes,
)
from jansen_env.tasks.walking.walker_benchmark import ENOUGH, WALKER
from jansen_env.tasks.walking.walker_env import JansenWalkerEnv
from jansen_env.terrain import Terrain, shapes
from jansen_env.world.settings import load_robot

SEED = 130_000  # of resets, apart from all others
STEPS = tuple(np.round(np.arange(0.04, 0.321, 0.04), 3).tolist())  # m, heights that are climbed
STEP_AT = 1.0  # m, where the step is
LEAST_BEYOND = 0.5  # m, to walk after it
COPIES, TOLERANCE = 8, 5e-4  # of a candidate whose lengths are off by up to so much, m


class Measure(NamedTuple):
    """A measure: the group that gives it, its unit and description."""

    group: str
    unit: str
    label: str


HELD = {
    "leg_step": "m", "leg_clearance": "m", "leg_duty": "fraction", "leg_flatness": "1",
    "leg_ripple": "1", "leg_wear": "N m", "leg_wear_of_mean": "N m", "leg_pin_load": "N",
}  # fmt: skip
"""Units of :func:`agents.design.held_leg.held_leg_measures`."""
WALK = {name: Measure("walk", m.unit, m.label) for name, m in WALKER.metrics.items()}
MEASURES: dict[str, Measure] = WALK | {
    **{name: Measure("held", unit, "of one held leg") for name, unit in HELD.items()},
    "upright": Measure("walk", "fraction", "of the time limit without a fall"),
    "closure": Measure("shape", "1", "sine of two links' angle, nearest a dead point"),
    "height": Measure("shape", "m", "of the crank axis above the lowest toe, mean"),
    "width": Measure("shape", "m", "of the machine"),
    "longest": Measure("shape", "m", "longest side of a link"),
    "mass": Measure("shape", "kg", "of the machine"),
    "lift": Measure("shape", "m", "most that a toe comes above the lowest one"),
    "opening": Measure("shape", "m", "of a toe's path in its middle: what it steps over"),
    "heave": Measure("shape", "m", "range of the crank axis's height, level and slow"),
    "stance": Measure("shape", "fraction", "of a turn with a toe near the ground, mean of all"),
    "advance": Measure("shape", "m", "way in a turn of the crank, level and slow, either way"),
    "clearance": Measure("planes", "m", "between links in one plane of the drawings"),
    "wear": Measure("loads", "J/m", "load times sliding in all pins per metre"),
    "pin_force": Measure("loads", "N", "largest force in a pin"),
    "rod_safety": Measure("loads", "1", "least buckling load over load of a bar"),
    "climb": Measure("climb", "m", "height of a step that is climbed"),
    "worst_copy": Measure(
        "copies", "1", f"largest cost of transport of {COPIES} copies built to {1e3 * TOLERANCE} mm"
    ),
}  # fmt: skip
"""Measures by name; walks have the metrics of the walker's benchmark."""
GROUPS = ("shape", "held", "planes", "walk", "copies", "climb", "loads")
"""Groups of measures, the cheapest first."""


class Walker:
    """Measures candidates, and walks them on an environment at one commanded speed.

    Args:
        env_id, env_kwargs: of a walker, with its "robot". speed: m/s.
        starts: crank angles to start from, evenly over half a turn: after that the legs have
            swapped. count: of candidates at once.
        policy: that turns the crank in place of the candidates' profiles.
    """

    def __init__(
        self, env_id: str, env_kwargs: EnvKwargs, speed: float, starts: int, count: int,
        policy: Policy | None = None,
    ) -> None:  # fmt: skip
        self.env_id, self.env_kwargs, self.speed = env_id, env_kwargs, speed
        self.starts, self.count, self.policy = starts, count, policy
        self.angles = math.pi * (np.arange(starts) + 0.5) / starts
        self._env = make_env(env_id, env_kwargs)
        self._envs: dict[tuple[object, ...], VectorEnv] = {}
        self._shared: list[tuple[Part, Part]] | None = None

    @property
    def time_limit(self) -> float:
        """Duration of an episode without a fall, s."""
        spec = self._env.spec
        assert spec is not None and spec.max_episode_steps is not None
        return spec.max_episode_steps * cast(JansenWalkerEnv, self._env.unwrapped).control_dt

    def measure(self, group: str, candidates: Sequence[Candidate]) -> dict[str, Array]:
        """Return a group's measures (n,) of candidates by name; NaN for what is not known."""
        rows = {
            "shape": lambda: [geometry_measures(c.robot) for c in candidates],
            "held": lambda: [held_leg_measures(c.robot) for c in candidates],
            "planes": lambda: self._planes(candidates),
            "walk": lambda: self.walk(candidates),
            "copies": lambda: self._copies(candidates),
            "climb": lambda: self._climb(candidates),
            "loads": lambda: [self._loads(c) for c in candidates],
        }[group]()
        return {name: np.array([row[name] for row in rows], float) for name in rows[0]}

    def _planes(self, candidates: Sequence[Candidate]) -> list[dict[str, float]]:
        """Gaps in the order along the shaft of the robot that the search began with."""
        if self._shared is None:
            self._shared = shared_planes(load_robot("robot", self.env_kwargs["robot"]))
        return [{"clearance": clearance(c.robot, self._shared)} for c in candidates]

    def walk(self, candidates: Sequence[Candidate]) -> list[dict[str, float]]:
        """Score every candidate's walks from all starts."""
        rows = []
        for run in self._run(candidates, self.angles):
            scores = point_estimates(WALKER.metrics, run, self._env)
            row = {name: math.nan if value is None else value for name, value in scores.items()}
            rows.append({**row, "upright": float(run["duration"].mean() / self.time_limit)})
        return rows

    def _run(
        self, candidates: Sequence[Candidate], angles: Array, grounds: Sequence[Terrain] = ()
    ) -> list[Episodes]:
        """Return each candidate's episodes, one from each crank angle, on its ground or level."""
        runs: dict[int, Episodes] = {}
        by_sides: dict[tuple[str, ...], list[int]] = {}
        for k, candidate in enumerate(candidates):
            by_sides.setdefault(leg_sides(candidate.robot), []).append(k)
        for members in by_sides.values():
            for begin in range(0, len(members), self.count):
                part = members[begin : begin + self.count]
                batch = self._batch([candidates[k] for k in part], angles, grounds)
                runs.update(zip(part, batch, strict=True))
        return [runs[k] for k in range(len(candidates))]

    def _batch(
        self, candidates: list[Candidate], angles: Array, grounds: Sequence[Terrain]
    ) -> list[Episodes]:
        """:meth:`_run` of up to ``count`` candidates with the same legs."""
        # Batches have few sizes, and are kept: places to spare walk the last candidate again.
        count = min(self.count, 1 << (len(candidates) - 1).bit_length())
        n, each = count * len(angles), len(angles)
        padded = [*candidates, *[candidates[-1]] * (count - len(candidates))]
        robots = np.empty(n, object)
        robots[:] = [candidate.robot for candidate in padded for _ in angles]
        kwargs = dict(self.env_kwargs)
        options: Options = {"crank_angle": np.tile(angles, count)}
        if grounds:
            kwargs["terrain"] = [*grounds] * count
        if self.policy is None:
            kwargs["robot"], options["robot"] = padded[0].robot, robots
        else:  # which may observe how far lengths are from the environment's robot
            options["lengths"] = np.empty(n, object)
            options["lengths"][:] = [lengths(robot) for robot in robots]
        key = leg_sides(padded[0].robot), n, each, bool(grounds)
        if key not in self._envs:
            self._envs[key] = make_envs(self.env_id, kwargs, n)
        numbers = np.repeat([candidate.numbers for candidate in padded], each, axis=0)
        run = run_episodes(
            self.policy or profiles(numbers, self._env), self.env_id, kwargs,
            np.full(n, self.speed), SEED + np.arange(n) % each,
            at_once=n, options=options, envs=self._envs[key],
        )  # fmt: skip
        run["weight"] = np.array([GRAVITY * robot.mass for robot in robots])
        return [
            {name: values[k * each : (k + 1) * each] for name, values in run.items()}
            for k in range(len(candidates))
        ]

    def _copies(self, candidates: Sequence[Candidate]) -> list[dict[str, float]]:
        """Score copies whose lengths are off, from one start each; infinite: one does not walk."""
        rng, copies, places = np.random.default_rng(SEED), [], []
        names = [name for name in lengths(candidates[0].robot) if name != "frame_angle"]
        errors = rng.uniform(-TOLERANCE, TOLERANCE, (COPIES, len(names)))
        costs = np.full((len(candidates), COPIES), np.inf)
        for k, candidate in enumerate(candidates):
            nominal = lengths(candidate.robot)
            for i, error in enumerate(errors.tolist()):
                off = {name: nominal[name] + e for name, e in zip(names, error, strict=True)}
                with suppress(ValueError):  # three lengths that form no triangle
                    robot = with_lengths(candidate.robot, off)
                    if geometry_measures(robot)["closure"] > 0.0:
                        copies.append(Candidate(robot, candidate.numbers))
                        places.append((k, i))
        for place, run in zip(places, self._run(copies, self.angles[:1]), strict=True):
            cost = point_estimates(WALKER.metrics, run, self._env)["steady_cost_of_transport"]
            if cost is not None and not run["fell"].any():
                costs[place] = cost
        return [{"worst_copy": value} for value in costs.max(axis=1).tolist()]

    def _climb(self, candidates: Sequence[Candidate]) -> list[dict[str, float]]:
        """Sum over :data:`STEPS`: their differences, times the share of the way beyond the step
        that is walked, 0 after a fall, mean of all starts."""
        beyond = ENOUGH * self.speed * self.time_limit - STEP_AT
        if beyond < LEAST_BEYOND:
            raise ValueError(
                f"climb at speed {self.speed} and a time limit of {self.time_limit:g} s ends "
                f"{beyond:g} m behind the step, must be {LEAST_BEYOND} or more"
            )
        heights, rows = np.array(STEPS), []
        grounds = [_step(height) for height in STEPS for _ in self.angles]
        for run in self._run(candidates, np.tile(self.angles, len(STEPS)), grounds):
            walked = np.clip((run["distance"] - STEP_AT) / beyond, 0.0, 1.0)
            share = np.where(run["fell"], 0.0, walked).reshape(len(STEPS), -1).mean(axis=1)
            rows.append({"climb": float(np.diff(heights, prepend=0.0) @ share)})
        return rows

    def _loads(self, candidate: Candidate) -> dict[str, float]:
        """Pin forces of a walk after :data:`SETTLING` s: wear, the largest, buckling."""
        kwargs = {**self.env_kwargs, "speed_command": self.speed}
        options: dict[str, object] = {"crank_angle": float(self.angles[0])}
        if self.policy is None:
            kwargs["robot"] = candidate.robot
        else:
            options["lengths"] = lengths(candidate.robot)
        env = gym.make(self.env_id, **kwargs)
        unwrapped = cast(JansenWalkerEnv, env.unwrapped)
        plant = cast(ProjectionPlant, unwrapped.plant)
        policy = self.policy or profiles(candidate.numbers[None], env)
        traces: list[NDArray[np.void]] = []
        state, over = None, False
        plant.tracing = True
        seen, _ = env.reset(seed=SEED, options=options)
        begin = round(SETTLING / unwrapped.control_dt)
        while not over:
            action, state = policy.predict(seen, state, np.array(not traces), True)
            seen, _, fallen, late, _ = env.step(action)
            traces.append(plant.trace.copy())
            over = fallen or late
        env.close()
        if len(traces) <= begin + 1:
            return {"wear": math.nan, "pin_force": math.nan, "rod_safety": math.nan}
        trace = np.concatenate(traces[begin:])
        least = 0.5 * self.speed * plant.time_step * len(trace)  # or it does not walk
        return loads_of_walk(candidate.robot, trace, plant.time_step, least)


def _step(height: float) -> Terrain:
    """Flat ground with one step up."""
    tread = shapes.treads(np.array([STEP_AT]), np.array([height]))
    return Terrain.of(np.concatenate([[[-1.0, 0.0]], tread, [[tread[-1, 0] + 1.0, height]]]))


def groups_of(names: Collection[str]) -> list[str]:
    """Return the groups that give some measures, in the order of :data:`GROUPS`."""
    needed = {MEASURES[name].group for name in names}
    return [group for group in GROUPS if group in needed]
