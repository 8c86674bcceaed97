"""Measures of candidates: walking, pin forces, climbing of steps, and geometry."""

import itertools
import math
from collections.abc import Sequence
from functools import cached_property
from typing import cast

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from agents import need_workshop
from agents.design.variables import Candidate
from jansen_env.arrays import Array
from jansen_env.dynamics.gravity import GRAVITY
from jansen_env.dynamics.joint_forces import JointForces
from jansen_env.dynamics.reduced import CONVERGED, compile_robot
from jansen_env.engine.walk_reward import ENOUGH
from jansen_env.plants.base import static_deflection
from jansen_env.plants.batch import Batch
from jansen_env.plants.trace import trace_forces
from jansen_env.policies.policy import TorquePolicy, columns
from jansen_env.robot import Bar, Robot, kinematics
from jansen_env.robot import buildable as built
from jansen_env.robot.lengths import lengths
from jansen_env.robot.linkage import CRANK
from jansen_env.robot.soundness import check_standing
from jansen_env.scoring import rollout
from jansen_env.scoring.metrics import SETTLING, Env, Episodes, horizon, point_estimates
from jansen_env.tasks.walking.profile import READ, profile_torque
from jansen_env.tasks.walking.walker_benchmark import WORLD
from jansen_env.tasks.walking.walker_env import JansenWalkerEnv
from jansen_env.terrain.ground import Terrain, one_step
from jansen_env.world.settings import load_robot

SEED = 130_000  # first seed of the resets; no other part of the project uses these seeds
STEPS = tuple(np.round(np.arange(0.04, 0.321, 0.04), 3).tolist())  # heights of steps, in m
STEP_AT = 1.0  # position of the step, in m
LEAST_BEYOND = 0.5  # smallest distance to walk after the step, in m
TRACED = 8  # pin forces for the wear are computed in every eighth time step
PEAKS = 64  # number of time steps with the largest ground impulses, for the largest forces
OF_PATHS = "height", "width", "lift", "opening", "heave", "stance", "advance"
PLANE = np.array([1.0, 1.0j])  # converts a point (x, y) to a complex number
SAMPLES = 180  # number of crank angles per turn
PATH_POINTS = 64  # number of points on the path of a toe

Part = tuple[int, int]
"""Indices of a leg and of a body in it."""


GROUPS: dict[str, dict[str, str]] = {
    "shape": {
        "closure": "1", "height": "m", "width": "m", "longest": "m", "mass": "kg", "lift": "m",
        "opening": "m", "heave": "m", "stance": "fraction", "advance": "m",
    },
    "planes": {"clearance": "m"},
    "path": {"path_error": "1"},
    "walk": {**{name: m.unit for name, m in WORLD.metrics.items()}, "upright": "fraction"},
    "climb": {"climb": "m", "links_in_ground": "fraction"},
    "loads": {"wear": "J/m", "pin_force": "N", "rod_safety": "1"},
}  # fmt: skip
"""Units of the measures, grouped by the computation that yields them, the cheapest group first.

``docs/design.md`` defines each measure. The group ``walk`` contains the metrics of the benchmark.
"""
MEASURES = {name: unit for units in GROUPS.values() for name, unit in units.items()}


def profiles(numbers: Array, env: Env) -> TorquePolicy:
    """Return a policy that applies one crank-speed profile per walker.

    Args:
        numbers: Parameters of the profiles with K harmonics, shape (n, 4 + 2 K).
        env: Environment of one walker, which determines observations and torque limit.
    """
    walker = cast(JansenWalkerEnv, env.unwrapped)
    read = columns(walker, *READ)
    return TorquePolicy(
        lambda seen, *_: (profile_torque(numbers, seen, read), None), walker.torque_limit
    )


