"""Link lengths of each robot's episode: set or sampled at a reset, observed, and saved."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jansen_env.checks import instance, invalid, listed
from jansen_env.dynamics.gravity import GRAVITY
from jansen_env.dynamics.reduced import CONVERGED, compile_robot
from jansen_env.plants.base import static_deflection
from jansen_env.plants.parameters import EVERY, Distribution
from jansen_env.robot import Robot
from jansen_env.robot.kinematics import nearest_dead_point
from jansen_env.robot.lengths import lengths, with_lengths
from jansen_env.robot.soundness import check_loaded, check_standing
from jansen_env.world.observations import EXACT, Observed
from jansen_env.world.settings import Values

MARGIN = 0.12  # smallest sine of the angle between two links that meet, for sampled lengths
ATTEMPTS = 200  # largest number of samples per robot; six in ten are valid if lengths vary by 10 %


class Build(NamedTuple):
    """Robot of an episode that has not begun yet.

    Attributes:
        nominal: The robot with its nominal lengths.
        changed: Lengths of the episode that differ from the nominal ones, by name, in m.
        robot: The robot with the lengths of the episode.
    """

    nominal: Robot
    changed: dict[str, float]
    robot: Robot


class EpisodeLengths:
    """Link lengths of n robots in their current episodes.

    Args:
        robots: The robots with their nominal lengths.
        randomizations: Randomised parameters of each robot. Only the entry "lengths" is used.
        observed: Whether the lengths are part of the observation.
        standing: Whether the robots must be able to stand. Robots with a fixed chassis in the air
            need not.

    Attributes:
        constructed: Robots with which the environment was created.
        nominal: Present robots with their nominal lengths. Resets may exchange them, and changes of
            parts apply to them.
        changed: For each robot, lengths of the current episode that differ from the nominal ones,
            by name, in m.
        factors: For each robot, distributions of the factors on its lengths, by name.
        entries: Descriptions of the observed lengths.
        values: All lengths of the current episodes by name, in m, shape (n,). None if the lengths
            are neither sampled nor observed.

    Raises:
        ValueError: If a robot has no length with the name of a randomised length.
    """

    def __init__(
        self,
        robots: Sequence[Robot],
        randomizations: Sequence[Values],
        observed: bool,
        standing: bool = True,
    ) -> None:
        self._standing = standing
        self.constructed = list(robots)
        self.nominal = list(robots)
        self.changed: list[dict[str, float]] = [{} for _ in robots]
        self.entries: list[Observed] = []
        self.values: NDArray[np.void] | None = None
        given = [ranges.get("lengths", {}) for ranges in randomizations]
        self.factors: list[dict[str, Distribution]] = given
        if not observed and not any(given):
            return
        names = [*lengths(robots[0])]
        self.values = np.zeros(len(robots), [(name, "f8") for name in names])
        self.factors = [_by_name(factors, names) for factors in given]
        if observed:
            limits = -np.inf, np.inf
            self.entries = [Observed(f"length_{name}", "1", *limits, EXACT) for name in names]

    def connect(self, columns: Mapping[str, int], observation: NDArray[np.float32]) -> None:
        """Store the array into which the observed lengths are written.

        Args:
            columns: Indices of the columns of the array, by name.
            observation: Array of the observations, shape (n, d).
        """
        self._columns = np.array([columns[entry.name] for entry in self.entries], np.int64)
        self._observation = observation
        self._note(range(len(self.nominal)))

    def plan(
        self, i: int, given: Mapping[str, float], seed: int | None, robot: Robot | None = None
    ) -> Build | None:
        """Return the robot of the next episode, or None if the robot does not change.

        Args:
            i: Index of the robot.
            given: User-specified lengths of the next episode, by name, in m.
            seed: Seed of the sampled lengths. If None, no lengths are sampled.
            robot: Robot that replaces the present one. None to keep the present robot.

        Raises:
            ValueError: If a name is unknown, a length is out of range, or no sampled robot can turn
                its crank.
        """
        drawn = {} if seed is None else self.factors[i]
        instance("lengths", given, Mapping)
        if robot is None and not (given or drawn or self.changed[i]):
            return None
        nominal = robot or self.nominal[i]
        if self.values is not None and (*lengths(nominal),) != (names := self.values.dtype.names):
            raise ValueError(
                f"names of a robot's lengths must be {names}, got {[*lengths(nominal)]}"
            )
        if robot is not None:  # later episodes use its nominal lengths or sampled lengths
            static_deflection(robot, GRAVITY)
            if drawn and given:
                self._draw(robot, {}, drawn, np.random.default_rng((seed or 0, 0)))
        if not {*drawn} <= {*given}:
            return self._draw(nominal, given, drawn, np.random.default_rng((seed or 0, 0)))
        build = _build(nominal, given)
        if given:
            check_loaded("lengths", build.robot, self._standing)
        static_deflection(build.robot, GRAVITY)  # raises an error if the feet are too soft
        return build

    def _draw(
        self,
        nominal: Robot,
        given: Mapping[str, float],
        factors: Mapping[str, Distribution],
        rng: np.random.Generator,
    ) -> Build:
        """Sample lengths until the robot can turn its crank far from any dead point.

        Args:
            nominal: The robot with its nominal lengths.
            given: User-specified lengths by name, in m, which are not sampled.
            factors: Distributions of the factors on the nominal lengths, by name.
            rng: Random number generator.

        Raises:
            ValueError: If none of :data:`ATTEMPTS` samples is valid.
        """
        before = lengths(nominal)
        reason = ""
        for _ in range(ATTEMPTS):
            drawn = {name: before[name] * factor.sample(rng) for name, factor in factors.items()}
            try:
                build = _build(nominal, {**drawn, **given})
                sine, joint, angle = nearest_dead_point(build.robot)
                if sine >= MARGIN:
                    if self._standing:
                        check_standing(build.robot)
                    static_deflection(build.robot, GRAVITY)
                    if compile_robot(build.robot).tail <= CONVERGED:
                        return build
                reason = (
                    f"links that meet in {joint} come near one line at crank angle {angle:.3f} rad"
                )
            except ValueError as error:
                reason = str(error)
        raise ValueError(
            "randomize['lengths'] must allow robots that can turn their cranks, got none in "
            f"{ATTEMPTS} samples; the last sample was rejected because {reason}"
        )

    def begin(self, builds: Mapping[int, Build]) -> None:
        """Begin episodes with planned robots.

        Args:
            builds: Robots that :meth:`plan` returned, by index.
        """
        for i, build in builds.items():
            self.nominal[i] = build.nominal
            self.changed[i] = build.changed
        self._note(builds)

    def _note(self, which: Iterable[int]) -> None:
        """Write the lengths of some robots into the information and the observations.

        An observed length is the relative change of the nominal length.
        """
        if self.values is None:
            return
        for i in which:
            nominal = lengths(self.nominal[i])
            now = {**nominal, **self.changed[i]}
            self.values[i] = tuple(now.values())
            if len(self._columns) > 0:
                # If the nominal length is 0, as for an offset, the share is the change in m.
                shares = [(now[k] - nominal[k]) / (nominal[k] or 1.0) for k in nominal]
                self._observation[i, self._columns] = shares

    def equipped(self, i: int, parts: Values) -> Build | None:
        """Return a robot with some of its parts replaced and its lengths unchanged.

        Args:
            i: Index of the robot.
            parts: New parts by name, such as the motor. If it is empty, the method returns None.
        """
        return _build(replace(self.nominal[i], **parts), self.changed[i]) if parts else None


def _by_name(factors: dict[str, Distribution], names: Sequence[str]) -> dict[str, Distribution]:
    """Return the distributions of factors by the names of lengths, in the order of the names.

    Args:
        factors: Distributions by name. The name :data:`EVERY` stands for all lengths.
        names: Names of the lengths of a robot.

    Raises:
        ValueError: If a name is not the name of a length.
    """
    every = dict.fromkeys(names, factors[EVERY]) if EVERY in factors else factors
    if unknown := [name for name in every if name not in names]:
        allowed = listed(names, unknown[0])
        raise invalid("a key of randomize['lengths']", unknown[0], f"one of {allowed}")
    return {name: every[name] for name in names if name in every}


def _build(nominal: Robot, given: Mapping[str, float]) -> Build:
    """Return a robot with user-specified lengths, by name, in m."""
    robot = with_lengths(nominal, given) if given else nominal
    before = lengths(nominal)
    changed = {name: float(value) for name, value in given.items() if value != before[name]}
    return Build(nominal, changed, robot)