class Walker:
    """Measurement of candidates, which includes walks at one commanded speed.

    Args:
        env_id: Id of a walker environment.
        env_kwargs: Arguments of the environment, including ``robot``, the initial design.
        speed: Commanded speed, in m/s.
        starts: Number of starting crank angles, evenly spaced over half a turn. After half a turn,
            the legs have swapped their roles.
        count: Number of candidates that walk at once.

    Attributes:
        angles: Starting crank angles, in rad, shape (starts,).
        time_limit: Time limit of an episode, in s.
    """

    def __init__(
        self, env_id: str, env_kwargs: rollout.EnvKwargs, speed: float, starts: int, count: int
    ) -> None:
        self.env_id = env_id
        self.env_kwargs = env_kwargs
        self.speed = speed
        self.count = count
        self.angles = math.pi * (np.arange(starts) + 0.5) / starts
        self._start = load_robot("robot", env_kwargs["robot"])
        self._env = rollout.make_env(env_id, env_kwargs)
        self._envs: dict[tuple[object, ...], rollout.VectorEnv] = {}
        self.time_limit = horizon(self._env)

    @cached_property
    def _shared(self) -> list[tuple[Part, Part]]:
        """Pairs of links that lie in the same layer of the initial design."""
        return shared_planes(self._start)

    @cached_property
    def _path(self) -> NDArray[np.complex128]:
        """Path of the first toe of the initial design."""
        return toe_path(self._start)

    def measure(self, group: str, candidates: Sequence[Candidate]) -> dict[str, Array]:
        """Return one group of measures.

        Args:
            group: Name of the group, a key of :data:`GROUPS`.
            candidates: The n candidates.

        Returns:
            The measures by name, shape (n,) each. NaN marks a value that is not known.
        """
        robots = [candidate.robot for candidate in candidates]
        values = {
            "shape": lambda: [geometry_measures(robot) for robot in robots],
            "planes": lambda: [{"clearance": clearance(r, self._shared)} for r in robots],
            "path": lambda: [{"path_error": path_error(toe_path(r), self._path)} for r in robots],
            "walk": lambda: self.walk(candidates),
            "climb": lambda: self._climb(candidates),
            "loads": lambda: [self._loads(c) for c in candidates],
        }[group]()
        return {name: np.array([each[name] for each in values], float) for name in values[0]}

    def walk(self, candidates: Sequence[Candidate]) -> list[dict[str, float]]:
        """Let every candidate walk from all starting crank angles and score it.

        Args:
            candidates: The candidates.

        Returns:
            The metrics of each candidate by name.
        """
        scores = []
        for run in self._run(candidates, self.angles):
            estimates = point_estimates(WORLD.metrics, run, self._env)
            known = {name: math.nan if v is None else v for name, v in estimates.items()}
            scores.append({**known, "upright": float(run["duration"].mean() / self.time_limit)})
        return scores

    def _run(
        self, candidates: Sequence[Candidate], angles: Array, grounds: Sequence[Terrain] = ()
    ) -> list[Episodes]:
        """Return the episodes of each candidate, one per crank angle.

        ``grounds`` has one terrain per crank angle. Without it, the terrain is that of the
        environment.
        """
        parts = [candidates[i : i + self.count] for i in range(0, len(candidates), self.count)]
        return [run for part in parts for run in self._batch(part, angles, grounds)]

    def _batch(
        self, candidates: Sequence[Candidate], angles: Array, grounds: Sequence[Terrain]
    ) -> list[Episodes]:
        """Run the episodes of up to ``count`` candidates; see :meth:`_run`."""
        # Round the batch size up to a power of two, so that few environments have to be created
        # and stored. Spare robots repeat the last candidate.
        count = min(self.count, 1 << (len(candidates) - 1).bit_length())
        each = len(angles)
        n = count * each
        padded = [*candidates, *[candidates[-1]] * (count - len(candidates))]
        robots = np.empty(n, object)
        robots[:] = [candidate.robot for candidate in padded for _ in angles]
        kwargs = {**self.env_kwargs, "robot": padded[0].robot}
        options: rollout.Options = {"crank_angle": np.tile(angles, count), "robot": robots}
        if grounds:
            kwargs["terrain"] = [*grounds] * count
        key = n, each, bool(grounds)
        if key not in self._envs:
            self._envs[key] = rollout.make_envs(self.env_id, kwargs, n)
        numbers = np.repeat([candidate.numbers for candidate in padded], each, axis=0)
        run = rollout.run_episodes(
            profiles(numbers, self._env),
            self.env_id,
            kwargs,
            np.full(n, self.speed),
            SEED + np.arange(n) % each,
            at_once=n,
            options=options,
            envs=self._envs[key],
        )
        run["weight"] = np.array([GRAVITY * robot.mass for robot in robots])
        return [
            {name: values[k * each : (k + 1) * each] for name, values in run.items()}
            for k in range(len(candidates))
        ]

    def _climb(self, candidates: Sequence[Candidate]) -> list[dict[str, float]]:
        """Return the measures ``climb`` and ``links_in_ground`` of each candidate.

        ``climb``, in m, is a sum over the heights in :data:`STEPS`. Each term is the difference
        from the previous height, multiplied by the fraction of the distance beyond the step that
        the robot walks. This fraction is 0 after a fall and is averaged over all starts.

        ``links_in_ground`` is the fraction of time in which a link is in the ground, averaged over
        the walks whose fraction is above 0.
        """
        beyond = ENOUGH * self.speed * self.time_limit - STEP_AT
        if beyond < LEAST_BEYOND:
            raise ValueError(
                f"climb must end at least {LEAST_BEYOND} m beyond the step, got {beyond:g} m at "
                f"speed {self.speed} and a time limit of {self.time_limit:g} s"
            )
        heights = np.array(STEPS)
        climbed = []
        grounds = [one_step(STEP_AT, height) for height in STEPS for _ in self.angles]
        for run in self._run(candidates, np.tile(self.angles, len(STEPS)), grounds):
            walked = np.clip((run["distance"] - STEP_AT) / beyond, 0.0, 1.0)
            walked = np.where(run["fell"], 0.0, walked)
            fraction = walked.reshape(len(STEPS), -1).mean(axis=1)
            steps = run["duration"] / self._env.get_wrapper_attr("control_dt")
            over = walked > 0.0
            in_ground = float((run["steps_in_ground"] / steps)[over].mean()) if over.any() else 0.0
            climb = float(np.diff(heights, prepend=0.0) @ fraction)
            climbed.append({"climb": climb, "links_in_ground": in_ground})
        return climbed

    def _loads(self, candidate: Candidate) -> dict[str, float]:
        """Return the wear, the largest pin force and the safety against buckling of one walk.

        The first :data:`SETTLING` seconds of the walk do not count. The measures are NaN if the
        robot falls before that.
        """
        kwargs = {**self.env_kwargs, "speed_command": self.speed, "robot": candidate.robot}
        env = gym.make(self.env_id, **kwargs)
        unwrapped = cast(JansenWalkerEnv, env.unwrapped)
        plant = cast(Batch, unwrapped.plant.batch)
        policy = profiles(candidate.numbers[None], env)
        traces: list[NDArray[np.void]] = []
        over = False
        plant.tracing = True
        seen, _ = env.reset(seed=SEED, options={"crank_angle": float(self.angles[0])})
        begin = round(SETTLING / unwrapped.control_dt)
        while not over:
            seen, _, fallen, late, _ = env.step(policy.predict(seen)[0])
            traces.append(plant.trace.copy())
            over = fallen or late
        env.close()
        if len(traces) <= begin + 1:
            return {"wear": math.nan, "pin_force": math.nan, "rod_safety": math.nan}
        trace = np.concatenate(traces[begin:])
        # A robot that covers less than half of the commanded distance does not walk.
        least = 0.5 * self.speed * plant.time_step * len(trace)
        return loads_of_walk(candidate.robot, trace, plant.time_step, least)


def loads_of_walk(
    robot: Robot, trace: NDArray[np.void], time_step: float, least: float
) -> dict[str, float]:
    """Return the wear, the largest pin force and the smallest safety of a bar against buckling.

    The wear follows Archard (1953): the pin force times the sliding distance at the radius of the
    bush, summed over all pins, per metre walked. Multiplied by Archard's coefficient, it is the
    worn volume per metre.

    Args:
        robot: The robot that walked.
        trace: Trace of the walk, shape (steps,); see :mod:`jansen_env.plants.trace`.
        time_step: Duration of a time step, in s.
        least: Distance that the robot has to walk, in m. If it walks less, the wear is NaN.

    Returns:
        ``wear`` in J/m, ``pin_force`` in N, and ``rod_safety``, the buckling load divided by the
        largest compression.
    """
    pushed = np.abs(trace["impulses"]).sum(axis=(1, 2))
    every = trace[::TRACED]
    hardest = trace[np.argsort(pushed)[-PEAKS:]]
    tables = compile_robot(robot)
    force = trace_forces(tables, every, time_step).magnitude
    pairs = [(pin.other, pin.body) for pin in robot.linkage.pins]
    # The rotation of the pins per rad of the crank, and then per second.
    rate = kinematics.turning(robot, every["pose"][:, 3], pairs)
    rate *= np.abs(every["velocity_after"][:, 3, None, None])
    work = float((force * rate).sum()) * built.PIN_RADIUS * time_step * TRACED
    walked = float(trace["pose"][-1, 0] - trace["pose"][0, 0])
    peak = trace_forces(tables, hardest, time_step)
    return {
        "wear": work / walked if walked > least else math.nan,
        "pin_force": float(peak.magnitude.max()),
        "rod_safety": rod_safety(robot, peak),
    }


def rod_safety(robot: Robot, forces: JointForces) -> float:
    """Return the smallest safety factor of an aluminium bar against buckling.

    It is the buckling load divided by the largest compression.

    Args:
        robot: The robot that walked.
        forces: Forces at the joints in the time steps to examine.
    """
    axial = forces.link_loads()[..., 0]
    safety = math.inf
    for body, (name, link) in enumerate(zip(robot.linkage.names, robot.bodies, strict=True), 1):
        if isinstance(link, Bar) and body > CRANK:
            ends = [k for k, (b, _) in enumerate(robot.linkage.corners) if b == body]
            push = max(1e-9, -float(axial[..., ends].mean(axis=-1).min()))
            most = built.buckling_load(link.length, built.bar_thickness(name))
            safety = min(safety, most / push)
    return safety


def geometry_measures(robot: Robot) -> dict[str, float]:
    """Return the measures of the group ``shape`` by name.

    If the robot cannot turn its crank or cannot stand, ``closure`` is -1 and every measure except
    ``mass`` and ``longest`` is NaN.

    Args:
        robot: Robot to measure.
    """
    sizes = {name: abs(value) for name, value in lengths(robot).items() if name != "frame_angle"}
    known = {"mass": robot.mass, "longest": max(sizes.values())}
    try:
        closure = kinematics.nearest_dead_point(robot, SAMPLES)[0]
        check_standing(robot)
        converged = compile_robot(robot).tail <= CONVERGED
        static_deflection(robot, GRAVITY)
    except ValueError:
        # The linkage does not close, or the robot cannot stand or is too heavy for its feet.
        converged = False
    if not converged:  # this includes linkages that almost fail to close
        return known | {"closure": -1.0, **dict.fromkeys(OF_PATHS, math.nan)}
    angles = np.linspace(0.0, 2.0 * math.pi, SAMPLES, endpoint=False)
    place = kinematics.joint_positions(robot, "fore", angles)
    toes = kinematics.toe_positions(robot, angles)
    heights = toes[..., 1]
    lowest = heights.min(axis=1)  # height of the level ground on which the robot stands
    above = heights - lowest[:, None]
    height = -float(lowest.mean())
    paths = (
        height,
        2.0 * np.abs(place[..., 0]).max(),
        above.max(),
        min(map(_opening, toes.swapaxes(0, 1))),
        np.ptp(lowest),
        (above <= kinematics.STANCE * height).mean(),
        abs(kinematics.advance_per_turn(robot, SAMPLES)),
    )
    return known | {"closure": closure, **dict(zip(OF_PATHS, map(float, paths), strict=True))}


def _opening(path: Array) -> float:
    """Return the vertical opening of a toe path at the middle of the stride, in m.

    ``path`` has shape (n, 2). The opening is the distance between the forward and return strokes.
    """
    x = path[:, 0] - 0.5 * (path[:, 0].min() + path[:, 0].max())
    after = np.roll(path[:, 1], -1), np.roll(x, -1)
    crossing = x * after[1] <= 0.0
    fraction = (x / np.where(crossing, x - after[1], 1.0))[crossing]
    return float(np.ptp((1.0 - fraction) * path[:, 1][crossing] + fraction * after[0][crossing]))


def evenly(path: Array) -> NDArray[np.complex128]:
    """Return :data:`PATH_POINTS` points, evenly spaced along a closed path, relative to their mean.

    Args:
        path: Points of the path, in m, shape (n, 2).

    Returns:
        The points as complex numbers, in m.
    """
    closed = np.append(path, path[:1], axis=0) @ PLANE
    way = np.append(0.0, np.abs(np.diff(closed)).cumsum())
    points = np.interp(np.linspace(0.0, way[-1], PATH_POINTS, endpoint=False), way, closed)
    return np.asarray(points - points.mean())


def toe_path(robot: Robot) -> NDArray[np.complex128]:
    """Return the path of the first toe, in the format of :func:`evenly`.

    Args:
        robot: The robot.

    Raises:
        LinkageError: If the linkage cannot turn its crank through a full revolution.
    """
    angles = np.linspace(0.0, 2.0 * math.pi, PATH_POINTS, endpoint=False)
    return evenly(kinematics.toe_positions(robot, angles)[:, 0])


def path_error(path: NDArray[np.complex128], target: NDArray[np.complex128]) -> float:
    """Return the root mean square distance between the points of two paths, relative to their size.

    Each path is divided by its own size (the root mean square distance of its points from their
    mean). The result is the smallest distance over all starting points and both directions.

    Args:
        path: Path in the format of :func:`evenly`.
        target: Path to compare it with, in the same format.
    """
    path, target = (each / np.sqrt((np.abs(each) ** 2).mean()) for each in (path, target))
    turned = [np.roll(way, k) for way in (path, path[::-1]) for k in range(PATH_POINTS)]
    return float(np.sqrt((np.abs(np.array(turned) - target) ** 2).mean(axis=1).min()))


def shared_planes(robot: Robot) -> list[tuple[Part, Part]]:
    """Return the pairs of links that lie in the same layer of the first unit of legs.

    The layers are those of the workshop drawings, so the package ``jansen_workshop`` must be
    installed.

    Args:
        robot: The robot.

    Raises:
        SystemExit: If the package is not installed.
        ValueError: If links collide in every order of layers.
    """
    need_workshop("the measure 'clearance'")
    from jansen_workshop.drawings.shaft_order import layers

    first = [placed for placed in layers(robot) if placed.unit == 0]
    return [
        ((a.leg, a.body - 1), (b.leg, b.body - 1))
        for a, b in itertools.combinations(first, 2)
        if a.layer == b.layer
    ]


def clearance(robot: Robot, planes: Sequence[tuple[Part, Part]]) -> float:
    """Return the smallest gap between links that lie in the same plane, over one turn of the crank.

    Args:
        robot: The robot.
        planes: Pairs of links that lie in the same plane.

    Returns:
        The gap in m; negative if links overlap.
    """
    from jansen_workshop.drawings.convex import gap

    turn = np.linspace(0.0, 2.0 * math.pi, SAMPLES // 2, endpoint=False)
    at = {
        k: kinematics.joint_positions(robot, robot.legs[k].side, turn + robot.legs[k].phase) @ PLANE
        for k in {leg for pair in planes for leg, _ in pair}
    }
    members = robot.linkage.members
    gaps = [gap(at[i][:, members[a]], at[k][:, members[b]]).min() for (i, a), (k, b) in planes]
    return float(min(gaps, default=math.inf)) - built.WIDTH
